//! Positions on the ground plane, and the definition of "within range".

/// A position on the ground [m], in the frame of the area: origin in its south-west corner, x east, y north.
pub type Position = nalgebra::Point2<f64>;

/// The point at the altitude `z_m` [m] above `ground`.
#[must_use]
pub fn above(ground: &Position, z_m: f64) -> nalgebra::Point3<f64> {
    nalgebra::Point3::new(ground.x, ground.y, z_m)
}

/// Slack of [`within`], relative to the radius.
///
/// The candidate circles of Algorithm 1 pass exactly *through* sensor nodes; without slack, rounding would drop them.
pub const RANGE_SLACK: f64 = 1e-9;

/// Squared distance [m²] between two positions.
#[must_use]
#[inline]
pub fn distance_squared(a: &Position, b: &Position) -> f64 {
    (a - b).norm_squared()
}

/// Whether `a` and `b` are at most `radius_m` [m] apart, up to [`RANGE_SLACK`]; false if any of them is NaN.
#[must_use]
#[inline]
pub fn within(a: &Position, b: &Position, radius_m: f64) -> bool {
    let limit_m = radius_m * (1.0 + RANGE_SLACK);
    distance_squared(a, b) <= limit_m * limit_m
}

/// Elevation angle `θ` [deg] of the UAV as seen from a sensor node, at the squared horizontal distance `d2_m2` [m²] and
/// the altitude `z_m` [m].
#[must_use]
pub fn elevation_deg(d2_m2: f64, z_m: f64) -> f64 {
    z_m.atan2(d2_m2.sqrt()).to_degrees()
}

/// The south-west and the north-east corner of the smallest box around positions; `None` without positions.
#[must_use]
pub fn extent(positions: impl IntoIterator<Item = Position>) -> Option<[Position; 2]> {
    let boxes = positions.into_iter().map(|at| [at; 2]);
    boxes.reduce(|[low, high], [at, _]| [low.inf(&at), high.sup(&at)])
}

/// Length of a way from `from` along `bends` [m].
#[must_use]
pub fn length_m(from: &Position, bends: &[Position]) -> f64 {
    let begins = std::iter::once(from).chain(bends);
    begins.zip(bends).map(|(a, b)| (b - a).norm()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_uav_overhead_is_seen_at_ninety_degrees() {
        assert!((elevation_deg(0.0, 20.0) - 90.0).abs() < 1e-12);
        assert!((elevation_deg(400.0, 20.0) - 45.0).abs() < 1e-12);
    }

    #[test]
    fn range_includes_the_rim_but_not_a_micrometre_more() {
        let centre = Position::new(0.1, 0.2);
        assert!(within(&centre, &Position::new(0.1 + 10.0 + 5e-9, 0.2), 10.0));
        assert!(!within(&centre, &Position::new(0.1 + 10.0 + 1e-6, 0.2), 10.0));
    }

    #[test]
    fn range_includes_the_rim_of_the_slack() {
        let rim_m = 10.0 * (1.0 + RANGE_SLACK);
        assert!(within(&Position::origin(), &Position::new(rim_m, 0.0), 10.0));
        assert!(!within(&Position::origin(), &Position::new(rim_m.next_up(), 0.0), 10.0));
    }

    #[test]
    fn no_point_is_within_range_of_nan() {
        let nan = Position::new(f64::NAN, 0.0);
        assert!(!within(&nan, &Position::origin(), 10.0));
        assert!(!within(&Position::origin(), &Position::origin(), f64::NAN));
    }
}
