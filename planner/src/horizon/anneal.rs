//! Simulated annealing of a plan: changes of a few stops, accepted with a probability that falls with the loss they
//! add.

use std::ops::Range;

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use skysink_common::random::{below, fraction};

use super::flight::Leg;
use super::forecast::{FRESH, Forecast};
use super::model::PlanningModel;

/// Longest part of a plan that moves as one.
const LONGEST_MOVED: usize = 40;

/// Slots ahead from which on changes have the full temperature.
const FAR_SLOTS: f64 = 60.0;

/// Temperature of a change in the next slot, as a fraction of that of one far ahead.
const NEAR_FRACTION: f64 = 0.02;

/// Steps between two checks whether a search is over.
const CHECK_STEPS: u32 = 8;

/// The temperature of a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Temperature {
    /// Loss [bit] that is accepted with probability 1/e, for a change at least 60 slots ahead.
    far_bits: f64,
    /// The temperature of a change in the next slot, as a fraction of `far_bits`.
    near_fraction: f64,
}

impl Temperature {
    /// The same temperature [bit] for all changes.
    #[must_use]
    pub fn everywhere(bits: f64) -> Self {
        Self { far_bits: bits, near_fraction: 1.0 }
    }

    /// Lower for changes in the next slots: those at least 60 slots ahead have `far_bits` [bit].
    #[must_use]
    pub fn far_ahead(far_bits: f64) -> Self {
        Self { far_bits, near_fraction: NEAR_FRACTION }
    }

    /// Of a change in `slot` of the window.
    fn at(&self, slot: i32) -> f64 {
        self.far_bits * (f64::from(slot) / FAR_SLOTS).clamp(self.near_fraction, 1.0)
    }
}

/// The indices of up to `steps` steps, until the search `is_over`.
fn steps_until(steps: u32, is_over: impl Fn() -> bool) -> impl Iterator<Item = u32> {
    (0..steps).take_while(move |step| !step.is_multiple_of(CHECK_STEPS) || !is_over())
}

/// Improves the plan of `forecast` by up to `steps` changes, until the search `is_over`.
pub fn anneal(
    model: &PlanningModel,
    forecast: &mut Forecast,
    temperature: Temperature,
    steps: u32,
    is_over: impl Fn() -> bool,
    random: &mut ChaCha8Rng,
) {
    let mut inserted = Vec::new();
    for _ in steps_until(steps, is_over) {
        let legs = &forecast.trace.legs;
        inserted.clear();
        let replaced = Proposal { model, legs, random, inserted: &mut inserted }.draw();
        let slot = legs.get(replaced.start).map_or(forecast.window.slots, |leg| leg.end);
        let limit_bits = forecast.loss_bits - temperature.at(slot) * fraction(random).ln();
        let loss_bits = forecast.attempt(model, replaced.start, replaced.end, &inserted);
        if loss_bits <= limit_bits {
            forecast.accept(loss_bits);
        }
    }
}

/// A proposed change of a plan.
struct Proposal<'a> {
    model: &'a PlanningModel,
    /// The plan.
    legs: &'a [Leg],
    random: &'a mut ChaCha8Rng,
    /// The new stops, as [`Forecast::attempt`] takes them.
    inserted: &'a mut Vec<(u32, u32)>,
}

impl Proposal<'_> {
    /// Any stop of the model.
    fn any(&mut self) -> u32 {
        self.model.stops[below(self.random, self.model.stops.len())]
    }

    /// A stop of the model near that of leg `leg`, or any.
    fn other(&mut self, leg: usize) -> u32 {
        let near = &self.model.neighbours[self.legs[leg].stop as usize];
        if near.is_empty() || below(self.random, 16) == 0 { self.any() } else { near[below(self.random, near.len())] }
    }

    /// The nearest leg with this stop, in one direction from leg `leg`, or in the other if there is none.
    fn nearest(&mut self, leg: usize, stop: u32) -> Option<usize> {
        let after = || self.legs[leg + 1..].iter().position(|other| other.stop == stop).map(|away| leg + 1 + away);
        let before = || self.legs[..leg].iter().rposition(|other| other.stop == stop);
        if self.random.next_u32() & 1 == 0 { after().or_else(before) } else { before().or_else(after) }
    }

    fn keep(&mut self, legs: Range<usize>) {
        self.inserted.extend(legs.map(|leg| (self.legs[leg].stop, leg as u32)));
    }

    fn reverse(&mut self, legs: Range<usize>) {
        self.inserted.extend(legs.rev().map(|leg| (self.legs[leg].stop, FRESH)));
    }

    /// Draws a change: fills `inserted` and returns the legs that it replaces.
    fn draw(&mut self) -> Range<usize> {
        if self.legs.is_empty() {
            let stop = self.any();
            self.inserted.push((stop, FRESH));
            return 0..0;
        }
        let leg = below(self.random, self.legs.len());
        match below(self.random, 100) {
            0..20 => {
                let stop = self.other(leg);
                self.insert(leg, stop)
            }
            20..35 => leg..leg + 1,
            35..50 => {
                let stop = self.other(leg);
                self.replace(leg, stop)
            }
            50..85 => self.move_from(leg),
            _ => self.swap(leg),
        }
    }

    /// Inserts `stop` before or after leg `leg`.
    fn insert(&mut self, leg: usize, stop: u32) -> Range<usize> {
        self.inserted.push((stop, FRESH));
        let at = leg + below(self.random, 2);
        at..at
    }

    /// Stops at `stop` instead.
    fn replace(&mut self, leg: usize, stop: u32) -> Range<usize> {
        self.inserted.push((stop, FRESH));
        leg..leg + 1
    }

    /// Moves a few stops, from leg `leg` on, to after the nearest one at a stop near the first of them; inserts that
    /// stop where the plan has none.
    fn move_from(&mut self, leg: usize) -> Range<usize> {
        let longest = LONGEST_MOVED.min(self.legs.len() - leg);
        let longest = if below(self.random, 2) == 0 { longest.min(3) } else { longest };
        let end = leg + 1 + below(self.random, longest);
        let stop = self.other(leg);
        let Some(target) =
            self.nearest(leg, stop).map(|near| near + 1).filter(|target| !(leg + 1..=end).contains(target))
        else {
            return self.insert(leg, stop);
        };
        let is_reversed = below(self.random, 2) == 0;
        let carry = |proposal: &mut Self| {
            if is_reversed { proposal.reverse(leg..end) } else { proposal.keep(leg..end) }
        };
        if target > end {
            self.keep(end..target);
            carry(self);
            leg..target
        } else {
            carry(self);
            self.keep(target..leg);
            target..end
        }
    }

    /// Exchanges a stop and the nearest one at a stop near it; replaces it by that where the plan has none.
    fn swap(&mut self, leg: usize) -> Range<usize> {
        let stop = self.other(leg);
        let Some(other) = self.nearest(leg, stop) else { return self.replace(leg, stop) };
        let first = leg.min(other);
        let second = leg.max(other);
        self.keep(second..second + 1);
        self.keep(first + 1..second);
        self.keep(first..first + 1);
        first..second + 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    use rand::SeedableRng;
    use skysink_common::geometry::Position;

    use crate::horizon::forecast::PlanningWindow;
    use crate::horizon::tests::model_of;

    #[test]
    fn the_temperature_of_a_change_grows_with_the_slots_ahead() {
        let temperature = Temperature::far_ahead(100.0);
        assert_eq!([0, 1, 30, 60, 500].map(|slot| temperature.at(slot)), [2.0, 2.0, 50.0, 100.0, 100.0]);
    }

    #[test]
    fn a_change_of_equal_loss_is_accepted_at_zero_temperature() {
        // Nobody loses anything within 20 slots, whatever the plan.
        let model = model_of(&[([200.0, 200.0], 1.0), ([240.0, 200.0], 1.0)], 1, 5e6);
        let window = PlanningWindow::new(&model, Position::new(200.0, 200.0), &[0; 2], 20, 0);
        let mut forecast = Forecast::new(&model, window);
        forecast.load(&model, [0]);
        anneal(&model, &mut forecast, Temperature::everywhere(0.0), 50, || false, &mut ChaCha8Rng::seed_from_u64(1));
        assert_ne!(forecast.stops(), [0]);
        assert_eq!(forecast.loss_bits, 0.0);
    }

    #[test]
    fn an_unlimited_search_takes_all_steps() {
        assert!(steps_until(3, || false).eq(0..3));
        assert_eq!(steps_until(0, || false).count(), 0);
    }

    #[test]
    fn a_stopped_search_ends_at_the_next_check() {
        assert_eq!(steps_until(1_000, || true).count(), 0);
        let done = Cell::new(0);
        let late = steps_until(1_000, || done.get() > 0).inspect(|_| done.set(done.get() + 1));
        assert_eq!(late.count(), CHECK_STEPS as usize);
    }
}
