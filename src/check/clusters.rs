//! Distances between the sensor nodes (SNs): the mean nearest-neighbour distance, and the largest connected group.

use std::collections::HashMap;
use std::ops::Range;

use skysink_common::geometry::{Position, distance_squared};
use skysink_planner::geometry::grid::Grid;

/// Maximum number of SNs whose nearest neighbour is searched, approximately. In larger fields, every k-th SN is
/// sampled.
const MAX_SAMPLED: usize = 50_000;

/// Maximum number of pairs whose distance is computed. The groups of a field that needs more are unknown.
const MAX_PAIRS: u64 = 10_000_000;

/// Cells per step length. With more than √2, all SNs of a cell are within a step of each other, despite rounding.
const CELLS_PER_STEP: f64 = 1.5;

/// SNs within a step of each other are at most this many cells apart, per axis.
const MAX_CELL_DISTANCE: i64 = 2;

/// Mean distance [m] of an SN to its nearest neighbour; `None` for a single SN.
#[must_use]
pub fn mean_neighbour_m(positions: &[Position], grid: &Grid) -> Option<f64> {
    if positions.len() < 2 {
        return None;
    }
    let stride = positions.len().div_ceil(MAX_SAMPLED);
    let sampled = (0u32..).zip(positions).step_by(stride);
    let distances_m = sampled.filter_map(|(id, position)| {
        let near = grid.nearest(position, 2);
        let other = near.into_iter().find(|&other| other != id)?;
        Some((position - positions[other as usize]).norm())
    });
    Some(distances_m.sum::<f64>() / positions.len().div_ceil(stride) as f64)
}

/// Size of the largest connected component of the graph that connects SNs at most `step_m` [m] apart. `None` if more
/// than `MAX_PAIRS` pairs would have to be compared.
///
/// All SNs of a cell are connected, because a cell is smaller than a step. Two cells are connected if any pair of their
/// SNs is; SNs farther than a step from the bounding box of the other cell are skipped.
#[must_use]
pub fn largest_group(positions: &[Position], step_m: f64) -> Option<usize> {
    let cells = Cells::of(positions, step_m / CELLS_PER_STEP);
    let mut groups = Groups::of_one(positions.len());
    let mut pairs_left = MAX_PAIRS;
    for (cell, members) in &cells.members {
        for pair in cells.ids[members.clone()].windows(2) {
            groups.join(pair[0], pair[1]);
        }
        for neighbour in cells.neighbours(*cell) {
            let [own, others] = [members, neighbour].map(|range| &cells.ids[range.clone()]);
            if groups.root(own[0]) != groups.root(others[0])
                && is_step_between(positions, own, others, step_m, &mut pairs_left)?
            {
                groups.join(own[0], others[0]);
            }
        }
    }
    groups.sizes.iter().max().map(|&size| size as usize)
}

/// Whether any SN of `own` is within `step_m` [m] of any SN of `others`; `None` once `pairs_left` is used up.
fn is_step_between(
    positions: &[Position],
    own: &[u32],
    others: &[u32],
    step_m: f64,
    pairs_left: &mut u64,
) -> Option<bool> {
    let near = |ids: &[u32], corners: [Position; 2]| -> Vec<Position> {
        let positions = ids.iter().map(|&id| positions[id as usize]);
        let nearest = |position: &Position| position.sup(&corners[0]).inf(&corners[1]);
        positions.filter(|position| distance_squared(position, &nearest(position)) <= step_m * step_m).collect()
    };
    let near_own = near(own, corners(positions, others));
    let near_others = near(others, corners(positions, own));
    for position in &near_own {
        *pairs_left = pairs_left.checked_sub(near_others.len() as u64)?;
        if near_others.iter().any(|other| distance_squared(position, other) <= step_m * step_m) {
            return Some(true);
        }
    }
    Some(false)
}

/// The lower and upper corner of the bounding box.
fn corners(positions: &[Position], ids: &[u32]) -> [Position; 2] {
    let first = positions[ids[0] as usize];
    ids.iter()
        .map(|&id| positions[id as usize])
        .fold([first; 2], |[low, high], position| [low.inf(&position), high.sup(&position)])
}

/// The SNs by square cell.
struct Cells {
    /// Ids, cell by cell.
    ids: Vec<u32>,
    /// The non-empty cells, ascending, with the range of their ids in `ids`.
    members: Vec<([i64; 2], Range<usize>)>,
    /// The index of each cell in `members`.
    indices: HashMap<[i64; 2], usize>,
}

impl Cells {
    /// Sorts the SNs into cells with the side `side_m` [m].
    fn of(positions: &[Position], side_m: f64) -> Self {
        let cell = |id: &u32| positions[*id as usize].coords.map(|metres| (metres / side_m).floor() as i64).into();
        let mut ids: Vec<u32> = (0u32..).take(positions.len()).collect();
        ids.sort_by_cached_key(cell);
        let mut members: Vec<([i64; 2], Range<usize>)> = Vec::new();
        for run in ids.chunk_by(|a, b| cell(a) == cell(b)) {
            let begin = members.last().map_or(0, |(_, range)| range.end);
            members.push((cell(&run[0]), begin..begin + run.len()));
        }
        let indices = members.iter().enumerate().map(|(index, (cell, _))| (*cell, index)).collect();
        Self { ids, members, indices }
    }

    /// The cells after `[x, y]` in ascending order that may contain an SN within a step.
    fn neighbours(&self, [x, y]: [i64; 2]) -> impl Iterator<Item = &Range<usize>> {
        let norths = -MAX_CELL_DISTANCE..=MAX_CELL_DISTANCE;
        let offsets = (0..=MAX_CELL_DISTANCE).flat_map(move |east| norths.clone().map(move |north| [east, north]));
        let later = offsets.filter(|&offset| offset > [0, 0]).map(move |[east, north]| [x + east, y + north]);
        later.filter_map(|cell| Some(&self.members[*self.indices.get(&cell)?].1))
    }
}

/// Disjoint sets (union-find); each root stores the size of its set.
struct Groups {
    parents: Vec<u32>,
    sizes: Vec<u32>,
}

impl Groups {
    fn of_one(count: usize) -> Self {
        Self { parents: (0u32..).take(count).collect(), sizes: vec![1; count] }
    }

    /// The root of the set of `member`, with path halving.
    fn root(&mut self, mut member: u32) -> u32 {
        while self.parents[member as usize] != member {
            let above = self.parents[member as usize];
            self.parents[member as usize] = self.parents[above as usize];
            member = above;
        }
        member
    }

    /// Merges two sets, by size.
    fn join(&mut self, a: u32, b: u32) {
        let [a, b] = [a, b].map(|member| self.root(member));
        if a != b {
            let is_a_larger = self.sizes[a as usize] >= self.sizes[b as usize];
            let [large, small] = if is_a_larger { [a, b] } else { [b, a] };
            self.parents[small as usize] = large;
            self.sizes[large as usize] += self.sizes[small as usize];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(xs_m: &[f64]) -> Vec<Position> {
        xs_m.iter().map(|&x_m| Position::new(x_m, 0.0)).collect()
    }

    #[test]
    fn the_nearest_neighbour_is_another_one() {
        // 0 to 3: 3 m; 3 to 0: 3 m; 10 to 3: 7 m; mean 13/3 m.
        let positions = row(&[0.0, 3.0, 10.0]);
        let mean_m = mean_neighbour_m(&positions, &Grid::new(&positions, 5.0)).unwrap();
        assert!((mean_m - 13.0 / 3.0).abs() < 1e-12, "{mean_m}");
        let twins = row(&[4.0, 4.0]);
        assert_eq!(mean_neighbour_m(&twins, &Grid::new(&twins, 5.0)), Some(0.0));
        assert_eq!(mean_neighbour_m(&twins[..1], &Grid::new(&twins[..1], 5.0)), None);
    }

    #[test]
    fn a_group_ends_where_a_step_is_too_long() {
        // Steps of 4, 4, 6, 4 m: three SNs, then two.
        let positions = row(&[0.0, 4.0, 8.0, 14.0, 18.0]);
        assert_eq!(largest_group(&positions, 3.9), Some(1));
        assert_eq!(largest_group(&positions, 4.0), Some(3));
        assert_eq!(largest_group(&positions, 6.0), Some(5));
        assert_eq!(largest_group(&[], 6.0), None);
    }

    #[test]
    fn dense_clusters_of_thousands_are_separated() {
        let crowd =
            |x_m: f64| (0..4_000).map(move |id| Position::new(x_m + f64::from(id % 10) / 5.0, f64::from(id % 7)));
        let positions: Vec<Position> = crowd(0.0).chain(crowd(90.0)).collect();
        assert_eq!(largest_group(&positions, 20.0), Some(4_000));
        assert_eq!(largest_group(&positions, 88.21), Some(8_000)); // from 1.8 m to 90 m
        assert_eq!(largest_group(&positions, 88.19), Some(4_000));
    }

    #[test]
    fn groups_agree_with_those_of_all_pairs() {
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / (1u64 << 31) as f64
        };
        for _ in 0..200 {
            let side_m = 10.0 + 90.0 * random();
            let positions: Vec<Position> =
                (0..60).map(|_| Position::new(side_m * random(), side_m * random())).collect();
            let step_m = 2.0 + 15.0 * random();
            let mut groups = Groups::of_one(60);
            for a in 0..60u32 {
                for b in 0..a {
                    if (positions[a as usize] - positions[b as usize]).norm() <= step_m {
                        groups.join(a, b);
                    }
                }
            }
            let expected = groups.sizes.iter().max().map(|&size| size as usize);
            assert_eq!(largest_group(&positions, step_m), expected, "steps of {step_m} m over {side_m} m");
        }
    }

    #[test]
    fn a_field_with_too_many_pairs_has_no_answer() {
        // Two clusters on parallel slanted lines, 10.001 m apart: no step of 10 m connects them, but all SNs are near
        // the bounding box of the other cluster.
        let position = |id: u32| {
            let along_m = f64::from(id % 4_000) * 1e-3;
            let across_m = if id < 4_000 { 0.0 } else { 7.0718 };
            Position::new(along_m + across_m, along_m - across_m)
        };
        let positions: Vec<Position> = (0..8_000).map(position).collect();
        assert_eq!(largest_group(&positions, 10.0), None); // 16 million pairs
    }
}
