//! `horizon` and `offline` with `planner.objective = "collect"`: the plan that delivers most until the mission's end.
//!
//! The plan is left to [`crate::collect`]. Where sensor nodes sample, most is delivered if little is lost, so its
//! search may begin with the plan of [`crate::horizon`].

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use nalgebra::Point3;
use skysink_common::checkpoint::{Checkpoint, CheckpointError};
use skysink_common::geometry::above;
use skysink_common::message::MAX_PATH_POINTS;

use super::serving::Serving;
use crate::collect::Collector;
use crate::collect::flight::{Next, PlannedStop};
use crate::horizon::flight::Leg;
use crate::horizon::{Horizon, HorizonKeys};
use crate::neighbours::PlannedVisit;
use crate::strategy::{Decision, Setup, Strategy, View};

/// Steps of the search for the least loss that take as long as one for the most data delivered.
pub(super) const LOSS_STEPS_PER_STEP: u64 = 20;

/// End of that search, as a fraction of the budget.
const LOSS_END: f64 = 0.3;

/// A plan over the rest of the mission, improved before every decision.
pub(crate) struct Collecting {
    collector: Collector,
    /// The look-ahead for the least loss, until the first plan; `None` where no SN samples.
    horizon: Option<Horizon>,
    serving: Serving,
    keys: HorizonKeys,
    /// Steps of the first search.
    first_steps: u64,
    /// The planned waypoints after the last decided one.
    path: Vec<Point3<f64>>,
}

impl Collecting {
    /// A search of `first_steps` steps before the first slot, and of as many as `keys` say before every other one.
    pub fn new(setup: &Setup, keys: HorizonKeys, first_steps: u64) -> Self {
        let collector = Collector::new(setup, keys.window);
        let is_sampling = setup.belief.has_learnt_rates() || setup.table.sensors.sampling_ids().next().is_some();
        let horizon = is_sampling.then(|| Horizon::new(setup, keys));
        let path = Vec::with_capacity(MAX_PATH_POINTS);
        Self { collector, horizon, serving: Serving::new(setup), keys, first_steps, path }
    }
}

/// The stops of a plan for the least loss, improved in `steps` steps; one for each member of a group.
fn of_least_loss(mut horizon: Horizon, view: &View, steps: u64, is_over: &dyn Fn() -> bool) -> Vec<PlannedStop> {
    let Some(mut forecast) = horizon.forecast(view) else { return Vec::new() };
    let watch = &mut |_| if is_over() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
    let begun = forecast.stops();
    if horizon.prepare(view, &mut forecast, steps, watch).is_none() {
        forecast.load(&horizon.model, begun); // ended early, its plan may be worse
    }
    let model = &horizon.model;
    let stops = |leg: &Leg| {
        let members = model.disks[leg.stop as usize].members.iter();
        members.map(|&member| PlannedStop::new(leg.at, model.ids[member as usize], 0)).collect::<Vec<_>>()
    };
    forecast.trace.legs.iter().flat_map(stops).collect()
}

impl Strategy for Collecting {
    fn plan(&mut self, view: &View<'_>) -> Option<Decision> {
        let ground = view.ground();
        if let Some(end) = view.table.airspace.under_way(view.slot, &ground) {
            // A hover in the base, until the next move may begin, that charged goes on charging.
            let is_charging = view.battery.is_charging && end == ground;
            return Some(if is_charging { Decision::stay(view) } else { self.serving.serve_most(view, &end) });
        }
        let budget = self.keys.budget(view).map(|budget| (Instant::now(), budget));
        let is_after = |fraction: f64| {
            let has_passed = |(begin, budget): (Instant, Duration)| begin.elapsed() >= budget.mul_f64(fraction);
            view.stop.requested().is_some() || budget.is_some_and(has_passed)
        };
        let is_over = || is_after(1.0);
        let steps = if self.collector.is_planned() { u64::from(self.keys.iterations) } else { self.first_steps };
        let horizon = self.horizon.take();
        let offered = || {
            let loss_steps = steps.saturating_mul(LOSS_STEPS_PER_STEP);
            horizon.map_or_else(Vec::new, |horizon| of_least_loss(horizon, view, loss_steps, &|| is_after(LOSS_END)))
        };
        let next = self.collector.plan(view, steps, offered, &is_over);
        let home = view.table.home.as_ref();
        let is_home = home.is_some_and(|home| home.base.contains(&ground));
        let waypoint = match next {
            Next::Charges => return Some(Decision::stay(view)),
            Next::Returns if is_home && home.is_some_and(|home| home.battery.is_some()) => {
                return Some(Decision::stay(view));
            }
            Next::Returns => home.map_or(ground, |home| home.next_waypoint(view.slot, &ground)),
            Next::Flies(end) => end,
        };
        let decision = self.serving.serve_most(view, &waypoint);
        self.path.clear();
        let path = self.collector.path(view, &waypoint, MAX_PATH_POINTS - 1);
        self.path.extend(path.iter().map(|point| above(point, decision.waypoint.z)));
        Some(decision)
    }

    fn path(&self) -> &[Point3<f64>] {
        &self.path
    }

    fn visits(&mut self, view: &View<'_>, into: &mut Vec<PlannedVisit>) {
        self.collector.visits(view, into);
    }
}

impl Checkpoint for Collecting {
    fn save(&self, bytes: &mut Vec<u8>) {
        self.collector.save(bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        self.collector.restore(bytes)
    }
}
