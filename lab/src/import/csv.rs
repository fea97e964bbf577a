//! CSV: columns by name in any order, separated by commas, semicolons or tabs.

use ::csv::{ReaderBuilder, StringRecord, Trim};
use skysink_common::error::{line_of, quoted};
use skysink_common::geodata::{NAME, check_geodetic};

use super::imported::{Frame, Imported, ImportedSensor, OTHERS};

/// The names of the columns with coordinates in lower case: first the name in a sensor list, then its aliases. Those of
/// [`OTHERS`] follow.
const COORDINATES: [&[&str]; 4] = [
    &["x_m", "x", "east", "easting"],
    &["y_m", "y", "north", "northing"],
    &["lat_deg", "lat", "latitude"],
    &["lon_deg", "lon", "lng", "long", "longitude"],
];

/// Reads the text of a file.
pub fn read(text: &str) -> Result<Imported, String> {
    let first = text.lines().next().unwrap_or_default();
    let separator =
        [b',', b';', b'\t'].into_iter().max_by_key(|&byte| (first.matches(byte as char).count(), byte == b','));
    let mut reader = ReaderBuilder::new()
        .trim(Trim::All)
        .delimiter(separator.expect("three to choose from"))
        .flexible(true)
        .from_reader(text.as_bytes());
    let header = reader.headers().map_err(|error| error.to_string())?.clone();
    let table = Columns::of(&header).map_err(|message| format!("line 1: {message}"))?;
    let mut sensors = Vec::new();
    for row in reader.records() {
        let row = row.map_err(|error| error.to_string())?;
        let line = line_of(text, row.position());
        if row.len() != header.len() {
            let [found, expected] = [row.len(), header.len()];
            return Err(format!(
                "line {line}: {found} fields: expected {expected}, as in the header, and numbers with decimal points"
            ));
        }
        let place = format!("line {line}");
        let sensor = table.sensor(&row, place.clone()).map_err(|message| format!("{place}: {message}"))?;
        sensors.push(sensor);
    }
    Ok(Imported {
        frame: table.frame,
        sensors,
        others: table.others.iter().map(|(name, _)| *name).collect(),
        ignored: table.ignored,
    })
}

/// The indices of the columns in a file.
struct Columns {
    frame: Frame,
    position: [(String, usize); 2],
    others: Vec<(&'static str, usize)>,
    ignored: Vec<String>,
}

impl Columns {
    fn of(header: &StringRecord) -> Result<Self, String> {
        let columns = [&COORDINATES[..], &OTHERS].concat();
        let mut places = vec![None; columns.len()];
        let mut ignored = Vec::new();
        for (place, name) in header.iter().enumerate() {
            let lower = name.to_lowercase();
            match columns.iter().position(|names| names.contains(&lower.as_str())) {
                Some(column) if places[column].is_some() => {
                    return Err(format!("column `{}`: expected {} once", quoted(name), columns[column][0]));
                }
                Some(column) => places[column] = Some(place),
                None => ignored.push(format!("column {}", quoted(name))),
            }
        }
        let (frame, first, second) = match places[..COORDINATES.len()] {
            [Some(x), Some(y), _, _] => (Frame::Plane, x, y),
            [_, _, Some(lat), Some(lon)] => (Frame::Geodetic, lat, lon),
            _ => {
                let header = quoted(&header.iter().collect::<Vec<_>>().join(","));
                return Err(format!("header `{header}`: expected columns x and y [m], or lat and lon [°]"));
            }
        };
        let named = |place: usize| (header[place].to_owned(), place);
        let others = columns.iter().zip(places).skip(COORDINATES.len());
        let others = others.filter_map(|(names, place)| Some((names[0], place?))).collect();
        Ok(Self { frame, position: [named(first), named(second)], others, ignored })
    }

    /// Parses a row at the location `place`.
    fn sensor(&self, row: &StringRecord, place: String) -> Result<ImportedSensor, String> {
        let [first, second] = &self.position;
        let position = [number(row, first)?, number(row, second)?];
        if self.frame == Frame::Geodetic {
            check_geodetic(position)?;
        }
        let other = |&(name, place): &(&str, usize)| match name {
            NAME => Ok(row.get(place).unwrap_or_default().to_owned()),
            _ => number(row, &(name.to_owned(), place)).map(|value| value.to_string()),
        };
        let others = self.others.iter().map(other).collect::<Result<_, _>>()?;
        Ok(ImportedSensor { place, position, others })
    }
}

/// Parses the finite number in a column.
fn number(row: &StringRecord, (name, place): &(String, usize)) -> Result<f64, String> {
    let text = row.get(*place).unwrap_or_default();
    let value = text.parse().ok().filter(|value: &f64| value.is_finite());
    let point = if text.contains(',') { " with a decimal point" } else { "" };
    value.ok_or_else(|| format!("{} = {}: expected a number{point}", quoted(name), quoted(text)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_found_by_name_in_any_order() {
        let imported = read("Name,Longitude,LAT,rate,colour\na,-87.6,41.9,50,red\nb,-87.5,41.8,60,\n").unwrap();
        assert_eq!((imported.frame, imported.others), (Frame::Geodetic, vec!["sampling_bps", "name"]));
        let place = "line 3".to_owned();
        let second = ImportedSensor { place, position: [41.8, -87.5], others: vec!["60".to_owned(), "b".to_owned()] };
        assert_eq!(imported.sensors[1], second);
        assert_eq!(imported.ignored, ["column colour"]);
        let plane = read("y;x\n1;2\n").unwrap();
        assert_eq!((plane.frame, plane.sensors[0].position), (Frame::Plane, [2.0, 1.0]));
    }

    #[test]
    fn a_bad_file_is_refused_with_its_line_number() {
        assert!(read("x,y\n1,2\n3,four\n").unwrap_err().starts_with("line 3: y = four: expected a number"));
        assert!(read("x,y\n\n\"1\",2\n\n3,four\n").unwrap_err().starts_with("line 5: y"), "empty lines count");
        assert!(read("x,y\n1\n").unwrap_err().starts_with("line 2: 1 fields: expected 2, as in the header"));
        assert!(read("x,y\n1,5,2,5\n").unwrap_err().contains("line 2: 4 fields: expected 2"), "decimal commas");
        assert!(read("x;y\n1;2,5\n").unwrap_err().ends_with("y = 2,5: expected a number with a decimal point"));
        assert!(read("x,y\n1,\n").unwrap_err().starts_with("line 2: y = : expected a number"));
        assert!(read("lat,lon\n95,2\n").unwrap_err().starts_with("line 2: latitude 95: expected -90 to 90"));
        assert!(read("x,z\n1,2\n").unwrap_err().contains("expected columns x and y [m], or lat and lon [°]"));
        assert!(read("x,x_m,y\n1,2,3\n").unwrap_err().contains("column `x_m`: expected x_m once"));
    }
}
