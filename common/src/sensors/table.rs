//! The rows of a sensor list: which columns it has, and one checked sensor node a row.
//!
//! Refusals are (line, message); the list adds the file. What a row leaves out is drawn by the parent module.

use super::projection::Projection;
use super::{Sensor, draw_queue_bits, draw_sampling_bps};
use crate::channel::draw_gain_db;
use crate::geometry::Position;
use crate::random::Streams;
use crate::scenario::{Area, LinkModel, MAX_FIELD_BITS, Scenario};

/// Columns in which a list is written, in this order.
pub(super) const WRITTEN: [&str; 5] = ["x_m", "y_m", "queue_bits", "gain_db", "sampling_bps"];

/// Columns that a list may have.
const COLUMNS: [&str; 7] = ["x_m", "y_m", "lat_deg", "lon_deg", "queue_bits", "gain_db", "sampling_bps"];

/// A projected position may miss the rim of the area by this [m], and is then on the rim: the origin's own meridian must
/// not fall outside by rounding.
const RIM_SLACK_M: f64 = 1e-6;

/// Line, from 1, and what is wrong there.
type Refusal = (u64, String);

/// Reads the text of a list; sensor node i is row i.
pub(super) fn read(text: &str, scenario: &Scenario) -> Result<Vec<Sensor>, Refusal> {
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).flexible(true).from_reader(text.as_bytes());
    let header = reader.headers().map_err(|error| (1, error.to_string()))?.clone();
    let table = Table::of(&header, scenario).map_err(|message| (1, message))?;
    let mission_s = scenario.slot_s * scenario.slots as f64;
    let (mut sensors, mut field_bits) = (Vec::new(), 0.0);
    for row in reader.records() {
        let row = row.map_err(|error| {
            let line = error.position().map_or(0, csv::Position::line);
            (line, "expected UTF-8 text".to_owned())
        })?;
        let line = row.position().map_or(0, csv::Position::line);
        if row.len() != header.len() {
            return Err((line, format!("{} fields: expected {}, as in the header", row.len(), header.len())));
        }
        let id = u32::try_from(sensors.len()).map_err(|_| (line, "expected at most 2^32 rows".to_owned()))?;
        let sensor = table.sensor(&row, id).map_err(|message| (line, message))?;
        field_bits += sensor.sampling_bps * mission_s;
        if field_bits > MAX_FIELD_BITS {
            let expected = "at most 9e18 bits over the mission from all sensor nodes";
            return Err((line, format!("sampling_bps = {}: expected {expected}", sensor.sampling_bps)));
        }
        sensors.push(sensor);
    }
    if sensors.is_empty() {
        return Err((1, "no rows: expected at least one sensor node".to_owned()));
    }
    Ok(sensors)
}

/// How the rows of one list are read.
struct Table<'a> {
    scenario: &'a Scenario,
    frame: Frame,
    queue_bits: Option<usize>,
    gain_db: Option<usize>,
    sampling_bps: Option<usize>,
}

/// What the positions of a list are, and the places of their two columns.
enum Frame {
    /// Metres from the south-west corner of the area.
    Area { x_m: usize, y_m: usize },
    /// Degrees on the Earth.
    Earth { lat_deg: usize, lon_deg: usize, projection: Projection },
}

impl<'a> Table<'a> {
    fn of(header: &csv::StringRecord, scenario: &'a Scenario) -> Result<Self, String> {
        let mut columns = [None; COLUMNS.len()];
        for (place, name) in header.iter().enumerate() {
            let Some(column) = COLUMNS.iter().position(|known| *known == name) else {
                return Err(format!("column `{name}`: expected some of {}", COLUMNS.join(",")));
            };
            if columns[column].replace(place).is_some() {
                return Err(format!("column `{name}` twice: expected it once"));
            }
        }
        let [x_m, y_m, lat_deg, lon_deg, queue_bits, gain_db, sampling_bps] = columns;
        let named = header.iter().collect::<Vec<_>>().join(",");
        let frame = match (x_m, y_m, lat_deg, lon_deg) {
            (Some(x_m), Some(y_m), None, None) => Frame::Area { x_m, y_m },
            (None, None, Some(lat_deg), Some(lon_deg)) => {
                let expected = "area.origin_lat_deg and area.origin_lon_deg in the scenario";
                let origin = scenario.area.origin.ok_or_else(|| format!("header `{named}`: expected {expected}"))?;
                Frame::Earth { lat_deg, lon_deg, projection: Projection::about(origin) }
            }
            _ => {
                let expected = "x_m,y_m or lat_deg,lon_deg, not both, and optionally queue_bits,gain_db,sampling_bps";
                return Err(format!("header `{named}`: expected {expected}"));
            }
        };
        Ok(Self { scenario, frame, queue_bits, gain_db, sampling_bps })
    }

    /// One row; the error says which column, the value and what was expected.
    fn sensor(&self, row: &csv::StringRecord, id: u32) -> Result<Sensor, String> {
        let scenario = self.scenario;
        let optional = |place: Option<usize>, name, expected: &str, holds: &dyn Fn(f64) -> bool| {
            place.map(|place| number(&row[place], name, expected, holds)).transpose()
        };
        let position = self.position(row)?;
        let capacity = f64::from(scenario.sensors.capacity_bits);
        let whole = |value: f64| (0.0..=capacity).contains(&value) && value.fract() == 0.0;
        let expected = format!("whole bits, 0 to the storage's {capacity}");
        let queue_bits = optional(self.queue_bits, "queue_bits", &expected, &whole)?;
        let level = |value: f64| (-300.0..=0.0).contains(&value);
        let gain_db = optional(self.gain_db, "gain_db", "a level from -300 to 0 dB", &level)?;
        let rate = |value: f64| (0.0..=9.0e15 / (scenario.slot_s * scenario.slots as f64)).contains(&value);
        let expected = "a finite rate, 0 or above, at most 9e15 bits over the mission";
        let sampling_bps = optional(self.sampling_bps, "sampling_bps", expected, &rate)?;
        Ok(Sensor {
            position,
            queue_bits: queue_bits.map_or_else(|| draw_queue_bits(scenario, id), |bits| bits as u32),
            // The probabilistic model has one reference gain for all, whatever the list says.
            gain_db: gain_db
                .filter(|_| scenario.link.model == LinkModel::FreeSpace)
                .unwrap_or_else(|| draw_gain_db(scenario.link.gain_range_db(), &Streams::new(scenario.seed), 0, id)),
            sampling_bps: sampling_bps.unwrap_or_else(|| draw_sampling_bps(scenario, id)),
        })
    }

    fn position(&self, row: &csv::StringRecord) -> Result<Position, String> {
        let area = self.scenario.area;
        match &self.frame {
            Frame::Area { x_m, y_m } => {
                let along = |place: usize, name, extent_m: f64| {
                    let expected = format!("a position in the area, 0 to {extent_m}");
                    number(&row[place], name, &expected, &|value| (0.0..=extent_m).contains(&value))
                };
                Ok(Position::new(along(*x_m, "x_m", area.width_m)?, along(*y_m, "y_m", area.height_m)?))
            }
            Frame::Earth { lat_deg, lon_deg, projection } => {
                let lat_deg = number(&row[*lat_deg], "lat_deg", "a latitude, -90 to 90", &|deg| deg.abs() <= 90.0)?;
                let lon_deg = number(&row[*lon_deg], "lon_deg", "a longitude, -180 to 180", &|deg| deg.abs() <= 180.0)?;
                let projected = projection.project(lat_deg, lon_deg);
                onto(area, projected).map_err(|reason| format!("lat_deg = {lat_deg}, lon_deg = {lon_deg}: {reason}"))
            }
        }
    }
}

/// A projected position in the area, [`RIM_SLACK_M`] taken back; else where it is and what was expected.
fn onto(area: Area, projected: Option<Position>) -> Result<Position, String> {
    let expected = format!("a position in the area, [0, {}] × [0, {}]", area.width_m, area.height_m);
    let Some(position) = projected else {
        return Err(format!("on the far side of the Earth: expected {expected}"));
    };
    let (x_m, y_m) = (position.x, position.y);
    if area.contains(&position, RIM_SLACK_M) {
        return Ok(Position::new(x_m.clamp(0.0, area.width_m), y_m.clamp(0.0, area.height_m)));
    }
    Err(format!("{x_m:.3} m east and {y_m:.3} m north of the origin: expected {expected}"))
}

fn number(text: &str, column: &str, expected: &str, holds: &dyn Fn(f64) -> bool) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if holds(value) => Ok(value),
        _ => Err(format!("{column} = {text}: expected {expected}")),
    }
}
