//! Latitude and longitude onto the plane of the area: metres east and north of its south-west corner.
//!
//! The plane touches the WGS84 ellipsoid at the corner. Whether a position lies in the area is left to the reader.

use sguaba::math::RigidBodyTransform;
use sguaba::systems::{Ecef, Wgs84};
use sguaba::{Coordinate, system};
use uom::ConstZero;
use uom::si::angle::degree;
use uom::si::f64::{Angle, Length};
use uom::si::length::meter;

use crate::geometry::Position;
use crate::scenario::Origin;

system!(
    /// East, north and up at the south-west corner of the area.
    struct Corner using ENU
);

/// Depth [m] below the plane from which on the ground faces away from it, where two places share one position: the
/// centre of the Earth lies 6357 to 6378 km deep, the horizon of a place on the ellipsoid at most 22 km higher.
const HORIZON_DEPTH_M: f64 = 6.3e6;

/// The projection about one origin.
pub(super) struct Projection(RigidBodyTransform<Ecef, Corner>);

impl Projection {
    /// The plane that touches the ellipsoid at `origin`, x east and y north.
    pub fn about(origin: Origin) -> Self {
        let corner = place(origin.lat_deg, origin.lon_deg);
        // SAFETY: `Corner` is defined by nothing but its origin, and this is the origin; sguaba asks for `unsafe` where a
        // wrong claim would mix up frames, no memory is at stake.
        Self(unsafe { RigidBodyTransform::ecef_to_enu_at(&corner) })
    }

    /// Where a place at altitude 0 meets the plane, looking straight down on it [m]; `None` on the far side of the
    /// Earth.
    ///
    /// Latitude in [−90, 90]. The plane leaves the ground by `d²/2R` at the distance d (75 m at 31 km), and distances
    /// shrink by about `d³/6R²` (0.12 m there).
    pub fn project(&self, lat_deg: f64, lon_deg: f64) -> Option<Position> {
        let place = Coordinate::<Ecef>::from_wgs84(&place(lat_deg, lon_deg));
        let [east_m, north_m, up_m] = self.0.transform(place).to_cartesian().map(|length| length.get::<meter>());
        (up_m > -HORIZON_DEPTH_M).then(|| Position::new(east_m, north_m))
    }
}

fn place(lat_deg: f64, lon_deg: f64) -> Wgs84 {
    Wgs84::builder()
        .latitude(Angle::new::<degree>(lat_deg))
        .expect("checked by the readers: −90 to 90")
        .longitude(Angle::new::<degree>(lon_deg))
        .altitude(Length::ZERO)
        .build()
}
