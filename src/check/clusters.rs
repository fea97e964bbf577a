//! How near to each other the sensor nodes (SNs) stand: the nearest neighbour, and the groups that short steps connect.

use skysink_common::geometry::Position;
use skysink_planner::geometry::grid::Grid;

/// SNs whose nearest neighbour is looked for, about; of more, every second, third and so on.
const MOST_ASKED: usize = 50_000;

/// Pairs that are joined at most; of a denser field it is not known how many groups there are.
const MOST_PAIRS: u64 = 10_000_000;

/// Mean distance [m] of an SN to the SN nearest to it; `None` for a lone one.
#[must_use]
pub fn mean_neighbour_m(positions: &[Position], grid: &Grid) -> Option<f64> {
    if positions.len() < 2 {
        return None;
    }
    let stride = positions.len().div_ceil(MOST_ASKED);
    let asked = (0u32..).zip(positions).step_by(stride);
    let distances_m = asked.filter_map(|(id, position)| {
        let near = grid.nearest(position, 2);
        let other = near.into_iter().find(|&other| other != id)?;
        Some((position - positions[other as usize]).norm())
    });
    Some(distances_m.sum::<f64>() / positions.len().div_ceil(stride) as f64)
}

/// How many SNs the largest group has, in which steps of at most `step_m` [m] lead from each to each; `None` if there
/// are too many pairs to look at.
#[must_use]
pub fn largest_group(positions: &[Position], step_m: f64) -> Option<usize> {
    let grid = Grid::new(positions, step_m);
    let mut groups = Groups::of_one(positions.len());
    let mut pairs = 0u64;
    for (id, position) in (0u32..).zip(positions) {
        grid.visit(position, step_m, |other, _| {
            pairs += 1;
            if other.id < id && pairs <= MOST_PAIRS {
                groups.join(id, other.id);
            }
        });
        if pairs > MOST_PAIRS {
            return None;
        }
    }
    groups.sizes.iter().max().map(|&size| size as usize)
}

/// Disjoint groups, each a tree whose root counts it.
struct Groups {
    parents: Vec<u32>,
    sizes: Vec<u32>,
}

impl Groups {
    fn of_one(count: usize) -> Self {
        Self { parents: (0u32..).take(count).collect(), sizes: vec![1; count] }
    }

    /// The root of the group of `member`; halves the path to it.
    fn root(&mut self, mut member: u32) -> u32 {
        while self.parents[member as usize] != member {
            let above = self.parents[member as usize];
            self.parents[member as usize] = self.parents[above as usize];
            member = above;
        }
        member
    }

    /// Makes one group of two, under the root of the larger.
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

    fn row(places_m: &[f64]) -> Vec<Position> {
        places_m.iter().map(|&x_m| Position::new(x_m, 0.0)).collect()
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
    fn pairs_beyond_the_limit_are_left_out() {
        assert_eq!(largest_group(&vec![Position::origin(); 4_000], 1.0), None); // 16 million pairs
    }
}
