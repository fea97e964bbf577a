//! Stored states of a plan that hovers. A change is evaluated from the last state before it.

use super::objective::Objective;

/// Fewest legs between two stored states.
const STRIDE: usize = 16;

/// Approximate number of stored states of a loaded plan; each takes O(N) memory.
const STATES: usize = 64;

/// A state before a leg: the buffer of each sensor, and the cost until then.
#[derive(Debug, Clone)]
struct State<O: Objective> {
    is_known: bool,
    cost: f64,
    levels: Vec<O::Level>,
}

/// The known states before the legs whose indices are multiples of a stride.
#[derive(Debug, Clone)]
pub struct States<O: Objective> {
    stride: usize,
    states: Vec<State<O>>,
}

impl<O: Objective> States<O> {
    /// The states of an empty plan that starts from `levels`.
    #[must_use]
    pub fn new(levels: &[O::Level]) -> Self {
        let start = State { is_known: true, cost: 0.0, levels: levels.to_vec() };
        Self { stride: STRIDE, states: vec![start] }
    }

    /// Forgets all but the start.
    pub fn forget(&mut self) {
        self.states[1..].iter_mut().for_each(|state| state.is_known = false);
    }

    /// Chooses the stride for a plan of `legs` legs, and forgets all states but the start.
    pub fn spread(&mut self, legs: usize) {
        self.forget();
        self.stride = STRIDE.max(legs / STATES);
    }

    /// The leg that `state` is before.
    pub fn leg(&self, state: usize) -> usize {
        state * self.stride
    }

    /// The last known state before leg `leg` or an earlier one.
    pub fn last_known(&self, leg: usize) -> usize {
        let mut until = self.states.iter().take(leg / self.stride + 1);
        until.rposition(|state| state.is_known).expect("the start is known")
    }

    /// Loads `state` into `work`; returns the cost until then.
    pub fn load(&self, state: usize, work: &mut [O::Level]) -> f64 {
        let State { cost, levels, .. } = &self.states[state];
        work.copy_from_slice(levels);
        *cost
    }

    /// Stores `work` as `state`, with the cost until then.
    pub fn store(&mut self, state: usize, cost: f64, work: &[O::Level]) {
        while self.states.len() <= state {
            self.states.push(State { is_known: false, cost: 0.0, levels: work.to_vec() });
        }
        let stored = &mut self.states[state];
        stored.is_known = true;
        stored.cost = cost;
        stored.levels.copy_from_slice(work);
    }

    /// Forgets the states that a change of the legs from `leg` on makes invalid.
    pub fn change(&mut self, leg: usize) {
        let stride = self.stride;
        self.states.iter_mut().skip(leg / stride + 1).for_each(|state| state.is_known = false);
    }
}
