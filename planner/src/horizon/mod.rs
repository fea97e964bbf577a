//! `horizon`: the plan of least predicted loss over many slots, improved in every slot and flown a slot at a time.
//!
//! A plan is a sequence of stops. How a slot of it becomes a decision, and when another strategy decides, is left to
//! [`crate::strategies::horizon`].
//!
//! | module | job |
//! |---|---|
//! | [`model`] | the sensor nodes that can lose data, in slots instead of bits |
//! | [`service_disk`], [`groups`] | the stops of a plan |
//! | [`flight`], [`choice`] | how a stop is flown, and which sensor nodes are served on the way |
//! | [`forecast`], [`states`] | what a plan, or a change of it, loses |
//! | [`start`], [`even_tour`], [`offered`] | plans to start from |
//! | [`anneal`], [`draw`] | the search |
//! | [`long_search`] | the search before the mission, of `offline` |
//! | [`bound`], [`path_bound`] | the loss that no plan avoids; how many sensor nodes some slots can serve |

pub mod anneal;
pub mod bound;
pub mod choice;
pub mod draw;
pub mod even_tour;
pub mod flight;
pub mod forecast;
pub mod groups;
pub mod long_search;
pub mod model;
pub mod offered;
pub mod path_bound;
pub mod service_disk;
pub mod start;
pub mod states;
#[cfg(test)]
mod tests;

use std::time::Duration;

use serde::{Deserialize, Serialize};
use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode, encode};
use skysink_common::geometry::Position;
use skysink_common::message::{MAX_PATH_POINTS, SensorNode};
use skysink_common::random::{Purpose, Streams};

use crate::strategies::{Setup, Timing, View};
use anneal::Temperature;
use bound::lower_bound;
use flight::Trace;
use forecast::{Forecast, PlanningWindow};
use model::PlanningModel;
use service_disk::ServiceDisk;
use skysink_common::estimate::{Estimate, Uncertainty};

/// Least that an SN of unknown rate is taken to sample per slot [bit]: one that does not sample cannot be told from one
/// that samples hardly ever.
const LEAST_MEAN_BITS: f64 = 1e-3;

/// Ceiling of the temperature at the mission's end; at its beginning it is 1.
const LAST_CEILING: f64 = 0.1;

/// From this fraction of free resource blocks on, the temperature is not reduced.
const FREE: f64 = 0.5;

/// Most that a search may end higher, as a fraction of what is avoidable; otherwise it is undone.
const MOST_RISE: f64 = 0.02;

/// Lowest temperature; above 0, so that a factor can raise it again.
const LEAST_TEMPERATURE: f64 = 1e-9;

/// Factor of the temperature after a slot whose search ended with more loss than it began with.
const COOLING: f64 = 0.95;

/// Factor of the temperature after a slot whose search ended with less.
const REHEATING: f64 = 1.05;

/// Temperature of a change in the next slot, as a fraction of that of one far ahead.
const NEAR_FRACTION: f64 = 0.02;

/// The look-ahead of a mission: its constants, and the plan carried from slot to slot.
#[derive(Debug, Clone)]
pub struct Horizon {
    model: PlanningModel,
    streams: Streams,
    /// Slots of the mission.
    slots: u64,
    /// Most slots that are looked ahead.
    most_slots: u64,
    /// Search steps in each slot.
    iterations: u32,
    /// Longest that a search may take in a paced mission.
    budget: Option<Duration>,
    /// Stops that are still to come, as disks of the model.
    carried: Vec<u32>,
    /// Temperature of the next search, 0 to 1: the loss accepted with probability 1/e, as a fraction of what the
    /// average stop loses beyond the bound.
    temperature: f64,
}

/// What a checkpoint holds of a look-ahead.
#[derive(Serialize, Deserialize)]
struct Saved {
    temperature: f64,
    /// Disks that were added: centre [m] and members.
    added: Vec<([f64; 2], Vec<u32>)>,
    carried: Vec<u32>,
}

/// A search in a slot.
#[derive(Debug, Clone, Copy)]
struct Search {
    slot: u64,
    /// Which of the searches of the slot.
    round: u32,
    steps: u32,
}

/// A slot of a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedSlot {
    /// Where it ends.
    pub waypoint: Position,
    /// Who is served there, ascending.
    pub ids: Vec<u32>,
    /// The waypoint of the next stop after it, and the slots from here to there.
    pub then: Option<(Position, i32)>,
}

impl Horizon {
    /// The look-ahead of a mission before its first slot, over at most `most_slots` slots, with `iterations` search
    /// steps in each slot; in a paced mission no search begins a step later than `budget` after its slot's planning
    /// began.
    ///
    /// Where sampling rates are learnt, every SN may lose data, at the rate that the estimate believes in.
    #[must_use]
    pub fn new(setup: &Setup, most_slots: u64, iterations: u32, budget: Option<Duration>) -> Self {
        let scenario = setup.scenario;
        let learnt = setup.estimate.filter(|estimate| estimate.has_learnt_rates());
        let believed = |(id, sensor): (u32, &SensorNode)| match learnt {
            Some(estimate) => SensorNode { sampling_bps: least_mean_bits(estimate, id) / scenario.slot_s, ..*sensor },
            None => *sensor,
        };
        let sensors: Vec<SensorNode> = (0..).zip(setup.sensors).map(believed).collect();
        Self {
            model: PlanningModel::new(scenario, &sensors),
            streams: Streams::new(scenario.seed),
            slots: scenario.slots,
            most_slots,
            iterations,
            budget,
            carried: Vec::new(),
            temperature: 1.0,
        }
    }

    /// Takes in what is believed as the slot of `view` begins: the rates, where they are learnt, and how sure the
    /// queues are.
    fn update_sensors(&mut self, view: &View) {
        let Some(estimate) = view.estimate else {
            return;
        };
        for (sensor, &id) in self.model.sensors.iter_mut().zip(&self.model.ids) {
            if estimate.has_learnt_rates() {
                sensor.mean_bits = least_mean_bits(estimate, id);
                sensor.fill_slots = f64::from(estimate.capacity_bits(id)) / sensor.mean_bits;
            }
            let Uncertainty { unbounded_bits, initial_bits, rate, since_contact_bits } =
                estimate.uncertainty(view.slot.saturating_sub(1), id);
            sensor.initial_half_slots = initial_bits / sensor.mean_bits;
            sensor.rate_half_fraction = rate;
            // Before the first contact this is only believed, but its doubt is in `initial_half_slots`.
            sensor.left_slots = if rate > 0.0 { (unbounded_bits - since_contact_bits) / sensor.mean_bits } else { 0.0 };
            let capacity_bits = sensor.fill_slots * sensor.mean_bits;
            let overdue_bits = if sensor.is_known() { 0.0 } else { (unbounded_bits - capacity_bits).max(0.0) };
            sensor.overdue_slots = overdue_bits / sensor.mean_bits;
        }
    }

    /// Resumes the carried plan at the slot of `view`, or makes one; `None` if no SN can lose data.
    #[must_use]
    pub fn forecast(&mut self, view: &View) -> Option<Forecast> {
        self.update_sensors(view);
        if self.model.sensors.is_empty() {
            return None;
        }
        let mut forecast = Forecast::new(&self.model, self.window(view));
        if self.carried.is_empty() {
            self.model.replace_added(Vec::new());
            start::begin(&self.model, &mut forecast);
        } else {
            forecast.load(&self.model, self.carried.iter().copied());
            start::extend(&self.model, &mut forecast);
        }
        Some(forecast)
    }

    /// Whether the plan of `forecast` is known to lose no more than it must.
    #[must_use]
    pub fn is_optimal(&self, forecast: &Forecast) -> bool {
        forecast.loss_bits <= lower_bound(&self.model, &forecast.window)
    }

    /// Improves the plan of `forecast`, and carries what follows the slot of `view`.
    ///
    /// Without a budget the search ends after a number of steps, not after a time. It draws from the slot's own random
    /// stream: the result depends on the view and the carried plan alone.
    pub fn search(&mut self, view: &View, forecast: &mut Forecast, is_over: impl Fn() -> bool) {
        self.improve(Search { slot: view.slot, round: 0, steps: self.iterations }, forecast, is_over);
        self.carried.clear();
        self.carried.extend(forecast.trace.legs.iter().filter(|leg| leg.end > 1).map(|leg| leg.stop));
    }

    /// Carries all of the plan, because another flies the next slot.
    pub fn carry_all(&mut self, forecast: &Forecast) {
        self.carried = forecast.stops();
    }

    /// Search steps in each slot.
    #[must_use]
    pub fn iterations(&self) -> u32 {
        self.iterations
    }

    /// Longest that the planning of the slot of `view` may take; none where no clock paces the mission.
    #[must_use]
    pub fn budget(&self, view: &View) -> Option<Duration> {
        self.budget.filter(|_| view.timing == Timing::Paced)
    }

    /// The sensors and their stops.
    #[must_use]
    pub fn model(&self) -> &PlanningModel {
        &self.model
    }

    /// The planning window that starts at the slot of `view`.
    fn window(&self, view: &View) -> PlanningWindow {
        let left = (self.slots + 1).saturating_sub(view.slot).max(1);
        let slots = left.min(self.most_slots);
        PlanningWindow::new(&self.model, view.ground(), view.queues_bits, slots, left - slots)
    }

    /// Anneals the plan; the one it began with stays if the search ends with far more loss.
    ///
    /// The temperature is in proportion to what the plan loses beyond the bound, per stop, and falls with the fraction
    /// of resource blocks that it leaves free: a cycle of full groups can only be disturbed. It cools after a slot
    /// whose search ended higher and warms up after one whose search ended lower, below a ceiling that falls over the
    /// mission.
    fn improve(&mut self, search: Search, forecast: &mut Forecast, is_over: impl Fn() -> bool) {
        let Search { slot, round, steps } = search;
        if steps == 0 {
            return;
        }
        let model = &self.model;
        let begun = forecast.stops();
        let begun_bits = forecast.loss_bits;
        let window = &forecast.window;
        let least_bits = lower_bound(model, window);
        if begun_bits <= least_bits {
            return; // nothing can be better
        }
        let blocks = model.table.resource_blocks as f64 * f64::from(window.slots);
        let free = (1.0 - forecast.trace.visits.len() as f64 / blocks).max(0.0);
        let freedom = (free / FREE).min(1.0).powi(2);
        let avoidable_bits = (begun_bits - forecast.beyond_bits - least_bits).max(0.0) * freedom;
        // A window that moves on has no end to cool toward.
        let progress = if window.beyond_slots > 0.0 { 1.0 } else { slot as f64 / self.slots as f64 };
        let ceiling = LAST_CEILING.powf(progress);
        let far_bits = avoidable_bits / begun.len().max(1) as f64 * self.temperature.min(ceiling);
        let temperature = Temperature { far_bits, now: 0, near_fraction: NEAR_FRACTION };
        let mut random = self.streams.stream(Purpose::Horizon, slot, round);
        anneal::anneal(model, forecast, temperature, steps, is_over, &mut random);
        // Which SNs a slot serves depends on the queues, and the search copies legs that it does not recompute. Load
        // the plan once more, so that the next slot resumes from exactly this plan.
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
        let added = self.model.added().iter().map(|added| (added.disk.centre.into(), added.members.clone())).collect();
        encode(&Saved { temperature: self.temperature, added, carried: self.carried.clone() }, bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        let Saved { temperature, added, carried } = decode(bytes)?;
        CheckpointError::ensure((0.0..=1.0).contains(&temperature), "a temperature from 0 to 1")?;
        let disk = |(centre, members): ([f64; 2], Vec<u32>)| {
            let disk = ServiceDisk::at(&self.model.table, centre.into(), members);
            disk.filter(|_| centre.iter().all(|coordinate| coordinate.is_finite()))
        };
        let saved_disks = added.len();
        let added: Vec<ServiceDisk> = added.into_iter().map_while(disk).collect();
        CheckpointError::ensure(added.len() == saved_disks, "service disks in range of their members")?;
        let disks = self.model.disks.len() - self.model.added().len() + added.len();
        CheckpointError::ensure(carried.iter().all(|&stop| (stop as usize) < disks), "stops of this field")?;
        self.model.replace_added(added);
        self.carried = carried;
        self.temperature = temperature;
        Ok(())
    }
}

/// What SN `id` is believed to sample per slot [bit], above 0.
fn least_mean_bits(estimate: &Estimate, id: u32) -> f64 {
    estimate.mean_bits(id).max(LEAST_MEAN_BITS)
}

/// Slot `slot`, from 1, of a plan, from where the UAV is as it begins; none behind the last stop.
#[must_use]
pub fn planned_slot(model: &PlanningModel, forecast: &Forecast, slot: i32, from: &Position) -> Option<PlannedSlot> {
    let Trace { legs, visits } = &forecast.trace;
    let leg = legs.get(legs.partition_point(|leg| leg.end < slot))?;
    // A leg of several slots is flown in equal steps.
    let waypoint = from + (leg.at - from) / f64::from(leg.end - slot + 1);
    let visits = visits[visits.partition_point(|visit| visit.slot < slot)..].iter();
    let visits = visits.take_while(|visit| visit.slot == slot);
    let mut ids: Vec<u32> = visits.map(|visit| model.ids[visit.sensor as usize]).collect();
    ids.sort_unstable();
    let then = legs.get(legs.partition_point(|leg| leg.end <= slot)).map(|leg| (leg.at, leg.end - slot));
    Some(PlannedSlot { waypoint, ids, then })
}

/// The planned stops [m] of a plan, after where its first slot ends, at most 63.
#[must_use]
pub fn planned_path(forecast: &Forecast) -> Vec<Position> {
    let mut path: Vec<Position> = forecast.trace.legs.iter().filter(|leg| leg.end > 1).map(|leg| leg.at).collect();
    path.dedup();
    path.truncate(MAX_PATH_POINTS - 1);
    path
}
