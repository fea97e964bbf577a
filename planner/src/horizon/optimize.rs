//! The same search before the mission, with a budget as large as one likes: what is the best known.

use skysink_common::message::SensorNode;
use skysink_common::random::Purpose;
use skysink_common::scenario::{Scenario, Strategy};

use super::anneal::{Heat, anneal};
use super::bound::{lower_bound, lower_bound_with_way};
use super::forecast::Forecast;
use super::reach::Reachable;
use super::{COLDEST, COOLING, FAR_SLOTS, HOTTEST, Horizon, LAST_CEILING, MOST_RISE, NEAR_SHARE, WARMING, start};
use crate::memory::begin;

/// Parts of the budget, each with its temperature.
const ROUNDS: u64 = 400;

/// Those of them that sweep over the mission; the others polish all of it.
const SWEEPING: u64 = 360;

/// Heat of the polish, as a share of what the average stop loses beyond the bound.
const POLISH: f64 = 0.01;

/// A plan for a whole mission, or its first 600 slots.
#[derive(Debug, Clone, PartialEq)]
pub struct Optimum {
    /// Loss [bit] that it leads to.
    pub loss_bits: f64,
    /// Loss [bit] that no plan avoids.
    pub bound_bits: f64,
    /// The memory of a `horizon` planner that has it, before slot 1: with `horizon_iterations = 0` the planner that recalls
    /// it for slot 0 flies the plan as it is.
    pub memory: Vec<u8>,
}

/// Anneals a plan of the mission by `steps` search steps, from the queues `queues_bits` [bit] before slot 1, by id; `None`
/// if no sensor node that can lose data can be reached in time.
#[must_use]
pub fn optimize(scenario: &Scenario, sensors: &[SensorNode], queues_bits: &[u32], steps: u64) -> Option<Optimum> {
    let mut horizon = Horizon::new(scenario, sensors);
    let world = &horizon.world;
    let mut forecast = Forecast::new(world, horizon.outlook(1, &scenario.uav.start, queues_bits));
    if world.sources.is_empty() {
        return None;
    }
    start::begin(world, &mut forecast);
    let least_bits = cool(&horizon, &mut forecast, steps);
    let bound_bits = lower_bound_with_way(world, forecast.outlook(), &Reachable::new(world)).max(least_bits);
    let loss_bits = forecast.loss_bits;
    horizon.carried = forecast.places();
    horizon.heat = COLDEST;
    let mut memory = Vec::new();
    begin(&mut memory, Strategy::Horizon, 0);
    horizon.remember(&mut memory);
    Some(Optimum { loss_bits, bound_bits, memory })
}

/// Anneals `forecast` by `steps` search steps as a mission would, but without flying: the part that is still open shrinks
/// from all slots to none while it cools, and what lies before it freezes. Then all of it is polished. Keeps the best plan
/// found between rounds; returns the bound [bit] by visits and throughput.
fn cool(horizon: &Horizon, forecast: &mut Forecast, steps: u64) -> f64 {
    let world = &horizon.world;
    let bound_bits = lower_bound(world, forecast.outlook());
    let slots = forecast.outlook().slots as u64;
    let (mut best_bits, mut best) = (forecast.loss_bits, forecast.places());
    let mut random = horizon.streams.stream(Purpose::Horizon, 0, 0);
    let mut warmth = HOTTEST;
    for round in 0..ROUNDS {
        let (begun_bits, begun) = (forecast.loss_bits, forecast.places());
        let avoidable_bits = (forecast.loss_bits - forecast.beyond_bits - bound_bits).max(0.0);
        let stop_bits = avoidable_bits / best.len().max(1) as f64;
        let heat = if round < SWEEPING {
            let progress = round as f64 / SWEEPING as f64;
            let far_bits = stop_bits * warmth.min(HOTTEST * (LAST_CEILING / HOTTEST).powf(progress));
            let now = i32::try_from(slots * round / SWEEPING).expect("at most 600");
            Heat { far_bits, now, far_slots: FAR_SLOTS, near_share: NEAR_SHARE }
        } else {
            Heat { far_bits: stop_bits * POLISH, now: 0, far_slots: 1.0, near_share: 1.0 }
        };
        if round == SWEEPING {
            forecast.load(world, best.iter().copied());
        }
        let now = steps * (round + 1) / ROUNDS - steps * round / ROUNDS;
        anneal(world, forecast, heat, u32::try_from(now).unwrap_or(u32::MAX), &mut random);
        if forecast.loss_bits < best_bits {
            (best_bits, best) = (forecast.loss_bits, forecast.places());
        }
        let rise_bits = forecast.loss_bits - begun_bits;
        warmth = if rise_bits > 0.0 { warmth * COOLING } else { (warmth * WARMING).min(HOTTEST) };
        if rise_bits > avoidable_bits * MOST_RISE {
            forecast.load(world, begun.into_iter());
        }
    }
    forecast.load(world, best.into_iter());
    start::extend(world, forecast); // as a planner does that takes the plan up
    bound_bits
}
