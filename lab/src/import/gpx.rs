//! GPX: imports the waypoints; ignores tracks and routes.

use skysink_common::geodata::{FoundPoint, FoundPoints, NAME, with_causes, xml};

use super::imported::Imported;

/// Reads the text of a file.
pub fn read(text: &str) -> Result<Imported, String> {
    xml::check(text, "GPX")?;
    let file = ::gpx::read(text.as_bytes()).map_err(|error| format!("{}: expected a GPX file", with_causes(&error)))?;
    let points = file.waypoints.iter().map(|waypoint| {
        let texts = [(NAME, &waypoint.name), ("comment", &waypoint.comment), ("description", &waypoint.description)];
        let property = |(name, text): (&str, &Option<String>)| Some((name.to_owned(), text.clone()?));
        FoundPoint {
            position: [waypoint.point().y(), waypoint.point().x()],
            altitude_m: waypoint.elevation,
            properties: texts.into_iter().filter_map(property).collect(),
        }
    });
    let ignored = file.tracks.len() + file.routes.len();
    Imported::geodetic(FoundPoints { points: points.collect(), ignored, ..FoundPoints::default() })
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = "<?xml version=\"1.0\"?><gpx version=\"1.1\" creator=\"a\" \
                        xmlns=\"http://www.topografix.com/GPX/1/1\"><wpt lat=\"51.5\" lon=\"-0.1\"><name>a</name></wpt>\
                        <wpt lat=\"51.6\" lon=\"0.2\"/><trk><name>t</name></trk></gpx>";

    #[test]
    fn waypoints_are_points() {
        let imported = read(FILE).unwrap();
        let points: Vec<[f64; 2]> = imported.sensors.iter().map(|sensor| sensor.position).collect();
        assert_eq!(points, [[51.5, -0.1], [51.6, 0.2]]);
        assert_eq!(imported.ignored.len(), 1, "a track");
        assert_eq!(imported.to_csv([0.0; 2]), "lat_deg,lon_deg,name\n51.5,-0.1,a\n51.6,0.2,\n");
    }

    #[test]
    fn a_truncated_file_is_refused() {
        for cut in FILE.find("<wpt").unwrap()..FILE.len() - 1 {
            assert!(read(&FILE[..cut]).is_err(), "{}", &FILE[..cut]);
        }
    }

    #[test]
    fn invalid_gpx_is_refused() {
        assert!(read("<kml/>").unwrap_err().ends_with("expected a GPX file"));
        assert!(read(&FILE.replace("51.5", "north")).is_err());
        assert!(read(&FILE.replace("51.5", "95")).is_err());
    }
}
