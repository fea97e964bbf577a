//! Positions of sensor nodes from the files of other programs: CSV with any columns, KML, GPX and GeoJSON.
//!
//! Each format has a file, and returns points; what becomes of them is left to the caller.

mod csv;
mod geojson;
mod gpx;
mod kml;
mod xml;

use std::path::Path;

use skysink_common::error::{InputError, read_text};

/// What is refused.
const WHAT: &str = "sensor positions";

/// Formats by the end of a file's name, with their readers.
const FORMATS: [(&str, Reader); 5] =
    [("csv", csv::read), ("kml", kml::read), ("gpx", gpx::read), ("geojson", geojson::read), ("json", geojson::read)];

/// Reads the text of a file; the error says where, what is there and what was expected.
type Reader = fn(&str) -> Result<Imported, String>;

/// Longitudes that are so far apart are one [°].
const FULL_CIRCLE_DEG: f64 = 360.0;

/// The frame of imported positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Frame {
    /// East and north [m].
    Plane,
    /// Latitude and longitude on WGS84 [°].
    Geodetic,
}

/// What a file says of one sensor node.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportedSensor {
    /// Where the file says so, such as `line 3` or `point 2`.
    pub place: String,
    /// x and y [m], or latitude and longitude [°].
    pub position: [f64; 2],
    /// Further columns of a sensor list, as they are written there.
    pub others: Vec<String>,
}

/// The sensor nodes of a file, in its order.
#[derive(Debug, Clone, PartialEq)]
pub struct Imported {
    /// The frame of all positions.
    pub frame: Frame,
    /// The sensor nodes.
    pub sensors: Vec<ImportedSensor>,
    /// Names of the further columns that the file has.
    pub others: Vec<&'static str>,
    /// What was left out of the file, for people.
    pub ignored: Vec<String>,
}

/// The points of a file, by latitude and longitude [°], and how many items it holds that carry none.
#[derive(Default)]
struct FoundPoints {
    points: Vec<[f64; 2]>,
    ignored: usize,
}

impl Imported {
    /// Points by latitude and longitude [°] and nothing else.
    fn geodetic(FoundPoints { points, ignored }: FoundPoints) -> Result<Self, String> {
        let mut sensors = Vec::with_capacity(points.len());
        for (position, number) in points.into_iter().zip(1..) {
            let place = format!("point {number}");
            on_earth(position).map_err(|message| format!("{place}: {message}"))?;
            sensors.push(ImportedSensor { place, position, others: Vec::new() });
        }
        let ignored = (ignored > 0).then(|| format!("{ignored} lines, polygons or others that carry no point"));
        Ok(Self { frame: Frame::Geodetic, sensors, others: Vec::new(), ignored: ignored.into_iter().collect() })
    }

    /// The sensor nodes as a sensor list of Skysink, shifted by `shift` [m or °].
    #[must_use]
    pub fn to_csv(&self, shift: [f64; 2]) -> String {
        let axes = match self.frame {
            Frame::Plane => ["x_m", "y_m"],
            Frame::Geodetic => ["lat_deg", "lon_deg"],
        };
        let mut text = axes.into_iter().chain(self.others.iter().copied()).collect::<Vec<_>>().join(",") + "\n";
        for sensor in &self.sensors {
            let place = [0, 1].map(|axis| (sensor.position[axis] + shift[axis]).to_string());
            let line = place.iter().chain(&sensor.others).map(String::as_str).collect::<Vec<_>>().join(",");
            text.push_str(&(line + "\n"));
        }
        text
    }

    /// The latitude [°] of the southernmost sensor node, and the longitude [°] of the westernmost: the one behind the
    /// widest gap, wherever that is, so that a field may lie on both sides of the 180th meridian.
    #[must_use]
    pub fn south_west(&self) -> [f64; 2] {
        let mut longitudes: Vec<f64> = self.sensors.iter().map(|sensor| sensor.position[1]).collect();
        longitudes.sort_by(f64::total_cmp);
        let gaps_before = longitudes.iter().zip(longitudes.iter().cycle().skip(longitudes.len().saturating_sub(1)));
        let gap = |(east, west): &(&f64, &f64)| (**east - **west).rem_euclid(FULL_CIRCLE_DEG);
        let widest = gaps_before.max_by(|a, b| gap(a).total_cmp(&gap(b)));
        [self.bounds()[0][0], widest.map_or(f64::NAN, |(east, _)| *east)]
    }

    /// The lowest coordinates and the highest.
    #[must_use]
    pub fn bounds(&self) -> [[f64; 2]; 2] {
        let fold = |start: f64, pick: fn(f64, f64) -> f64| {
            [0, 1].map(|axis| self.sensors.iter().map(|sensor| sensor.position[axis]).fold(start, pick))
        };
        [fold(f64::INFINITY, f64::min), fold(f64::NEG_INFINITY, f64::max)]
    }
}

/// Reads the sensor nodes of the file `path`; the end of its name says the format.
///
/// # Errors
/// If the format is unknown, the file cannot be read, a position is none, or there is no point.
pub fn read(path: &Path) -> Result<Imported, InputError> {
    let refuse = |message: String| InputError::new(WHAT, path, message);
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default().to_lowercase();
    let names = FORMATS.map(|(name, _)| format!(".{name}")).join(", ");
    let format = FORMATS.into_iter().find(|(name, _)| *name == extension);
    let (_, reader) = format.ok_or_else(|| refuse(format!("`.{extension}`: expected a file named {names}")))?;
    let text = read_text(WHAT, path)?;
    let imported = reader(&text).map_err(refuse)?;
    if imported.sensors.is_empty() {
        return Err(refuse("no points: expected at least one sensor node".to_owned()));
    }
    Ok(imported)
}

/// Refuses what is no latitude and longitude.
fn on_earth([lat_deg, lon_deg]: [f64; 2]) -> Result<(), String> {
    if !(-90.0..=90.0).contains(&lat_deg) {
        return Err(format!("latitude {lat_deg}: expected -90 to 90"));
    }
    if !(-180.0..=180.0).contains(&lon_deg) {
        return Err(format!("longitude {lon_deg}: expected -180 to 180"));
    }
    Ok(())
}

/// An error with what it stems from, on one line.
fn with_causes(error: &dyn std::error::Error) -> String {
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
    fn a_list_has_the_columns_of_its_frame() {
        let place = "line 2".to_owned();
        let sensor = ImportedSensor { place, position: [1.5, -2.0], others: vec!["50".to_owned()] };
        let others = vec!["sampling_bps"];
        let mut imported = Imported { frame: Frame::Plane, sensors: vec![sensor], others, ignored: Vec::new() };
        assert_eq!(imported.to_csv([0.0, 2.0]), "x_m,y_m,sampling_bps\n1.5,0,50\n");
        imported.frame = Frame::Geodetic;
        assert!(imported.to_csv([0.0; 2]).starts_with("lat_deg,lon_deg,"));
        assert_eq!(imported.bounds(), [[1.5, -2.0]; 2]);
    }

    #[test]
    fn the_westernmost_place_lies_behind_the_widest_gap() {
        let west = |longitudes: &[f64]| {
            let points = longitudes.iter().map(|&lon_deg| [1.0, lon_deg]).collect();
            Imported::geodetic(FoundPoints { points, ignored: 0 }).unwrap().south_west()
        };
        assert_eq!(west(&[13.4, 13.1, 13.5]), [1.0, 13.1]);
        assert_eq!(west(&[-179.9, 179.8, 179.9, -179.8]), [1.0, 179.8]);
        assert_eq!(west(&[-0.1, 0.1]), [1.0, -0.1]);
        assert_eq!(west(&[180.0, -180.0])[1].abs(), 180.0);
        assert_eq!(west(&[7.0]), [1.0, 7.0]);
        assert_eq!(west(&[7.0, 7.0]), [1.0, 7.0]);
    }

    #[test]
    fn a_point_that_is_not_on_earth_is_refused_by_its_number() {
        assert_eq!(
            Imported::geodetic(FoundPoints { points: vec![[1.0, 2.0], [91.0, 0.0]], ignored: 0 }).unwrap_err(),
            "point 2: latitude 91: expected -90 to 90"
        );
        assert!(
            Imported::geodetic(FoundPoints { points: vec![[0.0, f64::NAN]], ignored: 0 })
                .unwrap_err()
                .contains("longitude NaN")
        );
        assert!(read(Path::new("a.shp")).unwrap_err().to_string().contains("`.shp`: expected a file named .csv, .kml"));
    }
}
