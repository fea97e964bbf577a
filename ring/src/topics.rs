//! The topics of a run: a publish-subscribe service and an event service of the same name for each.
//!
//! Every run has a folder and a prefix of its own, so that two runs never meet. The launcher creates the topics and holds
//! them; a process of the ring only opens them.

use std::collections::VecDeque;
use std::fmt::Debug;
use std::rc::Rc;
use std::time::Duration;

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::{BackpressureAction, BackpressureInfo};
use iceoryx2::prelude::*;
use iceoryx2::service::builder::publish_subscribe as publish_subscribe_builder;
use iceoryx2::service::port_factory::event;
use rustix::time::{ClockId, clock_gettime};
use skysink_common::message::{Commit, FlightReport, Plan, QueuesHeader, SensorNode, SlotHeader};
use skysink_common::pace::Pace;
use skysink_common::path::PathPoint;
use skysink_common::scenario::Scenario;
use skysink_common::stop::Stop;

use crate::admission::{Admission, Data, Header};
use crate::cleanup::{purge_dead_nodes, remove_dead_nodes};
use crate::error::RingError;
use crate::folder::{RingFolder, Terms};
use crate::health::Health;
use crate::reader::{MAX_EARLY, Reader};
use crate::refusals::Refusals;
use crate::role::{Role, Seat};
use crate::wait::WaitContext;
use crate::writer::Writer;

/// Version of the messages and of what they mean; processes of different versions do not meet.
pub const SCHEMA: &str = "2";

/// Event by which the viewer says that it is connected to every writer, on the topic `commit`.
pub const VIEWER_READY: usize = 11;

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
        let listener = self.listener()?;
        let subscriber = self
            .data
            .subscriber_builder()
            .history_request(HISTORY)
            .buffer_size(buffer)
            .create()
            .map_err(|error| RingError::topic(self.name, "read", &error))?;
        let admission = Admission {
            name: self.name,
            mission: self.member.mission,
            config: self.config.clone(),
            data: Rc::clone(&self.data),
            refusals: self.member.refusals.clone(),
            several: self.name == HEALTH.0,
            writer: None,
            second_writer: None,
        };
        let early = VecDeque::with_capacity(MAX_EARLY);
        Ok(Reader { name: self.name, from: self.from, subscriber, listener, early, admission })
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

/// The topics of a run, opened.
#[derive(Debug)]
pub struct Ring<S: Service + 'static> {
    /// What the run has agreed on.
    pub terms: Terms,
    /// Every sensor node, once.
    pub sensors: SensorsTopic<S>,
    /// The queues after each slot.
    pub queues: QueuesTopic<S>,
    /// The plan of each slot.
    pub plan: PlanTopic<S>,
    /// Where the plan leads, of planners that know.
    pub path: PathTopic<S>,
    /// The flight of each slot.
    pub flight: FlightTopic<S>,
    /// The slots on record.
    pub commit: CommitTopic<S>,
    /// What becomes of the processes.
    pub health: HealthTopic<S>,
    /// What this process did not accept.
    pub refusals: Refusals,
    /// How often its seat was taken before.
    epoch: u32,
    node: Node<S>,
}

impl<S: Service + 'static> Ring<S> {
    /// Makes the ring in its folder; the launcher does, and keeps it for the whole run.
    ///
    /// # Errors
    /// If iceoryx2 cannot create its services.
    pub fn create(folder: &RingFolder, scenario: &Scenario) -> Result<Self, RingError> {
        let terms = folder.terms();
        let node = node::<S>(folder, Role::Launcher)?;
        folder.close_counter().map_err(|error| RingError::topic("ring", "close its counter", &error))?;
        let agreed = attributes(&terms, scenario)?;
        let member = Member { mission: terms.mission, refusals: Refusals::new(None) };
        Ok(Self {
            terms,
            sensors: Topic::create_list(&node, &member, SENSORS, RING_BUFFER, &agreed)?,
            queues: Topic::create_list(&node, &member, QUEUES, VIEWER_BUFFER, &agreed)?,
            plan: Topic::create(&node, &member, PLAN, VIEWER_BUFFER, &agreed)?,
            path: Topic::create_list(&node, &member, PATH, PATH_BUFFER, &agreed)?,
            flight: Topic::create(&node, &member, FLIGHT, VIEWER_BUFFER, &agreed)?,
            commit: Topic::create(&node, &member, COMMIT, RING_BUFFER, &agreed)?,
            health: Topic::create(&node, &member, HEALTH, VIEWER_BUFFER, &agreed)?,
            refusals: member.refusals,
            epoch: 0,
            node,
        })
    }

    /// Opens the ring in its folder, in the `seat` of `role`, and checks that it flies `scenario`.
    ///
    /// # Errors
    /// If the ring is not there or flies another scenario.
    pub fn open(folder: &RingFolder, scenario: &Scenario, role: Role, seat: &Seat) -> Result<Self, RingError> {
        let terms = folder.terms();
        let node = node::<S>(folder, role)?;
        // The ring's own processes say what they refuse; the viewer only looks on, but nobody else reads paths.
        let speaker = Some(role).filter(|&role| role != Role::Viewer);
        let member = Member { mission: terms.mission, refusals: Refusals::new(speaker) };
        let only_reader = Member { refusals: Refusals::new(Some(role)), ..member };
        let sensors = Topic::open_list(&node, &member, SENSORS)?;
        agree(folder, sensors.terms(), scenario)?;
        Ok(Self {
            terms,
            sensors,
            queues: Topic::open_list(&node, &member, QUEUES)?,
            plan: Topic::open(&node, &member, PLAN)?,
            path: Topic::open_list(&node, &only_reader, PATH)?,
            flight: Topic::open(&node, &member, FLIGHT)?,
            commit: Topic::open(&node, &member, COMMIT)?,
            health: Topic::open(&node, &member, HEALTH)?,
            refusals: member.refusals,
            epoch: seat.restarts(),
            node,
        })
    }

    /// Frees what processes that died have left behind; the launcher does. What it cannot free goes with the folder.
    pub fn remove_dead_nodes(&self) {
        purge_dead_nodes::<S>(self.node.config());
    }

    /// A header of this run, sent now.
    #[must_use]
    pub fn header(&self, slot: u64, flags: u32) -> SlotHeader {
        SlotHeader { mission: self.terms.mission, slot, epoch: self.epoch, flags, sent_ns: monotonic_ns() }
    }

    /// How long a process of this run waits for another.
    #[must_use]
    pub fn timeout(&self) -> Duration {
        Duration::from_secs_f64(self.terms.timeout_s)
    }

    /// The wait context of a process of this run, which keeps the heartbeat of its seat going; the launcher has none.
    ///
    /// # Errors
    /// If the supervisor's lock is not there.
    pub fn wait_context(&self, folder: &RingFolder, seat: Option<Seat>, stop: &Stop) -> Result<WaitContext, RingError> {
        Ok(WaitContext::new(stop.clone(), folder.supervisor()?, seat, self.timeout(), self.terms.wait))
    }
}

/// Time on the monotonic clock [ns], common to all processes of a machine.
#[must_use]
pub fn monotonic_ns() -> u64 {
    let time = clock_gettime(ClockId::Monotonic);
    time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64 // the clock starts at boot: both are positive
}

fn node<S: Service>(folder: &RingFolder, role: Role) -> Result<Node<S>, RingError> {
    let name = NodeName::new(role.name()).map_err(|error| RingError::topic("ring", "name the process", &error))?;
    NodeBuilder::new()
        .config(&folder.config()?)
        .name(&name)
        .signal_handling_mode(SignalHandlingMode::Disabled) // see `Stop`
        .create::<S>()
        .map_err(|error| RingError::topic("ring", "join", &error))
}

/// What every process must agree on, by key.
fn agreement(scenario: &Scenario) -> [(&'static str, String, &'static str); 3] {
    [
        ("version", SCHEMA.to_owned(), "use the executables of one build"),
        ("program", env!("CARGO_PKG_VERSION").to_owned(), "use the executables of one build"),
        ("scenario", format!("{:016x}", scenario.hash()), "pass the scenario.toml of the run's folder"),
    ]
}

fn attributes(terms: &Terms, scenario: &Scenario) -> Result<AttributeSpecifier, RingError> {
    let mission = ("mission", format!("{:016x}", terms.mission), "");
    let mut specifier = AttributeSpecifier::new();
    for (key, value, _) in agreement(scenario).into_iter().chain([mission]) {
        let refuse = |error: &dyn std::fmt::Debug| RingError::topic("ring", "define its terms", error);
        let (key, value) = (key.try_into().map_err(|error| refuse(&error))?, value.as_str().try_into());
        let value = value.map_err(|error| refuse(&error))?;
        specifier = specifier.define(&key, &value).map_err(|error| refuse(&error))?;
    }
    Ok(specifier)
}

fn agree(folder: &RingFolder, theirs: &AttributeSet, scenario: &Scenario) -> Result<(), RingError> {
    for (what, ours, remedy) in agreement(scenario) {
        let key = what.try_into().map_err(|error| RingError::topic("ring", "read its terms", &error))?;
        let theirs = theirs.key_value(&key, 0).map_or_else(|| "missing".to_owned(), ToString::to_string);
        if theirs != ours {
            let folder = folder.path().display().to_string();
            return Err(RingError::Differs { folder, what, theirs, ours, remedy });
        }
    }
    Ok(())
}
