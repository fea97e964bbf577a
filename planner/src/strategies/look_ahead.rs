//! `horizon`: receding-horizon planning. Each slot it improves a plan for the rest of the mission and flies the first
//! slot of the plan. `offline`: open-loop planning. One search before take-off plans the whole mission; the plan is
//! flown without changes.
//!
//! The search, by simulated annealing against a forecast of the objective, is left to [`crate::plan`].

mod hovering;
mod in_passing;

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use nalgebra::Point3;
use serde::{Deserialize, Serialize};
use skysink_common::belief::Belief;
use skysink_common::channel::ChannelModel;
use skysink_common::checkpoint::{Checkpoint, CheckpointError};
use skysink_common::geometry::{Position, above};
use skysink_common::interpolation::interpolate;
use skysink_common::keys::Accepts;
use skysink_common::message::{FlightReport, MAX_PATH_POINTS, SolverOutcome};
use skysink_common::stop::Stop;

use crate::neighbours::PlannedVisit;
use crate::operator_counts::OperatorCounts;
use crate::plan::carried_plan::{CarriedPlan, PlanStyle};
use crate::plan::collect::Collect;
use crate::plan::forecast::Forecast;
use crate::plan::gaps::Gaps;
use crate::plan::keys::HorizonKeys;
use crate::plan::long_search::{SearchOutcome, Watch};
use crate::plan::loss::Loss;
use crate::plan::objective::Objective;
use crate::plan::planned::{PathStyle, PlannedSlot, planned_path, planned_slot};
use crate::serving::Serving;
use crate::strategy::{Decision, Registered, Setup, Strategy, View};

/// A longer search before take-off makes such a plan, which is flown without changes.
pub const OFFLINE: Registered =
    Registered::new("offline", "open loop: one plan for the whole mission, made before take-off", |setup| {
        offline(setup)
    })
    .with_state()
    .with_path()
    .with_keys::<OfflineKeys>();

/// Most search steps before the mission; they take four months.
pub const MAX_STEPS: u64 = 1_000_000_000_000;

skysink_common::keys! {
    /// `[planner.offline]`.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct OfflineKeys {
        /// Search steps before slot 1; a million take some ten seconds for 200 SNs. Those beyond five million are spent
        /// on further searches from the same first plan; the best plan is flown.
        steps: u64 = 1000000, Accepts::Whole(0, MAX_STEPS);
    }
}

/// Longest planning window before take-off [slots].
const MOST_SLOTS: u64 = 10_000;

/// End of the search for a first plan, as a fraction of the budget.
const LOSS_END: f64 = 0.3;

/// End of the search, as a fraction of the budget; the rest is for the decision.
const SEARCH_END: f64 = 0.9;

/// A strategy that may search before take-off.
trait Prepare: Strategy {
    /// Runs the search before take-off. `watch` is called with the progress. `None`, without a plan, if no SN can lose
    /// data or `watch` ends the search.
    fn prepare(&mut self, view: &View, watch: &mut Watch<'_>) -> Option<SearchOutcome>;
}

/// The look-ahead for the scenario's objective; with `offline_steps` in so many steps before take-off.
fn look_ahead(setup: &Setup, keys: HorizonKeys, offline_steps: Option<u64>) -> Box<dyn Prepare> {
    let objective = setup.settings.objective;
    match () {
        () if objective.is_collect() => Box::new(LookAhead::<Collect>::new(setup, keys, offline_steps)),
        () if objective.is_loss() => Box::new(LookAhead::<Loss>::new(setup, keys, offline_steps)),
        () => Box::new(LookAhead::<Gaps>::new(setup, keys, offline_steps)),
    }
}

/// The look-ahead that improves its plan in every slot.
pub(crate) fn horizon(setup: &Setup, keys: HorizonKeys) -> Box<dyn Strategy> {
    look_ahead(setup, keys, None)
}

/// The look-ahead that searches before take-off only.
fn offline(setup: &Setup) -> Box<dyn Prepare> {
    let OfflineKeys { steps } = setup.scenario.planner_keys("planner.offline").expect("they were checked");
    look_ahead(setup, HorizonKeys { window: Some(MOST_SLOTS), ..HorizonKeys::of(0) }, Some(steps))
}

/// What a slot of a plan asks for.
#[derive(Debug, Clone, PartialEq)]
pub enum PlannedNext {
    /// No decision: nothing is left to do.
    Nothing,
    /// To stay, and serve nobody.
    Stay,
    /// To stay and charge: no path is shown.
    Charge,
    /// To fly to this waypoint [m], and serve the SNs that upload most.
    ServeMost(Position),
    /// To serve the SNs of the planned slot first.
    ServePlanned(PlannedSlot),
}

/// How plans of a style are begun and flown.
pub trait Flown<O: Objective<Style = Self>>: PlanStyle<O> + PathStyle {
    /// Whether `offline` flies its plan without changes; otherwise it has a longer first search.
    const IS_OPEN_LOOP: bool;

    /// Steps of the first search, `offline_steps` of them before take-off.
    fn first_steps(keys: &HorizonKeys, offline_steps: Option<u64>) -> u64;

    /// The look-ahead for the least loss, with which a first plan may begin.
    fn least_loss(_setup: &Setup, _keys: HorizonKeys) -> Option<CarriedPlan<Loss>> {
        None
    }

    /// What the slot of `view` asks for if it cannot be planned.
    fn under_way(_view: &View) -> Option<PlannedNext> {
        None
    }

    /// Searches before take-off. `watch` is called with the progress. `None`, without a plan, if no SN can lose data or
    /// `watch` ends the search.
    fn prepare(look_ahead: &mut LookAhead<O>, view: &View, watch: &mut Watch<'_>) -> Option<SearchOutcome>;

    /// Begins the first plan, if the style has to; until `is_over`, and with other plans until `is_late`.
    fn begin(
        _look_ahead: &mut LookAhead<O>,
        _view: &View,
        _forecast: &mut Forecast<O>,
        _is_late: &dyn Fn() -> bool,
        _is_over: &dyn Fn() -> bool,
    ) {
    }

    /// What the slot of `view` asks for, `planned`, or after the last stop.
    fn next(view: &View, planned: Option<PlannedSlot>) -> PlannedNext;
}

/// A plan over many slots.
pub struct LookAhead<O: Objective> {
    ahead: CarriedPlan<O>,
    /// Whether its plan is searched for before slot 1 alone, and flown without changes.
    is_offline: bool,
    /// Steps of the first search, if it differs from later ones.
    first_steps: u64,
    /// The look-ahead for the least loss, until the first plan has begun.
    loss: Option<CarriedPlan<Loss>>,
    serving: Serving,
    /// The planned waypoints after the last decided one.
    path: Vec<Point3<f64>>,
    /// For other UAVs: the last slot that was planned, and the visits of its plan.
    intents: (u64, Vec<PlannedVisit>),
}

impl<O: Objective<Style: Flown<O>>> LookAhead<O> {
    /// As [`CarriedPlan::new`].
    fn new(setup: &Setup, keys: HorizonKeys, offline_steps: Option<u64>) -> Self {
        Self {
            ahead: CarriedPlan::new(setup, keys),
            is_offline: offline_steps.is_some() && O::Style::IS_OPEN_LOOP,
            first_steps: O::Style::first_steps(&keys, offline_steps),
            loss: O::Style::least_loss(setup, keys),
            serving: Serving::new(setup),
            path: Vec::with_capacity(MAX_PATH_POINTS),
            intents: (0, Vec::new()),
        }
    }

    /// Flies the slot of `view` by the plan of `forecast`, and carries the rest.
    fn fly(&mut self, view: &View, forecast: &Forecast<O>) -> Option<Decision> {
        self.path.clear();
        if view.intents().is_some() {
            self.intents = (view.slot, self.ahead.visits(view, forecast));
        }
        let planned = planned_slot(&self.ahead.model, forecast, 1, &view.ground());
        let path = planned_path(&self.ahead.model, forecast);
        self.ahead.carry(forecast, &planned.as_ref().map_or(view.ground(), |planned| planned.waypoint));
        let next = O::Style::next(view, planned);
        let has_path = next != PlannedNext::Charge;
        let decision = self.decide(view, next)?;
        if has_path {
            self.path.extend(path.iter().map(|point| above(point, decision.waypoint.z)));
        }
        Some(decision)
    }

    /// The decision for what the slot of `view` asks for.
    fn decide(&mut self, view: &View, next: PlannedNext) -> Option<Decision> {
        Some(match next {
            PlannedNext::Nothing => return None,
            PlannedNext::Stay | PlannedNext::Charge => Decision::stay(view),
            PlannedNext::ServeMost(waypoint) => self.serving.serve_most(view, &waypoint),
            PlannedNext::ServePlanned(planned) => {
                let (waypoint, outcome) = between_stops(&mut self.serving, view, &planned);
                let decision = self.serving.serve_first(view, &waypoint, |id| planned.ids.contains(&id));
                Decision { outcome, ..decision }
            }
        })
    }
}

impl<O: Objective<Style: Flown<O>>> Prepare for LookAhead<O> {
    fn prepare(&mut self, view: &View, watch: &mut Watch<'_>) -> Option<SearchOutcome> {
        O::Style::prepare(self, view, watch)
    }
}

impl<O: Objective<Style: Flown<O>>> Strategy for LookAhead<O> {
    /// Improves the plan, and decides by it; `None` if no SN that can lose data is in reach.
    fn plan(&mut self, view: &View<'_>) -> Option<Decision> {
        if let Some(next) = O::Style::under_way(view) {
            return self.decide(view, next);
        }
        let budget = self.ahead.keys.budget(view).map(|budget| (Instant::now(), budget));
        let is_after = |fraction: f64| {
            let has_passed = |(begin, budget): (Instant, Duration)| begin.elapsed() >= budget.mul_f64(fraction);
            view.stop.requested().is_some() || budget.is_some_and(has_passed)
        };
        let is_over = || is_after(SEARCH_END);
        let watch = &mut |_| if is_over() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
        if self.is_offline && !self.ahead.has_searched() {
            self.prepare(view, watch)?;
        }
        let mut forecast = self.ahead.forecast(view)?;
        O::Style::begin(self, view, &mut forecast, &|| is_after(LOSS_END), &is_over);
        self.ahead.search(view, &mut forecast, self.first_steps, &is_over);
        self.fly(view, &forecast)
    }

    fn observe(&mut self, slot: u64, flights: &[FlightReport], _: &Belief) {
        self.ahead.observe(slot, flights);
    }

    fn path(&self) -> &[Point3<f64>] {
        &self.path
    }

    /// The visits of the carried plan, or of the one that was made for the slot of `view`.
    fn visits(&mut self, view: &View<'_>, into: &mut Vec<PlannedVisit>) {
        if self.intents.0 == view.slot {
            into.extend_from_slice(&self.intents.1);
        } else if self.ahead.has_plan()
            && let Some(forecast) = self.ahead.forecast(view)
        {
            into.extend(self.ahead.visits(view, &forecast));
        }
    }

    fn counts(&self) -> Vec<(&'static str, OperatorCounts)> {
        self.ahead.counts().map(|(name, counts)| (name, *counts)).collect()
    }
}

impl<O: Objective<Style: Flown<O>>> Checkpoint for LookAhead<O> {
    fn save(&self, bytes: &mut Vec<u8>) {
        self.ahead.save(bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        self.ahead.restore(bytes)?;
        self.intents = (0, Vec::new());
        Ok(())
    }
}

/// The plan of `offline` for a mission whose queues are known, `queues_bits` [bit] by id before slot 1; returns the
/// strategy and what was found.
///
/// `watch` is called with the progress. `None`, without a plan, if no sensor node can lose data or `watch` ends the
/// search.
pub fn search_offline(
    setup: &Setup,
    queues_bits: &[u32],
    stop: &Stop,
    watch: &mut Watch<'_>,
) -> Option<(Box<dyn Strategy>, SearchOutcome)> {
    let mut strategy = offline(setup);
    let found = strategy.prepare(&View::at_start(setup, queues_bits, stop), watch)?;
    Some((strategy, found))
}

/// The waypoint of a planned slot. If links limit the collected bits, or depend on the elevation, it is moved
/// toward the solution of sP2*, as far as the next stop stays in reach.
fn between_stops(serving: &mut Serving, view: &View, next: &PlannedSlot) -> (Position, SolverOutcome) {
    let above = serving.above(view, &next.waypoint, &next.ids);
    let queued_bits: u64 = next.ids.iter().map(|&id| u64::from(view.belief.queues_bits[id as usize])).sum();
    let expected_bits = view.table.expected_bits(&above, &next.ids, view.belief.queues_bits);
    if expected_bits == queued_bits && !view.table.channel.depends_on_elevation() {
        return (next.waypoint, SolverOutcome::Rule);
    }
    let Some(best) = serving.waypoint(view, &next.ids) else {
        return (next.waypoint, SolverOutcome::Rule);
    };
    let best_ground = best.point.xy();
    let Some((next_stop, slots)) = next.next_stop else {
        return (best_ground, best.outcome);
    };
    let reach_m = view.table.limits.reach_m * f64::from(slots);
    let fraction = fraction_within(&next.waypoint, &best_ground, &next_stop, reach_m);
    let moved = interpolate(next.waypoint, best_ground, fraction);
    // Behind a zone it would not be flown.
    if view.table.airspace.is_free(&view.ground(), &moved) {
        (moved, best.outcome)
    } else {
        (next.waypoint, SolverOutcome::Rule)
    }
}

/// The largest fraction of the path from `from` to `to` that stays within `radius_m` [m] of `centre`; 0 if `from` does
/// not.
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
    fn a_path_clipped_to_a_circle_ends_on_it() {
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
