//! A plan, flown ahead: which loss it leads to, and what a change of it would lead to.
//!
//! Loss depends on the visits alone: between two of them a source loses what does not fit, so that a forecast goes from
//! visit to visit, not from slot to slot. What a change leaves as it was is not flown again.

use skysink_common::geometry::Position;

use super::choice::late_slots;
use super::flight::{Decoder, Leg, Trace, Visit, serve};
use super::states::{Change, Rejoined, States};
use super::world::{Source, World};

/// A stop of a changed plan that the old plan does not have in this order.
pub const FRESH: u32 = u32::MAX;

/// Where a forecast starts and ends.
#[derive(Debug, Clone)]
pub struct Outlook {
    /// Where the UAV is.
    pub start: Position,
    /// When each source was or would have been empty [slot, at most 0].
    pub empty: Vec<f64>,
    /// Slots to look ahead.
    pub slots: i32,
    /// Slots of the mission behind them.
    pub beyond_slots: f64,
    /// Slots until everybody can be served once, from anywhere.
    pub revisit_slots: f64,
}

/// The forecast of a plan.
#[derive(Debug, Clone)]
pub struct Forecast {
    outlook: Outlook,
    trace: Trace,
    /// Expected loss [bit].
    pub loss_bits: f64,
    /// The part of it that is expected behind the last slot, in the plan that was loaded.
    pub beyond_bits: f64,
    change: Change,
    /// New stops in place of a part of the plan: place, and its index in the old plan or [`FRESH`].
    pub window: Vec<(u32, u32)>,
    /// What is expected to have overflowed before the first slot [bit]: it is in no plan's loss.
    sunk_bits: f64,
    decoder: Decoder,
    pub(super) states: States,
    work: Vec<f64>,
    spare: Trace,
}

impl Forecast {
    /// The forecast of an empty plan.
    #[must_use]
    pub fn new(world: &World, outlook: Outlook) -> Self {
        let mut forecast = Self {
            work: outlook.empty.clone(),
            states: States::new(&outlook.empty),
            outlook,
            trace: Trace::default(),
            loss_bits: 0.0,
            beyond_bits: 0.0,
            sunk_bits: 0.0,
            change: Change::default(),
            window: Vec::new(),
            decoder: Decoder::default(),
            spare: Trace::default(),
        };
        let sunk_bits = |(source, empty): (&Source, &f64)| source.overflow_slots(0.0, *empty) * source.mean_bits;
        forecast.sunk_bits = world.sources.iter().zip(&forecast.outlook.empty).map(sunk_bits).sum();
        forecast.loss_bits = forecast.final_loss(world);
        forecast
    }

    /// The plan as flown.
    #[must_use]
    pub fn trace(&self) -> &Trace {
        &self.trace
    }

    /// The stops of the plan.
    #[must_use]
    pub fn places(&self) -> Vec<u32> {
        self.trace.legs.iter().map(|leg| leg.place).collect()
    }

    /// Where it starts and ends.
    #[must_use]
    pub fn outlook(&self) -> &Outlook {
        &self.outlook
    }

    /// When each source is empty, after the last visit.
    pub fn levels(&mut self, world: &World) -> Vec<f64> {
        self.restore(world, self.trace.legs.len());
        self.work.clone()
    }

    /// Brings `work` to the state before leg `leg`; returns the loss until then [bit].
    fn restore(&mut self, world: &World, leg: usize) -> f64 {
        let state = self.states.last_known(leg);
        let mut lost_bits = self.states.load(state, 0, &mut self.work);
        let mut at = self.states.leg(state);
        for state in state + 1.. {
            let to = leg.min(self.states.leg(state));
            for visit in &self.trace.visits[self.first_visit(at)..self.first_visit(to)] {
                lost_bits += serve(world, &mut self.work, visit);
            }
            at = to;
            if to != self.states.leg(state) {
                break;
            }
            self.states.store(state, lost_bits, &self.work);
        }
        lost_bits
    }

    /// Index of the first visit of leg `leg`.
    fn first_visit(&self, leg: usize) -> usize {
        self.trace.legs.get(leg).map_or(self.trace.visits.len(), |leg| leg.first as usize)
    }

    /// What is lost after the last visit [bit], from the state `work`.
    fn final_loss(&self, world: &World) -> f64 {
        let end = f64::from(self.outlook.slots);
        let mut lost_bits = 0.0;
        for (source, empty) in world.sources.iter().zip(&self.work) {
            lost_bits += source.overflow_slots(end, *empty) * source.mean_bits;
        }
        lost_bits - self.sunk_bits + self.beyond(world)
    }

    /// What is lost behind the last slot [bit], from the state `work`.
    fn beyond(&self, world: &World) -> f64 {
        let end = f64::from(self.outlook.slots);
        let mut lost_bits = 0.0;
        if self.outlook.beyond_slots > 0.0 {
            let (most, until) = (self.outlook.beyond_slots, self.outlook.revisit_slots);
            for (source, empty) in world.sources.iter().zip(&self.work) {
                let left = (source.fill_slots - (end - empty)).max(0.0);
                lost_bits += late_slots(left, until).min(most) * source.mean_bits;
            }
        }
        lost_bits
    }

    /// Tries the plan in which `window` stands in place of the stops `from..to`; returns its loss [bit].
    pub fn attempt(&mut self, world: &World, from: usize, to: usize) -> f64 {
        let start = from.saturating_sub(1); // the waypoint before a change depends on what comes next
        let mut lost_bits = self.restore(world, start);
        self.resume(world, start);
        let mut change = std::mem::take(&mut self.change);
        change.trace.legs.clear();
        change.trace.visits.clear();
        change.from = start;
        change.rest = None;
        change.rejoined = None;
        let (before, fresh) = (from - start, self.window.len());
        let mut last = None; // index in the old plan, if flown as there
        for step in 0.. {
            let Some((place, old)) = self.item(start, before, fresh, to, step) else {
                break;
            };
            let next = self.item(start, before, fresh, to, step + 1);
            if last.is_some_and(|last| old == FRESH || last + 1 != old) {
                self.resume_in(world, &change.trace);
                last = None;
            }
            if self.as_before(world, old, next, last) {
                let shift = self.decoder.slot - self.end_before(old as usize);
                if step >= before + fresh {
                    change.rest = Some((old as usize, shift));
                    (lost_bits, change.rejoined) = self.repeat(world, old as usize, shift, lost_bits);
                    break;
                }
                let Some(bits) = self.copy_leg(world, old as usize, shift, &mut change.trace) else {
                    break;
                };
                lost_bits += bits;
                last = Some(old);
                continue;
            }
            if last.take().is_some() {
                self.resume_in(world, &change.trace);
            }
            let first = change.trace.visits.len() as u32;
            let stop = (place, next.map(|(next, _)| next));
            let visits = &mut change.trace.visits;
            let Some(bits) = self.decoder.fly(world, stop, self.outlook.slots, &mut self.work, visits) else {
                break;
            };
            lost_bits += bits;
            change.trace.legs.push(Leg { place, end: self.decoder.slot, at: self.decoder.at, first });
        }
        self.change = change;
        lost_bits + self.final_loss(world)
    }

    /// The stop `step` steps after `start` in the changed plan.
    #[inline]
    fn item(&self, start: usize, before: usize, fresh: usize, to: usize, step: usize) -> Option<(u32, u32)> {
        if step >= before && step < before + fresh {
            return Some(self.window[step - before]);
        }
        let old = if step < before { start + step } else { to + step - before - fresh };
        self.trace.legs.get(old).map(|leg| (leg.place, old as u32))
    }

    /// Whether stop `old` of the old plan, followed by `next`, is flown from here as it was.
    #[inline]
    fn as_before(&self, world: &World, old: u32, next: Option<(u32, u32)>, last: Option<u32>) -> bool {
        if old == FRESH {
            return false;
        }
        let index = old as usize;
        let next_old = next.map_or(self.trace.legs.len(), |(_, next)| next as usize);
        let (at, end) = match index.checked_sub(1) {
            Some(before) => (self.trace.legs[before].at, self.trace.legs[before].end),
            None => (self.outlook.start, 0),
        };
        if next_old != index + 1 || at != self.decoder.at {
            return false;
        }
        let leg = &self.trace.legs[index];
        last.is_some() || (leg.end > end && !self.decoder.meets(world, leg.place))
    }

    fn end_before(&self, leg: usize) -> i32 {
        leg.checked_sub(1).map_or(0, |before| self.trace.legs[before].end)
    }

    /// Takes over leg `old`, `shift` slots later; none if it ends too late.
    fn copy_leg(&mut self, world: &World, old: usize, shift: i32, into: &mut Trace) -> Option<f64> {
        let leg = self.trace.legs[old];
        if leg.end + shift > self.outlook.slots {
            return None;
        }
        let end = self.trace.legs.get(old + 1).map_or(self.trace.visits.len(), |leg| leg.first as usize);
        let first = into.visits.len() as u32;
        let mut lost_bits = 0.0;
        for visit in &self.trace.visits[leg.first as usize..end] {
            let visit = Visit { slot: visit.slot + shift, ..*visit };
            lost_bits += serve(world, &mut self.work, &visit);
            into.visits.push(visit);
        }
        into.legs.push(Leg { end: leg.end + shift, first, ..leg });
        (self.decoder.at, self.decoder.slot) = (leg.at, leg.end + shift);
        Some(lost_bits)
    }

    /// Flies the old plan from leg `old` on, `shift` slots later, `lost_bits` having been lost before; returns what is lost
    /// until the end of its last leg [bit].
    ///
    /// As soon as a stored state shows that all queues are as they were then, what follows is known.
    fn repeat(&mut self, world: &World, old: usize, shift: i32, mut lost_bits: f64) -> (f64, Option<Rejoined>) {
        let (end, _) = self.in_time(old, shift);
        let (mut at, mut rejoined) = (old, None);
        for state in self.states.after(old).. {
            let to = end.min(self.states.leg(state));
            for visit in &self.trace.visits[self.first_visit(at)..self.first_visit(to)] {
                lost_bits += serve(world, &mut self.work, &Visit { slot: visit.slot + shift, ..*visit });
            }
            at = to;
            if to == end {
                break;
            }
            let now = self.end_before(at) + shift;
            if let Some(overflowed_bits) = self.states.rejoin(world, state, shift, now, &self.work) {
                let more_bits = lost_bits + overflowed_bits - self.states.lost_bits(state);
                rejoined = Some(Rejoined { state, more_bits });
                let last = self.states.last_known(end);
                lost_bits = self.states.load(last, shift, &mut self.work) + more_bits;
                at = self.states.leg(last);
                break;
            }
        }
        for visit in &self.trace.visits[self.first_visit(at)..self.first_visit(end)] {
            lost_bits += serve(world, &mut self.work, &Visit { slot: visit.slot + shift, ..*visit });
        }
        (lost_bits, rejoined)
    }

    /// Ends of the legs, from leg `old` on, and of their visits, that are in time `shift` slots later.
    fn in_time(&self, old: usize, shift: i32) -> (usize, usize) {
        let last = self.outlook.slots - shift;
        let legs = if shift <= 0 {
            self.trace.legs.len()
        } else {
            old + self.trace.legs[old..].partition_point(|leg| leg.end <= last)
        };
        (legs, self.trace.legs.get(legs).map_or(self.trace.visits.len(), |leg| leg.first as usize))
    }

    /// Puts the decoder before leg `leg` of the plan.
    fn resume(&mut self, world: &World, leg: usize) {
        let slot = self.end_before(leg);
        let at = leg.checked_sub(1).map_or(self.outlook.start, |before| self.trace.legs[before].at);
        let visits = self.trace.legs.get(leg).map_or(self.trace.visits.len(), |leg| leg.first as usize);
        let served = self.trace.visits[..visits].iter().rev().take_while(|visit| visit.slot == slot);
        let stopped = self.trace.legs[..leg].iter().rev().take_while(|leg| leg.end == slot);
        self.decoder.resume(world, at, slot, served.map(|visit| visit.source), stopped);
    }

    /// Puts the decoder behind the last leg of `trace`.
    fn resume_in(&mut self, world: &World, trace: &Trace) {
        let (at, slot) = (self.decoder.at, self.decoder.slot);
        let served = trace.visits.iter().rev().take_while(|visit| visit.slot == slot);
        let stopped = trace.legs.iter().rev().take_while(|leg| leg.end == slot);
        self.decoder.resume(world, at, slot, served.map(|visit| visit.source), stopped);
    }

    /// Makes the last attempt, which leads to a loss of `loss_bits`, the plan.
    pub fn accept(&mut self, loss_bits: f64) {
        let change = &self.change;
        let from = change.from;
        let first = self.trace.legs.get(from).map_or(self.trace.visits.len(), |leg| leg.first as usize);
        let mut spare = std::mem::take(&mut self.spare);
        spare.legs.clear();
        spare.visits.clear();
        if let Some((rest, shift)) = change.rest {
            let begin = self.trace.legs[rest].first;
            let first = (first + change.trace.visits.len()) as u32;
            let (legs, visits) = self.in_time(rest, shift);
            let later = |leg: &Leg| Leg { end: leg.end + shift, first: leg.first - begin + first, ..*leg };
            spare.legs.extend(self.trace.legs[rest..legs].iter().map(later));
            let later = |visit: &Visit| Visit { slot: visit.slot + shift, ..*visit };
            spare.visits.extend(self.trace.visits[begin as usize..visits].iter().map(later));
        }
        self.trace.legs.truncate(from);
        self.trace.visits.truncate(first);
        let moved = |leg: &Leg| Leg { first: leg.first + first as u32, ..*leg };
        self.trace.legs.extend(change.trace.legs.iter().map(moved));
        self.trace.visits.extend_from_slice(&change.trace.visits);
        self.trace.legs.extend_from_slice(&spare.legs);
        self.trace.visits.extend_from_slice(&spare.visits);
        self.spare = spare;
        self.states.change(change, self.trace.legs.len());
        self.loss_bits = loss_bits;
    }

    /// Replaces the plan by `places`, as far as they can be flown in time.
    pub fn load(&mut self, world: &World, places: impl Iterator<Item = u32>) {
        self.trace = Trace::default();
        self.states.forget();
        self.window.clear();
        self.window.extend(places.map(|place| (place, FRESH)));
        let loss_bits = self.attempt(world, 0, 0);
        self.accept(loss_bits);
        self.states.spread(self.trace.legs.len());
        self.beyond_bits = self.beyond(world);
    }
}
