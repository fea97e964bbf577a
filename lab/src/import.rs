//! Imports positions of sensor nodes from CSV, KML, GPX and GeoJSON, links from flight logs, and the ground from grids of
//! heights. The caller derives the scenario.

mod csv;
mod flight_log;
mod gpx;
mod imported;
mod measured;
mod outlines;
mod terrain;

use std::path::Path;

use skysink_common::error::InputError;
use skysink_common::geodata::{self, KMZ, ReadFormat, geojson, kml};

pub use csv::COORDINATES;
pub use flight_log::{FlightLog, LogRow};
pub use imported::{Frame, GROUND, Imported, ImportedSensor, OTHERS, south_west};
pub use measured::{FittedLaw, MapGrid, Measured, MeasuredBin};
pub use outlines::{CellOutline, outlines};
pub use terrain::HeightGrid;

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

/// Reads the sensor nodes of the file `path`. Its extension determines the format.
///
/// # Errors
/// If the format is unknown, the file cannot be read, a position is invalid, or there is no point.
pub fn read(path: &Path) -> Result<Imported, InputError> {
    let imported = geodata::read(WHAT, path, &FORMATS)?;
    if imported.sensors.is_empty() {
        let only = if imported.ignored.is_empty() { "" } else { ", only " };
        let message = format!("no points{only}{}: expected at least one sensor node", imported.ignored.join(", "));
        return Err(InputError::new(WHAT, path, message));
    }
    Ok(imported)
}

/// Reads the sensor nodes of the text of a KML file.
fn of_kml(text: &str) -> Result<Imported, String> {
    Imported::geodetic(kml::find(text)?)
}

/// Reads the sensor nodes of the text of a GeoJSON file.
fn of_geojson(text: &str) -> Result<Imported, String> {
    Imported::geodetic(geojson::find(text)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_an_unknown_format_is_refused() {
        assert!(read(Path::new("a.shp")).unwrap_err().to_string().contains("`.shp`: expected a file named .csv, .kml"));
    }
}
