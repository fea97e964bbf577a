//! Stored states of a plan. A change is evaluated from the last state before it to the first state after it that is
//! reached again.

use super::flight::Trace;
use super::model::{PlanningModel, SensorModel};

/// Fewest legs between two stored states.
const STRIDE: usize = 16;

/// Approximate number of stored states of a loaded plan; each takes O(N) memory.
const STATES: usize = 64;

/// States that differ by less [slots] are equal up to rounding.
const ROUNDING: f64 = 1e-9;

/// A stored state of the old plan whose queues a changed plan has reached, at a shift in time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rejoined {
    /// The state.
    pub state: usize,
    /// Additional loss of the changed plan until then, including overflow [bit].
    pub more_bits: f64,
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

/// A state before a leg: when each sensor would have been empty, and the loss until then [bit].
#[derive(Debug, Clone)]
struct State {
    is_known: bool,
    lost_bits: f64,
    empty: Vec<f64>,
}

/// The known states before the legs whose indices are multiples of a stride.
#[derive(Debug, Clone)]
pub struct States {
    stride: usize,
    states: Vec<State>,
    /// The sensor that differed in the last comparison of two states; it is compared first.
    suspect: usize,
}

impl States {
    /// The states of an empty plan that starts from `empty`.
    #[must_use]
    pub fn new(empty: &[f64]) -> Self {
        let start = State { is_known: true, lost_bits: 0.0, empty: empty.to_vec() };
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

    /// Loads `state`, `shift` slots later, into `work`; returns the loss until then [bit].
    pub fn load(&self, state: usize, shift: i32, work: &mut [f64]) -> f64 {
        let State { lost_bits, empty, .. } = &self.states[state];
        work.copy_from_slice(empty);
        later(work, shift);
        *lost_bits
    }

    /// Stores `work` as `state`, with the loss `lost_bits`.
    pub fn store(&mut self, state: usize, lost_bits: f64, work: &[f64]) {
        while self.states.len() <= state {
            self.states.push(State { is_known: false, lost_bits: 0.0, empty: work.to_vec() });
        }
        let stored = &mut self.states[state];
        stored.is_known = true;
        stored.lost_bits = lost_bits;
        stored.empty.copy_from_slice(work);
    }

    /// Compares the queues `work` at the end of slot `now` with `state`, `shift` slots before. If they agree, returns
    /// the additional loss over that state, including the overflow of full queues that were not visited since.
    pub fn rejoin(
        &mut self,
        model: &PlanningModel,
        state: usize,
        shift: i32,
        now: i32,
        work: &[f64],
        lost_bits: f64,
    ) -> Option<Rejoined> {
        let State { lost_bits: stored_bits, empty: stored, .. } =
            self.states.get(state).filter(|state| state.is_known)?;
        if shift != 0 && !model.others.is_empty() {
            return None; // their visits are not shifted
        }
        let then = f64::from(now - shift);
        let now = f64::from(now);
        let differs = |index: usize| {
            let sensor = &model.sensors[index];
            let full = if sensor.is_known() { sensor.fill_slots } else { f64::INFINITY };
            let [own, before] = [(now, work[index]), (then, stored[index])]
                .map(|(slot, empty)| (slot - model.last_empty(index, slot, empty)).min(full));
            (own - before).abs() > ROUNDING
                || (sensor.initial_half_slots > 0.0 || sensor.left_slots > 0.0 || sensor.noise_slots2 > 0.0)
                    && (work[index] <= 0.0) != (stored[index] <= 0.0)
        };
        if work.get(self.suspect).is_some_and(|_| differs(self.suspect)) {
            return None;
        }
        if let Some(sensor) = (0..work.len()).find(|&sensor| differs(sensor)) {
            self.suspect = sensor;
            return None;
        }
        let more_bits = |(index, sensor): (usize, &SensorModel)| {
            let lost_slots = |slot: f64, empty: f64| model.overflow_slots(index, slot, empty).0;
            (lost_slots(now, work[index]) - lost_slots(then, stored[index])) * sensor.cost_bits
        };
        let overflowed_bits: f64 = model.sensors.iter().enumerate().map(more_bits).sum();
        Some(Rejoined { state, more_bits: lost_bits + overflowed_bits - stored_bits })
    }

    /// Keeps the states that are still valid after `change`, which leaves `legs` legs.
    pub(crate) fn change(&mut self, change: &Change, legs: usize) {
        // States keep their indices only if the number of legs has not changed.
        let rejoined = change.rejoined.filter(|_| change.from + change.trace.legs.len() == change.rest);
        let stride = self.stride;
        for (index, state) in self.states.iter_mut().enumerate().skip(change.from / stride + 1) {
            match rejoined {
                Some(rejoined) if index >= rejoined.state && index * stride <= legs => {
                    state.lost_bits += rejoined.more_bits;
                    later(&mut state.empty, change.shift);
                }
                _ => state.is_known = false,
            }
        }
    }
}

/// Shifts the slots in which sensors are empty by `shift`.
fn later(empty: &mut [f64], shift: i32) {
    if shift != 0 {
        empty.iter_mut().for_each(|empty| *empty += f64::from(shift));
    }
}
