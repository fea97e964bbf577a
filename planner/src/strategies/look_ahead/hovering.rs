//! The look-ahead for plans that hover. A first one may begin with the plan of least loss.

use std::ops::ControlFlow;

use skysink_common::geometry::Position;

use super::{Flown, LookAhead, PlannedNext};
use crate::plan::carried_plan::CarriedPlan;
use crate::plan::forecast::Forecast;
use crate::plan::hovering::Hovering;
use crate::plan::keys::HorizonKeys;
use crate::plan::long_search::{SearchOutcome, SearchProgress, Watch};
use crate::plan::loss::Loss;
use crate::plan::objective::Objective;
use crate::plan::planned::PlannedSlot;
use crate::strategy::{Setup, View};

/// Steps of the first search, divided by those of each later one.
const FIRST_SEARCH: u64 = 30;

/// Steps of the search for the least loss that take as long as one for the most data delivered.
const LOSS_STEPS_PER_STEP: u64 = 20;

impl<O: Objective<Style = Self>> Flown<O> for Hovering {
    const IS_OPEN_LOOP: bool = false;

    fn first_steps(keys: &HorizonKeys, offline_steps: Option<u64>) -> u64 {
        let later_steps = u64::from(keys.iterations) * FIRST_SEARCH;
        offline_steps.map_or(later_steps, |steps| steps.div_ceil(LOSS_STEPS_PER_STEP))
    }

    /// None where no SN samples.
    fn least_loss(setup: &Setup, keys: HorizonKeys) -> Option<CarriedPlan<Loss>> {
        let is_sampling = setup.belief.has_learnt_rates() || setup.table.sensors.sampling_ids().next().is_some();
        is_sampling.then(|| CarriedPlan::new(setup, keys))
    }

    /// A UAV under way flies on until the next move may begin; one that charged in the base goes on charging.
    fn under_way(view: &View) -> Option<PlannedNext> {
        let end = view.table.motion.under_way(view.slot, &view.ground())?;
        let is_charging = view.battery.is_charging && end == view.ground();
        Some(if is_charging { PlannedNext::Charge } else { PlannedNext::ServeMost(end) })
    }

    fn prepare(look_ahead: &mut LookAhead<O>, view: &View, watch: &mut Watch<'_>) -> Option<SearchOutcome> {
        let mut forecast = look_ahead.ahead.forecast(view)?;
        watch(SearchProgress { steps: 0, cost: forecast.cost }).continue_value()?;
        let is_over = || view.stop.requested().is_some();
        Self::begin(look_ahead, view, &mut forecast, &is_over, &is_over);
        let steps = look_ahead.first_steps;
        look_ahead.ahead.search(view, &mut forecast, steps, &is_over);
        look_ahead.ahead.keep(&forecast);
        let steps = steps.saturating_mul(LOSS_STEPS_PER_STEP);
        let outcome = SearchOutcome { cost: forecast.cost, steps, is_optimal: false };
        watch(SearchProgress { steps: outcome.steps, cost: outcome.cost }).continue_value()?;
        Some(outcome)
    }

    /// Loads a first plan, which may begin with that for the least loss, searched for until `is_late`.
    fn begin(
        look_ahead: &mut LookAhead<O>,
        view: &View,
        forecast: &mut Forecast<O>,
        is_late: &dyn Fn() -> bool,
        is_over: &dyn Fn() -> bool,
    ) {
        if look_ahead.ahead.has_searched() {
            return;
        }
        let steps = look_ahead.first_steps.saturating_mul(LOSS_STEPS_PER_STEP);
        let loss = look_ahead.loss.take();
        let offered = loss.map_or_else(Vec::new, |loss| of_least_loss(loss, view, steps, is_late));
        look_ahead.ahead.begin_at_points(view, forecast, &offered, is_over);
    }

    /// The way home after the last stop.
    fn next(view: &View, planned: Option<PlannedSlot>) -> PlannedNext {
        let Some(planned) = planned else { return home(view) };
        if planned.is_charging {
            return PlannedNext::Charge;
        }
        let ground = view.ground();
        let is_free = view.table.airspace.is_free(&ground, &planned.waypoint);
        let toward = || view.table.motion.toward(&ground, &planned.waypoint);
        PlannedNext::ServeMost(if is_free { toward() } else { planned.waypoint })
    }
}

/// The way home, or the stay there to charge.
fn home(view: &View) -> PlannedNext {
    let ground = view.ground();
    let home = &view.table.home;
    if home.is_charger(&ground) {
        return PlannedNext::Stay;
    }
    PlannedNext::ServeMost(home.next_waypoint(view.slot, &ground))
}

/// The points of a plan for the least loss, improved in `steps` steps, each with the id of an SN; one for each member
/// of a group.
fn of_least_loss(
    mut loss: CarriedPlan<Loss>,
    view: &View,
    steps: u64,
    is_over: &dyn Fn() -> bool,
) -> Vec<(Position, u32)> {
    let Some(mut forecast) = loss.forecast(view) else { return Vec::new() };
    let watch = &mut |_| if is_over() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
    let begun = forecast.stops();
    if loss.prepare(view, &mut forecast, steps, watch).is_none() {
        forecast.load(&loss.model, begun); // ended early, its plan may be worse
    }
    let model = &loss.model;
    let members = |disk: u32| model.disks[disk as usize].members.iter().map(|&member| model.ids[member as usize]);
    forecast.trace.legs.iter().flat_map(|leg| members(leg.stop.disk).map(|id| (leg.at, id))).collect()
}
