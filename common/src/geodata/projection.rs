//! Projection of latitude and longitude onto the plane of the area, in metres east and north of its south-west corner,
//! and back.
//!
//! The plane touches the WGS84 ellipsoid at that corner. Whether a position lies in the area is left to the caller.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::geometry::Position;

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
pub struct Projection {
    /// From Earth-centred coordinates [m] to east, north and up at the origin [m].
    to_plane: Isometry3<f64>,
}

impl Projection {
    /// The projection onto the plane that touches the ellipsoid at `origin`, x east and y north.
    pub fn at(origin: Origin) -> Self {
        let [(sin_lat, cos_lat), (sin_lon, cos_lon)] =
            [origin.lat_deg, origin.lon_deg].map(|degrees| degrees.to_radians().sin_cos());
        let rows = Matrix3::new(
            -sin_lon,
            cos_lon,
            0.0, // east
            -sin_lat * cos_lon,
            -sin_lat * sin_lon,
            cos_lat, // north
            cos_lat * cos_lon,
            cos_lat * sin_lon,
            sin_lat, // up
        );
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rows));
        let corner = Translation3::from(-earth_centred(origin.lat_deg, origin.lon_deg));
        Self { to_plane: Isometry3::from_parts(Translation3::identity(), rotation) * corner }
    }

    /// Orthogonal projection of a point at altitude 0 onto the plane [m]; `None` on the far side of the Earth.
    ///
    /// Latitude in [−90, 90]. At the distance d the plane lies `d²/2R` above the ground (75 m at 31 km), and distances
    /// are shortened by about `d³/6R²` (0.12 m there).
    pub fn project(&self, lat_deg: f64, lon_deg: f64) -> Option<Position> {
        let point = self.to_plane * nalgebra::Point3::from(earth_centred(lat_deg, lon_deg));
        (point.z > -HORIZON_DEPTH_M).then(|| point.xy())
    }

    /// The inverse of [`Self::project`]; `None` if no point of the ellipsoid lies below `position`.
    ///
    /// `P = F + u n`, with the point F of the plane and its unit normal n, both Earth-centred, and u the root nearest 0
    /// of `|S(F + u n)|² = 1`, `S = diag(1/a, 1/a, 1/b)`. On the ellipsoid `tan φ = (a/b)² z/√(x² + y²)` and
    /// `tan λ = y/x` (Torge and Müller, "Geodesy", 4th ed., 2012, chapter 4, with `1 − e² = (b/a)²`).
    pub fn unproject(&self, position: &Position) -> Option<GeodeticPosition> {
        let [a_m, b_m] = SEMI_AXES_M;
        let scaled = |vector: Vector3<f64>| vector.component_div(&Vector3::new(a_m, a_m, b_m));
        let foot = self.out_of_plane([position.x, position.y, 0.0]);
        let normal = (self.out_of_plane([0.0, 0.0, a_m]) - self.out_of_plane([0.0; 3])) / a_m;
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
    fn out_of_plane(&self, point_m: [f64; 3]) -> Vector3<f64> {
        self.to_plane.inverse_transform_point(&point_m.into()).coords
    }
}

/// Earth-centred coordinates [m] of a point of the ellipsoid: `N = a²/√(a² cos² φ + b² sin² φ)`,
/// `(N cos φ cos λ, N cos φ sin λ, (b/a)² N sin φ)`.
fn earth_centred(lat_deg: f64, lon_deg: f64) -> Vector3<f64> {
    let [a_m, b_m] = SEMI_AXES_M;
    let [(sin_lat, cos_lat), (sin_lon, cos_lon)] = [lat_deg, lon_deg].map(|degrees| degrees.to_radians().sin_cos());
    let normal_m = a_m * a_m / (a_m * cos_lat).hypot(b_m * sin_lat);
    let polar_m = (b_m / a_m).powi(2) * normal_m * sin_lat;
    Vector3::new(normal_m * cos_lat * cos_lon, normal_m * cos_lat * sin_lon, polar_m)
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
