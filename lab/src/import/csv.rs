//! CSV: columns by name in any order, separated by commas, semicolons or tabs, as GIS programs and spreadsheets write
//! them: with units, a line `sep=;`, and decimal commas where commas separate nothing.

use ::csv::{ReaderBuilder, StringRecord, Trim};
use skysink_common::error::{line_of, quoted};
use skysink_common::geodata::{EarthSystem, FOOT_M, NAME, ReferenceSystem, SourceText, plausible};

use super::ground::{self, GROUND, GROUND_FT};
use super::imported::{Frame, IDS, Imported, ImportedSensor, OTHERS, plain};

/// The names of the columns with coordinates in lower case: first the name in a sensor list, then its aliases. Those of
/// [`OTHERS`] follow.
pub const COORDINATES: [&[&str]; 4] = [
    &["x_m", "x", "east", "easting", "point_x", "xcoord", "x_coord"],
    &["y_m", "y", "north", "northing", "point_y", "ycoord", "y_coord"],
    &["lat_deg", "lat", "latitude", "decimallatitude"],
    &["lon_deg", "lon", "lng", "long", "longitude", "decimallongitude"],
];

/// The units that a header may name, by the ends of the names in a sensor list.
const UNITS: [(&str, &[&str]); 6] = [
    ("_m", &["m", "metre", "metres", "meter", "meters"]),
    ("_ft", &["ft", "feet", "foot", "ftus", "us-ft"]),
    ("_deg", &["deg", "°", "degree", "degrees", "decimal degrees", "dd", "wgs84"]),
    ("_bps", &["bit/s", "bits/s", "bps"]),
    ("_bits", &["bit", "bits"]),
    ("_db", &["db"]),
];

/// Columns of the flight that `skysink export` and runs write.
const SLOTS: [&str; 2] = ["slot", "scheduled"];

/// Reads the text of a file, with positions in metres, in degrees, or in the system of the source.
pub fn read(source: &SourceText<'_>) -> Result<Imported, String> {
    let text = source.text;
    let on_earth = source.system.and_then(ReferenceSystem::on_earth);
    let (line, declared) = match text.lines().next().and_then(|line| line.trim().strip_prefix("sep=")) {
        Some(separator) => (1, separator.bytes().next()),
        None => (0, None),
    };
    let header = text.lines().nth(line).unwrap_or_default();
    let separators = [b',', b';', b'\t'].into_iter();
    let likeliest = separators.max_by_key(|&byte| (header.matches(byte as char).count(), byte == b','));
    let separator = declared.or(likeliest).expect("three to choose from");
    let start = if line == 0 { 0 } else { text.find('\n').map_or(text.len(), |end| end + 1) };
    let body = &text[start..];
    let mut reader =
        ReaderBuilder::new().trim(Trim::All).delimiter(separator).flexible(true).from_reader(body.as_bytes());
    let header = reader.headers().map_err(|error| error.to_string())?.clone();
    let table = Columns::of(&header, separator, on_earth).map_err(|message| format!("line {}: {message}", line + 1))?;
    let mut sensors = Vec::new();
    let mut decimal: Option<(char, String)> = None;
    for row in reader.records() {
        let row = row.map_err(|error| error.to_string())?;
        let place = format!("line {}", line_of(body, row.position()) + line as u64);
        if row.len() > 1 && row.iter().all(str::is_empty) {
            continue; // spreadsheets end with such rows
        }
        if row.len() != header.len() {
            let [found, expected] = [row.len(), header.len()];
            return Err(format!(
                "{place}: {found} fields: expected {expected}, as in the header, and numbers with decimal points"
            ));
        }
        let sensor = table.sensor(&row, place.clone()).map_err(|message| format!("{place}: {message}"))?;
        table.check_decimals(&row, &place, &mut decimal).map_err(|message| format!("{place}: {message}"))?;
        sensors.push(sensor);
    }
    let positions: Vec<[f64; 2]> = sensors.iter().map(|sensor| sensor.position).collect();
    let are_lengths = table.frame == Frame::Plane && on_earth.is_none();
    if are_lengths && plausible::are_degrees(&positions) {
        let [x, y] = table.position.each_ref().map(|(name, _)| quoted(name));
        return Err(format!(
            "columns {x} and {y}: {} sensor nodes within a metre, as if their degrees were metres: expected metres, or \
             columns lat and lon",
            positions.len()
        ));
    }
    let others = table.others.iter().map(|(name, _)| *name).collect();
    let imported = Imported { frame: table.frame, sensors, others, ignored: table.ignored, system: None };
    imported.without_partial_ground().through(source.system)
}

/// The indices of the columns in a file.
struct Columns {
    frame: Frame,
    position: [(String, usize); 2],
    others: Vec<(&'static str, usize)>,
    /// Whether the altitudes of the ground are in feet.
    has_feet: bool,
    ignored: Vec<String>,
    /// Whether numbers may have decimal commas.
    has_commas: bool,
}

/// The name of a column in lower case without its unit, and the unit, as in `X [m]` and `Latitude (deg)`.
fn name_and_unit(header: &str) -> (String, Option<String>) {
    let lower = header.to_lowercase();
    let unit = lower.strip_suffix([')', ']']).and_then(|rest| rest.rsplit_once(['(', '[']));
    match unit {
        Some((name, unit)) => (plain(name.trim_end_matches([' ', '_'])), Some(unit.trim().to_owned())),
        None => (plain(&lower), None),
    }
}

/// Whether the values of the column `name` of a sensor list are in this unit.
fn is_in(name: &str, unit: &str) -> bool {
    UNITS.iter().any(|(end, units)| name.ends_with(end) && units.contains(&unit))
}

/// The `own` name of a column of a sensor list, with the unit of its values in the file, where it is called `name`:
/// positions are in the unit of their system.
fn with_unit<'a>(own: &'a str, name: &str, unit: Option<&String>, on_earth: Option<&EarthSystem>) -> &'a str {
    let has_feet = on_earth.is_some_and(|system| (system.unit_m() - FOOT_M).abs() < 1e-4);
    match own {
        "x_m" if has_feet => "x_ft",
        "y_m" if has_feet => "y_ft",
        GROUND if name == GROUND_FT => GROUND_FT,
        GROUND if name != GROUND && unit.is_some_and(|unit| is_in(GROUND_FT, unit)) => GROUND_FT,
        own => own,
    }
}

impl Columns {
    fn of(header: &StringRecord, separator: u8, on_earth: Option<&EarthSystem>) -> Result<Self, String> {
        if SLOTS.iter().all(|name| header.iter().any(|column| column == *name)) {
            let expected = "a row for each sensor node (a run has a sensor list, sensors.csv)";
            return Err(format!("columns slot and scheduled, of a flight: expected {expected}"));
        }
        let columns = [&COORDINATES[..], &OTHERS].concat();
        let mut places = vec![None; columns.len()];
        let mut ignored = Vec::new();
        let mut has_feet = false;
        let is_called = |names: &[&str], header: &str| names.contains(&name_and_unit(header).0.as_str());
        let names = columns.iter().find(|names| names[0] == NAME).expect("it is one of the others");
        let has_names = header.iter().any(|header| is_called(names, header));
        let id = header.iter().position(|header| !has_names && is_called(&IDS, header));
        for (place, header) in header.iter().enumerate() {
            let (name, unit) = name_and_unit(header);
            let name = if id == Some(place) { NAME } else { &name };
            let found = columns.iter().position(|names| names.contains(&name));
            // Degrees in columns x and y are a longitude and a latitude.
            let found = match (found, &unit) {
                (Some(axis @ (0 | 1)), Some(unit)) if is_in("lat_deg", unit) => Some(3 - axis),
                _ => found,
            };
            let Some(column) = found else {
                let heights = format!("; {}", ground::REMEDY);
                let heights = if ground::is_height(name) { &heights } else { "" };
                ignored.extend((!header.is_empty()).then(|| format!("column {}{heights}", quoted(header))));
                continue;
            };
            let own = with_unit(columns[column][0], name, unit.as_ref(), on_earth);
            has_feet |= own == GROUND_FT;
            if unit.is_some_and(|unit| !is_in(own, &unit)) {
                let expected = UNITS.iter().find(|(end, _)| own.ends_with(end)).map_or("none", |(_, units)| units[0]);
                return Err(format!("column `{}`: its unit: expected {expected}, of {own}", quoted(header)));
            }
            if places[column].replace(place).is_some() {
                return Err(format!("column `{}`: expected {own} once", quoted(header)));
            }
        }
        let named = |place: usize| (header[place].to_owned(), place);
        let (frame, first, second) = match places[..COORDINATES.len()] {
            [x, y, Some(lat), Some(lon)] => {
                // Degrees say more than metres from an unknown origin.
                let metres = [x, y].into_iter().flatten().map(|place| format!("column {}", quoted(&header[place])));
                ignored.extend(metres);
                (Frame::Geodetic, lat, lon)
            }
            [Some(x), Some(y), _, _] => (Frame::Plane, x, y),
            _ => {
                let header = quoted(&header.iter().collect::<Vec<_>>().join(","));
                return Err(format!("header `{header}`: expected columns x and y [m], or lat and lon [°]"));
            }
        };
        let others = columns.iter().zip(places).skip(COORDINATES.len());
        let others = others.filter_map(|(names, place)| Some((names[0], place?))).collect();
        let position = [named(first), named(second)];
        Ok(Self { frame, position, others, has_feet, ignored, has_commas: separator != b',' })
    }

    /// Parses a row at the location `place`.
    fn sensor(&self, row: &StringRecord, place: String) -> Result<ImportedSensor, String> {
        let [first, second] = &self.position;
        let position = [self.number(row, first)?, self.number(row, second)?];
        self.frame.check(position)?;
        let other = |&(name, place): &(&str, usize)| match name {
            NAME => Ok(row.get(place).unwrap_or_default().to_owned()),
            GROUND if ground::is_missing(row.get(place).unwrap_or_default()) => Ok(String::new()),
            GROUND if self.has_feet => {
                self.number(row, &(name.to_owned(), place)).map(|value| ground::in_metres(&value.to_string()))
            }
            _ => self.number(row, &(name.to_owned(), place)).map(|value| value.to_string()),
        };
        let others = self.others.iter().map(other).collect::<Result<_, _>>()?;
        Ok(ImportedSensor { place, position, others })
    }

    /// Checks that all numbers have the same decimal sign, where they may have commas; another one separates thousands.
    /// `decimal` is the first one, with its location.
    fn check_decimals(
        &self,
        row: &StringRecord,
        place: &str,
        decimal: &mut Option<(char, String)>,
    ) -> Result<(), String> {
        let others = self.others.iter().filter(|(name, _)| *name != NAME).copied();
        let columns = self.position.iter().map(|(name, place)| (name.as_str(), *place)).chain(others);
        for (name, column) in columns.filter(|_| self.has_commas) {
            let text = row.get(column).unwrap_or_default();
            let Some(sign) = text.chars().find(|sign| [',', '.'].contains(sign)) else { continue };
            let (first, line) = decimal.get_or_insert_with(|| (sign, place.to_owned()));
            if *first != sign {
                let (found, expected) = if sign == '.' { ("point", "comma") } else { ("comma", "point") };
                let expected = format!("a decimal {expected}, as in {line}, and no separator of thousands");
                return Err(format!("{} = {}: has a {found}: expected {expected}", quoted(name), quoted(text)));
            }
        }
        Ok(())
    }

    /// Parses the finite number in a column.
    fn number(&self, row: &StringRecord, (name, place): &(String, usize)) -> Result<f64, String> {
        let text = row.get(*place).unwrap_or_default();
        let is_decimal = self.has_commas && !text.contains('.') && text.matches(',').count() == 1;
        let with_point = if is_decimal { text.replace(',', ".") } else { text.to_owned() };
        let value = with_point.parse().ok().filter(|value: &f64| value.is_finite());
        let point = if text.contains(',') { " with a decimal point" } else { "" };
        value.ok_or_else(|| format!("{} = {}: expected a number{point}", quoted(name), quoted(text)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Imported, String> {
        super::read(&SourceText { text, ..SourceText::default() })
    }

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
    fn ids_are_names_where_there_are_no_names() {
        let named = read("Sensor ID;x;y\ns-7;1;2\n").unwrap();
        assert_eq!((named.others, &named.sensors[0].others), (vec!["name"], &vec!["s-7".to_owned()]));
        let spaced = read("Node ID;x;y;Sampling rate (bps);Buffer-Size\ns-7;1;2;3;4\n").unwrap();
        assert_eq!(spaced.others, ["sampling_bps", "capacity_bits", "name"]);
        assert!(spaced.ignored.is_empty(), "{spaced:?}");
        let both = read("id,name,x,y\n7,a,1,2\n").unwrap();
        assert_eq!((both.others, both.ignored), (vec!["name"], vec!["column id".to_owned()]));
    }

    #[test]
    fn a_bad_file_is_refused_with_its_line_number() {
        assert!(read("x,y\n1,2\n3,four\n").unwrap_err().starts_with("line 3: y = four: expected a number"));
        assert!(read("x,y\n\n\"1\",2\n\n3,four\n").unwrap_err().starts_with("line 5: y"), "empty lines count");
        assert!(read("x,y\n1\n").unwrap_err().starts_with("line 2: 1 fields: expected 2, as in the header"));
        assert!(read("x,y\n1,5,2,5\n").unwrap_err().contains("line 2: 4 fields: expected 2"), "decimal commas");
        assert!(read("x,y\n1,\"2,5\"\n").unwrap_err().ends_with("y = 2,5: expected a number with a decimal point"));
        assert!(read("x;y\n1;1.234,5\n").unwrap_err().ends_with("y = 1.234,5: expected a number with a decimal point"));
        assert!(read("sep=;\nx;y\n1;two\n").unwrap_err().starts_with("line 3: y = two"));
        assert!(read("x [ft],y [ft]\n1,2\n").unwrap_err().ends_with("column `x [ft]`: its unit: expected m, of x_m"));
        assert!(
            read("lat,lon,rate [kbit/s]\n1,2,3\n")
                .unwrap_err()
                .contains("column `rate [kbit/s]`: its unit: expected bit/s, of sampling_bps")
        );
        assert!(
            read("slot,time_s,lat_deg,lon_deg,scheduled\n0,0,1,2,\n")
                .unwrap_err()
                .contains("of a flight: expected a row")
        );
        assert!(read("x,y\n1,\n").unwrap_err().starts_with("line 2: y = : expected a number"));
        assert!(read("lat,lon\n95,2\n").unwrap_err().starts_with("line 2: latitude 95: expected -90 to 90"));
        assert!(read("x,z\n1,2\n").unwrap_err().contains("expected columns x and y [m], or lat and lon [°]"));
        assert!(read("x,x_m,y\n1,2,3\n").unwrap_err().contains("column `x_m`: expected x_m once"));
    }

    #[test]
    fn headers_of_other_programs_are_understood() {
        let degrees = (Frame::Geodetic, [47.5, 8.5]);
        let metres = (Frame::Plane, [8.5, 47.5]);
        for (text, (frame, position)) in [
            ("sep=;\nlat;lon\n47.5;8.5\n", degrees),
            ("sep=;\r\nlat;lon\r\n47,5;8,5\r\n;\r\n", degrees),
            ("sep=,\nlat,lon\n47.5,8.5\n", degrees),
            ("X [m],Y [m]\n8.5,47.5\n", metres),
            ("x (metres);y (metres)\n8,5;47,5\n", metres),
            ("Latitude (deg),Longitude (deg)\n47.5,8.5\n", degrees),
            ("lat_[°]\tlon_[°]\n47,5\t8,5\n", degrees),
            ("OID_,POINT_X,POINT_Y\n1,8.5,47.5\n", metres),
            ("X [deg],Y [deg]\n8.5,47.5\n", degrees),
            ("decimalLatitude,decimalLongitude\n47.5,8.5\n", degrees),
            ("\"Latitude\";\"Longitude\";\n\"47,5\";\"8,5\";\n;;\n", degrees),
            ("X,Y,lat,lon\n1,2,47.5,8.5\n", degrees),
        ] {
            let imported = read(text).unwrap_or_else(|message| panic!("{text}: {message}"));
            assert_eq!((imported.frame, imported.sensors.len()), (frame, 1), "{text}");
            assert_eq!(imported.sensors[0].position, position, "{text}");
        }
    }

    #[test]
    fn separators_of_thousands_are_no_decimal_signs() {
        let refused = |text: &str| read(text).unwrap_err();
        assert_eq!(
            refused("lat;lon;buffer\n47,5;8,5;500\n47,6;8,6;30.000\n"),
            "line 3: capacity_bits = 30.000: has a point: expected a decimal comma, as in line 2, and no separator of \
             thousands"
        );
        assert!(refused("x\ty\tbuffer\n1.5\t2\t30,000\n").starts_with("line 2: capacity_bits = 30,000: has a comma"));
        assert!(
            refused("x\ty\n1.5\t2\n3\t4,000\n").starts_with("line 3: y = 4,000: has a comma: expected a decimal point")
        );
        assert!(refused("x;y\n1,5;2.5\n").starts_with("line 2: y = 2.5: has a point"), "in one row");
        let names = read("x;y;name\n1,5;2,5;a. b\n3;4;c, d\n").unwrap();
        assert_eq!(names.sensors.len(), 2, "names are no numbers");
    }

    #[test]
    fn altitudes_of_the_ground_are_in_metres_or_feet_and_of_all_or_none() {
        let list = |text: &str| {
            let imported = read(text).unwrap();
            (imported.ground_m(), imported.ignored)
        };
        assert_eq!(list("x,y,ground\n1,2,300\n"), (vec![300.0], vec![]));
        for header in ["ground_ft", "ground_ft [ft]", "Ground (feet)", "ground [ft]"] {
            assert_eq!(list(&format!("x,y,{header}\n1,2,1000\n")), (vec![304.8], vec![]), "{header}");
        }
        let refused = read("x,y,ground_m [ft]\n1,2,300\n").unwrap_err();
        assert_eq!(refused, "line 1: column `ground_m [ft]`: its unit: expected m, of ground_m");
        for missing in ["", "NaN", "NA"] {
            let reason = "ground_m of all sensor nodes (line 3 has no number)".to_owned();
            assert_eq!(list(&format!("x,y,ground_m\n1,2,300\n3,4,{missing}\n")), (vec![], vec![reason]), "{missing}");
        }
        let (ground_m, ignored) = list("x,y,alt\n1,2,0\n3,4,388\n");
        assert!(ground_m.is_empty() && ignored[0].starts_with("column alt; altitudes of the ground"), "{ignored:?}");
    }

    #[test]
    fn degrees_in_columns_of_metres_are_refused() {
        let expected = "columns X and Y: 2 sensor nodes within a metre, as if their degrees were metres: expected \
                        metres, or columns lat and lon";
        assert_eq!(read("X,Y\n8.5452,47.3972\n8.5478,47.3988\n").unwrap_err(), expected);
        assert!(read("easting,northing\n8.5452,47.3972\n8.5478,47.3988\n").is_err());
        let both = read("X,Y,lat,lon\n8.5452,47.3972,47.3972,8.5452\n8.5478,47.3988,47.3988,8.5478\n").unwrap();
        assert_eq!((both.frame, both.ignored), (Frame::Geodetic, vec!["column X".to_owned(), "column Y".to_owned()]));
    }
}
