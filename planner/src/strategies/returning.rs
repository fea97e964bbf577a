//! The return rule (decision D13): the decision of a strategy is flown if it leaves the energy and the time for the way
//! home. Otherwise the slot is a part of the way home.

use arrayvec::ArrayVec;
use skysink_common::message::{Mode, SolverOutcome};

use super::serving::Serving;
use super::transit::transit_decision;
use crate::home::Returning;
use crate::strategy::{Decision, Strategy, View};

/// Decides the slot of `view`: by `strategy`, by transit where it has no decision, or by the way home. A decision that
/// stays in the base and serves nobody charges, and the strategy is not asked while the UAV charges.
///
/// Where its waypoint lies behind a zone, or beside the lines of a grid, it is led around (decisions D15 and D17a).
pub fn decide(strategy: &mut dyn Strategy, serving: &mut Serving, view: &View) -> (Decision, Mode) {
    let Some(home) = &view.table.home else { return decide_freely(strategy, serving, view) };
    if home.charges_on(view.slot, &view.battery) {
        return (stay(view), Mode::Charge);
    }
    let (decision, mode) = decide_freely(strategy, serving, view);
    let way = [&view.position, &decision.waypoint];
    match home.rule(view.slot, &view.battery, way, decision.schedule.is_empty()) {
        Returning::Not => (decision, mode),
        Returning::Charges => (stay(view), Mode::Charge),
        Returning::Flies(waypoint) => {
            let mut decision = serving.serve_fullest(view, &waypoint.xy());
            decision.waypoint.z = decision.waypoint.z.min(waypoint.z); // a climb would take energy
            (decision, Mode::Return)
        }
    }
}

/// How far a waypoint may be from the place where a slot ends on a grid, for the same schedule [m].
const BESIDE_M: f64 = 1e-5;

/// The decision of `strategy`, or transit. Where a zone is in its way: to fly around it toward the same waypoint and
/// serve the fullest queues in range (decision D15). On a grid: to fly along its lines (decision D17a).
fn decide_freely(strategy: &mut dyn Strategy, serving: &mut Serving, view: &View) -> (Decision, Mode) {
    let airspace = &view.table.airspace;
    let (mut decision, mode) = match strategy.plan(view) {
        Some(decision) => (decision, Mode::Serve),
        None => (transit_decision(serving, view), Mode::Transit),
    };
    if airspace.is_open() {
        return (decision, mode);
    }
    let told = decision.waypoint.xy();
    let end = airspace.slot_end(view.slot, &view.ground(), &told, view.table.limits.reach_m);
    if (end - told).norm() > if airspace.has_grid() { BESIDE_M } else { 0.0 } {
        return (serving.serve_fullest(view, &end), mode);
    }
    (decision.waypoint.x, decision.waypoint.y) = (end.x, end.y);
    (decision, mode)
}

/// The decision to stay and serve nobody.
pub(crate) fn stay(view: &View) -> Decision {
    Decision { waypoint: view.position, schedule: ArrayVec::new(), outcome: SolverOutcome::Rule, winner: None }
}
