//! The search before the mission, with any number of steps.

use std::ops::ControlFlow;

use skysink_common::random::Purpose;

use super::anneal::{Temperature, anneal};
use super::forecast::Forecast;
use super::{COOLING, Horizon, LAST_CEILING, LEAST_TEMPERATURE, MOST_RISE, NEAR_FRACTION, REHEATING, start};
use crate::strategy::View;

/// Parts of the search, each with its temperature.
const ROUNDS: u64 = 400;

/// Those of them that sweep over the mission; the rest polish the whole plan.
const SWEEPING: u64 = 360;

/// Most steps between two calls of `watch`: some milliseconds.
const WATCHED: u64 = 1 << 14;

/// Temperature of the polish, as a fraction of the mean loss per stop beyond the bound.
const POLISH: f64 = 0.01;

/// Progress of a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchProgress {
    /// Steps done.
    pub steps: u64,
    /// Loss of the best plan so far [bit].
    pub loss_bits: f64,
}

/// Result of a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchOutcome {
    /// Loss of the plan [bit].
    pub loss_bits: f64,
    /// Steps done.
    pub steps: u64,
    /// Whether the loss of the plan equals the lower bound, which ends the search early.
    pub is_optimal: bool,
}

impl Horizon {
    /// Improves the plan of `forecast` by up to `steps` search steps, and carries it. `watch` is called with the
    /// progress; if it ends the search, the result is `None`, and no plan is carried.
    pub(crate) fn prepare(
        &mut self,
        view: &View,
        forecast: &mut Forecast,
        steps: u64,
        watch: &mut dyn FnMut(SearchProgress) -> ControlFlow<()>,
    ) -> Option<SearchOutcome> {
        let (steps, is_optimal) = self.cool(forecast, view.slot, steps, watch).continue_value()?;
        self.carried = forecast.stops();
        self.temperature = LEAST_TEMPERATURE;
        Some(SearchOutcome { loss_bits: forecast.loss_bits, steps, is_optimal })
    }

    /// Anneals `forecast` by up to `steps` search steps. While the temperature falls, the first slot that may change
    /// moves from the beginning of the mission to its end; then the whole plan is polished. Keeps the best plan found
    /// between rounds. Returns the steps done, and whether the bound ended the search.
    fn cool(
        &self,
        forecast: &mut Forecast,
        slot: u64,
        steps: u64,
        watch: &mut dyn FnMut(SearchProgress) -> ControlFlow<()>,
    ) -> ControlFlow<(), (u64, bool)> {
        let model = &self.model;
        let bound_bits = forecast.window.least_loss_bits(model);
        let slots = forecast.window.slots as u64;
        let mut best_bits = forecast.loss_bits;
        let mut best = forecast.stops();
        let mut random = self.streams.stream(Purpose::Horizon, slot.saturating_sub(1), 0);
        let mut adapted: f64 = 1.0;
        let mut done = 0;
        for round in 0..ROUNDS {
            watch(SearchProgress { steps: done, loss_bits: best_bits })?;
            if best_bits <= bound_bits {
                break;
            }
            let begun_bits = forecast.loss_bits;
            let begun = forecast.stops();
            let avoidable_bits = (forecast.loss_bits - forecast.beyond_bits - bound_bits).max(0.0);
            let stop_bits = avoidable_bits / best.len().max(1) as f64;
            let temperature = if round < SWEEPING {
                let far_bits = stop_bits * adapted.min(LAST_CEILING.powf(round as f64 / SWEEPING as f64));
                let now = i32::try_from(slots * round / SWEEPING).expect("as many slots as a window has");
                Temperature { far_bits, now, near_fraction: NEAR_FRACTION }
            } else {
                Temperature { far_bits: stop_bits * POLISH, now: 0, near_fraction: 1.0 }
            };
            if round == SWEEPING {
                forecast.load(model, best.iter().copied());
            }
            let end = steps_before(steps, round + 1);
            while done < end {
                let next = WATCHED.min(end - done);
                anneal(model, forecast, temperature, next as u32, || false, &mut random);
                done += next;
                watch(SearchProgress { steps: done, loss_bits: best_bits })?;
            }
            if forecast.loss_bits < best_bits {
                // A reload may schedule other sensors, which changes the loss.
                let found = forecast.stops();
                forecast.load(model, found.iter().copied());
                if forecast.loss_bits < best_bits {
                    best_bits = forecast.loss_bits;
                    best = found;
                }
            }
            let rise_bits = forecast.loss_bits - begun_bits;
            adapted = if rise_bits > 0.0 { adapted * COOLING } else { (adapted * REHEATING).min(1.0) };
            if rise_bits > avoidable_bits * MOST_RISE {
                forecast.load(model, begun);
            }
        }
        forecast.load(model, best);
        start::extend(model, forecast); // as a planner does when it resumes the plan
        ControlFlow::Continue((done, best_bits <= bound_bits))
    }
}

/// The steps, of `steps` in all, that are done when a round begins.
fn steps_before(steps: u64, round: u64) -> u64 {
    let before = u128::from(steps) * u128::from(round) / u128::from(ROUNDS);
    u64::try_from(before).expect("no more than all steps")
}
