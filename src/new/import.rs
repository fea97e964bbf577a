//! The field of imported positions and zones: the sensor list and an area around it.
//!
//! What is in degrees is left to `degrees`.

use std::collections::HashMap;
use std::path::Path;

use skysink_common::error::InputError;
use skysink_common::geodata::plausible::{FieldPlaces, may_be_degrees};
use skysink_common::geodata::{ReferenceSystem, read_zones};
use skysink_common::geometry::Position;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_lab::import::{self, Frame, Imported};

use super::additions::Additions;
use super::degrees::of_degrees;
use super::field::NewField;
use super::log::{LoggedFlight, TRACK_LINE};
use super::presets::Lines;
use super::terrain::Terrain;

/// Margin between the sensor nodes and the border of the area [m].
pub(super) const MARGIN_M: f64 = 10.0;

/// What a new scenario is made from.
pub struct Sources<'a> {
    pub sensors: Option<&'a Path>,
    pub zones: Option<&'a Path>,
    /// Where the UAV starts, in the coordinates of the positions.
    pub start: Option<[f64; 2]>,
    /// `d_c` of the radio [m].
    pub comm_radius_m: f64,
    /// The flight log, whose flight the area encloses.
    pub log: Option<LoggedFlight>,
    pub terrain: Option<Terrain<'a>>,
}

impl Sources<'_> {
    /// Imports the positions and the zones; `None` without any, and without a start.
    ///
    /// # Errors
    /// If a file is refused, zones in degrees are to lie among positions in metres, or if the start lies in a zone.
    pub fn field(&self) -> Result<Option<NewField>, InputError> {
        let logged = self.log.as_ref().map(LoggedFlight::sensors);
        let read = |path| {
            let mut imported = import::read(path)?;
            if let Some(terrain) = &self.terrain {
                terrain.add_ground(&mut imported, path)?;
            }
            if self.log.as_ref().is_some_and(|log| log.frame() != imported.frame) {
                let expected = "expected positions as in the flight log, all in metres or all in degrees";
                return Err(InputError::new("sensor positions", path, expected));
            }
            Ok((imported, path))
        };
        let imported = self.sensors.or(logged.as_deref()).map(read).transpose()?;
        let uav = self.start.map(|start_m| format!("start_m = {start_m:?}\n"));
        let zones = self.zones.map(|path| Ok((read_zones(path)?, path))).transpose()?;
        match (imported, zones) {
            (None, None) => Ok(uav.map(|uav| NewField { uav, ..NewField::default() })),
            (Some((imported, path)), None) if imported.frame == Frame::Plane => {
                of_plane(&imported, path, self).map(Some)
            }
            (Some((Imported { frame: Frame::Plane, .. }, path)), Some(_)) => {
                let expected = "positions in metres: expected latitudes and longitudes, as the zones have";
                Err(InputError::new("sensor positions", path, expected))
            }
            (imported, zones) => {
                let imported = imported.as_ref().map(|(imported, path)| (imported, *path));
                of_degrees(imported, zones, self).map(Some)
            }
        }
    }

    /// What the log or the terrain adds to the `draft`.
    pub fn additions(
        &self,
        field: Option<&mut NewField>,
        draft: &Scenario,
        list: &SensorList,
        lines: &mut Lines,
    ) -> Result<Additions, InputError> {
        let Some(field) = field else { return Ok(Additions::default()) };
        let additions = match (&self.log, &self.terrain) {
            (Some(log), _) => {
                TRACK_LINE.clone_into(&mut field.uav);
                log.additions(draft, list, field.shift, lines)?
            }
            (None, Some(terrain)) => terrain.additions(draft, list, field.shift, lines)?,
            (None, None) => return Ok(Additions::default()),
        };
        field.zones += &additions.zones;
        Ok(additions)
    }
}

/// The line of a start.
pub(super) fn start_line(at: &Position, comment: &str) -> String {
    let [x_m, y_m] = [at.x, at.y].map(|along_m| (along_m * 1e3).round() / 1e3);
    format!("start_m = [{x_m:?}, {y_m:?}]{comment}\n")
}

/// The list of the positions in the file `path`.
pub(super) fn of_sensors(imported: &Imported, path: &Path, flown: &[[f64; 2]]) -> NewField {
    let shift = if imported.frame == Frame::Plane { shift(imported, flown) } else { [0.0; 2] };
    NewField {
        shift,
        list: Some(imported.to_csv(shift)),
        locations: imported.sensors.iter().map(|sensor| sensor.place.clone()).collect(),
        source: path.to_owned(),
        notes: imported.ignored.iter().map(|what| format!("ignored: {what}")).collect(),
        warnings: doubted_system("sensor positions", path, imported.frame == Frame::Plane)
            .into_iter()
            .chain(repeated(imported, path))
            .collect(),
        ..NewField::default()
    }
}

/// The sensor nodes that stand exactly where an earlier one stands.
fn repeated(imported: &Imported, path: &Path) -> Option<String> {
    let mut places: HashMap<[u64; 2], &str> = HashMap::new();
    let mut repeated = imported.sensors.iter().filter_map(|sensor| {
        let first = *places.entry(sensor.position.map(f64::to_bits)).or_insert(&sensor.place);
        (first != sensor.place).then_some((&sensor.place, first))
    });
    let (place, first) = repeated.next()?;
    let others = match repeated.count() {
        0 => String::new(),
        1 => ", and 1 more does so".to_owned(),
        others => format!(", and {others} more do so"),
    };
    Some(format!(
        "sensor positions {}: {place}: it stands where {first} stands{others}: are they repeated?",
        path.display()
    ))
}

/// Refuses lengths that the file `.prj` beside positions says are not metres on the ground.
fn check_metres(path: &Path) -> Result<(), InputError> {
    let Some(system) = ReferenceSystem::beside(path) else { return Ok(()) };
    let Some(why) = &system.no_metres else { return Ok(()) };
    let expected = "expected metres on the ground, such as those of UTM, or latitudes and longitudes (or this .prj belongs to \
                    another file: move it away)";
    Err(InputError::new("sensor positions", path, format_args!("{system}: {why}: {expected}")))
}

/// The field of positions in metres, in the file `path`.
fn of_plane(imported: &Imported, path: &Path, sources: &Sources<'_>) -> Result<NewField, InputError> {
    let Sources { start, comm_radius_m, .. } = *sources;
    check_metres(path)?;
    let flown = sources.log.as_ref().map(LoggedFlight::positions).unwrap_or_default();
    let mut field = of_sensors(imported, path, &flown);
    let shift = field.shift;
    let in_area = |position: [f64; 2]| Position::new(position[0] + shift[0], position[1] + shift[1]);
    let nodes: Vec<Position> = imported.sensors.iter().map(|sensor| in_area(sensor.position)).collect();
    let start = start.map(in_area);
    let flown = flown.into_iter().map(in_area);
    let last_m = nodes.iter().copied().chain(start).chain(flown).fold(Position::origin(), |last, at| last.sup(&at));
    let sides_m = [last_m.x, last_m.y].map(beyond);
    field.area = sides(sides_m);
    if shift != [0.0; 2] {
        field.area += &format!("\n# Positions are translated by {} m and {} m.", shift[0], shift[1]);
    }
    if let Some(at) = start {
        if at.x < 0.0 || at.y < 0.0 {
            let expected = "expected a place north and east of the origin of the positions";
            return Err(InputError::of_argument(
                "option",
                "--start",
                format_args!("{} m, {} m: {expected}", at.x, at.y),
            ));
        }
        field.uav = start_line(&at, "");
    }
    let node_name = |node: usize| format!("sensor positions {}: {}", path.display(), imported.sensors[node].place);
    let places =
        FieldPlaces { sides_m, origin: None, nodes: &nodes, node_name: &node_name, polygons: &[], comm_radius_m };
    field.warnings.extend(places.doubts());
    if let [sensor] = &imported.sensors[..]
        && may_be_degrees(&sensor.position)
    {
        let [x, y] = sensor.position;
        let taken = format!("{x}, {y}: taken as metres: if they are degrees, name the columns lat and lon");
        field.warnings.push(format!("{}: {taken}", node_name(0)));
    }
    Ok(field)
}

/// What a file `.prj` beside positions in metres or degrees says against them.
pub(super) fn doubted_system(what: &str, path: &Path, is_plane: bool) -> Option<String> {
    let system = ReferenceSystem::beside(path)?;
    let taken = match (is_plane, system.is_projected) {
        (true, true) => {
            "its metres are taken as those of a plane without latitude and longitude; its north is up to 3° beside true \
             north: for flights outdoors convert them to lat and lon"
        }
        (true, false) => "are its metres degrees?",
        (false, _) if system.is_wgs84 => return None,
        (false, _) => "its degrees are taken as those of WGS84",
    };
    Some(format!("{what} {}: {system}: {taken}", path.display()))
}

/// The translation of positions in a plane [m]: to the origin if some are negative, or if all are farther from it than
/// their extent. Positions that were `flown` over count, too.
fn shift(imported: &Imported, flown: &[[f64; 2]]) -> [f64; 2] {
    let [mut low, mut high] = imported.bounds();
    for axis in 0..2 {
        low[axis] = flown.iter().map(|position| position[axis]).fold(low[axis], f64::min);
        high[axis] = flown.iter().map(|position| position[axis]).fold(high[axis], f64::max);
    }
    [0, 1].map(|axis| {
        let is_far = low[axis] < 0.0 || low[axis] > (high[axis] - low[axis]).max(MARGIN_M);
        if is_far { MARGIN_M - low[axis] } else { 0.0 }
    })
}

/// A side that ends beyond this coordinate [m].
pub(super) fn beyond(coordinate_m: f64) -> f64 {
    (coordinate_m + MARGIN_M).ceil()
}

/// The keys of the sides of an area [m].
pub(super) fn sides([width_m, height_m]: [f64; 2]) -> String {
    format!("width_m = {width_m:?} # around the sensor nodes [m]\nheight_m = {height_m:?}")
}
