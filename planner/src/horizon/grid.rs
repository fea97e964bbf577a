//! Points in square cells, so that what is near a position is found without looking at all of them.
//!
//! It knows positions and ids, nothing of queues.

use skysink_common::geometry::{Position, distance_squared};
use skysink_common::scenario::Area;

/// Most cells along one axis.
const MAX_CELLS: f64 = 256.0;

/// Ids by the cell of their position.
#[derive(Debug, Clone)]
pub struct Grid {
    cell_m: f64,
    columns: usize,
    rows: usize,
    /// Where the ids of a cell begin in `entries`; one more than there are cells.
    starts: Vec<u32>,
    /// Ids with their positions, cell by cell, ascending within a cell.
    entries: Vec<(Position, u32)>,
}

impl Grid {
    /// A grid over `area` of the points `(id, position)`, in cells of at least `cell_m` [m].
    #[must_use]
    pub fn new(area: Area, cell_m: f64, points: &[(u32, Position)]) -> Self {
        let cell_m = cell_m.max(area.width_m.max(area.height_m) / MAX_CELLS);
        let count = |extent_m: f64| (extent_m / cell_m).floor() as usize + 1;
        let (columns, rows) = (count(area.width_m), count(area.height_m));
        let mut grid = Self { cell_m, columns, rows, starts: vec![0; columns * rows + 1], entries: Vec::new() };
        let mut sorted: Vec<(usize, u32, Position)> =
            points.iter().map(|&(id, position)| (grid.cell_of(&position), id, position)).collect();
        sorted.sort_unstable_by_key(|&(cell, id, _)| (cell, id));
        for &(cell, ..) in &sorted {
            grid.starts[cell + 1] += 1;
        }
        for cell in 0..columns * rows {
            grid.starts[cell + 1] += grid.starts[cell];
        }
        grid.entries = sorted.into_iter().map(|(_, id, position)| (position, id)).collect();
        grid
    }

    fn axis(&self, at_m: f64, cells: usize) -> usize {
        ((at_m / self.cell_m).max(0.0) as usize).min(cells - 1)
    }

    fn cell_of(&self, position: &Position) -> usize {
        self.axis(position.y, self.rows) * self.columns + self.axis(position.x, self.columns)
    }

    /// Calls `visit` with the id of, and the squared distance [m²] to, every point within `radius_m` [m] of `centre`.
    #[inline]
    pub fn within(&self, centre: &Position, radius_m: f64, mut visit: impl FnMut(u32, f64)) {
        let columns = self.axis(centre.x - radius_m, self.columns)..=self.axis(centre.x + radius_m, self.columns);
        let limit_m2 = radius_m * radius_m;
        for row in self.axis(centre.y - radius_m, self.rows)..=self.axis(centre.y + radius_m, self.rows) {
            let first = self.starts[row * self.columns + columns.start()] as usize;
            let last = self.starts[row * self.columns + columns.end() + 1] as usize;
            for (position, id) in &self.entries[first..last] {
                let d2_m2 = distance_squared(position, centre);
                if d2_m2 <= limit_m2 {
                    visit(*id, d2_m2);
                }
            }
        }
    }

    /// The `count` points nearest to `centre`, nearest first, ties to the lowest id.
    #[must_use]
    pub fn nearest(&self, centre: &Position, count: usize) -> Vec<u32> {
        let count = count.min(self.entries.len());
        let widest_m = self.cell_m * (self.columns + self.rows) as f64;
        let mut radius_m = self.cell_m;
        loop {
            let mut found: Vec<(f64, u32)> = Vec::new();
            self.within(centre, radius_m, |id, d2_m2| found.push((d2_m2, id)));
            if found.len() >= count || radius_m > 2.0 * widest_m {
                found.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                found.truncate(count);
                return found.into_iter().map(|(_, id)| id).collect();
            }
            radius_m *= 2.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_grid_finds_what_a_look_at_all_points_finds(
            places in prop::collection::vec((0.0..90.0, 0.0..60.0), 1..60),
            centre in (-5.0..95.0, -5.0..65.0), radius_m in 0.1..120.0, cell_m in 0.5..80.0, count in 1usize..20,
        ) {
            let points: Vec<(u32, Position)> =
                (0..).zip(&places).map(|(id, &(x, y))| (id, Position::new(x, y))).collect();
            let grid = Grid::new(Area { width_m: 90.0, height_m: 60.0 }, cell_m, &points);
            let centre = Position::new(centre.0, centre.1);
            let mut found = Vec::new();
            grid.within(&centre, radius_m, |id, _| found.push(id));
            found.sort_unstable();
            let mut all: Vec<(f64, u32)> = points.iter().map(|(id, at)| (distance_squared(at, &centre), *id)).collect();
            let expected: Vec<u32> =
                all.iter().filter(|(d2_m2, _)| *d2_m2 <= radius_m * radius_m).map(|&(_, id)| id).collect();
            prop_assert_eq!(found, expected);
            all.sort_by(|a, b| a.partial_cmp(b).unwrap());
            let expected: Vec<u32> = all.iter().take(count).map(|&(_, id)| id).collect();
            prop_assert_eq!(grid.nearest(&centre, count), expected);
        }
    }
}
