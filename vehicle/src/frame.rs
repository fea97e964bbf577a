//! Positions of the scenario's area on Earth, and back.

use nalgebra::Point3;
use skysink_common::geodata::projection::{GeodeticPosition, Origin, Projection};
use skysink_common::geometry::above;

use crate::telemetry::Fix;

/// The area of a scenario on Earth. Altitudes are above the home position of the vehicle, which the scenario has on the
/// ground.
#[derive(Debug, Clone, Copy)]
pub struct AreaFrame(Projection);

impl AreaFrame {
    /// The frame of an area whose south-west corner is `origin`.
    #[must_use]
    pub fn at(origin: Origin) -> Self {
        Self(Projection::at(origin))
    }

    /// Where `fix` is in the area [m]; `None` on the far side of the Earth.
    pub fn position(&self, fix: &Fix) -> Option<Point3<f64>> {
        if !(-90.0..=90.0).contains(&fix.lat_deg) || !fix.lon_deg.is_finite() {
            return None;
        }
        Some(above(&self.0.project(fix.lat_deg, fix.lon_deg)?, fix.above_home_m))
    }

    /// Where `position` [m] is on Earth; `None` beyond the rim.
    pub fn geodetic(&self, position: &Point3<f64>) -> Option<GeodeticPosition> {
        self.0.unproject(&position.xy())
    }
}
