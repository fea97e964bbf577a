//! The five circles that Algorithm 1 draws about a pair of sensor nodes.
//!
//! The sensor nodes in them are determined by [`crate::strategies::algorithm_1`].

use skysink_common::geometry::Position;

/// Candidate circles about one pair, C1 to C5.
pub const CIRCLES: usize = 5;

/// Step 4 of Algorithm 1: centres of the five circles of radius `d_c` [m] about anchor i and partner k.
///
/// With `u = (L_i − L_k)/d` and `V = sqrt(|d_c² − d²/4|)`: C1 and C2 through both, at the midpoint `± V (−u_y, u_x)`;
/// C3 touching k, `L_k + d_c u`; C4 touching i, `L_i − d_c u`; C5 at the midpoint. Where both coincide, `u = (1, 0)`.
#[must_use]
pub fn circles(anchor: &Position, partner: &Position, comm_radius_m: f64) -> [Position; CIRCLES] {
    let apart_m = (anchor - partner).norm();
    let along = if apart_m > 0.0 { (anchor - partner) / apart_m } else { nalgebra::Vector2::x() };
    let across = nalgebra::Vector2::new(-along.y, along.x);
    let middle = nalgebra::center(anchor, partner);
    let offset_m = (comm_radius_m * comm_radius_m - apart_m * apart_m / 4.0).abs().sqrt();
    [
        middle + across * offset_m,
        middle - across * offset_m,
        partner + along * comm_radius_m,
        anchor - along * comm_radius_m,
        middle,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_circles(anchor: [f64; 2], partner: [f64; 2], expected: [[f64; 2]; CIRCLES]) {
        let found = circles(&anchor.into(), &partner.into(), 10.0);
        for (number, (found, expected)) in (1..).zip(found.iter().zip(expected)) {
            assert!((found - Position::from(expected)).norm() < 1e-12, "C{number}: {found}");
        }
    }

    #[test]
    fn the_five_circles_are_those_of_the_paper() {
        // d = 12: V = sqrt(10² − 6²) = 8. u = (1, 0).
        let expected = [[46.0, 58.0], [46.0, 42.0], [50.0, 50.0], [42.0, 50.0], [46.0, 50.0]];
        assert_circles([52.0, 50.0], [40.0, 50.0], expected);
        // The same pair the other way round, u = (−1, 0): C1 and C2 change places.
        let expected = [[46.0, 42.0], [46.0, 58.0], [42.0, 50.0], [50.0, 50.0], [46.0, 50.0]];
        assert_circles([40.0, 50.0], [52.0, 50.0], expected);
        // u = (0, 1): C1 = (mx − V, my).
        let expected = [[42.0, 46.0], [58.0, 46.0], [50.0, 50.0], [50.0, 42.0], [50.0, 46.0]];
        assert_circles([50.0, 52.0], [50.0, 40.0], expected);
    }

    #[test]
    fn the_five_circles_merge_where_the_pair_is_two_radii_apart() {
        assert_circles([60.0, 50.0], [40.0, 50.0], [[50.0, 50.0]; CIRCLES]);
    }

    #[test]
    fn the_circles_of_a_pair_farther_apart_take_the_magnitude_of_the_offset() {
        // d = 25: V = sqrt(|10² − 12.5²|) = 7.5.
        let expected = [[50.0, 57.5], [50.0, 42.5], [47.5, 50.0], [52.5, 50.0], [50.0, 50.0]];
        assert_circles([62.5, 50.0], [37.5, 50.0], expected);
    }

    #[test]
    fn a_coincident_pair_has_circles_on_all_four_sides() {
        assert_circles([5.0, 5.0], [5.0, 5.0], [[5.0, 15.0], [5.0, -5.0], [15.0, 5.0], [-5.0, 5.0], [5.0, 5.0]]);
    }
}
