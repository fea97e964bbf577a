//! The decoder: flies a plan stop by stop, and schedules sensors on the way.

use std::cmp::Ordering;

use skysink_common::geometry::Position;

use super::groups::PlannedStop;
use super::model::{ModelStyle, PlanModel};
use super::objective::Objective;
use crate::geometry::disks::Disk;
use crate::route::motion::MOST_SLOTS;
use crate::route::route::{Route, RoutePart};
use crate::route::way_home::WayHome;

/// One sensor served in one slot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Visit {
    /// The sensor.
    pub sensor: u32,
    /// The slot; 1 is the slot to plan.
    pub slot: i32,
    /// The most that the visit takes, in the unit of the objective.
    pub capacity: f64,
}

impl Visit {
    /// The visit `slots` slots later.
    #[inline]
    #[must_use]
    pub fn later(self, slots: i32) -> Self {
        Self { slot: self.slot + slots, ..self }
    }
}

/// One stop as flown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leg {
    /// The stop.
    pub stop: PlannedStop,
    /// Slot at whose end the stop is served, or left after its hovers.
    pub end: i32,
    /// Slots of its hovers.
    pub hovered: i32,
    /// Position of the UAV at that time.
    pub at: Position,
    /// Index of the first visit of the leg, including those on the way.
    pub first: u32,
    /// Energy after the leg [J]; infinite without a battery.
    pub energy_j: f64,
    /// Energy after the leg beyond the way home and the reserve [J].
    pub margin_j: f64,
    /// The visit to the base with which the leg begins.
    pub via: Option<BaseVisit>,
}

impl Leg {
    /// The leg with `more_j` [J] more at its beginning; after a visit to the base the energy is the same.
    #[must_use]
    pub fn with_more(self, more_j: f64) -> Self {
        if self.via.is_some() || more_j == 0.0 {
            return self;
        }
        Self { energy_j: self.energy_j + more_j, margin_j: self.margin_j + more_j, ..self }
    }
}

/// A way home and the charging after it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BaseVisit {
    /// Slots of the way home.
    pub slots: i32,
    /// Slots in the base.
    pub charged: i32,
    /// Of these, those before a pad is free.
    pub waited: i32,
    /// Where the UAV charges.
    pub at: Position,
}

/// Legs with their visits.
#[derive(Debug, Clone, Default)]
pub struct Trace {
    /// Stops in the order of flight.
    pub legs: Vec<Leg>,
    /// Visits by time.
    pub visits: Vec<Visit>,
}

impl Trace {
    /// Index of the first visit of leg `leg`; the number of visits if there is no such leg.
    #[inline]
    pub fn first_visit(&self, leg: usize) -> usize {
        self.legs.get(leg).map_or(self.visits.len(), |leg| leg.first as usize)
    }
}

/// The buffers of a flight, as far as it has come.
pub trait Buffers<O: Objective> {
    /// That of `sensor`.
    fn level(&self, sensor: usize) -> O::Level;

    /// Applies one visit and returns what the gap before it costs.
    fn serve(&mut self, model: &PlanModel, visit: &Visit) -> f64;
}

/// By sensor.
impl<O: Objective> Buffers<O> for Vec<O::Level> {
    #[inline]
    fn level(&self, sensor: usize) -> O::Level {
        self[sensor]
    }

    #[inline]
    fn serve(&mut self, model: &PlanModel, visit: &Visit) -> f64 {
        serve::<O>(model, &mut self[visit.sensor as usize], visit)
    }
}

/// Applies one visit to the buffer of its sensor and returns what the gap before it costs.
#[inline]
pub fn serve<O: Objective>(model: &PlanModel, level: &mut O::Level, visit: &Visit) -> f64 {
    let sensor = &model.sensors[visit.sensor as usize];
    let slot = f64::from(visit.slot);
    let (before, reached) = model.until::<O>(visit.sensor as usize, slot, *level);
    let (units, left) = O::visit(sensor, reached, slot, visit.capacity);
    *level = left;
    (before + units) * O::price(sensor)
}

/// A sensor in range at the end of a slot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    sensor: u32,
    /// The most that a visit takes.
    capacity: f64,
    /// What a visit saves; infinite for those that are served before all others.
    saved: f64,
    /// Of equals the least counts.
    left: f64,
}

impl Candidate {
    /// The sensor, of which a visit takes `capacity` at most.
    #[inline]
    pub(super) fn new(sensor: u32, capacity: f64) -> Self {
        Self { sensor, capacity, saved: 0.0, left: 0.0 }
    }

    /// Most saved first; ties by the least room, then by the lowest number.
    fn order(a: &Self, b: &Self) -> Ordering {
        b.saved.total_cmp(&a.saved).then(a.left.total_cmp(&b.left)).then(a.sensor.cmp(&b.sensor))
    }
}

/// The state of a decoded flight.
#[derive(Debug, Clone, Default)]
pub struct Decoder {
    /// Position of the UAV.
    pub at: Position,
    /// The last flown slot.
    pub slot: i32,
    /// Energy in the battery [J]; infinite without one.
    pub energy_j: f64,
    /// Its part beyond the way home and the reserve, after the last leg [J].
    pub margin_j: f64,
    /// The visit to the base at the beginning of the last leg.
    pub via: Option<BaseVisit>,
    /// Slots of the hovers at its end.
    pub hovered: i32,
    /// Slots of the mission before the window.
    pub flown_slots: u64,
    /// Sensors in range at the end of a slot; working memory.
    found: Vec<Candidate>,
}

/// What a style says of the flight to a stop.
pub trait DecoderStyle<O: Objective>: ModelStyle<O> {
    /// The route from `from` into `disk`, as near to `near` as possible; `None` if there is none.
    fn enter(model: &PlanModel, from: &Position, disk: &Disk, near: &Position) -> Option<Route>;

    /// The sensors of `stop` that are served at its end before all others.
    fn served_first(model: &PlanModel, stop: PlannedStop) -> &[u32];

    /// Stays at `stop`, up to slot `last`; returns what that costs.
    fn stay(
        _decoder: &mut Decoder,
        _model: &PlanModel,
        _stop: PlannedStop,
        _last: i32,
        _buffers: &mut impl Buffers<O>,
        _visits: &mut Vec<Visit>,
    ) -> f64 {
        0.0
    }

    /// Energy beyond the way home from `at` [m] and the reserve, with `energy_j` [J] after `slot` [J].
    fn margin_j(model: &PlanModel, home: &WayHome, slot: u64, energy_j: f64, at: &Position) -> f64;

    /// Finds the sensors that can be served from above `at` [m], with `first` before all others.
    fn in_range(model: &PlanModel, first: &[u32], at: &Position, found: &mut Vec<Candidate>);

    /// Whether a service that costs `cost` is a visit of the plan.
    fn is_visit(_cost: f64) -> bool {
        true
    }
}

impl Decoder {
    /// Flies to `stop`, as near to the stop `next` as possible, and serves sensors in range at the end of each slot.
    /// Returns what the gaps before the visits cost; `None`, without a change, if it would arrive after slot `last`.
    pub fn fly<O: Objective<Style: DecoderStyle<O>>>(
        &mut self,
        model: &PlanModel,
        stop: PlannedStop,
        next: Option<PlannedStop>,
        last: i32,
        buffers: &mut impl Buffers<O>,
        visits: &mut Vec<Visit>,
    ) -> Option<f64> {
        self.via = None;
        self.hovered = 0;
        let disk = model.disk(stop.disk);
        let near = &model.disk(next.unwrap_or(stop).disk).centre;
        let enter = |from: &Position| O::Style::enter(model, from, disk, near);
        let mut route = enter(&self.at);
        let mut cost = 0.0;
        let home = model.table.home.way();
        let mut margin_j = route.as_ref().map_or(f64::NEG_INFINITY, |route| self.next_margin_j::<O>(model, route));
        if let Some(home) = home.filter(|_| margin_j < 0.0) {
            let (visit, back) = self.base_visit(home, &model.pad_waits);
            let Decoder { at, slot, energy_j, .. } = *self;
            let from_base = enter(&visit.at)?;
            let end =
                i64::from(slot) + i64::from(visit.slots) + i64::from(visit.charged) + i64::from(from_base.slots());
            if end > i64::from(last) {
                return None;
            }
            // Whether the stop can be served from the base, with what it charges.
            self.leave_base(home, &visit, back.energy_j());
            margin_j = self.next_margin_j::<O>(model, &from_base);
            self.at = at;
            self.slot = slot;
            self.energy_j = energy_j;
            if margin_j < 0.0 {
                // It is left out, unless the base does not charge: then the flights end.
                return home.battery_at(&visit.at).is_charged().then_some(0.0);
            }
            cost = self.fly_along::<O>(model, &back, &[], buffers, visits);
            self.leave_base(home, &visit, 0.0);
            self.via = Some(visit);
            route = Some(from_base);
        }
        let Some(route) = route else { return Some(0.0) }; // no path leads there: it is left out
        if self.via.is_none() && i64::from(route.slots()) > i64::from(last - self.slot) {
            return None;
        }
        self.margin_j = margin_j;
        cost += self.fly_along::<O>(model, &route, O::Style::served_first(model, stop), buffers, visits);
        Some(cost + O::Style::stay(self, model, stop, last, buffers, visits))
    }

    /// Flies along `route`, and serves `first` before all others at its end. Returns what the gaps before the visits
    /// cost.
    pub fn fly_along<O: Objective<Style: DecoderStyle<O>>>(
        &mut self,
        model: &PlanModel,
        route: &Route,
        first: &[u32],
        buffers: &mut impl Buffers<O>,
        visits: &mut Vec<Visit>,
    ) -> f64 {
        if route.slots() == 0 {
            return 0.0;
        }
        let begin = self.slot;
        let mut cost = 0.0;
        for step in 1..route.slots() {
            self.at = route.at(step);
            self.slot = begin + step as i32;
            cost += self.serve_in_range::<O>(model, &[], buffers, visits);
        }
        self.at = route.end();
        self.slot = begin + route.slots() as i32;
        self.energy_j -= route.energy_j();
        cost + self.serve_in_range::<O>(model, first, buffers, visits)
    }

    /// Energy beyond the way home and the reserve after a flight along `route` [J].
    pub(super) fn next_margin_j<O: Objective<Style: DecoderStyle<O>>>(&self, model: &PlanModel, route: &Route) -> f64 {
        let Some(home) = model.table.home.way() else { return f64::INFINITY };
        let energy_j = self.energy_j - route.energy_j();
        let slot = self.flown_slots + self.slot as u64 + u64::from(route.slots());
        O::Style::margin_j(model, home, slot, energy_j, &route.end())
    }

    /// The visit to the base that begins now, and the way there; `pad_waits` are the slots after which each site has a
    /// pad.
    fn base_visit(&self, home: &WayHome, pad_waits: &[u64]) -> (BaseVisit, Route) {
        let flown = self.flown_slots + self.slot as u64;
        let route = home.route(flown, &self.at);
        // Longer than any mission if there is none.
        let route = route.unwrap_or_else(|| Route::new(self.at, [RoutePart { end: self.at, slots: MOST_SLOTS }], None));
        let slots = route.slots().min(MOST_SLOTS) as i32;
        let at = route.end();
        if home.battery.is_endless() {
            return (BaseVisit { slots, charged: 0, waited: 0, at }, route);
        }
        let wait = home.base.site_at(&at).and_then(|site| pad_waits.get(site)).copied().unwrap_or_default();
        let wait = wait.saturating_sub(self.slot as u64 + slots as u64);
        let charged = home.charging_slots(flown + slots as u64 + wait + 1, self.energy_j - route.energy_j(), &at);
        let waited = if charged == 0 { 0 } else { wait.min(MOST_SLOTS.into()) as i32 };
        let charged = (charged + waited as u64).min(MOST_SLOTS.into()) as i32;
        (BaseVisit { slots, charged, waited, at }, route)
    }

    /// Moves to the end of `visit`, the way to which takes `more_j` [J], and charges.
    fn leave_base(&mut self, home: &WayHome, visit: &BaseVisit, more_j: f64) {
        let slots = f64::from(visit.charged - visit.waited);
        self.energy_j = home.battery_at(&visit.at).charged_for_j(self.energy_j - more_j, slots);
        self.slot += visit.charged + if self.at == visit.at { 0 } else { visit.slots };
        self.at = visit.at;
    }

    /// Serves `first`, and of the other sensors in range those whose visits save most.
    pub(super) fn serve_in_range<O: Objective<Style: DecoderStyle<O>>>(
        &mut self,
        model: &PlanModel,
        first: &[u32],
        buffers: &mut impl Buffers<O>,
        visits: &mut Vec<Visit>,
    ) -> f64 {
        let blocks = model.table.limits.blocks();
        self.found.clear();
        O::Style::in_range(model, first, &self.at, &mut self.found);
        if self.found.len() > blocks {
            self.rate::<O>(model, first, buffers);
            self.found.select_nth_unstable_by(blocks - 1, Candidate::order);
            self.found.truncate(blocks);
        }
        let mut cost = 0.0;
        for &Candidate { sensor, capacity, .. } in &self.found {
            let visit = Visit { sensor, slot: self.slot, capacity };
            let more = buffers.serve(model, &visit);
            cost += more;
            if O::Style::is_visit(more) {
                visits.push(visit);
            }
        }
        cost
    }

    /// Determines what visits of the sensors in range save; those of `first` come before all others.
    #[inline]
    fn rate<O: Objective>(&mut self, model: &PlanModel, first: &[u32], buffers: &impl Buffers<O>) {
        let slot = f64::from(self.slot);
        for candidate in &mut self.found {
            if first.contains(&candidate.sensor) {
                candidate.saved = f64::INFINITY;
                continue;
            }
            let index = candidate.sensor as usize;
            let sensor = &model.sensors[index];
            let level = model.level_at::<O>(index, slot, buffers.level(index));
            (candidate.saved, candidate.left) = O::saving(sensor, level, slot, candidate.capacity, model.round_slots);
        }
    }
}
