//! A topic: a publish-subscribe service and an event service of the same name. Its two ends are `reader` and `writer`.

use std::fmt::Debug;
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::{BackpressureAction, BackpressureInfo};
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::{event, publish_subscribe};
use skysink_common::pace::Pace;
use skysink_common::stop::Stop;

use crate::cleanup::remove_dead_nodes;
use crate::error::RingError;
use crate::refusals::Refusals;
use crate::role::{Role, Seat};
use crate::sample::{Header, Payload};
use crate::terms::Terms;
use crate::wait::{LateJoiners, Stopwatch};

/// Samples that a reader holds because they came early. With the one that is worked on they are all that it may hold.
pub(crate) const MAX_EARLY: usize = 3;

/// Samples that a reader holds at once: one it works on, and those that came early.
const MAX_BORROWED: usize = MAX_EARLY + 1;

/// Readers of a topic: the ring, the viewer, and room for programs from outside.
const MAX_READERS: usize = 8;

/// Writers of a topic: one by its role; the second place is for restarts and links between hosts.
const MAX_WRITERS: usize = 2;

/// Name of a subscriber that no writer waits for: if its buffer is full it misses samples.
pub(crate) const OBSERVER: &str = "observer";

/// Processes that open a topic.
const MAX_NODES: usize = 20;

/// How long a full reader is waited for before dead ones are looked for.
const CLEAN_UP_AFTER: Duration = Duration::from_millis(20);

/// A row of the table of topics.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row {
    pub(crate) name: &'static str,
    /// Who writes it.
    pub(crate) from: Role,
    /// Most samples that wait for a reader.
    pub(crate) buffer: usize,
    pub(crate) history: usize,
    pub(crate) full: Full,
    /// Whether a slot may have several samples.
    pub(crate) several: bool,
}

/// What a writer does about a reader whose buffer is full.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Full {
    /// Waits for it in lock-step, so that nothing is lost; in paced runs nobody waits.
    WaitInLockStep,
    /// Sends no sample, and the reader misses it.
    Miss,
}

/// What a process brings to each of its topics.
#[derive(Debug, Clone)]
pub(crate) struct Member {
    pub(crate) terms: Terms,
    /// How far ahead the ring can be of this process; none if it may lag.
    pub(crate) max_ahead: Option<u64>,
    /// Where it counts what it does not accept.
    pub(crate) refusals: Refusals,
    pub(crate) late_joiners: LateJoiners,
    /// Where it shows that it is alive; none in the launcher.
    pub(crate) seat: Option<Arc<Seat>>,
    pub(crate) stop: Stop,
}

/// A topic of the ring.
#[derive(Debug)]
pub struct Topic<S: Service + 'static, P: Payload + ?Sized, H: Header>(pub(crate) Rc<Shared<S, P, H>>);

/// What a topic shares with its readers and writers.
#[derive(Debug)]
pub(crate) struct Shared<S: Service + 'static, P: Payload + ?Sized, H: Header> {
    pub(crate) row: Row,
    pub(crate) config: Config,
    pub(crate) data: Arc<publish_subscribe::PortFactory<S, P, H>>,
    event: event::PortFactory<S>,
    pub(crate) member: Member,
}

impl<S: Service + 'static, P: Payload + ?Sized, H: Header> Topic<S, P, H> {
    /// The topic of a row: created if there are `terms`, which the launcher has; opened if there are none.
    pub(crate) fn new(
        node: &Node<S>,
        member: &Member,
        row: Row,
        terms: Option<&AttributeSpecifier>,
    ) -> Result<Self, RingError> {
        let action = if terms.is_some() { "create it" } else { "open it" };
        let refuse = |error: &dyn Debug| RingError::topic(row.name, action, error);
        let name = service_name(row.name)?;
        let mut builder = node.service_builder(&name).publish_subscribe::<P>().user_header::<H>();
        let events = node.service_builder(&name).event();
        if terms.is_some() {
            builder = builder
                .max_publishers(MAX_WRITERS)
                .max_subscribers(MAX_READERS)
                .max_nodes(MAX_NODES)
                .history_size(row.history)
                .subscriber_max_buffer_size(row.buffer)
                .subscriber_max_borrowed_samples(MAX_BORROWED)
                .enable_safe_overflow(false);
        }
        let data = Arc::new(P::service(builder, terms).map_err(|error| refuse(&error))?);
        let event = match terms {
            Some(_) => events.max_nodes(MAX_NODES).create().map_err(|error| refuse(&error))?,
            None => events.open().map_err(|error| refuse(&error))?,
        };
        Ok(Self(Rc::new(Shared { row, config: node.config().clone(), data, event, member: member.clone() })))
    }

    /// Whether a process is attached to write the topic, or a link.
    #[must_use]
    pub fn has_writer(&self) -> bool {
        !self.writers().is_empty()
    }

    /// The processes that are attached to write the topic.
    pub(crate) fn writers(&self) -> Vec<UniqueNodeId> {
        let mut writers = Vec::new();
        self.0.data.dynamic_config().list_publishers(|port| {
            writers.push(port.node_id);
            CallbackProgression::Continue
        });
        writers
    }

    /// The terms under which the topic was created.
    pub(crate) fn terms(&self) -> &AttributeSet {
        self.0.data.attributes()
    }

    /// The wake-ups of the topic, without its samples. Listeners that were attached earlier are notified first.
    ///
    /// # Errors
    /// If all listeners' places are taken, or the system refuses.
    pub fn listener(&self) -> Result<Listener<S>, RingError> {
        self.0.listener()
    }
}

impl<S: Service + 'static, P: Payload + ?Sized, H: Header> Shared<S, P, H> {
    pub(crate) fn listener(&self) -> Result<Listener<S>, RingError> {
        self.event.listener_builder().create().map_err(|error| self.refuse("listen", &error))
    }

    pub(crate) fn notifier(&self) -> Result<Notifier<S>, RingError> {
        self.event.notifier_builder().create().map_err(|error| self.refuse("notify", &error))
    }

    /// What iceoryx2 refuses to do.
    pub(crate) fn refuse(&self, action: &'static str, error: &dyn Debug) -> RingError {
        RingError::topic(self.row.name, action, error)
    }

    /// What is done about a full reader; while `is_repeating`, nothing.
    pub(crate) fn backpressure(
        &self,
        is_repeating: Arc<AtomicBool>,
    ) -> impl Fn(&BackpressureInfo) -> BackpressureAction + use<S, P, H> {
        let config = self.config.clone();
        let data = Arc::clone(&self.data);
        let stop = self.member.stop.clone();
        let seat = self.member.seat.clone();
        let limit = self.member.terms.full_limit();
        let waited = Mutex::new(Stopwatch::start(Instant::now()));
        let waits = self.row.full == Full::WaitInLockStep && self.member.terms.pace == Pace::Max;
        move |info| {
            if !waits || is_repeating.load(Ordering::Relaxed) || is_observer(&data, info.receiver_port_id) {
                return BackpressureAction::DiscardData;
            }
            let now = Instant::now();
            let mut waited = waited.lock().unwrap_or_else(PoisonError::into_inner);
            if info.retries == 0 {
                *waited = Stopwatch::start(now); // another buffer is full
            }
            if stop.requested().is_some() || waited.advance(now) > limit {
                return BackpressureAction::DiscardDataAndFail;
            }
            if info.elapsed_time > CLEAN_UP_AFTER {
                seat.iter().for_each(|seat| seat.beat(now));
                remove_dead_nodes::<S>(&config);
            }
            BackpressureAction::Retry
        }
    }
}

/// The name of the services of a topic.
pub(crate) fn service_name(topic: &'static str) -> Result<ServiceName, RingError> {
    ServiceName::new(&format!("skysink/{topic}")).map_err(|error| RingError::topic(topic, "name it", &error))
}

/// Whether this subscriber only observes.
fn is_observer<S: Service, P: Payload + ?Sized, H: Header>(
    data: &publish_subscribe::PortFactory<S, P, H>,
    subscriber: u128,
) -> bool {
    let mut is_observer = false;
    data.dynamic_config().list_subscribers(|port| {
        if port.subscriber_id.value() != subscriber {
            return CallbackProgression::Continue;
        }
        is_observer = port.subscriber_name.as_str() == OBSERVER;
        CallbackProgression::Stop
    });
    is_observer
}
