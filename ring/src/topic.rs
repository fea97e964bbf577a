//! A topic: a publish-subscribe service and an event service of the same name, its readers and its writers.

use std::collections::VecDeque;
use std::fmt::Debug;
use std::rc::Rc;
use std::time::Duration;

use iceoryx2::port::listener::Listener;
use iceoryx2::port::{BackpressureAction, BackpressureInfo};
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::event;
use iceoryx2::service::port_factory::publisher::PortFactoryPublisher;
use skysink_common::pace::Pace;
use skysink_common::stop::Stop;

use crate::admission::{Admission, Data};
use crate::cleanup::remove_dead_nodes;
use crate::error::RingError;
use crate::folder::Terms;
use crate::reader::{MAX_EARLY, Reader};
use crate::refusals::Refusals;
use crate::role::Role;
use crate::sample::{Header, Payload};
use crate::wait::LateJoiners;
use crate::writer::Writer;

/// Samples that a reader holds at once: one it works on, and those that came early.
const MAX_BORROWED: usize = MAX_EARLY + 1;

/// Readers of a topic: the ring, the viewer, and room for programs from outside.
const MAX_READERS: usize = 8;

/// Writers of a topic: one by its role; the second place is for restarts and links between hosts.
const MAX_WRITERS: usize = 2;

/// Processes that open a topic.
const MAX_NODES: usize = 20;

/// What is tried when a writer's place is taken.
const WRITE: &str = "write (if all places are taken, end the other program)";

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
    /// Goes on, and the reader misses the sample.
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
    pub(crate) stop: Stop,
}

/// A topic of the ring.
#[derive(Debug)]
pub struct Topic<S: Service + 'static, P: Payload + ?Sized, H: Header> {
    row: Row,
    config: Config,
    data: Rc<Data<S, P, H>>,
    event: Rc<event::PortFactory<S>>,
    member: Member,
}

impl<S: Service + 'static, P: Payload + ?Sized, H: Header> Topic<S, P, H> {
    /// The topic of a row: created if there are `terms`, which the launcher has; opened if there are none.
    pub(crate) fn new(
        node: &Node<S>,
        member: &Member,
        row: Row,
        terms: Option<&AttributeSpecifier>,
    ) -> Result<Self, RingError> {
        let refuse = |action, error: &dyn Debug| RingError::topic(row.name, action, error);
        let name = ServiceName::new(&format!("skysink/{}", row.name)).map_err(|error| refuse("name", &error))?;
        let builder = node.service_builder(&name).publish_subscribe::<P>().user_header::<H>();
        let events = node.service_builder(&name).event();
        let (data, event) = match terms {
            Some(terms) => {
                let builder = builder
                    .max_publishers(MAX_WRITERS)
                    .max_subscribers(MAX_READERS)
                    .max_nodes(MAX_NODES)
                    .history_size(row.history)
                    .subscriber_max_buffer_size(row.buffer)
                    .subscriber_max_borrowed_samples(MAX_BORROWED)
                    .enable_safe_overflow(false);
                let data = P::create(builder, terms).map_err(|error| refuse("create it", &error))?;
                let event = events.max_nodes(MAX_NODES).create();
                (data, event.map_err(|error| refuse("create its event", &error))?)
            }
            None => {
                let data = P::open(builder).map_err(|error| refuse("open it", &error))?;
                (data, events.open().map_err(|error| refuse("open its event", &error))?)
            }
        };
        let (config, member) = (node.config().clone(), member.clone());
        Ok(Self { row, config, data: Rc::new(data), event: Rc::new(event), member })
    }

    /// The terms under which the topic was created.
    pub(crate) fn terms(&self) -> &AttributeSet {
        self.data.attributes()
    }

    /// A reader with room for `buffer` samples, which gets the newest samples even if they were sent before.
    ///
    /// # Errors
    /// If all readers' places are taken, or the system refuses.
    pub fn reader(&self, buffer: usize) -> Result<Reader<S, P, H>, RingError> {
        let Row { name, from, history, .. } = self.row;
        let subscriber = self.data.subscriber_builder().history_request(history).buffer_size(buffer).create();
        let admission = Admission {
            name,
            mission: self.member.terms.mission,
            config: self.config.clone(),
            data: Rc::clone(&self.data),
            refusals: self.member.refusals.clone(),
            several: self.row.several,
            writer: None,
            second_writer: None,
        };
        Ok(Reader {
            name,
            from,
            max_ahead: self.member.max_ahead,
            subscriber: subscriber.map_err(|error| RingError::topic(name, "read", &error))?,
            listener: None,
            event: Rc::clone(&self.event),
            early: VecDeque::with_capacity(MAX_EARLY),
            admission,
        })
    }

    /// The wake-ups of the topic, without its samples. Listeners that were attached earlier are notified first.
    ///
    /// # Errors
    /// If all listeners' places are taken, or the system refuses.
    pub fn listener(&self) -> Result<Listener<S>, RingError> {
        self.event.listener_builder().create().map_err(|error| RingError::topic(self.row.name, "listen", &error))
    }

    fn write_by(&self, builder: PortFactoryPublisher<'_, S, P, H>) -> Result<Writer<S, P, H>, RingError> {
        let name = self.row.name;
        let builder = builder.max_loaned_samples(1).set_backpressure_handler(self.backpressure());
        let publisher = builder.create().map_err(|error| RingError::topic(name, WRITE, &error))?;
        let notifier = self.event.notifier_builder().create();
        let notifier = notifier.map_err(|error| RingError::topic(name, "notify", &error))?;
        Ok(Writer::new(name, publisher, notifier, self.member.terms.timeout(), &self.member.late_joiners))
    }

    fn backpressure(&self) -> impl Fn(&BackpressureInfo) -> BackpressureAction + use<S, P, H> {
        let (config, stop, timeout) = (self.config.clone(), self.member.stop.clone(), self.member.terms.timeout());
        let waits = self.row.full == Full::WaitInLockStep && self.member.terms.pace == Pace::Max;
        move |info| {
            if !waits {
                return BackpressureAction::DiscardData;
            }
            if stop.requested().is_some() || info.elapsed_time > timeout {
                return BackpressureAction::DiscardDataAndFail;
            }
            if info.elapsed_time > CLEAN_UP_AFTER {
                remove_dead_nodes::<S>(&config);
            }
            BackpressureAction::Retry
        }
    }
}

impl<S: Service + 'static, P: Debug + Copy + ZeroCopySend + 'static, H: Header> Topic<S, P, H> {
    /// A writer of single messages.
    ///
    /// # Errors
    /// If all writers' places are taken, or the system refuses.
    pub fn writer(&self) -> Result<Writer<S, P, H>, RingError> {
        self.write_by(self.data.publisher_builder())
    }
}

impl<S: Service + 'static, T: Debug + Copy + ZeroCopySend + 'static, H: Header> Topic<S, [T], H> {
    /// A writer of lists of at most `len` elements.
    ///
    /// # Errors
    /// If all writers' places are taken, or the system refuses.
    pub fn list_writer(&self, len: usize) -> Result<Writer<S, [T], H>, RingError> {
        self.write_by(self.data.publisher_builder().initial_max_slice_len(len))
    }
}
