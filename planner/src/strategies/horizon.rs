//! `horizon`: the plan of least predicted loss over many slots, improved in every slot and flown a slot at a time.
//!
//! How it is improved is left to [`crate::horizon`]; here its first slot becomes a decision.

use std::time::Duration;

use nalgebra::Point3;
use serde::{Deserialize, Serialize};
use skysink_common::checkpoint::{Checkpoint, CheckpointError};
use skysink_common::geometry::{Position, above};
use skysink_common::message::{MAX_PATH_POINTS, SolverOutcome};
use skysink_common::scenario::Count;

use super::nearby::fullest_first;
use super::serving::Serving;
use super::{Decision, Registered, Setup, Strategy, View, checked};
use crate::horizon::{Horizon, NextSlot};

/// The strategy in the registry.
pub const STRATEGY: Registered = Registered {
    name: "horizon",
    about: "the plan of least predicted loss over many slots, improved in every slot",
    is_stateless: false,
    has_path: true,
    keys: Some(checked::<HorizonKeys>),
    make: |setup| {
        let keys: HorizonKeys = setup.scenario.planner_keys("planner.horizon").expect("they were checked");
        let iterations = keys.iterations.get() as u32; // at most 10^9
        Box::new(LookAhead::new(setup, MOST_SLOTS, iterations, keys.budget_ms.map(Duration::from)))
    },
};

/// `[planner.horizon]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HorizonKeys {
    /// Search steps in each slot.
    pub iterations: Count<0, 1_000_000_000>,
    /// Longest that a slot's search may take where the mission is paced by a clock; elsewhere it has no effect.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub budget_ms: Option<BudgetMs>,
}

impl Default for HorizonKeys {
    fn default() -> Self {
        Self { iterations: Count::of::<6_000>(), budget_ms: None }
    }
}

/// A time [ms] above 0, at most an hour.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "f64")]
pub struct BudgetMs(f64);

impl TryFrom<f64> for BudgetMs {
    type Error = &'static str;

    fn try_from(budget_ms: f64) -> Result<Self, Self::Error> {
        let is_allowed = budget_ms > 0.0 && budget_ms <= 3.6e6;
        if is_allowed { Ok(Self(budget_ms)) } else { Err("expected milliseconds above 0, at most 3600000") }
    }
}

impl From<BudgetMs> for Duration {
    fn from(budget: BudgetMs) -> Self {
        Self::from_secs_f64(budget.0 / 1e3)
    }
}

/// Most slots that are looked ahead: the whole mission of the UTS letter (arXiv 2103.00753).
const MOST_SLOTS: u64 = 600;

/// A plan over many slots, and how its first slot is flown.
pub(super) struct LookAhead {
    pub horizon: Horizon,
    serving: Serving,
    /// The waypoints after the one decided last.
    path: Vec<Point3<f64>>,
}

impl LookAhead {
    /// As [`Horizon::new`].
    pub fn new(setup: &Setup, most_slots: u64, iterations: u32, budget: Option<Duration>) -> Self {
        let horizon = Horizon::new(setup, most_slots, iterations, budget);
        Self { horizon, serving: Serving::new(setup), path: Vec::with_capacity(MAX_PATH_POINTS) }
    }

    /// The waypoint of a planned slot: where its links limit what it collects, as far toward the best point to serve
    /// from (sP2*) as the next stop stays in reach in time.
    fn between_stops(&mut self, view: &View, next: &NextSlot) -> (Position, SolverOutcome) {
        let above = self.serving.above(view, &next.waypoint, &next.ids);
        let queued_bits: u64 = next.ids.iter().map(|&id| u64::from(view.queues_bits[id as usize])).sum();
        let expected_bits = view.table.expected_bits(&above, &next.ids, view.queues_bits);
        if expected_bits == queued_bits {
            return (next.waypoint, SolverOutcome::Rule);
        }
        let Some(best) = self.serving.waypoint(view, &next.ids) else {
            return (next.waypoint, SolverOutcome::Rule);
        };
        let best_ground = best.point.xy();
        let Some((then, slots)) = next.then else {
            return (best_ground, best.outcome);
        };
        let reach_m = view.table.reach_m * f64::from(slots);
        let fraction = fraction_within(&next.waypoint, &best_ground, &then, reach_m);
        (next.waypoint + (best_ground - next.waypoint) * fraction, best.outcome)
    }
}

impl Strategy for LookAhead {
    /// Improves the plan and decides its first slot; `None` if no SN that can lose data can be reached.
    fn plan(&mut self, view: &View<'_>) -> Option<Decision> {
        self.path.clear();
        let next = self.horizon.step(view)?;
        let (waypoint, outcome) = self.between_stops(view, &next);
        let key = |id: u32| (!next.ids.contains(&id), fullest_first(view.queues_bits[id as usize], id));
        let decision = Decision { outcome, ..self.serving.serve_by(view, &waypoint, key) };
        self.path.extend(next.path.iter().skip(1).map(|point| above(point, decision.waypoint.z)));
        Some(decision)
    }

    fn path(&self) -> &[Point3<f64>] {
        &self.path
    }
}

impl Checkpoint for LookAhead {
    fn save(&self, bytes: &mut Vec<u8>) {
        self.horizon.save(bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        self.horizon.restore(bytes)
    }
}

/// How far from `from` toward `to`, as a fraction of the path, one stays within `radius_m` [m] of `centre`; 0 if `from`
/// is not.
fn fraction_within(from: &Position, to: &Position, centre: &Position, radius_m: f64) -> f64 {
    let path = to - from;
    let away = from - centre;
    let a = path.norm_squared();
    let b = path.dot(&away);
    let c = away.norm_squared() - radius_m * radius_m;
    if c > 0.0 {
        return 0.0;
    }
    // The larger root of a t² + 2 b t + c = 0, c ≤ 0.
    let root = (b * b - a * c).max(0.0).sqrt();
    let fraction = if b > 0.0 { -c / (b + root) } else { (root - b) / a };
    if fraction.is_finite() { fraction.clamp(0.0, 1.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_path_within_a_circle_ends_on_it() {
        let at = Position::new;
        // From 4 m west of the centre of a circle of 10 m eastward: 14 m of 28 m.
        let fraction = fraction_within(&at(46.0, 50.0), &at(74.0, 50.0), &at(50.0, 50.0), 10.0);
        assert!((fraction - 0.5).abs() < 1e-12, "{fraction}");
        let fraction = fraction_within(&at(54.0, 50.0), &at(26.0, 50.0), &at(50.0, 50.0), 10.0);
        assert!((fraction - 0.5).abs() < 1e-12, "{fraction}");
        assert_eq!(fraction_within(&at(46.0, 50.0), &at(48.0, 50.0), &at(50.0, 50.0), 10.0), 1.0, "never leaves it");
        assert_eq!(fraction_within(&at(30.0, 50.0), &at(50.0, 50.0), &at(50.0, 50.0), 10.0), 0.0, "starts outside");
        assert_eq!(fraction_within(&at(46.0, 50.0), &at(46.0, 50.0), &at(50.0, 50.0), 10.0), 0.0, "nowhere to go");
    }
}
