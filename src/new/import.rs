//! The field of imported positions and zones: the sensor list and an area around it, georeferenced for geodetic
//! positions.

use std::path::Path;

use skysink_common::error::InputError;
use skysink_common::geodata::projection::Projection;
use skysink_common::geodata::{Zone, ZoneKind, read_zones};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::Sensor;
use skysink_lab::import::{self, Frame, Imported, ImportedSensor, MapPicture};

use super::field::{LIST, NewField};

/// Margin between the sensor nodes and the border of the area [m].
const MARGIN_M: f64 = 10.0;

/// Approximate length of a degree of latitude [m].
const DEGREE_M: f64 = 111_000.0;

/// Side of an area that contains all positions for which the tangent plane is accurate [m].
const VAST_M: f64 = 1e6;

/// Distances of the corner of the area from the sensor nodes, tried in this order [m]. A small one can fail: on the
/// southern hemisphere, a point far to the east of the corner, on the same parallel, has y < 0 in the tangent plane.
const CORNERS_M: [f64; 4] = [MARGIN_M, 100.0, 1e3, 1e4];

/// Imports the positions, the zones and the map in these files; `None` without files. The map has a side of its pixels
/// [m].
///
/// # Errors
/// If a file is refused, zones in degrees are to lie among positions in metres, or positions in degrees on a map.
pub fn field(
    sensors: Option<&Path>,
    zones: Option<&Path>,
    map: Option<(&Path, f64)>,
) -> Result<Option<NewField>, InputError> {
    let imported = sensors.map(|path| Ok((import::read(path)?, path))).transpose()?;
    if let Some((map, cell_m)) = map {
        let mut field = imported.as_ref().map(|(imported, path)| on_plane(imported, path)).transpose()?;
        let field = field.get_or_insert_with(|| NewField { source: map.to_owned(), ..NewField::default() });
        add_map(field, &import::read_picture(map)?, cell_m)?;
        return Ok(Some(field.clone()));
    }
    let Some(path) = zones else { return imported.map(|(imported, path)| of_sensors(&imported, path)).transpose() };
    let zones = read_zones(path)?;
    if let Some((Imported { frame: Frame::Plane, .. }, sensors)) = &imported {
        let expected = "positions in metres: expected latitudes and longitudes, as the zones have";
        return Err(InputError::new("sensor positions", sensors, expected));
    }
    let mut field = imported.as_ref().map(|(imported, path)| of_sensors(imported, path)).transpose()?;
    // The area encloses the boundary, or without sensor nodes all zones.
    let has_boundary = zones.iter().any(|zone| zone.kind == ZoneKind::Boundary);
    let is_enclosed = |zone: &&Zone| {
        if has_boundary { zone.kind == ZoneKind::Boundary } else { imported.is_none() }
    };
    let corner =
        |zone: &Zone, position: [f64; 2]| ImportedSensor { place: zone.place.clone(), position, others: Vec::new() };
    let corners = zones.iter().filter(is_enclosed).flat_map(|zone| zone.corners.iter().map(|at| corner(zone, *at)));
    let positions = imported.iter().flat_map(|(imported, _)| &imported.sensors);
    let positions = positions.map(|sensor| ImportedSensor { others: Vec::new(), ..sensor.clone() });
    let extent = Imported {
        frame: Frame::Geodetic,
        sensors: positions.chain(corners).collect(),
        others: Vec::new(),
        ignored: Vec::new(),
    };
    let enclosing = of_sensors(&extent, path)?;
    let field = field.get_or_insert(NewField { list: None, ..enclosing.clone() });
    field.area = enclosing.area;
    add_zones(field, &zones, path)?;
    Ok(Some(field.clone()))
}

/// The field of positions in metres from the corner of a map, in the file `path`.
fn on_plane(imported: &Imported, path: &Path) -> Result<NewField, InputError> {
    if imported.frame != Frame::Plane {
        let expected = "positions in degrees: expected metres from the south-west corner of the map";
        return Err(InputError::new("sensor positions", path, expected));
    }
    Ok(NewField { list: Some(imported.to_csv([0.0; 2])), ..of_sensors(imported, path)? })
}

/// Adds the keys of a map with cells of this side [m].
fn add_map(field: &mut NewField, map: &MapPicture, cell_m: f64) -> Result<(), InputError> {
    let corners = |outline: &[[f64; 2]]| {
        let corners = outline.iter().map(|[x, y]| format!("[{}, {}]", x * cell_m, y * cell_m));
        format!("[{}]", corners.collect::<Vec<_>>().join(", "))
    };
    let [width_m, height_m] = [map.columns, map.rows].map(|count| f64::from(count) * cell_m);
    field.area = format!("width_m = {width_m:?} # of the map [m]\nheight_m = {height_m:?}");
    let [x_m, y_m] = map.start.map(|index| index * cell_m);
    field.uav = format!("start_m = [{x_m:?}, {y_m:?}]\n");
    for outline in &map.no_fly {
        field.zones += &format!("\n[[area.no_fly]]\npolygon_m = {}\n", corners(outline));
    }
    let height_m = Scenario::letter(Overrides::default())?.uav.altitude_m;
    for outline in &map.buildings {
        field.zones += &format!("\n[[area.building]]\npolygon_m = {}\nheight_m = {height_m:?}\n", corners(outline));
    }
    if !map.landing.is_empty() {
        let areas: Vec<String> = map.landing.iter().map(|outline| corners(outline)).collect();
        field.zones += &format!("\n[base]\nareas_m = [\n    {},\n]\n", areas.join(",\n    "));
    }
    Ok(())
}

/// Adds the keys of `zones`, of the file `path`, in the area of `field`.
fn add_zones(field: &mut NewField, zones: &[Zone], path: &Path) -> Result<(), InputError> {
    let text = format!("name = \"area\"\n[area]\n{}\n", field.area);
    let scenario = Scenario::parse(&text, path, Overrides::default())?;
    let projection = Projection::at(scenario.area.origin().expect("the area of degrees has an origin"));
    for zone in zones {
        let corners = zone.corners_m(&projection, path)?;
        match zone.kind {
            ZoneKind::Boundary => field.area += &format!("\nboundary_m = {corners:?}"),
            ZoneKind::NoFly => field.zones += &format!("\n[[area.no_fly]]\npolygon_m = {corners:?}\n"),
            ZoneKind::Building(height_m) => {
                field.zones += &format!("\n[[area.building]]\npolygon_m = {corners:?}\nheight_m = {height_m:?}\n");
            }
        }
    }
    Ok(())
}

/// The field of the positions in the file `path`.
fn of_sensors(imported: &Imported, path: &Path) -> Result<NewField, InputError> {
    let is_plane = imported.frame == Frame::Plane;
    let shift = if is_plane { shift(imported) } else { [0.0; 2] };
    let mut field = NewField {
        area: String::new(),
        list: Some(imported.to_csv(shift)),
        locations: imported.sensors.iter().map(|sensor| sensor.place.clone()).collect(),
        source: path.to_owned(),
        notes: imported.ignored.iter().map(|what| format!("ignored: {what}")).collect(),
        ..NewField::default()
    };
    field.area = if is_plane { plane(imported, shift) } else { geodetic(imported, &field)? };
    Ok(field)
}

/// The translation of positions in a plane [m]: to the origin if some are negative, or if all are farther from it than
/// their extent.
fn shift(imported: &Imported) -> [f64; 2] {
    let [low, high] = imported.bounds();
    [0, 1].map(|axis| {
        let is_far = low[axis] < 0.0 || low[axis] > (high[axis] - low[axis]).max(MARGIN_M);
        if is_far { MARGIN_M - low[axis] } else { 0.0 }
    })
}

/// The area from the origin to beyond the last position.
fn plane(imported: &Imported, shift: [f64; 2]) -> String {
    let [_, high] = imported.bounds();
    let moved = if shift == [0.0; 2] {
        String::new()
    } else {
        format!("\n# Positions are translated by {} m and {} m.", shift[0], shift[1])
    };
    sides([0, 1].map(|axis| high[axis] + shift[axis])) + &moved
}

/// The sides of an area that ends beyond these coordinates [m].
fn sides(last_m: [f64; 2]) -> String {
    let [width_m, height_m] = last_m.map(|coordinate_m| (coordinate_m + MARGIN_M).ceil());
    format!("width_m = {width_m:?} # around the sensor nodes [m]\nheight_m = {height_m:?}")
}

/// The area north and east of a corner, in whose tangent plane all positions have positive coordinates.
fn geodetic(imported: &Imported, field: &NewField) -> Result<String, InputError> {
    let [low_lat_deg, low_lon_deg] = imported.south_west();
    let mut refused = None;
    for corner_m in CORNERS_M {
        let lat_deg = (low_lat_deg - corner_m / DEGREE_M).max(-90.0);
        let lon_deg = low_lon_deg - corner_m / DEGREE_M / low_lat_deg.to_radians().cos().max(0.01);
        let lon_deg = if lon_deg < -180.0 { lon_deg + 360.0 } else { lon_deg }; // west of the 180th meridian
        let origin =
            format!("origin_lat_deg = {lat_deg:.7} # of its south-west corner, WGS84\norigin_lon_deg = {lon_deg:.7}");
        let vast = format!("name = \"vast\"\n[area]\nside_m = {VAST_M:?}\n{origin}\n[sensors]\nfile = \"{LIST}\"\n");
        let vast = Scenario::parse(&vast, &field.source, Overrides::default());
        match vast.and_then(|scenario| field.sensors(&scenario)) {
            Ok(found) => {
                let last_m = |axis: fn(&Sensor) -> f64| found.sensors().iter().map(axis).fold(0.0, f64::max);
                let sides = sides([last_m(|sensor| sensor.position.x), last_m(|sensor| sensor.position.y)]);
                return Ok(format!("{sides}\n{origin}"));
            }
            Err(error) => refused = Some(error),
        }
    }
    Err(refused.expect("four corners were tried"))
}
