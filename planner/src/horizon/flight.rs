//! The decoder: flies a plan stop by stop, and schedules sensors on the way.

use skysink_common::geometry::{Position, distance_squared};

use super::choice::Candidate;
use super::model::PlanningModel;
use crate::route::home::Home;
use crate::route::motion::MOST_SLOTS;
use crate::route::route::{Part, Route};

/// Slack of range, relative to the communication radius: half that of decision D5, which flight-sim applies.
const RANGE_SLACK: f64 = 0.5e-9;

/// One sensor served in one slot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Visit {
    /// The sensor.
    pub sensor: u32,
    /// The slot; 1 is the slot to plan.
    pub slot: i32,
    /// The most that the visit takes [slots of sampling].
    pub capacity_slots: f64,
}

/// One stop as flown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leg {
    /// The stop, as a disk of the model.
    pub stop: u32,
    /// Slot at whose end the stop is served.
    pub end: i32,
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
    /// The same with `more_j` [J] more at its beginning; after a visit to the base the energy is the same.
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
    #[must_use]
    pub fn first_visit(&self, leg: usize) -> usize {
        self.legs.get(leg).map_or(self.visits.len(), |leg| leg.first as usize)
    }
}

/// Applies one visit and returns the overflow before it [bit].
///
/// Queues are represented by `e_i`, the slot in which each sensor would have been empty: a queue is `s_i τ (t − e_i)`
/// after slot t if it did not overflow. The visit uploads up to its capacity.
#[inline]
pub fn serve(model: &PlanningModel, empty: &mut [f64], visit: &Visit) -> f64 {
    let sensor = &model.sensors[visit.sensor as usize];
    let slot = f64::from(visit.slot);
    let empty = &mut empty[visit.sensor as usize];
    let (overflow_slots, emptied) = model.overflow_slots(visit.sensor as usize, slot, *empty);
    *empty = slot - ((slot - emptied).min(sensor.fill_slots) - visit.capacity_slots).max(0.0);
    overflow_slots * sensor.cost_bits
}

/// Slots to fly from `from` to a point in range of all members of `stop`, at least 1.
#[inline]
#[must_use]
pub fn slots_to(model: &PlanningModel, from: &Position, stop: u32) -> i32 {
    model.table.motion.slots_into(from, model.disk(stop)).min(f64::from(MOST_SLOTS)) as i32
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
    /// Slots of the mission before the window.
    pub flown_slots: u64,
    /// Sensors in range at the end of a slot; working memory.
    found: Vec<Candidate>,
}

impl Decoder {
    /// Flies to `stop`, as near to the stop `next` as possible, and serves sensors in range at the end of each slot.
    /// Returns the overflow before the visits [bit]; `None`, without a change, if it would arrive after slot `last`.
    pub fn fly(
        &mut self,
        model: &PlanningModel,
        stop: u32,
        next: Option<u32>,
        last: i32,
        empty: &mut [f64],
        visits: &mut Vec<Visit>,
    ) -> Option<f64> {
        let disk = model.disk(stop);
        let near = &model.disk(next.unwrap_or(stop)).centre;
        let enter = |from: &Position| model.table.motion.enter(from, disk, near);
        let mut route = enter(&self.at);
        let mut lost_bits = 0.0;
        self.via = None;
        let home = model.table.home.as_ref();
        let mut margin_j = route.as_ref().map_or(f64::NEG_INFINITY, |route| self.next_margin_j(home, route));
        if let Some(home) = home.filter(|_| margin_j < 0.0) {
            let (visit, back) = self.base_visit(home);
            let Decoder { at, slot, energy_j, .. } = *self;
            let from_base = enter(&visit.at)?;
            let end =
                i64::from(slot) + i64::from(visit.slots) + i64::from(visit.charged) + i64::from(from_base.slots());
            if end > i64::from(last) {
                return None;
            }
            // Whether the stop can be served from the base, with what it charges.
            self.leave_base(home, &visit, back.energy_j());
            margin_j = self.next_margin_j(Some(home), &from_base);
            (self.at, self.slot, self.energy_j) = (at, slot, energy_j);
            if margin_j < 0.0 {
                // It is left out, unless the base does not charge: then the flights end.
                return home.battery.is_some_and(|battery| battery.is_charged()).then_some(0.0);
            }
            lost_bits = self.fly_along(model, &back, &[], empty, visits);
            self.leave_base(home, &visit, 0.0);
            self.via = Some(visit);
            route = Some(from_base);
        }
        let Some(route) = route else { return Some(0.0) }; // no path leads there: it is left out
        if self.via.is_none() && i64::from(route.slots()) > i64::from(last - self.slot) {
            return None;
        }
        self.margin_j = margin_j;
        let members = &model.disks[stop as usize].members;
        Some(lost_bits + self.fly_along(model, &route, members, empty, visits))
    }

    /// Flies along `route`, and serves `members` from its end. Returns the overflow before the visits [bit].
    fn fly_along(
        &mut self,
        model: &PlanningModel,
        route: &Route,
        members: &[u32],
        empty: &mut [f64],
        visits: &mut Vec<Visit>,
    ) -> f64 {
        if route.slots() == 0 {
            return 0.0;
        }
        let begin = self.slot;
        let mut lost_bits = 0.0;
        for step in 1..route.slots() {
            self.at = route.at(step);
            self.slot = begin + step as i32;
            lost_bits += self.serve_in_range(model, &[], empty, visits);
        }
        self.at = route.end();
        self.slot = begin + route.slots() as i32;
        if model.table.home.as_ref().is_some_and(|home| home.battery.is_some()) {
            self.energy_j -= route.energy_j();
        }
        lost_bits + self.serve_in_range(model, members, empty, visits)
    }

    /// Energy beyond the way home and the reserve after a leg along `route` [J].
    fn next_margin_j(&self, home: Option<&Home>, route: &Route) -> f64 {
        let Some(home) = home else { return f64::INFINITY };
        let energy_j = home.battery.map_or(f64::INFINITY, |_| self.energy_j - route.energy_j());
        home.margin_j(self.flown_slots + self.slot as u64 + u64::from(route.slots()), energy_j, &route.end())
    }

    /// The visit to the base that begins now, and the way there.
    fn base_visit(&self, home: &Home) -> (BaseVisit, Route) {
        let flown = self.flown_slots + self.slot as u64;
        let route = home.route(flown, &self.at);
        // Longer than any mission if there is none.
        let route = route.unwrap_or_else(|| Route::new(self.at, [Part { end: self.at, slots: MOST_SLOTS }], None));
        let (slots, at) = (route.slots().min(MOST_SLOTS) as i32, route.end());
        if home.battery.is_none() {
            return (BaseVisit { slots, charged: 0, at }, route);
        }
        let charged = home.charging_slots(flown + slots as u64 + 1, self.energy_j - route.energy_j());
        (BaseVisit { slots, charged: charged.min(MOST_SLOTS.into()) as i32, at }, route)
    }

    /// Moves to the end of `visit`, the way to which takes `more_j` [J], and charges.
    fn leave_base(&mut self, home: &Home, visit: &BaseVisit, more_j: f64) {
        if let Some(battery) = &home.battery {
            self.energy_j = battery.charged_for_j(self.energy_j - more_j, f64::from(visit.charged));
        }
        self.slot += visit.charged + if self.at == visit.at { 0 } else { visit.slots };
        self.at = visit.at;
    }

    /// Serves `members`, and of the other sensors in range those whose visits save most.
    fn serve_in_range(
        &mut self,
        model: &PlanningModel,
        members: &[u32],
        empty: &mut [f64],
        visits: &mut Vec<Visit>,
    ) -> f64 {
        let slot = self.slot;
        let blocks = model.table.limits.blocks();
        let found = &mut self.found;
        found.clear();
        if members.len() == blocks {
            let away_m2 = |&sensor: &u32| distance_squared(model.table.sensors.position(sensor), &self.at);
            found.extend(members.iter().map(|sensor| Candidate::new(model, *sensor, away_m2(sensor), &self.at)));
        } else {
            model.table.sensors.grid.visit(
                &self.at,
                model.table.limits.comm_radius_m * (1.0 + RANGE_SLACK),
                |node, d2_m2| {
                    found.push(Candidate::new(model, node.id, d2_m2, &self.at));
                },
            );
        }
        if found.len() > blocks {
            for candidate in found.iter_mut() {
                let sensor = candidate.sensor as usize;
                let gap_slots = f64::from(slot) - model.last_empty(sensor, f64::from(slot), empty[sensor]);
                if members.contains(&candidate.sensor) {
                    candidate.saved_bits = f64::INFINITY;
                } else {
                    candidate.weigh(model, gap_slots);
                }
            }
            found.select_nth_unstable_by(blocks - 1, Candidate::order);
            found.truncate(blocks);
        }
        let mut lost_bits = 0.0;
        for &Candidate { sensor, capacity_slots, .. } in found.iter() {
            let visit = Visit { sensor, slot, capacity_slots };
            lost_bits += serve(model, empty, &visit);
            visits.push(visit);
        }
        lost_bits
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::horizon::forecast::Forecast;
    use crate::horizon::tests::{model_of, window_of};

    #[test]
    fn a_visit_loses_the_overflow_and_uploads_the_capacity_of_the_link() {
        let model = model_of(&[([200.0, 200.0], 1_000.0)], 4, 5e6); // full in 30 slots
        let mut empty = vec![-10.0];
        // 35 slots later 45 slots of data have come, of which 15 were lost; the link leaves 30 − 12 = 18.
        let lost_bits = serve(&model, &mut empty, &Visit { sensor: 0, slot: 35, capacity_slots: 12.0 });
        assert_eq!((lost_bits, empty[0]), (15_000.0, 17.0));
        // 5 slots later there are 23; the link carries more.
        let lost_bits = serve(&model, &mut empty, &Visit { sensor: 0, slot: 40, capacity_slots: f64::INFINITY });
        assert_eq!((lost_bits, empty[0]), (0.0, 40.0));
    }

    #[test]
    fn a_flight_serves_in_every_slot_on_the_way() {
        // 85 m in three steps of 28.3 m, with an SN beside the end of each.
        let sensors = [[285.0, 200.0], [228.0, 205.0], [257.0, 205.0]].map(|position_m| (position_m, 500.0));
        let model = model_of(&sensors, 4, 5e6);
        let mut forecast = Forecast::new(&model, window_of(&model, 10));
        forecast.load(&model, [0]);
        let served: Vec<(i32, u32)> = forecast.trace.visits.iter().map(|visit| (visit.slot, visit.sensor)).collect();
        assert_eq!(served, [(1, 1), (2, 2), (3, 0)]);
    }
}
