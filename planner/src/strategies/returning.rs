//! The return rule (decision D13): the decision of a strategy is flown if it leaves the energy and the time for the way
//! home. Otherwise the slot is a part of the way home.

use arrayvec::ArrayVec;
use skysink_common::battery::BatteryState;
use skysink_common::message::{Mode, SolverOutcome};

use super::serving::Serving;
use super::transit::transit_decision;
use crate::home::Home;
use crate::strategy::{Decision, Strategy, View};

/// Decides the slot of `view`: by `strategy`, by transit where it has no decision, or by the way home. One that stays in the
/// base and serves nobody charges, and the strategy is not asked while the UAV charges.
pub(crate) fn decide(strategy: &mut dyn Strategy, serving: &mut Serving, view: &View) -> (Decision, Mode) {
    let Some(home) = &view.table.home else { return decide_freely(strategy, serving, view) };
    if home.charges_on(view.slot, &view.battery) {
        return (stay(view), Mode::Charge);
    }
    let (decision, mode) = decide_freely(strategy, serving, view);
    let is_stay = decision.schedule.is_empty() && decision.waypoint == view.position;
    if is_stay && home.may_charge(&view.battery, &view.ground()) {
        return (decision, Mode::Charge);
    }
    if comes_home(home, view, &decision) { (decision, mode) } else { return_home(home, view, serving) }
}

/// The battery after a decided slot.
pub(crate) fn battery_after(view: &View, decision: &Decision, mode: Mode) -> BatteryState {
    let is_charging = mode == Mode::Charge;
    let energy_j = match view.table.home.and_then(|home| home.battery) {
        None => view.battery.energy_j,
        Some(battery) if is_charging => battery.charged_j(view.battery.energy_j),
        Some(battery) => battery.flown_j(view.battery.energy_j, &view.position, &decision.waypoint),
    };
    BatteryState { energy_j, is_charging }
}

/// The decision of `strategy`, or transit.
fn decide_freely(strategy: &mut dyn Strategy, serving: &mut Serving, view: &View) -> (Decision, Mode) {
    match strategy.plan(view) {
        Some(decision) => (decision, Mode::Serve),
        None => (transit_decision(serving, view), Mode::Transit),
    }
}

/// Whether the UAV comes home after `decision`.
fn comes_home(home: &Home, view: &View, decision: &Decision) -> bool {
    let energy_j = battery_after(view, decision, Mode::Serve).energy_j;
    home.is_in_reach(view.slot, energy_j, &decision.waypoint.xy())
}

/// A slot of the way home, which serves the fullest queues. In the base the UAV charges, or hovers if only the time
/// keeps it there.
fn return_home(home: &Home, view: &View, serving: &mut Serving) -> (Decision, Mode) {
    let mut decision = serving.serve_fullest(view, &home.next_waypoint(view.slot, &view.ground()));
    decision.waypoint.z = decision.waypoint.z.min(view.position.z); // a climb would take energy
    if home.base.contains(&view.ground()) && !comes_home(home, view, &decision) {
        return (stay(view), Mode::Charge);
    }
    (decision, Mode::Return)
}

/// The decision to stay and serve nobody.
pub(crate) fn stay(view: &View) -> Decision {
    Decision { waypoint: view.position, schedule: ArrayVec::new(), outcome: SolverOutcome::Rule, winner: None }
}
