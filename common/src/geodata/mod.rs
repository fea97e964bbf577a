//! Files of geodetic positions: the points and polygons of GeoJSON and KML, and the zones among them.
//!
//! Each format has its own file; `reference` leads from the metres of maps to latitude and longitude, `projection` into
//! the plane of an area and back. What the points and polygons mean is left to the callers.

pub mod geojson;
mod heights;
pub mod kml;
pub mod option_value;
pub mod plausible;
pub mod projection;
mod reference;
mod text;
pub mod xml;
mod zones;

use std::path::Path;

use crate::error::{InputError, quoted, read_bytes};

pub use heights::FOOT_M;
pub use reference::{Coordinates, EarthSystem, ReferenceSystem};
pub use zones::{Zone, ZoneKind, Zones, read_zones};

/// The property that names a point or a polygon.
pub const NAME: &str = "name";

/// The property that says what a point or a polygon is.
pub const KIND: &str = "kind";

/// The extension of an archive with a KML document.
pub const KMZ: &str = "kmz";

/// A point of a file.
#[derive(Debug, Clone, Default)]
pub struct FoundPoint {
    /// Latitude and longitude [°].
    pub position: [f64; 2],
    /// Its height [m], above whatever the file means: the ground, sea level, the ellipsoid or nothing.
    pub altitude_m: Option<f64>,
    /// Names and values of its properties.
    pub properties: Vec<(String, String)>,
}

/// A polygon as found: its rings, the outer one first, and its properties.
#[derive(Debug, Clone, Default)]
pub struct FoundPolygon {
    /// Latitude and longitude [°] of the corners of each ring.
    pub rings: Vec<Vec<[f64; 2]>>,
    /// How high its sides are drawn.
    pub extrusion: Extrusion,
    /// Names and values of its properties.
    pub properties: Vec<(String, String)>,
}

/// How high the sides of a polygon are drawn.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum Extrusion {
    /// Not at all.
    #[default]
    Flat,
    /// Up to this height above the ground [m].
    AboveGround(f64),
    /// Up to this altitude above sea level [m].
    AboveSea(f64),
}

/// An item of a file that is no point and no polygon.
#[derive(Debug, Clone, PartialEq)]
pub struct IgnoredItem {
    /// What it is, such as `line`.
    pub kind: &'static str,
    /// Its name, if it has one.
    pub name: Option<String>,
}

/// The points and polygons of a file, and what else is in it.
#[derive(Debug, Default)]
pub struct FoundPoints {
    /// The points.
    pub points: Vec<FoundPoint>,
    /// The polygons.
    pub polygons: Vec<FoundPolygon>,
    /// All other items.
    pub ignored: Vec<IgnoredItem>,
    /// The system that its positions were converted from; `None` if they are in degrees of WGS84.
    pub system: Option<ReferenceSystem>,
}

/// The kind of a line that ends where it begins, such as one around ground that must not be entered.
const CLOSED_LINE: &str = "closed line";

/// The kind of a line.
fn kind_of_line(is_closed: bool) -> &'static str {
    if is_closed { CLOSED_LINE } else { "line" }
}

/// Whether the first of at least four positions is the last again.
fn is_closed<T: PartialEq>(positions: &[T]) -> bool {
    positions.len() > 3 && positions.first() == positions.last()
}

/// Most names of ignored items in a message.
const MOST_NAMES: usize = 5;

/// The location of an item in a file: its number, and its name if it has one.
fn place(kind: &str, number: usize, properties: &[(String, String)]) -> String {
    let name = properties.iter().find(|(name, value)| name.to_lowercase() == NAME && !value.trim().is_empty());
    let name = name.map(|(_, name)| format!(" (`{}`)", quoted(name))).unwrap_or_default();
    format!("{kind} {number}{name}")
}

impl FoundPoints {
    /// The location of the next point, for messages.
    fn next_point(&self, properties: &[(String, String)]) -> String {
        place("point", self.points.len() + 1, properties)
    }

    /// The location of the next polygon, for messages.
    fn next_polygon(&self, properties: &[(String, String)]) -> String {
        place("polygon", self.polygons.len() + 1, properties)
    }

    /// Its polygons as ignored items.
    pub fn ignored_polygons(&self) -> impl Iterator<Item = IgnoredItem> {
        self.polygons.iter().map(|polygon| IgnoredItem::of("polygon", &polygon.properties))
    }
}

impl IgnoredItem {
    /// The item with these properties.
    #[must_use]
    pub fn of(kind: &'static str, properties: &[(String, String)]) -> Self {
        let name = properties.iter().find(|(name, value)| name.to_lowercase() == NAME && !value.trim().is_empty());
        Self { kind, name: name.map(|(_, name)| name.clone()) }
    }

    /// Counts and names of items by kind, such as `2 × line (`a`), polygon`; `None` without items.
    #[must_use]
    pub fn summary(items: &[Self]) -> Option<String> {
        let mut kinds: Vec<&str> = items.iter().map(|item| item.kind).collect();
        kinds.sort_unstable();
        kinds.dedup();
        let of_kind = |kind: &&str| {
            let count = items.iter().filter(|item| item.kind == *kind).count();
            let mut names: Vec<String> = items
                .iter()
                .filter(|item| item.kind == *kind)
                .filter_map(|item| Some(format!("`{}`", quoted(item.name.as_ref()?))))
                .collect();
            if names.len() > MOST_NAMES {
                names.truncate(MOST_NAMES);
                names.push("...".to_owned());
            }
            let names = if names.is_empty() { String::new() } else { format!(" ({})", names.join(", ")) };
            format!("{count} × {kind}{names}")
        };
        (!items.is_empty()).then(|| kinds.iter().map(of_kind).collect::<Vec<_>>().join(", "))
    }
}

/// The text of a file, with what its reader has to know besides.
#[derive(Debug, Default)]
pub struct SourceText<'a> {
    /// The text.
    pub text: &'a str,
    /// The system of positions that are no degrees, where the file itself names none: that of an option, or of a file
    /// `.prj`.
    pub system: Option<&'a ReferenceSystem>,
    /// Names of further documents in its archive, which are not read.
    pub others: Vec<String>,
}

/// Reads the text of a file. The error contains location, value and expectation.
pub type ReadFormat<T> = fn(&SourceText<'_>) -> Result<T, String>;

/// Reads the file `path`, a kind of input, with the reader of its extension. `system` is that of an option.
///
/// # Errors
/// If no reader has its extension, the file cannot be read, or its reader refuses it.
pub fn read<T>(
    what: &'static str,
    path: &Path,
    system: Option<&ReferenceSystem>,
    formats: &[(&str, ReadFormat<T>)],
) -> Result<T, InputError> {
    let refuse = |message: String| InputError::new(what, path, message);
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default().to_lowercase();
    let names = formats.iter().map(|(name, _)| format!(".{name}")).collect::<Vec<_>>().join(", ");
    let format = formats.iter().find(|(name, _)| *name == extension);
    let (_, reader) = format.ok_or_else(|| refuse(format!("`.{extension}`: expected a file named {names}")))?;
    let bytes = read_bytes(what, path)?;
    let (bytes, others) = if extension == KMZ { text::unzip(&bytes).map_err(refuse)? } else { (bytes, Vec::new()) };
    let beside = ReferenceSystem::beside(path);
    let system = system.or(beside.as_ref());
    let read = text::decode(&bytes).and_then(|text| reader(&SourceText { text: &text, system, others }));
    read.map_err(|message| match beside.as_ref().filter(|system| !system.is_wgs84()) {
        Some(system) if !message.contains(&system.to_string()) => refuse(format!("{message} ({system})")),
        _ => refuse(message),
    })
}

/// Checks the range of a latitude and a longitude.
///
/// # Errors
/// If one is out of range, with what was expected, and the probable cause.
pub fn check_geodetic([lat_deg, lon_deg]: [f64; 2]) -> Result<(), String> {
    let is_latitude = |deg: f64| (-90.0..=90.0).contains(&deg);
    let is_longitude = |deg: f64| (-180.0..=180.0).contains(&deg);
    let cause = if is_longitude(lat_deg) && is_latitude(lon_deg) {
        "; are latitude and longitude swapped?"
    } else if lat_deg.abs().max(lon_deg.abs()) > 360.0 {
        "; no degrees of WGS84 (EPSG:4326), but metres of a projection such as UTM (--crs of `skysink new`)?"
    } else {
        ""
    };
    if !is_latitude(lat_deg) {
        return Err(format!("latitude {lat_deg}: expected -90 to 90{cause}"));
    }
    if !is_longitude(lon_deg) {
        return Err(format!("longitude {lon_deg}: expected -180 to 180{cause}"));
    }
    Ok(())
}

/// An error with its causes, on one line.
#[must_use]
pub fn with_causes(error: &dyn std::error::Error) -> String {
    let causes = std::iter::successors(error.source(), |cause| cause.source());
    let mut message = error.to_string();
    for cause in causes.map(ToString::to_string) {
        if !message.contains(&cause) {
            message = format!("{message}: {cause}");
        }
    }
    message
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_an_unknown_format_is_refused() {
        let error =
            read("zones", Path::new("a.shp"), None, &[("kml", kml::find), ("json", geojson::find)]).unwrap_err();
        assert_eq!(error.to_string(), "zones a.shp: `.shp`: expected a file named .kml, .json");
    }
}
