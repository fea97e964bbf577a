//! The field of imported positions and zones: the sensor list and an area around it.
//!
//! What is in degrees is left to `degrees`.

use std::collections::HashMap;
use std::path::Path;

use skysink_common::error::InputError;
use skysink_common::geodata::plausible::{FieldPlaces, may_be_degrees};
use skysink_common::geodata::{Coordinates, ReferenceSystem, Zones, read_zones};
use skysink_common::geometry::Position;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_lab::import::{self, Frame, Imported};

use super::additions::Additions;
use super::area::{MARGIN_M, beyond, sides};
use super::degrees::of_degrees;
use super::field::NewField;
use super::plan::PlannedFlight;
use super::presets::Lines;

/// What a new scenario is made from.
pub struct Sources<'a> {
    pub sensors: Option<&'a Path>,
    pub zones: Option<&'a Path>,
    /// Where the UAV starts, in the coordinates of the positions.
    pub start: Option<[f64; 2]>,
    /// The system of positions that are not in degrees, in files that do not name theirs.
    pub crs: Option<ReferenceSystem>,
    /// The plan, whose flight the area encloses.
    pub plan: Option<PlannedFlight<'a>>,
    /// `d_c` of the radio [m].
    pub comm_radius_m: f64,
}

impl Sources<'_> {
    /// Imports the positions and the zones; `None` without any, and without a start.
    ///
    /// # Errors
    /// If a file is refused, zones in degrees are to lie among positions in metres, no file is in the system of the
    /// option, or if the start lies in a zone.
    pub fn field(&self) -> Result<Option<NewField>, InputError> {
        let read = |path| Ok::<_, InputError>((import::read(path, self.crs.as_ref())?, path));
        let imported = self.sensors.map(read).transpose()?;
        let uav = self.start.map(|start_m| format!("start_m = {start_m:?}\n"));
        let zones = match &self.plan {
            Some(plan) => Some((plan.fence(), plan.path())),
            None => self.zones.map(|path| Ok((read_zones(path, self.crs.as_ref())?, path))).transpose()?,
        };
        let list = imported.as_ref().map(|(imported, _)| imported);
        let start = self.start_within(list, zones.as_ref().map(|(zones, _)| zones))?;
        match (imported, zones) {
            (None, None) => Ok(uav.map(|uav| NewField { uav, ..NewField::default() })),
            (Some((imported, path)), None) if imported.frame == Frame::Plane => {
                of_plane(&imported, path, self).map(Some)
            }
            (Some((Imported { frame: Frame::Plane, .. }, path)), Some(_)) => {
                let other = if self.plan.is_some() { "the plan has" } else { "the zones have" };
                let map = "the reference system of their map, such as --crs EPSG:25832";
                let expected = format!("positions in metres: expected latitudes and longitudes, as {other}, or {map}");
                Err(InputError::new("sensor positions", path, expected))
            }
            (imported, zones) => {
                let imported = imported.as_ref().map(|(imported, path)| (imported, *path));
                of_degrees(imported, zones, start, self).map(Some)
            }
        }
    }

    /// The start in the frame of the positions, which is latitude and longitude if they were converted to it.
    fn start_within(&self, imported: Option<&Imported>, zones: Option<&Zones>) -> Result<Option<[f64; 2]>, InputError> {
        let refuse = |option, message: &str| InputError::of_argument("option", option, message);
        let of_list = imported.and_then(|imported| imported.system.as_ref());
        let of_zones = zones.and_then(|zones| zones.system.as_ref());
        if let Some(crs) = self.crs.as_ref().filter(|crs| !crs.is_wgs84())
            && [of_list, of_zones].into_iter().flatten().all(|system| system != crs)
        {
            let expected = "expected sensor positions in columns x and y, or zones, in this system";
            return Err(refuse("--crs", &format!("{crs}: no file is in it: {expected}")));
        }
        let system = if imported.is_some() { of_list } else { of_zones };
        let (Some(start), Some(on_earth)) = (self.start, system.and_then(ReferenceSystem::on_earth)) else {
            return Ok(self.start);
        };
        let along = if on_earth.is_in_degrees() { [start[1], start[0]] } else { start };
        let read = on_earth.to_geodetic(along);
        read.map(Some).map_err(|message| refuse("--start", &message))
    }

    /// What the plan adds to the `draft`.
    pub fn additions(
        &self,
        field: Option<&mut NewField>,
        draft: &Scenario,
        list: &SensorList,
        lines: &mut Lines,
    ) -> Result<Additions, InputError> {
        let Some(field) = field else { return Ok(Additions::default()) };
        if let Some(plan) = &self.plan {
            return plan.additions(draft, list, lines, &mut field.uav);
        }
        Ok(Additions::default())
    }
}

/// The line of a start.
pub(super) fn start_line(at: &Position, comment: &str) -> String {
    let [x_m, y_m] = [at.x, at.y].map(|along_m| (along_m * 1e3).round() / 1e3);
    format!("start_m = [{x_m:?}, {y_m:?}]{comment}\n")
}

/// The list of the positions in the file `path`.
pub(super) fn of_sensors(imported: &Imported, path: &Path) -> NewField {
    let shift = if imported.frame == Frame::Plane { shift(imported) } else { [0.0; 2] };
    NewField {
        list: Some(imported.to_csv(shift)),
        locations: imported.sensors.iter().map(|sensor| sensor.place.clone()).collect(),
        source: path.to_owned(),
        notes: (imported.system.iter())
            .map(|system| format!("sensor positions {}: {}", path.display(), system.note()))
            .chain(imported.ignored.iter().map(|what| format!("ignored: {what}")))
            .collect(),
        warnings: doubted_system("sensor positions", path, imported.frame == Frame::Plane, imported.system.as_ref())
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

/// The field of positions in metres, in the file `path`.
fn of_plane(imported: &Imported, path: &Path, sources: &Sources<'_>) -> Result<NewField, InputError> {
    let Sources { start, comm_radius_m, .. } = *sources;
    let mut field = of_sensors(imported, path);
    let shift = shift(imported);
    let in_area = |position: [f64; 2]| Position::new(position[0] + shift[0], position[1] + shift[1]);
    let nodes: Vec<Position> = imported.sensors.iter().map(|sensor| in_area(sensor.position)).collect();
    let start = start.map(in_area);
    let last_m = nodes.iter().copied().chain(start).fold(Position::origin(), |last, at| last.sup(&at));
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
    let ground_m = &imported.ground_m();
    let places = FieldPlaces {
        sides_m,
        origin: None,
        nodes: &nodes,
        ground_m,
        node_name: &node_name,
        polygons: &[],
        comm_radius_m,
    };
    field.warnings.extend(places.doubts());
    field.warnings.extend(map_grid(imported, path));
    if let [sensor] = &imported.sensors[..]
        && may_be_degrees(&sensor.position)
    {
        let [x, y] = sensor.position;
        let taken = format!("{x}, {y}: taken as metres: if they are degrees, name the columns lat and lon");
        field.warnings.push(format!("{}: {taken}", node_name(0)));
    }
    Ok(field)
}

/// Least coordinates of positions in metres [m] that are probably those of a map.
const LEAST_MAP_M: f64 = 10e3;

/// Metres that are probably those of a map, whose system is not known.
fn map_grid(imported: &Imported, path: &Path) -> Option<String> {
    let [low, _] = imported.bounds();
    let is_map = low.iter().all(|along_m| along_m.abs() > LEAST_MAP_M);
    let map = "their metres are probably those of a map, whose north is up to 5° beside true north";
    let remedy = "name its system, such as --crs EPSG:25832, to get latitudes and longitudes";
    is_map.then(|| format!("sensor positions {}: {map}: {remedy}", path.display()))
}

/// What a file `.prj` says against positions in metres, or in degrees that were not read in a `system`.
pub(super) fn doubted_system(
    what: &str,
    path: &Path,
    is_plane: bool,
    system: Option<&ReferenceSystem>,
) -> Option<String> {
    let beside = ReferenceSystem::beside(path).filter(|beside| system.is_none() && !beside.is_wgs84())?;
    let taken = match (is_plane, &beside.coordinates) {
        (true, Coordinates::Local(_)) => "its metres are taken as those of a plane without latitude and longitude",
        (true, _) => return None,
        (false, _) => "its degrees are taken as those of WGS84",
    };
    Some(format!("{what} {}: {beside}: {taken}", path.display()))
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
