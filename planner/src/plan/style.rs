//! Styles of plans: what differs between plans that serve in passing and plans that hover.
//!
//! A style is chosen by the objective, at compile time. Model, decoder, forecast and carried plan ask it where styles
//! differ; what only one style has is bound to it, so that the wrong call does not compile:
//!
//! ```
//! use skysink_planner::plan::{forecast::Forecast, model::PlanModel, objective::Loss, start};
//! fn extend(model: &PlanModel, forecast: &mut Forecast<Loss>) {
//!     start::extend(model, forecast);
//! }
//! ```
//!
//! ```compile_fail,E0271
//! use skysink_planner::plan::{forecast::Forecast, model::PlanModel, objective::Collect, start};
//! fn extend(model: &PlanModel, forecast: &mut Forecast<Collect>) {
//!     start::extend(model, forecast); // a plan that hovers has no disks
//! }
//! ```
//!
//! | style | plans |
//! |---|---|
//! | [`in_passing`](super::in_passing) | stop anywhere in a disk, for a slot, and end with the last stop |
//! | [`hovering`](super::hovering) | stop at points, hover there until nothing is left, and end at home |

use std::borrow::Cow;
use std::fmt::Debug;

use skysink_common::geometry::Position;
use skysink_common::scenario::Scenario;
use skysink_common::stop::Stop;

use super::capacities::CapacityTable;
use super::carried_plan::{CarriedPlan, SavedPoint};
use super::decoder::{Buffers, Candidate, Decoder, Trace, Visit};
use super::forecast::{Change, Forecast};
use super::groups::PlannedStop;
use super::model::PlanModel;
use super::objective::Objective;
use super::operators::Operator;
use super::timelines::Rest;
use super::window::PlanningWindow;
use crate::geometry::disks::Disk;
use crate::mission_table::MissionTable;
use crate::route::route::Route;
use crate::route::way_home::WayHome;
use crate::strategy::View;

/// The store of the style of an objective.
pub type StoreOf<O> = <<O as Objective>::Style as Style<O>>::Store;

/// The buffers of a plan, and of a change of it.
pub trait Store<O: Objective>: Buffers<O> + Debug + Clone {
    /// Those of an empty plan over `window`.
    fn new(model: &PlanModel, window: &PlanningWindow<O>) -> Self;

    /// Removes all visits of the plan; returns what it then costs.
    fn clear(&mut self, model: &PlanModel) -> f64;

    /// Begins a change of `plan`, which costs `cost`, before its leg `leg`. Returns the cost to which [`Style::end`]
    /// and the legs from there on are added.
    fn begin(&mut self, model: &PlanModel, plan: &Trace, leg: usize, cost: f64) -> f64;

    /// Replaces the visits between leg `leg`, where the change begins, and `rest` by `visits`.
    fn accept(&mut self, model: &PlanModel, leg: usize, visits: &[Visit], rest: Rest);

    /// Prepares for the search from a loaded plan of `legs` legs, which costs `cost`; returns its cost, with less
    /// rounding.
    fn loaded(&mut self, model: &PlanModel, legs: usize, cost: f64) -> f64;
}

/// What differs between plans that serve in passing and plans that hover.
pub trait Style<O: Objective>: 'static {
    /// The buffers of a plan.
    type Store: Store<O>;

    /// The changes that a search proposes. The first inserts a stop, also into an empty plan.
    const OPERATORS: &'static [Operator];

    // The model.

    /// The scenario that is planned for.
    fn scenario(scenario: &Scenario) -> Cow<'_, Scenario> {
        Cow::Borrowed(scenario)
    }

    /// Whether the sensor node `id`, which can be served, is a sensor of the plan.
    fn includes(mission: &MissionTable, id: u32) -> bool;

    /// What visits carry where it depends on the elevation or on the place; `None` if no table is needed.
    fn capacities_bits(_scenario: &Scenario, _table: &MissionTable) -> Option<Box<CapacityTable>> {
        None
    }

    /// Adds the stops that are known before slot 1 to a model with sensors, with random numbers of `seed`; with groups
    /// if it `may_group`.
    fn add_stops(model: &mut PlanModel, seed: u64, may_group: bool, stop: &Stop);

    // A leg.

    /// The route from `from` into `disk`, as near to `near` as possible; `None` if there is none.
    fn enter(model: &PlanModel, from: &Position, disk: &Disk, near: &Position) -> Option<Route>;

    /// The sensors of `stop` that are served at its end before all others.
    fn served_first(model: &PlanModel, stop: PlannedStop) -> &[u32];

    /// Stays at `stop`, up to slot `last`; returns what that costs.
    fn stay(
        _decoder: &mut Decoder,
        _model: &PlanModel,
        _stop: PlannedStop,
        _last: i32,
        _buffers: &mut impl Buffers<O>,
        _visits: &mut Vec<Visit>,
    ) -> f64 {
        0.0
    }

    /// Energy beyond the way home from `at` [m] and the reserve, with `energy_j` [J] after `slot` [J].
    fn margin_j(model: &PlanModel, home: &WayHome, slot: u64, energy_j: f64, at: &Position) -> f64;

    /// Finds the sensors that can be served from above `at` [m], with `first` before all others.
    fn in_range(model: &PlanModel, first: &[u32], at: &Position, found: &mut Vec<Candidate>);

    /// Whether a service that costs `cost` is a visit of the plan.
    fn is_visit(_cost: f64) -> bool {
        true
    }

    // A change.

    /// The sensors that have, or will have, data, and their queues at the beginning [bit], for the operators.
    fn open(_model: &PlanModel, _window: &PlanningWindow<O>) -> Vec<(u32, f64)> {
        Vec::new()
    }

    /// Whether the leg to stop `old` of the old plan, followed by `next`, is unchanged; `follows` if the leg before
    /// it is.
    #[inline]
    fn is_as_before(
        _forecast: &Forecast<O>,
        _model: &PlanModel,
        _change: &Change,
        _old: u32,
        _next: Option<u32>,
        _follows: bool,
    ) -> bool {
        false
    }

    /// Whether there is nothing to do at `stop`, the next one of `change`.
    fn is_idle(forecast: &Forecast<O>, model: &PlanModel, change: &Change, stop: PlannedStop) -> bool;

    /// The cost of the leg that began after slot `begin`, from what was `flown`; `None` if the plan ends before it.
    fn cost_of_leg(forecast: &Forecast<O>, change: &Change, begin: i32, flown: Option<f64>) -> Option<f64>;

    /// Whether a leg of `slots` slots stays in the plan.
    fn keeps(_store: &Self::Store, _slots: i32) -> bool {
        true
    }

    /// What a change costs after the legs that were flown for it.
    fn end(forecast: &mut Forecast<O>, model: &PlanModel) -> f64;

    /// The visits after the last stop of the plan that was tried last.
    fn tail(_store: &Self::Store) -> &[Visit] {
        &[]
    }

    /// The way [m] from the last stop, at `last` [m], to the end of a plan that begins after `flown_slots` slots.
    fn way_after(_model: &PlanModel, _flown_slots: u64, _last: &Position) -> Vec<Position> {
        Vec::new()
    }

    // The slots of a mission.

    /// How far from its waypoint a slot may end [m].
    fn beside_m(_scenario: &Scenario) -> f64 {
        0.0
    }

    /// Completes the planning window of the slot of `view`.
    fn complete(_plan: &CarriedPlan<O>, _view: &View, _window: &mut PlanningWindow<O>) {}

    /// [`CarriedPlan::forecast`], for an updated model.
    fn forecast(plan: &mut CarriedPlan<O>, view: &View) -> Option<Forecast<O>>;

    /// [`CarriedPlan::has_plan`].
    fn has_plan(plan: &CarriedPlan<O>) -> bool;

    /// [`CarriedPlan::search`].
    fn search(
        plan: &mut CarriedPlan<O>,
        view: &View,
        forecast: &mut Forecast<O>,
        first_steps: u64,
        is_over: &dyn Fn() -> bool,
    );

    /// [`CarriedPlan::carry`].
    fn carry(plan: &mut CarriedPlan<O>, forecast: &Forecast<O>, waypoint: &Position);

    /// The stops of the model that a checkpoint saves: those that do not follow from the mission.
    fn saved_points(_model: &PlanModel) -> Vec<SavedPoint> {
        Vec::new()
    }

    /// The number of stops of the model with these saved points.
    fn count_stops(model: &PlanModel, _points: &[SavedPoint]) -> usize {
        model.disks.len()
    }

    /// Restores the stops of the model from checked points.
    fn restore_points(_model: &mut PlanModel, _points: &[SavedPoint]) {}
}
