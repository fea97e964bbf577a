//! The topics of a run: a publish-subscribe service and an event service of the same name for each.
//!
//! Every run has a folder and a prefix of its own, so that two runs never meet. The launcher creates the topics and holds
//! them; a process of the ring only opens them.

use std::collections::VecDeque;
use std::fmt::Debug;
use std::rc::Rc;
use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::{BackpressureAction, BackpressureInfo};
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::event;
use rustix::time::{ClockId, clock_gettime};
use skysink_common::message::{Commit, FLAG_END, FlightReport, Plan, QueuesHeader, SensorNode, SlotHeader, Tick};
use skysink_common::pace::Pace;
use skysink_common::path::PathPoint;
use skysink_common::scenario::Scenario;
use skysink_common::stop::Stop;

use crate::admission::{Admission, Data};
use crate::cleanup::{purge_dead_nodes, remove_dead_nodes};
use crate::error::{NodeError, RingError};
use crate::folder::{RingFolder, Terms};
use crate::health::{Health, Ready};
use crate::reader::{MAX_AHEAD, MAX_EARLY, Reader};
use crate::refusals::Refusals;
use crate::role::{Role, Seat};
use crate::sample::{Header, Payload};
use crate::wait::{LateJoiners, PAUSE, WaitContext};
use crate::writer::Writer;

/// Version of the messages and of what they mean; processes of different versions do not meet.
pub const SCHEMA: &str = "3";

/// Samples that wait for a process of the ring: it is never more than two slots behind, but writers that are started again
/// repeat themselves. Memory that is not used costs nothing.
pub const RING_BUFFER: usize = 16;

/// Samples that wait for the viewer or the recorder.
pub const VIEWER_BUFFER: usize = 64;

/// The same of `path`. Its writer waits for nobody; where it waits for the viewer with the plan of a slot, none of the
/// paths before is missing, those that it repeats after a restart included.
pub const PATH_BUFFER: usize = 2 * VIEWER_BUFFER;

/// Samples that a late joiner still gets: slot 1 may be flown before the last process has seen the state before it.
const HISTORY: usize = 2;

/// The same of `flight`, which may be two slots ahead of the record: a planner that is started again then finds the flight
/// before each plan that the recorder may still wait for.
pub const FLIGHT_HISTORY: usize = 3;

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
struct Row {
    name: &'static str,
    /// Who writes it.
    from: Role,
    /// Most samples that wait for a reader.
    buffer: usize,
    history: usize,
    full: Full,
}

/// What a writer does about a reader whose buffer is full.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Full {
    /// Waits for it in lock-step, so that nothing is lost; in paced runs nobody waits.
    WaitInLockStep,
    /// Goes on, and the reader misses the sample.
    Miss,
}

/// A topic that every process of the ring needs.
const fn row(name: &'static str, from: Role, buffer: usize) -> Row {
    Row { name, from, buffer, history: HISTORY, full: Full::WaitInLockStep }
}

const SENSORS: Row = row("sensors", Role::FieldSim, RING_BUFFER);
const QUEUES: Row = row("queues", Role::FieldSim, VIEWER_BUFFER);
const TICK: Row = row("tick", Role::FieldSim, VIEWER_BUFFER);
const PLAN: Row = row("plan", Role::Planner, VIEWER_BUFFER);
const PATH: Row = Row { full: Full::Miss, ..row("path", Role::Planner, PATH_BUFFER) };
const FLIGHT: Row = Row { history: FLIGHT_HISTORY, ..row("flight", Role::FlightSim, VIEWER_BUFFER) };
const COMMIT: Row = row("commit", Role::Launcher, RING_BUFFER);
const HEALTH: Row = Row { full: Full::Miss, ..row("health", Role::Launcher, VIEWER_BUFFER) };
const READY: Row = row("ready", Role::Viewer, RING_BUFFER);

/// What a process brings to each of its topics.
#[derive(Debug, Clone)]
struct Member {
    terms: Terms,
    /// How far ahead the ring can be of this process; none if it may lag.
    max_ahead: Option<u64>,
    /// Where it counts what it does not accept.
    refusals: Refusals,
    late_joiners: LateJoiners,
    stop: Stop,
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
    fn new(node: &Node<S>, member: &Member, row: Row, terms: Option<&AttributeSpecifier>) -> Result<Self, RingError> {
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
            several: name == HEALTH.name,
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

    fn notifier(&self) -> Result<Notifier<S>, RingError> {
        self.event.notifier_builder().create().map_err(|error| RingError::topic(self.row.name, "notify", &error))
    }

    /// How long a process of the run waits for another.
    fn timeout(&self) -> Duration {
        self.member.terms.timeout()
    }

    fn backpressure(&self) -> impl Fn(&BackpressureInfo) -> BackpressureAction + use<S, P, H> {
        let (config, stop, timeout) = (self.config.clone(), self.member.stop.clone(), self.timeout());
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
        let builder = self.data.publisher_builder().max_loaned_samples(1);
        let publisher = builder.set_backpressure_handler(self.backpressure()).create();
        let publisher = publisher.map_err(|error| RingError::topic(self.row.name, WRITE, &error))?;
        Ok(Writer::new(self.row.name, publisher, self.notifier()?, self.timeout(), &self.member.late_joiners))
    }
}

impl<S: Service + 'static, T: Debug + Copy + ZeroCopySend + 'static, H: Header> Topic<S, [T], H> {
    /// A writer of lists of at most `len` elements.
    ///
    /// # Errors
    /// If all writers' places are taken, or the system refuses.
    pub fn list_writer(&self, len: usize) -> Result<Writer<S, [T], H>, RingError> {
        let builder = self.data.publisher_builder().initial_max_slice_len(len).max_loaned_samples(1);
        let publisher = builder.set_backpressure_handler(self.backpressure()).create();
        let publisher = publisher.map_err(|error| RingError::topic(self.row.name, WRITE, &error))?;
        Ok(Writer::new(self.row.name, publisher, self.notifier()?, self.timeout(), &self.member.late_joiners))
    }
}

/// The topics of a run, opened.
#[derive(Debug)]
pub struct Ring<S: Service + 'static> {
    /// What the run has agreed on.
    pub terms: Terms,
    /// Every sensor node, once.
    pub sensors: Topic<S, [SensorNode], SlotHeader>,
    /// The queue of every sensor node after each slot [bit]; ledger totals in the header.
    pub queues: Topic<S, [u32], QueuesHeader>,
    /// The beginning of each slot, in paced runs.
    pub tick: Topic<S, Tick, SlotHeader>,
    /// Whom to serve in each slot and where to fly.
    pub plan: Topic<S, Plan, SlotHeader>,
    /// Where the plan leads after its slot, of planners that know.
    pub path: Topic<S, [PathPoint], SlotHeader>,
    /// Where the UAV is after each slot, and what its links can carry.
    pub flight: Topic<S, FlightReport, SlotHeader>,
    /// The slots on record.
    pub commit: Topic<S, Commit, SlotHeader>,
    /// What becomes of the processes.
    pub health: Topic<S, Health, SlotHeader>,
    /// Which viewer is ready for the slots to come.
    pub ready: Topic<S, Ready, SlotHeader>,
    /// What this process did not accept.
    pub refusals: Refusals,
    /// How often its seat was taken before.
    pub restarts: u32,
    node: Node<S>,
}

impl<S: Service + 'static> Ring<S> {
    /// Creates the ring in its folder, with the launcher's wait context; the launcher does, and keeps it for the whole run.
    ///
    /// # Errors
    /// If iceoryx2 cannot create its services.
    pub fn create(folder: &RingFolder, scenario: &Scenario, stop: &Stop) -> Result<(Self, WaitContext), RingError> {
        let agreed = attributes(&folder.terms(), scenario)?;
        Self::join(folder, scenario, Role::Launcher, stop, Some(&agreed))
    }

    /// Takes the seat of `role` in the ring of the folder and opens its topics, with the process's wait context.
    ///
    /// # Errors
    /// If the seat is taken, or the ring is not there or flies another scenario.
    pub fn open(
        folder: &RingFolder,
        scenario: &Scenario,
        role: Role,
        stop: &Stop,
    ) -> Result<(Self, WaitContext), RingError> {
        Self::join(folder, scenario, role, stop, None)
    }

    fn join(
        folder: &RingFolder,
        scenario: &Scenario,
        role: Role,
        stop: &Stop,
        agreed: Option<&AttributeSpecifier>,
    ) -> Result<(Self, WaitContext), RingError> {
        let terms = folder.terms();
        let is_launcher = role == Role::Launcher;
        let seat = if is_launcher { None } else { Some(folder.take_seat(role)?) };
        let node = node::<S>(folder, role)?;
        if is_launcher {
            folder.close_counter().map_err(|error| RingError::topic("ring", "close its counter", &error))?;
        }
        let member = Member {
            terms,
            max_ahead: role.keeps_the_ring_waiting().then_some(MAX_AHEAD),
            // The ring's own processes report what they refuse; the viewer only looks on, but nobody else reads paths.
            refusals: Refusals::new(Some(role).filter(|&role| role != Role::Viewer && !is_launcher)),
            late_joiners: LateJoiners::default(),
            stop: stop.clone(),
        };
        let only_reader = Member { refusals: Refusals::new(Some(role)), ..member.clone() };
        let sensors = Topic::new(&node, &member, SENSORS, agreed)?;
        agree(folder, sensors.data.attributes(), scenario)?;
        let wait = WaitContext {
            stop: stop.clone(),
            supervisor: folder.supervisor()?,
            late_joiners: member.late_joiners.clone(),
            timeout: terms.timeout(),
            waiting: terms.wait,
            supervised: Instant::now(),
            served: Instant::now(),
            polls: 0,
            seat,
        };
        let ring = Self {
            terms,
            sensors,
            queues: Topic::new(&node, &member, QUEUES, agreed)?,
            tick: Topic::new(&node, &member, TICK, agreed)?,
            plan: Topic::new(&node, &member, PLAN, agreed)?,
            path: Topic::new(&node, &only_reader, PATH, agreed)?,
            flight: Topic::new(&node, &member, FLIGHT, agreed)?,
            commit: Topic::new(&node, &member, COMMIT, agreed)?,
            health: Topic::new(&node, &member, HEALTH, agreed)?,
            ready: Topic::new(&node, &member, READY, agreed)?,
            refusals: member.refusals,
            restarts: wait.seat.as_ref().map_or(0, Seat::restarts),
            node,
        };
        Ok((ring, wait))
    }

    /// Frees what processes that died have left behind; the launcher does. What it cannot free goes with the folder.
    pub fn remove_dead_nodes(&self) {
        purge_dead_nodes::<S>(self.node.config());
    }

    /// A header of this run, sent now.
    #[must_use]
    pub fn header(&self, slot: u64, flags: u32) -> SlotHeader {
        SlotHeader { mission: self.terms.mission, slot, epoch: self.restarts, flags, sent_ns: monotonic_ns() }
    }

    /// Waits after the last slot until the launcher releases this process, or has ended: until then it is there for those
    /// that are started again. `repeat` runs now and then.
    ///
    /// # Errors
    /// Those of `repeat`, a requested stop, or a broken ring.
    pub fn wait_for_release(
        &self,
        wait: &mut WaitContext,
        repeat: impl FnMut() -> Result<(), RingError>,
    ) -> Result<(), NodeError> {
        self.wait_for_commit(wait, |commit| commit.flags & FLAG_END != 0, repeat)
    }

    /// Waits until `slot` is on record, or the launcher has ended.
    ///
    /// # Errors
    /// A requested stop, or a broken ring.
    pub fn wait_for_record(&self, wait: &mut WaitContext, slot: u64) -> Result<(), NodeError> {
        self.wait_for_commit(wait, |commit| commit.slot >= slot, || Ok(()))
    }

    fn wait_for_commit(
        &self,
        wait: &mut WaitContext,
        is_awaited: impl Fn(&SlotHeader) -> bool,
        mut repeat: impl FnMut() -> Result<(), RingError>,
    ) -> Result<(), NodeError> {
        let mut commits = self.commit.reader(RING_BUFFER)?;
        loop {
            while let Some(commit) = commits.next()? {
                if is_awaited(commit.user_header()) {
                    return Ok(());
                }
            }
            repeat()?;
            match wait.sleep_until(Instant::now() + PAUSE) {
                Err(NodeError::Orphaned) => return Ok(()),
                slept => slept?,
            }
        }
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
        let refuse = |error: &dyn Debug| RingError::topic("ring", "define its terms", error);
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
