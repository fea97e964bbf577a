//! The search before the mission, with any number of steps.

use std::ops::ControlFlow;

use skysink_common::random::Purpose;

use super::anneal::{Temperature, anneal};
use super::forecast::Forecast;
use super::{COOLING, Horizon, LookAheadPart, MOST_RISE, REHEATING, start};
use crate::strategy::View;

/// Parts of the search, each with its temperature.
const ROUNDS: u64 = 400;

/// Those in which the temperature falls; the rest polish the best plan.
const FALLING: u64 = 360;

/// Temperatures between which it falls, as fractions of the mean loss per stop beyond the bound; the last is that of the
/// polish.
const TEMPERATURES: [f64; 2] = [0.2, 0.01];

/// Temperature of the first search in a slot after this one.
const LATER_TEMPERATURE: f64 = 0.02;

/// Most steps between two calls of `watch`: some milliseconds.
const WATCHED: u64 = 1 << 10;

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
    /// progress; if it ends the search, the result is `None`, and `forecast` is the best plan until then.
    pub(crate) fn prepare(
        &mut self,
        view: &View,
        forecast: &mut Forecast,
        steps: u64,
        watch: &mut dyn FnMut(SearchProgress) -> ControlFlow<()>,
    ) -> Option<SearchOutcome> {
        self.has_begun = true;
        let mut best = (forecast.loss_bits, forecast.stops());
        let ended = self.cool(forecast, &mut best, view.slot, steps, watch);
        forecast.load(&self.model, best.1);
        start::extend(&self.model, forecast); // as a planner does when it resumes the plan
        let (steps, is_optimal) = ended.continue_value()?;
        self.carried = forecast.stops();
        self.temperature = LATER_TEMPERATURE;
        Some(SearchOutcome { loss_bits: forecast.loss_bits, steps, is_optimal })
    }

    /// Anneals `forecast` by up to `steps` search steps, by a temperature that falls; then polishes the best plan found
    /// between rounds, which it keeps in `best` with its loss [bit]. Returns the steps done, and whether the bound ended
    /// the search.
    fn cool(
        &self,
        forecast: &mut Forecast,
        best: &mut (f64, Vec<u32>),
        slot: u64,
        steps: u64,
        watch: &mut dyn FnMut(SearchProgress) -> ControlFlow<()>,
    ) -> ControlFlow<(), (u64, bool)> {
        let model = &self.model;
        let bound_bits = forecast.window.least_loss_bits(model);
        let mut random = self.streams.stream(Purpose::Horizon, slot.saturating_sub(1), 0);
        let [first, last] = TEMPERATURES;
        let mut adapted = first;
        let mut done = 0;
        for round in 0..ROUNDS {
            watch(SearchProgress { steps: done, loss_bits: best.0 })?;
            if best.0 <= bound_bits {
                break;
            }
            if round == FALLING {
                forecast.load(model, best.1.iter().copied());
            }
            let begun_bits = forecast.loss_bits;
            let begun = forecast.stops();
            let avoidable_bits = (begun_bits - forecast.beyond_bits - bound_bits).max(0.0);
            let falling = first * (last / first).powf(round as f64 / FALLING as f64);
            let temperature = match self.keys.without {
                Some(LookAheadPart::Annealing) => 0.0,
                _ if round < FALLING => falling.min(adapted),
                _ => last,
            };
            let far_bits = avoidable_bits / begun.len().max(1) as f64 * temperature;
            let end = steps_before(steps, round + 1);
            while done < end {
                let next = WATCHED.min(end - done);
                anneal(model, forecast, Temperature::everywhere(far_bits), next as u32, || false, &mut random);
                done += next;
                watch(SearchProgress { steps: done, loss_bits: best.0 })?;
            }
            if forecast.loss_bits < best.0 {
                // A reload may schedule other sensors, which changes the loss.
                let found = forecast.stops();
                forecast.load(model, found.iter().copied());
                if forecast.loss_bits < best.0 {
                    *best = (forecast.loss_bits, found);
                }
            }
            let rise_bits = forecast.loss_bits - begun_bits;
            adapted = if rise_bits > 0.0 { adapted * COOLING } else { (adapted * REHEATING).min(1.0) };
            if rise_bits > avoidable_bits * MOST_RISE {
                forecast.load(model, begun);
            }
        }
        ControlFlow::Continue((done, best.0 <= bound_bits))
    }
}

/// The steps, of `steps` in all, that are done when a round begins.
fn steps_before(steps: u64, round: u64) -> u64 {
    let before = u128::from(steps) * u128::from(round) / u128::from(ROUNDS);
    u64::try_from(before).expect("no more than all steps")
}
