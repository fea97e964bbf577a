//! From the coordinates of a table to latitude and longitude, by the reference system that its source is said to have.

use skysink_common::geodata::{Coordinates, ReferenceSystem};

use super::imported::{Frame, Imported};

impl Imported {
    /// The table with latitudes and longitudes of WGS84 if its positions are in a known `system`: all in columns x and
    /// y, and those in columns of degrees if the system is in degrees, too. Otherwise as it is.
    ///
    /// # Errors
    /// If metres are in a system that is not known, are no metres, or a position is not in the system.
    pub(super) fn through(mut self, system: Option<&ReferenceSystem>) -> Result<Self, String> {
        let Some(system) = system else { return Ok(self) };
        let is_plane = self.frame == Frame::Plane;
        match &system.coordinates {
            Coordinates::Unknown(reason) if is_plane => return Err(system.refusal(reason)),
            Coordinates::Local(Err(reason)) if is_plane => {
                return Err(format!("{system}: {reason}: expected metres, or latitudes and longitudes"));
            }
            Coordinates::OnEarth(on_earth) if is_plane || (on_earth.is_in_degrees() && !system.is_wgs84()) => {
                for sensor in &mut self.sensors {
                    let [first, second] = sensor.position;
                    let read = on_earth.to_geodetic(if is_plane { [first, second] } else { [second, first] });
                    sensor.position = read.map_err(|message| format!("{}: {message} ({system})", sensor.place))?;
                }
                self.frame = Frame::Geodetic;
                self.system = Some(system.clone());
            }
            _ => {}
        }
        Ok(self)
    }
}

#[cfg(test)]
mod tests {
    use skysink_common::geodata::SourceText;

    use super::super::csv;
    use super::*;

    /// A table in the system of a code.
    fn read(code: &str, text: &str) -> Result<Imported, String> {
        let system = ReferenceSystem::of_name(&format!("EPSG:{code}")).unwrap();
        csv::read(&SourceText { text, system: Some(&system), others: Vec::new() })
    }

    /// The position of the only row [°].
    fn position(code: &str, text: &str) -> [f64; 2] {
        let imported = read(code, text).unwrap();
        assert_eq!(imported.frame, Frame::Geodetic);
        imported.sensors[0].position
    }

    #[test]
    fn metres_and_feet_of_maps_become_degrees() {
        // By PROJ 9: pyproj.Transformer.from_crs(code, 4326, always_xy=True), at 1 cm, 9e-8°.
        for (code, text, expected) in [
            ("25832", "POINT_X,POINT_Y\n681421.23,5777697.61\n", [52.119_999_963, 11.650_000_031]),
            ("25832", "northing;easting [m]\n5777697,61;681421,23\n", [52.119_999_963, 11.650_000_031]),
            ("32733", "x,y\n500000,6500000\n", [-31.635_186_220, 15.0]),
            ("2263", "x [ft],y [ft]\n987000,200000\n", [40.715_630_071, -73.990_079_931]),
            ("3857", "x,y\n1300000,6800000\n", [51.999_306_159, 11.678_098_694]),
            ("4326", "x,y\n11.65,52.12\n", [52.12, 11.65]),
            ("4258", "lat,lon\n52.12,11.65\n", [52.12, 11.65]),
        ] {
            let found = position(code, text);
            let error = found.iter().zip(expected).map(|(found, expected)| (found - expected).abs());
            assert!(error.fold(0.0, f64::max) < 9e-8, "EPSG:{code}: {found:?}, not {expected:?}");
        }
    }

    #[test]
    fn degrees_stay_degrees_beside_a_map() {
        let imported = read("25832", "lat,lon\n52.12,11.65\n").unwrap();
        assert_eq!((imported.sensors[0].position, imported.system), ([52.12, 11.65], None));
    }

    #[test]
    fn positions_that_are_not_of_the_map_are_refused_by_line() {
        for (code, text, message) in [
            (
                "25832",
                "x,y\n11.65,52.12\n",
                "line 2: 11.65, 52.12: expected lengths of a map, not degrees (EPSG:25832)",
            ),
            ("25832", "x,y\n681421,5777697\n7e7,7e7\n", "line 3: 70000000, 70000000: expected a position of its ref"),
            ("25832", "x [ft],y [ft]\n681421,5777697\n", "line 1: column `x [ft]`: its unit: expected m, of x_m"),
            ("2263", "x [m],y [m]\n987000,200000\n", "line 1: column `x [m]`: its unit: expected ft, of x_ft"),
        ] {
            let refused = read(code, text).unwrap_err();
            assert!(refused.starts_with(message), "{refused}");
        }
    }
}
