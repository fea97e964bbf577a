//! `horizon`: the plan of least predicted loss over many slots, improved in every slot and flown a slot at a time.
//!
//! A plan is a sequence of stops. [`flight`] says how it is flown, [`forecast`] what it loses, [`anneal`] how it is
//! improved, [`start`] what it starts from. What never changes is in [`world`]: the sensor nodes in slots instead of
//! bits, and the places to stop at, of which [`groups`] makes some. How the first slot becomes a message is left to
//! [`crate::planner`].

pub mod anneal;
pub mod bound;
pub mod budget;
pub mod choice;
pub mod cycle;
pub mod flight;
pub mod forecast;
pub mod groups;
pub mod optimize;
pub mod reach;
pub mod rollout;
pub mod start;
pub mod states;
#[cfg(test)]
mod tests;
pub mod world;

use std::time::Duration;

use serde::{Deserialize, Serialize};
use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode, encode};
use skysink_common::geometry::Position;
use skysink_common::message::SensorNode;
use skysink_common::path::MAX_POINTS;
use skysink_common::random::{Purpose, Streams};
use skysink_common::scenario::Scenario;

use crate::estimate::{Estimate, Uncertainty};
use anneal::Heat;
use bound::lower_bound;
use budget::Budget;
use forecast::{Forecast, Outlook};
use rollout::roll_out;
use world::{Doubt, Place, World};

/// Least that an SN of unknown rate is taken to sample per slot [bit]: one that does not sample cannot be told from one
/// that samples hardly ever.
const LEAST_MEAN_BITS: f64 = 1e-3;

/// Most waypoints of the planned path.
pub(crate) const PATH: usize = MAX_POINTS;

/// Hottest search: the loss accepted with chance 1/e, as a share of what the average stop loses beyond the bound.
const HOTTEST: f64 = 1.0;

/// Ceiling of the heat at the mission's end.
const LAST_CEILING: f64 = 0.1;

/// Share of free resource blocks from which on a search is as hot as it gets.
const FREE: f64 = 0.5;

/// Most that a search may end higher, as a share of what is avoidable; otherwise it is undone.
const MOST_RISE: f64 = 0.02;

/// Coldest search that may become warmer again.
const COLDEST: f64 = 1e-9;

/// What heat is multiplied by after a slot whose search ended with more loss than it began with.
const COOLING: f64 = 0.95;

/// What heat is multiplied by after a slot whose search ended with less.
const WARMING: f64 = 1.05;

/// Slots ahead from which on the future is as hot as it gets.
const FAR_SLOTS: f64 = 60.0;

/// Heat of the next slot, as a share of that.
const NEAR_SHARE: f64 = 0.02;

/// The look-ahead of a mission: its constants, and the plan carried from slot to slot.
#[derive(Debug, Clone)]
pub struct Horizon {
    world: World,
    streams: Streams,
    slots: u64,
    /// Most slots that are looked ahead.
    most_slots: u64,
    /// Search steps in each slot.
    iterations: u32,
    limit: Option<Duration>,
    /// What the queues would hold beyond their storages, as far as is believed, by source [slots of sampling]; empty where
    /// they are known.
    overdue: Vec<f64>,
    /// Stops that are still to come, as places of the world.
    carried: Vec<u32>,
    /// Heat of the next search, 0 to [`HOTTEST`].
    heat: f64,
}

/// What a checkpoint holds of a look-ahead.
#[derive(Serialize, Deserialize)]
struct Saved {
    heat: f64,
    /// Places that were added: centre [m] and members.
    added: Vec<([f64; 2], Vec<u32>)>,
    carried: Vec<u32>,
}

/// The next slot of a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Next {
    /// Where it ends.
    pub waypoint: Position,
    /// Who is served there, ascending.
    pub ids: Vec<u32>,
    /// The waypoint of the next stop after it, and the slots from here to there.
    pub then: Option<(Position, i32)>,
    /// The planned stops, this slot's first [m], at most 64.
    pub path: Vec<Position>,
    /// Loss [bit] that the plan leads to within the slots looked ahead.
    pub loss_bits: f64,
}

impl Horizon {
    /// The look-ahead of a scenario with these sensor nodes (SNs), before its first slot: over all slots, without search.
    #[must_use]
    pub fn new(scenario: &Scenario, sensors: &[SensorNode]) -> Self {
        Self {
            world: World::new(scenario, sensors),
            streams: Streams::new(scenario.seed),
            slots: scenario.slots,
            most_slots: scenario.slots,
            iterations: 0,
            limit: None,
            overdue: Vec::new(),
            carried: Vec::new(),
            heat: HOTTEST,
        }
    }

    /// The look-ahead of a scenario that does not know the sampling rates: every SN may lose data, at the rate that
    /// `estimate` believes in.
    #[must_use]
    pub fn learning(scenario: &Scenario, sensors: &[SensorNode], estimate: &Estimate) -> Self {
        let believed = |(id, sensor): (u32, &SensorNode)| {
            let sampling_bps = estimate.mean_bits(id).max(LEAST_MEAN_BITS) / scenario.slot_s;
            SensorNode { sampling_bps, ..*sensor }
        };
        Self::new(scenario, &(0..).zip(sensors).map(believed).collect::<Vec<_>>())
    }

    /// Looks at most `most_slots` ahead from now on, with `iterations` search steps in each slot.
    pub fn look_ahead(&mut self, most_slots: u64, iterations: u32) {
        self.most_slots = most_slots;
        self.iterations = iterations;
    }

    /// Takes in what `estimate` believes at the end of `slot`: the rates, where they are learnt, and how sure the queues
    /// are.
    pub fn believe(&mut self, slot: u64, estimate: &Estimate) {
        self.overdue.clear();
        for (source, &id) in self.world.sources.iter_mut().zip(&self.world.ids) {
            if estimate.learns() {
                source.sample(estimate.mean_bits(id).max(LEAST_MEAN_BITS), estimate.capacity_bits(id));
            }
            let Uncertainty { endless_bits, initial_bits, rate } = estimate.uncertainty(slot, id);
            source.doubt = Doubt { initial_slots: initial_bits / source.mean_bits, rate };
            let capacity_bits = source.fill_slots * source.mean_bits;
            let in_doubt = source.doubt != Doubt::default();
            let overdue_bits = if in_doubt { (endless_bits - capacity_bits).max(0.0) } else { 0.0 };
            self.overdue.push(overdue_bits / source.mean_bits);
        }
    }

    /// Ends the search of a slot also when `limit` has passed since its step began; by default no clock is read.
    pub fn limit(&mut self, limit: Option<Duration>) {
        self.limit = limit;
    }

    /// Looks ahead from `slot`, with the UAV at `position` and the queues `queues_bits` [bit], by id: takes up the
    /// carried plan, or makes one, improves it, and takes its first slot off. `None` if no SN that can lose data can be
    /// reached in time.
    ///
    /// Without a limit the search stops after the scenario's number of steps, not after a time. It draws from the slot's
    /// own random stream: the result depends on the arguments and the carried plan alone.
    #[must_use]
    pub fn step(&mut self, slot: u64, position: &Position, queues_bits: &[u32]) -> Option<Next> {
        let budget = Budget::from_now(self.iterations, self.limit);
        let world = &self.world;
        if world.sources.is_empty() {
            return None;
        }
        let mut forecast = Forecast::new(world, self.outlook(slot, position, queues_bits));
        if self.carried.is_empty() {
            self.begin(&mut forecast);
        } else {
            forecast.load(world, self.carried.iter().copied());
            start::extend(world, &mut forecast);
        }
        self.improve(slot, &mut forecast, budget);
        self.carried.clear();
        let legs = &forecast.trace().legs;
        self.carried.extend(legs.iter().filter(|leg| leg.end > 1).map(|leg| leg.place));
        next(&self.world, &forecast)
    }

    /// Makes a first plan: the best of several, where it loses more than it must also of the best sets of every slot.
    fn begin(&mut self, forecast: &mut Forecast) {
        self.world.forget_added();
        start::begin(&self.world, forecast);
        if forecast.loss_bits <= lower_bound(&self.world, forecast.outlook()) {
            return;
        }
        if let Some(stops) = roll_out(&self.world, forecast.outlook()) {
            let (begun_bits, begun) = (forecast.loss_bits, forecast.places());
            let first = self.world.places.len() as u32;
            self.world.add(stops);
            forecast.load(&self.world, first..self.world.places.len() as u32);
            if begun_bits <= forecast.loss_bits {
                self.world.forget_added();
                forecast.load(&self.world, begun.into_iter());
            }
        }
    }

    /// What is to be foreseen from `slot` on.
    fn outlook(&self, slot: u64, position: &Position, queues_bits: &[u32]) -> Outlook {
        let left = (self.slots + 1).saturating_sub(slot).max(1);
        let slots = left.min(self.most_slots);
        let sources = self.world.sources.iter().zip(&self.world.ids);
        let empty = sources.map(|(source, &id)| -f64::from(queues_bits[id as usize]) / source.mean_bits);
        let mut empty: Vec<f64> = empty.collect();
        empty.iter_mut().zip(&self.overdue).for_each(|(empty, overdue)| *empty -= overdue);
        Outlook {
            start: *position,
            empty,
            slots: i32::try_from(slots).expect("a mission has at most 10^9 slots"),
            beyond_slots: (left - slots) as f64,
            revisit_slots: self.world.round_slots,
        }
    }

    /// Anneals the plan; the one it began with stays if the search ends with far more loss.
    ///
    /// The temperature is in proportion to what the plan loses beyond the bound, per stop, and falls with the share of
    /// resource blocks that it leaves free: a cycle of full groups can only be disturbed. It cools after a slot whose
    /// search ended higher and warms up after one whose search ended lower, below a ceiling that falls over the mission.
    fn improve(&mut self, slot: u64, forecast: &mut Forecast, budget: Budget) {
        if self.iterations == 0 {
            return;
        }
        let world = &self.world;
        let legs = &forecast.trace().legs;
        let (stops, places): (f64, Vec<u32>) = (legs.len().max(1) as f64, forecast.places());
        let begun_bits = forecast.loss_bits;
        let outlook = forecast.outlook();
        let least_bits = lower_bound(world, outlook);
        if begun_bits <= least_bits {
            return; // nothing can be better
        }
        let blocks = world.blocks() as f64 * f64::from(outlook.slots);
        let free = (1.0 - forecast.trace().visits.len() as f64 / blocks).max(0.0);
        let freedom = (free / FREE).min(1.0).powi(2);
        let avoidable_bits = (begun_bits - forecast.beyond_bits - least_bits).max(0.0) * freedom;
        // A window that moves on has no end to cool toward.
        let progress = if outlook.beyond_slots > 0.0 { 1.0 } else { slot as f64 / self.slots as f64 };
        let ceiling = HOTTEST * (LAST_CEILING / HOTTEST).powf(progress);
        let far_bits = avoidable_bits / stops * self.heat.min(ceiling);
        let heat = Heat { far_bits, now: 0, far_slots: FAR_SLOTS, near_share: NEAR_SHARE };
        let mut random = self.streams.stream(Purpose::Horizon, slot, 0);
        anneal::anneal(world, forecast, heat, budget, &mut random);
        // Whom a slot serves depends on the queues, and a search takes over what it does not fly again: only flown anew the
        // plan is what the next slot goes on with.
        let found = forecast.places();
        forecast.load(world, found.into_iter());
        let rise_bits = forecast.loss_bits - begun_bits;
        if rise_bits > 0.0 {
            self.heat = (self.heat * COOLING).max(COLDEST);
        } else if rise_bits < 0.0 {
            self.heat = (self.heat * WARMING).min(HOTTEST);
        }
        if rise_bits > avoidable_bits * MOST_RISE {
            forecast.load(world, places.into_iter());
        }
    }
}

impl Checkpoint for Horizon {
    fn save(&self, bytes: &mut Vec<u8>) {
        let added = self.world.added().iter().map(|place| (place.centre.into(), place.members.clone())).collect();
        encode(&Saved { heat: self.heat, added, carried: self.carried.clone() }, bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        let Saved { heat, added, carried } = decode(bytes)?;
        if !(0.0..=HOTTEST).contains(&heat) {
            return Err(CheckpointError::unexpected("heat", heat, "0 to 1"));
        }
        let place = |(centre, members): ([f64; 2], Vec<u32>)| {
            let refusal = || CheckpointError::unexpected("place", format!("{centre:?}"), "one in range of its members");
            let is_finite = centre.iter().all(|coordinate| coordinate.is_finite());
            self.world.place_at(centre.into(), members).filter(|_| is_finite).ok_or_else(refusal)
        };
        let added = added.into_iter().map(place).collect::<Result<Vec<Place>, _>>()?;
        let places = self.world.places.len() - self.world.added().len() + added.len();
        if let Some(stop) = carried.iter().find(|&&stop| stop as usize >= places) {
            return Err(CheckpointError::unexpected("stop", stop, format!("a place below {places}")));
        }
        if self.world.added() != added {
            self.world.forget_added();
            self.world.add(added);
        }
        self.carried = carried;
        self.heat = heat;
        Ok(())
    }
}

/// The first slot of a plan; none if it has no stop.
fn next(world: &World, forecast: &Forecast) -> Option<Next> {
    let trace = forecast.trace();
    let first = trace.legs.first()?;
    let start = forecast.outlook().start;
    // A leg of several slots is flown in equal steps.
    let waypoint = start + (first.at - start) / f64::from(first.end);
    let visits = trace.visits.iter().take_while(|visit| visit.slot == 1);
    let mut ids: Vec<u32> = visits.map(|visit| world.ids[visit.source as usize]).collect();
    ids.sort_unstable();
    let later = trace.legs.iter().find(|leg| leg.end > 1);
    let mut path = vec![waypoint];
    path.extend(trace.legs.iter().filter(|leg| leg.end > 1).map(|leg| leg.at));
    path.dedup();
    path.truncate(PATH);
    let then = later.map(|leg| (leg.at, leg.end - 1));
    Some(Next { waypoint, ids, then, path, loss_bits: forecast.loss_bits })
}
