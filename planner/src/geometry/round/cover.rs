//! Which disks the legs of a round touch, by counts.

use skysink_common::geometry::{Position, RANGE_SLACK, distance_squared};

/// Most columns or rows of the grid.
const MOST_CELLS: f64 = 1_000.0;

/// Disks of one radius, sorted by the rows and columns of a grid: those that a leg may touch are few ranges of indices.
pub struct Cover {
    /// Centres, in this order.
    pub centres: Vec<Position>,
    /// Which of the given disks each is.
    pub ids: Vec<u32>,
    /// Within this distance a disk is touched [m].
    pub radius_m: f64,
    lowest: Position,
    cell_m: f64,
    columns: usize,
    rows: usize,
    /// Index of the first disk of each cell, by rows; then the number of disks.
    begins: Vec<usize>,
}

impl Cover {
    /// The disks of this radius [m].
    #[must_use]
    pub fn new(centres: &[Position], radius_m: f64) -> Self {
        let corner = |of: fn(f64, f64) -> f64, from: f64| {
            let fold = |axis: usize| centres.iter().map(|centre| centre[axis]).fold(from, of);
            Position::new(fold(0), fold(1))
        };
        let [lowest, highest] = [corner(f64::min, f64::INFINITY), corner(f64::max, f64::NEG_INFINITY)];
        let sides = if centres.is_empty() { nalgebra::Vector2::zeros() } else { highest - lowest };
        let spacing_m = (sides.x * sides.y / centres.len().max(1) as f64).sqrt();
        let cell_m = spacing_m.max(radius_m / 2.0).max(sides.max() / MOST_CELLS).max(f64::MIN_POSITIVE);
        let [columns, rows] = [sides.x, sides.y].map(|side_m| (side_m / cell_m) as usize + 1);
        let cell_of = |centre: &Position| {
            let [column, row] = [centre.x - lowest.x, centre.y - lowest.y].map(|along_m| (along_m / cell_m) as usize);
            row.min(rows - 1) * columns + column.min(columns - 1)
        };
        let mut ids: Vec<u32> = (0..centres.len() as u32).collect();
        ids.sort_by_key(|&id| cell_of(&centres[id as usize]));
        let sorted: Vec<Position> = ids.iter().map(|&id| centres[id as usize]).collect();
        let mut begins = vec![0; columns * rows + 1];
        for centre in &sorted {
            begins[cell_of(centre) + 1] += 1;
        }
        for cell in 0..columns * rows {
            begins[cell + 1] += begins[cell];
        }
        Self { centres: sorted, ids, radius_m, lowest, cell_m, columns, rows, begins }
    }

    /// Adds `change` to the counts of the disks that the leg between two points touches; modulo 2^16, so that
    /// `u16::MAX` takes one away.
    pub fn count(&self, counts: &mut [u16], one: &Position, other: &Position, change: u16) {
        // The same disks in both directions, whatever the rounding.
        let [from, to] = if (one.x, one.y) <= (other.x, other.y) { [one, other] } else { [other, one] };
        let cell = |at_m: f64, lowest_m: f64, most: usize| {
            (((at_m - lowest_m) / self.cell_m).max(0.0) as usize).min(most - 1) // a negative number becomes 0
        };
        let along = to - from;
        let per_m2 = 1.0 / along.norm_squared().max(f64::MIN_POSITIVE);
        let radius_m2 = self.radius_m * self.radius_m;
        let row = |at_m: f64| cell(at_m, self.lowest.y, self.rows);
        let [first, last] = [from.y.min(to.y) - self.radius_m, from.y.max(to.y) + self.radius_m];
        if last < self.lowest.y {
            return;
        }
        for row in row(first)..=row(last) {
            // The part of the leg within a radius of the row.
            let low_m = self.lowest.y + row as f64 * self.cell_m - self.radius_m;
            let high_m = low_m + self.cell_m + 2.0 * self.radius_m;
            let ends_m = if along.y.abs() > f64::EPSILON * self.cell_m {
                [low_m, high_m].map(|at_m| from.x + ((at_m - from.y) / along.y).clamp(0.0, 1.0) * along.x)
            } else {
                [from.x, to.x]
            };
            let slack_m = self.radius_m * RANGE_SLACK;
            let column = |at_m: f64| cell(at_m, self.lowest.x, self.columns);
            let begin = column(ends_m[0].min(ends_m[1]) - self.radius_m - slack_m);
            let end = column(ends_m[0].max(ends_m[1]) + self.radius_m + slack_m);
            let cells = row * self.columns;
            let within = self.begins[cells + begin]..self.begins[cells + end + 1];
            for (centre, count) in self.centres[within.clone()].iter().zip(&mut counts[within]) {
                let away = centre - from;
                let fraction = (away.dot(&along) * per_m2).clamp(0.0, 1.0);
                let is_touched = (away - along * fraction).norm_squared() <= radius_m2;
                *count = count.wrapping_add(if is_touched { change } else { 0 });
            }
        }
    }
}

/// Squared distance [m²] of `point` to the leg from `from` to `to`.
#[must_use]
pub fn distance_to_leg_squared(point: &Position, from: &Position, to: &Position) -> f64 {
    distance_squared(point, &nearest_of_leg(point, from, to))
}

/// The point of the leg from `from` to `to` that is nearest to `point`.
pub fn nearest_of_leg(point: &Position, from: &Position, to: &Position) -> Position {
    let along = to - from;
    let fraction = ((point - from).dot(&along) / along.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    from + along * fraction
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_leg_counts_the_disks_that_it_touches(
            centres in prop::collection::vec([0.0..100.0, -30.0..30.0f64], 1..60),
            ends in [[-50.0..150.0, -50.0..50.0], [-50.0..150.0, -50.0..50.0f64]],
            radius_m in 0.1..30.0, is_on_a_line in any::<bool>(),
        ) {
            let centres: Vec<Position> =
                centres.into_iter().map(|[x_m, y_m]| Position::new(x_m, if is_on_a_line { 7.0 } else { y_m })).collect();
            let [from, to] = ends.map(Position::from);
            let cover = Cover::new(&centres, radius_m);
            let mut counts = vec![0; centres.len()];
            cover.count(&mut counts, &from, &to, 1);
            for (id, count) in cover.ids.iter().zip(&counts) {
                let away_m = distance_to_leg_squared(&centres[*id as usize], &from, &to).sqrt();
                prop_assert!((away_m - radius_m).abs() < 1e-9 || (*count == 1) == (away_m < radius_m));
            }
            cover.count(&mut counts, &from, &to, u16::MAX);
            prop_assert!(counts.iter().all(|count| *count == 0));
        }
    }
}
