//! Where a UAV may fly: an area without no-fly zones and buildings (decisions D14 to D16).
//!
//! The straight way of a slot must not enter the closed ground: the interior of what all zones, and the outside of the
//! area, cover together. The shortest way between two points bends at corners of zones only: it is the shortest path in
//! the graph of the corners that see each other. In an open field every way is straight. On a grid (decision D17a) ways
//! lead from the middle of a cell to that of a neighbour.

mod boxes;
mod contacts;
mod graph;
mod grid;
mod polygon;
mod simplify;

use std::sync::Arc;

pub use grid::{MAX_CELLS, cells_along};
pub use polygon::{Bends, Polygon};
pub use simplify::{KeptGround, simplify};

use crate::geometry::{Position, distance_squared, length_m, within};
use boxes::BoxIndex;
use contacts::ZoneContacts;
use graph::CornerGraph;
use grid::CellGrid;
use polygon::{ClosedZone, ROUNDING, nearest_between};

/// Most corners of all zones and buildings of a scenario.
pub const MAX_CORNERS: usize = 100_000;

/// Corners of all zones and buildings up to which they are not simplified.
pub const SIMPLIFIED_CORNERS: usize = 1_000;

/// Most corners of all zones and buildings that ways lead around.
pub const MAX_SIMPLIFIED_CORNERS: usize = 2_000;

/// How far ways keep from the corners that they bend at, relative to the area.
const CLEARANCE: f64 = 1e-8;

/// Farther than any corner lies from the origin along an axis [m].
const FARTHEST_M: f64 = 1e12;

/// Where a UAV may fly.
///
/// The default is open.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Airspace {
    zones: Vec<ClosedZone>,
    /// The zones by the boxes around them, but for a boundary.
    index: BoxIndex,
    contacts: ZoneContacts,
    /// The lowest altitude of the UAV [m].
    lowest_m: f64,
    /// The north-east corner of the area.
    corner: Position,
    /// The longer side of the area [m].
    extent_m: f64,
    /// Clones share it.
    graph: Arc<CornerGraph>,
    /// Where the boundaries of zones that overlap cross [m].
    crossings: Vec<Position>,
    /// The grid that all ways lead along; clones share it.
    grid: Option<Arc<CellGrid>>,
}

impl Airspace {
    /// The airspace over an area of these sides [m], for a UAV that flies `lowest_m` [m] high or higher, with zones up
    /// to their tops [m]. It checks single ways; all its ways are straight.
    #[must_use]
    pub fn new(sides_m: [f64; 2], lowest_m: f64, zones: impl Iterator<Item = (Polygon, f64)>) -> Self {
        let extent_m = sides_m[0].max(sides_m[1]);
        let mut zones: Vec<ClosedZone> = zones.map(|(polygon, top_m)| ClosedZone { polygon, top_m }).collect();
        let mut contacts = ZoneContacts::default();
        if !zones.is_empty() {
            let [width_m, height_m] = sides_m;
            let edge = Polygon::of(&[[0.0, 0.0], [width_m, 0.0], [width_m, height_m], [0.0, height_m]], true);
            zones.extend(edge.map(|polygon| ClosedZone { polygon, top_m: f64::INFINITY }));
            contacts::close_gaps(&mut zones, extent_m);
            contacts = ZoneContacts::of(&zones, extent_m, CLEARANCE * extent_m);
            // Ways between two points of the area stay in it, if no gap at its edge is closed.
            let is_on_edge = |at: &Position| [0.0, width_m].contains(&at.x) || [0.0, height_m].contains(&at.y);
            if zones.last().is_some_and(|edge| edge.polygon.corners().iter().all(is_on_edge)) {
                zones.pop();
            }
        }
        let boxes = zones.iter().map(|zone| match zone.polygon.is_border() {
            true => [-FARTHEST_M, FARTHEST_M].map(|side_m| Position::new(side_m, side_m)),
            false => zone.polygon.extent(),
        });
        Self {
            index: BoxIndex::new(boxes),
            zones,
            contacts,
            lowest_m,
            corner: Position::from(sides_m),
            extent_m,
            graph: Arc::default(),
            crossings: Vec::new(),
            grid: None,
        }
    }

    /// The same with ways along a grid of cells of this side [m], with moves of `move_slots` slots, for a UAV that
    /// begins at `start` [m].
    #[must_use]
    pub fn on_grid(mut self, cell_m: f64, move_slots: u64, start: &Position) -> Self {
        let sides_m = [self.corner.x, self.corner.y];
        let is_clear =
            |from: &Position, to: &Position| self.contains(from) && self.contains(to) && self.is_clear(from, to);
        let grid = CellGrid::new(sides_m, cell_m, move_slots, start, is_clear);
        self.grid = Some(Arc::new(grid));
        self
    }

    /// Whether all ways lead along a grid.
    pub fn has_grid(&self) -> bool {
        self.grid.is_some()
    }

    /// Slots of a move to a neighbouring cell of the grid; 1 without one.
    pub fn move_slots(&self) -> u64 {
        self.grid.as_ref().map_or(1, |grid| grid.move_slots())
    }

    /// The middles of the cells of the grid that a way leads to from the start [m]; none without a grid.
    pub fn cells(&self) -> impl Iterator<Item = Position> {
        self.grid.iter().flat_map(|grid| grid.reached())
    }

    /// The same with ways around zones, for a UAV that begins at `start` [m].
    #[must_use]
    pub fn with_ways(mut self, start: &Position) -> Self {
        self.graph = Arc::new(CornerGraph::of(&self, start));
        let polygons: Vec<&Polygon> = self.polygons().collect();
        let pairs = (1..polygons.len()).flat_map(|second| (0..second).map(move |first| [first, second]));
        self.crossings = pairs.flat_map(|[first, second]| polygons[first].crossings(polygons[second])).collect();
        self
    }

    /// Whether all ways are straight.
    #[inline]
    pub fn is_open(&self) -> bool {
        self.zones.is_empty() && self.grid.is_none()
    }

    /// Its zones that rise above the altitude `z_m` [m].
    pub fn zones_above(&self, z_m: f64) -> impl Iterator<Item = &Polygon> {
        self.zones.iter().filter(move |zone| zone.top_m > z_m).map(|zone| &zone.polygon)
    }

    /// The middles of the cells that a move leads to from the middle of one, at `at` [m]; none elsewhere, and without a
    /// grid.
    pub fn neighbours(&self, at: &Position) -> Vec<Position> {
        self.grid.as_ref().map_or_else(Vec::new, |grid| grid.neighbouring(at))
    }

    /// Zones at the lowest altitude.
    fn polygons(&self) -> impl Iterator<Item = &Polygon> {
        self.zones_above(self.lowest_m)
    }

    /// How far a way keeps from corners [m].
    fn clearance_m(&self) -> f64 {
        CLEARANCE * self.extent_m
    }

    /// Zones that rise above the altitude `z_m` [m], and may be met on the straight way.
    fn zones_near(&self, from: &Position, to: &Position, z_m: f64) -> impl Iterator<Item = &ClosedZone> {
        let near = self.index.near(from, to, self.clearance_m()).map(|number| &self.zones[number]);
        near.filter(move |zone| zone.top_m > z_m)
    }

    /// Whether `point` [m] lies in the area, and not in closed ground.
    pub fn contains(&self, point: &Position) -> bool {
        let is_in_area = Position::origin() <= *point && *point <= self.corner;
        let slack_m = ROUNDING * self.extent_m;
        is_in_area
            && self.zones_near(point, point, self.lowest_m).all(|zone| !zone.polygon.forbids(point, slack_m))
            && !self.contacts.forbid(point, self.lowest_m)
    }

    /// Whether the straight way enters no zone, and on a grid leads along a line of it, within a move. A way that
    /// begins in a zone may leave it.
    #[inline]
    pub fn is_free(&self, from: &Position, to: &Position) -> bool {
        match &self.grid {
            Some(grid) => grid.is_free(from, to),
            None => self.is_clear(from, to),
        }
    }

    /// Whether a straight way from `from` to `to` [m] keeps to the grid; always without one.
    pub fn is_move(&self, from: &Position, to: &Position) -> bool {
        self.grid.as_ref().is_none_or(|grid| grid.is_free(from, to))
    }

    /// Whether the straight way enters no zone, wherever it leads.
    fn is_clear(&self, from: &Position, to: &Position) -> bool {
        if self.zones.is_empty() {
            return true;
        }
        let slack_m = ROUNDING * self.extent_m;
        let mut zones = self.zones_near(from, to, self.lowest_m);
        zones.all(|zone| zone.polygon.entry(from, to, slack_m, true).is_none())
            && self.contacts.entry(from, to, self.lowest_m, slack_m).is_none()
    }

    /// The fraction of the straight way from `from` to `to` [m] at which it enters closed ground, by more than
    /// `slack_m` [m], between the altitudes `z_m` [m] at its ends; `None` if it enters none.
    pub fn entry(&self, from: &Position, to: &Position, z_m: [f64; 2], slack_m: f64) -> Option<f64> {
        let [from_m, to_m] = z_m;
        let z_m = from_m.min(to_m);
        // From above a building the way leads into it, not out of it.
        let of_zone = |zone: &ClosedZone| zone.polygon.entry(from, to, slack_m, zone.top_m > from_m);
        let entries = self.zones_near(from, to, z_m).filter_map(of_zone);
        entries.chain(self.contacts.entry(from, to, z_m, slack_m)).min_by(f64::total_cmp)
    }

    /// The farthest point of the straight way from `from` to `to` [m] before it enters a zone, between the
    /// altitudes `z_m` [m] at its ends.
    pub fn last_free(&self, from: &Position, to: &Position, z_m: [f64; 2]) -> Position {
        if !self.is_move(from, to) {
            return *from;
        }
        let Some(fraction) = self.entry(from, to, z_m, ROUNDING * self.extent_m) else { return *to };
        let along = to - from;
        let before = fraction - self.clearance_m() / along.norm();
        from + along * before.max(0.0)
    }

    /// The point that a UAV which comes from the start can fly to, nearest to `point` [m]: the point itself, or beside
    /// the zone that it lies in.
    pub fn nearest(&self, point: &Position) -> Position {
        if self.is_open() {
            return *point;
        }
        let find = || if self.is_reachable(point) { *point } else { self.find_nearest(point) };
        match &self.grid {
            Some(grid) if !grid.is_reachable(point) => grid.nearest(point).unwrap_or(*point),
            Some(_) => *point,
            None => self.graph.nearest(point, find),
        }
    }

    /// The point beside zones that is nearest to `point` [m], which is not reachable.
    fn find_nearest(&self, point: &Position) -> Position {
        let projections = self.polygons().flat_map(|polygon| polygon.projections(point));
        let rims = projections.chain(self.crossings.iter().copied()).map(|rim| (rim, true));
        let mut beside: Vec<(Position, bool)> = rims.chain(self.contacts.beside().map(|rim| (rim, false))).collect();
        beside.sort_by(|a, b| distance_squared(&a.0, point).total_cmp(&distance_squared(&b.0, point)));
        let outward = |&(projected, is_rim): &(Position, bool)| {
            let away = projected - point;
            let clearance_m = if is_rim { self.clearance_m() } else { 0.0 };
            // To either side of the edge; one of them is free.
            [1.0, -1.0].map(|side| projected + away.try_normalize(0.0).unwrap_or_default() * (side * clearance_m))
        };
        let free = beside.iter().flat_map(outward).find(|point| self.is_reachable(point));
        free.unwrap_or_else(|| {
            let nodes = self.graph.reachable(self);
            let nearest = nodes.min_by(|a, b| distance_squared(a, point).total_cmp(&distance_squared(b, point)));
            nearest.copied().unwrap_or(self.graph.start())
        })
    }

    /// Whether `point` [m] is free, and a way leads there from the start.
    pub fn is_reachable(&self, point: &Position) -> bool {
        match &self.grid {
            Some(grid) => grid.is_reachable(point),
            None => self.is_open() || self.contains(point) && self.graph.reaches(self, point),
        }
    }

    /// The shortest way from `from` to `to` [m]: its bends, and `to`; where `to` lies in a zone, the nearest point
    /// beside it. Empty if no way leads there.
    pub fn way(&self, from: &Position, to: &Position) -> Bends {
        if self.is_free(from, to) {
            return Bends::from_slice(&[*to]);
        }
        if let Some(grid) = &self.grid {
            return grid.way(from, to);
        }
        let end = self.nearest(to);
        let begin = if self.contains(from) { *from } else { self.nearest(from) };
        let mut way = Bends::new();
        if begin != *from {
            way.push(begin);
        }
        if self.is_free(&begin, &end) {
            way.push(end);
            return way;
        }
        if !self.graph.connect(self, &begin, &end, &mut way) {
            return Bends::new();
        }
        way.push(end);
        // A bend that is already reached.
        while way.len() > 1 && (way[0] - from).norm() <= self.clearance_m() && self.is_free(from, &way[1]) {
            way.remove(0);
        }
        way
    }

    /// The shortest way from `from` to `to`, up to where it comes within `radius_m` [m] of `centre`; empty if it does
    /// not.
    pub fn way_into(&self, from: &Position, to: &Position, centre: &Position, radius_m: f64) -> Bends {
        if let Some(grid) = &self.grid {
            return grid.way_into(from, to, centre, radius_m);
        }
        let mut way = self.way(from, to);
        let begins = std::iter::once(*from).chain(way.clone());
        let entered =
            begins.zip(&way).position(|(begin, end)| within(&nearest_between(centre, &begin, end), centre, radius_m));
        let Some(piece) = entered else { return Bends::new() };
        let begin = piece.checked_sub(1).map_or(*from, |before| way[before]);
        way.truncate(piece + 1);
        let along = way[piece] - begin;
        let away = begin - centre;
        // |away + t along| = radius, the first time; 0 if it begins within.
        let (a, half_b) = (along.norm_squared(), along.dot(&away));
        let c = away.norm_squared() - radius_m * radius_m;
        if c <= 0.0 {
            way[piece] = begin;
        } else {
            let root = (half_b * half_b - a * c).max(0.0).sqrt();
            let fraction = c / (root - half_b);
            way[piece] = if fraction < 1.0 { begin + along * fraction } else { way[piece] };
        }
        way
    }

    /// Length of the shortest way [m]; infinite if there is none.
    pub fn distance_m(&self, from: &Position, to: &Position) -> f64 {
        if self.is_free(from, to) {
            return (to - from).norm();
        }
        if let Some(grid) = &self.grid {
            return grid.distance_m(from, to);
        }
        let way = self.way(from, to);
        if way.is_empty() { f64::INFINITY } else { length_m(from, &way) }
    }

    /// Lengths of the shortest ways between all `points` [m], by rows; infinite where there is none. A point in a zone
    /// counts as the nearest one beside it.
    pub fn distances_m(&self, points: &[Position]) -> Vec<f64> {
        let count = points.len();
        let points: Vec<Position> = points.iter().map(|point| self.nearest(point)).collect();
        let between_m = |from: usize, to: usize| match &self.grid {
            Some(grid) => grid.distance_m(&points[from], &points[to]),
            None if self.is_clear(&points[from], &points[to]) => (points[to] - points[from]).norm(),
            None => self.graph.shortest(self, &points[from], &points[to]).map_or(f64::INFINITY, |way| way.length_m),
        };
        let mut lengths_m = vec![0.0; count * count];
        for from in 0..count {
            for to in from + 1..count {
                let length_m = between_m(from, to);
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
        match &self.grid {
            Some(grid) => grid.slot_end(slot, from, to),
            None if self.is_clear(from, to) => *to,
            None => self.toward(from, to, reach_m),
        }
    }

    /// The end of `slot` of a UAV at `from` that is under way on a grid, or hovers until the next move may begin [m];
    /// `None` where it may be told a waypoint.
    pub fn under_way(&self, slot: u64, from: &Position) -> Option<Position> {
        self.grid.as_ref().and_then(|grid| grid.under_way(slot, from))
    }

    /// The slots from `slot` on that are decided with a flight from `from` to `to` [m], and where the UAV is after
    /// them: on a grid a whole move.
    pub fn committed(&self, slot: u64, from: &Position, to: &Position) -> (u64, Position) {
        self.grid.as_ref().map_or((1, *to), |grid| grid.committed(slot, from, to))
    }

    /// The end of a slot that flies up to `reach_m` [m] along the shortest way from `from` to `to`: the point at that
    /// length, or the first bend. Beyond a bend it flies straight on where that brings it nearer to the next one.
    pub fn toward(&self, from: &Position, to: &Position, reach_m: f64) -> Position {
        let way = self.way(from, to);
        if way.is_empty() { *from } else { self.step(from, &way, reach_m).0 }
    }

    /// The ends of the slots of [`Self::toward`] up to the end of the `way` from `from`, without those of its last
    /// straight part.
    pub fn bent_part(&self, from: &Position, way: &[Position], reach_m: f64) -> Vec<Position> {
        let mut ends = Vec::new();
        let (mut at, mut rest) = (*from, way);
        while rest.len() > 1 {
            let (end, passed) = self.step(&at, rest, reach_m);
            at = end;
            rest = &rest[passed..];
            ends.push(end);
        }
        ends
    }

    /// The end of a slot along `way`, which is not empty, and how many bends it has passed.
    fn step(&self, from: &Position, way: &[Position], reach_m: f64) -> (Position, usize) {
        let bend = way[0];
        let along = bend - from;
        let away_m = along.norm();
        if let Some(grid) = &self.grid {
            return grid.step(from, &bend, reach_m);
        }
        if away_m > reach_m {
            return (from + along * (reach_m / away_m), 0);
        }
        let Some(next) = way.get(1) else { return (bend, 1) };
        if away_m > 0.0 {
            let along = along / away_m;
            let on_m = along.dot(&(next - from)).min(reach_m);
            let beyond = from + along * on_m;
            let is_flown = self.contains(&beyond) && self.is_free(from, &beyond);
            if on_m > away_m && is_flown && self.is_free(&beyond, next) {
                return (beyond, 1);
            }
        }
        (bend, 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
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
