//! The rows of a sensor list: its columns, and one checked sensor node per row.
//!
//! `list` draws the values of missing columns, and adds the file name to errors.

use std::ops::RangeInclusive;

use super::list::{Sensor, draw_capacity_bits, draw_queue_bits, draw_sampling_bps};
use crate::arrivals::MAX_SAMPLED_BITS;
use crate::channel::{Channel, ChannelModel, draw_gain_db};
use crate::error::{line_of, quoted};
use crate::geodata::projection::Projection;
use crate::geometry::Position;
use crate::nodes::keys::{MAX_FIELD_BITS, MAX_SENSORS};
use crate::nodes::{self, NODE_ROWS, NodeColumn};
use crate::random::Streams;
use crate::scenario::{Area, Scenario};
use crate::weights::WEIGHTS;

/// Columns in which a list is always written, in this order.
pub(super) const WRITTEN: [&str; 5] = ["x_m", "y_m", "queue_bits", "gain_db", "sampling_bps"];

/// Columns that a list may have, and their values, before those of features.
const FIRST: [(&str, &str); 9] = [
    ("x_m", "0 to the width of the area [m]"),
    ("y_m", "0 to the height of the area [m]"),
    (
        "lat_deg",
        "instead of `x_m`, `y_m`: latitude of WGS84, south negative, projected onto the plane tangent at the origin",
    ),
    ("lon_deg", "longitude, west negative"),
    (
        "queue_bits",
        "initial queue: whole bits up to the buffer; a planner that estimates queues is told the scenario's mean",
    ),
    ("gain_db", "gain of the link, -300 to 0"),
    ("sampling_bps", "0 or above"),
    (CAPACITY, "buffer: whole bits, 1 to 4294967295"),
    (WEIGHT, "what a bit of this SN is worth, 1e-6 to 1e6: strategies value weighted queues (decision D25)"),
];

/// Those after the columns of features.
const LAST: [(&str, &str); 2] = [
    (GROUND, "altitude of the ground above sea level, -500 to 9000, for exports"),
    (NAME, "text of at most 100 characters, shown instead of `SN 7`"),
];

/// Columns that a list may have, and their values, also for `docs/src/input-files.md`.
pub fn columns() -> impl Iterator<Item = (&'static str, &'static str)> {
    let of_features = nodes::columns().map(|column| (column.name, column.words));
    FIRST.into_iter().chain(of_features).chain(LAST)
}

/// The names of the columns, of which the first `skipped` are left out.
fn names_of_columns(skipped: usize) -> String {
    columns().skip(skipped).map(|(name, _)| name).collect::<Vec<_>>().join(",")
}

/// The column of buffers, which is written if one is not that of the scenario.
pub(super) const CAPACITY: &str = "capacity_bits";

/// The column of weights, which is written if one is not 1.
pub(super) const WEIGHT: &str = "weight";

/// The column of the ground's altitudes, which is written if the list has it.
pub(super) const GROUND: &str = "ground_m";

/// Lowest and highest ground [m]: wider than the Earth's.
const GROUND_M: RangeInclusive<f64> = -500.0..=9000.0;

/// The column of names, which is written if a sensor node has one.
pub(super) const NAME: &str = "name";

/// Columns beside which these keys of the scenario are not read. A planner that estimates queues is told the range of
/// rates, and of initial queues.
fn prior() -> impl Iterator<Item = (&'static str, &'static str)> {
    let of_features = nodes::columns().map(|column| (column.name, column.key));
    [("sampling_bps", "sensors.sampling_bps"), (CAPACITY, "sensors.capacity_bits")].into_iter().chain(of_features)
}

/// Most characters of a name.
const MOST_CHARACTERS: usize = 100;

/// Checks the name of a sensor node: at most 100 characters, none of them a control character or one that XML forbids.
///
/// # Errors
/// A message with the name, if it is another.
pub fn check_name(name: &str) -> Result<(), String> {
    let is_forbidden = |character: &char| character.is_control() || "\u{fffe}\u{ffff}".contains(*character);
    let forbidden = name.chars().find(is_forbidden);
    let kind = if forbidden.is_some_and(char::is_control) { "a control character" } else { "which XML forbids" };
    let has = forbidden.map(|character| format!(": U+{:04X}, {kind}", u32::from(character))).unwrap_or_default();
    let expected = format_args!("at most {MOST_CHARACTERS} characters, on one line");
    let is_accepted = forbidden.is_none() && name.chars().count() <= MOST_CHARACTERS;
    if is_accepted { Ok(()) } else { Err(format!("name = {}{has}: expected {expected}", quoted(name))) }
}

/// A projected position up to this far [m] outside the area is moved to its border, so that rounding does not exclude
/// the meridian of the origin.
const RIM_SLACK_M: f64 = 1e-6;

/// The rows of a list; sensor node i is row i.
#[derive(Debug, Default)]
pub(super) struct Rows {
    pub sensors: Vec<Sensor>,
    /// Their names; empty without such a column.
    pub names: Vec<String>,
    /// The altitude of the ground at each [m]; empty without such a column.
    pub ground_m: Vec<f64>,
    /// Its columns of features, by name.
    pub columns: Vec<(&'static str, Vec<f64>)>,
}

/// Reads the text of a list. The error names the row by `locate`, given its index and line, the value, and what was
/// expected.
pub(super) fn read(text: &str, scenario: &Scenario, locate: impl Fn(usize, u64) -> String) -> Result<Rows, String> {
    let in_header = |message: String| format!("line 1: {message}");
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).flexible(true).from_reader(text.as_bytes());
    let header = reader.headers().map_err(|error| in_header(error.to_string()))?.clone();
    let table = Table::of(&header, scenario).map_err(in_header)?;
    let mission_s = scenario.slot_s * scenario.slots as f64;
    let Rows { mut sensors, mut names, mut ground_m, .. } = Rows::default();
    let mut columns: Vec<(&NodeColumn, Vec<f64>)> =
        table.feature_columns().map(|column| (column, Vec::new())).collect();
    let mut field_bits = 0.0;
    for row in reader.records() {
        let at = |position: Option<&csv::Position>, message: String| {
            format!("{}: {message}", locate(sensors.len(), line_of(text, position)))
        };
        let row = row.map_err(|error| at(error.position(), "expected UTF-8 text".to_owned()))?;
        let line = row.position();
        if row.len() != header.len() {
            return Err(at(line, format!("{} fields: expected {}, as in the header", row.len(), header.len())));
        }
        if sensors.len() as u64 == MAX_SENSORS {
            return Err(at(line, format!("more than {MAX_SENSORS} rows: expected at most {MAX_SENSORS} sensor nodes")));
        }
        let id = sensors.len() as u32;
        let sensor = table.sensor(&row, id).map_err(|message| at(line, message))?;
        field_bits += sensor.sampling_bps * mission_s;
        if field_bits > MAX_FIELD_BITS {
            let expected = "at most 9e18 bits over the mission from all sensor nodes";
            return Err(at(line, format!("sampling_bps = {}: expected {expected}", sensor.sampling_bps)));
        }
        let expected = format!("the altitude of the ground, {} to {} m, not a void", GROUND_M.start(), GROUND_M.end());
        let ground = table.number(&row, GROUND, &expected, |value| GROUND_M.contains(&value));
        for (column, values) in &mut columns {
            values.extend(table.feature(&row, column).map_err(|message| at(line, message))?);
        }
        ground_m.extend(ground.map_err(|message| at(line, message))?);
        names.extend(table.name(&row).map_err(|message| at(line, message))?);
        sensors.push(sensor);
    }
    if sensors.is_empty() {
        return Err(in_header("no rows: expected at least one sensor node".to_owned()));
    }
    let columns = columns.into_iter().map(|(column, values)| (column.name, values)).collect();
    Ok(Rows { sensors, names, ground_m, columns })
}

/// The line of a row of a list, from 1.
pub(super) fn line_of_row(text: &str, row: usize) -> Option<u64> {
    let mut reader = csv::ReaderBuilder::new().flexible(true).from_reader(text.as_bytes());
    let row = reader.records().nth(row)?.ok()?;
    Some(line_of(text, row.position()))
}

/// The columns of one list.
struct Table<'a> {
    scenario: &'a Scenario,
    header: &'a csv::StringRecord,
    /// `None` if positions are in metres from the south-west corner of the area.
    projection: Option<Projection>,
    /// Whether the column of gains counts.
    has_own_gains: bool,
}

impl<'a> Table<'a> {
    fn of(header: &'a csv::StringRecord, scenario: &'a Scenario) -> Result<Self, String> {
        let names: Vec<&str> = header.iter().collect();
        for (index, name) in names.iter().enumerate() {
            if !columns().any(|(column, _)| column == *name) {
                return Err(format!("column `{}`: expected one of {}", quoted(name), names_of_columns(0)));
            }
            if names[..index].contains(name) {
                return Err(format!("column `{}` twice: expected it once", quoted(name)));
            }
        }
        let knowledge = scenario.planner.others.get("knowledge").and_then(toml::Value::as_str);
        for setting in scenario.settings.iter().filter(|_| knowledge != Some("estimated")) {
            if let Some((name, _)) = prior().find(|(name, key)| setting.key == *key && names.contains(name)) {
                let origin = setting.origin;
                return Err(format!("column `{name}`: expected none, as it has priority over {origin} {setting}"));
            }
        }
        let refuse = |expected: &str| format!("header `{}`: expected {expected}", quoted(&names.join(",")));
        let keys = scenario.node_keys();
        for row in NODE_ROWS {
            let is_given = (row.traits)(&keys).is_some();
            if let Some(column) = row.columns.iter().find(|column| !is_given && names.contains(&column.name)) {
                let key = row.key;
                return Err(format!("column `{}`: expected it only with {key} in the scenario", column.name));
            }
            let is_missing =
                |column: &&NodeColumn| (column.of_keys)(keys.sensors).is_none() && !names.contains(&column.name);
            if let Some(NodeColumn { name, key, .. }) = row.columns.iter().find(|column| is_given && is_missing(column))
            {
                return Err(refuse(&format!("a column {name}, or {key} in the scenario")));
            }
        }
        let projection = match ["x_m", "y_m", "lat_deg", "lon_deg"].map(|name| names.contains(&name)) {
            [true, true, false, false] => None,
            [false, false, true, true] => {
                let expected = "area.origin_lat_deg and area.origin_lon_deg in the scenario";
                Some(Projection::at(scenario.area.origin().ok_or_else(|| refuse(expected))?))
            }
            _ => {
                let others = names_of_columns(4);
                let columns = format!("x_m,y_m or lat_deg,lon_deg, not both, and optionally {others}");
                return Err(refuse(&columns));
            }
        };
        Ok(Self { scenario, header, projection, has_own_gains: Channel::of(&scenario.link).has_own_gains() })
    }

    /// Reads one row; the error names the column, the value and what was expected.
    fn sensor(&self, row: &csv::StringRecord, id: u32) -> Result<Sensor, String> {
        let scenario = self.scenario;
        let position = self.position(row)?;
        let is_buffer = |value: f64| (1.0..=f64::from(u32::MAX)).contains(&value) && value.fract() == 0.0;
        let own_bits = self.number(row, CAPACITY, &format!("whole bits, 1 to {}", u32::MAX), is_buffer)?;
        let capacity_bits = own_bits.map_or_else(|| draw_capacity_bits(scenario, id), |bits| bits as u32);
        let expected = format!("a weight from {} to {}", WEIGHTS.start(), WEIGHTS.end());
        let weight = self.number(row, WEIGHT, &expected, |value| WEIGHTS.contains(&value))?;
        let capacity = f64::from(capacity_bits);
        let is_queue = |value: f64| (0.0..=capacity).contains(&value) && value.fract() == 0.0;
        let expected = format!("whole bits, 0 to the buffer's {capacity}");
        let queue_bits = self.number(row, "queue_bits", &expected, is_queue)?;
        let is_level = |value: f64| (-300.0..=0.0).contains(&value);
        let gain_db = self.number(row, "gain_db", "a level from -300 to 0 dB", is_level)?;
        let highest_bps = MAX_SAMPLED_BITS / (scenario.slot_s * scenario.slots as f64);
        let is_rate = |value: f64| (0.0..=highest_bps).contains(&value);
        let expected = "a finite rate, 0 or above, at most 9e15 bits over the mission";
        let sampling_bps = self.number(row, "sampling_bps", expected, is_rate)?;
        Ok(Sensor {
            position,
            queue_bits: queue_bits.map_or_else(|| draw_queue_bits(scenario, id, capacity_bits), |bits| bits as u32),
            // In a channel with one gain for all the column is ignored.
            gain_db: gain_db
                .filter(|_| self.has_own_gains)
                .unwrap_or_else(|| draw_gain_db(scenario.link.gain_range_db(), &Streams::new(scenario.seed), 0, id)),
            sampling_bps: sampling_bps.unwrap_or_else(|| draw_sampling_bps(scenario, id)),
            capacity_bits,
            weight: weight.unwrap_or(1.0),
        })
    }

    /// The columns of features that the list has.
    fn feature_columns(&self) -> impl Iterator<Item = &'static NodeColumn> {
        nodes::columns().filter(|column| self.header.iter().any(|name| name == column.name))
    }

    /// The number of a row in the column of a feature.
    fn feature(&self, row: &csv::StringRecord, column: &NodeColumn) -> Result<Option<f64>, String> {
        let is_accepted = |value: f64| column.accepts.refusal(&toml::Value::Float(value)).is_none();
        self.number(row, column.name, &column.accepts.expected(), is_accepted)
    }

    /// The name in a row, which may be empty; `None` if the list has no column of names.
    fn name(&self, row: &csv::StringRecord) -> Result<Option<String>, String> {
        let Some(index) = self.header.iter().position(|name| name == NAME) else { return Ok(None) };
        let name = &row[index];
        check_name(name).map(|()| Some(name.to_owned()))
    }

    fn position(&self, row: &csv::StringRecord) -> Result<Position, String> {
        let area = &self.scenario.area;
        let coordinate = |column, expected: &str, range: RangeInclusive<f64>| {
            let number = self.number(row, column, expected, |value| range.contains(&value))?;
            Ok::<f64, String>(number.expect("the header has both columns"))
        };
        let Some(projection) = &self.projection else {
            let within = |column, extent_m: f64| {
                coordinate(column, &format!("a position in the area, 0 to {extent_m}"), 0.0..=extent_m)
            };
            return Ok(Position::new(within("x_m", area.width_m())?, within("y_m", area.height_m())?));
        };
        let lat_deg = coordinate("lat_deg", "a latitude, -90 to 90", -90.0..=90.0)?;
        let lon_deg = coordinate("lon_deg", "a longitude, -180 to 180", -180.0..=180.0)?;
        let projected = projection.project(lat_deg, lon_deg);
        let located = clamp_to_area(area, projected);
        located.map_err(|reason| format!("lat_deg = {lat_deg}, lon_deg = {lon_deg}: {reason}"))
    }

    /// The number of a row in `column`; `None` if the list has no such column.
    fn number(
        &self,
        row: &csv::StringRecord,
        column: &str,
        expected: &str,
        is_accepted: impl Fn(f64) -> bool,
    ) -> Result<Option<f64>, String> {
        let Some(index) = self.header.iter().position(|name| name == column) else { return Ok(None) };
        let number = row[index].parse::<f64>().ok().filter(|&value| is_accepted(value));
        number.map(Some).ok_or_else(|| format!("{column} = {}: expected {expected}", quoted(&row[index])))
    }
}

/// The projected position, clamped to the area if it is at most [`RIM_SLACK_M`] outside; otherwise an error with the
/// position and what was expected.
fn clamp_to_area(area: &Area, projected: Option<Position>) -> Result<Position, String> {
    let expected = format!("a position in the area, [0, {}] × [0, {}]", area.width_m(), area.height_m());
    let Some(position) = projected else {
        return Err(format!("on the far side of the Earth: expected {expected}"));
    };
    if area.contains(&position, RIM_SLACK_M) {
        return Ok(Position::new(position.x.clamp(0.0, area.width_m()), position.y.clamp(0.0, area.height_m())));
    }
    Err(format!("{:.3} m east and {:.3} m north of the origin: expected {expected}", position.x, position.y))
}
