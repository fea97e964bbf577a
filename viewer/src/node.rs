//! The viewer as a process of the ring: logs each slot to the scene, and sends `ready` once it reads every topic.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use iceoryx2::prelude::Service;
use iceoryx2::sample::Sample;
use re_sdk_types::components::TextLogLevel;
use skysink_common::error::InputError;
use skysink_common::estimate::Rates;
use skysink_common::ledger::Ledger;
use skysink_common::message::{
    FLAG_END, FlightReport, HeardLink, HoldReason, NodeAnswer, PathPoint, Plan, QueuesHeader, SlotHeader,
};
use skysink_common::nodes::Answer;
use skysink_common::pace::Pace;
use skysink_common::possible::{are_known_links, are_possible_paths};
use skysink_common::scenario::{Area, Scenario};
use skysink_common::sensors::{SensorList, Sensors};
use skysink_common::slot_record::{ByUav, beacons, uploads};
use skysink_common::stop::Stop;
use skysink_common::told::Told;
use skysink_ring::error::NodeError;
use skysink_ring::folder::RingFolder;
use skysink_ring::health::{Health, Ready};
use skysink_ring::journal::Journal;
use skysink_ring::reader::{Reader, SlotSample};
use skysink_ring::refusals::Refusal;
use skysink_ring::role::Role;
use skysink_ring::sample::Payload;
use skysink_ring::topics::Ring;
use skysink_ring::wait::WaitContext;

use crate::journal::resume;
use crate::{Scene, SceneError, Sinks, SlotView, WallClock};

impl From<SceneError> for NodeError {
    /// A file that cannot be created is bad input, because a restart would fail, too. So is one that another process
    /// has changed, because a restarted viewer could not write the lost slots again.
    fn from(error: SceneError) -> Self {
        match error {
            SceneError::File { path, source } => {
                let message = format_args!("{source}: expected a path where a file can be created");
                Self::Input(InputError::new("recording", &path, message))
            }
            SceneError::Changed { path, source } => Self::Input(InputError::new("recording", &path, source)),
            error => Self::Recording(Box::new(error)),
        }
    }
}

/// Timeout for messages that may have been sent before this process joined.
const LEFT_OVERS: Duration = Duration::from_millis(500);

/// Time between two polls for such messages.
const POLL: Duration = Duration::from_millis(10);

/// Number of slots whose path may have been sent before this process joined. Such a path arrives when the writer next
/// serves late joiners, possibly after the plan.
const PATHS_BEFORE: u32 = 2;

/// Slots over which the pace is averaged.
const PACE_WINDOW: usize = 32;

/// What the viewer records, and where.
#[derive(Debug)]
pub struct ViewerOptions {
    /// Where it records.
    pub sinks: Sinks,
    /// Name of an external planner.
    pub label: Option<String>,
    /// How the UAV knows the rates, if it has to estimate the queues.
    pub estimated: Option<Rates>,
}

/// Records until the mission ends, and returns the number of slots that this process has missed (0 in lock-step).
/// However it ends, the recording contains all received slots. After a restart, it writes the next file of the
/// recording.
///
/// # Errors
/// If a peer is missing or wrong, the ring is broken, the recording cannot be written, or on a stop.
pub fn run<S: Service + 'static>(
    scenario: &Scenario,
    folder: &RingFolder,
    stop: &Stop,
    options: &ViewerOptions,
) -> Result<u64, NodeError> {
    let (ring, mut wait) = Ring::<S>::join(folder, scenario, Role::Viewer, stop)?;
    let mut topic = ring.sensors.reader()?;
    let nodes = topic.wait_for_next(&mut wait, 0)?;
    let _topic = ring.terms.link.is_none().then_some(topic); // over a link, repeated samples would accumulate
    let is_drawn = scenario.arrival_law().is_random();
    let sensors = Arc::new(if ring.terms.has_learnt_rates() || is_drawn {
        SensorList::of(scenario)?.sensors_of(scenario) // the topic has what a planner knows of what they sample
    } else {
        Sensors::of(scenario, nodes.payload())
    });
    let mut shown = scenario.clone();
    if let Some(label) = &options.label {
        label.clone_into(&mut shown.planner.strategy);
    }
    let name = run_name(&shown, ring.terms.mission);
    let mut scene = Scene::open(&options.sinks, &shown, &sensors, &name, WallClock::Measured, options.estimated)?;
    let journal = resume(folder, Scene::state_room(sensors.count()), &mut scene)?;
    if let Some(port) = scene.port() {
        let address = format!("rerun+http://127.0.0.1:{port}/proxy");
        Role::Viewer.log(format_args!("live at {address}: open it by `rerun {address}`"));
    }
    let list = scenario.node_traits().has_level.then(|| SensorList::of(scenario)).transpose()?;
    let ledger = list.map(|list| list.ledger(scenario));
    let followed = Follower::open(&ring, scenario, journal, ledger, &mut scene)
        .and_then(|mut follower| follower.follow(&mut wait).map(|()| follower.missed));
    let closed = scene.close();
    let missed = followed?;
    closed?;
    Ok(missed)
}

/// A viewer that has joined the ring: its readers, its scene, and its progress.
struct Follower<'a, S: Service + 'static> {
    ring: &'a Ring<S>,
    area: &'a Area,
    /// Number of UAVs.
    uavs: usize,
    /// That of sensor nodes with something that runs out, which no topic has; `None` without, and once slots are
    /// missed.
    ledger: Option<Ledger>,
    /// The slot of the ledger.
    ledger_slot: u64,
    journal: Journal,
    scene: &'a mut Scene,
    paths: Reader<S, [PathPoint], SlotHeader>,
    plans: Reader<S, [Plan], SlotHeader>,
    links: Option<Reader<S, [HeardLink], SlotHeader>>,
    answers: Option<Reader<S, [NodeAnswer], SlotHeader>>,
    flights: Reader<S, [FlightReport], SlotHeader>,
    queues: Reader<S, [u32], QueuesHeader>,
    health: Reader<S, Health, SlotHeader>,
    /// Number of slots whose path has been read.
    paths_read: u32,
    /// Whether `ready` has been sent.
    is_ready: bool,
    /// The slot to show next; `None` before the first has arrived.
    next: Option<u64>,
    /// Slots missed by this process.
    missed: u64,
    /// The last received slots, oldest first.
    recent: VecDeque<SlotHeader>,
}

impl<'a, S: Service + 'static> Follower<'a, S> {
    fn open(
        ring: &'a Ring<S>,
        scenario: &'a Scenario,
        journal: Journal,
        ledger: Option<Ledger>,
        scene: &'a mut Scene,
    ) -> Result<Self, NodeError> {
        Ok(Self {
            links: ring.links.as_ref().map(|links| links.reader()).transpose()?,
            answers: ring.answers.as_ref().map(|answers| answers.reader()).transpose()?,
            ledger,
            ledger_slot: 0,
            paths: ring.path.reader()?, // before the plans, so that the path of every received plan is available
            plans: ring.plan.reader()?,
            flights: ring.flight.reader()?,
            queues: ring.queues.reader()?,
            health: ring.health.reader()?,
            paths_read: 0,
            is_ready: false,
            // A resumed ring begins with the last recorded slot. Earlier slots are in earlier files, if recorded.
            next: journal.last_slot()?.map(|slot| slot + 1),
            missed: 0,
            recent: VecDeque::new(),
            ring,
            area: &scenario.area,
            uavs: scenario.uav.uavs(),
            journal,
            scene,
        })
    }

    /// Shows every slot until the mission has ended, and saves the progress to the journal.
    fn follow(&mut self, wait: &mut WaitContext) -> Result<(), NodeError> {
        let ready = self.ring.ready.writer()?;
        loop {
            let queues = match self.queues.wait_for_next(wait, self.next.unwrap_or(0)) {
                Err(NodeError::Stopped(stopped)) => {
                    self.show_left_overs(wait)?;
                    return Err(stopped.into());
                }
                queues => queues?,
            };
            let head = queues.user_header().head;
            let is_end = head.flags & FLAG_END != 0;
            self.log_health()?;
            self.show(wait, &queues)?;
            if !self.is_ready {
                // All readers are attached, so that writers deliver every slot from here on.
                self.is_ready = true;
                let process = Role::Viewer as u32;
                ready.send(self.ring.header(head.slot, 0), Ready { process, restarts: self.ring.restarts })?;
            }
            if is_end {
                self.log_health()?;
                // The recorder may read `ready` until the last slot is committed.
                self.ring.wait_for_commit(wait, |commit| commit.slot >= head.slot, || Ok(()))?;
                return Ok(());
            }
        }
    }

    /// Shows the slots that were flown before a stop and arrive shortly after it.
    fn show_left_overs(&mut self, wait: &mut WaitContext) -> Result<(), NodeError> {
        let deadline = Instant::now() + LEFT_OVERS;
        while Instant::now() < deadline {
            match self.queues.next_sample()? {
                Some(queues) => self.show(wait, &queues)?,
                None => std::thread::sleep(POLL),
            }
        }
        Ok(())
    }

    /// Shows the slot of these queues. Marks missed slots before it.
    fn show(&mut self, wait: &mut WaitContext, queues: &Sample<S, [u32], QueuesHeader>) -> Result<(), NodeError> {
        let header = queues.user_header();
        let slot = header.head.slot;
        let expected = *self.next.get_or_insert(slot);
        // In paced runs, writers do not wait for this reader, which may miss samples. In lock-step, it can only miss a
        // plan that was sent before it was ready; flight-sim repeats its last flights.
        let flight_limit = (self.ring.terms.pace != Pace::Max).then_some(LEFT_OVERS);
        let plan_limit = if self.is_ready { flight_limit } else { Some(LEFT_OVERS) };
        let flight = read(&mut self.flights, wait, slot, flight_limit)?;
        let was_planned =
            flight.as_ref().is_some_and(|flight| flight.iter().any(|flight| flight.hold != HoldReason::NoPlan as u32));
        let plan = if slot > 0 && was_planned { read(&mut self.plans, wait, slot, plan_limit)? } else { None };

        let missed_until = match flight {
            Some(_) => slot,
            None if header.head.flags & FLAG_END != 0 => slot + 1,
            None => expected, // unknown before the next slot
        };
        if expected < missed_until {
            self.scene.log_missed(expected..=missed_until - 1)?;
            self.missed += missed_until - expected;
        }
        let Some(flight) = flight.filter(|_| slot >= expected) else { return Ok(()) };
        let paths = self.paths(wait, slot)?.filter(|_| plan.is_some());
        let plans: ByUav<_> = plan.iter().flat_map(|plans| plans.payload().iter().copied().map(Some)).collect();
        let heard = self.heard(wait, slot, queues.payload().len())?;
        let Some(answers) = self.answers(wait, slot, queues.payload().len())? else { return Ok(()) };
        let told = Told::new(queues.payload(), &answers);
        self.follow_charges(slot, told, &flight);
        let slots_per_s = self.slots_per_s(header.head);
        self.scene.log_slot(&SlotView {
            slot,
            told,
            header,
            plans: &plans,
            paths: paths.as_ref().map_or(&[], |paths| paths.payload()),
            flights: &flight,
            heard: heard.as_ref().map_or(&[], |heard| heard.payload()),
            features: self.ledger.as_ref().map(Ledger::features),
            slots_per_s,
            plan_ms: plan.map(|plans| plans.iter().map(|plan| plan.plan_ns).sum::<u64>() as f64 / 1e6),
        })?;
        self.journal.save(slot, &[], self.scene)?;
        self.next = Some(slot + 1);
        Ok(())
    }

    /// What the UAVs have heard in a slot, which was sent before their flights. Unknown links are refused.
    fn heard(
        &mut self,
        wait: &mut WaitContext,
        slot: u64,
        sensors: usize,
    ) -> Result<Option<Sample<S, [HeardLink], SlotHeader>>, NodeError> {
        let Some(links) = &mut self.links else { return Ok(None) };
        let heard = read(links, wait, slot, Some(LEFT_OVERS))?;
        let are_known = heard.as_ref().is_none_or(|heard| are_known_links(heard.payload(), self.uavs, sensors));
        if !are_known {
            links.refuse(slot, Refusal::Links);
        }
        Ok(heard.filter(|_| are_known))
    }

    /// What the sensor nodes do after a slot, which was sent before the queues; nothing if all send. `None` if it was
    /// missed, or has not one answer of each of `sensors`, which is refused.
    fn answers(&mut self, wait: &mut WaitContext, slot: u64, sensors: usize) -> Result<Option<Vec<Answer>>, NodeError> {
        let Some(answers) = &mut self.answers else { return Ok(Some(Vec::new())) };
        let Some(nodes) = read(answers, wait, slot, Some(LEFT_OVERS))? else { return Ok(None) };
        if nodes.payload().len() != sensors {
            answers.refuse(slot, Refusal::Length);
            return Ok(None);
        }
        Ok(Some(nodes.payload().iter().filter_map(|node| Answer::from_repr(node.answer)).collect()))
    }

    /// Advances the charges to a slot, as field-sim does, as long as none is missing.
    fn follow_charges(&mut self, slot: u64, told: Told<'_>, flights: &[FlightReport]) {
        let Some(ledger) = &mut self.ledger else { return };
        let is_next = slot == self.ledger_slot + 1;
        self.ledger_slot = slot;
        if is_next {
            ledger.sample(slot);
            for link in uploads(flights).filter(|link| (link.sensor as usize) < told.queues_bits.len()) {
                let _ = ledger.serve(slot, link.sensor as usize, link.capacity_bits, link.rate_bps);
            }
            let _ = ledger.end_slot(slot, &beacons(flights).collect::<Vec<_>>());
        }
        let mut answers = Vec::new();
        ledger.fill_answers(&mut answers);
        if !is_next && slot > 0 || Told::new(ledger.queues_bits(), &answers) != told {
            self.ledger = None;
        }
    }

    /// The paths of a slot whose plan has arrived; empty if there is none. Invalid paths are refused.
    fn paths(
        &mut self,
        wait: &mut WaitContext,
        slot: u64,
    ) -> Result<Option<Sample<S, [PathPoint], SlotHeader>>, NodeError> {
        let is_lockstep = self.ring.terms.pace == Pace::Max;
        let may_be_late = slot > 0 && self.paths_read < PATHS_BEFORE && is_lockstep && self.ring.path.has_writer();
        self.paths_read = self.paths_read.saturating_add(1);
        let limit = if may_be_late { LEFT_OVERS } else { Duration::ZERO };
        let path = read(&mut self.paths, wait, slot, Some(limit))?;
        let is_good = path.as_ref().is_none_or(|path| are_possible_paths(path.payload(), self.area, self.uavs));
        if !is_good {
            self.paths.refuse(slot, Refusal::Path);
        }
        Ok(path.filter(|_| is_good))
    }

    /// Pace of the ring over the last slots, from the send times of their queues [slot/s].
    fn slots_per_s(&mut self, now: SlotHeader) -> Option<f64> {
        self.recent.push_back(now);
        if self.recent.len() > PACE_WINDOW {
            self.recent.pop_front();
        }
        let first = self.recent.front()?;
        let elapsed_ns = now.sent_ns.saturating_sub(first.sent_ns);
        (elapsed_ns > 0).then(|| (now.slot - first.slot) as f64 * 1e9 / elapsed_ns as f64)
    }

    /// Adds changes of the state of processes to the event log.
    fn log_health(&mut self) -> Result<(), NodeError> {
        while let Some(sample) = self.health.next_sample()? {
            if let Some((role, event)) = sample.payload().decode() {
                let level = if event.is_recovery() { TextLogLevel::INFO } else { TextLogLevel::WARN };
                self.scene.log_event(sample.user_header().slot, level, &format!("{} {event}", role.name()))?;
            }
        }
        Ok(())
    }
}

/// Reads the sample of a slot; `None` if it was missed. It may arrive later than the queues, because a writer serves
/// its readers one after another. A stop does not interrupt a limited wait, so that the last slot is complete.
fn read<S: Service + 'static, P: Payload + ?Sized>(
    reader: &mut Reader<S, P, SlotHeader>,
    wait: &mut WaitContext,
    slot: u64,
    limit: Option<Duration>,
) -> Result<Option<Sample<S, P, SlotHeader>>, NodeError> {
    let Some(limit) = limit else { return reader.wait_for_slot(wait, slot) };
    let deadline = Instant::now() + limit;
    loop {
        match reader.poll_slot(slot)? {
            SlotSample::Available(sample) => return Ok(Some(sample)),
            SlotSample::Pending if Instant::now() < deadline => std::thread::sleep(POLL),
            SlotSample::Pending | SlotSample::Passed => return Ok(None),
        }
    }
}

/// Name of the recording, and its id unless earlier files have one. The id is unique per run, because rerun merges
/// recordings with equal ids.
fn run_name(scenario: &Scenario, mission: u64) -> String {
    let strategy = &scenario.planner.strategy;
    format!("{}-{strategy}-{} ({:08x})", scenario.name, scenario.seed, mission >> 32)
}
