//! The table of topics, and the ring: all topics of a run.
//!
//! Every run has a folder and a prefix of its own, so that two runs never meet. The launcher creates the topics and
//! holds them; a process of the ring only opens them.

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
use crate::role::{Role, Seat};
use crate::survey::{TopicState, Watch, look};
use crate::terms::Terms;
use crate::topic::{Full, Member, OBSERVER, Row, Topic, service_name};
use crate::wait::{LateJoiners, PAUSE, SharedCore, WaitContext};

/// Version of the messages and of what they mean; processes of different versions do not meet.
pub const SCHEMA: u32 = 5;

/// Samples that wait for a process of the ring: it is never more than two slots behind, but writers that are started
/// again repeat themselves. Memory that is not used costs nothing.
pub const RING_BUFFER: usize = 16;

/// Samples that wait for the viewer or the recorder.
pub const VIEWER_BUFFER: usize = 64;

/// The same of `path`. Its writer waits for nobody; where it waits for the viewer with the plan of a slot, none of the
/// paths before is missing, those that it repeats after a restart included.
pub const PATH_BUFFER: usize = 2 * VIEWER_BUFFER;

/// Samples that a late joiner still gets: slot 1 may be flown before the last process has seen the state before it.
const HISTORY: usize = 2;

/// The same of `flight`, which may be two slots ahead of the record: a planner that is started again then finds the
/// flight before each plan that the recorder may still wait for.
pub const FLIGHT_HISTORY: usize = 3;

/// How often late joiners are served, and woken, where a link does the same on every host: each wake-up costs it some
/// milliseconds.
const SERVE_LINKED_EVERY: Duration = Duration::from_millis(100);

/// A topic that every process of the ring needs.
const fn row(name: &'static str, from: Role, buffer: usize) -> Row {
    Row { name, from, buffer, history: HISTORY, full: Full::WaitInLockStep, several: false }
}

const SENSORS: Row = row("sensors", Role::FieldSim, RING_BUFFER);
const QUEUES: Row = row("queues", Role::FieldSim, VIEWER_BUFFER);
const TRUTH: Row = row("truth", Role::FieldSim, VIEWER_BUFFER);
const TICK: Row = row("tick", Role::FieldSim, VIEWER_BUFFER);
const PLAN: Row = row("plan", Role::Planner, VIEWER_BUFFER);
const PATH: Row = Row { full: Full::Miss, ..row("path", Role::Planner, PATH_BUFFER) };
const FLIGHT: Row = Row { history: FLIGHT_HISTORY, ..row("flight", Role::FlightSim, VIEWER_BUFFER) };
const COMMIT: Row = row("commit", Role::Launcher, RING_BUFFER);
const HEALTH: Row = Row { full: Full::Miss, several: true, ..row("health", Role::Launcher, VIEWER_BUFFER) };
const READY: Row = row("ready", Role::Viewer, RING_BUFFER);

/// All topics, in the order of a slot.
const ROWS: [Row; 10] = [SENSORS, QUEUES, TRUTH, TICK, PATH, PLAN, FLIGHT, COMMIT, READY, HEALTH];

/// The services of a ring that a link carries from and to one of its hosts, by their names.
#[derive(Debug, PartialEq, Eq)]
pub struct LinkedServices {
    /// All of them.
    pub all: Vec<String>,
    /// Those that processes of this host write.
    pub written_here: Vec<String>,
}

impl LinkedServices {
    /// Those of a host with the processes `here`. `health` is of each host alone.
    #[must_use]
    pub fn of(terms: &Terms, here: &[Role]) -> Self {
        let exists = |row: &&Row| row.name != HEALTH.name && (terms.told.is_some() || row.name != TRUTH.name);
        let service = |row: &Row| format!("skysink/{}", row.name);
        let is_read = |row: &Row| here.iter().any(|&role| row.is_read_by(role));
        let is_written = |row: &Row| here.contains(&row.from);
        Self {
            all: ROWS.iter().filter(exists).filter(|row| is_read(row) || is_written(row)).map(service).collect(),
            written_here: ROWS.iter().filter(exists).filter(|row| is_written(row)).map(service).collect(),
        }
    }
}

impl Row {
    /// Whether the process of `role` reads it.
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

/// The topics of a run, opened.
#[derive(Debug)]
pub struct Ring<S: Service + 'static> {
    /// What the run has agreed on.
    pub terms: Terms,
    /// Every sensor node, once; the mission's limits in the header.
    pub sensors: Topic<S, [SensorNode], SensorsHeader>,
    /// The queue of every sensor node after each slot [bit]; ledger totals in the header.
    pub truth: Topic<S, [u32], QueuesHeader>,
    /// The same for a planner: where the queues are estimated and the planner is not Skysink's, what the served sensor
    /// nodes told and what is believed of the others, without totals.
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
    /// Takes the seat of `role` in the ring of the folder and opens its topics, with the process's wait context. The
    /// launcher has no seat; it creates the topics, and holds them for the whole run.
    ///
    /// # Errors
    /// If the seat is taken, the ring is not there or flies another scenario, or iceoryx2 cannot create its services.
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
        let seat = if is_launcher { None } else { Some(Arc::new(Seat::take(folder.path(), role)?)) };
        let node = node::<S>(folder, role.name())?;
        if is_launcher {
            folder.close_counter().map_err(|error| RingError::topic("ring", "close its counter", &error))?;
        }
        let member = Member {
            terms,
            max_ahead: role.keeps_the_ring_waiting().then_some(MAX_AHEAD),
            // The ring's own processes report what they refuse; the viewer only listens, but nobody else reads paths.
            refusals: Refusals::new(Some(role).filter(|&role| role != Role::Viewer && !is_launcher)),
            late_joiners: LateJoiners::default(),
            seat: seat.clone(),
            stop: stop.clone(),
        };
        if !is_launcher && let Some(theirs) = terms_of(&node)? {
            agree(folder, &theirs, scenario)?;
        }
        let sensors = Topic::new(&node, &member, SENSORS, agreed)?;
        let wait = WaitContext {
            stop: stop.clone(),
            supervisor: folder.supervisor()?,
            late_joiners: member.late_joiners.clone(),
            timeout: is_launcher.then(|| terms.timeout()),
            waiting: terms.wait,
            supervised: Instant::now(),
            served: Instant::now(),
            serve_every: if terms.link.is_some() { SERVE_LINKED_EVERY } else { PAUSE },
            polls: 0,
            shared_core: SharedCore::default(),
            slow_topics: Vec::new(),
            seat,
        };
        let only_reader = Refusals::new(Some(role));
        let ring = Self::with_topics(node, sensors, &member, only_reader, agreed)?;
        Ok((ring, wait))
    }

    /// Opens the topics of the ring in the folder for one who takes no role, to look at them.
    ///
    /// # Errors
    /// If the ring is not there, or is of another version.
    pub fn observe(folder: &RingFolder) -> Result<Self, RingError> {
        let member = Member {
            terms: folder.terms(),
            max_ahead: None,
            refusals: Refusals::new(None),
            late_joiners: LateJoiners::default(),
            seat: None,
            stop: Stop::default(),
        };
        let node = node::<S>(folder, OBSERVER)?;
        let sensors = Topic::new(&node, &member, SENSORS, None)?;
        Self::with_topics(node, sensors, &member, Refusals::new(None), None)
    }

    /// The ring with all topics but the first, created if there are terms.
    fn with_topics(
        node: Node<S>,
        sensors: Topic<S, [SensorNode], SensorsHeader>,
        member: &Member,
        only_reader: Refusals,
        agreed: Option<&AttributeSpecifier>,
    ) -> Result<Self, RingError> {
        let only_reader = Member { refusals: only_reader, ..member.clone() };
        let queues = Topic::new(&node, member, QUEUES, agreed)?;
        let truth = match member.terms.told {
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
            restarts: member.seat.as_ref().map_or(0, |seat| seat.restarts),
            node,
        })
    }

    /// What a look at each topic shows, in the order of a slot.
    ///
    /// # Errors
    /// If a topic cannot be read.
    pub fn look(&self) -> Result<Vec<TopicState>, RingError> {
        let mut watches: Vec<Box<dyn Watch + '_>> = vec![self.sensors.watch(), self.queues.watch()];
        if self.terms.told.is_some() {
            watches.push(self.truth.watch());
        }
        watches.extend([self.tick.watch(), self.path.watch(), self.plan.watch(), self.flight.watch()]);
        watches.extend([self.commit.watch(), self.ready.watch(), self.health.watch()]);
        look(watches, &self.node)
    }

    /// Hash of the scenario that the ring flies, as hexadecimal text.
    #[must_use]
    pub fn scenario_hash(&self) -> Option<String> {
        let key = "scenario".try_into().ok()?;
        self.sensors.terms().key_value(&key, 0).map(ToString::to_string)
    }

    /// Frees what processes that died have left behind; the launcher does. What it cannot free goes with the folder.
    pub fn remove_dead_nodes(&self) {
        purge_dead_nodes::<S>(self.node.config());
    }

    /// Whether no other process is in the ring.
    #[must_use]
    pub fn is_alone(&self) -> bool {
        is_only_node(&self.node)
    }

    /// Whether a process of this host is attached that writes what `role` sends in every slot; the viewer, what it
    /// sends once. A link writes every topic: who writes `commit` and is not the launcher is one.
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

    /// The wake-ups of what `role` sends in every slot, from wherever it is: a process wakes its readers whenever it
    /// waits, so that they show that it is alive.
    ///
    /// # Errors
    /// If all listeners' places are taken, or the system refuses.
    pub fn listener_of(&self, role: Role) -> Result<Listener<S>, RingError> {
        match role {
            Role::FieldSim => self.truth.listener(),
            Role::FlightSim => self.flight.listener(),
            Role::Planner => self.plan.listener(),
            Role::Viewer => self.ready.listener(),
            Role::Launcher => self.commit.listener(),
        }
    }

    /// A header of this run, sent now.
    #[must_use]
    pub fn header(&self, slot: u64, flags: u32) -> SlotHeader {
        SlotHeader { mission: self.terms.mission, slot, epoch: self.restarts, flags, sent_ns: monotonic_ns() }
    }

    /// Waits after the last slot until the record has what `is_awaited` (such as [`is_release`]), or the launcher has
    /// ended: until then this process is there for those that are started again. `repeat` runs now and then.
    ///
    /// # Errors
    /// Those of `repeat`, a requested stop, or a broken ring.
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
    time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64 // the clock starts at boot: both are positive
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

/// What every process must agree on, by key.
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
        let (key, value) = (key.try_into().map_err(|error| refuse(&error))?, value.as_str().try_into());
        let value = value.map_err(|error| refuse(&error))?;
        specifier = specifier.define(&key, &value).map_err(|error| refuse(&error))?;
    }
    Ok(specifier)
}

/// The terms under which the ring was created, whatever the types of its messages; none if it is not there.
fn terms_of<S: Service>(node: &Node<S>) -> Result<Option<AttributeSet>, RingError> {
    let refuse = |error: &dyn Debug| RingError::topic("ring", "read its terms", error);
    let name = service_name(SENSORS.name)?;
    let details =
        S::details(&name, node.config(), MessagingPattern::PublishSubscribe).map_err(|error| refuse(&error))?;
    Ok(details.map(|details| details.static_details.attributes().clone()))
}

fn agree(folder: &RingFolder, theirs: &AttributeSet, scenario: &Scenario) -> Result<(), RingError> {
    for (what, ours, remedy) in agreement(scenario) {
        let key = what.try_into().map_err(|error| RingError::topic("ring", "read its terms", &error))?;
        let theirs = theirs.key_value(&key, 0).map_or_else(|| "missing".to_owned(), ToString::to_string);
        if theirs != ours {
            let message = format_args!("{what} is {theirs}, here {ours}: {remedy}");
            return Err(RingError::folder(folder.path(), message));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn terms(told: Option<skysink_common::estimate::Rates>) -> Terms {
        let folder = RingFolder::create(Default::default(), Default::default(), 1.0, false, told).unwrap();
        folder.terms()
    }

    #[test]
    fn a_host_gets_what_its_processes_read_and_wakes_the_link_with_what_they_write() {
        let of = |here: &[Role]| LinkedServices::of(&terms(None), here);
        let services = |names: &[&str]| names.iter().map(|name| format!("skysink/{name}")).collect::<Vec<_>>();
        let planner = of(&[Role::Planner]);
        assert_eq!(planner.all, services(&["sensors", "queues", "path", "plan", "flight", "commit"]));
        assert_eq!(planner.written_here, services(&["path", "plan"]));
        let flight_sim = of(&[Role::FlightSim]);
        assert_eq!(flight_sim.all, services(&["sensors", "tick", "plan", "flight", "commit"]), "no queues");
        assert_eq!(flight_sim.written_here, services(&["flight"]));
        let launcher = of(&[Role::FieldSim, Role::Launcher]);
        assert_eq!(launcher.written_here, services(&["sensors", "queues", "tick", "commit"]));
        assert!(!launcher.all.contains(&"skysink/health".to_owned()), "it is of each host alone");
    }

    #[test]
    fn the_true_queues_cross_where_others_are_told_less() {
        let told = terms(Some(skysink_common::estimate::Rates::Known));
        let planner = LinkedServices::of(&told, &[Role::Planner]);
        assert!(planner.all.contains(&"skysink/truth".to_owned()), "{planner:?}");
    }
}
