//! The sensor nodes that were found in a file, in the frame of the file.

use skysink_common::error::quoted;
use skysink_common::geodata::{FoundPoint, FoundPoints, IgnoredItem, KIND, NAME, ReferenceSystem, check_geodetic};
use skysink_common::sensors::check_name;

use super::ground::{self, GROUND, GROUND_FT};

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

/// Farthest from the origin along an axis [m]: more than two ways around the Earth.
const MOST_M: f64 = 1e8;

impl Frame {
    /// Checks two coordinates.
    ///
    /// # Errors
    /// If one is out of range, with what was expected.
    pub fn check(self, position: [f64; 2]) -> Result<(), String> {
        match self {
            Self::Geodetic => check_geodetic(position),
            Self::Plane => match position.iter().find(|along_m| along_m.abs() > MOST_M) {
                Some(along_m) => Err(format!("{along_m:e} m: expected -{MOST_M:e} to {MOST_M:e}")),
                None => Ok(()),
            },
        }
    }
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
    /// The system that the positions were converted from; `None` if they are as in the file.
    pub system: Option<ReferenceSystem>,
}

/// The further columns of a sensor list, each followed by its aliases in imported files, in lower
/// case, with underscores.
pub const OTHERS: [&[&str]; 7] = [
    &["queue_bits", "queue"],
    &["gain_db", "gain"],
    &["sampling_bps", "sampling_rate", "sampling", "rate_bps", "rate"],
    &["capacity_bits", "buffer_bits", "buffer_size", "buffer"],
    &["weight", "priority"],
    &[GROUND, "ground", GROUND_FT],
    &[NAME, "label"],
];

/// Columns, in lower case, with underscores, that name the sensor nodes of a file without names.
pub const IDS: [&str; 6] = ["id", "sensor_id", "sensorid", "node_id", "nodeid", "node"];

/// A name in lower case, with underscores instead of spaces and hyphens.
pub fn plain(name: &str) -> String {
    name.to_lowercase().replace([' ', '-'], "_")
}

/// The further column of a sensor list that a column or property called `name` is for.
pub fn other(name: &str) -> Option<&'static str> {
    let name = plain(name);
    OTHERS.iter().find(|names| names.contains(&name.as_str())).map(|names| names[0])
}

/// Why writing a list cannot fail.
const IN_MEMORY: &str = "memory takes everything, and all rows are of one length";

/// Most properties that a note names.
const MOST_NAMED: usize = 10;

/// The index of the property of `point` for a further column: the first of the column's `names` that is not empty.
fn property(point: &FoundPoint, names: &[&str]) -> Option<usize> {
    let is_given = |value: &str| !value.trim().is_empty();
    let called =
        |alias: &&str| point.properties.iter().position(|(name, value)| plain(name) == **alias && is_given(value));
    names.iter().find_map(called)
}

/// The value of the property of `point` at an index, without a line break.
fn value(point: &FoundPoint, index: usize) -> String {
    let (name, value) = &point.properties[index];
    let value = value.split_whitespace().collect::<Vec<_>>().join(" ");
    if plain(name) == GROUND_FT { ground::in_metres(&value) } else { value }
}

pub fn is_number(value: &str) -> bool {
    value.parse().is_ok_and(f64::is_finite)
}

/// Whether a point is a sensor node of a file that `skysink export` wrote.
fn is_own_node(point: &FoundPoint) -> bool {
    point.properties.iter().any(|(name, value)| name == KIND && value == "sensor node")
}

impl Imported {
    /// Sensor nodes with latitude and longitude [°], and the properties that a sensor list has columns for. The heights
    /// of points are not taken: no format says that they are those of the ground. If some are of the kind `sensor
    /// node`, as in files of `skysink export`, the others are ignored.
    pub fn geodetic(mut found: FoundPoints) -> Result<Self, String> {
        let polygons: Vec<IgnoredItem> = found.ignored_polygons().collect();
        found.ignored.extend(polygons);
        let FoundPoints { mut points, mut ignored, system, .. } = found;
        // Of what `skysink export` writes, only some points are sensor nodes.
        if points.iter().any(is_own_node) {
            let others = points.extract_if(.., |point| !is_own_node(point));
            ignored.extend(others.map(|_| IgnoredItem { kind: "point that is no sensor node", name: None }));
            points.iter_mut().for_each(|point| point.properties.retain(|(name, _)| name != KIND && name != "id"));
        }
        let place = |index: usize| format!("point {}", index + 1);
        let mut sensors = Vec::with_capacity(points.len());
        for (index, point) in points.iter().enumerate() {
            check_geodetic(point.position).map_err(|message| format!("{}: {message}", place(index)))?;
            sensors.push(ImportedSensor { place: place(index), position: point.position, others: Vec::new() });
        }
        let mut others = Vec::new();
        let mut unread: Vec<Vec<bool>> = points.iter().map(|point| vec![true; point.properties.len()]).collect();
        let mut reasons: Vec<String> = ground::ignored_heights(&points).into_iter().collect();
        for names in OTHERS {
            let column = names[0];
            let mut found: Vec<Option<usize>> = points.iter().map(|point| property(point, names)).collect();
            if column == NAME && found.iter().all(Option::is_none) {
                found = points.iter().map(|point| property(point, &IDS)).collect();
            }
            if found.iter().all(Option::is_none) {
                continue;
            }
            let values: Vec<String> = points
                .iter()
                .zip(&found)
                .map(|(point, found)| found.map_or_else(String::new, |index| value(point, index)))
                .collect();
            if column == NAME {
                for (index, name) in values.iter().enumerate() {
                    check_name(name).map_err(|message| format!("{}: {message}", place(index)))?;
                }
            } else if let Some(index) = values.iter().position(|value| !is_number(value)) {
                let has_value = |value: &String| !(value.is_empty() || column == GROUND && ground::is_missing(value));
                let is_measured = values.iter().all(has_value) && values.iter().any(|value| is_number(value));
                if is_measured {
                    let value = quoted(&values[index]);
                    return Err(format!("{}: {column} = {value}: expected a number, as others have", place(index)));
                }
                reasons.push(format!("{column} of all points ({} has no number)", place(index)));
                continue;
            }
            others.push(column);
            for (index, value) in values.into_iter().enumerate() {
                sensors[index].others.push(value);
                if let Some(property) = found[index] {
                    unread[index][property] = false;
                }
            }
        }
        let items = IgnoredItem::summary(&ignored);
        let properties = unread_properties(&points, &unread);
        let ignored = [items, properties].into_iter().flatten().chain(reasons).collect();
        Ok(Self { frame: Frame::Geodetic, sensors, others, ignored, system })
    }

    /// The sensor list (CSV) of Skysink with all positions translated by `shift` [m or °].
    pub fn to_csv(&self, shift: [f64; 2]) -> String {
        let axes = match self.frame {
            Frame::Plane => ["x_m", "y_m"],
            Frame::Geodetic => ["lat_deg", "lon_deg"],
        };
        let mut list = csv::Writer::from_writer(Vec::new());
        list.write_record(axes.iter().chain(&self.others)).expect(IN_MEMORY);
        for sensor in &self.sensors {
            let place = [0, 1].map(|axis| (sensor.position[axis] + shift[axis]).to_string());
            list.write_record(place.iter().chain(&sensor.others)).expect(IN_MEMORY);
        }
        String::from_utf8(list.into_inner().expect(IN_MEMORY)).expect("cells are text")
    }

    /// The lower and upper corner of the bounding box.
    pub fn bounds(&self) -> [[f64; 2]; 2] {
        let fold = |start: f64, pick: fn(f64, f64) -> f64| {
            [0, 1].map(|axis| self.sensors.iter().map(|sensor| sensor.position[axis]).fold(start, pick))
        };
        [fold(f64::INFINITY, f64::min), fold(f64::NEG_INFINITY, f64::max)]
    }
}

/// The latitude [°] of the southernmost position and the longitude [°] of the westernmost one. The westernmost one is
/// the one east of the widest gap, so that a field may cross the 180th meridian.
#[must_use]
pub fn south_west(positions: &[[f64; 2]]) -> [f64; 2] {
    let mut longitudes: Vec<f64> = positions.iter().map(|position| position[1]).collect();
    longitudes.sort_by(f64::total_cmp);
    let gaps_before = longitudes.iter().zip(longitudes.iter().cycle().skip(longitudes.len().saturating_sub(1)));
    let gap = |(east, west): &(&f64, &f64)| (**east - **west).rem_euclid(FULL_CIRCLE_DEG);
    let widest = gaps_before.max_by(|a, b| gap(a).total_cmp(&gap(b)));
    let southernmost = positions.iter().map(|position| position[0]).fold(f64::INFINITY, f64::min);
    [southernmost, widest.map_or(f64::NAN, |(east, _)| *east)]
}

/// The properties of points that are `unread`, of each point by number, unless they are those of a column and empty.
fn unread_properties(points: &[FoundPoint], unread: &[Vec<bool>]) -> Option<String> {
    let properties = points.iter().flat_map(|point| &point.properties).zip(unread.iter().flatten());
    let is_ignored =
        |name: &str, text: &str, is_unread| is_unread && (other(name).is_none() || !text.trim().is_empty());
    let properties = properties.filter(|((name, text), is_unread)| is_ignored(name, text, **is_unread));
    let mut names: Vec<String> = properties.map(|((name, _), _)| quoted(name)).collect();
    names.sort();
    names.dedup();
    let more = names.len().saturating_sub(MOST_NAMED);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    names.truncate(MOST_NAMED);
    (!names.is_empty()).then(|| format!("properties {}{more}", names.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(position: [f64; 2], properties: &[(&str, &str)]) -> FoundPoint {
        let properties = properties.iter().map(|(name, value)| [name, value].map(|text| (*text).to_owned()).into());
        FoundPoint { position, altitude_m: None, properties: properties.collect() }
    }

    fn imported(points: &[FoundPoint]) -> Result<Imported, String> {
        Imported::geodetic(FoundPoints { points: points.to_vec(), ..FoundPoints::default() })
    }

    #[test]
    fn known_properties_become_columns_and_others_are_listed() {
        let one = point([1.0, 2.0], &[("Rate", "50"), ("name", "a, \"b\""), ("colour", "red"), ("height", "3")]);
        let other = point([1.0, 3.0], &[("rate", "60.5"), ("colour", "blue")]);
        let both = imported(&[one, other]).unwrap();
        let list = "lat_deg,lon_deg,sampling_bps,name\n1,2,50,\"a, \"\"b\"\"\"\n1,3,60.5,\n";
        assert_eq!(both.to_csv([0.0; 2]), list);
        assert_eq!(both.ignored, ["properties colour, height"]);
    }

    #[test]
    fn an_invalid_missing_or_repeated_property_is_listed_as_ignored() {
        let list = |points: &[&[(&str, &str)]]| {
            let points: Vec<FoundPoint> = points.iter().map(|properties| point([1.0, 2.0], properties)).collect();
            let imported = imported(&points).unwrap();
            (imported.to_csv([0.0; 2]), imported.ignored)
        };
        let bare = "lat_deg,lon_deg\n1,2\n1,2\n".to_owned();
        let of = |why: &str| vec!["properties rate".to_owned(), format!("sampling_bps of all points (point {why})")];
        assert_eq!(list(&[&[("rate", "slow")], &[("rate", "fast")]]), (bare.clone(), of("1 has no number")));
        assert_eq!(list(&[&[], &[("rate", "1")]]), (bare, of("1 has no number")));
        let (text, ignored) = list(&[&[("label", "b"), ("rate", "1"), ("name", "a"), ("sampling", "2")]]);
        assert_eq!(text, "lat_deg,lon_deg,sampling_bps,name\n1,2,2,a\n");
        assert_eq!(ignored, ["properties label, rate"]);
    }

    #[test]
    fn imported_names_are_one_line_and_valid_in_a_list() {
        let named = |name: &str| imported(&[point([1.0, 2.0], &[]), point([1.0, 2.0], &[("name", name)])]);
        let list = named("soil\n  \"7\",\r\nwest").unwrap().to_csv([0.0; 2]);
        assert_eq!(list, "lat_deg,lon_deg,name\n1,2,\n1,2,\"soil \"\"7\"\", west\"\n");
        assert!(named(&"a".repeat(100)).is_ok());
        for name in ["\x1b[31m", &"a".repeat(101)] {
            let message = named(name).unwrap_err();
            assert!(message.starts_with("point 2: name = "), "{message}");
            assert!(message.ends_with(": expected at most 100 characters, on one line"), "{message}");
        }
    }

    #[test]
    fn a_list_has_the_columns_of_its_frame() {
        let place = "line 2".to_owned();
        let sensor = ImportedSensor { place, position: [1.5, -2.0], others: vec!["50".to_owned()] };
        let others = vec!["sampling_bps"];
        let sensors = vec![sensor];
        let mut imported = Imported { frame: Frame::Plane, sensors, others, ignored: Vec::new(), system: None };
        assert_eq!(imported.to_csv([0.0, 2.0]), "x_m,y_m,sampling_bps\n1.5,0,50\n");
        imported.frame = Frame::Geodetic;
        assert!(imported.to_csv([0.0; 2]).starts_with("lat_deg,lon_deg,"));
        assert_eq!(imported.bounds(), [[1.5, -2.0]; 2]);
    }

    #[test]
    fn the_westernmost_point_follows_the_widest_gap() {
        let west = |longitudes: &[f64]| {
            let positions: Vec<[f64; 2]> = longitudes.iter().map(|&lon_deg| [1.0, lon_deg]).collect();
            south_west(&positions)
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
            "point 2: latitude 91: expected -90 to 90; are latitude and longitude swapped?"
        );
        assert!(imported(&[point([0.0, f64::NAN], &[])]).unwrap_err().contains("longitude NaN"));
    }
}
