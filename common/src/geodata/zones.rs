//! No-fly zones, buildings and a boundary from the polygons of a file.

use std::path::Path;

use super::{
    CLOSED_LINE, Extrusion, FOOT_M, FoundPoint, FoundPoints, FoundPolygon, IgnoredItem, KIND, KMZ, NAME, ReadFormat,
    ReferenceSystem, geojson, kml,
};
use crate::airspace::Polygon;
use crate::error::{InputError, quoted};
use crate::geodata::projection::Projection;
use crate::geometry::Position;

/// File extensions with their readers.
const FORMATS: [(&str, ReadFormat<FoundPoints>); 4] =
    [("kml", kml::find), (KMZ, kml::find), ("geojson", geojson::find), ("json", geojson::find)];

/// The kind of input in error messages.
const WHAT: &str = "zones";

/// Properties for the height of a building [m].
const HEIGHTS: [&str; 2] = ["height_m", "height"];

/// What feet are called after a number.
const FEET: [&str; 3] = ["ft", "feet", "'"];

/// Properties of a point in the middle of a circle, as programs for geofences write them.
const RADII: [&str; 2] = ["radius", "radius_m"];

/// The kind of such a point.
const CIRCLE: &str = "circle";

/// Properties that say what a polygon is.
const KINDS: [&str; 2] = [KIND, NAME];

/// Values of a property `kind` for a zone that is closed at all altitudes.
const NO_FLY: [&str; 4] = ["no-fly", "no_fly", "nofly", "no fly"];

/// Values of them for the boundary of an area.
const BOUNDARIES: [&str; 2] = ["boundary", "area"];

/// What a polygon of a file is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ZoneKind {
    /// A zone at any altitude.
    NoFly,
    /// A building of this height [m].
    Building(f64),
    /// A building up to this altitude above sea level [m].
    BuildingAboveSea(f64),
    /// The boundary of the area.
    Boundary,
}

/// A polygon of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Zone {
    /// Its location in the file, such as `polygon 2`.
    pub place: String,
    /// Latitude and longitude [°] of its corners.
    pub corners: Vec<[f64; 2]>,
    /// What it is.
    pub kind: ZoneKind,
    /// Whether a property `kind` of the file says so.
    pub is_marked: bool,
}

/// The zones of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Zones {
    /// The polygons.
    pub zones: Vec<Zone>,
    /// Counts and names of all that is no polygon, with the remedy; `None` without such items.
    pub ignored: Option<String>,
    /// The system that their corners were converted from; `None` if they are in degrees of WGS84.
    pub system: Option<ReferenceSystem>,
}

/// Reads the zones of the file `path`, KML, KMZ or GeoJSON. `system` is that of an option, for GeoJSON in lengths that
/// does not name its own.
///
/// # Errors
/// If the format is unknown, the file cannot be read, a polygon has a hole, no corners or an invalid position, or there
/// is none.
pub fn read_zones(path: &Path, system: Option<&ReferenceSystem>) -> Result<Zones, InputError> {
    if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("gpx")) {
        let message = "GPX has no polygons: expected KML, KMZ or GeoJSON, with a polygon for each zone";
        return Err(InputError::new(WHAT, path, message));
    }
    let found = super::read(WHAT, path, system, &FORMATS)?;
    let points = found.points.iter().map(ignored_point);
    let ignored: Vec<IgnoredItem> = found.ignored.iter().cloned().chain(points).collect();
    let zones = zones(&found, &ignored).map_err(|message| InputError::new(WHAT, path, message))?;
    let has_closed = ignored.iter().any(|item| [CLOSED_LINE, CIRCLE].contains(&item.kind));
    let remedy = if has_closed { "; only polygons are zones: draw what must not be entered as such" } else { "" };
    Ok(Zones { zones, ignored: IgnoredItem::summary(&ignored).map(|summary| summary + remedy), system: found.system })
}

/// A point among zones.
fn ignored_point(point: &FoundPoint) -> IgnoredItem {
    let is_circle = point.properties.iter().any(|(name, _)| RADII.contains(&name.to_lowercase().as_str()));
    IgnoredItem::of(if is_circle { CIRCLE } else { "point" }, &point.properties)
}

impl Zone {
    /// Its corners in the plane of an area [m], to the millimetre, without the last one if it is the first again.
    ///
    /// # Errors
    /// If a corner is beyond the horizon, or they are not those of a polygon; `path` is the file of the zone.
    pub fn corners_m(&self, projection: &Projection, path: &Path) -> Result<Vec<[f64; 2]>, InputError> {
        let open = match &self.corners[..] {
            [first, between @ .., last] if first == last && !between.is_empty() => &self.corners[..=between.len()],
            all => all,
        };
        let in_plane = |[lat_deg, lon_deg]: &[f64; 2]| {
            let position = projection.project(*lat_deg, *lon_deg);
            let expected = "expected a position within the horizon of the area";
            let refuse = || self.refusal(path, &format!("latitude {lat_deg}, longitude {lon_deg}: {expected}"));
            let to_millimetre = |length_m: f64| (length_m * 1e3).round() / 1e3 + 0.0; // without the sign of a zero
            position.ok_or_else(refuse).map(|at: Position| [at.x, at.y].map(to_millimetre))
        };
        let corners = open.iter().map(in_plane).collect::<Result<Vec<_>, _>>()?;
        let expected = "expected at least three corners of a polygon without crossings";
        Polygon::of(&corners, self.kind == ZoneKind::Boundary).map_err(|_| self.refusal(path, expected))?;
        Ok(corners)
    }

    /// Its name in messages, with its file `path`.
    pub fn name(&self, path: &Path) -> String {
        self.refusal(path, "").to_string().trim_end_matches(": ").to_owned()
    }

    /// The error for this zone of the file `path`.
    pub fn refusal(&self, path: &Path, expected: &str) -> InputError {
        InputError::new(WHAT, path, format_args!("{}: {expected}", self.place))
    }
}

/// The polygons as zones, beside what is `ignored`.
fn zones(found: &FoundPoints, ignored: &[IgnoredItem]) -> Result<Vec<Zone>, String> {
    if found.polygons.is_empty() {
        let only = IgnoredItem::summary(ignored).map(|summary| format!(", only {summary}")).unwrap_or_default();
        return Err(format!("no polygons{only}: expected a polygon for each zone"));
    }
    let numbered = found.polygons.iter().zip(1..);
    let zones = numbered.map(|(polygon, number)| {
        let place = super::place("polygon", number, &polygon.properties);
        let zone = zone(polygon).map_err(|message| format!("{place}: {message}"))?;
        Ok(Zone { place, ..zone })
    });
    let zones = zones.collect::<Result<Vec<_>, String>>()?;
    match zones.iter().filter(|zone| zone.kind == ZoneKind::Boundary).nth(1) {
        Some(second) => Err(format!("{}: a second boundary: expected one", second.place)),
        None => Ok(zones),
    }
}

/// A height [m] from its text, in metres unless it says feet.
fn height_m(text: &str) -> Option<f64> {
    let in_feet = FEET.iter().find_map(|unit| text.strip_suffix(unit));
    let number = in_feet.unwrap_or_else(|| text.trim_end_matches('m'));
    let number: f64 = number.trim_end().parse().ok()?;
    Some(if in_feet.is_some() { number * FOOT_M } else { number })
}

fn zone(polygon: &FoundPolygon) -> Result<Zone, String> {
    let outer = match &polygon.rings[..] {
        [] => return Err("no corners: expected at least three".to_owned()),
        [outer, ..] if outer.is_empty() => return Err("no corners: expected at least three".to_owned()),
        [outer] => outer,
        _ => return Err("a hole: expected a polygon without holes".to_owned()),
    };
    let property = |names: &[&str]| {
        let called = |name: &&str| polygon.properties.iter().find(|(own, _)| own.to_lowercase() == **name);
        names.iter().find_map(called).map(|(_, value)| value.trim())
    };
    let is_boundary = |value: &str| BOUNDARIES.contains(&value.to_lowercase().as_str());
    let is_marked = property(&[KIND]).is_some();
    let is_no_fly = |value: &str| NO_FLY.contains(&value.to_lowercase().as_str());
    let kind = if property(&KINDS).is_some_and(is_boundary) {
        ZoneKind::Boundary
    } else if property(&[KIND]).is_some_and(is_no_fly) {
        ZoneKind::NoFly // whatever its height
    } else {
        let given = HEIGHTS.iter().filter_map(|name| property(&[name]));
        let heights_m = given.map(|value| {
            let expected = || format!("height {}: expected metres, or feet as in `40 ft`", quoted(value));
            height_m(value).ok_or_else(expected)
        });
        let heights_m = heights_m.collect::<Result<Vec<f64>, String>>()?;
        let height = match heights_m[..] {
            [] => polygon.extrusion,
            [first_m, second_m] if first_m != second_m => {
                return Err(format!("height_m {first_m} and height {second_m}: expected one height"));
            }
            [height_m, ..] => Extrusion::AboveGround(height_m),
        };
        match height {
            Extrusion::Flat => ZoneKind::NoFly,
            Extrusion::AboveSea(altitude_m) => ZoneKind::BuildingAboveSea(altitude_m),
            Extrusion::AboveGround(height_m) if height_m > 0.0 && height_m.is_finite() => ZoneKind::Building(height_m),
            Extrusion::AboveGround(height_m) => {
                return Err(format!("height {height_m}: expected a finite number above 0"));
            }
        }
    };
    Ok(Zone { place: String::new(), corners: outer.clone(), kind, is_marked })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(properties: &[(&str, &str)]) -> FoundPolygon {
        let properties = properties.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect();
        FoundPolygon { rings: vec![vec![[1.0, 2.0], [1.0, 3.0], [2.0, 3.0]]], properties, ..FoundPolygon::default() }
    }

    fn kind(properties: &[(&str, &str)]) -> Result<ZoneKind, String> {
        zone(&found(properties)).map(|zone| zone.kind)
    }

    #[test]
    fn properties_distinguish_zones_buildings_and_the_boundary() {
        assert_eq!(kind(&[("name", "airfield")]), Ok(ZoneKind::NoFly));
        assert_eq!(kind(&[("building", "yes"), ("Height", "12.5 m")]), Ok(ZoneKind::Building(12.5)));
        assert_eq!(kind(&[("height", "10"), ("height_m", "10")]), Ok(ZoneKind::Building(10.0)));
        let two = kind(&[("height", "40"), ("height_m", "10")]);
        assert_eq!(two.unwrap_err(), "height_m 10 and height 40: expected one height");
        assert_eq!(kind(&[("kind", "No-Fly"), ("height", "12")]), Ok(ZoneKind::NoFly));
        assert_eq!(kind(&[("height", "40 ft")]), Ok(ZoneKind::Building(40.0 * 0.3048)));
        assert_eq!(kind(&[("kind", "area"), ("name", "field")]), Ok(ZoneKind::Boundary));
        assert_eq!(kind(&[("name", "Boundary")]), Ok(ZoneKind::Boundary));
        let extruded = FoundPolygon { extrusion: Extrusion::AboveGround(7.0), ..found(&[]) };
        assert_eq!(zone(&extruded).unwrap().kind, ZoneKind::Building(7.0));
        for height in ["tall", "-3", "0", "inf", "NaN", ""] {
            assert!(kind(&[("height", height)]).unwrap_err().starts_with("height "), "{height}");
        }
    }

    #[test]
    fn only_a_repeated_first_corner_is_left_out() {
        let projection = Projection::at(crate::scenario::Origin { lat_deg: 1.0, lon_deg: 2.0 });
        let corners = |closing: &[[f64; 2]]| {
            let mut zone = zone(&found(&[])).unwrap();
            zone.corners.extend(closing);
            zone.corners_m(&projection, Path::new("a.kml")).unwrap()
        };
        let open = corners(&[]);
        assert_eq!((open.len(), open[0]), (3, [0.0, 0.0]));
        assert_eq!(corners(&[[1.0, 2.0]]), open, "a closed ring");
        assert_eq!(corners(&[[1.5, 2.0]]).len(), 4);
    }

    #[test]
    fn holes_second_boundaries_and_invalid_corners_are_refused() {
        let all = |polygons: Vec<FoundPolygon>| zones(&FoundPoints { polygons, ..FoundPoints::default() }, &[]);
        assert!(all(vec![]).unwrap_err().contains("no polygons"));
        let mut pierced = found(&[]);
        pierced.rings.push(Vec::new());
        assert_eq!(all(vec![found(&[]), pierced]).unwrap_err(), "polygon 2: a hole: expected a polygon without holes");
        let boundary = || found(&[("kind", "boundary")]);
        assert_eq!(all(vec![boundary(), boundary()]).unwrap_err(), "polygon 2: a second boundary: expected one");
        for rings in [vec![], vec![vec![]], vec![vec![], vec![[1.0, 2.0]]]] {
            let empty = FoundPolygon { rings, ..found(&[("name", "pond")]) };
            assert_eq!(all(vec![empty]).unwrap_err(), "polygon 1 (`pond`): no corners: expected at least three");
        }
    }
}
