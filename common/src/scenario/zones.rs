//! The airspace of a scenario, and the rules of its zones, buildings and bases: polygons, and ways that lead where the
//! UAV has to go.

use std::path::Path;

use serde::Serialize;
use toml::Value;

use super::area::{BuildingKeys, NoFlyKeys};
use super::mission::Scenario;
use super::sites;
use crate::airspace::{Airspace, MAX_CORNERS, MAX_SIMPLIFIED_CORNERS, Polygon};
use crate::base::{Base, BaseArea};
use crate::channel::Buildings;
use crate::error::{InputError, MAX_PATH};
use crate::geodata::plausible::{NamedPolygon, PolygonRole};
use crate::geodata::projection::{Origin, Projection};
use crate::geodata::{ZoneKind, read_zones};
use crate::geometry::Position;
use crate::terminal::one_line;

/// Least part of its bounding box that a boundary fills: sensor nodes are drawn in the box until they lie in the
/// boundary.
pub const LEAST_FILLED: f64 = 0.01;

/// Replaces the files of `[[area.no_fly]]` by their zones, buildings and boundary, as polygons, and names all polygons
/// for messages.
///
/// # Errors
/// If a table has a polygon and a file or neither, a file is refused, the area has no origin, or there are two
/// boundaries.
pub(super) fn read_files(scenario: &mut Scenario) -> Result<(), InputError> {
    let mut polygons = Vec::new();
    let mut name = |name: String, role, corners_m: &[[f64; 2]]| {
        polygons.push(NamedPolygon { name, role, corners_m: corners_m.to_vec() });
    };
    let area = &scenario.area;
    area.boundary_m.iter().for_each(|corners| name("area.boundary_m".to_owned(), PolygonRole::Boundary, corners));
    for (index, building) in area.building.iter().flatten().enumerate() {
        name(format!("area.building[{index}].polygon_m"), PolygonRole::Building, &building.polygon_m);
    }
    let tables = scenario.area.no_fly.take().unwrap_or_default();
    let mut no_fly = Vec::with_capacity(tables.len());
    for (index, table) in tables.into_iter().enumerate() {
        let key = format!("area.no_fly[{index}]");
        let Some(file) = table.file.as_ref().filter(|_| table.polygon_m.is_none()) else {
            if table.polygon_m.is_none() || table.file.is_some() {
                return Err(scenario.refusal(&key, &toml_of(&table), "polygon_m, the corners of a zone [m], or file"));
            }
            // Here, where the table has its number in the file.
            if let Err(expected) = Polygon::of(table.corners(), false) {
                return Err(scenario.refusal(&format!("{key}.polygon_m"), &toml_of(table.corners()), expected));
            }
            name(format!("{key}.polygon_m"), PolygonRole::NoFly, table.corners());
            no_fly.push(table);
            continue;
        };
        let Some(origin) = scenario.area.origin() else {
            let expected = "area.origin_lat_deg and area.origin_lon_deg beside a file of zones";
            return Err(scenario.refusal(&format!("{key}.file"), &toml_of(file), expected));
        };
        let path = scenario.beside(file);
        read_zone_file(scenario, &path, origin, &mut name, &mut no_fly)?;
    }
    scenario.polygons = polygons;
    scenario.area.no_fly = Some(no_fly).filter(|zones| !zones.is_empty());
    Ok(())
}

/// Keeps a polygon with its name for messages, its role and its corners [m].
type NamePolygon<'a> = dyn FnMut(String, PolygonRole, &[[f64; 2]]) + 'a;

/// Adds the zones, the buildings and the boundary of the file `path` to `scenario` and to its zones `no_fly`, and gives
/// each its `name`.
fn read_zone_file(
    scenario: &mut Scenario,
    path: &Path,
    origin: Origin,
    name: &mut NamePolygon<'_>,
    no_fly: &mut Vec<NoFlyKeys>,
) -> Result<(), InputError> {
    let read = read_zones(path, None)?;
    let note = |ignored| format!("zones {}: ignored: {ignored}", one_line(&path.to_string_lossy(), MAX_PATH));
    scenario.notes.extend(read.ignored.map(note));
    for zone in read.zones {
        let corners = zone.corners_m(&Projection::at(origin), path)?;
        let mut named = |role| name(zone.name(path), role, &corners);
        match zone.kind {
            ZoneKind::NoFly => {
                named(PolygonRole::NoFly);
                no_fly.push(NoFlyKeys { polygon_m: Some(corners), file: None });
            }
            ZoneKind::Building(height_m) => {
                named(PolygonRole::Building);
                scenario.area.building.get_or_insert_default().push(BuildingKeys { polygon_m: corners, height_m });
            }
            ZoneKind::BuildingAboveSea(altitude_m) => {
                let expected = "expected a height above the ground (altitudeMode relativeToGround, or height_m); \
                                `skysink new --zones` measures it against the ground of the sensor nodes";
                return Err(zone.refusal(path, &format!("{altitude_m} m above sea level: {expected}")));
            }
            ZoneKind::Boundary if scenario.area.boundary_m.is_some() => {
                return Err(zone.refusal(path, "a second boundary: expected one, here or in area.boundary_m"));
            }
            ZoneKind::Boundary => {
                named(PolygonRole::Boundary);
                scenario.area.boundary_m = Some(corners);
            }
        }
    }
    Ok(())
}

/// Checks the border, the zones and the buildings of `scenario`, and that its start and its base lie outside of them.
pub(super) fn check(scenario: &Scenario) -> Result<(), InputError> {
    let area = &scenario.area;
    let count = check_polygons(scenario)?;
    check_areas(scenario)?;
    sites::check(scenario)?;
    if count == 0 && scenario.uav.grid_m().is_none() {
        return Ok(());
    }
    let simplified = scenario.simplified_zones();
    if simplified.corners > MAX_SIMPLIFIED_CORNERS {
        let expected = format!(
            "at most {MAX_SIMPLIFIED_CORNERS} corners in the boundary, all zones and buildings, not {} as are left of \
             {count}: a larger tolerance, or fewer zones",
            simplified.corners
        );
        return Err(scenario.refusal("area.simplify_m", &area.simplify_m().into(), &expected));
    }
    let start = scenario.start().xy();
    let refuse = |key: &str, position: &Position, expected: &str| {
        Err(scenario.refusal(key, &toml_of(&[position.x, position.y]), expected))
    };
    if !scenario.airspace_without_ways().contains(&start) {
        return refuse("uav.start_m", &start, "a position outside of zones and buildings, within the boundary");
    }
    let base = scenario.landing_base();
    if base.is_none() && scenario.uav.starts_m.is_none() {
        return Ok(());
    }
    let airspace = scenario.airspace();
    if !scenario.starts().all(|start| airspace.is_reachable(&start.xy())) {
        let expected = "positions that lead to each other, around zones and buildings";
        return Err(scenario.refusal("uav.starts_m", &toml_of(&scenario.uav.starts_m), expected));
    }
    base.map_or(Ok(()), |base| check_base(scenario, &base, &airspace))
}

/// Checks the border, the zones and the buildings of `scenario`, each by itself; returns their corners.
fn check_polygons(scenario: &Scenario) -> Result<usize, InputError> {
    let area = &scenario.area;
    let no_fly = area.no_fly.iter().flatten().map(NoFlyKeys::corners).enumerate();
    let no_fly = no_fly.map(|(index, corners)| (format!("area.no_fly[{index}].polygon_m"), corners, false));
    let buildings = area.building.iter().flatten().map(|building| &building.polygon_m[..]).enumerate();
    let buildings = buildings.map(|(index, corners)| (format!("area.building[{index}].polygon_m"), corners, false));
    let border = area.boundary_m.iter().map(|corners| ("area.boundary_m".to_owned(), &corners[..], true));
    let mut count = 0;
    for (key, corners, is_border) in border.chain(no_fly).chain(buildings) {
        count += corners.len();
        if count > MAX_CORNERS {
            let expected = format!("at most {MAX_CORNERS} corners in the boundary, all zones and buildings");
            return Err(scenario.refusal(&key, &format!("a polygon of {} corners", corners.len()).into(), &expected));
        }
        let polygon = Polygon::of(corners, is_border);
        let polygon = polygon.map_err(|expected| scenario.refusal(&key, &toml_of(corners), expected))?;
        let is_in_area = corners.iter().all(|&corner| area.contains(&corner.into(), 0.0));
        if is_border && !(is_in_area && polygon.filled() >= LEAST_FILLED) {
            let expected = "a polygon in the area that fills at least a hundredth of its extent";
            return Err(scenario.refusal(&key, &toml_of(corners), expected));
        }
    }
    Ok(count)
}

/// Checks that `base` can be reached in `airspace`.
fn check_base(scenario: &Scenario, base: &Base, airspace: &Airspace) -> Result<(), InputError> {
    if !base.sites().is_empty() {
        return sites::check_ways(scenario, base, airspace);
    }
    if airspace.has_grid() {
        let key = if matches!(base, Base::Disk { .. }) { "base.position_m" } else { "base.areas_m" };
        let keys = toml_of(&scenario.base);
        let value = keys.get(key.trim_start_matches("base.")).cloned().unwrap_or(keys);
        let expected = expected_of(airspace, "a base");
        return if is_led_to(airspace, base) { Ok(()) } else { Err(scenario.refusal(key, &value, &expected)) };
    }
    let Some((index, place)) = base.places().enumerate().find(|(_, place)| !airspace.is_reachable(place)) else {
        return Ok(());
    };
    match base {
        Base::Disk { .. } => {
            let at_m = toml_of(&[place.x, place.y]);
            Err(scenario.refusal("base.position_m", &at_m, &expected_of(airspace, "a position")))
        }
        Base::Areas(areas) => {
            let corners: Vec<[f64; 2]> = areas[index].polygon.corners().iter().map(|&at| at.into()).collect();
            let expected = expected_of(airspace, "a polygon");
            Err(scenario.refusal(&format!("base.areas_m[{index}]"), &toml_of(&corners), &expected))
        }
        Base::Sites(_) => Ok(()), // checked above
    }
}

/// Whether the UAV can fly to each place of a base, or on a grid to the middle of a cell in it.
pub(super) fn is_led_to(airspace: &Airspace, base: &Base) -> bool {
    match airspace.has_grid() {
        true => airspace.cells().any(|cell| base.contains(&cell)),
        false => base.places().all(|place| airspace.is_reachable(&place)),
    }
}

/// What is expected of a base, or a part of it.
pub(super) fn expected_of(airspace: &Airspace, part: &str) -> String {
    match airspace.has_grid() {
        true => format!("{part} with the middle of a cell of the grid that the UAV can fly to from its start"),
        false => format!("{part} that the UAV can fly to from its start, around zones and buildings"),
    }
}

/// Checks the polygons of the base.
fn check_areas(scenario: &Scenario) -> Result<(), InputError> {
    let Some(areas_m) = scenario.base.as_ref().and_then(|base| base.areas_m.as_ref()) else { return Ok(()) };
    let count: usize = areas_m.iter().map(Vec::len).sum();
    if areas_m.is_empty() || count > MAX_CORNERS {
        let expected = format!("at least one polygon, and at most {MAX_CORNERS} corners in all of them");
        return Err(scenario.refusal("base.areas_m", &toml_of(areas_m), &expected));
    }
    for (index, corners) in areas_m.iter().enumerate() {
        let is_in_area = corners.iter().all(|&corner| scenario.area.contains(&corner.into(), 0.0));
        let expected = match Polygon::of(corners, false) {
            Ok(_) if is_in_area => continue,
            Ok(_) => "a polygon in the area",
            Err(expected) => expected,
        };
        return Err(scenario.refusal(&format!("base.areas_m[{index}]"), &toml_of(corners), expected));
    }
    Ok(())
}

/// ```
/// use skysink_common::scenario::Scenario;
/// let text = "name = 'a'\nuav.must_land = true\nuav.start_m = [5, 50]\nbase.radius_m = 3.0\n\
///             [[area.no_fly]]\npolygon_m = [[40, 20], [60, 20], [60, 80], [40, 80]]";
/// let scenario = Scenario::parse(text, "a.toml".as_ref(), Default::default()).unwrap();
/// let [west, east] = [[30.0, 50.0].into(), [70.0, 50.0].into()];
/// assert!(!scenario.airspace_without_ways().is_free(&west, &east));
/// assert!(!scenario.airspace_of_slots().is_free(&west, &east));
/// assert!(scenario.airspace().distance_m(&west, &east) > 40.0); // about the zone
/// assert!(scenario.landing_base().unwrap().contains(&[7.0, 50.0].into()));
/// ```
impl Scenario {
    /// Where the UAV may fly at its lowest altitude. The shortest ways between corners take time
    /// by the square of their number, when they are first asked for.
    pub fn airspace(&self) -> Airspace {
        let airspace = self.airspace_without_ways();
        let start = self.start().xy();
        match self.uav.grid_m() {
            None => airspace.with_ways(&start),
            Some(cell_m) => airspace.on_grid(cell_m, self.move_slots(), &start),
        }
    }

    /// The airspace for checks of the flights of single slots.
    pub fn airspace_of_slots(&self) -> Airspace {
        if self.uav.grid_m().is_some() { self.airspace() } else { self.airspace_without_ways() }
    }

    /// The base; `None` if the scenario has none. A polygon that is none is left out; a checked scenario has no such.
    pub fn landing_base(&self) -> Option<Base> {
        let keys = self.base.as_ref()?;
        if let Some(sites) = &keys.site {
            return Some(sites::base(self, sites));
        }
        let Some(areas_m) = &keys.areas_m else {
            let centre = keys.position_m.map_or_else(|| self.start().xy(), Position::from);
            return Some(Base::Disk { centre, radius_m: keys.radius_m.unwrap_or_default() });
        };
        let airspace = self.airspace_without_ways();
        let polygons = areas_m.iter().filter_map(|corners| Polygon::of(corners, false).ok());
        Some(Base::Areas(polygons.map(|polygon| BaseArea::new(polygon, &airspace)).collect()))
    }

    /// The buildings among its sensor nodes. A polygon that is none is left out; a checked scenario has no such.
    pub(super) fn buildings(&self) -> Buildings {
        let buildings = self.area.building.iter().flatten();
        let outline =
            |building: &BuildingKeys| Some((Polygon::of(&building.polygon_m, false).ok()?, building.height_m));
        Buildings::new(buildings.filter_map(outline), self.sensors.height_m.unwrap_or_default())
    }

    /// The airspace for checks of single moves: all its paths are straight.
    ///
    /// # Panics
    /// If a zone is no polygon; never in a checked scenario.
    pub fn airspace_without_ways(&self) -> Airspace {
        let area = &self.area;
        let lowest_m = self.uav.climb().map_or(self.uav.altitude_m, |climb| climb.min_altitude_m);
        Airspace::new([area.width_m(), area.height_m()], lowest_m, self.simplified_zones().zones.into_iter())
    }
}

pub(super) fn toml_of(value: &(impl Serialize + ?Sized)) -> Value {
    Value::try_from(value).expect("numbers are TOML")
}
