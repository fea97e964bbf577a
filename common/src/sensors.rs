//! The sensor nodes as flown: drawn from the seed or read from a CSV list, and written back with every column.

use std::path::{Path, PathBuf};

use rand::RngExt;
use rand_distr::{Distribution, Poisson};

use crate::geometry::Position;
use crate::message::SensorNode;
use crate::random::{Purpose, Streams};
use crate::scenario::{Scenario, SensorSource};
use crate::units::ratio_of_db;

/// Columns of the list, in the order in which it is written.
const COLUMNS: [&str; 5] = ["x_m", "y_m", "queue_bits", "gain_db", "sampling_bps"];

/// One sensor node of the list.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensor {
    /// Where it stands, `L_i`.
    pub position: Position,
    /// What it holds before slot 1 [bit], at most its storage.
    pub queue_bits: u32,
    /// Reference channel gain at 1 m, `α_i` [dB].
    pub gain_db: f64,
    /// Sampling rate `s_i` [bit/s].
    pub sampling_bps: f64,
}

/// All sensor nodes of a mission, at least one; SN i is entry i.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorList(Vec<Sensor>);

/// Why a sensor list is refused; the display is one line that names the file, the line, the value and what was expected.
#[derive(Debug, thiserror::Error)]
pub enum SensorListError {
    /// The file cannot be read.
    #[error("sensor list {}: {source}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
    /// The file is not a list of sensor nodes.
    #[error("sensor list {}: line {line}: {message}", path.display())]
    Row {
        /// The file.
        path: PathBuf,
        /// Line, from 1; the header is line 1.
        line: u64,
        /// What is wrong there and what was expected.
        message: String,
    },
}

impl SensorList {
    /// The sensor nodes of a scenario: drawn from its seed, or read from its file.
    ///
    /// # Errors
    /// If the file cannot be read or holds a bad row.
    pub fn of(scenario: &Scenario) -> Result<Self, SensorListError> {
        match &scenario.sensors.source {
            SensorSource::Drawn(count) => Ok(Self((0..*count).map(|id| draw(scenario, id)).collect())),
            SensorSource::File(path) => {
                let text = std::fs::read_to_string(path)
                    .map_err(|source| SensorListError::Unreadable { path: path.clone(), source })?;
                Self::parse(&text, path, scenario)
            }
        }
    }

    /// Checks the text of the list `path`. Columns that it leaves out are drawn, or the scenario's value.
    ///
    /// # Errors
    /// If a row is bad, or there is none.
    pub fn parse(text: &str, path: &Path, scenario: &Scenario) -> Result<Self, SensorListError> {
        let refuse = |line, message| SensorListError::Row { path: path.to_owned(), line, message };
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).flexible(true).from_reader(text.as_bytes());
        let header = reader.headers().map_err(|error| refuse(1, error.to_string()))?.clone();
        let columns = columns_of(&header).map_err(|message| refuse(1, message))?;
        let mut sensors = Vec::new();
        for row in reader.records() {
            let row = row.map_err(|error| {
                let line = error.position().map_or(0, csv::Position::line);
                refuse(line, "expected UTF-8 text".to_owned())
            })?;
            let line = row.position().map_or(0, csv::Position::line);
            if row.len() != header.len() {
                return Err(refuse(line, format!("{} fields: expected {}, as in the header", row.len(), header.len())));
            }
            let id = u32::try_from(sensors.len()).map_err(|_| refuse(line, "expected at most 2^32 rows".to_owned()))?;
            sensors.push(read(&row, columns, scenario, id).map_err(|message| refuse(line, message))?);
        }
        if sensors.is_empty() {
            return Err(refuse(1, "no rows: expected at least one sensor node".to_owned()));
        }
        Ok(Self(sensors))
    }

    /// The list as a CSV file with every column; floats read back exactly.
    #[must_use]
    pub fn to_csv(&self) -> String {
        let mut text = COLUMNS.join(",") + "\n";
        for Sensor { position, queue_bits, gain_db, sampling_bps } in &self.0 {
            let line = format!("{},{},{queue_bits},{gain_db},{sampling_bps}\n", position.x, position.y);
            text.push_str(&line);
        }
        text
    }

    /// The sensor nodes, by id.
    #[must_use]
    pub fn sensors(&self) -> &[Sensor] {
        &self.0
    }

    /// The queues before slot 1 [bit], by id.
    #[must_use]
    pub fn queues_bits(&self) -> Vec<u32> {
        self.0.iter().map(|sensor| sensor.queue_bits).collect()
    }

    /// The list as it is published on the topic `sensors`.
    #[must_use]
    pub fn nodes(&self, capacity_bits: u32) -> Vec<SensorNode> {
        let node = |sensor: &Sensor| SensorNode {
            x_m: sensor.position.x,
            y_m: sensor.position.y,
            gain: ratio_of_db(sensor.gain_db),
            sampling_bps: sensor.sampling_bps,
            capacity_bits,
            reserved: 0,
        };
        self.0.iter().map(node).collect()
    }
}

/// Sensor node `id` of a field that is drawn from the seed.
fn draw(scenario: &Scenario, id: u32) -> Sensor {
    let mut stream = Streams::new(scenario.seed).stream(Purpose::Position, 0, id);
    let x_m = stream.random::<f64>() * scenario.area.width_m;
    let y_m = stream.random::<f64>() * scenario.area.height_m;
    Sensor {
        position: Position::new(x_m, y_m),
        queue_bits: draw_queue_bits(scenario, id),
        gain_db: draw_gain_db(scenario, 0, id),
        sampling_bps: scenario.sensors.sampling_bps,
    }
}

/// Initial queue [bit] of sensor node `id`: Poisson, capped at the storage.
fn draw_queue_bits(scenario: &Scenario, id: u32) -> u32 {
    let mean_bits = scenario.sensors.initial_queue_mean_bits;
    if mean_bits == 0.0 {
        return 0;
    }
    let mut stream = Streams::new(scenario.seed).stream(Purpose::InitialQueue, 0, id);
    let drawn_bits: f64 =
        Poisson::new(mean_bits).expect("the scenario's mean is finite and above 0").sample(&mut stream);
    drawn_bits.min(f64::from(scenario.sensors.capacity_bits)) as u32
}

/// Reference gain [dB] of sensor node `id` in `slot` (0: of the mission), uniform in dB.
#[must_use]
pub fn draw_gain_db(scenario: &Scenario, slot: u64, id: u32) -> f64 {
    let [lowest_db, highest_db] = scenario.link.gain_db;
    let share: f64 = Streams::new(scenario.seed).stream(Purpose::Gain, slot, id).random();
    lowest_db + (highest_db - lowest_db) * share
}

/// Where each of [`COLUMNS`] stands in the file.
type Columns = [Option<usize>; 5];

fn columns_of(header: &csv::StringRecord) -> Result<Columns, String> {
    let mut columns = [None; 5];
    for (place, name) in header.iter().enumerate() {
        let Some(column) = COLUMNS.iter().position(|known| *known == name) else {
            return Err(format!("column `{name}`: expected some of {}", COLUMNS.join(",")));
        };
        if columns[column].replace(place).is_some() {
            return Err(format!("column `{name}` twice: expected it once"));
        }
    }
    match columns {
        [Some(_), Some(_), ..] => Ok(columns),
        _ => Err(format!("header `{}`: expected x_m,y_m and optionally queue_bits,gain_db,sampling_bps", join(header))),
    }
}

fn join(record: &csv::StringRecord) -> String {
    record.iter().collect::<Vec<_>>().join(",")
}

/// One row of the list; the error says which column, the value and what was expected.
fn read(row: &csv::StringRecord, columns: Columns, scenario: &Scenario, id: u32) -> Result<Sensor, String> {
    let number = |column: usize, expected: &str, holds: &dyn Fn(f64) -> bool| -> Result<Option<f64>, String> {
        let Some(place) = columns[column] else {
            return Ok(None);
        };
        match row[place].parse::<f64>() {
            Ok(value) if holds(value) => Ok(Some(value)),
            _ => Err(format!("{} = {}: expected {expected}", COLUMNS[column], &row[place])),
        }
    };
    let area = scenario.area;
    let inside = |extent_m: f64| move |value: f64| (0.0..=extent_m).contains(&value);
    let x_m = number(0, &format!("a position in the area, 0 to {}", area.width_m), &inside(area.width_m))?;
    let y_m = number(1, &format!("a position in the area, 0 to {}", area.height_m), &inside(area.height_m))?;
    let capacity = f64::from(scenario.sensors.capacity_bits);
    let whole = |value: f64| (0.0..=capacity).contains(&value) && value.fract() == 0.0;
    let queue_bits = number(2, &format!("whole bits, 0 to the storage's {capacity}"), &whole)?;
    let gain_db = number(3, "a level from -300 to 0 dB", &|value| (-300.0..=0.0).contains(&value))?;
    let rate = |value: f64| (0.0..=9.0e15 / (scenario.slot_s * scenario.slots as f64)).contains(&value);
    let sampling_bps = number(4, "a finite rate, 0 or above, at most 9e15 bits over the mission", &rate)?;
    Ok(Sensor {
        position: Position::new(x_m.expect("a required column"), y_m.expect("a required column")),
        queue_bits: queue_bits.map_or_else(|| draw_queue_bits(scenario, id), |bits| bits as u32),
        gain_db: gain_db.unwrap_or_else(|| draw_gain_db(scenario, 0, id)),
        sampling_bps: sampling_bps.unwrap_or(scenario.sensors.sampling_bps),
    })
}
