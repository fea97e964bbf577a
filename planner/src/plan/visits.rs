//! Repeated visits: who is visited when, and from where, without a mission around it.

use std::ops::ControlFlow;

use skysink_common::geometry::Position;

use super::carried_plan::CarriedPlan;
use super::gaps::Gaps;
use super::in_passing::InPassing;
use super::keys::HorizonKeys;
use super::loss::Loss;
use super::objective::Objective;
use super::planned::planned_slot;
use crate::strategy::{Setup, View};

/// A visit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimedVisit {
    /// At the end of this slot; the first is 1.
    pub slot: u64,
    /// Whom.
    pub sensor: u32,
    /// From here [m].
    pub at: Position,
}

/// The visits of a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct VisitPlan {
    /// By slot, then by sensor.
    pub visits: Vec<TimedVisit>,
    /// What they cost, in the unit of the objective.
    pub cost: f64,
    /// No plan costs less.
    pub bound: f64,
}

/// The plan of least cost that `steps` steps find for the mission of `setup`, with the queues `queues_bits` [bit], by
/// id, before slot 1; `None` if nothing can be lost, or the setup's stop ends the search.
///
/// # Panics
/// If the most data is to be collected: such plans hover.
#[must_use]
pub fn plan_visits(setup: &Setup, queues_bits: &[u32], steps: u64) -> Option<VisitPlan> {
    let objective = setup.settings.objective;
    assert!(!objective.is_collect(), "expected costs of gaps");
    if objective.is_loss() {
        visits_of::<Loss>(setup, queues_bits, steps)
    } else {
        visits_of::<Gaps>(setup, queues_bits, steps)
    }
}

fn visits_of<O: Objective<Style = InPassing>>(setup: &Setup, queues_bits: &[u32], steps: u64) -> Option<VisitPlan> {
    let Setup { scenario, stop, .. } = *setup;
    let keys = HorizonKeys { window: Some(scenario.slots), ..HorizonKeys::of(0) };
    let mut plan = CarriedPlan::<O>::new(setup, keys);
    let view = View::at_start(setup, queues_bits, stop);
    let mut forecast = plan.forecast(&view)?;
    let watch = &mut |_| if stop.requested().is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
    plan.prepare(&view, &mut forecast, steps, watch)?;
    let mut visits = Vec::new();
    let mut at = view.ground();
    for slot in 1..=forecast.window.slots {
        let Some(planned) = planned_slot(&plan.model, &forecast, slot, &at) else { break };
        at = planned.waypoint;
        visits.extend(planned.ids.iter().map(|&sensor| TimedVisit { slot: slot as u64, sensor, at }));
    }
    Some(VisitPlan { visits, cost: forecast.cost, bound: forecast.window.least(&plan.model) })
}
