//! The sensor nodes that were found in a file, in the frame of the file.

use skysink_common::error::quoted;

/// Longitudes are equal modulo this angle [°].
const FULL_CIRCLE_DEG: f64 = 360.0;

/// The frame of imported positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Frame {
    /// East and north [m].
    Plane,
    /// Latitude and longitude on WGS84 [°].
    Geodetic,
}

/// An imported sensor node.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportedSensor {
    /// Its location in the file, such as `line 3` or `point 2`.
    pub place: String,
    /// x and y [m], or latitude and longitude [°].
    pub position: [f64; 2],
    /// Values of further columns of the sensor list.
    pub others: Vec<String>,
}

/// The sensor nodes of a file, in its order.
#[derive(Debug, Clone, PartialEq)]
pub struct Imported {
    /// The frame of all positions.
    pub frame: Frame,
    /// The sensor nodes.
    pub sensors: Vec<ImportedSensor>,
    /// Names of the further columns.
    pub others: Vec<&'static str>,
    /// Descriptions of ignored content.
    pub ignored: Vec<String>,
}

/// The further columns of a sensor list, each followed by its aliases in imported files, in lower case.
pub const OTHERS: [&[&str]; 4] = [
    &["queue_bits", "queue"],
    &["gain_db", "gain"],
    &["sampling_bps", "sampling_rate", "sampling", "rate_bps", "rate"],
    &[NAME, "label"],
];

/// The column of [`OTHERS`] that is no number.
pub const NAME: &str = "name";

/// The further column of a sensor list that a column or property called `name` is for.
pub fn other(name: &str) -> Option<&'static str> {
    let name = name.to_lowercase();
    OTHERS.iter().find(|names| names.contains(&name.as_str())).map(|names| names[0])
}

/// Most properties that a note names.
const MOST_NAMED: usize = 10;

/// A point of a file.
#[derive(Debug, Clone, Default)]
pub struct FoundPoint {
    /// Latitude and longitude [°].
    pub position: [f64; 2],
    /// Its altitude, 0 without one.
    pub altitude: f64,
    /// Names and values of its properties.
    pub properties: Vec<(String, String)>,
}

/// The points of a file, and the number of ignored items.
#[derive(Default)]
pub struct FoundPoints {
    /// The points.
    pub points: Vec<FoundPoint>,
    /// The number of ignored items.
    pub ignored: usize,
}

impl FoundPoint {
    /// The value of a further column, if it has one.
    fn value(&self, column: &'static str) -> Result<Option<&str>, String> {
        let mut found = self.properties.iter().filter(|(name, _)| other(name) == Some(column));
        let value = found.next().map(|(_, value)| value.trim());
        if let Some((again, _)) = found.next() {
            return Err(format!("property {}: expected {column} once", quoted(again)));
        }
        let Some(value) = value.filter(|value| !value.is_empty()) else { return Ok(None) };
        if column != NAME && !value.parse().is_ok_and(f64::is_finite) {
            return Err(format!("{column} = {}: expected a number", quoted(value)));
        }
        Ok(Some(value))
    }
}

impl Imported {
    /// Sensor nodes with latitude and longitude [°], and the properties that a sensor list has columns for.
    pub fn geodetic(FoundPoints { points, ignored }: FoundPoints) -> Result<Self, String> {
        let place = |index: usize| format!("point {}", index + 1);
        let mut sensors = Vec::with_capacity(points.len());
        for (index, point) in points.iter().enumerate() {
            check_geodetic(point.position).map_err(|message| format!("{}: {message}", place(index)))?;
            sensors.push(ImportedSensor { place: place(index), position: point.position, others: Vec::new() });
        }
        let mut others = Vec::new();
        for column in OTHERS.map(|names| names[0]) {
            let values: Vec<Option<&str>> = points
                .iter()
                .enumerate()
                .map(|(index, point)| point.value(column).map_err(|message| format!("{}: {message}", place(index))))
                .collect::<Result<_, String>>()?;
            if values.iter().all(Option::is_none) {
                continue;
            }
            let missing = values.iter().position(Option::is_none).filter(|_| column != NAME);
            if let Some(index) = missing {
                return Err(format!("{}: no {column}: expected it of all points, or of none", place(index)));
            }
            others.push(column);
            for (sensor, value) in sensors.iter_mut().zip(values) {
                sensor.others.push(value.unwrap_or_default().to_owned());
            }
        }
        let items = (ignored > 0).then(|| format!("{ignored} lines, polygons or other items without a point"));
        let high = points.iter().filter(|point| point.altitude != 0.0).count();
        let high = (high > 0).then(|| format!("altitudes of {high} points (sensor nodes stand on the ground)"));
        let names = points.iter().flat_map(|point| &point.properties).map(|(name, _)| name);
        let mut names: Vec<String> = names.filter(|name| other(name).is_none()).map(|name| quoted(name)).collect();
        names.sort();
        names.dedup();
        let more = names.len().saturating_sub(MOST_NAMED);
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        names.truncate(MOST_NAMED);
        let properties = (!names.is_empty()).then(|| format!("properties {}{more}", names.join(", ")));
        let ignored = [items, high, properties].into_iter().flatten().collect();
        Ok(Self { frame: Frame::Geodetic, sensors, others, ignored })
    }

    /// The sensor list (CSV) of Skysink with all positions translated by `shift` [m or °].
    #[must_use]
    pub fn to_csv(&self, shift: [f64; 2]) -> String {
        let axes = match self.frame {
            Frame::Plane => ["x_m", "y_m"],
            Frame::Geodetic => ["lat_deg", "lon_deg"],
        };
        let mut text = axes.into_iter().chain(self.others.iter().copied()).collect::<Vec<_>>().join(",") + "\n";
        for sensor in &self.sensors {
            let place = [0, 1].map(|axis| (sensor.position[axis] + shift[axis]).to_string());
            let cell = |text: &String| {
                let needs_quotes = text.contains([',', '"']);
                if needs_quotes { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.clone() }
            };
            let line = place.iter().chain(&sensor.others).map(cell).collect::<Vec<_>>().join(",");
            text.push_str(&(line + "\n"));
        }
        text
    }

    /// The latitude [°] of the southernmost sensor node and the longitude [°] of the westernmost one. The westernmost
    /// node is the one east of the widest gap, so that a field may cross the 180th meridian.
    #[must_use]
    pub fn south_west(&self) -> [f64; 2] {
        let mut longitudes: Vec<f64> = self.sensors.iter().map(|sensor| sensor.position[1]).collect();
        longitudes.sort_by(f64::total_cmp);
        let gaps_before = longitudes.iter().zip(longitudes.iter().cycle().skip(longitudes.len().saturating_sub(1)));
        let gap = |(east, west): &(&f64, &f64)| (**east - **west).rem_euclid(FULL_CIRCLE_DEG);
        let widest = gaps_before.max_by(|a, b| gap(a).total_cmp(&gap(b)));
        [self.bounds()[0][0], widest.map_or(f64::NAN, |(east, _)| *east)]
    }

    /// The lower and upper corner of the bounding box.
    #[must_use]
    pub fn bounds(&self) -> [[f64; 2]; 2] {
        let fold = |start: f64, pick: fn(f64, f64) -> f64| {
            [0, 1].map(|axis| self.sensors.iter().map(|sensor| sensor.position[axis]).fold(start, pick))
        };
        [fold(f64::INFINITY, f64::min), fold(f64::NEG_INFINITY, f64::max)]
    }
}

/// Checks the range of a latitude and a longitude.
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

    fn point(position: [f64; 2], properties: &[(&str, &str)]) -> FoundPoint {
        let properties = properties.iter().map(|(name, value)| [name, value].map(|text| (*text).to_owned()).into());
        FoundPoint { position, altitude: 0.0, properties: properties.collect() }
    }

    fn imported(points: &[FoundPoint]) -> Result<Imported, String> {
        Imported::geodetic(FoundPoints { points: points.to_vec(), ignored: 0 })
    }

    #[test]
    fn properties_become_columns_and_the_rest_is_listed() {
        let one = point([1.0, 2.0], &[("Rate", "50"), ("name", "a, \"b\""), ("colour", "red"), ("height", "3")]);
        let other = FoundPoint { altitude: 12.0, ..point([1.0, 3.0], &[("rate", "60.5"), ("colour", "blue")]) };
        let both = imported(&[one, other]).unwrap();
        let list = "lat_deg,lon_deg,sampling_bps,name\n1,2,50,\"a, \"\"b\"\"\"\n1,3,60.5,\n";
        assert_eq!(both.to_csv([0.0; 2]), list);
        let ignored = ["altitudes of 1 points (sensor nodes stand on the ground)", "properties colour, height"];
        assert_eq!(both.ignored, ignored);
    }

    #[test]
    fn a_property_that_is_no_number_or_missing_or_twice_is_refused_by_its_point() {
        let refused = |points: &[&[(&str, &str)]]| {
            let points: Vec<FoundPoint> = points.iter().map(|properties| point([1.0, 2.0], properties)).collect();
            imported(&points).unwrap_err()
        };
        assert_eq!(
            refused(&[&[("rate", "1")], &[("rate", "fast")]]),
            "point 2: sampling_bps = fast: expected a number"
        );
        assert_eq!(
            refused(&[&[("rate", "1")], &[]]),
            "point 2: no sampling_bps: expected it of all points, or of none"
        );
        assert_eq!(
            refused(&[&[("rate", "1"), ("sampling", "1")]]),
            "point 1: property sampling: expected sampling_bps once"
        );
    }

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
    fn the_westernmost_point_is_east_of_the_widest_gap() {
        let west = |longitudes: &[f64]| {
            let points = longitudes.iter().map(|&lon_deg| point([1.0, lon_deg], &[])).collect();
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
    fn a_point_with_invalid_coordinates_is_refused_by_its_number() {
        assert_eq!(
            imported(&[point([1.0, 2.0], &[]), point([91.0, 0.0], &[])]).unwrap_err(),
            "point 2: latitude 91: expected -90 to 90"
        );
        assert!(imported(&[point([0.0, f64::NAN], &[])]).unwrap_err().contains("longitude NaN"));
    }
}
