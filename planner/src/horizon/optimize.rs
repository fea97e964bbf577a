//! The same search before the mission, with a budget as large as one likes: what is the best known.

use std::ops::ControlFlow;

use skysink_common::geometry::Position;
use skysink_common::random::Purpose;

use super::anneal::{Heat, anneal};
use super::bound::lower_bound;
use super::budget::Budget;
use super::forecast::Forecast;
use super::{COLDEST, COOLING, FAR_SLOTS, HOTTEST, Horizon, LAST_CEILING, MOST_RISE, NEAR_SHARE, WARMING, start};

/// Parts of the budget, each with its temperature.
const ROUNDS: u64 = 400;

/// Those of them that sweep over the mission; the others polish all of it.
const SWEEPING: u64 = 360;

/// Heat of the polish, as a share of what the average stop loses beyond the bound.
const POLISH: f64 = 0.01;

/// How far a search is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Share of its steps that are done, 0 to 1.
    pub share: f64,
    /// Loss [bit] that the best plan so far leads to.
    pub loss_bits: f64,
}

impl Horizon {
    /// Makes the plan that is flown from `slot` on, with the UAV at `position` and the queues `queues_bits` [bit], by id, in
    /// `steps` search steps; returns the loss [bit] that it leads to. `None`, and nothing is planned, if no sensor node that
    /// can lose data can be reached in time, or if `watch`, which is told now and then how far it is, breaks it off.
    pub(crate) fn prepare(
        &mut self,
        (slot, steps): (u64, u64),
        position: &Position,
        queues_bits: &[u32],
        watch: &mut dyn FnMut(Progress) -> ControlFlow<()>,
    ) -> Option<f64> {
        if self.world.sources.is_empty() {
            return None;
        }
        let mut forecast = Forecast::new(&self.world, self.outlook(slot, position, queues_bits));
        self.begin(&mut forecast);
        self.cool(&mut forecast, (slot, steps), watch).continue_value()?;
        self.carried = forecast.places();
        self.heat = COLDEST;
        Some(forecast.loss_bits)
    }

    /// Anneals `forecast` by `steps` search steps as a mission would, but without flying: the part that is still open
    /// shrinks from all slots to none while it cools, and what lies before it freezes. Then all of it is polished. Keeps
    /// the best plan found between rounds.
    fn cool(
        &self,
        forecast: &mut Forecast,
        (slot, steps): (u64, u64),
        watch: &mut dyn FnMut(Progress) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        let world = &self.world;
        let bound_bits = lower_bound(world, forecast.outlook());
        let slots = forecast.outlook().slots as u64;
        let (mut best_bits, mut best) = (forecast.loss_bits, forecast.places());
        let mut random = self.streams.stream(Purpose::Horizon, slot.saturating_sub(1), 0);
        let mut warmth = HOTTEST;
        for round in 0..ROUNDS {
            watch(Progress { share: round as f64 / ROUNDS as f64, loss_bits: best_bits })?;
            if best_bits <= bound_bits {
                break; // nothing can be better
            }
            let (begun_bits, begun) = (forecast.loss_bits, forecast.places());
            let avoidable_bits = (forecast.loss_bits - forecast.beyond_bits - bound_bits).max(0.0);
            let stop_bits = avoidable_bits / best.len().max(1) as f64;
            let heat = if round < SWEEPING {
                let progress = round as f64 / SWEEPING as f64;
                let far_bits = stop_bits * warmth.min(HOTTEST * (LAST_CEILING / HOTTEST).powf(progress));
                let now = i32::try_from(slots * round / SWEEPING).expect("as many slots as an outlook has");
                Heat { far_bits, now, far_slots: FAR_SLOTS, near_share: NEAR_SHARE }
            } else {
                Heat { far_bits: stop_bits * POLISH, now: 0, far_slots: 1.0, near_share: 1.0 }
            };
            if round == SWEEPING {
                forecast.load(world, best.iter().copied());
            }
            anneal(world, forecast, heat, Budget::from_now(part(steps, round), None), &mut random);
            if forecast.loss_bits < best_bits {
                // Flown anew, its slots may serve others; what counts is what comes of that.
                let found = forecast.places();
                forecast.load(world, found.iter().copied());
                if forecast.loss_bits < best_bits {
                    (best_bits, best) = (forecast.loss_bits, found);
                }
            }
            let rise_bits = forecast.loss_bits - begun_bits;
            warmth = if rise_bits > 0.0 { warmth * COOLING } else { (warmth * WARMING).min(HOTTEST) };
            if rise_bits > avoidable_bits * MOST_RISE {
                forecast.load(world, begun.into_iter());
            }
        }
        forecast.load(world, best.into_iter());
        start::extend(world, forecast); // as a planner does that takes the plan up
        ControlFlow::Continue(())
    }
}

/// The steps of a round.
fn part(steps: u64, round: u64) -> u32 {
    let until = |round: u64| u128::from(steps) * u128::from(round) / u128::from(ROUNDS);
    u32::try_from(until(round + 1) - until(round)).unwrap_or(u32::MAX)
}
