//! Points in the square cells of a uniform grid, for range queries in time proportional to the points nearby.
//!
//! Queries return exactly the points that a loop over all of them would.

use crate::geometry::{Position, RANGE_SLACK, distance_squared, extent};
use crate::scenario::Area;

/// Relative margin of a preselection over the exact test that follows it.
pub const PRESELECTION_MARGIN: f64 = 1.001;

/// Most cells per point of a grid over a bounding box. Beyond it cells are enlarged, so that empty ground costs no
/// memory.
const CELLS_PER_NODE: f64 = 4.0;

/// Cells that are always allowed in such a grid.
const FEW_CELLS: f64 = 64.0;

/// Most cells along one axis of a grid over an area, about.
const MOST_ALONG: f64 = 256.0;

/// A point in its cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Node {
    /// Position, such as `L_i` of a sensor node (SN).
    pub position: Position,
    /// Index in the list of points, such as the id of an SN.
    pub id: u32,
}

/// All points in the cells of a uniform grid.
///
/// Cells are numbered row by row from the south-west, and points are stored in the order of their cells: those in
/// adjacent columns of a row are contiguous.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// South-west corner.
    corner: Position,
    side_m: f64,
    columns: usize,
    rows: usize,
    /// Index in `nodes` of the first point of each cell, and the number of points.
    starts: Vec<u32>,
    /// By cell, and within a cell by id.
    nodes: Vec<Node>,
}

impl Grid {
    /// A grid over the bounding box of `positions`, with cells of the side `side_m` [m], enlarged if there would be
    /// more than four cells per point. With an infinite side it has a single cell.
    ///
    /// # Panics
    /// If there are more points than ids; a scenario has at most 10^7 SNs.
    #[must_use]
    pub fn new(positions: &[Position], side_m: f64) -> Self {
        let [corner, end] = extent(positions.iter().copied()).unwrap_or([Position::origin(); 2]);
        let extents_m = [end.x - corner.x, end.y - corner.y];
        let most_cells = (CELLS_PER_NODE * positions.len() as f64).max(FEW_CELLS);
        let mut side_m = side_m.max(f64::MIN_POSITIVE); // 0 would never grow; the root of a tiny area is 0
        while cells(extents_m[0], side_m) * cells(extents_m[1], side_m) > most_cells {
            side_m *= 1.5;
        }
        Self::filled(corner, extents_m, side_m, positions)
    }

    /// A grid over `area`: the order in which points are visited depends on the area instead of the outermost points.
    ///
    /// # Panics
    /// As [`Self::new`].
    #[must_use]
    pub fn over(area: &Area, positions: &[Position], side_m: f64) -> Self {
        let side_m = side_m.max(area.width_m().max(area.height_m()) / MOST_ALONG);
        Self::filled(Position::origin(), [area.width_m(), area.height_m()], side_m, positions)
    }

    /// Sorts the points into their cells by counting sort, which keeps them by id within a cell.
    fn filled(corner: Position, extents_m: [f64; 2], side_m: f64, positions: &[Position]) -> Self {
        let count = u32::try_from(positions.len()).expect("a scenario has at most 10^7 sensor nodes");
        let [columns, rows] = extents_m.map(|extent_m| (cells(extent_m, side_m) as usize).max(1));
        let mut grid = Self { corner, side_m, columns, rows, starts: vec![0; columns * rows + 1], nodes: Vec::new() };
        for position in positions {
            let cell = grid.cell(position);
            grid.starts[cell + 1] += 1;
        }
        for cell in 1..grid.starts.len() {
            grid.starts[cell] += grid.starts[cell - 1];
        }
        let mut next = grid.starts.clone();
        grid.nodes = vec![Node { position: Position::origin(), id: 0 }; positions.len()];
        for (id, position) in (0..count).zip(positions) {
            let index = &mut next[grid.cell(position)];
            grid.nodes[*index as usize] = Node { position: *position, id };
            *index += 1;
        }
        grid
    }

    /// Visits every point within `radius_m` [m] of `centre` (decision D5) once, by cell.
    pub fn visit_within(&self, centre: &Position, radius_m: f64, mut visit: impl FnMut(&Node)) {
        self.visit(centre, radius_m * (1.0 + RANGE_SLACK), |node, _| visit(node));
    }

    /// Visits every point at most `radius_m` [m] from `centre`, without slack, once, with the squared distance [m²], by
    /// cell and within a cell by id.
    ///
    /// Rounding does not miss a point: the tested cells reach a thousandth of the radius beyond the test, and their
    /// bounds are computed by the same monotonic function as the cells of the points.
    #[inline]
    pub fn visit(&self, centre: &Position, radius_m: f64, mut visit: impl FnMut(&Node, f64)) {
        let margin_m = radius_m * PRESELECTION_MARGIN;
        let limit_m2 = radius_m * radius_m;
        let columns = self.column(centre.x - margin_m)..=self.column(centre.x + margin_m);
        for row in self.row(centre.y - margin_m)..=self.row(centre.y + margin_m) {
            let first = self.starts[row * self.columns + columns.start()] as usize;
            let last = self.starts[row * self.columns + columns.end() + 1] as usize;
            for node in &self.nodes[first..last] {
                let d2_m2 = distance_squared(&node.position, centre);
                if d2_m2 <= limit_m2 {
                    visit(node, d2_m2);
                }
            }
        }
    }

    /// The ids of the `count` points nearest to `centre`, nearest first, ties by the lowest id.
    pub fn nearest(&self, centre: &Position, count: usize) -> Vec<u32> {
        let count = count.min(self.nodes.len());
        let widest_m = self.side_m * (self.columns + self.rows) as f64;
        let farthest_m = (centre - self.corner).norm() + widest_m;
        let mut radius_m = self.side_m;
        loop {
            let mut found: Vec<(f64, u32)> = Vec::new();
            self.visit(centre, radius_m, |node, d2_m2| found.push((d2_m2, node.id)));
            if found.len() >= count || radius_m >= farthest_m || farthest_m.is_nan() {
                found.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                found.truncate(count);
                return found.into_iter().map(|(_, id)| id).collect();
            }
            radius_m *= 2.0;
        }
    }

    /// The cell of a position.
    fn cell(&self, position: &Position) -> usize {
        self.row(position.y) * self.columns + self.column(position.x)
    }

    /// The column of `x_m` [m]; the nearest one if it lies outside, the first for NaN.
    fn column(&self, x_m: f64) -> usize {
        (((x_m - self.corner.x) / self.side_m) as usize).min(self.columns - 1)
    }

    /// The row of `y_m` [m], likewise.
    fn row(&self, y_m: f64) -> usize {
        (((y_m - self.corner.y) / self.side_m) as usize).min(self.rows - 1)
    }
}

/// Cells of the side `side_m` [m] along an extent [m].
fn cells(extent_m: f64, side_m: f64) -> f64 {
    (extent_m / side_m).floor() + 1.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::within;
    use proptest::prelude::*;

    /// The SNs within `radius_m` [m] of `centre`, ascending, by the grid.
    fn found(grid: &Grid, centre: &Position, radius_m: f64) -> Vec<Node> {
        let mut nodes = Vec::new();
        grid.visit_within(centre, radius_m, |node| nodes.push(*node));
        nodes.sort_unstable_by_key(|node| node.id);
        nodes
    }

    /// The nodes within a radius, by a loop over all of them.
    fn by_loop(positions: &[Position], centre: &Position, radius_m: f64) -> Vec<Node> {
        let nodes = (0..).zip(positions).map(|(id, position)| Node { position: *position, id });
        nodes.filter(|node| within(&node.position, centre, radius_m)).collect()
    }

    #[test]
    fn no_point_is_near_in_an_empty_field() {
        assert_eq!(found(&Grid::new(&[], 10.0), &Position::origin(), 1e9), []);
    }

    #[test]
    fn no_point_is_near_nan() {
        let grid = Grid::new(&[Position::new(1.0, 2.0)], 10.0);
        assert_eq!(found(&grid, &Position::new(f64::NAN, 2.0), 10.0), []);
        assert_eq!(found(&grid, &Position::new(1.0, 2.0), f64::NAN), []);
    }

    #[test]
    fn ties_of_distance_go_to_the_lowest_ids() {
        let positions = [[51.0, 50.0], [50.0, 50.0], [50.0, 49.0], [49.0, 50.0], [50.0, 51.0]].map(Position::from);
        let grid = Grid::new(&positions, 10.0);
        assert_eq!(grid.nearest(&Position::new(50.0, 50.0), 4), [1, 0, 2, 3]);
    }

    #[test]
    fn the_nearest_search_terminates_for_any_centre() {
        let grid = Grid::new(&[Position::origin(), Position::new(f64::NAN, 0.0)], 10.0);
        for x_m in [f64::NAN, f64::INFINITY, f64::MAX] {
            assert!(grid.nearest(&Position::new(x_m, 0.0), 2).len() < 2, "{x_m}");
        }
    }

    #[test]
    fn cells_of_zero_side_grow_to_a_limited_count() {
        for extent_m in [5e-324, 1e-300, 1e-150, 1.0] {
            let positions = [Position::origin(), Position::new(extent_m, extent_m)];
            let grid = Grid::new(&positions, 0.0);
            assert!(grid.columns * grid.rows <= 64, "{extent_m}: {} by {}", grid.columns, grid.rows);
            assert_eq!(grid.nearest(&positions[1], 2).len(), 2, "{extent_m}");
        }
    }

    #[test]
    fn sparse_areas_need_no_memory() {
        // 10^12 cells of 10 m, and two SNs.
        let grid = Grid::new(&[Position::origin(), Position::new(1e7, 1e7)], 10.0);
        assert!(grid.columns * grid.rows <= 64, "{} by {}", grid.columns, grid.rows);
        assert_eq!(found(&grid, &Position::new(1e7, 1e7 - 10.0), 10.0).len(), 1);
        // One row of SNs: a box without height.
        let row: Vec<Position> = (0..1_000).map(|step| Position::new(1e4 * f64::from(step), 5.0)).collect();
        assert!(Grid::new(&row, 10.0).starts.len() <= 4_001);
    }

    #[test]
    fn cells_have_the_requested_side_and_row_major_numbers() {
        // 100 m × 100 m, an SN in the middle of every cell of 10 m.
        let middle = |step: u32| f64::from(step) * 10.0 + 5.0;
        let positions: Vec<Position> =
            (0..100).map(|cell| Position::new(middle(cell % 10), middle(cell / 10))).collect();
        let grid = Grid::new(&positions, 10.0);
        assert_eq!((grid.columns, grid.rows, grid.starts.len()), (10, 10, 101));
        assert_eq!(grid.cell(&positions[37]), 37);
    }

    /// Coordinates [m] anywhere, on borders of cells, or on those borders but for rounding.
    fn coordinates(extent_m: f64) -> impl Strategy<Value = f64> {
        let border = (0u32..=20).prop_map(move |step| f64::from(step) * extent_m / 20.0);
        prop_oneof![
            (0.0..1.0).prop_map(move |fraction| fraction * extent_m),
            border.clone(),
            border.clone().prop_map(f64::next_up),
            border.prop_map(f64::next_down)
        ]
    }

    fn positions(extent_m: f64) -> impl Strategy<Value = Position> {
        (coordinates(extent_m), coordinates(extent_m)).prop_map(|(x_m, y_m)| Position::new(x_m, y_m))
    }

    /// Fields that are dense, sparse, clustered or all in one point.
    fn fields() -> impl Strategy<Value = Vec<Position>> {
        let spread = prop::sample::select(vec![0.0, 1.0, 20.0, 100.0, 1e4])
            .prop_flat_map(|extent_m| prop::collection::vec(positions(extent_m), 1..120));
        let corners = prop::collection::vec(positions(100.0), 1..4);
        (spread, corners).prop_map(|(spread, corners)| {
            spread.iter().enumerate().map(|(id, position)| corners[id % corners.len()] + position.coords).collect()
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(1_000))]

        #[test]
        fn the_grid_query_agrees_with_a_linear_scan(
            positions in fields(),
            near in 0usize..120,
            side_m in prop::sample::select(vec![0.1, 5.0, 10.0, 33.3, 1e6]),
            radius_m in prop_oneof![Just(5.0), Just(10.0), Just(40.0), Just(1e5), 0.01..200.0],
            towards in prop_oneof![Just([1.0, 0.0]), Just([0.0, -1.0]), Just([0.6, 0.8]), Just([0.0, 0.0])],
            slack in prop::sample::select(vec![1.0, 1.0 + 0.9e-9, 1.0 + 1e-9, 1.0 + 1.1e-9]),
        ) {
            // A centre that has an SN on its rim, up to rounding and the slack of decision D5.
            let to_rim = nalgebra::Vector2::from(towards) * (radius_m * slack);
            let centre = positions[near % positions.len()] + to_rim;
            let area = Area::new(100.0, 100.0);
            let expected = by_loop(&positions, &centre, radius_m);
            for grid in [Grid::new(&positions, side_m), Grid::new(&positions, f64::INFINITY), Grid::over(&area, &positions, side_m)] {
                prop_assert_eq!(&found(&grid, &centre, radius_m), &expected);
            }
        }

        #[test]
        fn the_nearest_query_agrees_with_a_linear_scan(
            positions in prop::collection::vec((0.0..90.0, 0.0..60.0), 1..60),
            centre in (-5.0..95.0, -5.0..65.0), side_m in 0.5..80.0, count in 1usize..20,
        ) {
            let positions: Vec<Position> = positions.iter().map(|&(x_m, y_m)| Position::new(x_m, y_m)).collect();
            let centre = Position::new(centre.0, centre.1);
            let mut all: Vec<(f64, u32)> = positions.iter().map(|at| distance_squared(at, &centre)).zip(0..).collect();
            all.sort_by(|a, b| a.partial_cmp(b).unwrap());
            let expected: Vec<u32> = all.iter().take(count).map(|&(_, id)| id).collect();
            let area = Area::new(90.0, 60.0);
            prop_assert_eq!(&Grid::new(&positions, side_m).nearest(&centre, count), &expected);
            prop_assert_eq!(&Grid::over(&area, &positions, side_m).nearest(&centre, count), &expected);
        }
    }
}
