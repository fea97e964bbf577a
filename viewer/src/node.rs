//! viewer as a process of the ring: reads every topic, writes none, and shows each slot in the scene.

use std::collections::VecDeque;
use std::fmt::Debug;
use std::time::{Duration, Instant};

use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{IceoryxSend, Service};
use iceoryx2::sample::Sample;
use skysink_common::message::{FLAG_END, FLAG_TICK, FlightReport, HoldReason, Plan, QueuesHeader, SlotHeader};
use skysink_common::pace::Pace;
use skysink_common::path::{PathPoint, believable};
use skysink_common::scenario::{Area, Scenario};
use skysink_common::stop::Stop;
use skysink_ring::error::{NodeError, RingError};
use skysink_ring::folder::RingFolder;
use skysink_ring::health::Health;
use skysink_ring::journal::Journal;
use skysink_ring::reader::{Found, Reader, Receive};
use skysink_ring::refusals::Refusal;
use skysink_ring::role::Role;
use skysink_ring::topics::{PATH_BUFFER, RING_BUFFER, Ring, VIEWER_BUFFER, VIEWER_READY};
use skysink_ring::wait::WaitContext;

use crate::{Level, Scene, SceneError, Sinks, SlotView, Timing};

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
    let seat = folder.take_seat(Role::Viewer)?;
    let ring = Ring::<S>::open(folder, scenario, Role::Viewer, &seat)?;
    let mut context = ring.wait_context(folder, Some(seat), stop)?;
    let journal = Journal::open(&folder.journal("viewer"), 2, 0).map_err(RingError::from)?;
    let mut sensors = ring.sensors.reader(RING_BUFFER)?;
    let nodes = sensors.wait_for(&mut context, 0, |_| true, idle)?;
    let mut scene =
        Scene::open(sinks, scenario, nodes.payload(), &run_name(scenario, ring.terms.mission), Timing::Measured)?;
    let followed = follow(&ring, &scenario.area, &mut context, &journal, &mut scene);
    let closed = scene.close();
    let missed = followed?;
    closed?;
    Ok(missed)
}

/// No other process depends on this one while it waits.
fn idle() -> Result<(), ViewerError> {
    Ok(())
}

/// Shows every slot that arrives, and saves to the journal which was the last; returns how many were missed.
fn follow<S: Service + 'static>(
    ring: &Ring<S>,
    area: &Area,
    context: &mut WaitContext,
    journal: &Journal,
    scene: &mut Scene,
) -> Result<u64, ViewerError> {
    let mut readers = Readers::open(ring)?;
    let last = journal.read().map_err(RingError::from)?.last().map(|record| record.slot);
    // After a resume the ring begins with the last slot on record; the slots before are in earlier files, if in any.
    let mut next = last.map(|slot| slot + 1);
    let mut missed = 0;
    let mut is_ready = false;
    let mut speed = Speed::default();
    loop {
        let queues = readers.queues(context, next.unwrap_or(0))?;
        let header = queues.user_header();
        let slot = header.head.slot;
        let is_end = header.head.flags & FLAG_END != 0;
        let expected = *next.get_or_insert(slot);
        readers.log_health(scene)?;
        let wait = readers.wait(slot, is_end && !is_ready);
        let flight = read(&mut readers.flights, context, slot, wait)?;
        let plan = if slot > 0 { read(&mut readers.plans, context, slot, wait)? } else { None };

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
            let in_time = HoldReason::of_code(flight.payload().hold) != HoldReason::NoPlan;
            let plan = plan.as_ref().map(|plan| plan.payload()).filter(|_| in_time);
            let path = readers.path(context, slot, area)?.filter(|_| plan.is_some());
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
            journal.write(slot, &[]).map_err(RingError::from)?;
            next = Some(slot + 1);
        }

        if !is_ready {
            // Connected to every writer: from here on no slot can be lost on the way.
            if !is_end && wait == Wait::UntilPassed {
                readers.plans.wait_until_there(context, slot + 1, idle)?;
            }
            is_ready = true;
            ring.commit.say(VIEWER_READY)?;
        }
        if is_end {
            readers.log_health(scene)?;
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

/// How long to wait for a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Wait {
    /// Until it is there, or a later one is.
    UntilPassed,
    /// No longer than this.
    AtMost(Duration),
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

    /// The next queues that arrive; `slot` is expected.
    fn queues(&mut self, context: &mut WaitContext, slot: u64) -> Result<Sample<S, [u32], QueuesHeader>, ViewerError> {
        let is_state = |header: &QueuesHeader| header.head.flags & FLAG_TICK == 0;
        self.queues.wait_for(context, slot, is_state, idle)
    }

    /// How long to wait for the other samples of a slot. Of one that `was_over` before this process was there some may be
    /// gone; in paced runs also of others.
    fn wait(&self, slot: u64, was_over: bool) -> Wait {
        match self.pace {
            Pace::Factor(_) if slot > 0 => Wait::AtMost(Duration::ZERO), // the clock starts when everybody is there
            _ if was_over => Wait::AtMost(LEFT_OVERS),
            _ => Wait::UntilPassed,
        }
    }

    /// The path of a slot whose plan is there; none if there is none, or one that cannot be, which is refused.
    fn path(
        &mut self,
        context: &mut WaitContext,
        slot: u64,
        area: &Area,
    ) -> Result<Option<Sample<S, [PathPoint], SlotHeader>>, ViewerError> {
        let may_be_late = slot > 0 && self.paths_read < PATHS_BEFORE && self.pace == Pace::Max;
        self.paths_read = self.paths_read.saturating_add(1);
        let limit = if may_be_late && self.paths.has_writer() { LEFT_OVERS } else { Duration::ZERO };
        let path = read(&mut self.paths, context, slot, Wait::AtMost(limit))?;
        let is_good = path.as_ref().is_none_or(|path| believable(path.payload(), area));
        if !is_good {
            self.paths.refuse(slot, Refusal::Path);
        }
        Ok(path.filter(|_| is_good))
    }

    /// Adds what has become of the processes to the event log.
    fn log_health(&mut self, scene: &Scene) -> Result<(), ViewerError> {
        while let Some(sample) = self.health.receive()? {
            if let Some((role, fate)) = sample.payload().read() {
                let level = if fate.good() { Level::Info } else { Level::Warn };
                scene.log_event(sample.user_header().slot, level, &format!("{} {fate}", role.name()))?;
            }
        }
        Ok(())
    }
}

/// The sample of a slot; none if it was missed. A writer that waits for this reader's buffer may reach it later than the
/// queues do.
fn read<S: Service + 'static, P: IceoryxSend + Debug + ?Sized + 'static>(
    reader: &mut Reader<S, P, SlotHeader>,
    context: &mut WaitContext,
    slot: u64,
    wait: Wait,
) -> Result<Option<Sample<S, P, SlotHeader>>, ViewerError>
where
    Subscriber<S, P, SlotHeader>: Receive<S, P, SlotHeader>,
{
    let Wait::AtMost(limit) = wait else { return reader.wait_or_pass(context, slot, idle) };
    let deadline = Instant::now() + limit;
    loop {
        match reader.look_for(slot)? {
            Found::Here(sample) => return Ok(Some(sample)),
            Found::NotYet if Instant::now() < deadline => context.sleep_until(Instant::now() + POLL, idle)?,
            Found::NotYet | Found::Passed => return Ok(None),
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
