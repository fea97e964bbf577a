//! Projection of latitude and longitude onto the plane of the area, in metres east and north of its south-west corner,
//! and back.
//!
//! The plane touches the WGS84 ellipsoid at that corner. Whether a position lies in the area is left to the caller.

use nalgebra::Vector3;
use sguaba::math::RigidBodyTransform;
use sguaba::systems::{Ecef, Wgs84};
use sguaba::{Coordinate, system};
use uom::ConstZero;
use uom::si::angle::degree;
use uom::si::f64::{Angle, Length};
use uom::si::length::meter;

use crate::geometry::Position;

system!(
    /// East, north and up at the south-west corner of the area.
    struct Corner using ENU
);

/// Depth [m] below the plane beyond which the ground faces away from it, so that the projection is not unique. The
/// centre of the Earth lies 6357 to 6378 km below the plane, the horizon at most 22 km higher.
const HORIZON_DEPTH_M: f64 = 6.3e6;

/// Semi-axes of the WGS84 ellipsoid [m], equatorial and polar: `a`, and `b = a (1 − f)` with `1/f = 298.257223563`.
const SEMI_AXES_M: [f64; 2] = [6_378_137.0, 6_378_137.0 * (1.0 - 1.0 / 298.257_223_563)];

/// The south-west corner of the area on the WGS84 ellipsoid, at altitude 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Origin {
    /// Geodetic latitude [°], −90 to 90.
    pub lat_deg: f64,
    /// Longitude [°], −180 to 180.
    pub lon_deg: f64,
}

/// A point on the WGS84 ellipsoid, at altitude 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GeodeticPosition {
    /// Geodetic latitude [°], −90 to 90.
    pub lat_deg: f64,
    /// Longitude [°], −180 to 180.
    pub lon_deg: f64,
}

/// The projection about one origin.
#[derive(Debug, Clone, Copy)]
pub struct Projection(RigidBodyTransform<Ecef, Corner>);

impl Projection {
    /// The projection onto the plane that touches the ellipsoid at `origin`, x east and y north.
    pub fn at(origin: Origin) -> Self {
        let corner = wgs84(origin.lat_deg, origin.lon_deg);
        // SAFETY: `Corner` is defined by this origin alone. sguaba marks the call `unsafe` because a wrong origin would
        // mix up frames; it does not affect memory safety.
        Self(unsafe { RigidBodyTransform::ecef_to_enu_at(&corner) })
    }

    /// Orthogonal projection of a point at altitude 0 onto the plane [m]; `None` on the far side of the Earth.
    ///
    /// Latitude in [−90, 90]. At the distance d the plane lies `d²/2R` above the ground (75 m at 31 km), and distances
    /// are shortened by about `d³/6R²` (0.12 m there).
    pub fn project(&self, lat_deg: f64, lon_deg: f64) -> Option<Position> {
        let point = Coordinate::<Ecef>::from_wgs84(&wgs84(lat_deg, lon_deg));
        let [east_m, north_m, up_m] = self.0.transform(point).to_cartesian().map(|length| length.get::<meter>());
        (up_m > -HORIZON_DEPTH_M).then(|| Position::new(east_m, north_m))
    }

    /// The inverse of [`Self::project`]; `None` if no point of the ellipsoid lies below `position`.
    ///
    /// `P = F + u n`, with the point F of the plane and its unit normal n, both Earth-centred, and u the root nearest 0
    /// of `|S(F + u n)|² = 1`, `S = diag(1/a, 1/a, 1/b)`. On the ellipsoid `tan φ = (a/b)² z/√(x² + y²)` and
    /// `tan λ = y/x` (Torge and Müller, "Geodesy", 4th ed., 2012, chapter 4, with `1 − e² = (b/a)²`).
    pub fn unproject(&self, position: &Position) -> Option<GeodeticPosition> {
        let [a_m, b_m] = SEMI_AXES_M;
        let scaled = |vector: Vector3<f64>| vector.component_div(&Vector3::new(a_m, a_m, b_m));
        let foot = self.earth_centred([position.x, position.y, 0.0]);
        let normal = (self.earth_centred([0.0, 0.0, a_m]) - self.earth_centred([0.0; 3])) / a_m;
        let outside = scaled(foot).norm_squared() - 1.0;
        let slope = scaled(foot).dot(&scaled(normal));
        let discriminant = slope * slope - scaled(normal).norm_squared() * outside;
        // There is no root for NaN or beyond the rim of the Earth. This form does not cancel for a small u.
        let root = (discriminant >= 0.0).then(|| -outside / (slope + discriminant.sqrt()))?;
        let point = foot + normal * root;
        let lat_deg = ((a_m / b_m).powi(2) * point.z).atan2(point.x.hypot(point.y)).to_degrees();
        Some(GeodeticPosition { lat_deg, lon_deg: point.y.atan2(point.x).to_degrees() })
    }

    /// Earth-centred coordinates [m] of a point in the frame of the plane [m].
    fn earth_centred(&self, [east_m, north_m, up_m]: [f64; 3]) -> Vector3<f64> {
        let point = Coordinate::<Corner>::builder()
            .enu_east(Length::new::<meter>(east_m))
            .enu_north(Length::new::<meter>(north_m))
            .enu_up(Length::new::<meter>(up_m))
            .build();
        let cartesian = self.0.inverse_transform(point).to_cartesian().map(|length| length.get::<meter>());
        Vector3::from(cartesian)
    }
}

fn wgs84(lat_deg: f64, lon_deg: f64) -> Wgs84 {
    Wgs84::builder()
        .latitude(Angle::new::<degree>(lat_deg))
        .expect("the callers check that it is −90 to 90")
        .longitude(Angle::new::<degree>(lon_deg))
        .altitude(Length::ZERO)
        .build()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn longitude_due_east_of_an_equatorial_origin_matches_the_closed_form() {
        // On the equator, a circle of radius a: x = a sin λ, so x = a/2 is at 30°. Past the rim there is no ground.
        let projection = Projection::at(Origin { lat_deg: 0.0, lon_deg: 10.0 });
        let point = projection.unproject(&Position::new(SEMI_AXES_M[0] / 2.0, 0.0)).unwrap();
        assert!(point.lat_deg.abs() < 1e-12 && (point.lon_deg - 40.0).abs() < 1e-12, "{point:?}");
        assert_eq!(projection.unproject(&Position::new(SEMI_AXES_M[0] * 1.001, 0.0)), None);
        assert_eq!(projection.unproject(&Position::new(f64::NAN, 0.0)), None);
    }

    proptest! {
        #[test]
        fn projection_inverts_unprojection(
            lat_deg in -90.0..90.0f64,
            lon_deg in -180.0..180.0f64,
            [x_m, y_m] in prop::array::uniform2(-100e3..100e3f64),
        ) {
            let projection = Projection::at(Origin { lat_deg, lon_deg });
            let point = projection.unproject(&Position::new(x_m, y_m)).unwrap();
            let back = projection.project(point.lat_deg, point.lon_deg).unwrap();
            prop_assert!((back - Position::new(x_m, y_m)).norm() < 1e-7, "{point:?} is at {back}");
        }
    }
}
