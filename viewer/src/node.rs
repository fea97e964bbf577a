//! viewer as a process of the ring: shows each slot in the scene, and says by `ready` that it is there.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use iceoryx2::prelude::Service;
use iceoryx2::sample::Sample;
use rerun::TextLogLevel;
use skysink_common::message::{FLAG_END, FlightReport, HoldReason, Plan, QueuesHeader, SlotHeader};
use skysink_common::pace::Pace;
use skysink_common::path::{PathPoint, believable};
use skysink_common::scenario::{Area, Scenario};
use skysink_common::stop::Stop;
use skysink_ring::error::{NodeError, RingError};
use skysink_ring::folder::RingFolder;
use skysink_ring::health::{Health, Ready};
use skysink_ring::journal::Journal;
use skysink_ring::reader::{Reader, SlotSample};
use skysink_ring::refusals::Refusal;
use skysink_ring::role::Role;
use skysink_ring::sample::Payload;
use skysink_ring::topics::{PATH_BUFFER, RING_BUFFER, Ring, VIEWER_BUFFER};
use skysink_ring::wait::WaitContext;

use crate::{Scene, SceneError, Sinks, SlotView, WallClock};

/// Why the viewer ends before the mission does.
#[derive(Debug, thiserror::Error)]
pub enum ViewerError {
    /// As any process of the ring.
    #[error(transparent)]
    Node(#[from] NodeError),
    /// The recording cannot be made.
    #[error(transparent)]
    Scene(#[from] SceneError),
}

impl From<RingError> for ViewerError {
    fn from(error: RingError) -> Self {
        Self::Node(error.into())
    }
}

impl ViewerError {
    /// Exit code of a process that ends with this error.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Node(error) => error.exit_code(),
            Self::Scene(_) => 1,
        }
    }
}

/// Records until the mission ends, and returns how many slots this process missed: none in lock-step. However it ends,
/// the recording holds what it got. Started again, it writes the recording's next file.
///
/// # Errors
/// If a peer is missing or wrong, the ring breaks, `stop` is requested, or the recording cannot be made.
pub fn run<S: Service + 'static>(
    scenario: &Scenario,
    folder: &RingFolder,
    stop: &Stop,
    sinks: &Sinks,
) -> Result<u64, ViewerError> {
    let (ring, mut wait) = Ring::<S>::join(folder, scenario, Role::Viewer, stop)?;
    let journal = Journal::open(&folder.journal("viewer"), 2, 0)?;
    let mut sensors = ring.sensors.reader(RING_BUFFER)?;
    let nodes = sensors.wait_for_next(&mut wait, 0)?;
    let mut scene =
        Scene::open(sinks, scenario, nodes.payload(), &run_name(scenario, ring.terms.mission), WallClock::Measured)?;
    let followed = follow(&ring, &scenario.area, &mut wait, &journal, &mut scene);
    let closed = scene.close();
    let missed = followed?;
    closed?;
    Ok(missed)
}

/// Shows every slot that arrives, and saves to the journal which was the last; returns how many were missed.
fn follow<S: Service + 'static>(
    ring: &Ring<S>,
    area: &Area,
    wait: &mut WaitContext,
    journal: &Journal,
    scene: &mut Scene,
) -> Result<u64, ViewerError> {
    let mut readers = Readers::open(ring)?;
    let ready = ring.ready.writer()?;
    let last = journal.read()?.last().map(|record| record.slot);
    // After a resume the ring begins with the last slot on record; the slots before are in earlier files, if in any.
    let mut next = last.map(|slot| slot + 1);
    let mut missed = 0;
    let mut is_ready = false;
    let mut speed = Speed::default();
    loop {
        let queues = readers.queues.wait_for_next(wait, next.unwrap_or(0))?;
        let header = queues.user_header();
        let slot = header.head.slot;
        let is_end = header.head.flags & FLAG_END != 0;
        let expected = *next.get_or_insert(slot);
        readers.log_health(scene)?;
        let flight_limit = readers.limit(true); // flight-sim repeats more than one slot
        let plan_limit = readers.limit(is_ready);
        let flight = read(&mut readers.flights, wait, slot, flight_limit)?;
        let was_planned = flight.as_ref().is_some_and(|flight| flight.payload().hold != HoldReason::NoPlan as u32);
        let plan = if slot > 0 && was_planned { read(&mut readers.plans, wait, slot, plan_limit)? } else { None };

        let missed_until = match flight {
            Some(_) => slot,
            None if is_end => slot + 1,
            None => expected, // not known before the next slot
        };
        if expected < missed_until {
            scene.log_missed(expected..=missed_until - 1)?;
            missed += missed_until - expected;
        }
        if let Some(flight) = flight.filter(|_| slot >= expected) {
            let plan = plan.as_ref().map(|plan| plan.payload());
            let path = readers.path(wait, slot, area)?.filter(|_| plan.is_some());
            scene.log_slot(&SlotView {
                slot,
                queues_bits: queues.payload(),
                header,
                plan,
                path: path.as_ref().map_or(&[], |path| path.payload()),
                flight: flight.payload(),
                slots_per_s: speed.slots_per_s(header),
                plan_ms: plan.map(|plan| plan.plan_ns as f64 / 1e6),
            })?;
            journal.write(slot, &[])?;
            next = Some(slot + 1);
        }

        if !is_ready {
            // Its readers are attached everywhere: writers that live deliver every slot from here on.
            is_ready = true;
            let process = Role::Viewer as u32;
            ready.send(ring.header(slot, 0), Ready { process, restarts: ring.restarts })?;
        }
        if is_end {
            readers.log_health(scene)?;
            // Until then the recorder may need to know that this viewer is ready.
            ring.wait_for_commit(wait, |commit| commit.slot >= slot, || Ok(()))?;
            return Ok(missed);
        }
    }
}

/// The topics that the viewer reads.
struct Readers<S: Service + 'static> {
    queues: Reader<S, [u32], QueuesHeader>,
    plans: Reader<S, Plan, SlotHeader>,
    paths: Reader<S, [PathPoint], SlotHeader>,
    flights: Reader<S, FlightReport, SlotHeader>,
    health: Reader<S, Health, SlotHeader>,
    pace: Pace,
    /// Slots whose path has been read.
    paths_read: u32,
}

/// How long to wait for what may have been sent before this process was there.
const LEFT_OVERS: Duration = Duration::from_millis(500);

/// How often it is polled for.
const POLL: Duration = Duration::from_millis(10);

/// Slots whose path may have been sent before this process was there. It then arrives when the writer next serves late
/// joiners, which may be after the plan.
const PATHS_BEFORE: u32 = 2;

impl<S: Service + 'static> Readers<S> {
    fn open(ring: &Ring<S>) -> Result<Self, RingError> {
        Ok(Self {
            paths: ring.path.reader(PATH_BUFFER)?, // before the plans: whoever has a plan then has its path
            plans: ring.plan.reader(VIEWER_BUFFER)?,
            flights: ring.flight.reader(VIEWER_BUFFER)?,
            queues: ring.queues.reader(VIEWER_BUFFER)?,
            health: ring.health.reader(VIEWER_BUFFER)?,
            pace: ring.terms.pace,
            paths_read: 0,
        })
    }

    /// How long to wait for the other samples of a slot at most; none: until they are there, or later ones are. Before this process `is_ready` some may be gone; in paced runs also
    /// later, because no writer waits for this reader.
    fn limit(&self, is_ready: bool) -> Option<Duration> {
        (self.pace != Pace::Max || !is_ready).then_some(LEFT_OVERS)
    }

    /// The path of a slot whose plan is there; none if there is none, or one that cannot be, which is refused.
    fn path(
        &mut self,
        wait: &mut WaitContext,
        slot: u64,
        area: &Area,
    ) -> Result<Option<Sample<S, [PathPoint], SlotHeader>>, ViewerError> {
        let may_be_late = slot > 0 && self.paths_read < PATHS_BEFORE && self.pace == Pace::Max;
        self.paths_read = self.paths_read.saturating_add(1);
        let limit = if may_be_late && self.paths.has_writer() { LEFT_OVERS } else { Duration::ZERO };
        let path = read(&mut self.paths, wait, slot, Some(limit))?;
        let is_good = path.as_ref().is_none_or(|path| believable(path.payload(), area));
        if !is_good {
            self.paths.refuse(slot, Refusal::Path);
        }
        Ok(path.filter(|_| is_good))
    }

    /// Adds what has become of the processes to the event log.
    fn log_health(&mut self, scene: &Scene) -> Result<(), ViewerError> {
        while let Some(sample) = self.health.next_sample()? {
            if let Some((role, fate)) = sample.payload().read() {
                let level = if fate.is_recovery() { TextLogLevel::INFO } else { TextLogLevel::WARN };
                scene.log_event(sample.user_header().slot, level, &format!("{} {fate}", role.name()))?;
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
        match reader.of_slot(slot)? {
            SlotSample::Here(sample) => return Ok(Some(sample)),
            SlotSample::NotYet if Instant::now() < deadline => std::thread::sleep(POLL),
            SlotSample::NotYet | SlotSample::Passed => return Ok(None),
        }
    }
}

/// Name of the recording, and its id unless earlier files have one. rerun merges recordings of one id: each run has its
/// own.
fn run_name(scenario: &Scenario, mission: u64) -> String {
    let strategy = &scenario.planner.strategy;
    format!("{}-{strategy}-{} ({:08x})", scenario.name, scenario.seed, mission >> 32)
}

/// Pace of the ring, from the times at which queues were sent.
#[derive(Debug, Default)]
struct Speed(VecDeque<(u64, u64)>);

/// Slots over which the pace is averaged.
const SPEED_WINDOW: usize = 32;

impl Speed {
    fn slots_per_s(&mut self, header: &QueuesHeader) -> Option<f64> {
        let now = (header.head.slot, header.head.sent_ns);
        self.0.push_back(now);
        if self.0.len() > SPEED_WINDOW {
            self.0.pop_front();
        }
        let first = self.0.front()?;
        let elapsed_ns = now.1.saturating_sub(first.1);
        (elapsed_ns > 0).then(|| (now.0 - first.0) as f64 * 1e9 / elapsed_ns as f64)
    }
}
