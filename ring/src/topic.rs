//! The table of topics: a publish-subscribe service and an event service of the same name for each.

use std::collections::VecDeque;
use std::fmt::Debug;
use std::rc::Rc;
use std::time::Duration;

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::{BackpressureAction, BackpressureInfo};
use iceoryx2::prelude::*;
use iceoryx2::service::builder::publish_subscribe as publish_subscribe_builder;
use iceoryx2::service::port_factory::{event, publish_subscribe};

use crate::dead::remove_dead_nodes;
use crate::health::Health;
use crate::node::Role;
use crate::reader::{Door, MAX_EARLY, Reader};
use crate::refusals::Refusals;
use crate::ring::RingError;
use crate::writer::Writer;
use skysink_common::message::{Commit, FlightReport, Plan, QueuesHeader, SensorNode, SlotHeader};
use skysink_common::pace::Pace;
use skysink_common::path::PathPoint;
use skysink_common::stop::Stop;

/// Samples that wait for a process of the ring, which is never more than two slots behind.
pub const RING_BUFFER: usize = 4;

/// Samples that wait for the viewer or the recorder. Memory that is not used costs nothing.
pub const VIEWER_BUFFER: usize = 64;

/// The same of `path`. Its writer waits for nobody; where it waits for the viewer with the plan of a slot, none of the
/// paths before is missing, those that it repeats after a restart included.
pub const PATH_BUFFER: usize = 2 * VIEWER_BUFFER;

/// Samples that a late joiner still gets: slot 1 may be flown before the last process has seen the state before it.
const HISTORY: usize = 2;

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

/// How long a full reader is waited for before the dead ones are looked for.
const CLEAN_UP_AFTER: Duration = Duration::from_millis(20);

/// What is read from a header of any topic.
pub trait Header: Debug + Default + Copy + ZeroCopySend + 'static {
    /// Mission, slot and flags.
    fn head(&self) -> &SlotHeader;
}

impl Header for SlotHeader {
    fn head(&self) -> &SlotHeader {
        self
    }
}

impl Header for QueuesHeader {
    fn head(&self) -> &SlotHeader {
        &self.head
    }
}

/// Name of a topic, and who writes it.
pub(crate) type Name = (&'static str, Role);

/// The table of topics.
pub(crate) const SENSORS: Name = ("sensors", Role::FieldSim);
pub(crate) const QUEUES: Name = ("queues", Role::FieldSim);
pub(crate) const PLAN: Name = ("plan", Role::Planner);
pub(crate) const PATH: Name = ("path", Role::Planner);
pub(crate) const FLIGHT: Name = ("flight", Role::FlightSim);
pub(crate) const COMMIT: Name = ("commit", Role::Launcher);
pub(crate) const HEALTH: Name = ("health", Role::Launcher);

/// What a process brings to each of its topics.
#[derive(Debug, Clone)]
pub(crate) struct Member {
    /// The run it takes part in.
    pub(crate) mission: u64,
    /// Where it counts what it does not accept.
    pub(crate) refusals: Refusals,
}

/// A topic of the ring.
#[derive(Debug)]
pub struct Topic<S: Service + 'static, P: IceoryxSend + Debug + ?Sized + 'static, H: Header> {
    name: &'static str,
    from: Role,
    config: Config,
    data: Rc<Data<S, P, H>>,
    event: event::PortFactory<S>,
    member: Member,
}

/// `sensors`: every sensor node, once.
pub type SensorsTopic<S> = Topic<S, [SensorNode], SlotHeader>;
/// `queues`: the queue of every sensor node [bit]; ledger totals in the header.
pub type QueuesTopic<S> = Topic<S, [u32], QueuesHeader>;
/// `plan`: whom to serve and where to fly.
pub type PlanTopic<S> = Topic<S, Plan, SlotHeader>;
/// `path`: where the plan leads after the slot.
pub type PathTopic<S> = Topic<S, [PathPoint], SlotHeader>;
/// `flight`: where the UAV is, and what its links can carry.
pub type FlightTopic<S> = Topic<S, FlightReport, SlotHeader>;
/// `commit`: the slot is on record.
pub type CommitTopic<S> = Topic<S, Commit, SlotHeader>;
/// `health`: what becomes of the processes.
pub type HealthTopic<S> = Topic<S, Health, SlotHeader>;

/// What a writer does about a reader whose buffer is full.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Full {
    /// Waits for it: nothing is lost.
    Wait,
    /// Goes on, and the reader misses the sample.
    Miss,
}

impl Full {
    /// In lock-step everybody waits, in paced runs nobody.
    #[must_use]
    pub fn of(pace: Pace) -> Self {
        match pace {
            Pace::Max => Self::Wait,
            Pace::Factor(_) => Self::Miss,
        }
    }
}

/// What makes or opens the publish-subscribe service of a topic.
type Builder<S, P, H> = publish_subscribe_builder::Builder<P, H, S>;

/// A publish-subscribe service.
pub(crate) type Data<S, P, H> = publish_subscribe::PortFactory<S, P, H>;

impl<S: Service + 'static, P: IceoryxSend + Debug + ?Sized + 'static, H: Header> Topic<S, P, H> {
    /// The builder that makes the topic's service for readers with room for `buffer` samples.
    fn maker(node: &Node<S>, name: &'static str, buffer: usize) -> Result<Builder<S, P, H>, RingError> {
        Ok(Self::opener(node, name)?
            .max_publishers(MAX_WRITERS)
            .max_subscribers(MAX_READERS)
            .max_nodes(MAX_NODES)
            .history_size(HISTORY)
            .subscriber_max_buffer_size(buffer)
            .subscriber_max_borrowed_samples(MAX_BORROWED)
            .enable_safe_overflow(false))
    }

    /// The builder that opens the topic's service.
    fn opener(node: &Node<S>, name: &'static str) -> Result<Builder<S, P, H>, RingError> {
        Ok(node.service_builder(&service_name(name)?).publish_subscribe::<P>().user_header::<H>())
    }

    /// The topic whose service has just been made, with its event.
    fn made(node: &Node<S>, member: &Member, (name, from): Name, data: Data<S, P, H>) -> Result<Self, RingError> {
        let event = node.service_builder(&service_name(name)?).event().max_nodes(MAX_NODES);
        let event = event.create().map_err(|error| RingError::topic(name, "create its event", &error))?;
        Ok(Self { name, from, config: node.config().clone(), data: Rc::new(data), event, member: member.clone() })
    }

    /// The topic whose service has just been opened, with its event.
    fn opened(node: &Node<S>, member: &Member, (name, from): Name, data: Data<S, P, H>) -> Result<Self, RingError> {
        let event = node.service_builder(&service_name(name)?).event();
        let event = event.open().map_err(|error| RingError::topic(name, "open its event", &error))?;
        Ok(Self { name, from, config: node.config().clone(), data: Rc::new(data), event, member: member.clone() })
    }

    /// The terms under which the topic was made.
    pub(crate) fn terms(&self) -> &AttributeSet {
        self.data.attributes()
    }

    /// A reader with room for `buffer` samples, which gets the newest samples even if they were sent before.
    ///
    /// # Errors
    /// If all readers' places are taken, or the system refuses.
    pub fn reader(&self, buffer: usize) -> Result<Reader<S, P, H>, RingError> {
        let bell = self.listener()?;
        let subscriber = self
            .data
            .subscriber_builder()
            .history_request(HISTORY)
            .buffer_size(buffer)
            .create()
            .map_err(|error| RingError::topic(self.name, "read", &error))?;
        let door = Door {
            name: self.name,
            mission: self.member.mission,
            config: self.config.clone(),
            data: Rc::clone(&self.data),
            refusals: self.member.refusals.clone(),
            several: self.name == HEALTH.0,
            writer: None,
            stranger: None,
        };
        let early = VecDeque::with_capacity(MAX_EARLY);
        Ok(Reader { name: self.name, from: self.from, subscriber, bell, early, door })
    }

    /// The wake-ups of the topic, without its samples.
    ///
    /// # Errors
    /// If all listeners' places are taken, or the system refuses.
    pub fn listener(&self) -> Result<Listener<S>, RingError> {
        self.event.listener_builder().create().map_err(|error| RingError::topic(self.name, "listen", &error))
    }

    /// Wakes the topic's listeners with an event of its own, without a sample.
    ///
    /// # Errors
    /// If all notifiers' places are taken, or the system refuses.
    pub fn say(&self, event: usize) -> Result<(), RingError> {
        let said = self.notifier()?.notify_with_custom_event_id(EventId::new(event));
        said.map_err(|error| RingError::topic(self.name, "notify", &error))?;
        Ok(())
    }

    fn notifier(&self) -> Result<Notifier<S>, RingError> {
        self.event.notifier_builder().create().map_err(|error| RingError::topic(self.name, "notify", &error))
    }

    fn backpressure(
        &self,
        full: Full,
        stop: &Stop,
        timeout: Duration,
    ) -> impl Fn(&BackpressureInfo) -> BackpressureAction + use<S, P, H> {
        let (config, stop) = (self.config.clone(), stop.clone());
        move |info| match full {
            Full::Miss => BackpressureAction::DiscardData,
            Full::Wait if stop.requested().is_some() || info.elapsed_time > timeout => {
                BackpressureAction::DiscardDataAndFail
            }
            Full::Wait => {
                if info.elapsed_time > CLEAN_UP_AFTER {
                    remove_dead_nodes::<S>(&config);
                }
                BackpressureAction::Retry
            }
        }
    }
}

/// The wake-ups of a topic are named as the topic.
fn service_name(name: &'static str) -> Result<ServiceName, RingError> {
    ServiceName::new(&format!("skysink/{name}")).map_err(|error| RingError::topic(name, "name", &error))
}

impl<S: Service + 'static, P: Debug + Copy + ZeroCopySend + 'static, H: Header> Topic<S, P, H> {
    /// Makes a topic of single messages; the launcher does, and holds it for the whole run.
    pub(crate) fn create(
        node: &Node<S>,
        member: &Member,
        (name, from): Name,
        buffer: usize,
        terms: &AttributeSpecifier,
    ) -> Result<Self, RingError> {
        let data = Self::maker(node, name, buffer)?.create_with_attributes(terms);
        Self::made(node, member, (name, from), data.map_err(|error| RingError::topic(name, "create it", &error))?)
    }

    /// Opens the topic that the launcher made.
    pub(crate) fn open(node: &Node<S>, member: &Member, (name, from): Name) -> Result<Self, RingError> {
        let data = Self::opener(node, name)?.open();
        Self::opened(node, member, (name, from), data.map_err(|error| RingError::topic(name, "open it", &error))?)
    }

    /// A writer of single messages.
    ///
    /// # Errors
    /// If all writers' places are taken, or the system refuses.
    pub fn writer(&self, full: Full, stop: &Stop, timeout: Duration) -> Result<Writer<S, P, H>, RingError> {
        let publisher = self
            .data
            .publisher_builder()
            .max_loaned_samples(1)
            .set_backpressure_handler(self.backpressure(full, stop, timeout))
            .create()
            .map_err(|error| RingError::topic(self.name, WRITE, &error))?;
        Ok(Writer { name: self.name, publisher, notifier: self.notifier()?, timeout })
    }
}

impl<S: Service + 'static, T: Debug + Copy + ZeroCopySend + 'static, H: Header> Topic<S, [T], H> {
    /// Makes a topic of lists; the launcher does, and holds it for the whole run.
    pub(crate) fn create_list(
        node: &Node<S>,
        member: &Member,
        (name, from): Name,
        buffer: usize,
        terms: &AttributeSpecifier,
    ) -> Result<Self, RingError> {
        let data = Self::maker(node, name, buffer)?.create_with_attributes(terms);
        Self::made(node, member, (name, from), data.map_err(|error| RingError::topic(name, "create it", &error))?)
    }

    /// Opens the topic that the launcher made.
    pub(crate) fn open_list(node: &Node<S>, member: &Member, (name, from): Name) -> Result<Self, RingError> {
        let data = Self::opener(node, name)?.open();
        Self::opened(node, member, (name, from), data.map_err(|error| RingError::topic(name, "open it", &error))?)
    }

    /// A writer of lists of at most `len` elements.
    ///
    /// # Errors
    /// If all writers' places are taken, or the system refuses.
    pub fn list_writer(
        &self,
        len: usize,
        full: Full,
        stop: &Stop,
        timeout: Duration,
    ) -> Result<Writer<S, [T], H>, RingError> {
        let publisher = self
            .data
            .publisher_builder()
            .initial_max_slice_len(len)
            .max_loaned_samples(1)
            .set_backpressure_handler(self.backpressure(full, stop, timeout))
            .create()
            .map_err(|error| RingError::topic(self.name, WRITE, &error))?;
        Ok(Writer { name: self.name, publisher, notifier: self.notifier()?, timeout })
    }
}
