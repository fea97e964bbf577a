//! The visits of a plan by sensor, and what their gaps cost. A change costs more or less for the sensors that it
//! touches alone, so a step of a search takes as long as what it changes.

mod served;

use std::ops::Range;

use super::decoder::{Buffers, Trace, Visit, serve};
use super::forecast::{Forecast, ForecastStyle, Rest, Store};
use super::model::PlanModel;
use super::objective::{Objective, Reached};
use super::window::PlanningWindow;
use served::{Served, Timeline};

/// Shifts [slots] up to which the cost of most gaps is linear: where they are much too long, or not by far.
const NEAR: i32 = 16;

/// The visits of a plan that does not hover, and of a change.
#[derive(Debug, Clone)]
pub struct Timelines<O: Objective> {
    /// The visits by time.
    plan: Vec<Served<O::Level>>,
    /// By sensor.
    timelines: Vec<Timeline<O::Level>>,
    /// By visit: what the plan costs more for each slot that this one and all later ones are later, as far as it is
    /// linear.
    slopes: Vec<f64>,
    /// The visits at which it is not.
    bent: Vec<u32>,
    /// What the plan without visits costs.
    unvisited: f64,
    /// What gaps have cost before the window, which is not counted.
    sunk: f64,
    /// Those that a change adds; working memory.
    fresh: Vec<Served<O::Level>>,
    /// Slots of the window, and of the mission after it.
    slots: f64,
    beyond_slots: f64,
    /// What is expected after the window, of the plan as loaded; part of its cost.
    pub beyond: f64,
    /// The number of the change, the visit with which it begins, and the sensors that it touches.
    change: u64,
    begin: usize,
    touched: Vec<u32>,
    /// The visits of the changed plan whose slopes differ.
    changed: Range<usize>,
}

impl<O: Objective> Buffers<O> for Timelines<O> {
    #[inline]
    fn level(&self, sensor: usize) -> O::Level {
        let timeline = &self.timelines[sensor];
        if timeline.change == self.change { timeline.reached } else { timeline.at(&self.plan, self.begin).0 }
    }

    #[inline]
    fn serve(&mut self, model: &PlanModel, visit: &Visit) -> f64 {
        serve::<O>(model, &mut self.touch(visit.sensor).reached, visit)
    }
}

impl<O: Objective> Store<O> for Timelines<O> {
    fn new(model: &PlanModel, window: &PlanningWindow<O>) -> Self {
        let levels = &window.levels;
        let mut timelines = Self {
            plan: Vec::new(),
            timelines: Vec::with_capacity(levels.len()),
            slopes: vec![0.0],
            bent: Vec::new(),
            unvisited: 0.0,
            sunk: 0.0,
            fresh: Vec::new(),
            slots: f64::from(window.slots),
            beyond_slots: window.beyond_slots,
            beyond: 0.0,
            change: 0,
            begin: 0,
            touched: Vec::new(),
            changed: 0..0,
        };
        for (index, (sensor, &begun)) in model.sensors.iter().zip(levels).enumerate() {
            timelines.sunk += O::rest(sensor, begun, 0.0) * O::price(sensor);
            let end = timelines.end(model, index, begun);
            timelines.timelines.push(Timeline {
                begun,
                visits: Vec::new(),
                change: 0,
                reached: begun,
                nth: 0,
                end,
                end_slope: None,
            });
        }
        timelines.unvisited = timelines.cost();
        timelines
    }

    fn clear(&mut self, model: &PlanModel) -> f64 {
        self.begin_at(0);
        self.accept(model, 0, &[], Rest { from: 0, until: 0, shift: 0 });
        self.unvisited
    }

    /// The cost of the whole plan: of the visits that follow only what they cost more is added.
    #[inline]
    fn begin(&mut self, _: &PlanModel, plan: &Trace, leg: usize, cost: f64) -> f64 {
        self.begin_at(plan.first_visit(leg));
        cost
    }

    fn accept(&mut self, model: &PlanModel, _: usize, visits: &[Visit], rest: Rest) {
        let Rest { from, until, shift } = rest;
        debug_assert!(until == self.plan.len() || shift > 0 || until == 0, "what is left out is after the end");
        self.begin_at(self.begin); // the buffers are those before it again
        (self.begin..from).for_each(|index| self.touch_visited(index));
        (until..self.plan.len()).for_each(|index| _ = self.touch(self.plan[index].visit.sensor));
        self.fresh.reserve(visits.len());
        for (index, &visit) in (self.begin as u32..).zip(visits) {
            let Timeline { visits: own, nth, reached: before, .. } = self.touch(visit.sensor);
            match own.get_mut(*nth).filter(|own| (**own as usize) < from) {
                Some(own) => *own = index,
                None => own.insert(*nth, index),
            }
            let served = Served::new(visit, *before, *nth);
            *nth += 1;
            self.fresh.push(served);
        }
        for &sensor in &self.touched {
            let Timeline { visits: own, nth, .. } = &mut self.timelines[sensor as usize];
            own.truncate(*nth + own[*nth..].partition_point(|visit| (*visit as usize) < until));
            let replaced = own[*nth..].iter().take_while(|visit| (**visit as usize) < from).count();
            own.drain(*nth..*nth + replaced);
            for (nth, &visit) in (*nth as u32..).zip(&own[*nth..]) {
                self.plan[visit as usize].nth = nth;
            }
        }
        self.plan.truncate(until);
        self.plan.splice(self.begin..from, self.fresh.drain(..));
        let new_from = self.begin + visits.len();
        self.changed = self.begin..new_from;
        for touched in 0..self.touched.len() {
            let sensor = self.touched[touched];
            self.follow(model, sensor, self.timelines[sensor as usize].nth, rest, new_from);
        }
        for index in if shift != 0 || new_from != from { new_from..self.plan.len() } else { 0..0 } {
            let Served { visit: Visit { sensor, .. }, nth, .. } = self.plan[index];
            if self.timelines[sensor as usize].change != self.change {
                self.follow(model, sensor, nth as usize, rest, new_from);
            }
        }
        self.change += 1; // nothing is reached any more
        self.sum_slopes(rest, new_from);
    }

    fn loaded(&mut self, model: &PlanModel, _: usize, _: f64) -> f64 {
        self.beyond = self.cost_beyond(model);
        self.cost()
    }
}

impl<O: Objective> Timelines<O> {
    /// What the plan costs, added up again: after many changes its cost has errors of rounding.
    pub fn cost(&self) -> f64 {
        let gaps: f64 = self.plan.iter().map(|served| served.cost).sum();
        gaps + self.timelines.iter().map(|timeline| timeline.end).sum::<f64>() - self.sunk
    }

    /// The buffers after the last visits of the plan, by sensor.
    pub fn levels(&self) -> Vec<O::Level> {
        self.timelines.iter().map(|timeline| timeline.at(&self.plan, self.plan.len()).0).collect()
    }

    /// What is expected after the window.
    fn cost_beyond(&self, model: &PlanModel) -> f64 {
        if self.beyond_slots <= 0.0 {
            return 0.0;
        }
        self.levels().iter().enumerate().map(|(sensor, level)| self.beyond_of(model, sensor, *level)).sum()
    }

    /// The same of `sensor`, left with the buffer `level` by its last visit.
    fn beyond_of(&self, model: &PlanModel, sensor: usize, level: O::Level) -> f64 {
        let level = model.level_at::<O>(sensor, self.slots, level);
        let sensor = &model.sensors[sensor];
        O::beyond(sensor, level, self.slots, model.round_slots, self.beyond_slots) * O::price(sensor)
    }

    /// What `sensor` costs after its last visit, which leaves the buffer `level`.
    fn end(&self, model: &PlanModel, sensor: usize, level: O::Level) -> f64 {
        let rest = model.rest::<O>(sensor, self.slots, level) * O::price(&model.sensors[sensor]);
        if self.beyond_slots > 0.0 { rest + self.beyond_of(model, sensor, level) } else { rest }
    }

    /// What a gap of `sensor` up to `slot` costs more for each slot that it is longer, if that is linear.
    fn slope(model: &PlanModel, sensor: u32, level: O::Level, slot: f64, capacity: f64) -> Option<f64> {
        let sensor = &model.sensors[sensor as usize];
        let slope = O::slope(sensor, level, slot, capacity, f64::from(NEAR)).filter(|_| model.others.is_empty())?;
        Some(slope * O::price(sensor))
    }

    /// The same of the last gap, to the end of the window. After that data is lost as before only of full buffers.
    fn end_slope(&self, model: &PlanModel, sensor: u32, level: O::Level) -> Option<f64> {
        let slope = Self::slope(model, sensor, level, self.slots, f64::INFINITY);
        slope.filter(|slope| self.beyond_slots <= 0.0 || *slope > 0.0)
    }

    /// Begins a change at visit `visit` of the plan.
    fn begin_at(&mut self, visit: usize) {
        self.change += 1;
        self.begin = visit;
        self.touched.clear();
    }

    /// Counts `sensor` among those that the change touches.
    #[inline]
    fn touch(&mut self, sensor: u32) -> &mut Timeline<O::Level> {
        let timeline = &mut self.timelines[sensor as usize];
        if timeline.change != self.change {
            timeline.change = self.change;
            (timeline.reached, timeline.nth) = timeline.at(&self.plan, self.begin);
            self.touched.push(sensor);
        }
        timeline
    }

    /// The same of the sensor of visit `index` of the plan, unless an earlier one touches it.
    #[inline]
    fn touch_visited(&mut self, index: usize) {
        let Served { visit: Visit { sensor, .. }, before, nth, .. } = self.plan[index];
        let timeline = &mut self.timelines[sensor as usize];
        if timeline.change != self.change {
            timeline.change = self.change;
            timeline.reached = before;
            timeline.nth = nth as usize;
            self.touched.push(sensor);
        }
    }

    /// What the changed plan costs more than the plan, beside its visits before `rest`.
    pub fn added_cost(&mut self, model: &PlanModel, rest: Rest) -> f64 {
        let mut more = 0.0;
        for index in self.begin..rest.from {
            more -= self.plan[index].cost;
            self.touch_visited(index);
        }
        for index in rest.until..self.plan.len() {
            more -= self.plan[index].cost;
            self.touch(self.plan[index].visit.sensor);
        }
        if rest.shift != 0 {
            more += self.added_by_shift(model, rest);
        }
        more + self.touched.iter().map(|&sensor| self.added_by_touched(model, sensor, rest)).sum::<f64>()
    }

    /// The same of sensors that the change does not touch, but `rest` serves at other times: by slopes where costs are
    /// linear. Touches those whose buffers differ from those of the plan after the first visit.
    fn added_by_shift(&mut self, model: &PlanModel, Rest { from, until, shift }: Rest) -> f64 {
        let is_near = shift.abs() <= NEAR;
        let mut more = if is_near { self.slopes[from] * f64::from(shift) } else { 0.0 };
        let bent = self.bent.partition_point(|index| (*index as usize) < from);
        for nth in 0..if is_near { self.bent.len() - bent } else { until - from } {
            let index = if is_near { self.bent[bent + nth] as usize } else { from + nth };
            let served = &self.plan[index];
            let timeline = &self.timelines[served.visit.sensor as usize];
            if timeline.change == self.change {
                continue;
            }
            let nth = served.nth as usize;
            if !(is_near && served.slope.is_some()) && timeline.last(nth).is_none_or(|last| last < from) {
                let mut level = served.before;
                let cost = serve::<O>(model, &mut level, &served.visit.later(shift));
                if !Self::agrees(model, served, level, shift) {
                    self.touch_visited(index);
                    continue;
                }
                more += cost - served.cost;
            }
            if nth + 1 == timeline.visits.len() && !(is_near && timeline.end_slope.is_some()) {
                let level = O::later(served.after, f64::from(shift));
                more += self.end(model, served.visit.sensor as usize, level) - timeline.end;
            }
        }
        more
    }

    /// The same of a touched sensor. As soon as its buffer is that of the plan, the other gaps cost the same.
    #[inline]
    fn added_by_touched(&self, model: &PlanModel, sensor: u32, Rest { from, until, shift }: Rest) -> f64 {
        let Timeline { mut reached, nth, ref visits, end, end_slope, .. } = self.timelines[sensor as usize];
        let replaced = visits[nth..].iter().take_while(|visit| (**visit as usize) < from).count();
        let own = &visits[nth + replaced..];
        let mut more = 0.0;
        if let Some(&first) = own.first().filter(|_| shift != 0 && shift.abs() <= NEAR) {
            let slope = self.plan[first as usize].slope.unwrap_or(0.0) - end_slope.unwrap_or(0.0);
            more -= slope * f64::from(shift); // it is counted among the untouched ones
        }
        for &index in own.iter().take_while(|visit| (**visit as usize) < until) {
            let served = &self.plan[index as usize];
            more += serve::<O>(model, &mut reached, &served.visit.later(shift)) - served.cost;
            if Self::agrees(model, served, reached, shift) {
                if shift == 0 {
                    return more;
                }
                let last = own.iter().rfind(|visit| (**visit as usize) < until).expect("this one, or a later one");
                reached = O::later(self.plan[*last as usize].after, f64::from(shift));
                break;
            }
        }
        more + self.end(model, sensor as usize, reached) - end
    }

    /// Whether the buffer `level`, after a visit of the plan `shift` slots later, is that of the plan.
    #[inline]
    fn agrees(model: &PlanModel, served: &Served<O::Level>, level: O::Level, shift: i32) -> bool {
        let reached = |slot: i32, level: O::Level| Reached { slot: f64::from(slot), level };
        let Visit { sensor, slot, .. } = served.visit;
        let [now, then] = [reached(slot + shift, level), reached(slot, served.after)];
        // The visits of others are not shifted.
        (shift == 0 || model.others.is_empty()) && O::agree(&model.sensors[sensor as usize], &now, &then)
    }

    /// Brings up to date the visits of a sensor from its visit `nth` on, the first in the rest, and new ones before it.
    #[inline]
    fn follow(&mut self, model: &PlanModel, sensor: u32, mut nth: usize, rest: Rest, new_from: usize) {
        let Self { plan, timelines, changed, .. } = self;
        let timeline = &mut timelines[sensor as usize];
        let is_touched = std::mem::replace(&mut timeline.change, self.change) == self.change;
        timeline.visits[nth..].iter_mut().for_each(|visit| *visit = *visit + new_from as u32 - rest.from as u32);
        if rest.shift == 0 && !is_touched {
            return;
        }
        while timeline.last(nth).is_some_and(|last| last >= self.begin) {
            nth -= 1;
        }
        let mut last = timeline.last(nth);
        let mut reached = last.map_or(timeline.begun, |last| plan[last].after);
        for &index in &timeline.visits[nth..] {
            let index = index as usize;
            let served = &mut plan[index];
            let is_same = served.renew(reached, (index >= new_from).then_some(rest.shift), O::later);
            if !is_same {
                served.cost = serve::<O>(model, &mut served.after, &served.visit);
                let Visit { slot, capacity, .. } = served.visit;
                served.slope = Self::slope(model, sensor, reached, f64::from(slot), capacity);
            }
            reached = served.after;
            let slope = served.slope;
            if let Some(last) = last.replace(index) {
                plan[last].precede(slope, false, last, changed);
            }
            if is_same && rest.shift == 0 {
                return; // nor do the later ones differ
            }
        }
        let end = self.end(model, sensor as usize, reached);
        let end_slope = self.end_slope(model, sensor, reached);
        if let Some(last) = last {
            self.plan[last].precede(end_slope, true, last, &mut self.changed);
        }
        let timeline = &mut self.timelines[sensor as usize];
        timeline.end = end;
        timeline.end_slope = end_slope;
    }

    /// Adds up the slopes of the plan again, where they differ after a change before `rest`, which now begins at
    /// `new_from`.
    fn sum_slopes(&mut self, Rest { from, until, .. }: Rest, new_from: usize) {
        let Range { start, mut end } = self.changed;
        if until + 1 < self.slopes.len() {
            self.slopes.truncate(until + 1);
            self.slopes[until] = 0.0;
            end = self.plan.len();
        }
        let then = end + from - new_from;
        self.slopes.splice(start..then, std::iter::repeat_n(0.0, end - start));
        for index in (0..end).rev() {
            let slope = self.slopes[index + 1] + self.plan[index].slope_difference;
            if index < start && slope == self.slopes[index] {
                break;
            }
            self.slopes[index] = slope;
        }
        let [first, last] = [start, then].map(|end| self.bent.partition_point(|index| (*index as usize) < end));
        self.bent.truncate(self.bent.partition_point(|index| (*index as usize) < until));
        self.bent[last..].iter_mut().for_each(|index| *index = *index + new_from as u32 - from as u32);
        let bent = (start..end).filter(|&index| self.plan[index].is_bent).map(|index| index as u32);
        self.bent.splice(first..last, bent);
    }
}

impl<O: Objective<Style: ForecastStyle<O, Store = Timelines<O>>>> Forecast<O> {
    /// Adds up the cost of the plan again: after many changes it has errors of rounding.
    pub(super) fn settle(&mut self) {
        self.cost = self.store.cost();
    }
}
