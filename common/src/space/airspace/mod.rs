//! Where a UAV may fly: an area without no-fly zones and buildings (decisions D14 to D16).
//!
//! The straight way of a slot must not enter the closed ground: the interior of what all zones, and the outside of the
//! area, cover together (`ground.rs`). On it there is one kind of ways, a file each with its part of `Ways`: in an
//! open field every way is straight; the shortest way between zones bends at their corners only; on a grid (decision
//! D17a) ways lead from the middle of a cell to that of a neighbour.

mod boxes;
mod cells;
mod contacts;
mod corners;
mod ground;
mod polygon;
mod simplify;
mod straight;
mod ways;

use std::sync::Arc;

use enum_dispatch::enum_dispatch;

pub use cells::{MAX_CELLS, cells_along};
pub use polygon::{Bends, Polygon};
pub use simplify::{KeptGround, simplify};

use crate::geometry::Position;
use cells::GridCells;
use corners::BentWays;
use ground::ClosedGround;
use straight::Straight;
use ways::Ways;

/// Most corners of all zones and buildings of a scenario.
pub const MAX_CORNERS: usize = 100_000;

/// Corners of all zones and buildings up to which they are not simplified.
pub const SIMPLIFIED_CORNERS: usize = 1_000;

/// Most corners of all zones and buildings that ways lead around.
pub const MAX_SIMPLIFIED_CORNERS: usize = 2_000;

/// The kinds of ways. Clones share what they have found.
#[enum_dispatch(Ways)]
#[derive(Debug, Clone, PartialEq)]
enum AnyWays {
    Straight(Straight),
    Bent(Arc<BentWays>),
    Cells(Arc<GridCells>),
}

impl Default for AnyWays {
    fn default() -> Self {
        Self::Straight(Straight)
    }
}

/// Where a UAV may fly.
///
/// The default is open.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Airspace {
    ground: ClosedGround,
    ways: AnyWays,
}

impl Airspace {
    /// The airspace over an area of these sides [m], for a UAV that flies `lowest_m` [m] high or higher, with zones up
    /// to their tops [m]. It checks single ways; all its ways are straight.
    #[must_use]
    pub fn new(sides_m: [f64; 2], lowest_m: f64, zones: impl Iterator<Item = (Polygon, f64)>) -> Self {
        Self { ground: ClosedGround::new(sides_m, lowest_m, zones), ways: AnyWays::default() }
    }

    /// The same with ways along a grid of cells of this side [m], with moves of `move_slots` slots, for a UAV that
    /// begins at `start` [m].
    #[must_use]
    pub fn on_grid(self, cell_m: f64, move_slots: u64, start: &Position) -> Self {
        let cells = GridCells::over(&self.ground, cell_m, move_slots, start);
        Self { ways: Arc::new(cells).into(), ..self }
    }

    /// The same with ways around zones, for a UAV that begins at `start` [m].
    #[must_use]
    pub fn with_ways(self, start: &Position) -> Self {
        if self.ground.is_open() {
            return self;
        }
        let bent = BentWays::of(&self.ground, start);
        Self { ways: Arc::new(bent).into(), ..self }
    }

    /// Whether all ways lead along a grid.
    #[inline]
    pub fn has_grid(&self) -> bool {
        matches!(self.ways, AnyWays::Cells(_))
    }

    /// Slots of a move to a neighbouring cell of the grid; 1 without one.
    pub fn move_slots(&self) -> u64 {
        self.ways.move_slots()
    }

    /// The middles of the cells of the grid that a way leads to from the start [m]; none without a grid.
    pub fn cells(&self) -> impl Iterator<Item = Position> {
        self.ways.reached().into_iter()
    }

    /// Whether all ways are straight.
    #[inline]
    pub fn is_open(&self) -> bool {
        self.ground.is_open() && !self.has_grid()
    }

    /// Its zones that rise above the altitude `z_m` [m].
    pub fn zones_above(&self, z_m: f64) -> impl Iterator<Item = &Polygon> {
        self.ground.zones_above(z_m)
    }

    /// The middles of the cells that a move leads to from the middle of one, at `at` [m]; none elsewhere, and without a
    /// grid.
    pub fn neighbours(&self, at: &Position) -> Vec<Position> {
        self.ways.neighbouring(at)
    }

    /// Whether `point` [m] lies in the area, and not in closed ground.
    pub fn contains(&self, point: &Position) -> bool {
        self.ground.contains(point)
    }

    /// Whether the straight way enters no zone, and on a grid leads along a line of it, within a move. A way that
    /// begins in a zone may leave it.
    #[inline]
    pub fn is_free(&self, from: &Position, to: &Position) -> bool {
        self.is_open() || self.ways.is_free(&self.ground, from, to)
    }

    /// Whether a straight way from `from` to `to` [m] keeps to the grid; always without one.
    pub fn is_move(&self, from: &Position, to: &Position) -> bool {
        self.ways.is_move(from, to)
    }

    /// The fraction of the straight way from `from` to `to` [m] at which it enters closed ground, by more than
    /// `slack_m` [m], between the altitudes `z_m` [m] at its ends; `None` if it enters none.
    pub fn entry(&self, from: &Position, to: &Position, z_m: [f64; 2], slack_m: f64) -> Option<f64> {
        self.ground.entry(from, to, z_m, slack_m)
    }

    /// The farthest point of the straight way from `from` to `to` [m] before it enters a zone, between the
    /// altitudes `z_m` [m] at its ends.
    pub fn last_free(&self, from: &Position, to: &Position, z_m: [f64; 2]) -> Position {
        if !self.is_move(from, to) {
            return *from;
        }
        let Some(fraction) = self.entry(from, to, z_m, self.ground.slack_m()) else { return *to };
        let along = to - from;
        let before = fraction - self.ground.clearance_m() / along.norm();
        from + along * before.max(0.0)
    }

    /// The point that a UAV which comes from the start can fly to, nearest to `point` [m]: the point itself, or beside
    /// the zone that it lies in.
    pub fn nearest(&self, point: &Position) -> Position {
        if self.is_open() { *point } else { self.ways.nearest(&self.ground, point) }
    }

    /// Whether `point` [m] is free, and a way leads there from the start.
    pub fn is_reachable(&self, point: &Position) -> bool {
        self.ways.is_reachable(&self.ground, point)
    }

    /// The shortest way from `from` to `to` [m]: its bends, and `to`; where `to` lies in a zone, the nearest point
    /// beside it. Empty if no way leads there.
    pub fn way(&self, from: &Position, to: &Position) -> Bends {
        self.ways.way(&self.ground, from, to)
    }

    /// The shortest way from `from` to `to`, up to where it comes within `radius_m` [m] of `centre`; empty if it does
    /// not.
    pub fn way_into(&self, from: &Position, to: &Position, centre: &Position, radius_m: f64) -> Bends {
        self.ways.way_into(&self.ground, from, to, centre, radius_m)
    }

    /// Length of the shortest way [m]; infinite if there is none.
    pub fn distance_m(&self, from: &Position, to: &Position) -> f64 {
        self.ways.distance_m(&self.ground, from, to)
    }

    /// Lengths of the shortest ways between all `points` [m], by rows; infinite where there is none. A point in a zone
    /// counts as the nearest one beside it.
    pub fn distances_m(&self, points: &[Position]) -> Vec<f64> {
        let count = points.len();
        let points: Vec<Position> = points.iter().map(|point| self.nearest(point)).collect();
        let mut lengths_m = vec![0.0; count * count];
        for from in 0..count {
            for to in from + 1..count {
                let length_m = self.ways.between_m(&self.ground, &points[from], &points[to]);
                lengths_m[from * count + to] = length_m;
                lengths_m[to * count + from] = length_m;
            }
        }
        lengths_m
    }

    /// The end of `slot` of a UAV at `from` that is told to fly to `to` [m], up to `reach_m` [m]: `to` if the way is
    /// free, otherwise a part of the shortest way. On a grid a move that is under way is flown to its end, and the next
    /// begins in its turn.
    #[inline]
    pub fn slot_end(&self, slot: u64, from: &Position, to: &Position, reach_m: f64) -> Position {
        if self.is_open() { *to } else { self.ways.slot_end(&self.ground, slot, from, to, reach_m) }
    }

    /// The end of `slot` of a UAV at `from` that is under way on a grid, or hovers until the next move may begin [m];
    /// `None` where it may be told a waypoint.
    pub fn under_way(&self, slot: u64, from: &Position) -> Option<Position> {
        self.ways.under_way(slot, from)
    }

    /// The slots from `slot` on that are decided with a flight from `from` to `to` [m], and where the UAV is after
    /// them: on a grid a whole move.
    pub fn committed(&self, slot: u64, from: &Position, to: &Position) -> (u64, Position) {
        self.ways.committed(slot, from, to)
    }

    /// The end of a slot that flies up to `reach_m` [m] along the shortest way from `from` to `to`: the point at that
    /// length, or the first bend. Beyond a bend it flies straight on where that brings it nearer to the next one.
    pub fn toward(&self, from: &Position, to: &Position, reach_m: f64) -> Position {
        self.ways.toward(&self.ground, from, to, reach_m)
    }

    /// The ends of the slots of [`Self::toward`] up to the end of the `way` from `from`, without those of its last
    /// straight part.
    pub fn bent_part(&self, from: &Position, way: &[Position], reach_m: f64) -> Vec<Position> {
        let mut ends = Vec::new();
        let mut at = *from;
        let mut rest = way;
        while rest.len() > 1 {
            let (end, passed) = self.ways.step(&self.ground, &at, rest, reach_m);
            at = end;
            rest = &rest[passed..];
            ends.push(end);
        }
        ends
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::length_m;
    use crate::scenario::{Overrides, Scenario};
    use std::path::Path;

    /// 100 m × 100 m with a wall from (50, 0) to (54, 80), and the UAV at (20, 50).
    fn walled(more: &str) -> Airspace {
        let text = format!(
            "name = 'a'\n[area]\nno_fly = [{{ polygon_m = [[50.0, 0.0], [54.0, 0.0], [54.0, 80.0], [50.0, 80.0]] }}]\n{more}\
             [uav]\nstart_m = [20.0, 50.0]\n"
        );
        Scenario::parse(&text, Path::new("a.toml"), Overrides::default()).unwrap().airspace()
    }

    fn at(x_m: f64, y_m: f64) -> Position {
        Position::new(x_m, y_m)
    }

    #[test]
    fn a_path_around_a_wall_turns_at_its_corners() {
        let airspace = walled("");
        let way = airspace.way(&at(20.0, 50.0), &at(84.0, 50.0));
        // 2 · √(30² + 30²) + 4
        assert!((length_m(&at(20.0, 50.0), &way) - (2.0 * 1_800f64.sqrt() + 4.0)).abs() < 1e-4, "{way:?}");
        assert_eq!(way.len(), 3);
        assert_eq!(airspace.distance_m(&at(20.0, 50.0), &at(20.0, 90.0)), 40.0);
    }

    #[test]
    fn a_slot_passes_a_turning_point_if_that_ends_nearer_the_target() {
        let airspace = walled("");
        // The bend at (50, 80) is 2.8 m away; straight on leads out of the way to the next, at (54, 80).
        let end = airspace.toward(&at(48.0, 78.0), &at(84.0, 50.0), 30.0);
        assert!((end - at(52.0, 82.0)).norm() < 1e-4, "{end}");
        assert!(airspace.is_free(&end, &at(54.0, 80.000_01)));
    }

    #[test]
    fn a_path_to_a_disk_ends_at_its_rim() {
        let airspace = walled("");
        let centre = at(52.0, 40.0); // in the wall
        let nearest = airspace.nearest(&centre);
        assert!((nearest.x - 50.0).abs() < 1e-5 || (nearest.x - 54.0).abs() < 1e-5, "{nearest}");
        let way = airspace.way_into(&at(20.0, 50.0), &nearest, &centre, 10.0);
        let end = way[way.len() - 1];
        assert!(((end - centre).norm() - 10.0).abs() < 1e-9 && airspace.contains(&end), "{end}");
        assert!(airspace.way_into(&at(20.0, 50.0), &nearest, &centre, 1.5).is_empty(), "out of range beside the wall");
        assert_eq!(airspace.way_into(&end, &nearest, &centre, 11.0)[..], [end], "it is there");
    }

    /// Two bars that cross at (50, 50): of a point in both, all nearest points of edges lie in the other bar.
    #[test]
    fn the_nearest_free_point_at_overlapping_zones_is_their_crossing() {
        let text = "name = 'a'\n[area]\nno_fly = [{ polygon_m = [[10, 40], [90, 40], [90, 60], [10, 60]] },\
                    { polygon_m = [[40, 10], [60, 10], [60, 90], [40, 90]] }]\n[uav]\nstart_m = [5.0, 5.0]\n";
        let airspace = Scenario::parse(text, Path::new("a.toml"), Overrides::default()).unwrap().airspace();
        for (point, crossing) in [(at(47.0, 52.0), at(40.0, 60.0)), (at(55.0, 44.0), at(60.0, 40.0))] {
            let nearest = airspace.nearest(&point);
            assert!((nearest - crossing).norm() < 1e-4 && airspace.is_reachable(&nearest), "{point}: {nearest}");
        }
    }

    #[test]
    fn an_enclosed_point_is_not_reachable() {
        let closed = "building = [{ polygon_m = [[50.0, 79.0], [100.0, 79.0], [100.0, 90.0], [50.0, 90.0]], height_m = 99.0 }]\n";
        let airspace = walled(closed);
        assert!(!airspace.is_reachable(&at(80.0, 50.0)) && airspace.is_reachable(&at(80.0, 95.0)));
        assert!(airspace.way(&at(20.0, 50.0), &at(80.0, 50.0)).len() <= 1, "to the nearest point that is");
        let nearest = airspace.nearest(&at(80.0, 50.0));
        assert!(airspace.is_reachable(&nearest), "{nearest}");
        let low = closed.replace("99.0", "20.0");
        assert!(walled(&low).is_reachable(&at(80.0, 50.0)), "over the building");
    }
}
