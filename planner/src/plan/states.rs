//! The buffers of a plan that hovers, with stored states: a change is evaluated from the last state before it.

use super::decoder::{Buffers, Trace, Visit};
use super::forecast::{Rest, Store};
use super::model::PlanModel;
use super::objective::Objective;
use super::window::PlanningWindow;

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

/// The buffers of a plan that hovers, and how it ends.
#[derive(Debug, Clone)]
pub struct HoverStore<O: Objective> {
    states: States<O>,
    /// The buffers of the plan that was tried last, as far as it has come.
    pub(super) levels: Vec<O::Level>,
    /// Cost of a slot in the air.
    pub(super) slot_cost: f64,
    /// Whether stops that take no slot stay in the plan: later they may take one.
    pub keeps_idle: bool,
    /// The visits after the last stop of the plan that was tried last.
    pub(super) tail: Vec<Visit>,
}

impl<O: Objective> Buffers<O> for HoverStore<O> {
    #[inline]
    fn level(&self, sensor: usize) -> O::Level {
        self.levels[sensor]
    }

    #[inline]
    fn serve(&mut self, model: &PlanModel, visit: &Visit) -> f64 {
        Buffers::<O>::serve(&mut self.levels, model, visit)
    }
}

impl<O: Objective> Store<O> for HoverStore<O> {
    fn new(model: &PlanModel, window: &PlanningWindow<O>) -> Self {
        Self {
            states: States::new(&window.levels),
            levels: window.levels.clone(),
            slot_cost: O::slot_cost(&model.sensors, &window.levels, window.slots),
            keeps_idle: true,
            tail: Vec::new(),
        }
    }

    fn clear(&mut self, _: &PlanModel) -> f64 {
        self.states.forget();
        0.0
    }

    /// The cost until the leg. The buffers are then those before it.
    fn begin(&mut self, model: &PlanModel, plan: &Trace, leg: usize, _: f64) -> f64 {
        let state = self.states.last_known(leg);
        let mut cost = self.states.load(state, &mut self.levels);
        let mut at = self.states.leg(state);
        for state in state + 1.. {
            let to = leg.min(self.states.leg(state));
            for visit in &plan.visits[plan.first_visit(at)..plan.first_visit(to)] {
                cost += self.serve(model, visit);
            }
            at = to;
            if to != self.states.leg(state) {
                break;
            }
            self.states.store(state, cost, &self.levels);
        }
        cost
    }

    fn accept(&mut self, _: &PlanModel, leg: usize, _: &[Visit], _: Rest) {
        self.states.change(leg);
    }

    fn loaded(&mut self, _: &PlanModel, legs: usize, cost: f64) -> f64 {
        self.states.spread(legs);
        cost
    }
}
