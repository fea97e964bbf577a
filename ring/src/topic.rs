//! A topic: a publish-subscribe service and an event service of the same name. Its ends are in `reader` and `writer`.

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
use skysink_common::scenario::Scenario;
use skysink_common::stop::Stop;

use crate::cleanup::remove_dead_nodes;
use crate::error::RingError;
use crate::refusals::Refusals;
use crate::role::{Role, RoleLock};
use crate::sample::{Header, Payload};
use crate::terms::Terms;
use crate::wait::{LateJoiners, Stopwatch};

/// Most samples of later slots that a reader keeps.
pub(crate) const MAX_EARLY: usize = 3;

/// Most samples that a reader borrows: those of later slots, and the one in use.
const MAX_BORROWED: usize = MAX_EARLY + 1;

/// Most readers of a topic: the ring, the viewer, and external programs.
const MAX_READERS: usize = 8;

/// Most writers of a topic: the process of its role, and one for restarts and links between hosts.
const MAX_WRITERS: usize = 2;

/// Name of a subscriber that no writer waits for: it misses samples while its buffer is full.
pub(crate) const OBSERVER: &str = "observer";

/// Most processes that open a topic.
const MAX_NODES: usize = 20;

/// How long a writer waits for a full reader before it removes dead processes.
const CLEAN_UP_AFTER: Duration = Duration::from_millis(20);

/// How many samples a topic has in a slot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SamplesPerSlot {
    /// One.
    One,
    /// One or none.
    AtMostOne,
    /// Any number.
    Any,
}

/// A row of the table of topics.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TopicRow {
    pub(crate) name: &'static str,
    /// The process that writes it.
    pub(crate) writer: Role,
    /// The processes that read it.
    pub(crate) readers: &'static [Role],
    /// Largest buffer of a reader [samples].
    pub(crate) buffer: usize,
    /// Samples that a late joiner receives.
    pub(crate) history: usize,
    pub(crate) on_full: OnFullBuffer,
    /// Whether a sample has one element for each UAV; readers refuse others.
    pub(crate) is_by_uav: bool,
    pub(crate) samples: SamplesPerSlot,
    /// Whether its notifications are the heartbeats of its writer, which notifies its readers while it waits, too. Each
    /// process writes one such topic.
    pub(crate) is_heartbeat: bool,
    /// Whether a link carries it to other hosts.
    pub(crate) is_linked: bool,
    /// Which runs have it.
    pub(crate) exists: Existence,
}

/// Which runs have a topic.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Existence {
    /// All.
    Always,
    /// Those with such terms.
    WithTerms(fn(&Terms) -> bool),
    /// Those of such scenarios; their terms list it (`topics`).
    WithScenario(fn(&Scenario) -> bool),
}

impl TopicRow {
    /// Whether a run with these terms has the topic.
    pub(crate) fn exists(&self, terms: &Terms) -> bool {
        match self.exists {
            Existence::Always => true,
            Existence::WithTerms(exists) => exists(terms),
            Existence::WithScenario(_) => terms.topics.iter().any(|name| name == self.name),
        }
    }

    /// The name of the topic's services.
    pub(crate) fn service(&self) -> String {
        format!("skysink/{}", self.name)
    }

    /// The name of the topic's services, checked by iceoryx2.
    pub(crate) fn service_name(&self) -> Result<ServiceName, RingError> {
        ServiceName::new(&self.service()).map_err(|error| RingError::topic(self.name, "name it", &error))
    }
}

/// What a writer does if the buffer of a reader is full.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum OnFullBuffer {
    /// In lock-step, blocks until the reader takes a sample; in paced runs, drops the sample.
    BlockInLockStep,
    /// Drops the sample for this reader.
    DropSample,
}

/// The state of a process that its topics share.
#[derive(Debug, Clone)]
pub(crate) struct Participant {
    pub(crate) terms: Terms,
    /// `None` for an observer.
    pub(crate) role: Option<Role>,
    /// The number of UAVs; `None` for an observer, who takes any.
    pub(crate) uavs: Option<usize>,
    /// Most slots by which the ring can be ahead of this process; `None` if it may lag.
    pub(crate) max_ahead: Option<u64>,
    /// Counts of refused samples, except those of topics that only the viewer reads.
    pub(crate) refusals: Refusals,
    pub(crate) late_joiners: LateJoiners,
    /// The lock of its role, for heartbeats; `None` in the launcher.
    pub(crate) role_lock: Option<Arc<RoleLock>>,
    pub(crate) stop: Stop,
}

/// A topic of the ring.
#[derive(Debug)]
pub struct Topic<S: Service + 'static, P: Payload + ?Sized, H: Header>(pub(crate) Rc<TopicShared<S, P, H>>);

/// The state that a topic shares with its readers and writers.
#[derive(Debug)]
pub(crate) struct TopicShared<S: Service + 'static, P: Payload + ?Sized, H: Header> {
    pub(crate) row: &'static TopicRow,
    pub(crate) config: Config,
    pub(crate) data: Arc<publish_subscribe::PortFactory<S, P, H>>,
    event: event::PortFactory<S>,
    pub(crate) member: Participant,
    pub(crate) refusals: Refusals,
}

/// What it takes to open topics.
pub(crate) struct Opening<'a, S: Service + 'static> {
    pub(crate) node: &'a Node<S>,
    pub(crate) member: &'a Participant,
    /// The attributes with which the launcher creates the topics; `None` to open them.
    pub(crate) created_with: Option<&'a AttributeSpecifier>,
}

impl<S: Service + 'static, P: Payload + ?Sized, H: Header> Topic<S, P, H> {
    /// The topic of a row.
    pub(crate) fn open(opening: &Opening<'_, S>, row: &'static TopicRow) -> Result<Self, RingError> {
        let Opening { node, member, created_with: terms } = *opening;
        let action = if terms.is_some() { "create it" } else { "open it" };
        let refuse = |error: &dyn Debug| RingError::topic(row.name, action, error);
        let name = row.service_name()?;
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
        // No other process logs refusals of a topic that only the viewer reads.
        let refusals = if row.readers == [Role::Viewer] { Refusals::new(member.role) } else { member.refusals.clone() };
        let config = node.config().clone();
        Ok(Self(Rc::new(TopicShared { row, config, data, event, member: member.clone(), refusals })))
    }

    /// The name of the topic.
    pub fn name(&self) -> &'static str {
        self.0.row.name
    }

    /// The process that writes the topic.
    pub fn written_by(&self) -> Role {
        self.0.row.writer
    }

    /// Whether a process or a link is attached as a writer.
    pub fn has_writer(&self) -> bool {
        !self.writers().is_empty()
    }

    /// The attached writers.
    pub(crate) fn writers(&self) -> Vec<UniqueNodeId> {
        let mut writers = Vec::new();
        self.0.data.dynamic_config().list_publishers(|port| {
            writers.push(port.node_id);
            CallbackProgression::Continue
        });
        writers
    }

    /// The attributes with which the topic was created.
    pub(crate) fn terms(&self) -> &AttributeSet {
        self.0.data.attributes()
    }

    /// A listener to the notifications of the topic. Listeners that were attached earlier are notified first.
    ///
    /// # Errors
    /// If the topic has its maximum of listeners, or iceoryx2 fails.
    pub fn listener(&self) -> Result<Listener<S>, RingError> {
        self.0.listener()
    }
}

impl<S: Service + 'static, P: Payload + ?Sized, H: Header> TopicShared<S, P, H> {
    pub(crate) fn listener(&self) -> Result<Listener<S>, RingError> {
        self.event.listener_builder().create().map_err(|error| self.refuse("listen", &error))
    }

    pub(crate) fn notifier(&self) -> Result<Notifier<S>, RingError> {
        self.event.notifier_builder().create().map_err(|error| self.refuse("notify", &error))
    }

    /// The error of a failed `action`.
    pub(crate) fn refuse(&self, action: &'static str, error: &dyn Debug) -> RingError {
        RingError::topic(self.row.name, action, error)
    }

    /// The handler for full buffers of readers. While `is_repeating`, samples are dropped.
    pub(crate) fn backpressure(
        &self,
        is_repeating: Arc<AtomicBool>,
    ) -> impl Fn(&BackpressureInfo) -> BackpressureAction + use<S, P, H> {
        let config = self.config.clone();
        let data = Arc::clone(&self.data);
        let stop = self.member.stop.clone();
        let role_lock = self.member.role_lock.clone();
        let limit = self.member.terms.full_limit();
        let waited = Mutex::new(Stopwatch::start(Instant::now()));
        let is_blocking = self.row.on_full == OnFullBuffer::BlockInLockStep && self.member.terms.pace == Pace::Max;
        move |info| {
            if !is_blocking || is_repeating.load(Ordering::Relaxed) || is_observer(&data, info.receiver_port_id) {
                return BackpressureAction::DiscardData;
            }
            let now = Instant::now();
            let mut waited = waited.lock().unwrap_or_else(PoisonError::into_inner);
            if info.retries == 0 {
                *waited = Stopwatch::start(now); // a new wait
            }
            if stop.requested().is_some() || waited.advance(now) > limit {
                return BackpressureAction::DiscardDataAndFail;
            }
            if info.elapsed_time > CLEAN_UP_AFTER {
                role_lock.iter().for_each(|lock| lock.beat(now));
                remove_dead_nodes::<S>(&config);
            }
            BackpressureAction::Retry
        }
    }
}

/// Whether this subscriber is an [`OBSERVER`].
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
