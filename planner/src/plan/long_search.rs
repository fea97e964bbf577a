//! The search before the mission, with any number of steps.

use std::ops::ControlFlow;

use rand_chacha::ChaCha8Rng;
use skysink_common::random::Purpose;

use super::anneal::{Best, Cooling, SearchSteps, SearchStyle, anneal};
use super::carried_plan::CarriedPlan;
use super::forecast::Forecast;
use super::improve::{COOLING, MOST_RISE, REHEATING};
use super::keys::LookAheadPart;
use super::objective::Objective;
use super::start;
use super::timelines::Timelines;
use crate::strategy::View;

/// Parts of the search, each with its temperature.
const ROUNDS: u64 = 400;

/// Those in which the temperature falls; the rest polish the best plan.
const FALLING: u64 = 360;

/// Temperatures between which it falls, as fractions of the mean cost per stop beyond the bound; the last is that of
/// the polish.
const TEMPERATURES: [f64; 2] = [0.2, 0.01];

/// Temperature of the first search in a slot after this one.
const LATER_TEMPERATURE: f64 = 0.02;

/// Most steps of a search. What is more is spent on others from the same plan: they find better ones than a longer
/// search.
const MOST_STEPS: u64 = 5_000_000;

/// Most steps between two calls of `watch`: some milliseconds.
const WATCHED: u64 = 1 << 10;

/// Progress of a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchProgress {
    /// Steps done.
    pub steps: u64,
    /// Cost of the best plan so far: for the loss [bit].
    pub cost: f64,
}

/// Is called with the progress of a search, and may end it.
pub type Watch<'a> = dyn FnMut(SearchProgress) -> ControlFlow<()> + 'a;

/// Result of a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchOutcome {
    /// Cost of the plan: for the loss [bit].
    pub cost: f64,
    /// Steps done.
    pub steps: u64,
    /// Whether the cost of the plan equals the lower bound, which ends the search early.
    pub is_optimal: bool,
}

impl<O: Objective<Style: SearchStyle<O, Store = Timelines<O>>>> CarriedPlan<O> {
    /// Improves the plan of `forecast` by up to `steps` search steps, and carries it. `watch` is called with the
    /// progress; if it ends the search, the result is `None`, and `forecast` is the best plan until then.
    pub(crate) fn prepare(
        &mut self,
        view: &View,
        forecast: &mut Forecast<O>,
        steps: u64,
        watch: &mut Watch<'_>,
    ) -> Option<SearchOutcome> {
        self.prepare_by(MOST_STEPS, view, forecast, steps, watch)
    }

    /// The same by searches of at most `most` steps from the plan of `forecast`, each with other random numbers.
    fn prepare_by(
        &mut self,
        most: u64,
        view: &View,
        forecast: &mut Forecast<O>,
        steps: u64,
        watch: &mut Watch<'_>,
    ) -> Option<SearchOutcome> {
        self.state.has_begun = true;
        let begun = (forecast.cost, forecast.stops());
        let mut best = begun.clone();
        let mut ended = ControlFlow::Continue((0, false));
        for search in 0..steps.div_ceil(most).max(1) {
            let ControlFlow::Continue((done, false)) = ended else { break };
            if search > 0 {
                forecast.load(&self.model, begun.1.iter().copied());
            }
            let mut random = self.streams.stream(Purpose::Horizon, view.slot.saturating_sub(1), search as u32);
            let mut found = begun.clone();
            let least = best.0;
            let watch = &mut |progress: SearchProgress| {
                watch(SearchProgress { steps: done + progress.steps, cost: progress.cost.min(least) })
            };
            ended = self.cool(forecast, &mut found, &mut random, most.min(steps - done), watch);
            ended = ended.map_continue(|(steps, is_optimal)| (done + steps, is_optimal));
            if found.0 < best.0 {
                best = found;
            }
        }
        forecast.load(&self.model, best.1);
        start::extend(&self.model, forecast); // as a planner does when it resumes the plan
        let (steps, is_optimal) = ended.continue_value()?;
        self.stops = forecast.stops();
        self.state.temperature = LATER_TEMPERATURE;
        Some(SearchOutcome { cost: forecast.cost, steps, is_optimal })
    }

    /// Anneals `forecast` by up to `steps` search steps, by a temperature that falls; then polishes the best plan found
    /// between rounds, which it keeps in `best`. Returns the steps done, and whether the bound ended
    /// the search.
    fn cool(
        &mut self,
        forecast: &mut Forecast<O>,
        best: &mut Best,
        random: &mut ChaCha8Rng,
        steps: u64,
        watch: &mut Watch<'_>,
    ) -> ControlFlow<(), (u64, bool)> {
        let model = &mut self.model;
        let bound = forecast.window.least(model);
        let [first, last] = TEMPERATURES;
        let mut adapted = first;
        let mut done = 0;
        for round in 0..ROUNDS {
            watch(SearchProgress { steps: done, cost: best.0 })?;
            if best.0 <= bound {
                break;
            }
            if round == FALLING {
                forecast.load(model, best.1.iter().copied());
            }
            forecast.settle();
            let begun_cost = forecast.cost;
            let begun = forecast.stops();
            let avoidable = (begun_cost - forecast.store.beyond - bound).max(0.0);
            let falling = first * (last / first).powf(round as f64 / FALLING as f64);
            let temperature = match self.keys.without {
                Some(LookAheadPart::Annealing) => 0.0,
                _ if round < FALLING => falling.min(adapted),
                _ => last,
            };
            let far = avoidable / begun.len().max(1) as f64 * temperature;
            let end = steps_before(steps, round + 1);
            while done < end {
                let next = WATCHED.min(end - done);
                let counts = &mut self.counts;
                let mut search = SearchSteps { is_over: &|| false, random: &mut *random, counts, patience: u64::MAX };
                anneal(model, forecast, Cooling::Everywhere(far), next, &mut search, None);
                done += next;
                watch(SearchProgress { steps: done, cost: best.0 })?;
            }
            if forecast.cost < best.0 {
                // A reload may schedule other sensors, which changes the loss.
                let found = forecast.stops();
                forecast.load(model, found.iter().copied());
                if forecast.cost < best.0 {
                    *best = (forecast.cost, found);
                }
            }
            let rise = forecast.cost - begun_cost;
            adapted = if rise > 0.0 { adapted * COOLING } else { (adapted * REHEATING).min(1.0) };
            if rise > avoidable * MOST_RISE {
                forecast.load(model, begun);
            }
        }
        ControlFlow::Continue((done, best.0 <= bound))
    }
}

/// The steps, of `steps` in all, that are done when a round begins.
fn steps_before(steps: u64, round: u64) -> u64 {
    let before = u128::from(steps) * u128::from(round) / u128::from(ROUNDS);
    u64::try_from(before).expect("no more than all steps")
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use skysink_common::scenario::{Overrides, Scenario};
    use skysink_common::sensors::SensorList;
    use skysink_common::stop::Stop;

    use super::*;
    use crate::plan::keys::HorizonKeys;
    use crate::plan::loss::Loss;
    use crate::strategy::OwnedSetup;

    #[test]
    fn of_several_searches_the_best_plan_counts() {
        let text = "name = 'x'\nslots = 100\narea.side_m = 800.0\nsensors.count = 60\nsensors.sampling_bps = 300.0\n";
        let scenario = Scenario::parse(text, Path::new("x.toml"), Overrides::default()).unwrap();
        let list = SensorList::of(&scenario).unwrap();
        let setup = OwnedSetup::new(scenario, &list.nodes()).unwrap();
        let setup = setup.setup();
        let queues_bits = list.queues_bits();
        let stop = Stop::default();
        let view = View::at_start(&setup, &queues_bits, &stop);
        let plan = CarriedPlan::<Loss>::new(&setup, HorizonKeys::of(0));
        let found = |steps: u64, until: u64| {
            let mut plan = plan.clone();
            let mut forecast = plan.forecast(&view).unwrap();
            let mut watched = vec![SearchProgress { steps: 0, cost: f64::INFINITY }];
            let watch = &mut |progress: SearchProgress| {
                let last = watched.last().expect("the first");
                assert!(progress.steps >= last.steps && progress.cost <= last.cost, "{last:?}, then {progress:?}");
                watched.push(progress);
                if progress.steps > until { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            };
            let outcome = plan.prepare_by(10_000, &view, &mut forecast, steps, watch);
            assert!(outcome.is_none_or(|outcome| (outcome.steps, outcome.cost) == (steps, forecast.cost)));
            (outcome.is_some(), forecast.cost)
        };
        let costs = [10_000, 10_001, 20_000, 30_000, 40_000].map(|steps| found(steps, u64::MAX));
        assert!(costs.is_sorted_by(|a, b| a.0 && b.0 && a.1 >= b.1) && costs[4].1 < costs[0].1, "{costs:?}");
        let ended = found(40_000, 15_000); // in the second search, with the best plan until then
        assert!(!ended.0 && ended.1 <= costs[0].1, "{ended:?}");
        let none = found(0, u64::MAX);
        assert!(none.0 && none.1 >= costs[0].1, "{none:?}");
    }
}
