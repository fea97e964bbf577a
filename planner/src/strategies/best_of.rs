//! `best-of`: the strategy that loses least in simulations.
//!
//! From time to time the candidates are simulated from the present state, all with the same draws of what is not known:
//! links, sight, arrivals, and queues and rates that are estimated. The best is followed until the next comparison. A
//! candidate leaves a comparison as soon as the paired differences say that it loses more than another, and the present
//! one is kept unless they say so of it. How often they are compared follows from a mean number of simulated slots in a
//! slot.

use std::time::{Duration, Instant};

use nalgebra::Point3;
use serde::{Deserialize, Serialize};
use skysink_common::belief::Belief;
use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode, encode};
use skysink_common::keys::Accepts;
use skysink_common::message::FlightReport;

use super::{
    drift_plus_penalty, edf, exact, gfs, hover, look_ahead, max_age_first, max_weight, mes, tour, uts_wide, whittle,
};
use crate::neighbours::PlannedVisit;
use crate::operator_counts::OperatorCounts;
use crate::plan::keys::HorizonKeys;
use crate::planner::Planner;
use crate::simulation::{Drawn, Simulator};
use crate::strategy::{Decision, Registered, Setup, Strategy, Timing, View};

/// The strategy in the registry.
pub const STRATEGY: Registered =
    Registered::new("best-of", "whichever other strategy loses least in simulations of what may come", |setup| {
        let keys: BestOfKeys = setup.scenario.planner_keys("planner.best-of").expect("they were checked");
        best_of(setup, HorizonKeys::of(keys.iterations), keys)
    })
    .with_state()
    .with_path()
    .with_keys::<BestOfKeys>();

skysink_common::keys! {
    /// `[planner.best-of]`.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct BestOfKeys {
        /// Search steps in each slot of the look-ahead, while it is followed.
        iterations: u32 = 6000, Accepts::Whole(0, 1_000_000_000);
        /// Slots that are simulated in the mean of a slot.
        simulated_slots: u32 = 50, Accepts::Whole(1, 1_000_000_000);
        /// Slots that a simulation looks ahead, at most.
        window: u32 = 100, Accepts::Whole(1, 1_000_000);
    }
}

impl Default for BestOfKeys {
    fn default() -> Self {
        Self { iterations: 6000, simulated_slots: 50, window: 100 }
    }
}

/// The candidates that plan slot by slot.
const OF_ONE_SLOT: [Registered; 11] = [
    max_weight::STRATEGY,
    drift_plus_penalty::STRATEGY,
    exact::STRATEGY,
    gfs::STRATEGY,
    mes::STRATEGY,
    tour::STRATEGY,
    hover::STRATEGY,
    uts_wide::STRATEGY,
    edf::STRATEGY,
    whittle::STRATEGY,
    max_age_first::STRATEGY,
];

/// Most sensor nodes: beyond that one strategy takes all the time of a slot.
const MOST_SENSORS: usize = 2_000;

/// Search steps of the simulated look-ahead in each slot: a part of those of the look-ahead, so that the simulations of
/// a slot take fewer, and at most so many.
const SHORT_SEARCH_PART: u32 = 100;
const SHORT_SEARCH: u32 = 60;

/// Draws after which candidates that are clearly worse leave a comparison, and most draws of one.
const DRAWS: u32 = 4;
const MOST_DRAWS: u32 = 16;

/// Standard errors of a paired difference beyond which a candidate is worse.
const CLEARLY: f64 = 2.5;

/// Longest comparison in a paced mission, as a fraction of the slot.
const PACED: f64 = 0.2;

/// A strategy that may be followed.
struct Candidate {
    /// As it flies.
    strategy: Box<dyn Strategy>,
    is_stateless: bool,
    /// As it is simulated.
    planner: Planner,
    /// What it lost in each draw of the last comparison it was in [bit].
    lost_bits: Vec<f64>,
}

/// The state in a checkpoint.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
struct State {
    /// Which candidate is followed.
    followed: usize,
    /// The slot of the next comparison.
    next: u64,
}

/// The strategy that follows the best of several.
pub struct BestOf {
    simulator: Simulator,
    candidates: Vec<Candidate>,
    keys: BestOfKeys,
    slots: u64,
    slot_s: f64,
    state: State,
}

/// The choice among the look-ahead with these `ahead` keys and the strategies of one slot; the look-ahead alone where
/// nothing can be simulated, another objective than the loss counts, or there are too many sensor nodes.
pub(crate) fn best_of(setup: &Setup<'_>, ahead: HorizonKeys, keys: BestOfKeys) -> Box<dyn Strategy> {
    let may_compare = setup.settings.objective.is_loss() && setup.table.sensors.count() <= MOST_SENSORS;
    let simulator = Simulator::of(setup).filter(|_| may_compare);
    let Some(simulator) = simulator else { return look_ahead::horizon(setup, ahead) };
    let short = HorizonKeys { iterations: (ahead.iterations / SHORT_SEARCH_PART).min(SHORT_SEARCH), ..ahead };
    let candidate = |strategy: Box<dyn Strategy>, simulated: Box<dyn Strategy>, is_stateless: bool| Candidate {
        strategy,
        is_stateless,
        planner: Planner::with(setup, simulated),
        lost_bits: Vec::new(),
    };
    let mut candidates = vec![candidate(look_ahead::horizon(setup, ahead), look_ahead::horizon(setup, short), false)];
    for row in OF_ONE_SLOT {
        candidates.push(candidate((row.make)(setup), (row.make)(setup), row.is_stateless));
    }
    Box::new(BestOf {
        simulator,
        candidates,
        keys,
        slots: setup.scenario.slots,
        slot_s: setup.scenario.slot_s,
        state: State { followed: 0, next: 1 },
    })
}

impl BestOf {
    /// Compares the candidates from the slot of `view` on, and follows the best; returns its decision.
    fn compare(&mut self, view: &View<'_>) -> Option<Decision> {
        let slots = (self.slots + 1).saturating_sub(view.slot).clamp(1, u64::from(self.keys.window));
        let begin = Instant::now();
        let most = Duration::from_secs_f64(self.slot_s * PACED);
        let is_over = || view.stop.requested().is_some() || view.timing == Timing::Paced && begin.elapsed() > most;
        let before: Vec<Vec<u8>> = self.candidates.iter().map(Candidate::saved).collect();
        let first: Vec<Option<Decision>> =
            self.candidates.iter_mut().map(|candidate| candidate.strategy.plan(view)).collect();
        let after: Vec<Vec<u8>> = self.candidates.iter().map(Candidate::saved).collect();
        let mut left: Vec<usize> = (0..self.candidates.len()).collect();
        self.candidates.iter_mut().for_each(|candidate| candidate.lost_bits.clear());
        let mut simulated = 0;
        for draw in 0..MOST_DRAWS {
            let drawn = self.simulator.draw(view, draw, slots);
            for &index in &left {
                let candidate = &mut self.candidates[index];
                let lost_bits = candidate.simulate(view, drawn.clone(), first[index].as_ref(), &after[index]);
                candidate.lost_bits.push(lost_bits);
                simulated += slots;
            }
            if is_over() {
                break;
            }
            if (draw + 1) % DRAWS == 0 {
                self.leave(&mut left);
                if left.len() == 1 {
                    break;
                }
            }
        }
        self.state.followed = self.chosen(&left);
        self.state.next = view.slot + simulated.div_ceil(u64::from(self.keys.simulated_slots));
        for (index, candidate) in self.candidates.iter_mut().enumerate() {
            if index != self.state.followed && !candidate.is_stateless {
                candidate.strategy.restore(&before[index]).expect("it was just saved");
            }
        }
        first[self.state.followed].clone()
    }

    /// Leaves those out that lose clearly more than the best.
    fn leave(&self, left: &mut Vec<usize>) {
        let best = self.best(left);
        left.retain(|&index| !is_worse(&self.candidates[index].lost_bits, &self.candidates[best].lost_bits));
    }

    /// The one of least mean loss, the followed one among equals.
    fn best(&self, left: &[usize]) -> usize {
        let key = |index: &usize| (mean(&self.candidates[*index].lost_bits), *index != self.state.followed);
        let by_loss = |a: &&usize, b: &&usize| key(a).partial_cmp(&key(b)).expect("losses are numbers");
        left.iter().min_by(by_loss).copied().unwrap_or(self.state.followed)
    }

    /// Whom to follow of those that are left.
    fn chosen(&self, left: &[usize]) -> usize {
        if left.contains(&self.state.followed) { self.state.followed } else { self.best(left) }
    }
}

impl Candidate {
    fn saved(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        self.strategy.save(&mut bytes);
        bytes
    }

    /// What is lost in the mission that was drawn [bit], with its `first` decision, `after` which it has this state.
    fn simulate(&mut self, view: &View<'_>, drawn: Drawn, first: Option<&Decision>, after: &[u8]) -> f64 {
        if !self.is_stateless {
            self.planner.strategy.restore(after).expect("it was just saved");
        }
        drawn.fly(view, &mut self.planner, first)
    }
}

fn mean(numbers: &[f64]) -> f64 {
    numbers.iter().sum::<f64>() / numbers.len() as f64
}

/// Whether losses are clearly more than `others`, draw by draw.
fn is_worse(losses: &[f64], others: &[f64]) -> bool {
    let apart: Vec<f64> = losses.iter().zip(others).map(|(a, b)| a - b).collect();
    let middle = mean(&apart);
    let squares: f64 = apart.iter().map(|apart| (apart - middle).powi(2)).sum();
    let error = (squares / (apart.len() as f64 - 1.0) / apart.len() as f64).sqrt();
    middle > CLEARLY * error
}

impl Strategy for BestOf {
    fn plan(&mut self, view: &View<'_>) -> Option<Decision> {
        if view.slot >= self.state.next {
            return self.compare(view);
        }
        self.candidates[self.state.followed].strategy.plan(view)
    }

    fn observe(&mut self, slot: u64, flights: &[FlightReport], belief: &Belief) {
        for candidate in &mut self.candidates {
            candidate.strategy.observe(slot, flights, belief);
        }
    }

    fn path(&self) -> &[Point3<f64>] {
        self.candidates[self.state.followed].strategy.path()
    }

    fn counts(&self) -> Vec<(&'static str, OperatorCounts)> {
        self.candidates.iter().flat_map(|candidate| candidate.strategy.counts()).collect()
    }

    fn visits(&mut self, view: &View<'_>, into: &mut Vec<PlannedVisit>) {
        self.candidates[self.state.followed].strategy.visits(view, into);
    }
}

impl Checkpoint for BestOf {
    fn save(&self, bytes: &mut Vec<u8>) {
        let states: Vec<Vec<u8>> = self.candidates.iter().map(Candidate::saved).collect();
        encode(&(&self.state, states), bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        let (state, states): (State, Vec<Vec<u8>>) = decode(bytes)?;
        let count = self.candidates.len();
        CheckpointError::ensure(state.followed < count && states.len() == count, "these candidates")?;
        let before: Vec<Vec<u8>> = self.candidates.iter().map(Candidate::saved).collect();
        let restored = self
            .candidates
            .iter_mut()
            .zip(&states)
            .try_for_each(|(candidate, state)| candidate.strategy.restore(state));
        if restored.is_err() {
            let back = |(candidate, state): (&mut Candidate, &Vec<u8>)| candidate.strategy.restore(state);
            self.candidates.iter_mut().zip(&before).try_for_each(back).expect("it was just saved");
            return restored;
        }
        self.state = state;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_paired_difference_decides_although_draws_differ_more() {
        let hard_and_easy = [100.0, 900.0, 500.0, 20.0];
        let others = hard_and_easy.map(|bits| bits - 9.0 - bits / 1e3);
        assert!(is_worse(&hard_and_easy, &others) && !is_worse(&others, &hard_and_easy));
        assert!(!is_worse(&hard_and_easy, &hard_and_easy), "equal ones stay");
        assert!(!is_worse(&[10.0, 0.0, 10.0, 0.0], &[0.0, 10.0, 0.0, 9.0]), "nothing is decided");
    }
}
