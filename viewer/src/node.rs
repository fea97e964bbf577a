//! viewer as a process of the ring: shows each slot in the scene, and sends `ready` once it reads every topic.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use iceoryx2::prelude::Service;
use iceoryx2::sample::Sample;
use re_sdk_types::components::TextLogLevel;
use skysink_common::error::InputError;
use skysink_common::estimate::Rates;
use skysink_common::message::{
    FLAG_END, FlightReport, HoldReason, PathPoint, Plan, QueuesHeader, SlotHeader, is_possible_path,
};
use skysink_common::pace::Pace;
use skysink_common::scenario::{Area, Scenario};
use skysink_common::stop::Stop;
use skysink_ring::error::NodeError;
use skysink_ring::folder::RingFolder;
use skysink_ring::health::{Health, Ready};
use skysink_ring::reader::{Reader, SlotSample};
use skysink_ring::refusals::Refusal;
use skysink_ring::role::Role;
use skysink_ring::sample::Payload;
use skysink_ring::topics::{PATH_BUFFER, RING_BUFFER, Ring, VIEWER_BUFFER};
use skysink_ring::wait::WaitContext;

use crate::journal::ViewerJournal;
use crate::{Scene, SceneError, Sinks, SlotView, WallClock};

impl From<SceneError> for NodeError {
    /// A file that cannot be created is refused input: it could not be created the next time either.
    fn from(error: SceneError) -> Self {
        match error {
            SceneError::File { path, source } => {
                let message = format_args!("{source}: expected a place where a file can be created");
                Self::Input(InputError::new("recording", &path, message))
            }
            error => Self::Recording(Box::new(error)),
        }
    }
}

/// How long to wait for what may have been sent before this process was there.
const LEFT_OVERS: Duration = Duration::from_millis(500);

/// How often it is polled for.
const POLL: Duration = Duration::from_millis(10);

/// Slots whose path may have been sent before this process was there. It then arrives when the writer next serves late
/// joiners, which may be after the plan.
const PATHS_BEFORE: u32 = 2;

/// Slots over which the pace is averaged.
const PACE_WINDOW: usize = 32;

/// Records until the mission ends, and returns how many slots this process missed: none in lock-step. However it ends,
/// the recording holds what it got. Started again, it writes the recording's next file. `label` is what the mission of
/// an outside planner is booked as, `estimated` what the UAV knows of the rates where it has to estimate the queues.
///
/// # Errors
/// If a peer is missing or wrong, the ring breaks, `stop` is requested, or the recording cannot be made.
pub fn run<S: Service + 'static>(
    scenario: &Scenario,
    folder: &RingFolder,
    stop: &Stop,
    sinks: &Sinks,
    label: Option<&str>,
    estimated: Option<Rates>,
) -> Result<u64, NodeError> {
    let (ring, mut wait) = Ring::<S>::join(folder, scenario, Role::Viewer, stop)?;
    let mut sensors = ring.sensors.reader(RING_BUFFER)?;
    let nodes = sensors.wait_for_next(&mut wait, 0)?;
    let _sensors = ring.terms.link.is_none().then_some(sensors); // behind a link its repeats would pile up
    let mut shown = scenario.clone();
    if let Some(label) = label {
        label.clone_into(&mut shown.planner.strategy);
    }
    let name = run_name(&shown, ring.terms.mission);
    let mut scene = Scene::open(sinks, &shown, nodes.payload(), &name, WallClock::Measured, estimated)?;
    let journal = ViewerJournal::open(folder, Scene::state_room(nodes.payload().len()), &mut scene)?;
    if let Some(port) = scene.port() {
        let address = format!("rerun+http://127.0.0.1:{port}/proxy");
        Role::Viewer.log(format_args!("live at {address}: open it by `rerun {address}`"));
    }
    let followed = Follower::open(&ring, &scenario.area, journal, &mut scene)
        .and_then(|mut follower| follower.follow(&mut wait).map(|()| follower.missed));
    let closed = scene.close();
    let missed = followed?;
    closed?;
    Ok(missed)
}

/// A viewer that has joined the ring: the topics that it reads, the scene that it shows them in, and how far it is.
struct Follower<'a, S: Service + 'static> {
    ring: &'a Ring<S>,
    area: &'a Area,
    journal: ViewerJournal,
    scene: &'a mut Scene,
    paths: Reader<S, [PathPoint], SlotHeader>,
    plans: Reader<S, Plan, SlotHeader>,
    flights: Reader<S, FlightReport, SlotHeader>,
    queues: Reader<S, [u32], QueuesHeader>,
    health: Reader<S, Health, SlotHeader>,
    /// Slots whose path has been read.
    paths_read: u32,
    /// Whether this process has said that it is ready.
    is_ready: bool,
    /// The slot to show next; none before the first one is there.
    next: Option<u64>,
    /// Slots missed by this process.
    missed: u64,
    /// The last slots that were sent, the oldest first.
    recent: VecDeque<SlotHeader>,
}

impl<'a, S: Service + 'static> Follower<'a, S> {
    fn open(
        ring: &'a Ring<S>,
        area: &'a Area,
        journal: ViewerJournal,
        scene: &'a mut Scene,
    ) -> Result<Self, NodeError> {
        Ok(Self {
            paths: ring.path.reader(PATH_BUFFER)?, // before the plans: whoever has a plan then has its path
            plans: ring.plan.reader(VIEWER_BUFFER)?,
            flights: ring.flight.reader(VIEWER_BUFFER)?,
            queues: ring.truth.reader(VIEWER_BUFFER)?,
            health: ring.health.reader(VIEWER_BUFFER)?,
            paths_read: 0,
            is_ready: false,
            // After a resume the ring begins with the last slot on record; those before are in earlier files, if in
            // any.
            next: journal.next,
            missed: 0,
            recent: VecDeque::new(),
            ring,
            area,
            journal,
            scene,
        })
    }

    /// Shows every slot that arrives until the mission has ended, and saves to the journal which was the last.
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
                // Its readers are attached to every topic: running writers deliver every slot from here on.
                self.is_ready = true;
                let process = Role::Viewer as u32;
                ready.send(self.ring.header(head.slot, 0), Ready { process, restarts: self.ring.restarts })?;
            }
            if is_end {
                self.log_health()?;
                // Until the last slot is committed, the recorder may read `ready`.
                self.ring.wait_for_commit(wait, |commit| commit.slot >= head.slot, || Ok(()))?;
                return Ok(());
            }
        }
    }

    /// Shows the slots that were flown before a stop, but arrive with it or a little later.
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

    /// Shows the slot of these queues, after those that were missed before it.
    fn show(&mut self, wait: &mut WaitContext, queues: &Sample<S, [u32], QueuesHeader>) -> Result<(), NodeError> {
        let header = queues.user_header();
        let slot = header.head.slot;
        let expected = *self.next.get_or_insert(slot);
        // In paced runs no writer waits for this reader, which may miss samples. In lock-step it may only miss a plan
        // that was sent before it was ready: of the flights, flight-sim repeats more than one.
        let flight_limit = (self.ring.terms.pace != Pace::Max).then_some(LEFT_OVERS);
        let plan_limit = if self.is_ready { flight_limit } else { Some(LEFT_OVERS) };
        let flight = read(&mut self.flights, wait, slot, flight_limit)?;
        let was_planned = flight.as_ref().is_some_and(|flight| flight.payload().hold != HoldReason::NoPlan as u32);
        let plan = if slot > 0 && was_planned { read(&mut self.plans, wait, slot, plan_limit)? } else { None };

        let missed_until = match flight {
            Some(_) => slot,
            None if header.head.flags & FLAG_END != 0 => slot + 1,
            None => expected, // not known before the next slot
        };
        if expected < missed_until {
            self.scene.log_missed(expected..=missed_until - 1)?;
            self.missed += missed_until - expected;
        }
        let Some(flight) = flight.filter(|_| slot >= expected) else { return Ok(()) };
        let path = self.path(wait, slot)?.filter(|_| plan.is_some());
        let plan = plan.as_ref().map(|plan| plan.payload());
        let slots_per_s = self.slots_per_s(header.head);
        self.scene.log_slot(&SlotView {
            slot,
            queues_bits: queues.payload(),
            header,
            plan,
            path: path.as_ref().map_or(&[], |path| path.payload()),
            flight: flight.payload(),
            slots_per_s,
            plan_ms: plan.map(|plan| plan.plan_ns as f64 / 1e6),
        })?;
        self.journal.save(slot, self.scene)?;
        self.next = Some(slot + 1);
        Ok(())
    }

    /// The path of a slot whose plan is there; none if there is none, or one that cannot be, which is refused.
    fn path(
        &mut self,
        wait: &mut WaitContext,
        slot: u64,
    ) -> Result<Option<Sample<S, [PathPoint], SlotHeader>>, NodeError> {
        let is_lockstep = self.ring.terms.pace == Pace::Max;
        let may_be_late = slot > 0 && self.paths_read < PATHS_BEFORE && is_lockstep && self.ring.path.has_writer();
        self.paths_read = self.paths_read.saturating_add(1);
        let limit = if may_be_late { LEFT_OVERS } else { Duration::ZERO };
        let path = read(&mut self.paths, wait, slot, Some(limit))?;
        let is_good = path.as_ref().is_none_or(|path| is_possible_path(path.payload(), self.area));
        if !is_good {
            self.paths.refuse(slot, Refusal::Path);
        }
        Ok(path.filter(|_| is_good))
    }

    /// Pace of the ring [slot/s] over the last slots, from the times at which their queues were sent.
    fn slots_per_s(&mut self, now: SlotHeader) -> Option<f64> {
        self.recent.push_back(now);
        if self.recent.len() > PACE_WINDOW {
            self.recent.pop_front();
        }
        let first = self.recent.front()?;
        let elapsed_ns = now.sent_ns.saturating_sub(first.sent_ns);
        (elapsed_ns > 0).then(|| (now.slot - first.slot) as f64 * 1e9 / elapsed_ns as f64)
    }

    /// Adds what has become of the processes to the event log.
    fn log_health(&mut self) -> Result<(), NodeError> {
        while let Some(sample) = self.health.next_sample()? {
            if let Some((role, fate)) = sample.payload().decode() {
                let level = if fate.is_recovery() { TextLogLevel::INFO } else { TextLogLevel::WARN };
                self.scene.log_event(sample.user_header().slot, level, &format!("{} {fate}", role.name()))?;
            }
        }
        Ok(())
    }
}

/// The sample of a slot; none if it was missed. A sample may reach this reader later than the queues do: its writer
/// serves the readers one after another. A requested stop does not cut a limited wait short, for the last slot's sake.
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

/// Name of the recording, and its id unless earlier files have one. rerun merges recordings of one id: each run has its
/// own.
fn run_name(scenario: &Scenario, mission: u64) -> String {
    let strategy = &scenario.planner.strategy;
    format!("{}-{strategy}-{} ({:08x})", scenario.name, scenario.seed, mission >> 32)
}
