//! Imports positions of sensor nodes from CSV, KML, GPX and GeoJSON.
//!
//! Each format has its own file and returns points. The caller derives the scenario.

mod csv;
mod geojson;
mod gpx;
mod imported;
mod kml;
mod xml;

use std::path::Path;

use skysink_common::error::{InputError, read_text};

pub use imported::{Frame, Imported, ImportedSensor};

/// The kind of input in error messages.
const WHAT: &str = "sensor positions";

/// File extensions with their readers.
const FORMATS: [(&str, ReadFormat); 5] =
    [("csv", csv::read), ("kml", kml::read), ("gpx", gpx::read), ("geojson", geojson::read), ("json", geojson::read)];

/// Reads the text of a file. The error contains location, value and expectation.
type ReadFormat = fn(&str) -> Result<Imported, String>;

/// Reads the sensor nodes of the file `path`. Its extension determines the format.
///
/// # Errors
/// If the format is unknown, the file cannot be read, a position is invalid, or there is no point.
pub fn read(path: &Path) -> Result<Imported, InputError> {
    let refuse = |message: String| InputError::new(WHAT, path, message);
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default().to_lowercase();
    let names = FORMATS.map(|(name, _)| format!(".{name}")).join(", ");
    let format = FORMATS.into_iter().find(|(name, _)| *name == extension);
    let (_, reader) = format.ok_or_else(|| refuse(format!("`.{extension}`: expected a file named {names}")))?;
    let text = read_text(WHAT, path)?;
    let imported = reader(text.trim_start_matches('\u{feff}')).map_err(refuse)?; // without the byte order mark
    if imported.sensors.is_empty() {
        return Err(refuse("no points: expected at least one sensor node".to_owned()));
    }
    Ok(imported)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_an_unknown_format_is_refused() {
        assert!(read(Path::new("a.shp")).unwrap_err().to_string().contains("`.shp`: expected a file named .csv, .kml"));
    }
}
