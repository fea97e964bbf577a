//! The look-ahead: the plan of least predicted cost over many slots, carried from slot to slot and improved in each.

use std::marker::PhantomData;
use std::ops::ControlFlow;
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode, encode};
use skysink_common::estimate::Uncertainty;
use skysink_common::geometry::{Position, within};
use skysink_common::message::FlightReport;
use skysink_common::random::Streams;
use skysink_common::sampling::Sampler;
use skysink_common::sensors::Sensors;

use super::forecast::Forecast;
use super::groups::PlannedStop;
use super::keys::{HorizonKeys, LookAheadPart};
use super::model::PlanModel;
use super::objective::Objective;
use super::operators::operators;
use super::other_visits::OtherVisits;
use super::points::is_there;
use super::sensor::noise_slots2;
use super::start;
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

/// Most slots for which a long search before the first of them makes all but one in [`LEFT`] of the steps, where all is
/// known.
const ADVANCE_SLOTS: u64 = 500;
const LEFT: u32 = 4;

/// Most steps of the long search: some seconds, counted and not timed. Fewer where a step takes longer: by the factor
/// of a battery, of zones, and of other UAVs, which search as long, and by the number of sensors beyond so many.
const MOST_ADVANCED: u64 = 600_000;
const BATTERY_EFFORT: u64 = 10;
const ZONES_EFFORT: u64 = 3;
const FLEET_EFFORT: u64 = 4;
const EASY_SENSORS: usize = 200;

/// How often the steps of a search are halved, at most, after searches in vain.
const MOST_HALVINGS: u32 = 4;

/// Standard deviations of position errors within which a UAV has arrived.
const MOST_DEVIATIONS: f64 = 6.0;

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
    /// How far from its waypoint a slot may end, where plans hover [m].
    beside_m: f64,
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
    advanced: u64,
    /// Whether the UAV is on its way to the first stop, where plans hover.
    is_under_way: bool,
    /// Searches in vain in a row, where plans hover: each next one takes half as many steps.
    pub(super) vain_searches: u32,
    /// Where the last planned slot should have ended, if slots end beside their waypoints [m].
    waypoint: Option<[f64; 2]>,
}

/// The checkpoint of a look-ahead. Points, by their numbers, are positions [m] and sensors.
#[derive(Serialize, Deserialize)]
struct Saved {
    stops: Vec<PlannedStop>,
    points: Vec<([f64; 2], u32)>,
    state: PlanState,
    counts: Vec<OperatorCounts>,
    served: Vec<u32>,
}

impl<O: Objective> CarriedPlan<O> {
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
            beside_m: if O::HOVERS { MOST_DEVIATIONS * scenario.uav.position_error_m.unwrap_or(0.0) } else { 0.0 },
            counts: vec![OperatorCounts::default(); operators::<O>().len()],
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
                sensor.is_dead = view.table.is_dead(id);
                sensor.weight = if view.table.is_out(id) { 0.0 } else { weights.factor(index) };
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
    /// data. Where plans hover there is none before [`Self::begin_at_points`].
    #[must_use]
    pub fn forecast(&mut self, view: &View) -> Option<Forecast<O>> {
        self.update_sensors(view);
        let model = &mut self.model;
        model.pad_waits = view.pad_waits();
        if !O::HOVERS {
            let intents = view.intents().unwrap_or_default();
            model.others = OtherVisits::of(intents, &model.ids, &model.sensors, view.slot);
            if model.sensors.is_empty() {
                return None;
            }
        }
        let mut forecast = Forecast::new(&self.model, self.window(view));
        if O::HOVERS {
            forecast.load(&self.model, self.stops.iter().copied());
        } else if self.stops.is_empty() {
            start::begin(&self.model, &mut forecast);
        } else {
            forecast.load(&self.model, self.stops.iter().copied());
            start::extend(&self.model, &mut forecast);
        }
        Some(forecast)
    }

    /// The visits of the plan of `forecast`, from the slot of `view` on.
    pub fn visits(&self, view: &View, forecast: &Forecast<O>) -> Vec<PlannedVisit> {
        let mut levels = forecast.window.levels.clone();
        let planned = forecast.visits().map(|visit| {
            let (index, slot) = (visit.sensor as usize, f64::from(visit.slot));
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

    /// Whether it has searched, or carries a plan from the slot before.
    pub fn has_plan(&self) -> bool {
        if O::HOVERS { self.state.has_begun } else { !self.stops.is_empty() }
    }

    /// Loads a first plan that hovers: see [`start::begin_at_points`]. `offered` are points, each with a sensor by its
    /// id.
    pub fn begin_at_points(
        &mut self,
        view: &View,
        forecast: &mut Forecast<O>,
        offered: &[(Position, u32)],
        is_over: &dyn Fn() -> bool,
    ) {
        let mut turns = self.model.table.turns(view.stop).as_ref().clone();
        turns.begin_near(|point| self.model.table.motion.distance_m2(point, &forecast.window.start));
        let number = |id: &u32| self.model.ids.binary_search(id).ok();
        let offered: Vec<(Position, u32)> =
            offered.iter().filter_map(|(at, id)| number(id).map(|sensor| (*at, sensor as u32))).collect();
        let offered = offered.into_iter().map(|(at, sensor)| self.model.add_point(sensor, at, 0)).collect();
        start::begin_at_points(&mut self.model, forecast, &turns, offered, is_over);
    }

    /// Improves the plan of `forecast` in the steps of its keys, `first_steps` where plans hover and it is the first.
    ///
    /// Without a budget the number of steps is fixed. The search draws from the random stream of the slot, so the
    /// result depends only on the view and the carried plan. Where all is known, the first search makes most of the
    /// steps of the slots after it, which have fewer then.
    pub fn search(&mut self, view: &View, forecast: &mut Forecast<O>, first_steps: u64, is_over: &dyn Fn() -> bool) {
        if O::HOVERS {
            let is_first = !self.state.has_begun;
            let steps = u64::from(self.keys.iterations);
            let halved = steps >> self.state.vain_searches.min(MOST_HALVINGS);
            let steps = if is_first { first_steps } else { halved.max(steps.min(1)) };
            self.state.has_begun = true;
            return self.improve_points(view.slot, steps, is_first, forecast, is_over);
        }
        let steps = self.keys.iterations;
        let left = steps.div_ceil(LEFT);
        if !self.state.has_begun && view.is_certain() {
            let advanced = u64::from(steps - left);
            let most = (self.most_advanced(view) / advanced.max(1)).min(forecast.window.slots as u64);
            let slots = most.min(ADVANCE_SLOTS);
            let watch = &mut |_| if is_over() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
            if self.prepare(view, forecast, advanced * slots, watch).is_some() {
                self.state.advanced = view.slot + slots;
            }
        }
        self.state.has_begun = true;
        self.improve(view.slot, if view.slot < self.state.advanced { left } else { steps }, forecast, is_over);
    }

    /// Carries the part of the plan of `forecast` after the slot of `view`, whose waypoint is `waypoint` [m]; where
    /// plans hover all stops that are left.
    pub fn carry(&mut self, forecast: &Forecast<O>, waypoint: &Position) {
        let legs = &forecast.trace.legs;
        self.stops.clear();
        if !O::HOVERS {
            self.stops.extend(legs.iter().filter(|leg| leg.end > 1).map(|leg| leg.stop));
            return;
        }
        let first = legs.partition_point(|leg| leg.end == 0);
        self.stops.extend(legs[first..].iter().map(|leg| leg.stop));
        self.state.is_under_way = legs.get(first).is_some_and(|leg| leg.via.is_none());
        if let Some(stop) = self.stops.first_mut().filter(|_| self.state.is_under_way)
            && is_there(&forecast.window.start, waypoint)
        {
            stop.hovers = stop.hovers.saturating_sub(1);
        }
        self.state.waypoint = (self.beside_m > 0.0 && self.state.is_under_way).then_some((*waypoint).into());
        self.model.keep_points(&mut self.stops);
    }

    /// Keeps the plan of `forecast`, of which nothing is flown yet, for the slot that it begins with.
    pub(crate) fn keep(&mut self, forecast: &Forecast<O>) {
        self.stops = forecast.stops();
        self.model.keep_points(&mut self.stops);
    }

    /// Most steps of the long search.
    fn most_advanced(&self, view: &View) -> u64 {
        let table = &self.model.table;
        let sensors = self.model.sensors.len().div_ceil(EASY_SENSORS).max(1) as u64;
        let zones = if table.airspace.is_open() { 1 } else { ZONES_EFFORT };
        let battery = if table.home.way().is_some() { BATTERY_EFFORT } else { 1 };
        let fleet = if view.intents().is_some() { FLEET_EFFORT } else { 1 };
        MOST_ADVANCED / (sensors * zones * battery * fleet)
    }

    /// The planning window that starts at the slot of `view`.
    fn window(&self, view: &View) -> PlanningWindow<O> {
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
        if O::HOVERS {
            window.under_way = self.stops.first().filter(|_| self.state.is_under_way).map(|stop| stop.disk);
            // What other UAVs will take is theirs.
            for visit in view.intents().unwrap_or_default() {
                if let Ok(sensor) = self.model.ids.binary_search(&visit.sensor) {
                    let slot = (visit.slot + 1).saturating_sub(view.slot) as f64;
                    window.levels[sensor] =
                        O::leave(&self.model.sensors[sensor], window.levels[sensor], slot, visit.bits);
                }
            }
        }
        window
    }

    /// What became of the proposals of each operator, by its name.
    pub fn counts(&self) -> impl Iterator<Item = (&'static str, &OperatorCounts)> {
        operators::<O>().iter().map(|operator| operator.name).zip(&self.counts)
    }
}

impl<O: Objective> Checkpoint for CarriedPlan<O> {
    fn save(&self, bytes: &mut Vec<u8>) {
        let points = self.model.disks.iter().filter(|_| O::HOVERS);
        let saved = Saved {
            stops: self.stops.clone(),
            points: points.map(|point| (point.disk.centre.into(), point.members[0])).collect(),
            state: self.state.clone(),
            counts: self.counts.clone(),
            served: self.served.clone(),
        };
        encode(&saved, bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        let Saved { stops, points, state, counts, served } = decode(bytes)?;
        CheckpointError::ensure((0.0..=1.0).contains(&state.temperature), "a temperature from 0 to 1")?;
        let disks = if O::HOVERS { points.len() } else { self.model.disks.len() };
        CheckpointError::ensure(stops.iter().all(|stop| (stop.disk as usize) < disks), "stops of this field")?;
        let is_point = |point: &[f64; 2]| point.iter().all(|coordinate_m| coordinate_m.is_finite());
        let is_known =
            |(point, sensor): &([f64; 2], u32)| (*sensor as usize) < self.model.sensors.len() && is_point(point);
        CheckpointError::ensure(points.iter().all(is_known), "points of this field")?;
        CheckpointError::ensure(state.waypoint.iter().all(is_point), "a waypoint")?;
        CheckpointError::ensure(counts.len() == self.counts.len(), "the operators of this objective")?;
        CheckpointError::ensure(served.len() == self.served.len(), "a service of each sensor node")?;
        if O::HOVERS {
            self.model.disks.clear();
            points.iter().for_each(|(point, sensor)| _ = self.model.add_point(*sensor, (*point).into(), 0));
        }
        (self.stops, self.state, self.counts, self.served) = (stops, state, counts, served);
        Ok(())
    }
}

/// Estimated bits per slot of an SN, raised above 0.
fn least_mean_bits(mean_bits: f64) -> f64 {
    mean_bits.max(LEAST_MEAN_BITS)
}
