//! Files of other programs: positions of sensor nodes, zones and arrays of links.

use skysink_common::channel::LinkMap;
use skysink_common::geodata::projection::{Origin, Projection};
use skysink_common::geodata::{Zone, check_geodetic, read_zones};
use skysink_lab::import::{self, Frame};

use crate::world::{assert_one_line, file};

/// A file is refused in one line, or all that is read of it is in range. The first line of the input is its extension.
pub fn files(bytes: &[u8]) {
    let Some(end) = bytes.iter().position(|&byte| byte == b'\n') else { return };
    let extensions = ["csv", "kml", "kmz", "gpx", "geojson", "npz"];
    let Some(extension) = extensions.iter().find(|extension| extension.as_bytes() == &bytes[..end]) else { return };
    let text = &bytes[end + 1..];
    let path = file(&format!("import.{extension}"), text);
    if *extension == "npz" {
        let read = LinkMap::read(&path, None).map(|map| assert!(map.has_rates()));
        return read.unwrap_or_else(|error| assert_one_line(&error));
    }
    let has = |word: &str| text.windows(word.len()).any(|found| found.eq_ignore_ascii_case(word.as_bytes()));
    let refused = |message: &str| assert!(!message.contains("NaN") || has("nan") || has("&#"), "{message}");
    match import::read(&path, None) {
        Err(error) => {
            assert_one_line(&error);
            refused(&error.message);
        }
        Ok(imported) => {
            for sensor in &imported.sensors {
                assert!(sensor.position.iter().all(|coordinate| coordinate.is_finite()), "{sensor:?}");
                assert_eq!(sensor.others.len(), imported.others.len());
                if imported.frame == Frame::Geodetic {
                    check_geodetic(sensor.position).expect("imported degrees are in range");
                }
            }
            assert!(imported.to_csv([0.0; 2]).lines().count() > imported.sensors.len());
        }
    }
    match read_zones(&path, None) {
        Err(error) => {
            assert_one_line(&error);
            refused(&error.message);
        }
        Ok(read) => read.zones.iter().for_each(|zone| outline(zone, &path)),
    }
}

/// The corners of a zone are in range, and become a polygon or are refused in one line.
fn outline(zone: &Zone, path: &std::path::Path) {
    zone.corners.iter().for_each(|corner| check_geodetic(*corner).expect("corners are in range"));
    let [lat_deg, lon_deg] = *zone.corners.first().expect("a zone has corners");
    match zone.corners_m(&Projection::at(Origin { lat_deg, lon_deg }), path) {
        Err(error) => assert_one_line(&error),
        Ok(corners_m) => assert!(corners_m.len() >= 3 && corners_m.iter().flatten().all(|along| along.is_finite())),
    }
}
