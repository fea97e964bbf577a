//! A short closed tour through points: nearest neighbour, then 2-opt and or-opt over neighbour lists.

use skysink_common::geometry::Position;
use skysink_common::scenario::Area;
use skysink_common::sensors::grid::Grid;
use skysink_common::stop::Stop;

/// Neighbours that a point may be joined to.
const NEIGHBOURS: usize = 10;

/// Longest part of the tour that or-opt moves.
const LONGEST_MOVED: usize = 3;

/// Most points for which the nearest-neighbour tour is improved: an exchange takes O(N).
const MOST_IMPROVED: usize = 20_000;

/// Most sweeps over all points; far fewer suffice.
const MOST_SWEEPS: usize = 50;

/// Index in the tour of a point that is not in it yet.
const UNVISITED: usize = usize::MAX;

/// Least gain [m] of an exchange; smaller ones are rounding.
const LEAST_GAIN_M: f64 = 1e-9;

/// Tours are repaired if at most one leg in this many is long. With more the search takes long and does not succeed.
const FEW: usize = 8;

/// Excess below this [slots] is rounding.
const LEAST_EXCESS: f64 = 1e-9;

/// Indices of `points`, all in `area`, in the order of a short closed tour that begins with index 0. `stop` ends the
/// search for a shorter one.
#[must_use]
pub fn closed_tour(area: Area, points: &[Position], stop: &Stop) -> Vec<u32> {
    let mut tour = Tour::nearest_neighbour(area, points);
    if points.len() <= MOST_IMPROVED {
        tour.improve(stop);
    }
    let first = tour.order.iter().position(|&point| point == 0).unwrap_or(0);
    tour.order.rotate_left(first);
    tour.order
}

struct Tour<'a> {
    points: &'a [Position],
    neighbours: Vec<Vec<u32>>,
    order: Vec<u32>,
    /// Index of each point in `order`.
    indices: Vec<usize>,
}

impl<'a> Tour<'a> {
    fn nearest_neighbour(area: Area, points: &'a [Position]) -> Self {
        let side_m = (area.width_m() * area.height_m() / points.len().max(1) as f64).sqrt();
        let grid = Grid::new(points, side_m);
        let near = |(index, point): (u32, &Position)| {
            let mut near = grid.nearest(point, NEIGHBOURS + 1);
            near.retain(|&other| other != index);
            near
        };
        let neighbours: Vec<Vec<u32>> = (0..).zip(points).map(near).collect();
        let mut order = Vec::with_capacity(points.len());
        let mut indices = vec![UNVISITED; points.len()];
        let mut next = (!points.is_empty()).then_some(0);
        while let Some(at) = next {
            indices[at as usize] = order.len();
            order.push(at);
            let is_unvisited = |point: &u32| indices[*point as usize] == UNVISITED;
            let listed = neighbours[at as usize].iter().copied().find(is_unvisited);
            next = listed.or_else(|| nearest_unvisited(&grid, points, at, is_unvisited));
        }
        Self { points, neighbours, order, indices }
    }

    fn length_m(&self, a: u32, b: u32) -> f64 {
        (self.points[a as usize] - self.points[b as usize]).norm()
    }

    fn at(&self, position: usize) -> u32 {
        self.order[position % self.order.len()]
    }

    fn improve(&mut self, stop: &Stop) {
        if self.order.len() < 4 {
            return;
        }
        for _ in 0..MOST_SWEEPS {
            let mut improved = false;
            for point in 0..self.order.len() as u32 {
                if stop.requested().is_some() {
                    return;
                }
                while self.two_opt(point) || self.or_opt(point) {
                    improved = true;
                }
            }
            if !improved {
                return;
            }
        }
    }

    /// Joins `point` with one of its neighbours, and their successors with each other.
    fn two_opt(&mut self, point: u32) -> bool {
        let position = self.indices[point as usize];
        let next = self.at(position + 1);
        let own_m = self.length_m(point, next);
        for index in 0..self.neighbours[point as usize].len() {
            let other = self.neighbours[point as usize][index];
            let joined_m = self.length_m(point, other);
            if joined_m >= own_m {
                break;
            }
            let other_index = self.indices[other as usize];
            let after = self.at(other_index + 1);
            let gain_m = own_m + self.length_m(other, after) - joined_m - self.length_m(next, after);
            if gain_m > LEAST_GAIN_M && other != next && after != point {
                self.reverse(position.min(other_index) + 1, position.max(other_index));
                return true;
            }
        }
        false
    }

    /// Reverses the points at the indices `low..=high`.
    fn reverse(&mut self, low: usize, high: usize) {
        self.order[low..=high].reverse();
        self.update_indices(low, high);
    }

    fn update_indices(&mut self, low: usize, high: usize) {
        for position in low..=high {
            self.indices[self.order[position] as usize] = position;
        }
    }

    /// Moves up to three points, from `point` on, to after a neighbour of `point`, reversed if that is shorter.
    fn or_opt(&mut self, point: u32) -> bool {
        let count = self.order.len();
        let begin = self.indices[point as usize];
        for length in 1..=LONGEST_MOVED.min(count - 3) {
            let end = begin + length;
            if begin == 0 || end >= count {
                return false;
            }
            let before = self.at(begin - 1);
            let after = self.at(end);
            let last = self.at(end - 1);
            let freed_m = self.length_m(before, point) + self.length_m(last, after) - self.length_m(before, after);
            for index in 0..self.neighbours[point as usize].len() {
                let other = self.neighbours[point as usize][index];
                if self.length_m(point, other) >= freed_m {
                    break;
                }
                let position = self.indices[other as usize];
                if (begin..end).contains(&position) {
                    continue;
                }
                let next = self.at(position + 1);
                if next == point {
                    continue;
                }
                let base_m = self.length_m(other, next);
                let straight_m = self.length_m(other, point) + self.length_m(last, next);
                if freed_m - straight_m + base_m > LEAST_GAIN_M {
                    self.shift(begin, end, position);
                    return true;
                }
                let previous = self.at(position + count - 1);
                if previous == last {
                    continue;
                }
                let reversed_m = self.length_m(previous, last) + self.length_m(point, other);
                if freed_m - reversed_m + self.length_m(previous, other) > LEAST_GAIN_M && position > 0 {
                    self.reverse(begin, end - 1);
                    self.shift(begin, end, position - 1);
                    return true;
                }
            }
        }
        false
    }

    /// Moves the points at the indices `begin..end` to after the one at `position`.
    fn shift(&mut self, begin: usize, end: usize, position: usize) {
        if position >= end {
            self.order[begin..=position].rotate_left(end - begin);
            self.update_indices(begin, position);
        } else {
            self.order[position + 1..end].rotate_right(end - begin);
            self.update_indices(position + 1, end - 1);
        }
    }
}

/// The unvisited point nearest to point `at`, if its neighbour list has none; any if its position is NaN. `None` if all
/// are visited.
fn nearest_unvisited(grid: &Grid, points: &[Position], at: u32, is_unvisited: impl Fn(&u32) -> bool) -> Option<u32> {
    let mut count = 4 * NEIGHBOURS;
    loop {
        let near = grid.nearest(&points[at as usize], count);
        let next = near.iter().copied().find(&is_unvisited);
        if next.is_some() || near.len() < count {
            return next.or_else(|| (0..points.len() as u32).find(&is_unvisited));
        }
        count *= 4;
    }
}

/// Repairs a closed tour in which few legs are longer than a slot, by 2-opt: a long leg costs an additional slot per
/// round. Reverses parts of `tour` until no reversal reduces the total excess. `excess` is the time beyond one slot
/// [slots] of the leg between two stops, and symmetric. `stop` ends the search.
pub fn even_out(tour: &mut [u32], excess: impl Fn(u32, u32) -> f64, stop: &Stop) {
    let count = tour.len();
    // Each exchange reduces the excess; far fewer are found.
    for _ in 0..count {
        let leg = |index: usize| excess(tour[index], tour[(index + 1) % count]);
        let long: Vec<usize> = (0..count).filter(|&index| leg(index) > LEAST_EXCESS).collect();
        if long.len() * FEW > count || stop.requested().is_some() {
            return;
        }
        let mut best: Option<(f64, usize, usize)> = None;
        for long in long {
            for other in (0..count).filter(|&other| other != long) {
                let low = long.min(other);
                let high = long.max(other);
                let joined = excess(tour[low], tour[high]) + excess(tour[low + 1], tour[(high + 1) % count]);
                let gain = leg(low) + leg(high) - joined;
                if gain > LEAST_EXCESS && best.is_none_or(|(most, ..)| gain > most) {
                    best = Some((gain, low, high));
                }
            }
        }
        let Some((_, low, high)) = best else {
            return;
        };
        tour[low + 1..=high].reverse();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::RngExt;
    use skysink_common::random::{Purpose, Streams};

    const AREA: Area = Area::new(100.0, 100.0);

    fn length_m(points: &[Position], tour: &[u32]) -> f64 {
        let at = |index: usize| points[tour[index % tour.len()] as usize];
        (0..tour.len()).map(|index| (at(index) - at(index + 1)).norm()).sum()
    }

    #[test]
    fn a_ring_of_points_is_toured_around() {
        let angle = |step: u32| f64::from(step * 7 % 20) * std::f64::consts::TAU / 20.0;
        let points: Vec<Position> = (0..20)
            .map(|step| Position::new(50.0 + 40.0 * angle(step).cos(), 50.0 + 40.0 * angle(step).sin()))
            .collect();
        // Twenty sides of a regular polygon: 20 · 2 · 40 · sin(π/20) = 250.29 m.
        let expected_m = 1600.0 * (std::f64::consts::PI / 20.0).sin();
        assert!((length_m(&points, &closed_tour(AREA, &points, &Stop::default())) - expected_m).abs() < 1e-9);
    }

    #[test]
    fn few_and_coincident_points_have_a_tour() {
        let point = Position::new(3.0, 4.0);
        assert_eq!(closed_tour(AREA, &[], &Stop::default()), [0; 0]);
        assert_eq!(closed_tour(AREA, &[point], &Stop::default()), [0]);
        assert_eq!(closed_tour(AREA, &[point; 30], &Stop::default()).len(), 30);
        for side_m in [5e-324, 1e-300] {
            let corners = [Position::origin(), Position::new(side_m, side_m)].repeat(15);
            assert_eq!(
                closed_tour(Area::new(side_m, side_m), &corners, &Stop::default()).len(),
                30,
                "an area of 0 m², rounded"
            );
        }
    }

    proptest! {
        #[test]
        fn a_tour_passes_every_point_once(coordinates in prop::collection::vec((0.0..100.0, 0.0..100.0), 1..80)) {
            let points: Vec<Position> = coordinates.into_iter().map(|(x_m, y_m)| Position::new(x_m, y_m)).collect();
            let mut tour = closed_tour(AREA, &points, &Stop::default());
            prop_assert_eq!(tour[0], 0);
            tour.sort_unstable();
            prop_assert!((0..points.len() as u32).eq(tour));
        }
    }

    /// Length of the shortest tour over a few points [m], by trying all.
    fn shortest_m(points: &[Position]) -> f64 {
        let mut shortest_m = f64::INFINITY;
        let mut orders = vec![vec![0u32]];
        while let Some(order) = orders.pop() {
            if order.len() == points.len() {
                shortest_m = shortest_m.min(length_m(points, &order));
            }
            let others = (1..points.len() as u32).filter(|next| !order.contains(next));
            orders.extend(others.map(|next| [&order[..], &[next]].concat()));
        }
        shortest_m
    }

    #[test]
    fn a_tour_of_seven_is_hardly_longer_than_the_shortest() {
        let mut random = Streams::new(1).stream(Purpose::Position, 0, 0);
        let mut coordinate_m = || random.random::<f64>() * 100.0;
        let mut excess = |_| {
            let points: Vec<Position> = (0..7).map(|_| Position::new(coordinate_m(), coordinate_m())).collect();
            length_m(&points, &closed_tour(AREA, &points, &Stop::default())) / shortest_m(&points) - 1.0
        };
        let excesses: Vec<f64> = (0..300).map(&mut excess).collect();
        let mean = excesses.iter().sum::<f64>() / 300.0;
        let worst = excesses.iter().copied().fold(0.0, f64::max);
        assert!(mean < 0.01 && worst < 0.25, "on average {mean}, at worst {worst}");
    }

    /// Slots beyond one between two of 16 stops on a ring, one slot from each to the next.
    fn ring(a: u32, b: u32) -> f64 {
        let apart = a.abs_diff(b);
        (f64::from(apart.min(16 - apart)) - 1.0).max(0.0)
    }

    #[test]
    fn two_legs_that_are_too_long_are_exchanged_for_two_of_a_slot() {
        // 4 to 9 and 5 to 10 are five slots each.
        let mut tour = [0, 1, 2, 3, 4, 9, 8, 7, 6, 5, 10, 11, 12, 13, 14, 15];
        even_out(&mut tour, ring, &Stop::default());
        let sum: f64 = (0..16).map(|index| ring(tour[index], tour[(index + 1) % 16])).sum();
        assert_eq!(sum, 0.0, "{tour:?}");
        tour.sort_unstable();
        assert_eq!(tour, std::array::from_fn(|stop| stop as u32));
    }

    #[test]
    fn a_tour_with_many_long_legs_is_not_changed() {
        let mut tour = [0, 2, 4, 6, 8, 10, 12, 14, 1, 3, 5, 7, 9, 11, 13, 15];
        let before = tour;
        even_out(&mut tour, ring, &Stop::default());
        assert_eq!(tour, before);
    }

    #[test]
    fn a_tour_of_short_legs_and_one_of_few_stops_stay_as_they_are() {
        let mut tour = [3, 1, 2, 0];
        even_out(&mut tour, |_, _| 0.0, &Stop::default());
        assert_eq!(tour, [3, 1, 2, 0]);
        let mut pair = [0, 1];
        even_out(&mut pair, |_, _| 5.0, &Stop::default());
        assert_eq!(pair, [0, 1]);
        even_out(&mut [], |_, _| 5.0, &Stop::default());
    }
}
