//! `[area]`: the area that is flown over.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::airspace::Polygon;
use crate::geodata::projection::Origin;
use crate::geometry::Position;
use crate::keys::{Accepts, POSITIVE};
use crate::slack::BORDER_SLACK;

crate::keys! {
    /// `[area]`: the area `[0, width] × [0, height]`, closed.
    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, expecting = "a table")]
    pub struct Area {
        /// Side of a square area [m], or `width_m` and `height_m`. The area is `[0, width] × [0, height]`, closed.
        side_m: Option<f64> = 100.0, POSITIVE;
        /// Extent in x, to the east [m]; with `height_m`.
        width_m: Option<f64>, POSITIVE;
        /// Extent in y, to the north [m]; with `width_m`.
        height_m: Option<f64>, POSITIVE;
        /// Geodetic latitude of the area's south-west corner on the WGS84 ellipsoid [°]; with `origin_lon_deg`. Both
        /// are required by a sensor list with `lat_deg,lon_deg`.
        origin_lat_deg: Option<f64>, Accepts::Number("a latitude, -90 to 90", |lat_deg| lat_deg.abs() <= 90.0);
        /// Longitude of the same corner [°]; with `origin_lat_deg`.
        origin_lon_deg: Option<f64>, Accepts::Number("a longitude, -180 to 180", |lon_deg| lon_deg.abs() <= 180.0);
        /// Corners of a polygon that the UAV must not leave, `[[x, y], ...]` [m]; without it the whole area. Drawn SNs
        /// lie in it; those of a list may stand outside, and are served from inside.
        boundary_m: Option<Vec<[f64; 2]>>, CORNERS;
        /// Farthest that zones and buildings may grow, and the boundary may shrink [m], where all of them have more
        /// than 1 000 corners and are simplified; default 5, and 0 is not at all (decision D14).
        simplify_m: Option<f64>, Accepts::Number("a distance, at least 0", |simplify_m| simplify_m >= 0.0);
        /// `[[area.no_fly]]`: polygons that the UAV must not enter, at any altitude, or files of them (decision D14).
        /// SNs may stand in them.
        no_fly: Option<Vec<NoFlyKeys>>, Accepts::TablesOf(NoFlyKeys::KEYS);
        /// `[[area.building]]`: buildings (decision D16).
        building: Option<Vec<BuildingKeys>>, Accepts::TablesOf(BuildingKeys::KEYS);
    }
}

/// Farthest that zones grow where they have many corners, by default [m].
const SIMPLIFY_M: f64 = 5.0;

/// Corners of a polygon.
pub(super) const CORNERS: Accepts = Accepts::Rule("corners of a polygon, `[[x, y], [x, y], [x, y], ...]` [m]");

crate::keys! {
    /// `[[area.no_fly]]`: a polygon that the UAV must not enter (decision D14), or a file of such polygons.
    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, expecting = "a table")]
    pub struct NoFlyKeys {
        /// Its corners, `[[x, y], ...]` [m]; required without `file`.
        polygon_m: Option<Vec<[f64; 2]>>, CORNERS;
        /// A KML, KMZ or GeoJSON file of zones, buildings and a boundary, relative to the scenario's folder; replaces
        /// `polygon_m`. A run keeps their corners.
        file: Option<PathBuf>, Accepts::Rule("a path");
    }
}

impl NoFlyKeys {
    /// Its corners [m]; none if it is a file, which a checked scenario has replaced by polygons.
    pub fn corners(&self) -> &[[f64; 2]] {
        self.polygon_m.as_deref().unwrap_or_default()
    }
}

crate::keys! {
    /// `[[area.building]]`: a building, a no-fly zone for a UAV below its top (decision D16).
    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, expecting = "a table")]
    pub struct BuildingKeys {
        /// Corners of its ground plan, `[[x, y], ...]` [m]; required.
        polygon_m: Vec<[f64; 2]>, CORNERS;
        /// Its height [m]; required.
        height_m: f64, POSITIVE;
    }
}

impl Area {
    /// An area without geodetic coordinates.
    #[must_use]
    pub const fn new(width_m: f64, height_m: f64) -> Self {
        Self {
            side_m: None,
            width_m: Some(width_m),
            height_m: Some(height_m),
            origin_lat_deg: None,
            origin_lon_deg: None,
            boundary_m: None,
            simplify_m: None,
            no_fly: None,
            building: None,
        }
    }

    /// Extent in x [m].
    pub fn width_m(&self) -> f64 {
        self.width_m.or(self.side_m).unwrap_or(f64::NAN)
    }

    /// Extent in y [m].
    pub fn height_m(&self) -> f64 {
        self.height_m.or(self.side_m).unwrap_or(f64::NAN)
    }

    /// Its south-west corner on the ellipsoid; `None` without geodetic coordinates.
    pub fn origin(&self) -> Option<Origin> {
        Some(Origin { lat_deg: self.origin_lat_deg?, lon_deg: self.origin_lon_deg? })
    }

    /// The polygon that the UAV must not leave, if there is one.
    pub fn border(&self) -> Option<Polygon> {
        Polygon::of(self.boundary_m.as_ref()?, true).ok()
    }

    /// Farthest that zones grow where they have many corners [m].
    pub fn simplify_m(&self) -> f64 {
        self.simplify_m.unwrap_or(SIMPLIFY_M)
    }

    /// How far rounding may put a position over its border, or into a zone [m].
    pub fn border_slack_m(&self) -> f64 {
        BORDER_SLACK * self.width_m().max(self.height_m())
    }

    /// Whether a position lies in the closed area, up to `slack_m` [m]; false for NaN.
    pub fn contains(&self, position: &Position, slack_m: f64) -> bool {
        (-slack_m..=self.width_m() + slack_m).contains(&position.x)
            && (-slack_m..=self.height_m() + slack_m).contains(&position.y)
    }
}
