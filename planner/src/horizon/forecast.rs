//! The forecast of a plan: its predicted loss, and that of changes.
//!
//! Loss depends on the visits alone, so a forecast advances from visit to visit, not from slot to slot. Parts of a plan
//! that a change does not affect are not recomputed. [`Forecast::attempt`] evaluates a change in four parts:
//!
//! ```text
//! plan      a b c d e f g h i j k l    stops; the state of all queues is stored before a, e and i
//! change    a b x y e f g h i j k l    x and y instead of c and d
//!
//! restored  a                          visits served again from the stored state before, without flight
//! flown       b x y e                  from one stop before the change, because b ends near the stop after it,
//!                                      until a leg begins where it began in the plan, here the one to f
//! repeated            f g h            the legs of the plan, shifted in time; their visits are served again
//! rejoined                  i j k l    all queues equal those stored before i, shifted: the rest of the loss is known
//! ```

use skysink_common::geometry::Position;

use super::choice::late_slots;
use super::flight::{Decoder, Leg, Trace, Visit, serve};
use super::model::{PlanningModel, SensorModel};
use super::states::{Change, Rejoined, States};
use crate::bound::window::{WindowField, WindowSensor};

/// Marks an inserted stop without a corresponding leg in the old plan.
pub const FRESH: u32 = u32::MAX;

/// Most stops in sequence that are left out because the battery does not reach them; a plan ends with more.
const MOST_LEFT_OUT: usize = 64;

/// The planning window of a forecast.
#[derive(Debug, Clone)]
pub struct PlanningWindow {
    /// Initial position of the UAV.
    pub start: Position,
    /// By sensor: the slot, at most 0, in which it was or would have been empty.
    pub empty: Vec<f64>,
    /// Slots of the window.
    pub slots: i32,
    /// Slots of the mission after the window.
    pub beyond_slots: f64,
    /// Slots of the mission before the window.
    pub flown_slots: u64,
    /// Energy in the battery at its beginning [J]; infinite without one.
    pub energy_j: f64,
}

impl PlanningWindow {
    /// A window of `slots` slots, followed by `beyond_slots` slots of the mission, with the UAV at `start` and the
    /// queues `queues_bits` [bit], by id.
    ///
    /// # Panics
    /// If there are more slots than an `i32` holds; a mission has at most 10^9.
    #[must_use]
    pub fn new(model: &PlanningModel, start: Position, queues_bits: &[u32], slots: u64, beyond_slots: u64) -> Self {
        let empty = |(sensor, &id): (&SensorModel, &u32)| {
            -f64::from(queues_bits[id as usize]) / sensor.mean_bits - sensor.overdue_slots
        };
        Self {
            start,
            empty: model.sensors.iter().zip(&model.ids).map(empty).collect(),
            slots: i32::try_from(slots).expect("a mission has at most 10^9 slots"),
            beyond_slots: beyond_slots as f64,
            flown_slots: 0,
            energy_j: f64::INFINITY,
        }
    }

    /// The same after `flown_slots` slots, with `energy_j` [J] in the battery.
    #[must_use]
    pub fn with_battery(self, flown_slots: u64, energy_j: f64) -> Self {
        Self { flown_slots, energy_j, ..self }
    }

    /// Lower bound on the loss [bit] of every plan over this window.
    #[must_use]
    pub fn least_loss_bits(&self, model: &PlanningModel) -> f64 {
        if !model.others.is_empty() {
            return 0.0; // the bounds are those of one UAV
        }
        let sensor = |((index, sensor), empty): ((u32, &SensorModel), &f64)| WindowSensor {
            fill_slots: sensor.fill_slots,
            mean_bits: sensor.cost_bits,
            empty: *empty,
            capacity_slots: model.capacity_slots(index, 0.0, true),
        };
        let sensors = (0..).zip(&model.sensors).zip(&self.empty).map(sensor).collect();
        WindowField { sensors, slots: self.slots, blocks: model.table.limits.blocks() }.least_loss_bits()
    }
}

/// The forecast of a plan.
#[derive(Debug, Clone)]
pub struct Forecast {
    /// The planning window.
    pub window: PlanningWindow,
    /// The plan as flown.
    pub trace: Trace,
    /// Expected loss [bit].
    pub loss_bits: f64,
    /// Expected loss after the window, of the plan as loaded [bit]; part of `loss_bits`.
    pub beyond_bits: f64,
    /// Expected overflow before the window [bit], which is not counted as loss.
    sunk_bits: f64,
    change: Change,
    decoder: Decoder,
    pub(crate) states: States,
    work: Vec<f64>,
}

impl Forecast {
    /// The forecast of an empty plan.
    #[must_use]
    pub fn new(model: &PlanningModel, window: PlanningWindow) -> Self {
        let sunk_bits = |(sensor, empty): (&SensorModel, &f64)| sensor.overflow_slots(0.0, *empty) * sensor.cost_bits;
        let mut forecast = Self {
            trace: Trace::default(),
            loss_bits: 0.0,
            beyond_bits: 0.0,
            sunk_bits: model.sensors.iter().zip(&window.empty).map(sunk_bits).sum(),
            change: Change::default(),
            decoder: Decoder::default(),
            states: States::new(&window.empty),
            work: window.empty.clone(),
            window,
        };
        forecast.loss_bits = forecast.final_loss(model);
        forecast
    }

    /// The stops of the plan.
    #[must_use]
    pub fn stops(&self) -> Vec<u32> {
        self.trace.legs.iter().map(|leg| leg.stop).collect()
    }

    /// By sensor: the slot in which it would have been empty, after the last visit.
    pub fn levels(&mut self, model: &PlanningModel) -> Vec<f64> {
        self.restore(model, self.trace.legs.len());
        self.work.clone()
    }

    /// Sets `work` to the state before leg `leg`; returns the loss until then [bit].
    fn restore(&mut self, model: &PlanningModel, leg: usize) -> f64 {
        let state = self.states.last_known(leg);
        let mut lost_bits = self.states.load(state, 0, &mut self.work);
        let mut at = self.states.leg(state);
        for state in state + 1.. {
            let to = leg.min(self.states.leg(state));
            lost_bits = self.serve_legs(model, at, to, 0, lost_bits);
            at = to;
            if to != self.states.leg(state) {
                break;
            }
            self.states.store(state, lost_bits, &self.work);
        }
        lost_bits
    }

    /// Applies the visits of the legs `from..to`, `shift` slots later, to `work`; returns `lost_bits` plus their loss
    /// [bit].
    fn serve_legs(&mut self, model: &PlanningModel, from: usize, to: usize, shift: i32, mut lost_bits: f64) -> f64 {
        for visit in &self.trace.visits[self.trace.first_visit(from)..self.trace.first_visit(to)] {
            lost_bits += serve(model, &mut self.work, &Visit { slot: visit.slot + shift, ..*visit });
        }
        lost_bits
    }

    /// Loss after the last visit [bit], from the state `work`.
    fn final_loss(&self, model: &PlanningModel) -> f64 {
        let end = f64::from(self.window.slots);
        let mut lost_bits = 0.0;
        for (index, (sensor, empty)) in model.sensors.iter().zip(&self.work).enumerate() {
            lost_bits += model.overflow_slots(index, end, *empty).0 * sensor.cost_bits;
        }
        lost_bits - self.sunk_bits + self.beyond(model)
    }

    /// Expected loss after the window [bit], from the state `work`.
    fn beyond(&self, model: &PlanningModel) -> f64 {
        let end = f64::from(self.window.slots);
        let mut lost_bits = 0.0;
        if self.window.beyond_slots > 0.0 {
            for (index, (sensor, empty)) in model.sensors.iter().zip(&self.work).enumerate() {
                let empty = model.last_empty(index, end, *empty);
                let left = (sensor.fill_slots - (end - empty)).max(0.0);
                lost_bits += late_slots(left, model.round_slots).min(self.window.beyond_slots) * sensor.cost_bits;
            }
        }
        lost_bits
    }

    /// Tries the plan with `inserted` instead of the stops `from..to`; returns its loss [bit]. Each inserted stop has
    /// its index in the old plan, or [`FRESH`].
    pub fn attempt(&mut self, model: &PlanningModel, from: usize, to: usize, inserted: &[(u32, u32)]) -> f64 {
        let start = from.saturating_sub(1); // the waypoint before a change depends on what comes next
        let mut lost_bits = self.restore(model, start);
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
            let lost_on_leg_bits = if self.is_as_before(model, &change, old, next, follows) {
                let (_, slot, energy_j) = self.begin(old as usize);
                let shift = self.decoder.slot - slot;
                let has_battery = model.table.home.as_ref().is_some_and(|home| home.battery.is_some());
                let more_j = if has_battery { self.decoder.energy_j - energy_j } else { 0.0 };
                if step >= changed {
                    change.rest = old as usize;
                    change.shift = shift;
                    change.more_j = more_j;
                    (lost_bits, change.rejoined) = self.repeat(model, old as usize, shift, lost_bits);
                    break;
                }
                last = Some(old);
                self.copy_leg(model, old as usize, shift, more_j, &mut change.trace)
            } else {
                self.fly_leg(model, stop, next.map(|(next, _)| next), &mut change)
            };
            let Some(lost_on_leg_bits) = lost_on_leg_bits else {
                break; // after the end of the window
            };
            lost_bits += lost_on_leg_bits;
        }
        self.change = change;
        lost_bits + self.final_loss(model)
    }

    /// Whether the leg to stop `old` of the old plan, followed by `next`, is unchanged; `follows` if the leg before it
    /// is.
    #[inline]
    fn is_as_before(
        &self,
        model: &PlanningModel,
        change: &Change,
        old: u32,
        next: Option<(u32, u32)>,
        follows: bool,
    ) -> bool {
        if old == FRESH {
            return false;
        }
        let index = old as usize;
        let next_old = next.map_or(self.trace.legs.len(), |(_, next)| next as usize);
        let (at, slot, energy_j) = self.begin(index);
        if next_old != index + 1 || at != self.decoder.at {
            return false;
        }
        if let Some(home) = &model.table.home
            && (home.must_land && slot != self.decoder.slot
                || self.least_margin_j(index) < energy_j - self.decoder.energy_j)
        {
            return false; // the way home may come earlier
        }
        let leg = &self.trace.legs[index];
        follows || (leg.end > slot && !self.is_met(model, change, leg.stop))
    }

    /// Whether the last slot of `change` serves all members of `stop` without a stop for them.
    fn is_met(&self, model: &PlanningModel, change: &Change, stop: u32) -> bool {
        let slot = self.decoder.slot;
        let Self { trace: Trace { legs, visits }, .. } = self;
        let visits = change.trace.visits.iter().rev().chain(visits[..self.trace.first_visit(change.from)].iter().rev());
        let legs = change.trace.legs.iter().rev().chain(legs[..change.from].iter().rev());
        let served = visits.take_while(|visit| visit.slot == slot);
        let stopped = legs.take_while(|leg| leg.end == slot);
        model.disks[stop as usize].members.iter().all(|member| {
            let is_served = served.clone().any(|visit| visit.sensor == *member);
            is_served && !stopped.clone().any(|leg| model.disks[leg.stop as usize].members.contains(member))
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

    /// Copies leg `old`, `shift` slots later and with `more_j` [J] more; returns its loss [bit], or `None` if it ends
    /// after the window.
    fn copy_leg(
        &mut self,
        model: &PlanningModel,
        old: usize,
        shift: i32,
        more_j: f64,
        into: &mut Trace,
    ) -> Option<f64> {
        let leg = self.trace.legs[old].with_more(more_j);
        let end = leg.end + shift;
        if end > self.window.slots {
            return None;
        }
        let visits = &self.trace.visits[self.trace.first_visit(old)..self.trace.first_visit(old + 1)];
        into.legs.push(Leg { end, first: into.visits.len() as u32, ..leg });
        into.visits.extend(visits.iter().map(|visit| Visit { slot: visit.slot + shift, ..*visit }));
        self.decoder.at = leg.at;
        self.decoder.slot = end;
        self.decoder.energy_j = leg.energy_j;
        self.decoder.margin_j = leg.margin_j;
        Some(self.serve_legs(model, old, old + 1, shift, 0.0))
    }

    /// Flies to `stop`, as near to the stop `next` as possible; returns the loss [bit], or `None` if the leg ends after
    /// the window. A stop whose members the last slot serves takes no time.
    fn fly_leg(&mut self, model: &PlanningModel, stop: u32, next: Option<u32>, change: &mut Change) -> Option<f64> {
        let first = change.trace.visits.len() as u32;
        let mut lost_bits = 0.0;
        self.decoder.via = None;
        if !self.is_met(model, change, stop) {
            let begin = self.decoder.slot;
            let visits = &mut change.trace.visits;
            lost_bits = self.decoder.fly(model, stop, next, self.window.slots, &mut self.work, visits)?;
            if self.decoder.slot == begin && self.left_out(change) >= MOST_LEFT_OUT {
                return None;
            }
        }
        let Decoder { at, slot: end, energy_j, margin_j, via, .. } = self.decoder;
        change.trace.legs.push(Leg { stop, end, at, first, energy_j, margin_j, via });
        Some(lost_bits)
    }

    /// The number of legs that end in the last slot of `change`.
    fn left_out(&self, change: &Change) -> usize {
        let legs = change.trace.legs.iter().rev().chain(self.trace.legs[..change.from].iter().rev());
        legs.take_while(|leg| leg.end == self.decoder.slot).count()
    }

    /// Repeats the old plan from leg `old` on, `shift` slots later, after a loss of `lost_bits`; returns the loss up to
    /// the end of its last leg [bit].
    ///
    /// As soon as all queues agree with a stored state, the remaining loss is known.
    fn repeat(&mut self, model: &PlanningModel, old: usize, shift: i32, mut lost_bits: f64) -> (f64, Option<Rejoined>) {
        let end = self.in_time(old, shift);
        let mut at = old;
        let mut rejoined = None;
        for state in self.states.after(old).. {
            let to = end.min(self.states.leg(state));
            lost_bits = self.serve_legs(model, at, to, shift, lost_bits);
            at = to;
            if to == end {
                break;
            }
            let now = self.begin(at).1 + shift;
            rejoined = self.states.rejoin(model, state, shift, now, &self.work, lost_bits);
            if let Some(Rejoined { more_bits, .. }) = rejoined {
                let last = self.states.last_known(end);
                lost_bits = self.states.load(last, shift, &mut self.work) + more_bits;
                at = self.states.leg(last);
                break;
            }
        }
        (self.serve_legs(model, at, end, shift, lost_bits), rejoined)
    }

    /// The end of the legs, from leg `old` on, that end within the window `shift` slots later.
    fn in_time(&self, old: usize, shift: i32) -> usize {
        if shift <= 0 {
            return self.trace.legs.len();
        }
        old + self.trace.legs[old..].partition_point(|leg| leg.end <= self.window.slots - shift)
    }

    /// Accepts the last attempt, whose loss is `loss_bits`, as the plan.
    pub fn accept(&mut self, loss_bits: f64) {
        let end = self.in_time(self.change.rest, self.change.shift);
        let Self { change: Change { from, trace: changed, rest, shift, more_j, .. }, trace, .. } = self;
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
        self.states.change(&self.change, self.trace.legs.len());
        self.loss_bits = loss_bits;
    }

    /// Appends `stop`, unless it cannot be served within the window.
    pub fn append(&mut self, model: &PlanningModel, stop: u32) {
        let stops = self.trace.legs.len();
        let loss_bits = self.attempt(model, stops, stops, &[(stop, FRESH)]);
        self.accept(loss_bits);
    }

    /// Replaces the plan by `stops`, as far as they can be flown within the window.
    pub fn load(&mut self, model: &PlanningModel, stops: impl IntoIterator<Item = u32>) {
        self.trace = Trace::default();
        self.states.forget();
        let inserted: Vec<(u32, u32)> = stops.into_iter().map(|stop| (stop, FRESH)).collect();
        let loss_bits = self.attempt(model, 0, 0, &inserted);
        self.accept(loss_bits);
        self.states.spread(self.trace.legs.len());
        self.beyond_bits = self.beyond(model);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::horizon::tests::{model_of, window_of};

    #[test]
    fn a_delayed_plan_keeps_its_stops_within_the_window() {
        // 40 m apart, 30 m from the one to the rim of the other: a slot for each stop, from above the first on.
        let model = model_of(&[([200.0, 200.0], 500.0), ([240.0, 200.0], 500.0)], 1, 5e6);
        for (slots, ends) in [(4, vec![1, 2, 3, 4]), (3, vec![1, 2, 3])] {
            let mut forecast = Forecast::new(&model, window_of(&model, slots));
            forecast.load(&model, [0, 1, 0]);
            let loss_bits = forecast.attempt(&model, 0, 0, &[(0, FRESH)]);
            forecast.accept(loss_bits);
            assert_eq!(forecast.trace.legs.iter().map(|leg| leg.end).collect::<Vec<_>>(), ends);
        }
    }
}
