//! `horizon`: the plan of least predicted loss over many slots, improved in every slot and flown a slot at a time.
//!
//! A plan is a sequence of stops. Decisions for slots are left to the strategy `horizon`, lower bounds on the loss to
//! [`crate::bound`].
//!
//! | module | contents |
//! |---|---|
//! | [`model`] | the sensor nodes that can lose data, in slots instead of bits |
//! | [`groups`] | the stops of a plan |
//! | [`flight`], [`choice`] | the flight to a stop, and the sensor nodes served on the way |
//! | [`forecast`], [`states`] | the predicted loss of a plan, or of a change |
//! | [`start`] | initial plans |
//! | [`anneal`] | the search |
//! | [`long_search`] | the search before the mission |

pub mod anneal;
pub mod choice;
pub mod flight;
pub mod forecast;
pub mod groups;
pub mod long_search;
pub mod model;
pub mod start;
pub mod states;
#[cfg(test)]
mod tests;

use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode, encode};
use skysink_common::estimate::Uncertainty;
use skysink_common::geometry::Position;
use skysink_common::keys::Accepts;
use skysink_common::message::MAX_PATH_POINTS;
use skysink_common::random::{Purpose, Streams};
use skysink_common::sampling::Sampler;
use skysink_common::sensors::Sensors;
use strum::VariantNames;

use crate::neighbours::PlannedVisit;
use crate::strategy::{Setup, Timing, View};
use anneal::Temperature;
use flight::{BaseVisit, Trace, Visit};
use forecast::{Forecast, PlanningWindow};
use model::{OtherVisits, PlanningModel, noise_slots2};

/// Lower limit on the estimated bits per slot of an SN: one that does not sample cannot be distinguished from one that
/// rarely does.
const LEAST_MEAN_BITS: f64 = 1e-3;

/// Temperature of the first search.
const FIRST_TEMPERATURE: f64 = 0.05;

/// Most slots for which a long search before the first of them makes all but one in [`LEFT`] of the steps, where all is
/// known.
const ADVANCE_SLOTS: u64 = 500;
const LEFT: u32 = 4;

/// Most steps of the long search: some seconds, counted and not timed. Fewer where a step takes longer: by the factor of a
/// battery, of zones, and of other UAVs, which search as long, and by the number of sensors beyond so many.
const MOST_ADVANCED: u64 = 600_000;
const BATTERY_EFFORT: u64 = 10;
const ZONES_EFFORT: u64 = 3;
const FLEET_EFFORT: u64 = 4;
const EASY_SENSORS: usize = 200;

/// Ceiling of the temperature at the mission's end; 1 at its beginning.
const LAST_CEILING: f64 = 0.1;

/// Fraction of free resource blocks from which on the temperature is not reduced.
const FREE: f64 = 0.5;

/// Largest increase of the loss by a search, as a fraction of the avoidable loss; beyond it the search is undone.
const MOST_RISE: f64 = 0.02;

/// Lowest temperature; above 0, so that [`REHEATING`] can raise it.
const LEAST_TEMPERATURE: f64 = 1e-9;

/// Factor of the temperature after a search that increased the loss.
const COOLING: f64 = 0.95;

/// Factor of the temperature after a search that reduced the loss.
const REHEATING: f64 = 1.05;

/// Longest planning window [slots] unless the scenario has another: four times the mission of the UTS letter.
const MOST_SLOTS: u64 = 2_400;

/// Times for a search.
const BUDGET_MS: Accepts =
    Accepts::Number("milliseconds above 0, at most 3600000", |budget_ms| budget_ms > 0.0 && budget_ms <= 3.6e6);

skysink_common::keys! {
    /// `[planner.horizon]`.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct HorizonKeys {
        /// Search steps in each slot.
        iterations: u32 = 6000, Accepts::Whole(0, 1_000_000_000);
        /// Longest planning window [slots]; 2400 if absent. A window that reaches to the mission's end loses less than
        /// a shorter one that moves with the slot.
        window: Option<u64>, Accepts::Whole(1, 1_000_000);
        /// A part of the method to leave out, for ablations.
        without: Option<LookAheadPart>, Accepts::OneOf(LookAheadPart::VARIANTS);
        /// Time limit for the plan of a slot in paced runs [ms]. It has no effect in lock-step and in one process,
        /// where results must not depend on a clock.
        budget_ms: Option<f64>, BUDGET_MS;
    }
}

impl HorizonKeys {
    /// All parts of the method, over the default window.
    #[must_use]
    pub fn of(iterations: u32) -> Self {
        Self { iterations, window: None, without: None, budget_ms: None }
    }

    /// Longest planning time for the slot of `view`; `None` if the mission is not paced.
    #[must_use]
    pub fn budget(&self, view: &View) -> Option<Duration> {
        let budget_ms = self.budget_ms.filter(|_| view.timing == Timing::Paced);
        budget_ms.map(|budget_ms| Duration::from_secs_f64(budget_ms / 1e3))
    }
}

/// A part of the look-ahead that an ablation leaves out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum LookAheadPart {
    /// All parts are there, as if the key were absent.
    Nothing,
    /// Changes that lose more for a while: only improvements are accepted.
    Annealing,
    /// Groups of sensor nodes as stops.
    Groups,
}

/// The look-ahead of a mission: its parameters, and the plan carried from slot to slot.
#[derive(Debug, Clone)]
pub struct Horizon {
    /// The sensors and their stops.
    pub(crate) model: PlanningModel,
    streams: Streams,
    /// Slots of the mission.
    slots: u64,
    pub(crate) keys: HorizonKeys,
    /// The remaining stops, as disks of the model.
    carried: Vec<u32>,
    /// Temperature of the next search, 0 to 1: the loss accepted with probability 1/e, as a fraction of the mean loss
    /// per stop beyond the bound.
    temperature: f64,
    /// Whether it has searched.
    has_begun: bool,
    /// The slot before which searches were made in part; 0 if they were not.
    advanced: u64,
}

/// The checkpoint of a look-ahead.
#[derive(Serialize, Deserialize)]
struct Saved {
    temperature: f64,
    carried: Vec<u32>,
    has_begun: bool,
    advanced: u64,
}

/// A slot of a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedSlot {
    /// Waypoint at the end of the slot.
    pub waypoint: Position,
    /// The served sensor nodes, ascending.
    pub ids: Vec<u32>,
    /// The waypoint of the next stop, and the slots to it.
    pub next_stop: Option<(Position, i32)>,
    /// Whether the UAV charges, and serves nobody.
    pub is_charging: bool,
}

impl Horizon {
    /// The look-ahead before slot 1.
    ///
    /// If sampling rates are learnt, all SNs can lose data, at their estimated rates. The setup's stop ends the search
    /// for groups and tours.
    #[must_use]
    pub fn new(setup: &Setup, keys: HorizonKeys) -> Self {
        let Setup { scenario, belief, stop, .. } = *setup;
        let sensors = &setup.table.sensors;
        let may_group = keys.without != Some(LookAheadPart::Groups);
        let model = if belief.has_learnt_rates() {
            let mean_bits = sensors.ids().map(|id| least_mean_bits(belief.mean_bits(sensors, id))).collect();
            let sampling = sensors.sampling.with_means(mean_bits);
            let estimated = Sensors { sampling, ..Sensors::clone(sensors) };
            PlanningModel::new(scenario, &setup.table.over(scenario, Arc::new(estimated)), may_group, stop)
        } else {
            PlanningModel::new(scenario, setup.table, may_group, stop)
        };
        Self {
            model,
            streams: Streams::new(scenario.seed),
            slots: scenario.slots,
            keys,
            carried: Vec::new(),
            temperature: FIRST_TEMPERATURE,
            has_begun: false,
            advanced: 0,
        }
    }

    /// Updates the model with the estimate at the beginning of the slot: learnt rates, and the uncertainty of the
    /// queues.
    fn update_sensors(&mut self, view: &View) {
        let belief = view.belief.belief;
        if !belief.is_estimated() {
            return;
        }
        let law = view.table.arrivals;
        for (sensor, &id) in self.model.sensors.iter_mut().zip(&self.model.ids) {
            if belief.has_learnt_rates() {
                let mean_bits = least_mean_bits(view.belief.mean_bits(id));
                sensor.mean_bits = mean_bits;
                sensor.cost_bits = view.table.sensors.weights.factor(id as usize) * mean_bits;
                sensor.fill_slots = Sampler { mean_bits, ..view.table.sensors.sampler(id) }.fill_slots();
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
    pub fn forecast(&mut self, view: &View) -> Option<Forecast> {
        self.update_sensors(view);
        let model = &mut self.model;
        model.others = OtherVisits::of(view.intents().unwrap_or_default(), &model.ids, &model.sensors, view.slot);
        if self.model.sensors.is_empty() {
            return None;
        }
        let mut forecast = Forecast::new(&self.model, self.window(view));
        if self.carried.is_empty() {
            start::begin(&self.model, &mut forecast);
        } else {
            forecast.load(&self.model, self.carried.iter().copied());
            start::extend(&self.model, &mut forecast);
        }
        Some(forecast)
    }

    /// The visits of the plan of `forecast`, from the slot of `view` on.
    #[must_use]
    pub fn visits(&self, view: &View, forecast: &Forecast) -> Vec<PlannedVisit> {
        let visit = |visit: &Visit| PlannedVisit {
            slot: view.slot - 1 + visit.slot as u64,
            sensor: self.model.ids[visit.sensor as usize],
            bits: visit.capacity_slots * self.model.sensors[visit.sensor as usize].mean_bits,
        };
        forecast.trace.visits.iter().map(visit).collect()
    }

    /// Whether a plan is carried from the slot before.
    #[must_use]
    pub fn has_plan(&self) -> bool {
        !self.carried.is_empty()
    }

    /// Improves the plan of `forecast`, and carries the part after the slot of `view`.
    ///
    /// Without a budget the number of steps is fixed. The search draws from the random stream of the slot, so the
    /// result depends only on the view and the carried plan. Where all is known, the first search makes most of the
    /// steps of the slots after it, which have fewer then.
    pub fn search(&mut self, view: &View, forecast: &mut Forecast, is_over: impl Fn() -> bool) {
        let steps = self.keys.iterations;
        let left = steps.div_ceil(LEFT);
        if !self.has_begun && view.is_certain() {
            let advanced = u64::from(steps - left);
            let most = (self.most_advanced(view) / advanced.max(1)).min(forecast.window.slots as u64);
            let slots = most.min(ADVANCE_SLOTS);
            let watch = &mut |_| if is_over() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
            if self.prepare(view, forecast, advanced * slots, watch).is_some() {
                self.advanced = view.slot + slots;
            }
        }
        self.has_begun = true;
        self.improve(view.slot, if view.slot < self.advanced { left } else { steps }, forecast, is_over);
        self.carried.clear();
        self.carried.extend(forecast.trace.legs.iter().filter(|leg| leg.end > 1).map(|leg| leg.stop));
    }

    /// Most steps of the long search.
    fn most_advanced(&self, view: &View) -> u64 {
        let table = &self.model.table;
        let sensors = self.model.sensors.len().div_ceil(EASY_SENSORS).max(1) as u64;
        let zones = if table.airspace.is_open() { 1 } else { ZONES_EFFORT };
        let battery = if table.home.is_some() { BATTERY_EFFORT } else { 1 };
        let fleet = if view.intents().is_some() { FLEET_EFFORT } else { 1 };
        MOST_ADVANCED / (sensors * zones * battery * fleet)
    }

    /// The planning window that starts at the slot of `view`.
    fn window(&self, view: &View) -> PlanningWindow {
        let left = (self.slots + 1).saturating_sub(view.slot).max(1);
        let slots = left.min(self.keys.window.unwrap_or(MOST_SLOTS));
        PlanningWindow::new(&self.model, view.ground(), view.belief.queues_bits, slots, left - slots)
            .with_battery(view.slot.saturating_sub(1), view.battery.energy_j)
    }

    /// Anneals the plan; restores the initial plan if the loss ends much higher.
    ///
    /// The temperature is proportional to the loss per stop beyond the bound, and falls with the fraction of free
    /// resource blocks, because a cycle of full groups can only get worse. It is lowered after a search that increased
    /// the loss, and raised after one that reduced it, up to a ceiling that falls over the mission.
    fn improve(&mut self, slot: u64, steps: u32, forecast: &mut Forecast, is_over: impl Fn() -> bool) {
        if steps == 0 {
            return;
        }
        let model = &self.model;
        let begun = forecast.stops();
        let begun_bits = forecast.loss_bits;
        let window = &forecast.window;
        let least_bits = window.least_loss_bits(model);
        if begun_bits <= least_bits {
            return; // nothing can be better
        }
        let blocks = model.table.limits.blocks() as f64 * f64::from(window.slots);
        let free = (1.0 - forecast.trace.visits.len() as f64 / blocks).max(0.0);
        let freedom = (free / FREE).min(1.0).powi(2);
        let avoidable_bits = (begun_bits - forecast.beyond_bits - least_bits).max(0.0) * freedom;
        // A window that ends before the mission has no final temperature.
        let progress = if window.beyond_slots > 0.0 { 1.0 } else { slot as f64 / self.slots as f64 };
        let ceiling = LAST_CEILING.powf(progress);
        let temperature =
            if self.keys.without == Some(LookAheadPart::Annealing) { 0.0 } else { self.temperature.min(ceiling) };
        let far_bits = avoidable_bits / begun.len().max(1) as f64 * temperature;
        let mut random = self.streams.stream(Purpose::Horizon, slot, 0);
        anneal::anneal(model, forecast, Temperature::far_ahead(far_bits), steps, is_over, &mut random);
        // The schedules depend on the queues, and the search copies legs without recomputing them. Reload the plan, so
        // that the next slot resumes from exactly this plan.
        forecast.load(model, forecast.stops());
        let rise_bits = forecast.loss_bits - begun_bits;
        if rise_bits > 0.0 {
            self.temperature = (self.temperature * COOLING).max(LEAST_TEMPERATURE);
        } else if rise_bits < 0.0 {
            self.temperature = (self.temperature * REHEATING).min(1.0);
        }
        if rise_bits > avoidable_bits * MOST_RISE {
            forecast.load(model, begun);
        }
    }
}

impl Checkpoint for Horizon {
    fn save(&self, bytes: &mut Vec<u8>) {
        let Self { temperature, has_begun, advanced, .. } = *self;
        encode(&Saved { temperature, carried: self.carried.clone(), has_begun, advanced }, bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        let Saved { temperature, carried, has_begun, advanced } = decode(bytes)?;
        CheckpointError::ensure((0.0..=1.0).contains(&temperature), "a temperature from 0 to 1")?;
        let disks = self.model.disks.len();
        CheckpointError::ensure(carried.iter().all(|&stop| (stop as usize) < disks), "stops of this field")?;
        self.carried = carried;
        self.has_begun = has_begun;
        self.advanced = advanced;
        self.temperature = temperature;
        Ok(())
    }
}

/// Estimated bits per slot of an SN, raised above 0.
fn least_mean_bits(mean_bits: f64) -> f64 {
    mean_bits.max(LEAST_MEAN_BITS)
}

/// Slot `slot`, from 1, of a plan, with the UAV at `from` at its beginning; `None` after the last stop.
#[must_use]
pub fn planned_slot(model: &PlanningModel, forecast: &Forecast, slot: i32, from: &Position) -> Option<PlannedSlot> {
    let Trace { legs, visits } = &forecast.trace;
    let index = legs.partition_point(|leg| leg.end < slot);
    let leg = legs.get(index)?;
    let begin = index.checked_sub(1).map_or(0, |before| legs[before].end);
    // Where the leg leads, and when it is there: to the base first, if it is due.
    let mut end = (leg.at, leg.end);
    let mut next = legs.get(legs.partition_point(|leg| leg.end <= slot)).map(|leg| (leg.at, leg.end));
    if let Some(BaseVisit { slots: way, charged, at }) = leg.via {
        if slot > begin + way && slot <= begin + way + charged {
            return Some(PlannedSlot { waypoint: *from, ids: Vec::new(), next_stop: None, is_charging: true });
        }
        if slot <= begin + way {
            end = (at, begin + way);
            next = Some(end);
        }
    }
    // A leg of several slots is flown in equal steps, after the slots around zones.
    let airspace = &model.table.airspace;
    let waypoint = if airspace.is_free(from, &end.0) {
        from + (end.0 - from) / f64::from(end.1 - slot + 1)
    } else {
        model.table.motion.toward(from, &end.0)
    };
    let visits = visits[visits.partition_point(|visit| visit.slot < slot)..].iter();
    let visits = visits.take_while(|visit| visit.slot == slot);
    let mut ids: Vec<u32> = visits.map(|visit| model.ids[visit.sensor as usize]).collect();
    ids.sort_unstable();
    let next_stop = next.map(|(at, end)| (at, end - slot));
    Some(PlannedSlot { waypoint, ids, next_stop, is_charging: false })
}

/// The stops [m] of a plan after its first slot, and the bends around zones between them, at most 63 points.
#[must_use]
pub fn planned_path(model: &PlanningModel, forecast: &Forecast) -> Vec<Position> {
    let airspace = &model.table.airspace;
    let mut path: Vec<Position> = Vec::new();
    for leg in forecast.trace.legs.iter().filter(|leg| leg.end > 1) {
        match path.last().copied() {
            Some(_) if !airspace.is_open() && path.len() >= MAX_PATH_POINTS => break,
            Some(before) if !airspace.is_open() => path.extend(airspace.way(&before, &leg.at)),
            _ => path.push(leg.at),
        }
    }
    path.dedup();
    path.truncate(MAX_PATH_POINTS - 1);
    path
}
