//! viewer as a process of the ring: reads every topic, writes none, and shows each slot in the scene.

use std::collections::VecDeque;
use std::fmt::Debug;
use std::time::{Duration, Instant};

use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{IceoryxSend, Service, ZeroCopySend};
use iceoryx2::sample::Sample;
use skysink_common::message::{FLAG_END, FLAG_TICK, HoldReason, QueuesHeader, SlotHeader};
use skysink_common::pace::Pace;
use skysink_common::path::{PathPoint, believable};
use skysink_common::scenario::{Area, Scenario};
use skysink_common::stop::Stop;
use skysink_ring::error::{NodeError, RingError};
use skysink_ring::folder::RingFolder;
use skysink_ring::health::Health;
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

/// Records until the mission ends, and returns how many slots it missed: none in lock-step. However it ends, the
/// recording holds what it got.
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
    let mut patience = ring.wait_context(folder, Some(seat), stop)?;
    let mut sensors = ring.sensors.reader(RING_BUFFER)?;
    let nodes = sensors.wait_for(&mut patience, 0, |_| true, idle)?;
    let mut scene =
        Scene::open(sinks, scenario, nodes.payload(), &run_name(scenario, ring.terms.mission), Timing::Measured)?;
    let followed = follow(&ring, &mut patience, &mut scene, &scenario.area);
    let closed = scene.close();
    let missed = followed?;
    closed?;
    Ok(missed)
}

/// This process serves nobody while it waits.
fn idle() -> Result<(), ViewerError> {
    Ok(())
}

/// Shows every slot that arrives; returns how many did not.
fn follow<S: Service + 'static>(
    ring: &Ring<S>,
    patience: &mut WaitContext,
    scene: &mut Scene,
    area: &Area,
) -> Result<u64, ViewerError> {
    let mut paths = Paths::open(ring, *area)?; // before the plans: whoever has a plan then has its path
    let (mut plans, mut flights) = (ring.plan.reader(VIEWER_BUFFER)?, ring.flight.reader(VIEWER_BUFFER)?);
    let (mut queues, mut health) = (ring.queues.reader(VIEWER_BUFFER)?, ring.health.reader(VIEWER_BUFFER)?);
    let is_state = |header: &QueuesHeader| header.head.flags & FLAG_TICK == 0;

    let (mut missed, mut ready, mut speed) = (0, false, Speed::default());
    let mut next = scene.continued_after().map_or(0, |slot| slot + 1);
    loop {
        let sample = queues.wait_for(patience, next, is_state, idle)?;
        let (header, slot) = (sample.user_header(), sample.user_header().head.slot);
        let end = header.head.flags & FLAG_END != 0;
        log_health(&mut health, scene)?;
        // Of a slot that was over before this process was there some may be gone; in paced runs also of others.
        let slack = (end && !ready).then_some(LEFT_OVERS);
        let pace = if slot == 0 { Pace::Max } else { ring.terms.pace }; // the clock does not run before all are here
        let flight = wait_for_part(&mut flights, patience, pace, slot, slack)?;
        let plan = if slot > 0 { wait_for_part(&mut plans, patience, pace, slot, slack)? } else { None };
        if let Some(flight) = flight.filter(|_| slot >= next) {
            if slot > next {
                scene.log_missed(next..=slot - 1)?;
                missed += slot - next;
            }
            next = slot + 1;
            let in_time = HoldReason::of_code(flight.payload().hold) != HoldReason::NoPlan;
            let plan = plan.as_ref().map(|plan| plan.payload()).filter(|_| in_time);
            let path = paths.of(slot, patience)?.filter(|_| plan.is_some());
            scene.log_slot(&SlotView {
                slot,
                queues_bits: sample.payload(),
                header,
                plan,
                path: path.as_ref().map_or(&[], |path| path.payload()),
                flight: flight.payload(),
                slots_per_s: speed.slots_per_s(header),
                plan_ms: plan.map(|plan| plan.plan_ns as f64 / 1e6),
            })?;
        }
        if !ready {
            // Connected to every writer: from here on no slot can be lost on the way.
            if !end && pace == Pace::Max {
                plans.wait_until_there(patience, slot + 1, idle)?;
            }
            ready = true;
            ring.commit.say(VIEWER_READY)?;
        }
        if end {
            if next <= slot {
                scene.log_missed(next..=slot)?;
                missed += slot + 1 - next;
            }
            log_health(&mut health, scene)?;
            return Ok(missed);
        }
    }
}

/// How long it is waited for what may be left of a slot that was sent before this process was there.
const LEFT_OVERS: Duration = Duration::from_millis(500);

/// The part of a slot that another topic holds; none if it was missed. A writer that waits for this reader's buffer may
/// reach it later than the queues do.
fn wait_for_part<S: Service + 'static, P: Debug + Copy + ZeroCopySend + 'static>(
    parts: &mut Reader<S, P, SlotHeader>,
    patience: &mut WaitContext,
    pace: Pace,
    slot: u64,
    slack: Option<Duration>,
) -> Result<Option<Sample<S, P, SlotHeader>>, ViewerError> {
    match (pace, slack) {
        (Pace::Max, None) => parts.wait_or_pass(patience, slot, idle),
        (Pace::Max, Some(slack)) => look_for(parts, patience, slot, slack),
        (Pace::Factor(_), _) => look_for(parts, patience, slot, Duration::ZERO),
    }
}

/// Looks for a message for `long`, and at least once.
fn look_for<S: Service + 'static, P: IceoryxSend + Debug + ?Sized + 'static>(
    parts: &mut Reader<S, P, SlotHeader>,
    patience: &mut WaitContext,
    slot: u64,
    long: Duration,
) -> Result<Option<Sample<S, P, SlotHeader>>, ViewerError>
where
    Subscriber<S, P, SlotHeader>: Receive<S, P, SlotHeader>,
{
    let deadline = Instant::now() + long;
    loop {
        match parts.look_for(slot)? {
            Found::Here(part) => return Ok(Some(part)),
            Found::NotYet if Instant::now() < deadline => patience.sleep_until(Instant::now() + GLANCE, idle)?,
            Found::NotYet | Found::Passed => return Ok(None),
        }
    }
}

/// How often it is looked for what is left.
const GLANCE: Duration = Duration::from_millis(10);

/// The paths of the slots, of planners that send them before their plans.
struct Paths<S: Service + 'static> {
    reader: Reader<S, [PathPoint], SlotHeader>,
    area: Area,
    pace: Pace,
    /// Slots that were looked for.
    looked: u32,
}

/// Slots whose path may have been sent before this process was there. It then comes with the writer's next look at who
/// has joined, which may be after that of the plan.
const BEFORE: u32 = 2;

impl<S: Service + 'static> Paths<S> {
    fn open(ring: &Ring<S>, area: Area) -> Result<Self, RingError> {
        Ok(Self { reader: ring.path.reader(PATH_BUFFER)?, area, pace: ring.terms.pace, looked: 0 })
    }

    /// The path of a slot whose plan is there; none if it has none, or one that cannot be, which is refused.
    fn of(
        &mut self,
        slot: u64,
        patience: &mut WaitContext,
    ) -> Result<Option<Sample<S, [PathPoint], SlotHeader>>, ViewerError> {
        let awaited = slot > 0 && self.looked < BEFORE && self.pace == Pace::Max && self.reader.has_writer();
        self.looked = self.looked.saturating_add(1);
        let long = if awaited { LEFT_OVERS } else { Duration::ZERO };
        let path = look_for(&mut self.reader, patience, slot, long)?;
        let is_good = path.as_ref().is_none_or(|path| believable(path.payload(), &self.area));
        if !is_good {
            self.reader.refuse(slot, Refusal::Path);
        }
        Ok(path.filter(|_| is_good))
    }
}

/// Adds what has become of the processes to the event log.
fn log_health<S: Service + 'static>(
    health: &mut Reader<S, Health, SlotHeader>,
    scene: &Scene,
) -> Result<(), ViewerError> {
    while let Some(sample) = health.receive()? {
        if let Some((role, fate)) = sample.payload().read() {
            let level = if fate.good() { Level::Info } else { Level::Warn };
            scene.log_event(sample.user_header().slot, level, &format!("{} {fate}", role.name()))?;
        }
    }
    Ok(())
}

/// What the recording is called. rerun merges recordings of one name, so that every run has its own.
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
