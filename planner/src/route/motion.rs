//! The routes of a UAV that flies straight at any speed up to its top speed, around zones, or from cell to cell of a
//! grid (decisions D15 and D17a).

use std::sync::Arc;

use nalgebra::{Rotation2, Vector2};
use skysink_common::airspace::{Airspace, Bends};
use skysink_common::base::Base;
use skysink_common::battery::Battery;
use skysink_common::geometry::{Position, distance_squared};
use skysink_common::scenario::Scenario;
use skysink_common::slack::SLOTS_SLACK;
use smallvec::SmallVec;

use super::route::{Route, RoutePart};
use crate::geometry::disks::{Disk, nearest_in_both, slots_between, toward};

/// Most slots of a route; no mission has more.
pub(crate) const MOST_SLOTS: u32 = 1_000_000_000;

/// Turns [°] away from a direction in which a flight may give way.
const TURNS_DEG: [f64; 8] = [0.0, 45.0, -45.0, 90.0, -90.0, 135.0, -135.0, 180.0];

/// Parts of its length that it may fly there.
const PARTS: [f64; 2] = [1.0, 0.5];

/// How far a waypoint may be from where a slot by cells ends, to be the same [m].
const BESIDE_M: f64 = 1e-5;

/// How a UAV flies.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    airspace: Arc<Airspace>,
    /// Farthest flight in a slot [m].
    reach_m: f64,
    /// Flight in a slot at the least energy per metre [m]. Along a grid all moves take the same time.
    thrifty_m: f64,
    /// What its flights take energy from.
    battery: Battery,
}

impl Motion {
    /// The motion of a scenario's UAV.
    #[must_use]
    pub fn of(scenario: &Scenario, airspace: &Arc<Airspace>) -> Self {
        let battery = Battery::of(scenario);
        let reach_m = scenario.reach_m();
        let thrifty_m = if airspace.has_grid() { reach_m } else { battery.thrifty_m(reach_m) };
        Self { airspace: Arc::clone(airspace), reach_m, thrifty_m, battery }
    }

    /// What its flights take energy from.
    pub fn battery(&self) -> &Battery {
        &self.battery
    }

    /// Whether it flies from cell to cell of a grid.
    #[inline]
    pub fn is_by_cells(&self) -> bool {
        self.airspace.has_grid()
    }

    /// Slots of a move to a neighbouring cell, and of a hover; 1 without a grid.
    pub fn move_slots(&self) -> u64 {
        self.airspace.move_slots()
    }

    /// Farthest flight in a slot [m].
    pub fn reach_m(&self) -> f64 {
        self.reach_m
    }

    /// Flight in a slot at the least energy per metre [m]; on a grid, and without a battery, the farthest.
    pub fn thrifty_m(&self) -> f64 {
        self.thrifty_m
    }

    /// Places well inside of `base` [m]; along a grid the middles of its cells.
    pub fn places_in(&self, base: &Base) -> Arc<[Position]> {
        match self.is_by_cells() {
            false => base.places().collect(),
            true => self.airspace.cells().filter(|cell| base.contains(cell)).collect(),
        }
    }

    /// The end of a slot that flies from `from` toward `goal` [m], as far as one slot reaches, stopping on it if it is
    /// nearer: straight, or around zones.
    pub fn toward(&self, from: &Position, goal: &Position) -> Position {
        if self.is_straight(from, goal) {
            return toward(self.reach_m, from, goal);
        }
        self.airspace.toward(from, goal, self.reach_m)
    }

    /// Length of the shortest path [m]; infinite if there is none.
    pub fn distance_m(&self, from: &Position, to: &Position) -> f64 {
        self.distance_m2(from, to).sqrt()
    }

    /// Its square [m²], for comparisons: without a root, in an open field.
    pub fn distance_m2(&self, from: &Position, to: &Position) -> f64 {
        if self.is_straight(from, to) { distance_squared(from, to) } else { self.airspace.distance_m(from, to).powi(2) }
    }

    /// Whether it flies straight from `from` to `to` [m]: as in an open field, to the last bit, where no zone is in the
    /// way.
    #[inline]
    fn is_straight(&self, from: &Position, to: &Position) -> bool {
        self.airspace.is_open() || !self.is_by_cells() && self.airspace.is_free(from, to)
    }

    /// Slots that no path from `from` into `disk` falls short of: those of the straight one, at least 1.
    #[inline]
    pub fn least_slots_into(&self, from: &Position, disk: &Disk) -> f64 {
        slots_between(from, disk, self.reach_m)
    }

    /// Slots of the shortest path from `from` into `disk`, at least 1, on a grid at least those of a hover; infinite if
    /// there is none.
    pub fn slots_into(&self, from: &Position, disk: &Disk) -> f64 {
        if self.is_straight(from, &disk.centre) {
            return self.least_slots_into(from, disk);
        }
        self.shortest_into(from, disk).map_or(f64::INFINITY, |route| f64::from(route.slots()))
    }

    /// The shortest path from `from` into `disk`, toward its centre or the point beside zones that is nearest to it;
    /// empty if there is none.
    pub fn path_into(&self, from: &Position, disk: &Disk) -> Bends {
        self.airspace.way_into(from, &self.airspace.nearest(&disk.centre), &disk.centre, disk.radius_m)
    }

    /// The route along it, at full speed.
    pub fn shortest_into(&self, from: &Position, disk: &Disk) -> Option<Route> {
        self.along(from, &self.path_into(from, disk))
    }

    /// The route from `from` into `disk` in the fewest slots, that ends as near to `next` [m] as they allow; around
    /// zones and on a grid where it comes into the disk. `None` if there is none.
    pub fn enter(&self, from: &Position, disk: &Disk, next: &Position) -> Option<Route> {
        if self.is_by_cells() {
            return self.shortest_into(from, disk);
        }
        let slots = slots_between(from, disk, self.reach_m).min(f64::from(MOST_SLOTS));
        let reach = Disk { centre: *from, radius_m: self.reach_m * slots };
        let end = nearest_in_both(next, &reach, disk);
        if self.airspace.is_free(from, &end) {
            return Some(Route::new(*from, [RoutePart { end, slots: slots as u32 }], Some(&self.battery)));
        }
        self.shortest_into(from, disk)
    }

    /// The route along `path`: at full speed up to its last straight part, which is flown in equal steps. `None` if the
    /// path is empty.
    fn along(&self, from: &Position, path: &[Position]) -> Option<Route> {
        let end = *path.last()?;
        let bent = self.airspace.bent_part(from, path, self.reach_m);
        let rest_m = (end - bent.last().unwrap_or(from)).norm();
        let mut slots = (rest_m / self.reach_m - SLOTS_SLACK).ceil().max(0.0);
        if bent.is_empty() && slots == 0.0 {
            slots = self.move_slots() as f64; // a hover takes as many
        }
        let rest = RoutePart { end, slots: slots.min(f64::from(MOST_SLOTS / 2)) as u32 };
        let bent = bent.into_iter().map(|end| RoutePart { end, slots: 1 });
        Some(Route::new(*from, bent.chain([rest]), Some(&self.battery)))
    }

    /// The route from `from` to `end` [m] of least energy in `left` slots: its straight parts at the speed of least
    /// energy per metre, of which the first have the slots that are not needed for full speed. Around zones at full
    /// speed, as every other flight, where there is no time for whole slots in each part, or no battery. `None` if
    /// there is none.
    pub fn thrifty(&self, from: &Position, end: &Position, left: u64) -> Option<Route> {
        let path = self.airspace.way(from, end);
        let slots = |length_m: f64, slot_m: f64| (length_m / slot_m - SLOTS_SLACK).ceil().max(0.0);
        let begins = std::iter::once(from).chain(&path);
        let lengths_m: SmallVec<[f64; 4]> = begins.zip(&path).map(|(begin, end)| (end - begin).norm()).collect();
        let fastest = lengths_m.iter().map(|length_m| slots(*length_m, self.reach_m)).sum::<f64>();
        if path.len() > 1 && (self.battery.is_endless() || fastest > left as f64) {
            return self.along(from, &path);
        }
        let mut spare = left as f64 - fastest;
        let part = |(end, length_m): (&Position, &f64)| {
            let fastest = slots(*length_m, self.reach_m);
            let more = (slots(*length_m, self.thrifty_m) - fastest).min(spare).max(0.0);
            spare -= more;
            RoutePart { end: *end, slots: (fastest + more).min(f64::from(MOST_SLOTS)) as u32 }
        };
        let parts: SmallVec<[RoutePart; 4]> = path.iter().zip(&lengths_m).map(part).collect();
        (!parts.is_empty()).then(|| Route::new(*from, parts, Some(&self.battery)))
    }

    /// The route of no slots of a UAV at `at` [m].
    pub fn stay(&self, at: &Position) -> Route {
        Route::new(*at, [RoutePart { end: *at, slots: 0 }], None)
    }

    /// A hover at `at` [m]: a slot, on a grid as many as a move takes.
    pub fn wait(&self, at: &Position) -> Route {
        Route::new(*at, [RoutePart { end: *at, slots: self.move_slots() as u32 }], Some(&self.battery))
    }

    /// The end of `slot` of a UAV at `from` that is told to fly to `to` [m]: `to` if the path is free, otherwise a part
    /// of the shortest path. On a grid a move that is under way is flown to its end.
    #[inline]
    pub fn slot_end(&self, slot: u64, from: &Position, to: &Position) -> Position {
        self.airspace.slot_end(slot, from, to, self.reach_m)
    }

    /// Whether a slot that ends at `end` [m] does what one to `to` would.
    pub fn is_same(&self, end: &Position, to: &Position) -> bool {
        (end - to).norm() <= if self.is_by_cells() { BESIDE_M } else { 0.0 }
    }

    /// The slots from `slot` on that are decided with a flight from `from` to `to` [m], and where the UAV is after
    /// them: on a grid a whole move.
    pub fn committed(&self, slot: u64, from: &Position, to: &Position) -> (u64, Position) {
        self.airspace.committed(slot, from, to)
    }

    /// The end of `slot` of a UAV at `from` that is under way on a grid, or hovers until the next move may begin [m];
    /// `None` where it may be told a waypoint.
    pub fn under_way(&self, slot: u64, from: &Position) -> Option<Position> {
        self.airspace.under_way(slot, from)
    }

    /// Where `slot` may end instead of at `to` [m]: on the straight line from `from`, beside it and behind it, and in
    /// reach of a slot around; on a grid in the neighbouring cells. They may be in zones, or outside of the area.
    pub fn alternatives(&self, slot: u64, from: &Position, to: &Position) -> Vec<Position> {
        if self.is_by_cells() {
            let flown = |cell: Position| self.slot_end(slot, from, &cell);
            return self.airspace.neighbours(from).into_iter().map(flown).collect();
        }
        let along = to - from;
        let ahead = along.try_normalize(0.0).unwrap_or_else(Vector2::x) * self.reach_m;
        let turned = |turn_deg: f64| {
            let turn = Rotation2::new(turn_deg.to_radians());
            let [whole, half] = PARTS.map(|part| from + turn * along * part);
            [whole, half, from + turn * ahead]
        };
        TURNS_DEG.into_iter().flat_map(turned).skip(1).collect()
    }
}
