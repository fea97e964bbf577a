//! The look-ahead: the plan of least predicted cost over many slots, carried from slot to slot and improved in each.

use std::marker::PhantomData;
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode, encode};
use skysink_common::estimate::Uncertainty;
use skysink_common::geometry::{Position, within};
use skysink_common::message::FlightReport;
use skysink_common::nodes::Answer;
use skysink_common::random::Streams;
use skysink_common::sampling::Sampler;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::Sensors;

use super::anneal::SearchStyle;
use super::forecast::Forecast;
use super::groups::PlannedStop;
use super::keys::{HorizonKeys, LookAheadPart};
use super::model::PlanModel;
use super::objective::Objective;
use super::sensor::noise_slots2;
use super::window::PlanningWindow;
use crate::gap_costs::GapCosts;
use crate::neighbours::PlannedVisit;
use crate::operator_counts::OperatorCounts;
use crate::strategy::{Setup, View};

/// Lower limit on the estimated bits per slot of an SN: one that does not sample cannot be distinguished from one that
/// rarely does.
const LEAST_MEAN_BITS: f64 = 1e-3;

/// Temperature of the first search.
const FIRST_TEMPERATURE: f64 = 0.05;

/// Longest planning window [slots] unless the scenario has another: four times the mission of the UTS letter.
const MOST_SLOTS: u64 = 2_400;

/// The look-ahead of a mission: its parameters, and the plan carried from slot to slot.
#[derive(Debug, Clone)]
pub struct CarriedPlan<O: Objective> {
    /// The sensors and their stops.
    pub(crate) model: PlanModel,
    pub(super) streams: Streams,
    /// Slots of the mission.
    pub(super) slots: u64,
    pub(crate) keys: HorizonKeys,
    /// How far from its waypoint a slot may end [m].
    pub(super) beside_m: f64,
    /// What became of the proposals of each operator.
    pub(super) counts: Vec<OperatorCounts>,
    /// The slot of the last service of each SN, 0 before the first; empty unless ages count.
    served: Vec<u32>,
    /// The remaining stops.
    pub(super) stops: Vec<PlannedStop>,
    pub(super) state: PlanState,
    objective: PhantomData<O>,
}

/// How the plan is searched for, and flown, also in checkpoints: its fields and their order are those of their bytes.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct PlanState {
    /// Temperature of the next search, 0 to 1: the cost accepted with probability 1/e, as a fraction of the mean cost
    /// per stop beyond the bound.
    pub(super) temperature: f64,
    /// Whether it has searched.
    pub(super) has_begun: bool,
    /// The slot before which searches were made in part; 0 if they were not.
    pub(super) advanced: u64,
    /// Whether the UAV is on its way to the first stop, where plans hover.
    pub(super) is_under_way: bool,
    /// Searches in vain in a row, where plans hover: each next one takes half as many steps.
    pub(super) vain_searches: u32,
    /// Where the last planned slot should have ended, if slots end beside their waypoints [m].
    pub(super) waypoint: Option<[f64; 2]>,
}

/// A point in a checkpoint, by its number: its position [m] and sensor.
pub type SavedPoint = ([f64; 2], u32);

/// The checkpoint of a look-ahead.
#[derive(Serialize, Deserialize)]
struct Saved {
    stops: Vec<PlannedStop>,
    points: Vec<SavedPoint>,
    state: PlanState,
    counts: Vec<OperatorCounts>,
    served: Vec<u32>,
}

/// What a style says of the slots of a mission.
pub trait PlanStyle<O: Objective<Style = Self>>: SearchStyle<O> {
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

impl<O: Objective<Style: PlanStyle<O>>> CarriedPlan<O> {
    /// The look-ahead before slot 1.
    ///
    /// If sampling rates are learnt, all SNs can lose data, at their estimated rates. The setup's stop ends the search
    /// for groups and tours.
    #[must_use]
    pub fn new(setup: &Setup, keys: HorizonKeys) -> Self {
        let Setup { scenario, belief, stop, .. } = *setup;
        let sensors = &setup.table.sensors;
        let may_group = keys.without != Some(LookAheadPart::Groups);
        let costs = match setup.settings.objective.weights() {
            Some(weights) if O::COUNTS_AGES => GapCosts::new(&weights, scenario.slot_s, scenario.deadline_slots()),
            _ => GapCosts::LOSS,
        };
        let model = if belief.has_learnt_rates() {
            let mean_bits = sensors.ids().map(|id| least_mean_bits(belief.mean_bits(sensors, id))).collect();
            let sampling = sensors.sampling.with_means(mean_bits);
            let estimated = Sensors { sampling, ..Sensors::clone(sensors) };
            PlanModel::new::<O>(scenario, &setup.table.over(scenario, Arc::new(estimated)), &costs, may_group, stop)
        } else {
            PlanModel::new::<O>(scenario, setup.table, &costs, may_group, stop)
        };
        Self {
            model,
            streams: Streams::new(scenario.seed),
            slots: scenario.slots,
            keys,
            beside_m: O::Style::beside_m(scenario),
            counts: vec![OperatorCounts::default(); O::Style::OPERATORS.len()],
            served: if O::COUNTS_AGES { vec![0; sensors.count()] } else { Vec::new() },
            stops: Vec::new(),
            state: PlanState { temperature: FIRST_TEMPERATURE, ..PlanState::default() },
            objective: PhantomData,
        }
    }

    /// Takes in the services of the flights of `slot`, where ages count.
    pub(crate) fn observe(&mut self, slot: u64, flights: &[FlightReport]) {
        for link in flights.iter().flat_map(FlightReport::served_links) {
            if let Some(served) = self.served.get_mut(link.sensor as usize) {
                *served = u32::try_from(slot).unwrap_or(u32::MAX);
            }
        }
    }

    /// Updates the model with what is known at the beginning of the slot: SNs that are out, learnt rates, and the
    /// uncertainty of the queues.
    pub(super) fn update_sensors(&mut self, view: &View) {
        let belief = view.belief.belief;
        if view.table.sensors.may_refuse {
            let weights = &self.model.table.sensors.weights;
            for (index, (sensor, &id)) in self.model.sensors.iter_mut().zip(&self.model.ids).enumerate() {
                let answer = view.answer(id);
                sensor.is_dead = answer == Answer::Dead;
                sensor.weight = if answer.sends() { weights.factor(index) } else { 0.0 };
                sensor.cost_bits = sensor.weight * sensor.mean_bits;
            }
            let first = self.stops.first().copied();
            self.stops.retain(|stop| !self.model.is_dead(stop.disk)); // a silent one may send again
            self.state.is_under_way &= self.stops.first().copied() == first;
        }
        if !belief.is_estimated() {
            return;
        }
        let law = view.table.arrivals;
        for (sensor, &id) in self.model.sensors.iter_mut().zip(&self.model.ids) {
            if sensor.mean_bits == 0.0 || sensor.weight == 0.0 {
                continue; // its queue does not change
            }
            if belief.has_learnt_rates() {
                let mean_bits = least_mean_bits(view.belief.mean_bits(id));
                sensor.mean_bits = mean_bits;
                sensor.cost_bits = sensor.weight * mean_bits;
                sensor.fill_slots = Sampler { mean_bits, ..view.table.sensors.sampler(id) }.lossless_slots();
                sensor.noise_slots2 = noise_slots2(law, mean_bits, sensor.fill_slots);
            }
            let uncertainty = view.belief.uncertainty(id);
            let Uncertainty { unbounded_bits, initial_bits, rate, since_contact_bits, arrivals_bits } = uncertainty;
            sensor.noise_before_slots2 = 3.0 * (arrivals_bits / sensor.mean_bits).powi(2);
            sensor.initial_half_slots = initial_bits / sensor.mean_bits;
            sensor.rate_half_fraction = rate;
            // Before the first contact its uncertainty is in `initial_half_slots`.
            sensor.left_slots = if rate > 0.0 { (unbounded_bits - since_contact_bits) / sensor.mean_bits } else { 0.0 };
            let capacity_bits = sensor.fill_slots * sensor.mean_bits;
            let overdue_bits = if sensor.is_known() { 0.0 } else { (unbounded_bits - capacity_bits).max(0.0) };
            sensor.overdue_slots = overdue_bits / sensor.mean_bits;
        }
    }

    /// The forecast of the carried plan from the slot of `view` on, or of an initial plan; `None` if no SN can lose
    /// data.
    #[must_use]
    pub fn forecast(&mut self, view: &View) -> Option<Forecast<O>> {
        self.update_sensors(view);
        self.model.pad_waits = view.pad_waits();
        O::Style::forecast(self, view)
    }

    /// The visits of the plan of `forecast`, from the slot of `view` on.
    pub fn visits(&self, view: &View, forecast: &Forecast<O>) -> Vec<PlannedVisit> {
        let mut levels = forecast.window.levels.clone();
        let planned = forecast.visits().map(|visit| {
            let index = visit.sensor as usize;
            let slot = f64::from(visit.slot);
            let sensor = &self.model.sensors[index];
            let (units, left) = O::visit(sensor, levels[index], slot, visit.capacity);
            levels[index] = left;
            PlannedVisit {
                slot: view.slot + (visit.slot as u64 - 1), // from 1 on
                sensor: self.model.ids[index],
                bits: O::visit_bits(sensor, units, visit.capacity),
            }
        });
        planned.collect()
    }

    /// Whether it has searched.
    pub fn has_searched(&self) -> bool {
        self.state.has_begun
    }

    /// Whether it carries a plan from the slot before.
    pub fn has_plan(&self) -> bool {
        O::Style::has_plan(self)
    }

    /// Improves the plan of `forecast` in the steps of its keys, or in `first_steps`, by the style.
    ///
    /// Without a budget the number of steps is fixed. The search draws from the random stream of the slot, so the
    /// result depends only on the view and the carried plan.
    pub fn search(&mut self, view: &View, forecast: &mut Forecast<O>, first_steps: u64, is_over: &dyn Fn() -> bool) {
        O::Style::search(self, view, forecast, first_steps, is_over);
    }

    /// Carries the part of the plan of `forecast` after the slot of `view`, whose waypoint is `waypoint` [m].
    pub fn carry(&mut self, forecast: &Forecast<O>, waypoint: &Position) {
        O::Style::carry(self, forecast, waypoint);
    }

    /// The planning window that starts at the slot of `view`.
    pub(super) fn window(&self, view: &View) -> PlanningWindow<O> {
        let left = (self.slots + 1).saturating_sub(view.slot).max(1);
        let slots = left.min(self.keys.window.unwrap_or(MOST_SLOTS));
        // A UAV beside its waypoint has arrived: otherwise a hover would never be over.
        let ground = view.ground();
        let arrived = self.state.waypoint.map(Position::from).filter(|at| within(at, &ground, self.beside_m));
        let start = arrived.unwrap_or(ground);
        let begun = view.slot.saturating_sub(1) as f64;
        let age_slots = |id: u32| self.served.get(id as usize).map_or(0.0, |served| begun - f64::from(*served));
        let mut window =
            PlanningWindow::new(&self.model, start, view.belief.queues_bits, age_slots, slots, left - slots)
                .with_battery(view.slot.saturating_sub(1), view.battery.energy_j);
        O::Style::complete(self, view, &mut window);
        window
    }

    /// What became of the proposals of each operator, by its name.
    pub fn counts(&self) -> impl Iterator<Item = (&'static str, &OperatorCounts)> {
        O::Style::OPERATORS.iter().map(|operator| operator.name).zip(&self.counts)
    }
}

impl<O: Objective<Style: PlanStyle<O>>> Checkpoint for CarriedPlan<O> {
    fn save(&self, bytes: &mut Vec<u8>) {
        let saved = Saved {
            stops: self.stops.clone(),
            points: O::Style::saved_points(&self.model),
            state: self.state.clone(),
            counts: self.counts.clone(),
            served: self.served.clone(),
        };
        encode(&saved, bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        let Saved { stops, points, state, counts, served } = decode(bytes)?;
        CheckpointError::ensure((0.0..=1.0).contains(&state.temperature), "a temperature from 0 to 1")?;
        let disks = O::Style::count_stops(&self.model, &points);
        CheckpointError::ensure(stops.iter().all(|stop| (stop.disk as usize) < disks), "stops of this field")?;
        let is_point = |point: &[f64; 2]| point.iter().all(|coordinate_m| coordinate_m.is_finite());
        let is_known = |(point, sensor): &SavedPoint| (*sensor as usize) < self.model.sensors.len() && is_point(point);
        CheckpointError::ensure(points.iter().all(is_known), "points of this field")?;
        CheckpointError::ensure(state.waypoint.iter().all(is_point), "a waypoint")?;
        CheckpointError::ensure(counts.len() == self.counts.len(), "the operators of this objective")?;
        CheckpointError::ensure(served.len() == self.served.len(), "a service of each sensor node")?;
        O::Style::restore_points(&mut self.model, &points);
        self.stops = stops;
        self.state = state;
        self.counts = counts;
        self.served = served;
        Ok(())
    }
}

/// Estimated bits per slot of an SN, raised above 0.
fn least_mean_bits(mean_bits: f64) -> f64 {
    mean_bits.max(LEAST_MEAN_BITS)
}
