//! viewer as a process of the ring: reads every topic, writes none, and shows each slot in the scene.

use std::collections::VecDeque;

use iceoryx2::prelude::Service;
use skysink_common::message::{FLAG_END, FLAG_TICK, HoldReason, QueuesHeader};
use skysink_common::node::{NodeError, Patience, Role, Stop};
use skysink_common::pace::Pace;
use skysink_common::ring::{Ring, RingError, VIEWER_READY};
use skysink_common::ring_folder::RingFolder;
use skysink_common::scenario::Scenario;
use skysink_common::topic::{RING_BUFFER, VIEWER_BUFFER};

use crate::{Scene, SceneError, Sinks, SlotView, Timing};

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
    let ring = Ring::<S>::open(folder, scenario, Role::Viewer)?;
    let mut patience = ring.patience(folder, stop)?;
    let mut sensors = ring.sensors.reader(RING_BUFFER)?;
    let nodes = sensors.wait_for(&mut patience, 0, |_| true, idle)?;
    let mut scene =
        Scene::open(sinks, scenario, nodes.payload(), &run_name(scenario, ring.terms.mission), Timing::Measured)?;
    let followed = follow(&ring, &mut patience, &mut scene);
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
    patience: &mut Patience,
    scene: &mut Scene,
) -> Result<u64, ViewerError> {
    let (mut plans, mut flights) = (ring.plan.reader(VIEWER_BUFFER)?, ring.flight.reader(VIEWER_BUFFER)?);
    let mut queues = ring.queues.reader(VIEWER_BUFFER)?;
    let is_state = |header: &QueuesHeader| header.head.flags & FLAG_TICK == 0;

    // Connected to every writer: from here on no slot can be lost on the way.
    plans.wait_until_there(patience, 1, idle)?;
    flights.wait_until_there(patience, 0, idle)?;
    let mut first = Some(queues.wait_for(patience, 0, is_state, idle)?);
    ring.commit.say(VIEWER_READY)?;

    let (mut next, mut missed, mut speed) = (0, 0, Speed::default());
    loop {
        let sample = match first.take() {
            Some(sample) => sample,
            None => queues.wait_for(patience, next, is_state, idle)?,
        };
        let (header, slot) = (sample.user_header(), sample.user_header().head.slot);
        let (flight, plan) = match ring.terms.pace {
            // A writer that waits for this reader's buffer may reach it later than the queues do.
            Pace::Max => {
                let flight = flights.wait(patience, slot, idle)?;
                let plan = if slot > 0 { Some(plans.wait(patience, slot, idle)?) } else { None };
                (flight, plan)
            }
            Pace::Factor(_) => match flights.take(slot)? {
                Some(flight) => (flight, plans.take(slot)?),
                None => continue, // shown as missed with the next slot that is whole
            },
        };
        if slot > next {
            scene.log_missed(next..=slot - 1)?;
            missed += slot - next;
        }
        next = slot + 1;
        let in_time = HoldReason::of_code(flight.payload().hold) != HoldReason::NoPlan;
        let plan = plan.as_ref().map(|plan| plan.payload()).filter(|_| in_time);
        scene.log_slot(&SlotView {
            slot,
            queues_bits: sample.payload(),
            header,
            plan,
            flight: flight.payload(),
            slots_per_s: speed.slots_per_s(header),
            plan_ms: plan.map(|plan| plan.plan_ns as f64 / 1e6),
        })?;
        if header.head.flags & FLAG_END != 0 {
            return Ok(missed);
        }
    }
}

/// What the recording is called. rerun merges recordings of one name, so that every run has its own.
fn run_name(scenario: &Scenario, mission: u64) -> String {
    let strategy = scenario.planner.strategy.name();
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
