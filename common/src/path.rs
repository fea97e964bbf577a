//! Where a plan leads after its slot: the message, and which one can be believed.

#[cfg(feature = "node")]
use iceoryx2::prelude::ZeroCopySend;
use nalgebra::Point3;

use crate::geometry::{Position, RANGE_SLACK};
use crate::scenario::Area;

/// Most points of a path.
pub const MAX_POINTS: usize = 64;

/// Payload element of `path`: a planned waypoint. The first is that of the slot's own plan.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[cfg_attr(feature = "node", derive(ZeroCopySend), type_name("skysink.PathPoint.v1"))]
pub struct PathPoint {
    /// East [m].
    pub x_m: f64,
    /// North [m].
    pub y_m: f64,
    /// Up [m].
    pub z_m: f64,
}

impl From<Point3<f64>> for PathPoint {
    fn from(point: Point3<f64>) -> Self {
        Self { x_m: point.x, y_m: point.y, z_m: point.z }
    }
}

/// Whether these are 1 to [`MAX_POINTS`] points over the area, at altitudes that single precision, in which they are
/// drawn, can hold.
#[must_use]
pub fn believable(points: &[PathPoint], area: &Area) -> bool {
    let border_m = RANGE_SLACK * area.width_m.max(area.height_m);
    let over = |point: &PathPoint| area.contains(&Position::new(point.x_m, point.y_m), border_m);
    (1..=MAX_POINTS).contains(&points.len()) && points.iter().all(|point| over(point) && (point.z_m as f32).is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    const AREA: Area = Area::new(100.0, 50.0);

    /// Outside programs declare the same struct: a size that changes needs a new version in the type's name.
    #[test]
    fn the_layout_stays_what_it_is() {
        assert_eq!(size_of::<PathPoint>(), 24);
        let point = PathPoint::from(Point3::new(1.0, 2.0, 3.0));
        assert_eq!((point.x_m, point.y_m, point.z_m), (1.0, 2.0, 3.0));
    }

    #[test]
    fn one_to_sixty_four_points_are_a_path() {
        for (count, believed) in [(0, false), (1, true), (64, true), (65, false), (100_000, false)] {
            assert_eq!(believable(&vec![PathPoint::default(); count], &AREA), believed, "{count} points");
        }
    }

    #[test]
    fn one_point_that_is_nowhere_spoils_a_path() {
        let good = [100.0, 50.0, 20.0];
        assert!(
            believable(&[PathPoint::from(Point3::from(good)), Point3::new(0.0, 0.0, 1e9).into()], &AREA),
            "the rim is part of the area"
        );
        for (axis, value) in [
            (0, f64::NAN),
            (1, f64::NAN),
            (2, f64::NAN),
            (0, f64::INFINITY),
            (1, f64::NEG_INFINITY),
            (2, f64::INFINITY),
            (2, -1e300),
            (0, 100.1),
            (1, 50.1),
            (0, -0.1),
        ] {
            let mut bad = good;
            bad[axis] = value;
            assert!(!believable(&[PathPoint::from(Point3::from(good)), Point3::from(bad).into()], &AREA), "{bad:?}");
        }
    }
}
