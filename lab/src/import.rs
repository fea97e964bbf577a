//! Imports positions of sensor nodes from CSV, KML, GPX and GeoJSON. The caller derives the scenario.

mod csv;
mod gpx;
mod ground;
mod imported;
pub mod plan;
mod referenced;

use std::path::Path;

use skysink_common::error::InputError;
use skysink_common::geodata::{self, KMZ, ReadFormat, ReferenceSystem, SourceText, geojson, kml};

pub use csv::COORDINATES;
pub use ground::GROUND;
pub use imported::{Frame, Imported, ImportedSensor, OTHERS, south_west};

/// The kind of input in error messages.
const WHAT: &str = "sensor positions";

/// File extensions with their readers.
const FORMATS: [(&str, ReadFormat<Imported>); 6] = [
    ("csv", csv::read),
    ("kml", of_kml),
    (KMZ, of_kml),
    ("gpx", gpx::read),
    ("geojson", of_geojson),
    ("json", of_geojson),
];

/// Reads the sensor nodes of the file `path`. Its extension determines the format. `system` is that of an option, for
/// positions that are not in degrees, in a file that names none.
///
/// # Errors
/// If the format is unknown, the file cannot be read, a position is invalid, or there is no point.
pub fn read(path: &Path, system: Option<&ReferenceSystem>) -> Result<Imported, InputError> {
    let imported = geodata::read(WHAT, path, system, &FORMATS)?;
    if imported.sensors.is_empty() {
        let only = if imported.ignored.is_empty() { "" } else { ", only " };
        let message = format!("no points{only}{}: expected at least one sensor node", imported.ignored.join(", "));
        return Err(InputError::new(WHAT, path, message));
    }
    Ok(imported)
}

/// Reads the sensor nodes of the text of a KML file.
fn of_kml(source: &SourceText<'_>) -> Result<Imported, String> {
    Imported::geodetic(kml::find(source)?)
}

/// Reads the sensor nodes of the text of a GeoJSON file.
fn of_geojson(source: &SourceText<'_>) -> Result<Imported, String> {
    Imported::geodetic(geojson::find(source)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_an_unknown_format_is_refused() {
        assert!(
            read(Path::new("a.shp"), None)
                .unwrap_err()
                .to_string()
                .contains("`.shp`: expected a file named .csv, .kml")
        );
    }
}
