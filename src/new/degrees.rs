//! The field of positions and zones in degrees: a georeferenced area around them, and a free place to start from.

use std::path::Path;

use skysink_common::airspace::{Airspace, KeptGround, MAX_SIMPLIFIED_CORNERS, Polygon, SIMPLIFIED_CORNERS, simplify};
use skysink_common::error::InputError;
use skysink_common::geodata::plausible::{FieldPlaces, NamedPolygon, PolygonRole, distance};
use skysink_common::geodata::projection::Projection;
use skysink_common::geodata::{Zone, ZoneKind, Zones, check_geodetic};
use skysink_common::geometry::Position;
use skysink_common::scenario::{Area, LEAST_FILLED, Origin, Overrides, Scenario};
use skysink_lab::import::plan::PLAN;
use skysink_lab::import::{GROUND, Imported};

use super::field::NewField;
use super::geodetic_area::{GeodeticArea, SourcePosition};
use super::import::{Sources, doubted_system, of_sensors, start_line};
use super::plan::HOME;

/// Places along each side of the area among which a free start is searched.
const START_PLACES: u32 = 100;

/// Most sensor nodes, about, of which is checked whether ways lead to them from a start.
const MOST_NODES: usize = 500;

/// Most parts of an area, divided by zones, among which one with a start is chosen.
const MOST_PARTS: usize = 20;

/// Distance [m] from which on a boundary is not that of the sensor nodes.
const FAR_M: f64 = 1e3;

/// The field of positions in degrees and of zones, with a start [°] or one that is free.
///
/// # Errors
/// If all together are no field, a zone is refused, or no place to start from is free.
pub fn of_degrees(
    imported: Option<(&Imported, &Path)>,
    zones: Option<(Zones, &Path)>,
    start: Option<[f64; 2]>,
    sources: &Sources<'_>,
) -> Result<NewField, InputError> {
    let comm_radius_m = sources.comm_radius_m;
    let mut field = imported.map_or_else(NewField::default, |(imported, path)| of_sensors(imported, path));
    let nodes: Vec<SourcePosition> = imported.iter().flat_map(|(imported, path)| positions(imported, path)).collect();
    let none = Zones { zones: Vec::new(), ignored: None, system: None };
    let (mut zones, path) = zones.unwrap_or((none, Path::new("")));
    field.notes.extend(zones.system.as_ref().map(|system| format!("zones {}: {}", path.display(), system.note())));
    field.warnings.extend(doubted_system("zones", path, false, zones.system.as_ref()));
    field.notes.extend(zones.ignored.take().map(|what| format!("ignored in {}: {what}", path.display())));
    field.notes.extend(find_boundary(&mut zones.zones, &nodes, path)?);
    let zones = zones.zones;

    // The area encloses the sensor nodes, the start and the boundary, or without sensor nodes all zones.
    let count = nodes.len();
    let start_text = sources.start.map(|[first, second]| format!("{first},{second}")).unwrap_or_default();
    let start = start_of(sources, start, &start_text);
    if let Some(start) = &start {
        check_geodetic(start.position).map_err(|expected| start.refusal(&expected))?;
    }
    let has_boundary = zones.iter().any(|zone| zone.kind == ZoneKind::Boundary);
    let is_enclosed = |zone: &&Zone| if has_boundary { zone.kind == ZoneKind::Boundary } else { count == 0 };
    let mut enclosed = nodes;
    enclosed.extend(zones.iter().filter(is_enclosed).flat_map(|zone| corners(zone, path)));
    let planned = sources.plan.iter().flat_map(|plan| plan.places().map(move |place| (plan.path(), place)));
    enclosed.extend(planned.map(|(path, (place, position))| SourcePosition { what: PLAN, path, place, position }));
    enclosed.extend(start);
    let area = GeodeticArea::around(&enclosed, count)?;
    let nodes_m = &area.positions[..count];
    field.area = area.keys();

    let shapes = ZoneShapes::of(&zones, path, &area, nodes_m, imported, comm_radius_m)?;
    field.area += &shapes.boundary_key;
    field.zones += &shapes.zone_keys;
    let places = FieldPlaces {
        sides_m: area.sides_m,
        origin: Some(area.origin),
        nodes: nodes_m,
        ground_m: &imported.map(|(imported, _)| imported.ground_m()).unwrap_or_default(),
        node_name: &|node| enclosed[node].name(),
        polygons: &shapes.polygons,
        comm_radius_m,
    };
    field.notes.extend(listed(&zones, &shapes.outlines, &shapes.tops_m, nodes_m, path));
    field.warnings.extend(places.doubts());
    choose_start(&mut field, shapes, &area, &enclosed, count, path)?;
    Ok(field)
}

/// Where the UAV starts: at home of the plan, or where the option, written as `text`, has it [°].
fn start_of<'a>(sources: &'a Sources<'_>, start: Option<[f64; 2]>, text: &'a str) -> Option<SourcePosition<'a>> {
    let at_start = |position| SourcePosition { what: "option", path: Path::new("--start"), place: text, position };
    let home = sources.plan.as_ref().map(|plan| SourcePosition {
        what: PLAN,
        path: plan.path(),
        place: HOME,
        position: plan.home(),
    });
    home.or_else(|| start.map(at_start))
}

/// The zones of a file in the area.
#[derive(Default)]
struct ZoneShapes {
    /// The key of the boundary, if there is one.
    boundary_key: String,
    /// The tables of the other zones.
    zone_keys: String,
    polygons: Vec<NamedPolygon>,
    outlines: Vec<Polygon>,
    tops_m: Vec<f64>,
}

impl ZoneShapes {
    /// The `zones` of the file `path` in `area`, in which the sensor nodes stand at `nodes_m` [m].
    fn of(
        zones: &[Zone],
        path: &Path,
        area: &GeodeticArea,
        nodes_m: &[Position],
        imported: Option<(&Imported, &Path)>,
        comm_radius_m: f64,
    ) -> Result<Self, InputError> {
        let grounded = |zone: &Zone, polygon: &Polygon, altitude_m| {
            let ground_m = imported.and_then(|(imported, _)| ground_at(imported, nodes_m, polygon));
            height_above(ground_m, altitude_m).map_err(|expected| zone.refusal(path, &expected))
        };
        let mut shapes = Self::default();
        for zone in zones {
            let corners_m = zone.corners_m(&area.projection(), path)?;
            let polygon = Polygon::of(&corners_m, zone.kind == ZoneKind::Boundary).expect("its corners were checked");
            let (role, height_m) = match zone.kind {
                ZoneKind::NoFly => (PolygonRole::NoFly, f64::INFINITY),
                ZoneKind::Boundary => (PolygonRole::Boundary, f64::INFINITY),
                ZoneKind::Building(height_m) => (PolygonRole::Building, height_m),
                ZoneKind::BuildingAboveSea(altitude_m) => {
                    (PolygonRole::Building, grounded(zone, &polygon, altitude_m)?)
                }
            };
            match role {
                PolygonRole::Boundary => {
                    check_boundary(&polygon, nodes_m, comm_radius_m)
                        .map_err(|expected| zone.refusal(path, &expected))?;
                    shapes.boundary_key = format!("\nboundary_m = {corners_m:?}");
                }
                PolygonRole::NoFly => shapes.zone_keys += &format!("\n[[area.no_fly]]\npolygon_m = {corners_m:?}\n"),
                PolygonRole::Building => {
                    shapes.zone_keys +=
                        &format!("\n[[area.building]]\npolygon_m = {corners_m:?}\nheight_m = {height_m:?}\n");
                }
            }
            shapes.polygons.push(NamedPolygon { name: zone.name(path), role, corners_m });
            shapes.outlines.push(polygon);
            shapes.tops_m.push(height_m);
        }
        Ok(shapes)
    }
}

/// Fills in the start of the UAV, if it is not the middle of the area: the last of the `enclosed` positions, if that is
/// one, or a free place. The first `count` of them are those of sensor nodes.
fn choose_start(
    field: &mut NewField,
    mut shapes: ZoneShapes,
    area: &GeodeticArea,
    enclosed: &[SourcePosition<'_>],
    count: usize,
    path: &Path,
) -> Result<(), InputError> {
    let lowest_m = Scenario::letter(Overrides::default())?.uav.altitude_m;
    let extent = shapes.outlines.iter().find(|polygon| polygon.is_border()).map(Polygon::extent);
    // As the scenario will be, which keeps its start free.
    let [width_m, height_m] = area.sides_m;
    let at_start: Vec<Position> =
        enclosed.iter().zip(&area.positions).filter(|(place, _)| place.is_start()).map(|(_, at)| *at).collect();
    let kept = KeptGround { places: &at_start, areas: &[] };
    simplify(&mut shapes.outlines, SIMPLIFIED_CORNERS, Area::new(width_m, height_m).simplify_m(), kept);
    let corners: usize = shapes.outlines.iter().map(|outline| outline.corners().len()).sum();
    // A scenario with more is refused.
    let nodes_m = if corners <= MAX_SIMPLIFIED_CORNERS { &area.positions[..count] } else { &[] };
    let airspace = Airspace::new(area.sides_m, lowest_m, shapes.outlines.into_iter().zip(shapes.tops_m));
    if let Some(start) = enclosed.last().filter(|last| last.is_start()) {
        let at = area.positions[enclosed.len() - 1];
        if !airspace.contains(&at) {
            return Err(start.refusal("expected a place outside of zones and buildings, within the boundary"));
        }
        field.uav = start_line(&at, "");
    } else if !airspace.is_open() {
        let middle = Position::from([width_m / 2.0, height_m / 2.0]);
        let extent = extent.unwrap_or([Position::origin(), Position::from(area.sides_m)]);
        let free = free_place(&airspace, nodes_m, &middle, extent).ok_or_else(|| {
            let causes: Vec<String> = field.warnings.iter().map(|warning| format!("; {warning}")).collect();
            let message = format!("they leave no free place to start from in the area{}", causes.concat());
            InputError::new("zones", path, message)
        })?;
        if free != middle {
            field.uav = start_line(&free, " # a free place near the middle of the area");
        }
    }
    Ok(())
}

/// Most sensor nodes times corners for which is counted how many stand in a zone.
const MOST_CHECKED: usize = 10_000_000;

/// Most zones of a kind that are listed.
const MOST_LISTED: usize = 5;

/// What the zones of the file `path` are taken as, with the sensor nodes in no-fly zones; `None` without any.
fn listed(zones: &[Zone], outlines: &[Polygon], tops_m: &[f64], nodes_m: &[Position], path: &Path) -> Option<String> {
    let mut kinds: [(&str, Vec<String>); 3] =
        [("boundary", Vec::new()), ("no-fly zone", Vec::new()), ("building", Vec::new())];
    for ((zone, outline), top_m) in zones.iter().zip(outlines).zip(tops_m) {
        let is_counted = nodes_m.len().saturating_mul(outline.corners().len()) <= MOST_CHECKED;
        let nodes_m = if is_counted { nodes_m } else { &[] };
        let within = || match nodes_m.iter().filter(|node| outline.encloses(node)).count() {
            0 => String::new(),
            1 => " around 1 sensor node".to_owned(),
            count => format!(" around {count} sensor nodes"),
        };
        let place = &zone.place;
        match zone.kind {
            ZoneKind::Boundary => kinds[0].1.push(place.clone()),
            ZoneKind::NoFly if kinds[1].1.len() < MOST_LISTED => kinds[1].1.push(format!("{place}{}", within())),
            ZoneKind::NoFly => kinds[1].1.push(place.clone()),
            ZoneKind::Building(_) | ZoneKind::BuildingAboveSea(_) => kinds[2].1.push(format!("{place}, {top_m:.1} m")),
        }
    }
    let listed = |(kind, names): &(&str, Vec<String>)| {
        let more = names.len().saturating_sub(MOST_LISTED);
        let more = if more > 0 { format!("; and {more} more") } else { String::new() };
        let names = names.iter().take(MOST_LISTED).cloned().collect::<Vec<_>>().join("; ");
        format!("{kind}: {names}{more}")
    };
    let listed: Vec<String> = kinds.iter().filter(|(_, names)| !names.is_empty()).map(listed).collect();
    (!listed.is_empty()).then(|| format!("zones {}: {}", path.display(), listed.join(" · ")))
}

/// The corners of a zone of the file `path` with their location.
fn corners<'a>(zone: &'a Zone, path: &'a Path) -> impl Iterator<Item = SourcePosition<'a>> {
    zone.corners.iter().map(move |&position| SourcePosition { what: "zones", path, place: &zone.place, position })
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

/// The height of a building [m] up to an altitude above sea level [m], or the reason why it has none.
fn height_above(ground_m: Option<f64>, altitude_m: f64) -> Result<f64, String> {
    let expected = match ground_m {
        Some(ground_m) if altitude_m > ground_m => return Ok(altitude_m - ground_m),
        Some(ground_m) => format!("more than {ground_m}, the ground at the nearest sensor node"),
        None => "the altitude of the ground of each sensor node (ground_m) to measure it against, altitudeMode \
                 relativeToGround, or height_m"
            .to_owned(),
    };
    Err(format!("{altitude_m} m above sea level: expected {expected}"))
}

/// Checks that a boundary has an extent, and is that of the sensor nodes, some of which may be outside of it.
fn check_boundary(boundary: &Polygon, nodes_m: &[Position], comm_radius_m: f64) -> Result<(), String> {
    if boundary.filled() < LEAST_FILLED {
        return Err("expected a boundary that fills at least a hundredth of its extent".to_owned());
    }
    let nearest_m = nodes_m.iter().map(|node| distance_to(boundary, node)).reduce(f64::min).unwrap_or(0.0);
    if nearest_m > FAR_M.max(comm_radius_m) {
        let far = distance(nearest_m);
        return Err(format!("it lies {far} from the nearest sensor node: expected a boundary around them"));
    }
    Ok(())
}

/// The distance of a position from a polygon [m]; 0 in it.
fn distance_to(polygon: &Polygon, at: &Position) -> f64 {
    if polygon.encloses(at) { 0.0 } else { (polygon.nearest(at) - at).norm() }
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
    let column = imported.others.iter().position(|name| *name == GROUND)?;
    let nodes = nodes_m.iter().zip(&imported.sensors);
    let (_, nearest) = nodes.min_by(|(a, _), (b, _)| distance_to(polygon, a).total_cmp(&distance_to(polygon, b)))?;
    nearest.others[column].parse().ok()
}

/// The middle of an area, or the place of a grid between two corners that is nearest to it: where it is free, and ways
/// lead from there to sensor nodes, to most of them if zones divide the area.
fn free_place(
    airspace: &Airspace,
    nodes_m: &[Position],
    middle: &Position,
    [low, high]: [Position; 2],
) -> Option<Position> {
    let around = around_most(airspace, nodes_m);
    let leads_on = |at: &Position| around.as_ref().is_none_or(|airspace| airspace.is_reachable(at));
    if airspace.contains(middle) && leads_on(middle) {
        return Some(*middle);
    }
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
    let free: Vec<Position> = places.into_iter().filter(is_free).collect();
    free.iter().find(|at| leads_on(at)).or(free.first()).copied()
}

/// The airspace with the ways of the part of an area in which most of the sensor nodes stand; `None` if all stand in
/// zones.
fn around_most(airspace: &Airspace, nodes_m: &[Position]) -> Option<Airspace> {
    let mut parts: Vec<(usize, Airspace)> = Vec::new();
    let some = nodes_m.iter().step_by(nodes_m.len().div_ceil(MOST_NODES).max(1));
    for node in some.filter(|node| airspace.contains(node)) {
        match parts.iter().position(|(_, part)| part.is_reachable(node)) {
            Some(index) => parts[index].0 += 1,
            None if parts.len() < MOST_PARTS => parts.push((1, airspace.clone().with_ways(node))),
            None => {}
        }
    }
    // The first of equal ones.
    parts.into_iter().rev().max_by_key(|(count, _)| *count).map(|(_, part)| part)
}
