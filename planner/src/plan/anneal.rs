//! Simulated annealing of a plan: changes of a few stops, accepted with a probability that falls with the cost they
//! add.

use rand_chacha::ChaCha8Rng;
use skysink_common::random::fraction;

use super::forecast::{Forecast, ForecastStyle};
use super::groups::PlannedStop;
use super::model::PlanModel;
use super::objective::Objective;
use super::operators::{Draft, Operator};
use crate::operator_counts::OperatorCounts;

/// Slots ahead from which on changes have the full temperature.
const FAR_SLOTS: f64 = 60.0;

/// Temperature of a change in the next slot, as a fraction of that of one far ahead.
const NEAR_FRACTION: f64 = 0.02;

/// Steps between two checks whether a search is over.
const CHECK_STEPS: u64 = 8;

/// What a style says of a search.
pub trait SearchStyle<O: Objective<Style = Self>>: ForecastStyle<O> {
    /// The changes that a search proposes. The first inserts a stop, also into an empty plan.
    const OPERATORS: &'static [Operator];
}

/// The temperature of a search: the cost that is accepted with probability 1/e.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Cooling {
    /// The same for all changes.
    Everywhere(f64),
    /// That of a change at least 60 slots ahead, for a plan whose first slot is flown next: lower for changes in the
    /// next slots.
    FarAhead(f64),
    /// Falling from the first step to the last.
    Geometric {
        /// In the first step.
        first: f64,
        /// In the last.
        last: f64,
    },
}

impl Cooling {
    /// Of a change in `slot` of the window, after a fraction `along` of the steps.
    fn at(&self, slot: i32, along: f64) -> f64 {
        match *self {
            Self::Everywhere(temperature) => temperature,
            Self::FarAhead(far) => far * (f64::from(slot) / FAR_SLOTS).clamp(NEAR_FRACTION, 1.0),
            Self::Geometric { first, last } => first * (last / first).powf(along),
        }
    }
}

/// What the steps of a search share.
pub struct SearchSteps<'a> {
    /// Ends it early.
    pub is_over: &'a dyn Fn() -> bool,
    /// Its random numbers.
    pub random: &'a mut ChaCha8Rng,
    /// What became of the proposals, by operator.
    pub counts: &'a mut [OperatorCounts],
    /// Where the best plan is kept: the steps in a row without a better one after which it ends.
    pub patience: u64,
}

/// The best plan of a search, and its cost.
pub type Best = (f64, Vec<PlannedStop>);

/// The indices of up to `steps` steps, until the search `is_over`.
fn steps_until(steps: u64, is_over: impl Fn() -> bool) -> impl Iterator<Item = u64> {
    (0..steps).take_while(move |step| !step.is_multiple_of(CHECK_STEPS) || !is_over())
}

/// Improves the plan of `forecast` by up to `steps` changes, and keeps the best plan in `best`, if it is wanted.
pub fn anneal<O: Objective<Style: SearchStyle<O>>>(
    model: &mut PlanModel,
    forecast: &mut Forecast<O>,
    cooling: Cooling,
    steps: u64,
    search: &mut SearchSteps<'_>,
    mut best: Option<&mut Best>,
) {
    let mut inserted = Vec::new();
    let open = forecast.open(model);
    let least = if best.is_some() { forecast.window.least(model) } else { f64::NEG_INFINITY };
    let mut better = 0; // the step of the best plan
    for step in steps_until(steps, search.is_over) {
        if best.as_ref().is_some_and(|best| best.0 <= least || step - better >= search.patience) {
            break; // nothing can be better, or nothing better is found
        }
        let disks = model.disks.len();
        inserted.clear();
        let legs = &forecast.trace.legs[..];
        let start = forecast.window.start;
        let mut draft = Draft { model, legs, start, open: &open, random: &mut *search.random, inserted: &mut inserted };
        let (operator, replaced) = draft.draw(O::Style::OPERATORS);
        let counts = &mut search.counts[operator];
        counts.proposed += 1;
        let Some(replaced) = replaced else {
            counts.void += 1;
            continue;
        };
        let slot = legs.get(replaced.start).map_or(forecast.window.slots, |leg| leg.end);
        let temperature = cooling.at(slot, step as f64 / steps as f64);
        let limit = forecast.cost - temperature * fraction(search.random).ln();
        let cost = forecast.attempt(model, replaced.start, replaced.end, &inserted);
        if cost > limit || cost.is_nan() {
            model.disks.truncate(disks);
            continue;
        }
        counts.accepted += 1;
        counts.improved += u64::from(cost < forecast.cost);
        forecast.accept(model, cost);
        if let Some(best) = best.as_deref_mut().filter(|best| cost < best.0) {
            *best = (cost, forecast.stops());
            better = step;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    use rand::SeedableRng;

    use super::super::window::PlanningWindow;

    use crate::plan::loss::Loss;
    use crate::plan::tests::{model_of, window_of};

    #[test]
    fn the_temperature_of_a_change_grows_with_the_slots_ahead() {
        let cooling = Cooling::FarAhead(100.0);
        assert_eq!([0, 1, 30, 60, 500].map(|slot| cooling.at(slot, 0.5)), [2.0, 2.0, 50.0, 100.0, 100.0]);
        let falling = Cooling::Geometric { first: 100.0, last: 1.0 };
        assert_eq!([0.0, 0.5, 1.0].map(|along| falling.at(7, along)), [100.0, 10.0, 1.0]);
    }

    #[test]
    fn a_change_of_equal_loss_is_accepted_at_zero_temperature() {
        // Nobody loses anything within 20 slots, whatever the plan.
        let mut model = model_of(&[([200.0, 200.0], 1.0), ([240.0, 200.0], 1.0)], 1, 5e6);
        let mut forecast: Forecast<Loss> =
            Forecast::new(&model, PlanningWindow { levels: vec![0.0; 2], ..window_of(&model, 20) });
        forecast.load(&model, [PlannedStop::at(0)]);
        let mut counts = [OperatorCounts::default(); 5];
        let random = &mut ChaCha8Rng::seed_from_u64(1);
        let mut search = SearchSteps { is_over: &|| false, random, counts: &mut counts, patience: u64::MAX };
        anneal(&mut model, &mut forecast, Cooling::Everywhere(0.0), 50, &mut search, None);
        assert_ne!(forecast.stops(), [PlannedStop::at(0)]);
        assert_eq!(forecast.cost, 0.0);
        let [proposed, accepted] = [|count: &OperatorCounts| count.proposed, |count: &OperatorCounts| count.accepted]
            .map(|of| counts.iter().map(of).sum::<u64>());
        assert_eq!((proposed, accepted), (50, 50), "all of them change nothing");
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
