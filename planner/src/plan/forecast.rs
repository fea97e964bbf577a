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
//! it is shifted: see [`Timelines`]. Where plans hover, legs depend on the buffers: all that follows a change is flown,
//! from the last of the stored [`States`] before it on.

use skysink_common::geometry::Position;

use super::decoder::{Buffers, Decoder, Leg, Trace, Visit};
use super::groups::PlannedStop;
use super::model::PlanModel;
use super::objective::Objective;
use super::sensor::SensorModel;
use super::states::States;
use super::timelines::{Rest, Timelines};
use super::window::PlanningWindow;

/// Marks an inserted stop without a corresponding leg in the old plan.
pub const FRESH: u32 = u32::MAX;

/// Most stops in sequence that are left out because the battery does not reach them; a plan ends with more.
const MOST_LEFT_OUT: usize = 64;

/// An attempted change: `trace` replaces the legs `from..rest` of the old trace, and the rest is `shift` slots later.
#[derive(Debug, Clone, Default)]
struct Change {
    from: usize,
    trace: Trace,
    rest: usize,
    shift: i32,
    /// Additional energy [J] at the beginning of the rest.
    more_j: f64,
}

/// The forecast of a plan.
#[derive(Debug, Clone)]
pub struct Forecast<O: Objective> {
    /// The planning window.
    pub window: PlanningWindow<O>,
    /// The plan as flown.
    pub trace: Trace,
    /// Its cost.
    pub cost: f64,
    /// What is expected after the window, of the plan as loaded; part of `cost`.
    pub beyond: f64,
    /// Cost of a slot in the air.
    slot_cost: f64,
    /// Whether stops that take no slot stay in the plan where it hovers: later they may take one.
    pub keeps_idle: bool,
    /// The visits after the last stop of the plan that was tried last, where it hovers.
    tail: Vec<Visit>,
    change: Change,
    decoder: Decoder,
    /// Where plans do not hover.
    pub(super) timelines: Timelines<O>,
    /// Where they do, and the buffers.
    states: States<O>,
    work: Vec<O::Level>,
}

impl<O: Objective> Forecast<O> {
    /// The forecast of an empty plan.
    #[must_use]
    pub fn new(model: &PlanModel, window: PlanningWindow<O>) -> Self {
        let work = if O::HOVERS { window.levels.clone() } else { Vec::new() };
        let mut forecast = Self {
            trace: Trace::default(),
            cost: 0.0,
            beyond: 0.0,
            slot_cost: O::slot_cost(&model.sensors, &window.levels, window.slots),
            keeps_idle: true,
            tail: Vec::new(),
            change: Change::default(),
            decoder: Decoder::default(),
            timelines: Timelines::new(model, &window),
            states: States::new(&work),
            work,
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
        self.trace.visits.iter().chain(&self.tail)
    }

    /// The sensors that have, or will have, data, and their queues at the beginning [bit]; none but where plans hover.
    pub fn open(&self, model: &PlanModel) -> Vec<(u32, f64)> {
        let queue_bits = |(sensor, level): (&SensorModel, &O::Level)| O::queue_bits(sensor, *level, 1.0);
        let all = (0..).zip(model.sensors.iter().zip(&self.window.levels).map(queue_bits)).zip(&model.sensors);
        let open = all.filter(|((_, bits), sensor)| O::HOVERS && (*bits > 0.0 || sensor.mean_bits > 0.0));
        open.map(|(open, _)| open).collect()
    }

    /// Sets `work` to the state before leg `leg` of a plan that hovers; returns the cost until then.
    fn restore(&mut self, model: &PlanModel, leg: usize) -> f64 {
        let state = self.states.last_known(leg);
        let mut cost = self.states.load(state, &mut self.work);
        let mut at = self.states.leg(state);
        for state in state + 1.. {
            let to = leg.min(self.states.leg(state));
            for visit in &self.trace.visits[self.trace.first_visit(at)..self.trace.first_visit(to)] {
                cost += Buffers::<O>::serve(&mut self.work, model, visit);
            }
            at = to;
            if to != self.states.leg(state) {
                break;
            }
            self.states.store(state, cost, &self.work);
        }
        cost
    }

    /// Tries the plan with `inserted` instead of the stops `from..to`; returns its cost. Each inserted stop has
    /// its index in the old plan, or [`FRESH`].
    pub fn attempt(&mut self, model: &PlanModel, from: usize, to: usize, inserted: &[(PlannedStop, u32)]) -> f64 {
        let start = from.saturating_sub(1); // the waypoint before a change depends on what comes next
        // The cost until there; where plans do not hover, of the whole plan.
        let mut cost = if O::HOVERS {
            self.restore(model, start)
        } else {
            self.timelines.begin(self.trace.first_visit(start));
            self.cost
        };
        (self.decoder.at, self.decoder.slot, self.decoder.energy_j) = self.begin(start);
        self.decoder.margin_j = start.checked_sub(1).map_or(f64::INFINITY, |before| self.trace.legs[before].margin_j);
        self.decoder.flown_slots = self.window.flown_slots;
        let mut trace = std::mem::take(&mut self.change.trace);
        trace.legs.clear();
        trace.visits.clear();
        let mut change = Change { from: start, trace, rest: self.trace.legs.len(), ..Change::default() };
        let before = from - start;
        let changed = before + inserted.len();
        // The stop after `step` others: its index in the old plan, or `FRESH`.
        let item = |legs: &[Leg], step: usize| {
            if (before..changed).contains(&step) {
                return Some(inserted[step - before]);
            }
            let old = if step < before { start + step } else { to + step - changed };
            legs.get(old).map(|leg| (leg.stop, old as u32))
        };
        let mut last = None; // index of the stop before in the old plan, if flown as there
        for step in 0.. {
            let Some((stop, old)) = item(&self.trace.legs, step) else {
                break;
            };
            let next = item(&self.trace.legs, step + 1);
            let follows = last.take().is_some_and(|last: u32| old != FRESH && last + 1 == old);
            let leg_cost = if self.is_as_before(model, &change, old, next, follows) {
                let (_, slot, energy_j) = self.begin(old as usize);
                let shift = self.decoder.slot - slot;
                // Without end both are infinite.
                let more_j = if self.decoder.energy_j == energy_j { 0.0 } else { self.decoder.energy_j - energy_j };
                if step >= changed {
                    change.rest = old as usize;
                    change.shift = shift;
                    change.more_j = more_j;
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
        if O::HOVERS {
            self.tail.clear();
            let Self { decoder, window, work, tail, .. } = self;
            return cost + decoder.finish::<O>(model, window.slots, self.slot_cost, work, tail);
        }
        cost + self.timelines.added_cost(model, self.rest())
    }

    /// The visits of the plan that follow the last attempt.
    fn rest(&self) -> Rest {
        let Change { rest, shift, .. } = self.change;
        let [from, until] = [rest, self.in_time(rest, shift)].map(|leg| self.trace.first_visit(leg));
        Rest { from, until, shift }
    }

    /// Whether the leg to stop `old` of the old plan, followed by `next`, is unchanged; `follows` if the leg before it
    /// is.
    #[inline]
    fn is_as_before(
        &self,
        model: &PlanModel,
        change: &Change,
        old: u32,
        next: Option<(PlannedStop, u32)>,
        follows: bool,
    ) -> bool {
        if O::HOVERS || old == FRESH {
            return false;
        }
        let index = old as usize;
        let next_old = next.map_or(self.trace.legs.len(), |(_, next)| next as usize);
        let (at, slot, energy_j) = self.begin(index);
        if next_old != index + 1 || at != self.decoder.at {
            return false;
        }
        if let Some(home) = model.table.home.way()
            && ((home.must_land || !model.pad_waits.is_empty()) && slot != self.decoder.slot
                || self.least_margin_j(index) < energy_j - self.decoder.energy_j)
        {
            return false; // the way home may come earlier, or a pad be free
        }
        let leg = &self.trace.legs[index];
        follows || (leg.end > slot && !self.is_met(model, change, leg.stop))
    }

    /// Whether the last slot of `change` serves all live members of `stop` without a stop for them.
    fn is_met(&self, model: &PlanModel, change: &Change, stop: PlannedStop) -> bool {
        let slot = self.decoder.slot;
        let Self { trace: Trace { legs, visits }, .. } = self;
        let visits = change.trace.visits.iter().rev().chain(visits[..self.trace.first_visit(change.from)].iter().rev());
        let legs = change.trace.legs.iter().rev().chain(legs[..change.from].iter().rev());
        let served = visits.take_while(|visit| visit.slot == slot);
        let stopped = legs.take_while(|leg| leg.end == slot);
        model.disks[stop.disk as usize].members.iter().all(|member| {
            if model.sensors[*member as usize].weight == 0.0 {
                return true;
            }
            let is_served = served.clone().any(|visit| visit.sensor == *member);
            is_served && !stopped.clone().any(|leg| model.disks[leg.stop.disk as usize].members.contains(member))
        })
    }

    /// Least margin [J] of the legs from `leg` to the next visit to the base. How long that charges is not adapted to
    /// the energy of a changed plan before it, until the plan is loaded again.
    fn least_margin_j(&self, leg: usize) -> f64 {
        let legs = self.trace.legs[leg..].iter().take_while(|leg| leg.via.is_none());
        legs.map(|leg| leg.margin_j).fold(f64::INFINITY, f64::min)
    }

    /// Position, slot and energy [J] at the beginning of leg `leg`.
    #[inline]
    fn begin(&self, leg: usize) -> (Position, i32, f64) {
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
            cost += self.timelines.serve(model, &visit);
            into.visits.push(visit);
        }
        self.decoder.at = leg.at;
        self.decoder.slot = end;
        self.decoder.energy_j = leg.energy_j;
        self.decoder.margin_j = leg.margin_j;
        Some(cost)
    }

    /// Flies to `stop`, as near to the stop `next` as possible; returns the cost, or `None` if the leg ends after
    /// the window. A stop whose members the last slot serves takes no time.
    fn fly_leg(
        &mut self,
        model: &PlanModel,
        stop: PlannedStop,
        next: Option<PlannedStop>,
        change: &mut Change,
    ) -> Option<f64> {
        let first = change.trace.visits.len() as u32;
        let mut cost = 0.0;
        (self.decoder.via, self.decoder.hovered) = (None, 0);
        let begin = self.decoder.slot;
        if !self.is_idle(model, change, stop) {
            let visits = &mut change.trace.visits;
            let slots = self.window.slots;
            let flown = match O::HOVERS {
                true => self.decoder.fly::<O>(model, stop, next, slots, &mut self.work, visits),
                false => self.decoder.fly::<O>(model, stop, next, slots, &mut self.timelines, visits),
            };
            cost = if O::HOVERS { flown.unwrap_or(0.0) } else { flown? };
            if !O::HOVERS && self.decoder.slot == begin && self.left_out(change) >= MOST_LEFT_OUT {
                return None;
            }
        }
        let Decoder { at, slot: end, hovered, energy_j, margin_j, via, .. } = self.decoder;
        if self.keeps_idle || !O::HOVERS || end > begin {
            change.trace.legs.push(Leg { stop, end, hovered, at, first, energy_j, margin_j, via });
        }
        Some(cost)
    }

    /// Whether there is nothing to do at `stop`: the last slot serves its members, or, where plans hover, its sensor
    /// was served in passing, and the UAV is not on its way there.
    fn is_idle(&self, model: &PlanModel, change: &Change, stop: PlannedStop) -> bool {
        if !O::HOVERS {
            return self.is_met(model, change, stop);
        }
        let is_first = change.from == 0 && change.trace.legs.is_empty();
        let sensor = model.disks[stop.disk as usize].members[0] as usize;
        if model.is_out(stop.disk) {
            return model.is_dead(stop.disk); // a silent one may send again
        }
        let SensorModel { mean_bits, capacity_bits, .. } = model.sensors[sensor];
        let level = self.work[sensor];
        // Of one that was not served what there is when the UAV has come: now it may have sampled nothing yet.
        let away = if O::since(level) > 0.0 {
            1.0
        } else {
            model.table.motion.least_slots_into(&self.decoder.at, model.disk(stop.disk))
        };
        let there_bits = O::queue_bits(&model.sensors[sensor], level, f64::from(self.decoder.slot) + away);
        let is_little = there_bits < capacity_bits.min(2.0 * mean_bits);
        is_little && !(is_first && self.window.under_way == Some(stop.disk))
    }

    /// The number of legs that end in the last slot of `change`.
    fn left_out(&self, change: &Change) -> usize {
        let legs = change.trace.legs.iter().rev().chain(self.trace.legs[..change.from].iter().rev());
        legs.take_while(|leg| leg.end == self.decoder.slot).count()
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
        match O::HOVERS {
            true => self.states.change(self.change.from),
            false => self.timelines.accept(model, &self.change.trace.visits, self.rest()),
        }
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
        self.states.forget();
        self.cost = self.timelines.clear(model);
        let inserted: Vec<(PlannedStop, u32)> = stops.into_iter().map(|stop| (stop, FRESH)).collect();
        let cost = self.attempt(model, 0, 0, &inserted);
        self.accept(model, cost);
        self.states.spread(self.trace.legs.len());
        self.settle();
        self.beyond = self.timelines.cost_beyond(model);
    }

    /// Adds up the cost of the plan again: after many changes it has errors of rounding.
    pub(super) fn settle(&mut self) {
        if !O::HOVERS {
            self.cost = self.timelines.cost();
        }
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
