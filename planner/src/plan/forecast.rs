//! The forecast of a plan: its cost, and that of changes.
//!
//! Costs depend on the visits alone, so a forecast advances from visit to visit, not from slot to slot. Parts of a plan
//! that a change does not affect are not recomputed. [`Forecast::attempt`] evaluates a change in three parts:
//!
//! ```text
//! plan      a b c d e f g h i j k l    stops
//! change    a b x y e f g h i j k l    x and y instead of c and d
//!
//! kept      a                          nothing changes
//! flown       b x y e                  from one stop before the change, because b ends near the stop after it,
//!                                      until a leg begins where it began in the plan, here the one to f
//! repeated            f g h i j k l    the legs of the plan, shifted in time
//! ```
//!
//! Of the sensors those count that the plan or the change visits in the flown part, and those of the repeated part if
//! it is shifted: see [`Timelines`](super::timelines::Timelines). Where plans hover, legs depend on the buffers: all
//! that follows a change is flown, from the last of the stored [`States`](super::states::States) before it on.

use std::fmt::Debug;

use skysink_common::geometry::Position;

use super::decoder::{Buffers, Decoder, DecoderStyle, Leg, Trace, Visit};
use super::groups::PlannedStop;
use super::model::PlanModel;
use super::objective::Objective;
use super::window::PlanningWindow;

/// Marks an inserted stop without a corresponding leg in the old plan.
pub const FRESH: u32 = u32::MAX;

/// An attempted change: `trace` replaces the legs `from..rest` of the old trace, and the rest is `shift` slots later.
#[derive(Debug, Clone, Default)]
pub struct Change {
    pub(super) from: usize,
    pub(super) trace: Trace,
    rest: usize,
    shift: i32,
    /// Additional energy [J] at the beginning of the rest.
    more_j: f64,
}

/// The stops of a changed plan from leg `start` of the old plan on: its stops up to the change, those that are
/// inserted, and its stops from `to` on.
struct ChangedStops<'a> {
    start: usize,
    /// Stops before the change.
    before: usize,
    inserted: &'a [(PlannedStop, u32)],
    to: usize,
}

impl ChangedStops<'_> {
    /// Stops before those of the old plan that follow the change.
    fn changed(&self) -> usize {
        self.before + self.inserted.len()
    }

    /// The stop after `step` others, and its index in the old plan, which has these `legs`, or [`FRESH`].
    #[inline]
    fn get(&self, legs: &[Leg], step: usize) -> Option<(PlannedStop, u32)> {
        let Self { start, before, inserted, to } = *self;
        if (before..self.changed()).contains(&step) {
            return Some(inserted[step - before]);
        }
        let old = if step < before { start + step } else { to + step - self.changed() };
        legs.get(old).map(|leg| (leg.stop, old as u32))
    }
}

/// What follows a change: the visits of the plan from index `from` up to `until`, `shift` slots later.
#[derive(Debug, Clone, Copy)]
pub struct Rest {
    /// The first of them.
    pub from: usize,
    /// The one after the last of them.
    pub until: usize,
    /// Slots by which they are later.
    pub shift: i32,
}

/// The buffers of a plan, and of a change of it.
pub trait Store<O: Objective>: Buffers<O> + Debug + Clone {
    /// Those of an empty plan over `window`.
    fn new(model: &PlanModel, window: &PlanningWindow<O>) -> Self;

    /// Removes all visits of the plan; returns what it then costs.
    fn clear(&mut self, model: &PlanModel) -> f64;

    /// Begins a change of `plan`, which costs `cost`, before its leg `leg`. Returns the cost to which
    /// [`ForecastStyle::end`] and the legs from there on are added.
    fn begin(&mut self, model: &PlanModel, plan: &Trace, leg: usize, cost: f64) -> f64;

    /// Replaces the visits between leg `leg`, where the change begins, and `rest` by `visits`.
    fn accept(&mut self, model: &PlanModel, leg: usize, visits: &[Visit], rest: Rest);

    /// Prepares for the search from a loaded plan of `legs` legs, which costs `cost`; returns its cost, with less
    /// rounding.
    fn loaded(&mut self, model: &PlanModel, legs: usize, cost: f64) -> f64;
}

/// What a style says of a plan and of changes of it.
pub trait ForecastStyle<O: Objective<Style = Self>>: DecoderStyle<O> + Sized {
    /// The buffers of a plan.
    type Store: Store<O>;

    /// The sensors that have, or will have, data, and their queues at the beginning [bit], for the operators.
    fn open(_model: &PlanModel, _window: &PlanningWindow<O>) -> Vec<(u32, f64)> {
        Vec::new()
    }

    /// Whether the leg to stop `old` of the old plan, followed by `next`, is unchanged; `follows` if the leg before
    /// it is.
    #[inline]
    fn is_as_before(
        _forecast: &Forecast<O>,
        _model: &PlanModel,
        _change: &Change,
        _old: u32,
        _next: Option<u32>,
        _follows: bool,
    ) -> bool {
        false
    }

    /// Whether there is nothing to do at `stop`, the next one of `change`.
    fn is_idle(forecast: &Forecast<O>, model: &PlanModel, change: &Change, stop: PlannedStop) -> bool;

    /// The cost of the leg that began after slot `begin`, from what was `flown`; `None` if the plan ends before it.
    fn cost_of_leg(forecast: &Forecast<O>, change: &Change, begin: i32, flown: Option<f64>) -> Option<f64>;

    /// Whether a leg of `slots` slots stays in the plan.
    fn keeps(_store: &Self::Store, _slots: i32) -> bool {
        true
    }

    /// What a change costs after the legs that were flown for it.
    fn end(forecast: &mut Forecast<O>, model: &PlanModel) -> f64;

    /// The visits after the last stop of the plan that was tried last.
    fn tail(_store: &Self::Store) -> &[Visit] {
        &[]
    }
}

/// The store of the style of an objective.
pub type StoreOf<O> = <<O as Objective>::Style as ForecastStyle<O>>::Store;

/// The forecast of a plan.
#[derive(Debug, Clone)]
pub struct Forecast<O: Objective<Style: ForecastStyle<O>>> {
    /// The planning window.
    pub window: PlanningWindow<O>,
    /// The plan as flown.
    pub trace: Trace,
    /// Its cost.
    pub cost: f64,
    change: Change,
    pub(super) decoder: Decoder,
    pub(super) store: StoreOf<O>,
}

impl<O: Objective<Style: ForecastStyle<O>>> Forecast<O> {
    /// The forecast of an empty plan.
    #[must_use]
    pub fn new(model: &PlanModel, window: PlanningWindow<O>) -> Self {
        let mut forecast = Self {
            trace: Trace::default(),
            cost: 0.0,
            change: Change::default(),
            decoder: Decoder::default(),
            store: StoreOf::<O>::new(model, &window),
            window,
        };
        forecast.load(model, []);
        forecast
    }

    /// The stops of the plan.
    pub fn stops(&self) -> Vec<PlannedStop> {
        self.trace.legs.iter().map(|leg| leg.stop).collect()
    }

    /// All visits: those of the stops, and of a plan that was tried last, those after its last stop.
    pub fn visits(&self) -> impl Iterator<Item = &Visit> {
        self.trace.visits.iter().chain(O::Style::tail(&self.store))
    }

    /// The sensors that have, or will have, data, and their queues at the beginning [bit], for the operators.
    pub fn open(&self, model: &PlanModel) -> Vec<(u32, f64)> {
        O::Style::open(model, &self.window)
    }

    /// Tries the plan with `inserted` instead of the stops `from..to`; returns its cost. Each inserted stop has
    /// its index in the old plan, or [`FRESH`].
    pub fn attempt(&mut self, model: &PlanModel, from: usize, to: usize, inserted: &[(PlannedStop, u32)]) -> f64 {
        let start = from.saturating_sub(1); // the waypoint before a change depends on what comes next
        let stops = ChangedStops { start, before: from - start, inserted, to };
        let mut cost = self.store.begin(model, &self.trace, start, self.cost);
        let mut change = self.begin_change(start);
        let mut last = None; // index of the stop before in the old plan, if flown as there
        for step in 0.. {
            let Some((stop, old)) = stops.get(&self.trace.legs, step) else { break };
            let next = stops.get(&self.trace.legs, step + 1);
            let follows = last.take().is_some_and(|last: u32| old != FRESH && last + 1 == old);
            let next_old = next.map(|(_, next)| next);
            let leg_cost = if old != FRESH && O::Style::is_as_before(self, model, &change, old, next_old, follows) {
                let (shift, more_j) = self.moved(old as usize);
                if step >= stops.changed() {
                    change = Change { rest: old as usize, shift, more_j, ..change };
                    break;
                }
                last = Some(old);
                self.copy_leg(model, old as usize, shift, more_j, &mut change.trace)
            } else {
                self.fly_leg(model, stop, next.map(|(next, _)| next), &mut change)
            };
            let Some(leg_cost) = leg_cost else {
                break; // after the end of the window
            };
            cost += leg_cost;
        }
        self.change = change;
        cost + O::Style::end(self, model)
    }

    /// Begins a change before leg `start`: there the decoder resumes the flight.
    fn begin_change(&mut self, start: usize) -> Change {
        let (at, slot, energy_j) = self.begin(start);
        let margin_j = start.checked_sub(1).map_or(f64::INFINITY, |before| self.trace.legs[before].margin_j);
        self.decoder.at = at;
        self.decoder.slot = slot;
        self.decoder.energy_j = energy_j;
        self.decoder.margin_j = margin_j;
        self.decoder.flown_slots = self.window.flown_slots;
        let mut trace = std::mem::take(&mut self.change.trace);
        trace.legs.clear();
        trace.visits.clear();
        Change { from: start, trace, rest: self.trace.legs.len(), ..Change::default() }
    }

    /// The slots by which leg `old` of the old plan begins later now, and the energy [J] that there is more then.
    #[inline]
    fn moved(&self, old: usize) -> (i32, f64) {
        let (_, slot, energy_j) = self.begin(old);
        // Without end both are infinite.
        let more_j = if self.decoder.energy_j == energy_j { 0.0 } else { self.decoder.energy_j - energy_j };
        (self.decoder.slot - slot, more_j)
    }

    /// The visits of the plan that follow the last attempt.
    pub(super) fn rest(&self) -> Rest {
        let Change { rest, shift, .. } = self.change;
        let [from, until] = [rest, self.in_time(rest, shift)].map(|leg| self.trace.first_visit(leg));
        Rest { from, until, shift }
    }

    /// Position, slot and energy [J] at the beginning of leg `leg`.
    #[inline]
    pub(super) fn begin(&self, leg: usize) -> (Position, i32, f64) {
        leg.checked_sub(1).map_or((self.window.start, 0, self.window.energy_j), |before| {
            let before = &self.trace.legs[before];
            (before.at, before.end, before.energy_j)
        })
    }

    /// Copies leg `old`, `shift` slots later and with `more_j` [J] more; returns its cost, or `None` if it ends
    /// after the window.
    fn copy_leg(&mut self, model: &PlanModel, old: usize, shift: i32, more_j: f64, into: &mut Trace) -> Option<f64> {
        let leg = self.trace.legs[old].with_more(more_j);
        let end = leg.end + shift;
        if end > self.window.slots {
            return None;
        }
        let visits = &self.trace.visits[self.trace.first_visit(old)..self.trace.first_visit(old + 1)];
        into.legs.push(Leg { end, first: into.visits.len() as u32, ..leg });
        let mut cost = 0.0;
        for visit in visits.iter().map(|visit| visit.later(shift)) {
            cost += self.store.serve(model, &visit);
            into.visits.push(visit);
        }
        self.decoder.at = leg.at;
        self.decoder.slot = end;
        self.decoder.energy_j = leg.energy_j;
        self.decoder.margin_j = leg.margin_j;
        Some(cost)
    }

    /// Flies to `stop`, as near to the stop `next` as possible; returns the cost, or `None` if the leg ends after
    /// the window. A stop at which there is nothing to do takes no time.
    fn fly_leg(
        &mut self,
        model: &PlanModel,
        stop: PlannedStop,
        next: Option<PlannedStop>,
        change: &mut Change,
    ) -> Option<f64> {
        let first = change.trace.visits.len() as u32;
        let begin = self.decoder.slot;
        self.decoder.via = None;
        self.decoder.hovered = 0;
        let mut cost = 0.0;
        if !O::Style::is_idle(self, model, change, stop) {
            let visits = &mut change.trace.visits;
            let flown = self.decoder.fly::<O>(model, stop, next, self.window.slots, &mut self.store, visits);
            cost = O::Style::cost_of_leg(self, change, begin, flown)?;
        }
        let Decoder { at, slot: end, hovered, energy_j, margin_j, via, .. } = self.decoder;
        if O::Style::keeps(&self.store, end - begin) {
            change.trace.legs.push(Leg { stop, end, hovered, at, first, energy_j, margin_j, via });
        }
        Some(cost)
    }

    /// The end of the legs, from leg `old` on, that end within the window `shift` slots later.
    fn in_time(&self, old: usize, shift: i32) -> usize {
        if shift <= 0 {
            return self.trace.legs.len();
        }
        old + self.trace.legs[old..].partition_point(|leg| leg.end <= self.window.slots - shift)
    }

    /// Accepts the last attempt, whose cost is `cost`, as the plan.
    pub fn accept(&mut self, model: &PlanModel, cost: f64) {
        let rest = self.rest();
        self.store.accept(model, self.change.from, &self.change.trace.visits, rest);
        let end = self.in_time(self.change.rest, self.change.shift);
        let Self { change: Change { from, trace: changed, rest, shift, more_j }, trace, .. } = self;
        let begin = trace.first_visit(*from);
        let rest_begin = trace.first_visit(*rest);
        trace.visits.truncate(trace.first_visit(end));
        trace.legs.truncate(end);
        for leg in &mut trace.legs[*rest..] {
            leg.end += *shift;
            leg.first = leg.first - rest_begin as u32 + (begin + changed.visits.len()) as u32;
        }
        trace.visits[rest_begin..].iter_mut().for_each(|visit| visit.slot += *shift);
        if *more_j != 0.0 {
            let legs = trace.legs[*rest..].iter_mut().take_while(|leg| leg.via.is_none());
            legs.for_each(|leg| *leg = leg.with_more(*more_j));
        }
        let moved = |leg: &Leg| Leg { first: leg.first + begin as u32, ..*leg };
        trace.legs.splice(*from..*rest, changed.legs.iter().map(moved));
        trace.visits.splice(begin..rest_begin, changed.visits.iter().copied());
        self.cost = cost;
    }

    /// Appends `stop`, unless it cannot be served within the window.
    pub fn append(&mut self, model: &PlanModel, stop: PlannedStop) {
        let stops = self.trace.legs.len();
        let cost = self.attempt(model, stops, stops, &[(stop, FRESH)]);
        self.accept(model, cost);
    }

    /// Replaces the plan by `stops`, as far as they can be flown within the window.
    pub fn load(&mut self, model: &PlanModel, stops: impl IntoIterator<Item = PlannedStop>) {
        self.trace = Trace::default();
        self.cost = self.store.clear(model);
        let inserted: Vec<(PlannedStop, u32)> = stops.into_iter().map(|stop| (stop, FRESH)).collect();
        let stops = inserted.len().min(self.window.slots as usize * model.table.limits.blocks());
        self.change.trace.legs.reserve(stops);
        self.change.trace.visits.reserve(stops);
        let cost = self.attempt(model, 0, 0, &inserted);
        self.accept(model, cost);
        self.cost = self.store.loaded(model, self.trace.legs.len(), cost);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::tests::{model_of, window_of};

    #[test]
    fn a_delayed_plan_keeps_its_stops_within_the_window() {
        // 40 m apart, 30 m from the one to the rim of the other: a slot for each stop, from above the first on.
        let model = model_of(&[([200.0, 200.0], 500.0), ([240.0, 200.0], 500.0)], 1, 5e6);
        for (slots, ends) in [(4, vec![1, 2, 3, 4]), (3, vec![1, 2, 3])] {
            let mut forecast = Forecast::new(&model, window_of(&model, slots));
            forecast.load(&model, [0, 1, 0].map(PlannedStop::at));
            let cost = forecast.attempt(&model, 0, 0, &[(PlannedStop::at(0), FRESH)]);
            forecast.accept(&model, cost);
            assert_eq!(forecast.trace.legs.iter().map(|leg| leg.end).collect::<Vec<_>>(), ends);
        }
    }
}
