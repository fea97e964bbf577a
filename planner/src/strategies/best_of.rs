//! `best-of`: the strategy that loses least in simulations.
//!
//! From time to time the candidates are simulated from the present state, all with the same draws of what is not known:
//! links, sight, arrivals, and queues and rates that are estimated. The best is followed until the next comparison. A
//! candidate leaves a comparison as soon as the paired differences say that it loses more than another, and the present
//! one is kept unless they say so of it. How often they are compared follows from a mean number of simulated slots in a
//! slot. A strategy that is not followed keeps no state: in the next comparison it begins anew.

use std::time::{Duration, Instant};

use nalgebra::Point3;
use serde::{Deserialize, Serialize};
use skysink_common::belief::Belief;
use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode, encode};
use skysink_common::keys::Accepts;
use skysink_common::message::FlightReport;

use super::{
    drift_plus_penalty, edf, exact, gfs, hover, look_ahead, max_age_first, max_weight, mes, tour, uts, uts_wide,
    whittle,
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
        let ahead: HorizonKeys = setup.scenario.planner_keys("planner.horizon").expect("they were checked");
        best_of(setup, HorizonKeys { iterations: keys.iterations, ..ahead }, keys)
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

/// The candidates that plan slot by slot.
const OF_ONE_SLOT: [Registered; 12] = [
    max_weight::STRATEGY,
    drift_plus_penalty::STRATEGY,
    exact::STRATEGY,
    gfs::STRATEGY,
    mes::STRATEGY,
    tour::STRATEGY,
    hover::STRATEGY,
    uts::STRATEGY,
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

/// A comparison counts at most for this part of what is left of the mission, so that short missions are not flown by
/// one that was made when little was known.
const NEXT_PART: u64 = 2;

/// Least part of its loss that a worse candidate loses more.
const LEAST_PART: f64 = 0.01;

/// Time of the simulations in a paced mission, as a fraction of the time for a plan, after which no other draw begins.
const PACED: f64 = 0.2;

/// A strategy that may be followed.
struct Candidate {
    /// As it flies.
    strategy: Box<dyn Strategy>,
    is_stateless: bool,
    /// Its state before the first slot, in which it begins while another one is followed.
    initial: Vec<u8>,
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
    ahead: HorizonKeys,
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
        initial: saved(&*strategy),
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
        ahead,
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
        let first: Vec<Option<Decision>> =
            self.candidates.iter_mut().map(|candidate| candidate.strategy.plan(view)).collect();
        let after: Vec<Vec<u8>> = self.candidates.iter().map(|candidate| saved(&*candidate.strategy)).collect();
        let end = self.end_of_simulations(view);
        let is_over = || view.stop.requested().is_some() || end.is_some_and(|end| Instant::now() > end);
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
            let is_over = is_over();
            if is_over || (draw + 1) % DRAWS == 0 {
                self.leave(&mut left);
                if is_over || self.are_equal(&left) {
                    break;
                }
            }
        }
        self.state.followed = self.chosen(&left);
        let left_slots = (self.slots + 1).saturating_sub(view.slot);
        let wait_slots = simulated.div_ceil(u64::from(self.keys.simulated_slots));
        self.state.next = view.slot.saturating_add(wait_slots.min(left_slots.div_ceil(NEXT_PART)).max(1));
        self.forget_others();
        first[self.state.followed].clone()
    }

    /// When the simulations of the slot of `view` have to end; `None` if they do not.
    fn end_of_simulations(&self, view: &View<'_>) -> Option<Instant> {
        if view.timing != Timing::Paced {
            return None;
        }
        let budget_s = self.ahead.budget(view).map_or(self.slot_s, |budget| budget.as_secs_f64());
        Instant::now().checked_add(Duration::try_from_secs_f64(budget_s * PACED).ok()?)
    }

    /// Lets all that are not followed begin anew, because nobody tells them what others fly.
    fn forget_others(&mut self) {
        for (index, candidate) in self.candidates.iter_mut().enumerate() {
            if index != self.state.followed && !candidate.is_stateless {
                candidate.strategy.restore(&candidate.initial).expect("it was just saved");
            }
        }
    }

    /// Whether nothing is left to compare: one candidate, or equal losses in all draws.
    fn are_equal(&self, left: &[usize]) -> bool {
        left.windows(2).all(|pair| self.candidates[pair[0]].lost_bits == self.candidates[pair[1]].lost_bits)
    }

    /// Leaves those out that lose clearly more than the best.
    fn leave(&self, left: &mut Vec<usize>) {
        let best = self.best(left);
        left.retain(|&index| !is_worse(&self.candidates[index].lost_bits, &self.candidates[best].lost_bits));
    }

    /// The one of least mean loss, the followed one among equals.
    fn best(&self, left: &[usize]) -> usize {
        let lost_bits = |index: &usize| mean(&self.candidates[*index].lost_bits);
        let is_other = |index: &usize| *index != self.state.followed;
        let by_loss =
            |a: &&usize, b: &&usize| lost_bits(a).total_cmp(&lost_bits(b)).then(is_other(a).cmp(&is_other(b)));
        left.iter().min_by(by_loss).copied().unwrap_or(self.state.followed)
    }

    /// Whom to follow of those that are left.
    fn chosen(&self, left: &[usize]) -> usize {
        if left.contains(&self.state.followed) { self.state.followed } else { self.best(left) }
    }
}

/// The state of a strategy.
fn saved(strategy: &dyn Strategy) -> Vec<u8> {
    let mut bytes = Vec::new();
    strategy.save(&mut bytes);
    bytes
}

impl Candidate {
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

/// Whether losses are clearly more than `others`, draw by draw, and by more than a hundredth.
fn is_worse(losses: &[f64], others: &[f64]) -> bool {
    let apart: Vec<f64> = losses.iter().zip(others).map(|(a, b)| a - b).collect();
    let middle = mean(&apart);
    let squares: f64 = apart.iter().map(|apart| (apart - middle).powi(2)).sum();
    let error = (squares / (apart.len() as f64 - 1.0) / apart.len() as f64).sqrt();
    middle > CLEARLY * error && middle > LEAST_PART * mean(losses)
}

impl Strategy for BestOf {
    fn plan(&mut self, view: &View<'_>) -> Option<Decision> {
        if view.slot >= self.state.next && self.simulator.is_possible(view) {
            return self.compare(view);
        }
        self.candidates[self.state.followed].strategy.plan(view)
    }

    fn observe(&mut self, slot: u64, flights: &[FlightReport], belief: &Belief) {
        self.candidates[self.state.followed].strategy.observe(slot, flights, belief); // the others begin anew
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
        encode(&(&self.state, saved(&*self.candidates[self.state.followed].strategy)), bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        let (state, followed): (State, Vec<u8>) = decode(bytes)?;
        CheckpointError::ensure(state.followed < self.candidates.len(), "a candidate")?;
        self.candidates[state.followed].strategy.restore(&followed)?;
        self.state = state;
        self.forget_others();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_paired_difference_decides_although_draws_differ_more() {
        let hard_and_easy = [100.0, 900.0, 500.0, 20.0];
        let others = hard_and_easy.map(|bits| bits - 9.0 - bits / 1e2);
        assert!(is_worse(&hard_and_easy, &others) && !is_worse(&others, &hard_and_easy));
        assert!(!is_worse(&hard_and_easy, &hard_and_easy), "equal ones stay");
        assert!(!is_worse(&[10.0, 0.0, 10.0, 0.0], &[0.0, 10.0, 0.0, 9.0]), "nothing is decided");
        assert!(!is_worse(&[1000.0; 4], &[999.0; 4]), "a thousandth");
    }
}
