//! Imports positions of sensor nodes from CSV, KML, GPX and GeoJSON, zones from KML and GeoJSON, and maps from pictures.
//!
//! Each format has its own file and returns points and polygons. The caller derives the scenario.

mod csv;
mod geojson;
mod gpx;
mod imported;
mod kml;
mod picture;
mod xml;
mod zones;

use std::path::Path;

use skysink_common::error::{InputError, read_bytes, read_text};

use imported::FoundPoints;
pub use imported::{Frame, Imported, ImportedSensor};
pub use picture::MapPicture;
pub use zones::{ImportedZone, ZoneKind};

/// The kind of input in error messages.
const WHAT: &str = "sensor positions";

/// File extensions with their readers.
const FORMATS: [(&str, ReadFormat<Imported>); 5] =
    [("csv", csv::read), ("kml", kml::read), ("gpx", gpx::read), ("geojson", geojson::read), ("json", geojson::read)];

/// File extensions with their readers of zones.
const ZONE_FORMATS: [(&str, ReadFormat<FoundPoints>); 3] =
    [("kml", kml::find), ("geojson", geojson::find), ("json", geojson::find)];

/// Reads the text of a file. The error contains location, value and expectation.
type ReadFormat<T> = fn(&str) -> Result<T, String>;

/// Reads the sensor nodes of the file `path`. Its extension determines the format.
///
/// # Errors
/// If the format is unknown, the file cannot be read, a position is invalid, or there is no point.
pub fn read(path: &Path) -> Result<Imported, InputError> {
    let imported = find(WHAT, path, &FORMATS)?;
    if imported.sensors.is_empty() {
        return Err(InputError::new(WHAT, path, "no points: expected at least one sensor node"));
    }
    Ok(imported)
}

/// Reads the polygons of the file `path`, KML or GeoJSON.
///
/// # Errors
/// If the format is unknown, the file cannot be read, a polygon has a hole or an invalid position, or there is none.
pub fn read_zones(path: &Path) -> Result<Vec<ImportedZone>, InputError> {
    let found = find("zones", path, &ZONE_FORMATS)?;
    zones::zones(&found).map_err(|message| InputError::new("zones", path, message))
}

/// Reads the map in the picture `path`, PNG.
///
/// # Errors
/// If the file cannot be read, is no PNG picture, is larger than 1000 × 1000 pixels, or has no free pixel.
pub fn read_picture(path: &Path) -> Result<MapPicture, InputError> {
    let bytes = read_bytes("map", path)?;
    picture::read(&bytes).map_err(|message| InputError::new("map", path, message))
}

/// Reads the file `path`, a kind of input, with the reader of its extension.
fn find<T>(what: &'static str, path: &Path, formats: &[(&str, ReadFormat<T>)]) -> Result<T, InputError> {
    let refuse = |message: String| InputError::new(what, path, message);
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default().to_lowercase();
    let names = formats.iter().map(|(name, _)| format!(".{name}")).collect::<Vec<_>>().join(", ");
    let format = formats.iter().find(|(name, _)| *name == extension);
    let (_, reader) = format.ok_or_else(|| refuse(format!("`.{extension}`: expected a file named {names}")))?;
    let text = read_text(what, path)?;
    reader(text.trim_start_matches('\u{feff}')).map_err(refuse) // without the byte order mark
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_an_unknown_format_is_refused() {
        assert!(read(Path::new("a.shp")).unwrap_err().to_string().contains("`.shp`: expected a file named .csv, .kml"));
    }
}
