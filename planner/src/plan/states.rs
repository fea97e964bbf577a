//! Stored states of a plan. A change is evaluated from the last state before it to the first state after it that is
//! reached again.

use super::decoder::Trace;
use super::model::PlanModel;
use super::objective::{Objective, Reached};
use super::sensor::SensorModel;

/// Fewest legs between two stored states.
const STRIDE: usize = 16;

/// Approximate number of stored states of a loaded plan; each takes O(N) memory.
const STATES: usize = 64;

/// A stored state of the old plan whose queues a changed plan has reached, at a shift in time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rejoined {
    /// The state.
    pub state: usize,
    /// Additional cost of the changed plan until then, with that of the gaps up to the state.
    pub more: f64,
}

/// An attempted change: `trace` replaces the legs `from..rest` of the old trace, and the rest is `shift` slots later.
#[derive(Debug, Clone, Default)]
pub(crate) struct Change {
    pub(crate) from: usize,
    pub(crate) trace: Trace,
    pub(crate) rest: usize,
    pub(crate) shift: i32,
    /// Additional energy [J] at the beginning of the rest.
    pub(crate) more_j: f64,
    /// The state from which on the rest is unchanged.
    pub(crate) rejoined: Option<Rejoined>,
}

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
    /// The sensor that differed in the last comparison of two states; it is compared first.
    suspect: usize,
}

impl<O: Objective> States<O> {
    /// The states of an empty plan that starts from `levels`.
    #[must_use]
    pub fn new(levels: &[O::Level]) -> Self {
        let start = State { is_known: true, cost: 0.0, levels: levels.to_vec() };
        Self { stride: STRIDE, states: vec![start], suspect: 0 }
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
    #[must_use]
    pub fn leg(&self, state: usize) -> usize {
        state * self.stride
    }

    /// The first state before leg `leg` or a later one.
    #[must_use]
    pub fn after(&self, leg: usize) -> usize {
        leg.div_ceil(self.stride)
    }

    /// The last known state before leg `leg` or an earlier one.
    #[must_use]
    pub fn last_known(&self, leg: usize) -> usize {
        let mut until = self.states.iter().take(leg / self.stride + 1);
        until.rposition(|state| state.is_known).expect("the start is known")
    }

    /// Loads `state`, `shift` slots later, into `work`; returns the cost until then.
    pub fn load(&self, state: usize, shift: i32, work: &mut [O::Level]) -> f64 {
        let State { cost, levels, .. } = &self.states[state];
        work.copy_from_slice(levels);
        later::<O>(work, shift);
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

    /// Compares the buffers `work` at the end of slot `now` with `state`, `shift` slots before. If they agree, returns
    /// the additional cost over that state, with that of the gaps that have not ended.
    pub fn rejoin(
        &mut self,
        model: &PlanModel,
        state: usize,
        shift: i32,
        now: i32,
        work: &[O::Level],
        cost: f64,
    ) -> Option<Rejoined> {
        let State { cost: stored_cost, levels: stored, .. } = self.states.get(state).filter(|state| state.is_known)?;
        if shift != 0 && !model.others.is_empty() {
            return None; // their visits are not shifted
        }
        let then = f64::from(now - shift);
        let now = f64::from(now);
        let differs = |index: usize| {
            let reached = |slot: f64, visited: O::Level| Reached {
                slot,
                visited,
                level: model.level_at::<O>(index, slot, visited),
            };
            !O::agree(&model.sensors[index], &reached(now, work[index]), &reached(then, stored[index]))
        };
        if work.get(self.suspect).is_some_and(|_| differs(self.suspect)) {
            return None;
        }
        if let Some(sensor) = (0..work.len()).find(|&sensor| differs(sensor)) {
            self.suspect = sensor;
            return None;
        }
        let more = |(index, sensor): (usize, &SensorModel)| {
            let rest = |slot: f64, level: O::Level| model.rest::<O>(index, slot, level);
            (rest(now, work[index]) - rest(then, stored[index])) * O::price(sensor)
        };
        let gaps: f64 = model.sensors.iter().enumerate().map(more).sum();
        Some(Rejoined { state, more: cost + gaps - stored_cost })
    }

    /// Keeps the states that are still valid after `change`, which leaves `legs` legs.
    pub(crate) fn change(&mut self, change: &Change, legs: usize) {
        // States keep their indices only if the number of legs has not changed.
        let rejoined = change.rejoined.filter(|_| change.from + change.trace.legs.len() == change.rest);
        let stride = self.stride;
        for (index, state) in self.states.iter_mut().enumerate().skip(change.from / stride + 1) {
            match rejoined {
                Some(rejoined) if index >= rejoined.state && index * stride <= legs => {
                    state.cost += rejoined.more;
                    later::<O>(&mut state.levels, change.shift);
                }
                _ => state.is_known = false,
            }
        }
    }
}

/// Shifts buffers by `shift` slots.
fn later<O: Objective>(levels: &mut [O::Level], shift: i32) {
    if shift != 0 {
        levels.iter_mut().for_each(|level| *level = O::later(*level, f64::from(shift)));
    }
}
