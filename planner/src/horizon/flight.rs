//! The decoder: how one stop of a plan is flown, and whom the UAV meets on the way.

use skysink_common::geometry::{Position, distance_squared};

use super::choice::Candidate;
use super::world::World;
use crate::geometry::disks::{Disk, nearest_in_both};

/// Slack of the number of slots to a stop, relative to one slot's reach; far below the slack of decision D5.
const SLOT_SLACK: f64 = 1e-11;

/// Slack of range, relative to the communication radius: half that of decision D5, which has the last word.
const RANGE_SLACK: f64 = 0.5e-9;

/// One source served in one slot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Visit {
    /// The source.
    pub source: u32,
    /// The slot, from 1 for the one that is being planned.
    pub slot: i32,
    /// The most that the visit takes [slots of sampling].
    pub capacity_slots: f64,
}

/// One stop as flown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leg {
    /// The place that is served.
    pub place: u32,
    /// Slot at whose end it is served.
    pub end: i32,
    /// Where the UAV is then.
    pub at: Position,
    /// Index of its first visit; those on the way to it belong to it.
    pub first: u32,
}

/// Legs with their visits.
#[derive(Debug, Clone, Default)]
pub struct Trace {
    /// Stops in the order of flight.
    pub legs: Vec<Leg>,
    /// Visits in the order of time.
    pub visits: Vec<Visit>,
}

/// What the sources hold, as the slot in which each would have been empty: `e_i`, so that a queue is
/// `s_i τ (t − e_i)` after slot t if it did not overflow.
pub type Empty = [f64];

/// Serves one visit: what has overflowed before it is lost [bit], and the rest goes up to the visit's capacity.
#[inline]
pub fn serve(world: &World, empty: &mut Empty, visit: &Visit) -> f64 {
    let source = &world.sources[visit.source as usize];
    let slot = f64::from(visit.slot);
    let empty = &mut empty[visit.source as usize];
    let overflow_slots = source.overflow_slots(slot, *empty);
    *empty = slot - ((slot - *empty).min(source.fill_slots) - visit.capacity_slots).max(0.0);
    overflow_slots * source.mean_bits
}

/// Slots to get from `from` to a point within `radius_m` [m] of `centre` at `reach_m` [m] a slot, at least 1.
#[inline]
#[must_use]
pub fn slots_for(from: &Position, reach_m: f64, centre: &Position, radius_m: f64) -> f64 {
    let away_m = distance_squared(from, centre).sqrt() - radius_m;
    (away_m / reach_m - SLOT_SLACK).ceil().max(1.0)
}

/// Slots to get from `from` to a point in range of all members of `place`, at least 1.
#[inline]
#[must_use]
pub fn slots_to(world: &World, from: &Position, place: u32) -> i32 {
    let place = &world.places[place as usize];
    slots_for(from, world.reach_m(), &place.centre, place.radius_m).min(1e9) as i32
}

/// The point within `reach_m` of `from` and `radius_m` of `centre` that is nearest to `target`.
#[must_use]
pub fn aim(from: &Position, reach_m: f64, centre: &Position, radius_m: f64, target: &Position) -> Position {
    let reach = Disk { centre: *from, radius_m: reach_m };
    nearest_in_both(target, &reach, &Disk { centre: *centre, radius_m })
}

/// The state of a flight under decoding.
#[derive(Debug, Clone, Default)]
pub struct Decoder {
    /// Where the UAV is.
    pub at: Position,
    /// The last slot flown.
    pub slot: i32,
    /// Who is served at the end of that slot.
    served: Vec<u32>,
    /// The members of the stops that end with that slot.
    stopped: Vec<u32>,
    /// In range at the end of a slot.
    found: Vec<Candidate>,
}

impl Decoder {
    /// Puts the UAV `at` the end of `slot`, in which `served` were served and the stops `stopped` ended.
    pub fn resume<'a>(
        &mut self,
        world: &World,
        at: Position,
        slot: i32,
        served: impl Iterator<Item = u32>,
        stopped: impl Iterator<Item = &'a Leg>,
    ) {
        self.at = at;
        self.slot = slot;
        self.served.clear();
        self.served.extend(served);
        self.stopped.clear();
        for leg in stopped {
            self.stopped.extend_from_slice(&world.places[leg.place as usize].members);
        }
    }

    /// Whether the last slot serves all members of `place` although it did not stop for them.
    pub fn meets(&self, world: &World, place: u32) -> bool {
        let met = |source: &u32| self.served.contains(source) && !self.stopped.contains(source);
        world.places[place as usize].members.iter().all(met)
    }

    /// Flies to `place` with `next` in mind, and serves whoever is in range at the end of each slot. Returns what has
    /// overflowed before the visits [bit]; none, and flies nowhere, if it would arrive after slot `last`.
    ///
    /// A stop whose members are all served in the last slot anyway takes no time, unless that slot stopped for them.
    pub fn fly(
        &mut self,
        world: &World,
        (place, next): (u32, Option<u32>),
        last: i32,
        empty: &mut Empty,
        visits: &mut Vec<Visit>,
    ) -> Option<f64> {
        let members = &world.places[place as usize].members;
        if self.meets(world, place) {
            self.stopped.extend_from_slice(members);
            return Some(0.0);
        }
        let slots = slots_to(world, &self.at, place);
        if slots > last - self.slot {
            return None;
        }
        let waypoint = waypoint(world, &self.at, slots, place, next);
        let (from, begin) = (self.at, self.slot);
        let mut lost_bits = 0.0;
        for step in 1..slots {
            self.at = from + (waypoint - from) * (f64::from(step) / f64::from(slots));
            self.slot = begin + step;
            lost_bits += self.meet(world, &[], empty, visits);
        }
        self.at = waypoint;
        self.slot = begin + slots;
        self.stopped.clear();
        self.stopped.extend_from_slice(members);
        Some(lost_bits + self.meet(world, members, empty, visits))
    }

    /// Serves `members` and then those of the others in range for whom it saves most.
    fn meet(&mut self, world: &World, members: &[u32], empty: &mut Empty, visits: &mut Vec<Visit>) -> f64 {
        let (slot, now) = (self.slot, f64::from(self.slot));
        let found = &mut self.found;
        found.clear();
        if members.len() == world.blocks() {
            let away_m2 = |&source: &u32| distance_squared(&world.positions[source as usize], &self.at);
            found.extend(members.iter().map(|source| Candidate::new(world, *source, away_m2(source))));
        } else {
            world.grid.visit(&self.at, world.radius_m() * (1.0 + RANGE_SLACK), |node, d2_m2| {
                found.push(Candidate::new(world, node.id, d2_m2));
            });
        }
        if found.len() > world.blocks() {
            for candidate in found.iter_mut() {
                let gap_slots = now - empty[candidate.source as usize];
                let is_member = members.contains(&candidate.source);
                if is_member { candidate.stop() } else { candidate.weigh(world, gap_slots) }
            }
            found.select_nth_unstable_by(world.blocks() - 1, Candidate::order);
            found.truncate(world.blocks());
        }
        self.served.clear();
        let mut lost_bits = 0.0;
        for &Candidate { source, capacity_slots, .. } in found.iter() {
            let visit = Visit { source, slot, capacity_slots };
            lost_bits += serve(world, empty, &visit);
            visits.push(visit);
            self.served.push(source);
        }
        lost_bits
    }
}

/// Where the UAV at `from` serves `place` from, `slots` later: as near to `next` as it can.
fn waypoint(world: &World, from: &Position, slots: i32, place: u32, next: Option<u32>) -> Position {
    let reach_m = world.reach_m() * f64::from(slots);
    let place = &world.places[place as usize];
    let target = next.map_or(place.centre, |next| world.places[next as usize].centre);
    aim(from, reach_m, &place.centre, place.radius_m, &target)
}
