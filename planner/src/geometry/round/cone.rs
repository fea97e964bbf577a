//! The points of an order of disks that make the path shortest, as a second-order cone program, by Clarabel.
//!
//! The search moves one point at a time, which can end where two points lie together; this moves all at once.

use clarabel::solver::SupportedConeT::SecondOrderConeT;
use nalgebra::Vector2;
use skysink_common::geometry::Position;

use super::stops::DiskField;
use crate::cone_program::ConeProgram;

/// Rows of a cone: a bound, and a vector that is no longer.
const ROWS: usize = 3;

/// Tolerance of Clarabel.
const TOLERANCE: f64 = 1e-8;

/// A solution: points, and for each leg a vector no longer than 1, which bounds the length from below.
pub struct Shortest {
    /// The points, after the start if there is one [m].
    pub points: Vec<Position>,
    /// The vectors.
    pub directions: Vec<Vector2<f64>>,
}

/// The points of the disks `order`, after the start if there is one; `None` if Clarabel does not solve it.
///
/// Minimises `Σ t_k` with `‖p_{k+1} − p_k‖ ≤ t_k` for each leg, and `‖p_k − c_k‖ ≤ r` for each disk. Lengths are
/// relative to the start, or the first centre, and in units of the largest distance to it.
#[must_use]
pub fn shortest(field: &DiskField, order: &[u32]) -> Option<Shortest> {
    let fixed = field.fixed();
    let stops = fixed + order.len();
    if order.is_empty() || stops < 2 {
        return None;
    }
    let centre = |disk: u32| field.cover.centres[disk as usize];
    let origin = field.start.unwrap_or_else(|| centre(order[0]));
    let away_m = order.iter().map(|&disk| (centre(disk) - origin).norm());
    let unit_m = away_m.fold(field.inner_m, f64::max).max(f64::MIN_POSITIVE);
    let scaled = |position: Position| (position - origin) / unit_m;
    let legs = if field.is_closed { stops } else { stops - 1 };
    // Variables: x and y of each free point, then the length of each leg.
    let mut program = ConeProgram::new(2 * order.len() + legs);
    program.quadratic.clear(); // a linear program, for which Clarabel takes other steps than for zeros
    for leg in 0..legs {
        let length = 2 * order.len() + leg;
        program.linear[length] = 1.0;
        program.cone(SecondOrderConeT(ROWS));
        program.row(0.0, &[(length, -1.0)]);
        for axis in 0..2 {
            // The start is the origin.
            let free = [(leg, 1.0), ((leg + 1) % stops, -1.0)].into_iter().filter(|(stop, _)| *stop >= fixed);
            let factors: Vec<(usize, f64)> = free.map(|(stop, sign)| (2 * (stop - fixed) + axis, sign)).collect();
            program.row(0.0, &factors);
        }
    }
    for (stop, &disk) in order.iter().enumerate() {
        program.stay_within(field.inner_m / unit_m, &-scaled(centre(disk)), 2 * stop, 1.0);
    }
    let solution = program.solve(TOLERANCE)?;
    let free = solution.x[..2 * order.len()].chunks(2).zip(order).map(|(point, &disk)| {
        // An interior-point solution may lie a little outside.
        let away = origin + Vector2::new(point[0], point[1]) * unit_m - centre(disk);
        centre(disk) + away * (field.inner_m / away.norm().max(f64::MIN_POSITIVE)).min(1.0)
    });
    // The dual cone of a leg is (1, −u).
    let directions = solution.z[..ROWS * legs].chunks(ROWS).map(|cone| {
        let vector = -Vector2::new(cone[1], cone[2]);
        vector / vector.norm().max(1.0)
    });
    Some(Shortest { points: field.start.into_iter().chain(free).collect(), directions: directions.collect() })
}
