//! Files of geodetic positions: the points and polygons of GeoJSON and KML, and the zones among them.
//!
//! Each format has its own file; `projection` leads into the plane of an area and back. What the points and polygons
//! mean is left to the callers.

pub mod geojson;
pub mod kml;
pub mod projection;
pub mod xml;
mod zones;

use std::path::Path;

use crate::error::{InputError, read_text};

pub use zones::{Zone, ZoneKind, read_zones};

/// The property that names a point or a polygon.
pub const NAME: &str = "name";

/// A point of a file.
#[derive(Debug, Clone, Default)]
pub struct FoundPoint {
    /// Latitude and longitude [°].
    pub position: [f64; 2],
    /// Its altitude above sea level or the ellipsoid [m].
    pub altitude_m: Option<f64>,
    /// Names and values of its properties.
    pub properties: Vec<(String, String)>,
}

/// A polygon as found: its rings, the outer one first, and its properties.
#[derive(Debug, Clone, Default)]
pub struct FoundPolygon {
    /// Latitude and longitude [°] of the corners of each ring.
    pub rings: Vec<Vec<[f64; 2]>>,
    /// The height to which its sides are drawn [m].
    pub extruded_m: Option<f64>,
    /// Names and values of its properties.
    pub properties: Vec<(String, String)>,
}

/// The points and polygons of a file, and the number of items without a point.
#[derive(Debug, Default)]
pub struct FoundPoints {
    /// The points.
    pub points: Vec<FoundPoint>,
    /// The polygons.
    pub polygons: Vec<FoundPolygon>,
    /// The number of items without a point.
    pub ignored: usize,
}

/// Reads the text of a file. The error contains location, value and expectation.
pub type ReadFormat<T> = fn(&str) -> Result<T, String>;

/// Reads the file `path`, a kind of input, with the reader of its extension.
///
/// # Errors
/// If no reader has its extension, the file cannot be read, or its reader refuses it.
pub fn read<T>(what: &'static str, path: &Path, formats: &[(&str, ReadFormat<T>)]) -> Result<T, InputError> {
    let refuse = |message: String| InputError::new(what, path, message);
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default().to_lowercase();
    let names = formats.iter().map(|(name, _)| format!(".{name}")).collect::<Vec<_>>().join(", ");
    let format = formats.iter().find(|(name, _)| *name == extension);
    let (_, reader) = format.ok_or_else(|| refuse(format!("`.{extension}`: expected a file named {names}")))?;
    let text = read_text(what, path)?;
    reader(text.trim_start_matches('\u{feff}')).map_err(refuse) // without the byte order mark
}

/// Checks the range of a latitude and a longitude.
///
/// # Errors
/// If one is out of range, with what was expected.
pub fn check_geodetic([lat_deg, lon_deg]: [f64; 2]) -> Result<(), String> {
    if !(-90.0..=90.0).contains(&lat_deg) {
        return Err(format!("latitude {lat_deg}: expected -90 to 90"));
    }
    if !(-180.0..=180.0).contains(&lon_deg) {
        return Err(format!("longitude {lon_deg}: expected -180 to 180"));
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
        let error = read("zones", Path::new("a.shp"), &[("kml", kml::find), ("json", geojson::find)]).unwrap_err();
        assert_eq!(error.to_string(), "zones a.shp: `.shp`: expected a file named .kml, .json");
    }
}
