//! The table of topics, and the ring: all topics of a run.
//!
//! Each run has its own folder and iceoryx2 prefix, which isolates concurrent runs. The launcher creates the topics;
//! the other processes only open them.

use std::fmt::Debug;
use std::rc::Rc;
use std::sync::Arc;
use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::*;
use rustix::time::{ClockId, clock_gettime};
use skysink_common::message::{
    Commit, FLAG_END, FlightReport, PathPoint, Plan, QueuesHeader, SensorNode, SensorsHeader, SlotHeader, Tick,
};
use skysink_common::scenario::Scenario;
use skysink_common::stop::Stop;

use crate::cleanup::{is_only_node, purge_dead_nodes};
use crate::error::{NodeError, RingError};
use crate::folder::RingFolder;
use crate::health::{Health, Ready};
use crate::reader::MAX_AHEAD;
use crate::refusals::Refusals;
use crate::role::{Role, RoleLock};
use crate::survey::{ObserveTopic, TopicState, observe_all};
use crate::terms::Terms;
use crate::topic::{OBSERVER, OnFullBuffer, Participant, Topic, TopicRow, service_name};
use crate::wait::{CoreContention, LateJoiners, PAUSE, WaitContext};

/// Version of the messages and their semantics; processes of different versions refuse each other.
pub const SCHEMA: u32 = 5;

/// Buffer of a process of the ring [samples]: it is at most two slots behind, but restarted writers repeat samples.
/// Unused memory costs nothing.
pub const RING_BUFFER: usize = 16;

/// Buffer of the viewer and of the recorder [samples].
pub const VIEWER_BUFFER: usize = 64;

/// Buffer of a reader of `path` [samples]. The writer of `path` does not wait for readers, but the writer of `plan`
/// does: this buffer holds all paths until then, and those repeated after a restart.
pub const PATH_BUFFER: usize = 2 * VIEWER_BUFFER;

/// Samples that a late joiner receives: slot 1 may be flown before the last process has read the state before it.
const HISTORY: usize = 2;

/// Samples of `flight` that a late joiner receives. Flights may be two slots ahead of the trace: so a restarted planner
/// finds the flight before each plan that the recorder may still wait for.
pub const FLIGHT_HISTORY: usize = 3;

/// Period of serving late joiners in a ring with a link, in which each notification costs some milliseconds.
const SERVE_LINKED_EVERY: Duration = Duration::from_millis(100);

/// A topic with the default history and backpressure.
const fn row(name: &'static str, writer: Role, buffer: usize) -> TopicRow {
    TopicRow {
        name,
        writer,
        buffer,
        history: HISTORY,
        on_full: OnFullBuffer::BlockInLockStep,
        has_several_per_slot: false,
    }
}

const SENSORS: TopicRow = row("sensors", Role::FieldSim, RING_BUFFER);
const QUEUES: TopicRow = row("queues", Role::FieldSim, VIEWER_BUFFER);
const TRUTH: TopicRow = row("truth", Role::FieldSim, VIEWER_BUFFER);
const TICK: TopicRow = row("tick", Role::FieldSim, VIEWER_BUFFER);
const PLAN: TopicRow = row("plan", Role::Planner, VIEWER_BUFFER);
const PATH: TopicRow = TopicRow { on_full: OnFullBuffer::DropSample, ..row("path", Role::Planner, PATH_BUFFER) };
const FLIGHT: TopicRow = TopicRow { history: FLIGHT_HISTORY, ..row("flight", Role::FlightSim, VIEWER_BUFFER) };
const COMMIT: TopicRow = row("commit", Role::Launcher, RING_BUFFER);
const HEALTH: TopicRow = TopicRow {
    on_full: OnFullBuffer::DropSample,
    has_several_per_slot: true,
    ..row("health", Role::Launcher, VIEWER_BUFFER)
};
const READY: TopicRow = row("ready", Role::Viewer, RING_BUFFER);

/// All topics, in the order of a slot.
const ROWS: [TopicRow; 10] = [SENSORS, QUEUES, TRUTH, TICK, PATH, PLAN, FLIGHT, COMMIT, READY, HEALTH];

/// The names of the services that a link carries to and from one host of a ring.
#[derive(Debug, PartialEq, Eq)]
pub struct LinkedServices {
    /// All of them.
    pub all: Vec<String>,
    /// Those written by processes of this host.
    pub written_here: Vec<String>,
}

impl LinkedServices {
    /// The services of a host with the processes `roles`. `health` is not carried.
    #[must_use]
    pub fn of(terms: &Terms, roles: &[Role]) -> Self {
        let exists = |row: &&TopicRow| row.name != HEALTH.name && (terms.estimated.is_some() || row.name != TRUTH.name);
        let service = |row: &TopicRow| format!("skysink/{}", row.name);
        let is_read = |row: &TopicRow| roles.iter().any(|&role| row.is_read_by(role));
        let is_written = |row: &TopicRow| roles.contains(&row.writer);
        Self {
            all: ROWS.iter().filter(exists).filter(|row| is_read(row) || is_written(row)).map(service).collect(),
            written_here: ROWS.iter().filter(exists).filter(|row| is_written(row)).map(service).collect(),
        }
    }
}

impl TopicRow {
    /// Whether the process `role` reads it.
    fn is_read_by(&self, role: Role) -> bool {
        let topics: &[Self] = match role {
            Role::FieldSim => &[FLIGHT, COMMIT],
            Role::FlightSim => &[SENSORS, PLAN, TICK, COMMIT],
            Role::Planner => &[SENSORS, QUEUES, TRUTH, FLIGHT, COMMIT],
            Role::Viewer | Role::Launcher => &ROWS,
        };
        topics.iter().any(|row| row.name == self.name)
    }
}

/// The open topics of a run.
#[derive(Debug)]
pub struct Ring<S: Service + 'static> {
    /// The terms of the run.
    pub terms: Terms,
    /// All sensor nodes, once; the mission's limits in the header.
    pub sensors: Topic<S, [SensorNode], SensorsHeader>,
    /// The queue of each sensor node after each slot [bit]; ledger totals in the header.
    pub truth: Topic<S, [u32], QueuesHeader>,
    /// The queues for an external planner: the UAV's estimate, without totals, if the queues are estimated; otherwise
    /// this is `truth`.
    pub queues: Topic<S, [u32], QueuesHeader>,
    /// The beginning of each slot, in paced runs.
    pub tick: Topic<S, Tick, SlotHeader>,
    /// The schedule and the waypoint of each slot.
    pub plan: Topic<S, Plan, SlotHeader>,
    /// The planned waypoints after the slot, from planners that look ahead.
    pub path: Topic<S, [PathPoint], SlotHeader>,
    /// The position of the UAV after each slot, and the capacities of its links.
    pub flight: Topic<S, FlightReport, SlotHeader>,
    /// The recorded slots.
    pub commit: Topic<S, Commit, SlotHeader>,
    /// The events of the processes.
    pub health: Topic<S, Health, SlotHeader>,
    /// The viewer that is ready for the slots to come.
    pub ready: Topic<S, Ready, SlotHeader>,
    /// Samples that this process refused.
    pub refusals: Refusals,
    /// Restart count of this process.
    pub restarts: u32,
    node: Node<S>,
}

impl<S: Service + 'static> Ring<S> {
    /// Locks `role` in the ring of the folder and opens its topics; returns them with the wait context of the process.
    /// The launcher has no lock; it creates the topics.
    ///
    /// # Errors
    /// If another process has the role, the ring does not exist or flies another scenario, or iceoryx2 fails.
    pub fn join(
        folder: &RingFolder,
        scenario: &Scenario,
        role: Role,
        stop: &Stop,
    ) -> Result<(Self, WaitContext), RingError> {
        let terms = folder.terms();
        let is_launcher = role == Role::Launcher;
        let agreed = if is_launcher { Some(attributes(&terms, scenario)?) } else { None };
        let agreed = agreed.as_ref();
        let role_lock = if is_launcher { None } else { Some(Arc::new(RoleLock::acquire(folder.path(), role)?)) };
        let node = node::<S>(folder, role.name())?;
        if is_launcher {
            let restricted = folder.restrict_process_counter();
            restricted.map_err(|error| RingError::topic("ring", "restrict its process counter", &error))?;
        }
        let member = Participant {
            terms,
            max_ahead: role.blocks_ring().then_some(MAX_AHEAD),
            // The viewer and the launcher do not log refusals: the ring's other processes read the same samples.
            refusals: Refusals::new(Some(role).filter(|&role| role != Role::Viewer && !is_launcher)),
            late_joiners: LateJoiners::default(),
            role_lock: role_lock.clone(),
            stop: stop.clone(),
        };
        if !is_launcher && let Some(attributes) = attributes_of(&node)? {
            check_attributes(folder, &attributes, scenario)?;
        }
        let sensors = Topic::new(&node, &member, SENSORS, agreed)?;
        let wait = WaitContext {
            stop: stop.clone(),
            supervisor: folder.supervisor()?,
            late_joiners: member.late_joiners.clone(),
            timeout: is_launcher.then(|| terms.timeout()),
            waiting: terms.wait,
            last_supervisor_check: Instant::now(),
            last_served: Instant::now(),
            serve_every: if terms.link.is_some() { SERVE_LINKED_EVERY } else { PAUSE },
            polls: 0,
            contention: CoreContention::default(),
            slow_topics: Vec::new(),
            role_lock,
        };
        let only_reader = Refusals::new(Some(role)); // of `path`, which only the viewer and the launcher read
        let ring = Self::with_topics(node, sensors, &member, only_reader, agreed)?;
        Ok((ring, wait))
    }

    /// Opens the topics of the ring in the folder as an observer without a role.
    ///
    /// # Errors
    /// If the ring does not exist, or has another version.
    pub fn observe(folder: &RingFolder) -> Result<Self, RingError> {
        let member = Participant {
            terms: folder.terms(),
            max_ahead: None,
            refusals: Refusals::new(None),
            late_joiners: LateJoiners::default(),
            role_lock: None,
            stop: Stop::default(),
        };
        let node = node::<S>(folder, OBSERVER)?;
        let sensors = Topic::new(&node, &member, SENSORS, None)?;
        Self::with_topics(node, sensors, &member, Refusals::new(None), None)
    }

    /// Opens the remaining topics, or creates them with the attributes `agreed`.
    fn with_topics(
        node: Node<S>,
        sensors: Topic<S, [SensorNode], SensorsHeader>,
        member: &Participant,
        only_reader: Refusals,
        agreed: Option<&AttributeSpecifier>,
    ) -> Result<Self, RingError> {
        let only_reader = Participant { refusals: only_reader, ..member.clone() };
        let queues = Topic::new(&node, member, QUEUES, agreed)?;
        let truth = match member.terms.estimated {
            Some(_) => Topic::new(&node, member, TRUTH, agreed)?,
            None => Topic(Rc::clone(&queues.0)),
        };
        Ok(Self {
            terms: member.terms,
            sensors,
            truth,
            queues,
            tick: Topic::new(&node, member, TICK, agreed)?,
            plan: Topic::new(&node, member, PLAN, agreed)?,
            path: Topic::new(&node, &only_reader, PATH, agreed)?,
            flight: Topic::new(&node, member, FLIGHT, agreed)?,
            commit: Topic::new(&node, member, COMMIT, agreed)?,
            health: Topic::new(&node, member, HEALTH, agreed)?,
            ready: Topic::new(&node, member, READY, agreed)?,
            refusals: member.refusals.clone(),
            restarts: member.role_lock.as_ref().map_or(0, |lock| lock.restarts),
            node,
        })
    }

    /// The states of all topics, in the order of a slot.
    ///
    /// # Errors
    /// If a topic cannot be read.
    pub fn topic_states(&self) -> Result<Vec<TopicState>, RingError> {
        let mut observers: Vec<Box<dyn ObserveTopic + '_>> = vec![self.sensors.observer(), self.queues.observer()];
        if self.terms.estimated.is_some() {
            observers.push(self.truth.observer());
        }
        observers.extend([self.tick.observer(), self.path.observer(), self.plan.observer(), self.flight.observer()]);
        observers.extend([self.commit.observer(), self.ready.observer(), self.health.observer()]);
        observe_all(observers, &self.node)
    }

    /// Hash of the ring's scenario, as hexadecimal text.
    #[must_use]
    pub fn scenario_hash(&self) -> Option<String> {
        let key = "scenario".try_into().ok()?;
        self.sensors.terms().key_value(&key, 0).map(ToString::to_string)
    }

    /// Removes the resources of dead processes; called by the launcher. The rest is removed with the folder.
    pub fn remove_dead_nodes(&self) {
        purge_dead_nodes::<S>(self.node.config());
    }

    /// Whether the ring has no other process.
    #[must_use]
    pub fn is_alone(&self) -> bool {
        is_only_node(&self.node)
    }

    /// Whether a process of this host is attached as the writer of the topic of `role`: that of each slot, or `ready`
    /// of the viewer. A link writes all topics: a writer of `commit` other than the launcher is a link.
    #[must_use]
    pub fn has_writer(&self, role: Role) -> bool {
        let mut links = if self.terms.link.is_some() { self.commit.writers() } else { Vec::new() };
        links.retain(|writer| writer != self.node.id());
        let writers = match role {
            Role::FieldSim => self.truth.writers(),
            Role::FlightSim => self.flight.writers(),
            Role::Planner => self.plan.writers(),
            Role::Viewer => self.ready.writers(),
            Role::Launcher => self.commit.writers(),
        };
        writers.iter().any(|writer| !links.contains(writer))
    }

    /// A listener to the topic of `role`, on this host or another. A process also notifies its readers while it waits,
    /// so that notifications serve as heartbeats.
    ///
    /// # Errors
    /// If the topic has its maximum of listeners, or iceoryx2 fails.
    pub fn listener_of(&self, role: Role) -> Result<Listener<S>, RingError> {
        match role {
            Role::FieldSim => self.truth.listener(),
            Role::FlightSim => self.flight.listener(),
            Role::Planner => self.plan.listener(),
            Role::Viewer => self.ready.listener(),
            Role::Launcher => self.commit.listener(),
        }
    }

    /// A header of this run with the current time.
    #[must_use]
    pub fn header(&self, slot: u64, flags: u32) -> SlotHeader {
        SlotHeader { mission: self.terms.mission, slot, epoch: self.restarts, flags, sent_ns: monotonic_ns() }
    }

    /// Waits after the last slot for a commit that `is_awaited`, such as [`is_release`], or for the end of the
    /// launcher. Until then this process serves restarted ones. `repeat` is called every 10 ms.
    ///
    /// # Errors
    /// Those of `repeat`, on a requested stop, or if iceoryx2 fails.
    pub fn wait_for_commit(
        &self,
        wait: &mut WaitContext,
        is_awaited: impl Fn(&SlotHeader) -> bool,
        mut repeat: impl FnMut() -> Result<(), RingError>,
    ) -> Result<(), NodeError> {
        let mut commits = self.commit.reader(RING_BUFFER)?;
        loop {
            while let Some(commit) = commits.next_sample()? {
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

/// Whether a commit releases the processes of the ring.
#[must_use]
pub fn is_release(commit: &SlotHeader) -> bool {
    commit.flags & FLAG_END != 0
}

/// Time on the monotonic clock [ns], common to all processes of a machine.
#[must_use]
pub fn monotonic_ns() -> u64 {
    let time = clock_gettime(ClockId::Monotonic);
    time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64 // both are positive: the clock starts at boot
}

fn node<S: Service>(folder: &RingFolder, name: &str) -> Result<Node<S>, RingError> {
    let name = NodeName::new(name).map_err(|error| RingError::topic("ring", "name the process", &error))?;
    NodeBuilder::new()
        .config(&folder.config()?)
        .name(&name)
        .signal_handling_mode(SignalHandlingMode::Disabled) // see `Stop`
        .create::<S>()
        .map_err(|error| RingError::topic("ring", "join", &error))
}

/// The attributes on which all processes must agree: key, value, and the remedy if they differ.
fn agreement(scenario: &Scenario) -> [(&'static str, String, &'static str); 3] {
    [
        ("version", SCHEMA.to_string(), "use the executables of one build"),
        ("program", env!("CARGO_PKG_VERSION").to_owned(), "use the executables of one build"),
        ("scenario", format!("{:016x}", scenario.hash()), "pass the scenario.toml of the run's folder"),
    ]
}

fn attributes(terms: &Terms, scenario: &Scenario) -> Result<AttributeSpecifier, RingError> {
    let mission = ("mission", format!("{:016x}", terms.mission), "");
    let mut specifier = AttributeSpecifier::new();
    for (key, value, _) in agreement(scenario).into_iter().chain([mission]) {
        let refuse = |error: &dyn Debug| RingError::topic("ring", "define its terms", error);
        let key = key.try_into().map_err(|error| refuse(&error))?;
        let value = value.as_str().try_into().map_err(|error| refuse(&error))?;
        specifier = specifier.define(&key, &value).map_err(|error| refuse(&error))?;
    }
    Ok(specifier)
}

/// The attributes with which the ring was created, for any message types; `None` if the ring does not exist.
fn attributes_of<S: Service>(node: &Node<S>) -> Result<Option<AttributeSet>, RingError> {
    let refuse = |error: &dyn Debug| RingError::topic("ring", "read its terms", error);
    let name = service_name(SENSORS.name)?;
    let details =
        S::details(&name, node.config(), MessagingPattern::PublishSubscribe).map_err(|error| refuse(&error))?;
    Ok(details.map(|details| details.static_details.attributes().clone()))
}

/// Refuses a ring whose attributes differ from those of this process.
fn check_attributes(folder: &RingFolder, attributes: &AttributeSet, scenario: &Scenario) -> Result<(), RingError> {
    for (name, expected, remedy) in agreement(scenario) {
        let key = name.try_into().map_err(|error| RingError::topic("ring", "read its terms", &error))?;
        let found = attributes.key_value(&key, 0).map_or_else(|| "missing".to_owned(), ToString::to_string);
        if found != expected {
            let message = format_args!("{name} is {found}, here {expected}: {remedy}");
            return Err(RingError::folder(folder.path(), message));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn terms(estimated: Option<skysink_common::estimate::Rates>) -> Terms {
        let folder = RingFolder::create(Default::default(), Default::default(), 1.0, false, estimated).unwrap();
        folder.terms()
    }

    #[test]
    fn a_link_carries_the_topics_that_the_processes_of_a_host_read_or_write() {
        let of = |roles: &[Role]| LinkedServices::of(&terms(None), roles);
        let services = |names: &[&str]| names.iter().map(|name| format!("skysink/{name}")).collect::<Vec<_>>();
        let planner = of(&[Role::Planner]);
        assert_eq!(planner.all, services(&["sensors", "queues", "path", "plan", "flight", "commit"]));
        assert_eq!(planner.written_here, services(&["path", "plan"]));
        let flight_sim = of(&[Role::FlightSim]);
        assert_eq!(flight_sim.all, services(&["sensors", "tick", "plan", "flight", "commit"]), "no queues");
        assert_eq!(flight_sim.written_here, services(&["flight"]));
        let launcher = of(&[Role::FieldSim, Role::Launcher]);
        assert_eq!(launcher.written_here, services(&["sensors", "queues", "tick", "commit"]));
        assert!(!launcher.all.contains(&"skysink/health".to_owned()), "each host has its own");
    }

    #[test]
    fn a_link_carries_the_true_queues_if_external_planners_read_an_estimate() {
        let estimated = terms(Some(skysink_common::estimate::Rates::Known));
        let planner = LinkedServices::of(&estimated, &[Role::Planner]);
        assert!(planner.all.contains(&"skysink/truth".to_owned()), "{planner:?}");
    }
}
