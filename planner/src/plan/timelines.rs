//! The visits of a plan by sensor, and what their gaps cost. A change costs more or less for the sensors that it touches
//! alone, so a step of a search takes as long as what it changes.

use super::decoder::{Buffers, Visit, serve};
use super::model::PlanModel;
use super::objective::{Objective, Reached};
use super::window::PlanningWindow;

/// Stands for the visit after the last one of a sensor.
const NONE: u32 = u32::MAX;

/// Shifts [slots] up to which the cost of most gaps is linear: where they are much too long, or not by far.
const NEAR: i32 = 16;

/// A visit of the plan, and the gap that it ends.
#[derive(Debug, Clone, Copy)]
struct Served<L> {
    visit: Visit,
    /// The buffer when the gap begins, and after the visit.
    before: L,
    after: L,
    /// What the gap costs.
    cost: f64,
    /// Visits of the plan up to the one that the gap begins with; 0 if there is none.
    since: u32,
    /// Index of the next visit of the sensor, or [`NONE`].
    next: u32,
    /// What the gap costs more for each slot that the visit is later, within [`NEAR`]; `None` if that is not linear.
    slope: Option<f64>,
    /// That slope less the one of the next gap of the sensor; 0 for one that is not linear. Summed over all visits from one on
    /// it is the slope of each sensor's first gap less that of its last.
    slope_difference: f64,
    /// Whether it is not, here or at the end.
    is_bent: bool,
}

/// A sensor: its visits, and how far a change has come.
#[derive(Debug, Clone)]
struct Timeline<L> {
    begun: L,
    /// Indices of its visits in the plan.
    visits: Vec<u32>,
    /// The last change that touches it, its buffer in the changed plan, and its next visit in the plan before.
    change: u64,
    reached: L,
    next: u32,
    /// What it costs after its last visit, and more for each slot that the window is longer, if that is linear.
    end: f64,
    end_slope: Option<f64>,
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

/// The visits of a plan that does not hover, and of a change.
#[derive(Debug, Clone)]
pub struct Timelines<O: Objective> {
    /// The visits by time.
    plan: Vec<Served<O::Level>>,
    /// By sensor.
    timelines: Vec<Timeline<O::Level>>,
    /// By visit: what the plan costs more for each slot that this one and all later ones are later, as far as it is linear.
    slopes: Vec<f64>,
    /// The visits at which it is not.
    bent: Vec<u32>,
    /// What the plan without visits costs.
    unvisited: f64,
    /// What gaps have cost before the window, which is not counted.
    sunk: f64,
    /// Those of the plan after a change; working memory.
    rest: Vec<Served<O::Level>>,
    /// Slots of the window, and of the mission after it.
    slots: f64,
    beyond_slots: f64,
    /// The number of the change, the visit with which it begins, and the sensors that it touches.
    change: u64,
    begin: usize,
    touched: Vec<u32>,
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

impl<L> Served<L> {
    /// Puts the visit before visit `next` of its sensor, or the end of the window, with the slope of the gap in between.
    fn precede(&mut self, next: u32, slope: Option<f64>) {
        self.next = next;
        self.slope_difference = self.slope.unwrap_or(0.0) - slope.unwrap_or(0.0);
        self.is_bent = self.slope.is_none() || next == NONE && slope.is_none();
    }
}

impl<L: Copy> Timeline<L> {
    /// The buffer before visit `visit` of the plan, and the next visit of the sensor from there on.
    #[inline]
    fn at(&self, plan: &[Served<L>], visit: usize) -> (L, u32) {
        let before = self.visits.partition_point(|own| (*own as usize) < visit);
        let level = before.checked_sub(1).map_or(self.begun, |last| plan[self.visits[last] as usize].after);
        (level, self.visits.get(before).copied().unwrap_or(NONE))
    }
}

impl<O: Objective> Timelines<O> {
    /// Those of an empty plan.
    #[must_use]
    pub fn new(model: &PlanModel, window: &PlanningWindow<O>) -> Self {
        let levels = if O::HOVERS { &[] } else { &window.levels[..] };
        let mut timelines = Self {
            plan: Vec::new(),
            timelines: Vec::with_capacity(levels.len()),
            slopes: vec![0.0],
            bent: Vec::new(),
            unvisited: 0.0,
            sunk: 0.0,
            rest: Vec::new(),
            slots: f64::from(window.slots),
            beyond_slots: window.beyond_slots,
            change: 0,
            begin: 0,
            touched: Vec::new(),
        };
        for (index, (sensor, &begun)) in model.sensors.iter().zip(levels).enumerate() {
            let (end, end_slope) = (timelines.end(model, index, begun), None);
            timelines.sunk += O::rest(sensor, begun, 0.0) * O::price(sensor);
            let (visits, reached) = (Vec::new(), begun);
            timelines.timelines.push(Timeline { begun, visits, change: 0, reached, next: NONE, end, end_slope });
        }
        timelines.unvisited = timelines.cost();
        timelines
    }

    /// What the plan costs.
    #[must_use]
    pub fn cost(&self) -> f64 {
        let gaps: f64 = self.plan.iter().map(|served| served.cost).sum();
        gaps + self.timelines.iter().map(|timeline| timeline.end).sum::<f64>() - self.sunk
    }

    /// The buffers after the last visits of the plan, by sensor.
    #[must_use]
    pub fn levels(&self) -> Vec<O::Level> {
        self.timelines.iter().map(|timeline| timeline.at(&self.plan, self.plan.len()).0).collect()
    }

    /// What is expected after the window.
    #[must_use]
    pub fn cost_beyond(&self, model: &PlanModel) -> f64 {
        if self.beyond_slots <= 0.0 {
            return 0.0;
        }
        self.levels().iter().enumerate().map(|(sensor, level)| self.beyond(model, sensor, *level)).sum()
    }

    /// The same of `sensor`, left with the buffer `level` by its last visit.
    fn beyond(&self, model: &PlanModel, sensor: usize, level: O::Level) -> f64 {
        let level = model.level_at::<O>(sensor, self.slots, level);
        let sensor = &model.sensors[sensor];
        O::beyond(sensor, level, self.slots, model.round_slots, self.beyond_slots) * O::price(sensor)
    }

    /// What `sensor` costs after its last visit, which leaves the buffer `level`.
    fn end(&self, model: &PlanModel, sensor: usize, level: O::Level) -> f64 {
        let rest = model.rest::<O>(sensor, self.slots, level) * O::price(&model.sensors[sensor]);
        if self.beyond_slots > 0.0 { rest + self.beyond(model, sensor, level) } else { rest }
    }

    /// What a gap of `sensor` up to `slot` costs more for each slot that it is longer, if that is linear.
    fn slope(&self, model: &PlanModel, sensor: u32, level: O::Level, slot: f64, capacity: f64) -> Option<f64> {
        let sensor = &model.sensors[sensor as usize];
        let slope = O::slope(sensor, level, slot, capacity, f64::from(NEAR)).filter(|_| model.others.is_empty())?;
        Some(slope * O::price(sensor))
    }

    /// The same of the last gap, to the end of the window. After that data is lost as before only of full buffers.
    fn end_slope(&self, model: &PlanModel, sensor: u32, level: O::Level) -> Option<f64> {
        let slope = self.slope(model, sensor, level, self.slots, f64::INFINITY);
        slope.filter(|slope| self.beyond_slots <= 0.0 || *slope > 0.0)
    }

    /// Removes all visits of the plan; returns what it then costs.
    pub fn clear(&mut self, model: &PlanModel) -> f64 {
        self.begin(0);
        self.accept(model, &[], Rest { from: 0, until: 0, shift: 0 });
        self.unvisited
    }

    /// Begins a change at visit `visit` of the plan.
    pub fn begin(&mut self, visit: usize) {
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
            (timeline.reached, timeline.next) = timeline.at(&self.plan, self.begin);
            self.touched.push(sensor);
        }
        timeline
    }

    /// The same of the sensor of visit `index` of the plan, unless an earlier one touches it.
    #[inline]
    fn touch_visited(&mut self, index: usize) {
        let Served { visit: Visit { sensor, .. }, before, .. } = self.plan[index];
        let timeline = &mut self.timelines[sensor as usize];
        if timeline.change != self.change {
            (timeline.change, timeline.reached, timeline.next) = (self.change, before, index as u32);
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
            if served.since as usize <= from && !(is_near && served.slope.is_some()) {
                let mut level = served.before;
                let cost = serve::<O>(model, &mut level, &served.visit.later(shift));
                if !Self::agrees(model, served, level, shift) {
                    self.touch_visited(index);
                    continue;
                }
                more += cost - served.cost;
            }
            if served.next == NONE && !(is_near && timeline.end_slope.is_some()) {
                let level = O::later(served.after, f64::from(shift));
                more += self.end(model, served.visit.sensor as usize, level) - timeline.end;
            }
        }
        more
    }

    /// The same of a touched sensor. As soon as its buffer is that of the plan, the other gaps cost the same.
    #[inline]
    fn added_by_touched(&self, model: &PlanModel, sensor: u32, Rest { from, until, shift }: Rest) -> f64 {
        let Timeline { mut reached, mut next, ref visits, end, end_slope, .. } = self.timelines[sensor as usize];
        while (next as usize) < from {
            next = self.plan[next as usize].next;
        }
        let mut more = 0.0;
        if let Some(first) = self.plan.get(next as usize).filter(|_| shift != 0 && shift.abs() <= NEAR) {
            let slope = first.slope.unwrap_or(0.0) - end_slope.unwrap_or(0.0);
            more -= slope * f64::from(shift); // it is counted among the untouched ones
        }
        while (next as usize) < until {
            let served = &self.plan[next as usize];
            more += serve::<O>(model, &mut reached, &served.visit.later(shift)) - served.cost;
            if Self::agrees(model, served, reached, shift) {
                if shift == 0 {
                    return more;
                }
                let last = visits.iter().rfind(|visit| (**visit as usize) < until).expect("this one, or a later one");
                reached = O::later(self.plan[*last as usize].after, f64::from(shift));
                break;
            }
            next = served.next;
        }
        more + self.end(model, sensor as usize, reached) - end
    }

    /// Whether the buffer `level`, after a visit of the plan `shift` slots later, is that of the plan.
    #[inline]
    fn agrees(model: &PlanModel, served: &Served<O::Level>, level: O::Level, shift: i32) -> bool {
        let reached = |slot: i32, level: O::Level| Reached { slot: f64::from(slot), visited: level, level };
        let Visit { sensor, slot, .. } = served.visit;
        let [now, then] = [reached(slot + shift, level), reached(slot, served.after)];
        // The visits of others are not shifted.
        (shift == 0 || model.others.is_empty()) && O::agree(&model.sensors[sensor as usize], &now, &then)
    }

    /// Replaces the visits of the plan between the begin of the change and `rest` by `visits`.
    pub fn accept(&mut self, model: &PlanModel, visits: &[Visit], Rest { from, until, shift }: Rest) {
        self.begin(self.begin); // the buffers are those before it again
        for index in self.begin..self.plan.len() {
            self.touch(self.plan[index].visit.sensor);
        }
        for &sensor in &self.touched {
            let own = &mut self.timelines[sensor as usize].visits;
            own.truncate(own.partition_point(|visit| (*visit as usize) < self.begin));
        }
        let mut rest = std::mem::take(&mut self.rest);
        rest.clear();
        rest.extend_from_slice(&self.plan[from..until]);
        self.plan.truncate(self.begin);
        visits.iter().for_each(|visit| self.push(model, visit, None));
        rest.iter().for_each(|served| self.push(model, &served.visit.later(shift), Some((served, shift))));
        self.rest = rest;
        for &sensor in &self.touched {
            let Timeline { reached, ref visits, .. } = self.timelines[sensor as usize];
            let end_slope = self.end_slope(model, sensor, reached);
            if let Some(&last) = visits.last() {
                self.plan[last as usize].precede(NONE, end_slope);
            }
            let end = self.end(model, sensor as usize, reached);
            let timeline = &mut self.timelines[sensor as usize];
            (timeline.end, timeline.end_slope) = (end, end_slope);
        }
        self.change += 1; // nothing is reached any more
        self.sum_slopes();
    }

    /// Adds a visit to the plan: one that was `then` so many slots before, or a new one.
    #[inline]
    fn push(&mut self, model: &PlanModel, visit: &Visit, then: Option<(&Served<O::Level>, i32)>) {
        let index = self.plan.len() as u32;
        let before = self.touch(visit.sensor).reached;
        let later = |level: O::Level, shift: i32| O::later(level, f64::from(shift));
        let is_same = |&(served, shift): &(&Served<O::Level>, i32)| {
            (shift == 0 || served.slope.is_some()) && before == later(served.before, shift)
        };
        let (cost, after, slope) = if let Some((served, shift)) = then.filter(is_same) {
            (served.cost, later(served.after, shift), served.slope)
        } else {
            let mut level = before;
            let cost = serve::<O>(model, &mut level, visit);
            (cost, level, self.slope(model, visit.sensor, before, f64::from(visit.slot), visit.capacity))
        };
        let timeline = &mut self.timelines[visit.sensor as usize];
        timeline.reached = after;
        let last = timeline.visits.last().copied();
        timeline.visits.push(index);
        if let Some(last) = last {
            self.plan[last as usize].precede(index, slope);
        }
        let (since, is_bent) = (last.map_or(0, |last| last + 1), slope.is_none());
        let (visit, next, slope_difference) = (*visit, NONE, 0.0);
        self.plan.push(Served { visit, before, after, cost, since, next, slope, slope_difference, is_bent });
    }

    /// Adds up the slopes of the plan.
    fn sum_slopes(&mut self) {
        self.bent.clear();
        self.slopes.resize(self.plan.len() + 1, 0.0);
        let mut slope = 0.0;
        self.slopes[self.plan.len()] = slope;
        for (index, served) in self.plan.iter().enumerate().rev() {
            slope += served.slope_difference;
            self.slopes[index] = slope;
            if served.is_bent {
                self.bent.push(index as u32);
            }
        }
        self.bent.reverse();
    }
}
