//! The field of imported positions and zones: the sensor list and an area around it, georeferenced for geodetic
//! positions.

use std::path::Path;

use skysink_common::airspace::{Airspace, Polygon};
use skysink_common::error::InputError;
use skysink_common::geodata::plausible::{FieldPlaces, NamedPolygon, PolygonRole, distance};
use skysink_common::geodata::projection::Projection;
use skysink_common::geodata::{Zone, ZoneKind, Zones, read_zones};
use skysink_common::geometry::Position;
use skysink_common::scenario::{LEAST_FILLED, Origin, Overrides, Scenario};
use skysink_lab::import::{self, Frame, Imported, MapPicture};

use super::field::NewField;

/// Margin between the sensor nodes and the border of the area [m].
const MARGIN_M: f64 = 10.0;

/// Approximate length of a degree of latitude [m].
const DEGREE_M: f64 = 111_000.0;

/// Side of an area that contains all positions for which the tangent plane is accurate [m].
const VAST_M: f64 = 1e6;

/// Distances of the corner of the area from the sensor nodes, tried in this order [m]. A small one can fail: on the
/// southern hemisphere, a point far to the east of the corner, on the same parallel, has y < 0 in the tangent plane.
const CORNERS_M: [f64; 4] = [MARGIN_M, 100.0, 1e3, 1e4];

/// Places along each side of the area among which a free start is searched.
const START_PLACES: u32 = 100;

/// Distance [m] from which on a boundary is not that of the sensor nodes.
const FAR_M: f64 = 1e3;

/// The files of a new scenario.
pub struct Sources<'a> {
    /// The file of positions.
    pub sensors: Option<&'a Path>,
    /// The file of zones.
    pub zones: Option<&'a Path>,
    /// The map, with the side of its pixels [m].
    pub map: Option<(&'a Path, f64)>,
    /// Where the UAV starts, in the coordinates of the positions.
    pub start: Option<[f64; 2]>,
}

/// A position with its origin.
struct SourcePosition<'a> {
    what: &'static str,
    path: &'a Path,
    place: &'a str,
    /// Latitude and longitude [°].
    position: [f64; 2],
}

impl SourcePosition<'_> {
    fn refusal(&self, message: &str) -> InputError {
        InputError::new(self.what, self.path, format_args!("{}: {message}", self.place))
    }
}

/// Imports the positions, the zones and the map of these files; `None` without any, and without a start.
///
/// # Errors
/// If a file is refused, zones in degrees are to lie among positions in metres, positions in degrees on a map, or if the
/// start lies in a zone.
pub fn field(sources: &Sources<'_>) -> Result<Option<NewField>, InputError> {
    let imported = sources.sensors.map(|path| Ok((import::read(path)?, path))).transpose()?;
    let uav = sources.start.map(|start_m| format!("start_m = {start_m:?}\n"));
    if let Some((map, cell_m)) = sources.map {
        let mut field = imported.as_ref().map(|(imported, path)| on_plane(imported, path)).transpose()?;
        let field = field.get_or_insert_with(|| NewField { source: map.to_owned(), ..NewField::default() });
        add_map(field, &import::read_picture(map)?, cell_m)?;
        field.uav = uav.unwrap_or_else(|| field.uav.clone());
        return Ok(Some(field.clone()));
    }
    let zones = sources.zones.map(|path| Ok((read_zones(path)?, path))).transpose()?;
    match (imported, zones) {
        (None, None) => Ok(uav.map(|uav| NewField { uav, ..NewField::default() })),
        (Some((imported, path)), None) if imported.frame == Frame::Plane => {
            of_plane(&imported, path, sources.start).map(Some)
        }
        (Some((Imported { frame: Frame::Plane, .. }, path)), Some(_)) => {
            let expected = "positions in metres: expected latitudes and longitudes, as the zones have";
            Err(InputError::new("sensor positions", path, expected))
        }
        (imported, zones) => {
            let imported = imported.as_ref().map(|(imported, path)| (imported, *path));
            of_degrees(imported, zones, sources.start).map(Some)
        }
    }
}

/// The field of positions in metres from the corner of a map, in the file `path`.
fn on_plane(imported: &Imported, path: &Path) -> Result<NewField, InputError> {
    if imported.frame != Frame::Plane {
        let expected = "positions in degrees: expected metres from the south-west corner of the map";
        return Err(InputError::new("sensor positions", path, expected));
    }
    Ok(NewField { list: Some(imported.to_csv([0.0; 2])), ..of_sensors(imported, path) })
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

/// The field of positions in degrees and of zones.
fn of_degrees(
    imported: Option<(&Imported, &Path)>,
    zones: Option<(Zones, &Path)>,
    start: Option<[f64; 2]>,
) -> Result<NewField, InputError> {
    let mut field = imported.map_or_else(NewField::default, |(imported, path)| of_sensors(imported, path));
    let nodes: Vec<SourcePosition> = imported.iter().flat_map(|(imported, path)| positions(imported, path)).collect();
    let (mut zones, zones_path) = zones.unwrap_or((Zones { zones: Vec::new(), ignored: None }, Path::new("")));
    field.notes.extend(zones.ignored.take().map(|what| format!("ignored in {}: {what}", zones_path.display())));
    field.notes.extend(find_boundary(&mut zones.zones, &nodes, zones_path)?);

    // The area encloses the sensor nodes, the start and the boundary, or without sensor nodes all zones.
    let has_boundary = zones.zones.iter().any(|zone| zone.kind == ZoneKind::Boundary);
    let is_enclosed = |zone: &&Zone| if has_boundary { zone.kind == ZoneKind::Boundary } else { nodes.is_empty() };
    let corner = |zone: &Zone, position| (zone.place.clone(), position);
    let corners =
        zones.zones.iter().filter(is_enclosed).flat_map(|zone| zone.corners.iter().map(|at| corner(zone, *at)));
    let corners: Vec<(String, [f64; 2])> = corners.collect();
    let corners = corners.iter().map(|(place, position)| SourcePosition {
        what: "zones",
        path: zones_path,
        place,
        position: *position,
    });
    let own_start = start.map(|position| (format!("{},{}", position[0], position[1]), position));
    let own_start = own_start.as_ref().map(|(place, position)| SourcePosition {
        what: "option",
        path: Path::new("--start"),
        place,
        position: *position,
    });
    let count = nodes.len();
    let mut enclosed: Vec<SourcePosition> = nodes;
    enclosed.extend(corners);
    enclosed.extend(own_start);
    let area = GeodeticArea::around(&enclosed)?;
    let nodes_m = &area.positions[..count];
    field.area = area.keys();

    let mut polygons = Vec::with_capacity(zones.zones.len());
    let mut closed = Vec::with_capacity(zones.zones.len());
    let lowest_m = Scenario::letter(Overrides::default())?.uav.altitude_m;
    for zone in &zones.zones {
        let corners_m = zone.corners_m(&area.projection(), zones_path)?;
        let polygon = Polygon::of(&corners_m, zone.kind == ZoneKind::Boundary).expect("its corners were checked");
        let (role, height_m) = match zone.kind {
            ZoneKind::NoFly => (PolygonRole::NoFly, f64::INFINITY),
            ZoneKind::Boundary => (PolygonRole::Boundary, f64::INFINITY),
            ZoneKind::Building(height_m) => (PolygonRole::Building, height_m),
            ZoneKind::BuildingAboveSea(altitude_m) => {
                let ground = imported.and_then(|(imported, _)| ground_at(imported, nodes_m, &polygon));
                let expected = "expected the altitude of the ground of each sensor node (ground_m) to measure it \
                                against, altitudeMode relativeToGround, or height_m";
                let above = format!("{altitude_m} m above sea level");
                let ground_m = ground.ok_or_else(|| zone.refusal(zones_path, &format!("{above}: {expected}")))?;
                if altitude_m <= ground_m {
                    let expected = format!("expected more than {ground_m}, the ground at the nearest sensor node");
                    return Err(zone.refusal(zones_path, &format!("{above}: {expected}")));
                }
                (PolygonRole::Building, altitude_m - ground_m)
            }
        };
        match role {
            PolygonRole::Boundary if polygon.filled() < LEAST_FILLED => {
                let expected = "expected a boundary that fills at least a hundredth of its extent";
                return Err(zone.refusal(zones_path, expected));
            }
            PolygonRole::Boundary if distance_to(&polygon, nodes_m) > FAR_M => {
                let far = distance(distance_to(&polygon, nodes_m));
                let expected = format!("it lies {far} from the nearest sensor node: expected a boundary around them");
                return Err(zone.refusal(zones_path, &expected));
            }
            PolygonRole::Boundary => field.area += &format!("\nboundary_m = {corners_m:?}"),
            PolygonRole::NoFly => field.zones += &format!("\n[[area.no_fly]]\npolygon_m = {corners_m:?}\n"),
            PolygonRole::Building => {
                field.zones += &format!("\n[[area.building]]\npolygon_m = {corners_m:?}\nheight_m = {height_m:?}\n");
            }
        }
        polygons.push(NamedPolygon { name: zone.name(zones_path), role, corners_m });
        closed.push((polygon, height_m));
    }
    let node_name = |node: usize| enclosed[node].refusal("").to_string().trim_end_matches(": ").to_owned();
    let places = FieldPlaces {
        sides_m: area.sides_m,
        origin: Some(area.origin),
        nodes: nodes_m,
        node_name: &node_name,
        polygons: &polygons,
    };
    field.warnings = places.doubts();
    let border = closed.iter().find(|(polygon, _)| polygon.is_border()).map(|(polygon, _)| polygon.extent());
    let airspace = Airspace::new(area.sides_m, lowest_m, closed.into_iter());
    let middle = Position::from(area.sides_m.map(|side_m| side_m / 2.0));
    if start.is_some() {
        let at = area.positions[area.positions.len() - 1];
        if !airspace.contains(&at) {
            let expected = "expected a place outside of zones and buildings, within the boundary";
            return Err(enclosed[enclosed.len() - 1].refusal(expected));
        }
        field.uav = start_line(&at, "");
    } else if !airspace.contains(&middle) {
        let extent = border.unwrap_or([Position::origin(), Position::from(area.sides_m)]);
        let free = free_place(&airspace, &middle, extent);
        let refuse = || {
            let causes: Vec<String> = field.warnings.iter().map(|warning| format!("; {warning}")).collect();
            let message = format!("they leave no free place to start from in the area{}", causes.concat());
            InputError::new("zones", zones_path, message)
        };
        let free = free.ok_or_else(refuse)?;
        field.uav = start_line(&free, " # the free place nearest to the middle of the area");
    }
    Ok(field)
}

/// The distance of the nearest sensor node from a boundary [m]; 0 if one lies in it, or without sensor nodes.
fn distance_to(boundary: &Polygon, nodes_m: &[Position]) -> f64 {
    let away_m = |node: &Position| if boundary.encloses(node) { 0.0 } else { (boundary.nearest(node) - node).norm() };
    nodes_m.iter().map(away_m).reduce(f64::min).unwrap_or(0.0)
}

/// The line of a start.
fn start_line(at: &Position, comment: &str) -> String {
    let [x_m, y_m] = [at.x, at.y].map(|along_m| (along_m * 1e3).round() / 1e3);
    format!("start_m = [{x_m:?}, {y_m:?}]{comment}\n")
}

/// The positions of a file with their locations.
fn positions<'a>(imported: &'a Imported, path: &'a Path) -> impl Iterator<Item = SourcePosition<'a>> {
    imported.sensors.iter().map(move |sensor| SourcePosition {
        what: "sensor positions",
        path,
        place: &sensor.place,
        position: sensor.position,
    })
}

/// Takes the zone around all sensor nodes as the boundary, if no zone is marked as such, nor this one as a no-fly zone.
/// Returns a note about it.
fn find_boundary(zones: &mut [Zone], nodes: &[SourcePosition<'_>], path: &Path) -> Result<Option<String>, InputError> {
    let Some(first) = nodes.first() else { return Ok(None) };
    let [lat_deg, lon_deg] = first.position;
    let projection = Projection::at(Origin { lat_deg, lon_deg });
    let nodes_m = nodes.iter().map(|node| projection.project(node.position[0], node.position[1]));
    let Some(nodes_m) = nodes_m.collect::<Option<Vec<Position>>>() else { return Ok(None) };
    let mut around = Vec::new();
    for (index, zone) in zones.iter().enumerate().filter(|(_, zone)| zone.kind == ZoneKind::NoFly && !zone.is_marked) {
        let corners_m = zone.corners_m(&projection, path)?;
        let polygon = Polygon::of(&corners_m, false).expect("its corners were checked");
        if nodes_m.iter().all(|node| polygon.encloses(node)) {
            around.push(index);
        }
    }
    let boundary = zones.iter().position(|zone| zone.kind == ZoneKind::Boundary);
    let mut all = boundary.into_iter().chain(around);
    match [all.next(), all.next()] {
        [Some(first), Some(second)] => {
            let first = &zones[first].place;
            let expected =
                format!("around all sensor nodes, beside {first}: expected one boundary, and zones within it");
            Err(zones[second].refusal(path, &expected))
        }
        [Some(index), None] if boundary.is_none() => {
            zones[index].kind = ZoneKind::Boundary;
            let name = zones[index].name(path);
            Ok(Some(format!("{name}: taken as the boundary of the area, as it encloses all sensor nodes")))
        }
        _ => Ok(None),
    }
}

/// The altitude of the ground [m] at the sensor node that is nearest to a polygon; `None` if the list has none.
fn ground_at(imported: &Imported, nodes_m: &[Position], polygon: &Polygon) -> Option<f64> {
    let column = imported.others.iter().position(|name| *name == import::GROUND)?;
    let away_m = |node: &Position| {
        if polygon.encloses(node) { 0.0 } else { (polygon.nearest(node) - node).norm() }
    };
    let nodes = nodes_m.iter().zip(&imported.sensors);
    let (_, nearest) = nodes.min_by(|(a, _), (b, _)| away_m(a).total_cmp(&away_m(b)))?;
    nearest.others[column].parse().ok()
}

/// The free place nearest to the middle of an area, of a grid between two corners.
fn free_place(airspace: &Airspace, middle: &Position, [low, high]: [Position; 2]) -> Option<Position> {
    let steps_m = (high - low) / f64::from(START_PLACES);
    let column = |x: u32| (1..START_PLACES).map(move |y| [x, y].map(f64::from));
    let place = |[x, y]: [f64; 2]| Position::new(low.x + x * steps_m.x, low.y + y * steps_m.y);
    let mut places: Vec<Position> = (1..START_PLACES).flat_map(column).map(place).collect();
    let away_m = |at: &Position| (at - middle).norm();
    places.sort_by(|a, b| away_m(a).total_cmp(&away_m(b)));
    // With free ground around it, so that it lies on no edge.
    let is_free = |at: &Position| {
        let beside = [[0.4, 0.0], [-0.4, 0.0], [0.0, 0.4], [0.0, -0.4]];
        let mut beside = beside.map(|[x, y]| Position::new(at.x + x * steps_m.x, at.y + y * steps_m.y)).into_iter();
        airspace.contains(at) && beside.all(|at| airspace.contains(&at))
    };
    places.into_iter().find(is_free)
}

/// The list of the positions in the file `path`.
fn of_sensors(imported: &Imported, path: &Path) -> NewField {
    let shift = if imported.frame == Frame::Plane { shift(imported) } else { [0.0; 2] };
    NewField {
        list: Some(imported.to_csv(shift)),
        locations: imported.sensors.iter().map(|sensor| sensor.place.clone()).collect(),
        source: path.to_owned(),
        notes: imported.ignored.iter().map(|what| format!("ignored: {what}")).collect(),
        ..NewField::default()
    }
}

/// The field of positions in metres, in the file `path`.
fn of_plane(imported: &Imported, path: &Path, start: Option<[f64; 2]>) -> Result<NewField, InputError> {
    let mut field = of_sensors(imported, path);
    let shift = shift(imported);
    let in_area = |position: [f64; 2]| Position::new(position[0] + shift[0], position[1] + shift[1]);
    let nodes: Vec<Position> = imported.sensors.iter().map(|sensor| in_area(sensor.position)).collect();
    let start = start.map(in_area);
    let last_m = nodes.iter().chain(&start).fold(Position::origin(), |last, at| last.sup(at));
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
    let places = FieldPlaces { sides_m, origin: None, nodes: &nodes, node_name: &node_name, polygons: &[] };
    field.warnings = places.doubts();
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

/// A side that ends beyond this coordinate [m].
fn beyond(coordinate_m: f64) -> f64 {
    (coordinate_m + MARGIN_M).ceil()
}

/// The keys of the sides of an area [m].
fn sides([width_m, height_m]: [f64; 2]) -> String {
    format!("width_m = {width_m:?} # around the sensor nodes [m]\nheight_m = {height_m:?}")
}

/// An area in degrees.
struct GeodeticArea {
    /// Its south-west corner.
    origin: Origin,
    /// Its sides [m].
    sides_m: [f64; 2],
    /// The positions in it [m].
    positions: Vec<Position>,
}

impl GeodeticArea {
    /// The area north and east of a corner, in whose tangent plane all positions have positive coordinates.
    fn around(places: &[SourcePosition<'_>]) -> Result<Self, InputError> {
        let positions: Vec<[f64; 2]> = places.iter().map(|place| place.position).collect();
        let [low_lat_deg, low_lon_deg] = import::south_west(&positions);
        for corner_m in CORNERS_M {
            let lat_deg = (low_lat_deg - corner_m / DEGREE_M).max(-90.0);
            let lon_deg = low_lon_deg - corner_m / DEGREE_M / low_lat_deg.to_radians().cos().max(0.01);
            let lon_deg = if lon_deg < -180.0 { lon_deg + 360.0 } else { lon_deg }; // west of the 180th meridian
            let [lat_deg, lon_deg] = [lat_deg, lon_deg].map(|deg| (deg * 1e7).round() / 1e7);
            let origin = Origin { lat_deg, lon_deg };
            let projection = Projection::at(origin);
            let is_within = |at: &Position| at.iter().all(|along_m| (0.0..=VAST_M).contains(along_m));
            let project = |[lat_deg, lon_deg]: &[f64; 2]| projection.project(*lat_deg, *lon_deg).filter(is_within);
            if let Some(positions) = positions.iter().map(project).collect::<Option<Vec<Position>>>() {
                let last_m = positions.iter().fold(Position::origin(), |last, at| last.sup(at));
                return Ok(Self { origin, sides_m: [last_m.x, last_m.y].map(beyond), positions });
            }
        }
        let median = [0, 1].map(|axis| {
            let mut along: Vec<f64> = positions.iter().map(|position| position[axis]).collect();
            along.sort_by(f64::total_cmp);
            along[along.len() / 2]
        });
        let projection = Projection::at(Origin { lat_deg: median[0], lon_deg: median[1] });
        let away_m = |place: &&SourcePosition<'_>| {
            let projected = projection.project(place.position[0], place.position[1]);
            projected.map_or(f64::INFINITY, |at| at.coords.norm())
        };
        let farthest = places.iter().max_by(|a, b| away_m(a).total_cmp(&away_m(b))).expect("there are several");
        let [lat_deg, lon_deg] = farthest.position;
        let away = away_m(&farthest);
        let away = if away.is_finite() { distance(away) } else { "half the Earth".to_owned() };
        let expected = format!("expected a field of at most {}", distance(VAST_M));
        Err(farthest.refusal(&format!("{lat_deg},{lon_deg}: {away} from the middle of the positions: {expected}")))
    }

    fn projection(&self) -> Projection {
        Projection::at(self.origin)
    }

    /// Its keys.
    fn keys(&self) -> String {
        let Origin { lat_deg, lon_deg } = self.origin;
        let origin =
            format!("origin_lat_deg = {lat_deg:.7} # of its south-west corner, WGS84\norigin_lon_deg = {lon_deg:.7}");
        format!("{}\n{origin}", sides(self.sides_m))
    }
}
