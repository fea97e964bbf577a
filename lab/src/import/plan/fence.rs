//! The geofence of a plan as zones.
//!
//! Degrees in plans are rounded, so that a flight along a fence would cross it: polygons that must not be entered are
//! [`LOOSE_M`] smaller, and one that must not be left is as much wider.

use std::f64::consts::TAU;

use geo::algorithm::buffer::{Buffer, BufferStyle, LineJoin};
use geo::{LineString, MultiPolygon, Polygon};
use skysink_common::airspace;
use skysink_common::geodata::projection::{Origin, Projection};
use skysink_common::geodata::{Zone, ZoneKind, check_geodetic};
use skysink_common::geometry::Position;

/// How much nearer a flight may come to a fence [m].
pub const LOOSE_M: f64 = 0.01;

/// Corners of a circle.
const CIRCLE_CORNERS: u32 = 36;

/// Largest radius of a circle [m].
const MOST_RADIUS_M: f64 = 1e6;

/// Sharper corners are cut [rad].
const SHARPEST: f64 = 0.1;

/// Sine of the least turn of a corner; moving a polygon adds others beside its corners.
const LEAST_TURN: f64 = 1e-3;

/// A zone of a polygon, at `place` in the file.
///
/// # Errors
/// If a corner is no position.
pub fn of_polygon(place: String, is_inclusion: bool, corners: &[[f64; 2]]) -> Result<Zone, String> {
    corners.iter().try_for_each(|&corner| check_geodetic(corner)).map_err(|expected| format!("{place}: {expected}"))?;
    Ok(zone(place, is_inclusion, loosened(corners, is_inclusion).unwrap_or_else(|| corners.to_vec())))
}

/// A zone of a circle: a polygon around one that must not be entered, within one that must not be left.
///
/// # Errors
/// If the centre is no position, or the radius [m] no length.
pub fn of_circle(place: String, is_inclusion: bool, centre: [f64; 2], radius_m: f64) -> Result<Zone, String> {
    check_geodetic(centre).map_err(|expected| format!("{place}: {expected}"))?;
    if !(radius_m > 0.0 && radius_m <= MOST_RADIUS_M) {
        return Err(format!("{place}: radius {radius_m}: expected above 0, at most {MOST_RADIUS_M} m"));
    }
    let projection = Projection::at(Origin { lat_deg: centre[0], lon_deg: centre[1] });
    let corner_rad = TAU / f64::from(CIRCLE_CORNERS);
    let radius_m = if is_inclusion { radius_m } else { radius_m / (corner_rad / 2.0).cos() };
    let corners = (0..CIRCLE_CORNERS).map(|corner| {
        let (sin, cos) = (f64::from(corner) * corner_rad).sin_cos();
        let corner = projection.unproject(&Position::new(radius_m * cos, radius_m * sin));
        corner.map(|corner| [corner.lat_deg, corner.lon_deg])
    });
    let corners: Option<Vec<[f64; 2]>> = corners.collect();
    let corners = corners.ok_or_else(|| format!("{place}: radius {radius_m}: expected one that fits on the Earth"))?;
    Ok(zone(place, is_inclusion, corners))
}

/// Checks that there is at most one polygon that must not be left.
///
/// # Errors
/// If there are more.
pub fn check(fence: &[Zone]) -> Result<(), String> {
    let mut boundaries = fence.iter().filter(|zone| zone.kind == ZoneKind::Boundary);
    match [boundaries.next(), boundaries.next()] {
        [Some(first), Some(second)] => Err(format!(
            "{}: a second area that must not be left, beside {}: expected one (autopilots differ in whether a vehicle \
             must stay in all of them or in any)",
            second.place, first.place
        )),
        _ => Ok(()),
    }
}

fn zone(place: String, is_inclusion: bool, corners: Vec<[f64; 2]>) -> Zone {
    let kind = if is_inclusion { ZoneKind::Boundary } else { ZoneKind::NoFly };
    Zone { place, corners, kind, is_marked: true }
}

/// The corners [°] of a polygon moved by [`LOOSE_M`]; `None` for one that is no simple polygon, or that would be none.
fn loosened(corners: &[[f64; 2]], is_inclusion: bool) -> Option<Vec<[f64; 2]>> {
    let [lat_deg, lon_deg] = *corners.first()?;
    let projection = Projection::at(Origin { lat_deg, lon_deg });
    let corners_m = corners.iter().map(|corner| projection.project(corner[0], corner[1]).map(|at| [at.x, at.y]));
    let corners_m: Vec<[f64; 2]> = corners_m.collect::<Option<_>>()?;
    airspace::Polygon::of(&corners_m, is_inclusion).ok()?;
    let ring: LineString = corners_m.iter().map(|&[x, y]| (x, y)).collect();
    let margin_m = if is_inclusion { LOOSE_M } else { -LOOSE_M };
    let style = BufferStyle::new(margin_m).line_join(LineJoin::Miter(SHARPEST));
    let MultiPolygon(moved) = Polygon::new(ring, vec![]).buffer_with_style(style);
    let [moved] = &moved[..] else { return None };
    let ring: Vec<Position> = moved.exterior().points().skip(1).map(|at| Position::new(at.x(), at.y())).collect();
    let turns = |index: &usize| {
        let [before, at, after] = [ring.len() - 1, 0, 1].map(|step| ring[(index + step) % ring.len()]);
        let [along, on] = [at - before, after - at];
        along.perp(&on).abs() > LEAST_TURN * along.norm() * on.norm()
    };
    let corners = (0..ring.len()).filter(turns).map(|index| projection.unproject(&ring[index]));
    corners.map(|corner| corner.map(|corner| [corner.lat_deg, corner.lon_deg])).collect()
}
