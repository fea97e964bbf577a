//! The decoder: flies a plan stop by stop, and schedules sensors on the way.

use skysink_common::geometry::{Position, distance_squared};

use super::choice::Candidate;
use super::model::PlanningModel;
use crate::geometry::disks::{Disk, nearest_in_both, slots_between};

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
    let overflow_slots = sensor.overflow_slots(slot, *empty);
    *empty = slot - ((slot - *empty).min(sensor.fill_slots) - visit.capacity_slots).max(0.0);
    overflow_slots * sensor.cost_bits
}

/// Slots to fly from `from` to a point in range of all members of `stop`, at least 1.
#[inline]
#[must_use]
pub fn slots_to(model: &PlanningModel, from: &Position, stop: u32) -> i32 {
    slots_between(from, model.disk(stop), model.table.limits.reach_m).min(1e9) as i32
}

/// The state of a decoded flight.
#[derive(Debug, Clone, Default)]
pub struct Decoder {
    /// Position of the UAV.
    pub at: Position,
    /// The last flown slot.
    pub slot: i32,
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
        let slots = slots_to(model, &self.at, stop);
        if slots > last - self.slot {
            return None;
        }
        let from = self.at;
        let begin = self.slot;
        let reach = Disk { centre: from, radius_m: model.table.limits.reach_m * f64::from(slots) };
        let waypoint = nearest_in_both(&model.disk(next.unwrap_or(stop)).centre, &reach, model.disk(stop));
        let mut lost_bits = 0.0;
        for step in 1..slots {
            self.at = from + (waypoint - from) * (f64::from(step) / f64::from(slots));
            self.slot = begin + step;
            lost_bits += self.serve_in_range(model, &[], empty, visits);
        }
        self.at = waypoint;
        self.slot = begin + slots;
        Some(lost_bits + self.serve_in_range(model, &model.disks[stop as usize].members, empty, visits))
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
            found.extend(members.iter().map(|sensor| Candidate::new(model, *sensor, away_m2(sensor))));
        } else {
            model.table.sensors.grid.visit(
                &self.at,
                model.table.limits.comm_radius_m * (1.0 + RANGE_SLACK),
                |node, d2_m2| {
                    found.push(Candidate::new(model, node.id, d2_m2));
                },
            );
        }
        if found.len() > blocks {
            for candidate in found.iter_mut() {
                let gap_slots = f64::from(slot) - empty[candidate.sensor as usize];
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
