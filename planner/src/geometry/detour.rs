//! The order of a round where straight lines are no measure: improved by the lengths of the shortest ways between its
//! points.

use skysink_common::stop::Stop;

/// Most points of a round whose order is improved; the time grows with their square.
pub const MOST: usize = 1_000;

/// Longest part of a round that moves to another place.
const LONGEST_PART: usize = 3;

/// Least improvement that counts, relative to the round.
const LEAST: f64 = 1e-9;

/// Lengths between points [m], by rows, the same in both directions; infinite where no way leads.
#[derive(Debug)]
pub struct Lengths {
    /// Number of points.
    pub count: usize,
    /// The length from point `row` to point `column`.
    pub lengths_m: Vec<f64>,
}

impl Lengths {
    fn between(&self, a: u32, b: u32) -> f64 {
        self.lengths_m[a as usize * self.count + b as usize]
    }

    /// Length of a closed round [m].
    pub fn round_m(&self, round: &[u32]) -> f64 {
        let next = round.iter().cycle().skip(1);
        round.iter().zip(next).map(|(&from, &to)| self.between(from, to)).sum()
    }

    /// Shortens the closed `round`: reverses parts (2-opt) and moves short ones (Or-opt) as long as a change makes it
    /// shorter. The result depends on the round alone, unless `stop` ends it.
    pub fn shorten(&self, round: &mut [u32], stop: &Stop) {
        let least_m = LEAST * self.round_m(round);
        if !least_m.is_finite() {
            return; // some points are apart
        }
        while stop.requested().is_none() && (self.reverse_parts(round, least_m) || self.move_parts(round, least_m)) {}
    }

    /// Reverses parts of the round that make it shorter; whether there was one.
    fn reverse_parts(&self, round: &mut [u32], least_m: f64) -> bool {
        let count = round.len();
        let mut is_shorter = false;
        for first in 0..count.saturating_sub(2) {
            for last in first + 2..count {
                let [a, b, c, d] = [round[first], round[first + 1], round[last], round[(last + 1) % count]];
                let before_m = self.between(a, b) + self.between(c, d);
                if self.between(a, c) + self.between(b, d) < before_m - least_m {
                    round[first + 1..=last].reverse();
                    is_shorter = true;
                }
            }
        }
        is_shorter
    }

    /// Moves parts of up to [`LONGEST_PART`] points to where they cost less; whether there was one.
    fn move_parts(&self, round: &mut [u32], least_m: f64) -> bool {
        let count = round.len();
        let mut is_shorter = false;
        for length in 1..=LONGEST_PART.min(count.saturating_sub(3)) {
            for _ in 0..count {
                // The part stands at the beginning, the rest follows.
                let [first, last] = [round[0], round[length - 1]];
                let rest = &round[length..];
                let [next, before] = [rest[0], rest[rest.len() - 1]];
                let saved_m = self.between(before, first) + self.between(last, next) - self.between(before, next);
                let place = rest.windows(2).enumerate().find_map(|(index, leg)| {
                    let cost_m = |begin: u32, end: u32| {
                        self.between(leg[0], begin) + self.between(end, leg[1]) - self.between(leg[0], leg[1])
                    };
                    let [as_is_m, reversed_m] = [cost_m(first, last), cost_m(last, first)];
                    (as_is_m.min(reversed_m) < saved_m - least_m).then_some((index + 1, reversed_m < as_is_m))
                });
                match place {
                    Some((place, is_reversed)) => {
                        if is_reversed {
                            round[..length].reverse();
                        }
                        round[..length + place].rotate_left(length);
                        is_shorter = true;
                    }
                    None => round.rotate_left(1),
                }
            }
        }
        is_shorter
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Lengths of ways over the streets of a grid.
    fn of(points: &[(f64, f64)]) -> Lengths {
        let row =
            |a: &(f64, f64)| points.iter().map(move |b| (a.0 - b.0).abs() + (a.1 - b.1).abs()).collect::<Vec<_>>();
        Lengths { count: points.len(), lengths_m: points.iter().flat_map(row).collect() }
    }

    /// The shortest closed round over all points, by trying all orders.
    fn best_m(lengths: &Lengths, round: &mut Vec<u32>, placed: usize) -> f64 {
        if placed == round.len() {
            return lengths.round_m(round);
        }
        let mut best = f64::INFINITY;
        for next in placed..round.len() {
            round.swap(placed, next);
            best = best.min(best_m(lengths, round, placed + 1));
            round.swap(placed, next);
        }
        best
    }

    #[test]
    fn removes_a_crossing() {
        // A rectangle of 10 m × 1 m; over the diagonals 44 m.
        let lengths = of(&[(0.0, 0.0), (10.0, 1.0), (10.0, 0.0), (0.0, 1.0)]);
        let mut round = vec![0, 1, 2, 3];
        lengths.shorten(&mut round, &Stop::default());
        assert_eq!(lengths.round_m(&round), 22.0);
    }

    #[test]
    fn leaves_distant_points_unchanged() {
        let mut lengths = of(&[(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (1.0, 5.0)]);
        lengths.lengths_m[3] = f64::INFINITY;
        lengths.lengths_m[12] = f64::INFINITY;
        let mut round = vec![3, 0, 2, 1];
        lengths.shorten(&mut round, &Stop::default());
        assert_eq!(round, [3, 0, 2, 1]);
    }

    proptest! {
        #[test]
        fn is_not_longer_than_the_input_and_close_to_the_shortest(
            points in prop::collection::vec((0.0..100.0, 0.0..100.0), 0..8),
        ) {
            let lengths = of(&points);
            let mut round: Vec<u32> = (0..points.len() as u32).collect();
            let before_m = lengths.round_m(&round);
            lengths.shorten(&mut round, &Stop::default());
            let mut points_of = round.clone();
            points_of.sort_unstable();
            prop_assert!((0..points.len() as u32).eq(points_of));
            let after_m = lengths.round_m(&round);
            prop_assert!(after_m <= before_m);
            let fixed = usize::from(!round.is_empty());
            prop_assert!(after_m <= 1.25 * best_m(&lengths, &mut round, fixed) + 1e-9);
        }
    }
}
