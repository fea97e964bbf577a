//! The table of topics, and the ring: all topics of a run.
//!
//! Each run has its own folder and iceoryx2 prefix, which isolates concurrent runs. The launcher creates the topics;
//! the other processes only open them.

use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::*;
use rustix::time::{ClockId, clock_gettime};
use skysink_common::message::{
    Commit, FLAG_END, FlightReport, HeardLink, NodeAnswer, PathPoint, Plan, QueuesHeader, SensorNode, SensorsHeader,
    SlotHeader, Tick,
};
use skysink_common::scenario::Scenario;

use crate::cleanup::{is_only_node, purge_dead_nodes};
use crate::error::{NodeError, RingError};
use crate::health::{Health, Ready};
use crate::reader::RING_BUFFER;
use crate::refusals::Refusals;
use crate::role::Role;
use crate::sample::{Header, Payload};
use crate::survey::{AnyTopic, TopicState, newest_tick, observe_all};
use crate::terms::Terms;
use crate::topic::{Existence, OnFullBuffer, Opening, Participant, SamplesPerSlot, Topic, TopicRow};
use crate::wait::{PAUSE, WaitContext};

/// Version of the messages and their semantics; processes of different versions refuse each other.
pub const SCHEMA: u32 = 13;

/// Buffer of the viewer and of the recorder [samples].
pub const VIEWER_BUFFER: usize = 64;

/// Samples of `flight` that a late joiner receives. Flights may be two slots ahead of the trace: so a restarted planner
/// finds the flight before each plan that the recorder may still wait for.
pub const FLIGHT_HISTORY: usize = 3;

/// Makes the [`Ring`] and the rows of its topics from the table. An entry of the table is a field of the ring with the
/// types of payload and user header, and what differs from [`DEFAULT_ROW`]. A topic that not every run has (`exists`)
/// is an [`OptionalTopic`].
macro_rules! topics {
    ($(
        $(#[$doc:meta])*
        $name:ident: $Field:ident<$Payload:ty, $Header:ty> { $($key:ident: $value:expr),* $(,)? }
    )*) => {
        /// The topics of a run, in the order of a slot.
        pub(crate) const ROWS: &[TopicRow] =
            &[$(TopicRow { name: stringify!($name), $($key: $value,)* ..DEFAULT_ROW }),*];

        /// The open topics of a run.
        #[derive(Debug)]
        pub struct Ring<S: Service + 'static> {
            $($(#[$doc])* pub $name: $Field<S, $Payload, $Header>,)*
            /// The terms of the run.
            pub terms: Terms,
            /// Samples that this process refused.
            pub refusals: Refusals,
            /// Restart count of this process.
            pub restarts: u32,
            node: Node<S>,
        }

        impl<S: Service + 'static> Ring<S> {
            /// Opens the topics in the order of the table, or creates them with the attributes `created_with`.
            pub(crate) fn open(
                node: Node<S>,
                member: &Participant,
                created_with: Option<&AttributeSpecifier>,
            ) -> Result<Self, RingError> {
                let opening = Opening { node: &node, member, created_with };
                let mut rows = ROWS.iter();
                Ok(Self {
                    $($name: RingTopic::open(&opening, rows.next().expect("a row for each field"))?,)*
                    terms: member.terms.clone(),
                    refusals: member.refusals.clone(),
                    restarts: member.role_lock.as_ref().map_or(0, |lock| lock.restarts),
                    node,
                })
            }

            /// The topics that the run has, in the order of the table.
            fn topics(&self) -> Vec<&dyn AnyTopic<S>> {
                let topics = [$(self.$name.existing()),*];
                topics.into_iter().flatten().collect()
            }
        }
    };
}

/// What a topic is unless its entry says otherwise.
const DEFAULT_ROW: TopicRow = TopicRow {
    name: "",
    writer: Role::Launcher,
    readers: &[],
    buffer: VIEWER_BUFFER,
    history: 2, // slot 1 may be flown before the last process has read the state before it
    on_full: OnFullBuffer::BlockInLockStep,
    is_by_uav: false,
    samples: SamplesPerSlot::One,
    is_heartbeat: false,
    is_linked: true,
    exists: Existence::Always,
};

use Role::{FieldSim, FlightSim, Launcher, Planner, Viewer};

topics! {
    /// All sensor nodes, once, with the rates that the planner knows before slot 1; the mission's limits in the header.
    sensors: Topic<[SensorNode], SensorsHeader> {
        writer: FieldSim,
        readers: &[FlightSim, Planner, Viewer],
        buffer: RING_BUFFER,
        samples: SamplesPerSlot::AtMostOne,
    }

    /// The rates that the UAV has learnt after each slot [bit/s], for an external planner. Sent before `belief`.
    rates: OptionalTopic<[f64], SlotHeader> {
        writer: FieldSim,
        readers: &[Planner],
        exists: Existence::WithTerms(Terms::has_learnt_rates),
    }

    /// The UAV's belief of the queues after each slot [bit], for an external planner; without totals. Sent before
    /// `queues`: a process that has the queues of a slot then has the belief, too.
    belief: OptionalTopic<[u32], QueuesHeader> {
        writer: FieldSim,
        readers: &[Planner],
        exists: Existence::WithTerms(Terms::has_belief),
    }

    /// What each sensor node does in the next slot, where some may be dead or silent (decision D33). Sent before
    /// `queues`: a process that has the queues of a slot then has the answers, too.
    answers: OptionalTopic<[NodeAnswer], SlotHeader> {
        writer: FieldSim,
        readers: &[Planner, Viewer],
        exists: Existence::WithScenario(|scenario| scenario.node_traits().may_refuse),
    }

    /// The queue of each sensor node after each slot [bit], 0 of a dead one; ledger totals in the header.
    queues: Topic<[u32], QueuesHeader> {
        writer: FieldSim,
        readers: &[Planner, Viewer, Launcher],
        is_heartbeat: true,
    }

    /// The beginning of each slot, in paced runs.
    tick: Topic<Tick, SlotHeader> {
        writer: FieldSim,
        readers: &[FlightSim, Launcher],
    }

    /// The planned waypoints after the slot, from planners that look ahead. Its writer does not wait for readers, but
    /// that of `plan` does: the buffer holds all paths until then, and those repeated after a restart.
    path: Topic<[PathPoint], SlotHeader> {
        writer: Planner,
        readers: &[Viewer],
        buffer: 2 * VIEWER_BUFFER,
        on_full: OnFullBuffer::DropSample,
        samples: SamplesPerSlot::AtMostOne,
    }

    /// The schedule and the waypoint of each UAV in each slot.
    plan: Topic<[Plan], SlotHeader> {
        writer: Planner,
        readers: &[FlightSim, Viewer, Launcher],
        is_by_uav: true,
        is_heartbeat: true,
    }

    /// What the UAVs hear at the end of each slot, with `link.beacon_radius_m`. Sent before `flight`: a process that
    /// has the flight of a slot then has the links, too.
    links: OptionalTopic<[HeardLink], SlotHeader> {
        writer: FlightSim,
        readers: &[Planner, Viewer],
        history: FLIGHT_HISTORY,
        exists: Existence::WithScenario(|scenario| scenario.link.beacon_radius_m.is_some()),
    }

    /// The position of each UAV after each slot, and the capacities of its links.
    flight: Topic<[FlightReport], SlotHeader> {
        writer: FlightSim,
        readers: &[FieldSim, Planner, Viewer, Launcher],
        is_by_uav: true,
        history: FLIGHT_HISTORY,
        is_heartbeat: true,
    }

    /// The recorded slots.
    commit: Topic<Commit, SlotHeader> {
        writer: Launcher,
        readers: &[FieldSim, FlightSim, Planner, Viewer],
        buffer: RING_BUFFER,
        is_heartbeat: true,
    }

    /// The viewer that is ready for the slots to come.
    ready: Topic<Ready, SlotHeader> {
        writer: Viewer,
        readers: &[Launcher],
        buffer: RING_BUFFER,
        samples: SamplesPerSlot::AtMostOne,
        is_heartbeat: true,
    }

    /// The events of the processes of a host.
    health: Topic<Health, SlotHeader> {
        writer: Launcher,
        readers: &[Viewer],
        on_full: OnFullBuffer::DropSample,
        samples: SamplesPerSlot::Any,
        is_linked: false,
    }
}

/// A topic that not every run has.
pub type OptionalTopic<S, P, H> = Option<Topic<S, P, H>>;

/// The field of a topic in the ring.
trait RingTopic<S: Service + 'static>: Sized {
    /// The topic of a row.
    fn open(opening: &Opening<'_, S>, row: &'static TopicRow) -> Result<Self, RingError>;

    /// The topic, if the run has it.
    fn existing(&self) -> Option<&dyn AnyTopic<S>>;
}

impl<S: Service + 'static, P: Payload + ?Sized, H: Header> RingTopic<S> for Topic<S, P, H> {
    fn open(opening: &Opening<'_, S>, row: &'static TopicRow) -> Result<Self, RingError> {
        Self::open(opening, row)
    }

    fn existing(&self) -> Option<&dyn AnyTopic<S>> {
        Some(self)
    }
}

impl<S: Service + 'static, P: Payload + ?Sized, H: Header> RingTopic<S> for OptionalTopic<S, P, H> {
    fn open(opening: &Opening<'_, S>, row: &'static TopicRow) -> Result<Self, RingError> {
        row.exists(&opening.member.terms).then(|| Topic::open(opening, row)).transpose()
    }

    fn existing(&self) -> Option<&dyn AnyTopic<S>> {
        self.as_ref().map(|topic| topic as _)
    }
}

impl Terms {
    /// The default, with the topics that the run of a scenario has.
    #[must_use]
    pub fn of(scenario: &Scenario) -> Self {
        let is_asked = |row: &&TopicRow| matches!(row.exists, Existence::WithScenario(asks) if asks(scenario));
        let topics = ROWS.iter().filter(is_asked).map(|row| row.name.to_owned());
        Self { topics: topics.collect(), ..Self::default() }
    }
}

/// The names of the services of a run with these terms, in the order of a slot. Each is a publish-subscribe service and
/// an event service.
#[must_use]
pub fn services(terms: &Terms) -> Vec<String> {
    rows(terms).map(TopicRow::service).collect()
}

/// The topics of a run with these terms.
fn rows(terms: &Terms) -> impl Iterator<Item = &'static TopicRow> {
    ROWS.iter().filter(|row| row.exists(terms))
}

/// The names of the services that a link carries to and from one host of a ring.
#[derive(Debug, PartialEq, Eq)]
pub struct LinkedServices {
    /// All of them.
    pub all: Vec<String>,
    /// Those written by processes of this host.
    pub written_here: Vec<String>,
}

impl LinkedServices {
    /// The services of a host with the processes `roles`.
    #[must_use]
    pub fn of(terms: &Terms, roles: &[Role]) -> Self {
        let is_read = |row: &TopicRow| row.readers.iter().any(|reader| roles.contains(reader));
        let is_written = |row: &TopicRow| roles.contains(&row.writer);
        let linked = || rows(terms).filter(|row| row.is_linked);
        Self {
            all: linked().filter(|row| is_read(row) || is_written(row)).map(TopicRow::service).collect(),
            written_here: linked().filter(|row| is_written(row)).map(TopicRow::service).collect(),
        }
    }
}

impl<S: Service + 'static> Ring<S> {
    /// The states of all topics, in the order of a slot.
    ///
    /// # Errors
    /// If a topic cannot be read.
    pub fn topic_states(&self) -> Result<Vec<TopicState>, RingError> {
        observe_all(&self.topics(), &self.node)
    }

    /// Wall time from one slot to the next, as the newest tick says; `None` in lock-step, and before the first tick.
    ///
    /// # Errors
    /// If the topic cannot be read.
    pub fn period(&self) -> Result<Option<Duration>, RingError> {
        Ok(newest_tick(&self.tick)?.map(|tick| Duration::from_nanos(tick.period_ns)))
    }

    /// Hash of the ring's scenario, as hexadecimal text.
    pub fn scenario_hash(&self) -> Option<String> {
        let key = "scenario".try_into().ok()?;
        self.sensors.terms().key_value(&key, 0).map(ToString::to_string)
    }

    /// Removes the resources of dead processes; called by the launcher. The rest is removed with the folder.
    pub fn remove_dead_nodes(&self) {
        purge_dead_nodes::<S>(self.node.config());
    }

    /// Whether the ring has no other process.
    pub fn is_alone(&self) -> bool {
        is_only_node(&self.node)
    }

    /// Whether a process of this host has the role, as a writer of its heartbeats. A link writes all topics: a writer
    /// of `commit` other than the launcher is a link.
    pub fn has_process(&self, role: Role) -> bool {
        let mut links = if self.terms.link.is_some() { self.commit.writers() } else { Vec::new() };
        links.retain(|writer| writer != self.node.id());
        self.heartbeats(role).writers().iter().any(|writer| !links.contains(writer))
    }

    /// A listener to the heartbeats of the process `role`, on this host or another.
    ///
    /// # Errors
    /// If the topic has its maximum of listeners, or iceoryx2 fails.
    pub fn heartbeat_listener(&self, role: Role) -> Result<Listener<S>, RingError> {
        self.heartbeats(role).listener()
    }

    /// The topic whose notifications are the heartbeats of the process `role`.
    fn heartbeats(&self, role: Role) -> &dyn AnyTopic<S> {
        let is_it = |topic: &&dyn AnyTopic<S>| topic.row().writer == role && topic.row().is_heartbeat;
        self.topics().into_iter().find(is_it).expect("each process has one in every run")
    }

    /// A header of this run with the current time.
    pub fn header(&self, slot: u64, flags: u32) -> SlotHeader {
        SlotHeader { mission: self.terms.mission, slot, epoch: self.restarts, flags, sent_ns: monotonic_ns() }
    }

    /// Waits after the last slot for a commit that `is_awaited`, such as [`is_release`], or for the end of the
    /// launcher. Until then this process serves restarted ones. `repeat` is called every 10 ms.
    ///
    /// # Errors
    /// If `repeat` or iceoryx2 fails, or on a requested stop.
    pub fn wait_for_commit(
        &self,
        wait: &mut WaitContext,
        is_awaited: impl Fn(&SlotHeader) -> bool,
        mut repeat: impl FnMut() -> Result<(), RingError>,
    ) -> Result<(), NodeError> {
        let mut commits = self.commit.reader()?;
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
    nanoseconds(ClockId::Monotonic)
}

/// Time since the machine was started [ns], also while it was suspended.
#[must_use]
pub fn boot_ns() -> u64 {
    nanoseconds(ClockId::Boottime)
}

fn nanoseconds(clock: ClockId) -> u64 {
    let time = clock_gettime(clock);
    time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64 // both are positive: the clock starts at boot
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::estimate::Rates;

    #[test]
    fn a_link_carries_the_topics_of_the_processes_of_its_host() {
        let of = |roles: &[Role]| LinkedServices::of(&Terms::default(), roles);
        let services = |names: &[&str]| names.iter().map(|name| format!("skysink/{name}")).collect::<Vec<_>>();
        let planner = of(&[Planner]);
        assert_eq!(planner.all, services(&["sensors", "queues", "path", "plan", "flight", "commit"]));
        assert_eq!(planner.written_here, services(&["path", "plan"]));
        let flight_sim = of(&[FlightSim]);
        assert_eq!(flight_sim.all, services(&["sensors", "tick", "plan", "flight", "commit"]), "no queues");
        assert_eq!(flight_sim.written_here, services(&["flight"]));
        let launcher = of(&[FieldSim, Launcher]);
        assert_eq!(launcher.written_here, services(&["sensors", "queues", "tick", "commit"]));
        assert!(!launcher.all.contains(&"skysink/health".to_owned()), "each host has its own");
    }

    #[test]
    fn a_link_carries_optional_topics_to_their_readers_alone() {
        let estimated = Terms { belief: Some(Rates::Known), ..Terms::default() };
        let has_belief = |role| LinkedServices::of(&estimated, &[role]).all.contains(&"skysink/belief".to_owned());
        assert!(has_belief(Planner) && !has_belief(Viewer));
        assert!(!services(&Terms::default()).contains(&"skysink/belief".to_owned()));
        let has_rates = |belief| services(&Terms { belief, ..Terms::default() }).contains(&"skysink/rates".to_owned());
        assert!(has_rates(Some(Rates::Learnt)) && !has_rates(Some(Rates::Known)) && !has_rates(None));
        let hearing = Terms { topics: vec!["links".to_owned()], ..Terms::default() };
        let has_links = |role| LinkedServices::of(&hearing, &[role]).all.contains(&"skysink/links".to_owned());
        assert!(has_links(FlightSim) && has_links(Planner) && !has_links(FieldSim));
        assert!(!services(&Terms::default()).contains(&"skysink/links".to_owned()));
        let refusing = Terms { topics: vec!["answers".to_owned()], ..Terms::default() };
        let has_answers = |role| LinkedServices::of(&refusing, &[role]).all.contains(&"skysink/answers".to_owned());
        assert!(has_answers(FieldSim) && has_answers(Planner) && !has_answers(FlightSim));
        assert!(!services(&Terms::default()).contains(&"skysink/answers".to_owned()));
    }

    #[test]
    fn each_process_has_one_topic_of_heartbeats_in_every_run() {
        for role in [FieldSim, FlightSim, Planner, Viewer, Launcher] {
            let heartbeats = |row: &&&TopicRow| row.writer == role && row.is_heartbeat;
            let terms = Terms::default();
            assert_eq!(rows(&terms).collect::<Vec<_>>().iter().filter(heartbeats).count(), 1, "{}", role.name());
        }
    }

    #[test]
    fn the_documentation_lists_each_topic_with_the_lists_that_it_holds() {
        let text = include_str!("../../docs/src/interfaces.md");
        for row in ROWS {
            assert!(text.contains(&format!("| `{}` |", row.service())), "{}", row.name);
        }
        assert_eq!(text.matches("| `skysink/").count(), ROWS.len());
    }
}
