//! The field of imported positions: the sensor list and an area around it, georeferenced for geodetic positions.

use std::path::Path;

use skysink_common::error::InputError;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_lab::import::{self, Frame, Imported};

use super::field::{LIST, NewField, NewList};

/// Margin between the sensor nodes and the border of the area [m].
const MARGIN_M: f64 = 10.0;

/// Approximate length of a degree of latitude [m].
const DEGREE_M: f64 = 111_000.0;

/// Side of an area that contains all positions for which the tangent plane is accurate [m].
const VAST_M: f64 = 1e6;

/// Distances of the corner of the area from the sensor nodes, tried in this order [m]. A small one can fail: on the
/// southern hemisphere, a point far to the east of the corner, on the same parallel, has y < 0 in the tangent plane.
const CORNERS_M: [f64; 4] = [MARGIN_M, 100.0, 1e3, 1e4];

/// Imports the positions in the file `path`.
pub fn field(path: &Path) -> Result<NewField, InputError> {
    let imported = import::read(path)?;
    let (area, list) = match imported.frame {
        Frame::Plane => plane(&imported, path),
        Frame::Geodetic => geodetic(&imported, path)?,
    };
    let sensors = format!("file = \"{LIST}\"              # a row for each; metres, or degrees about the origin\n");
    let notes = imported.ignored.iter().map(|what| format!("ignored: {what}")).collect();
    Ok(NewField { area: Some(area + "\n"), sensors: Some(sensors), list: Some(list), notes })
}

/// The sensor list of the positions in the file `path`, translated by `shift` [m or °].
fn list(imported: &Imported, shift: [f64; 2], path: &Path) -> NewList {
    let locations = imported.sensors.iter().map(|sensor| sensor.place.clone()).collect();
    NewList { text: imported.to_csv(shift), locations, source: path.to_owned() }
}

/// The area from the origin to beyond the last position. The positions are translated to the origin if some are
/// negative, or if all are farther from it than their extent.
fn plane(imported: &Imported, path: &Path) -> (String, NewList) {
    let [low, high] = imported.bounds();
    let shift = [0, 1].map(|axis| {
        let is_far = low[axis] < 0.0 || low[axis] > (high[axis] - low[axis]).max(MARGIN_M);
        if is_far { MARGIN_M - low[axis] } else { 0.0 }
    });
    let [width_m, height_m] = [0, 1].map(|axis| (high[axis] + shift[axis] + MARGIN_M).ceil());
    let moved = if shift == [0.0; 2] {
        String::new()
    } else {
        format!("\n# Positions are translated by {} m and {} m.", shift[0], shift[1])
    };
    (
        format!("width_m = {width_m:?} # around the sensor nodes [m]\nheight_m = {height_m:?}{moved}"),
        list(imported, shift, path),
    )
}

/// The area north and east of a corner, in whose tangent plane all positions have positive coordinates.
fn geodetic(imported: &Imported, path: &Path) -> Result<(String, NewList), InputError> {
    let [low_lat_deg, low_lon_deg] = imported.south_west();
    let list = list(imported, [0.0; 2], path);
    let mut refused = None;
    for corner_m in CORNERS_M {
        let lat_deg = (low_lat_deg - corner_m / DEGREE_M).max(-90.0);
        let lon_deg = low_lon_deg - corner_m / DEGREE_M / low_lat_deg.to_radians().cos().max(0.01);
        let lon_deg = if lon_deg < -180.0 { lon_deg + 360.0 } else { lon_deg }; // west of the 180th meridian
        let origin =
            format!("origin_lat_deg = {lat_deg:.7} # of its south-west corner, WGS84\norigin_lon_deg = {lon_deg:.7}");
        let vast = format!("name = \"vast\"\n[area]\nside_m = {VAST_M:?}\n{origin}\n[sensors]\nfile = \"{LIST}\"\n");
        let found = Scenario::parse(&vast, path, Overrides::default()).and_then(|scenario| list.sensors(&scenario));
        match found {
            Ok(found) => {
                let last = |axis: fn(&skysink_common::sensors::Sensor) -> f64| {
                    (found.sensors().iter().map(axis).fold(0.0, f64::max) + MARGIN_M).ceil()
                };
                let [width_m, height_m] = [last(|sensor| sensor.position.x), last(|sensor| sensor.position.y)];
                let sides = format!("width_m = {width_m:?} # around the sensor nodes [m]\nheight_m = {height_m:?}");
                return Ok((format!("{sides}\n{origin}"), list));
            }
            Err(error) => refused = Some(error),
        }
    }
    Err(refused.expect("four corners were tried"))
}
