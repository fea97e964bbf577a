//! The sensor list: drawn from the seed or read from a CSV file, and written back with all columns.
//!
//! The rows of a file are left to `rows`.

use std::path::Path;

use rand::RngExt;
use rand_distr::{Distribution, Poisson};

use super::Sensors;
use super::rows::{self, Rows};
use crate::airspace::Polygon;
use crate::arrivals::{ArrivalLaw, ArrivalTrace, Arrivals, MAX_SAMPLED_BITS, mean_bits};
use crate::channel::draw_gain_db;
use crate::error::{InputError, read_text};
use crate::geometry::Position;
use crate::interpolation::interpolate;
use crate::ledger::Ledger;
use crate::loss_rate::LossRate;
use crate::message::SensorNode;
use crate::nodes::energy::HarvestTrace;
use crate::nodes::{NodeColumn, NodeFeatures, NodeRow, NodeSetup};
use crate::random::{Purpose, Streams};
use crate::sampling::Sampling;
use crate::scenario::{CHANNEL, Interval, RATES, Scenario, TRACE};
use crate::units::ratio_of_db;
use crate::weights::Weights;

/// One sensor node of the list.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensor {
    /// Position, `L_i`.
    pub position: Position,
    /// Queue before slot 1 [bit], at most the buffer.
    pub queue_bits: u32,
    /// Reference channel gain at 1 m, `α_i` [dB].
    pub gain_db: f64,
    /// Sampling rate `s_i` [bit/s].
    pub sampling_bps: f64,
    /// Buffer, `B_i` [bit].
    pub capacity_bits: u32,
    /// Weight of its bits, `w_i` (decision D25); 1 if the list has no weights.
    pub weight: f64,
}

/// A column of a feature of the sensor nodes.
#[derive(Debug, Clone, PartialEq)]
pub struct FeatureColumn {
    /// Its name.
    pub name: &'static str,
    /// Its numbers, by id.
    pub values: Vec<f64>,
    /// Whether the scenario alone does not tell the columns of the feature.
    is_own: bool,
}

impl FeatureColumn {
    /// The columns of the features that the mission has, for `count` sensor nodes; `listed` are those of the list.
    fn of(scenario: &Scenario, count: usize, listed: &[(&'static str, Vec<f64>)]) -> Vec<Self> {
        let keys = scenario.node_keys();
        let column = |column: &NodeColumn| {
            let of_keys = (column.of_keys)(keys.sensors);
            let own = listed.iter().find(|(name, _)| *name == column.name).map(|(_, values)| values.clone());
            let of_all = || vec![of_keys.expect("a list without this column is refused"); count];
            let values = own.unwrap_or_else(of_all);
            Self { name: column.name, is_own: values.iter().any(|value| Some(*value) != of_keys), values }
        };
        let of_row = |row: NodeRow| {
            let mut columns: Vec<Self> = row.columns.iter().map(column).collect();
            let is_own = columns.iter().any(|column| column.is_own);
            columns.iter_mut().for_each(|column| column.is_own = is_own);
            columns
        };
        keys.rows().flat_map(of_row).collect()
    }
}

/// All sensor nodes of a mission, at least one; SN i is entry i.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorList {
    sensors: Vec<Sensor>,
    /// The name of each; empty if none has one.
    names: Vec<String>,
    /// The altitude of the ground at each [m]; empty if the list has none.
    ground_m: Vec<f64>,
    /// The arrivals, if they are those of a file.
    trace: Option<ArrivalTrace>,
    /// The columns of the features that the mission has.
    columns: Vec<FeatureColumn>,
    /// The files of these features, by their names in a run folder.
    files: Vec<(&'static str, HarvestTrace)>,
    /// Whether the scenario alone does not tell the buffers.
    has_own_buffers: bool,
}

/// Most arrivals at random: sensor nodes times slots.
const MOST_ARRIVALS: f64 = 1e8;

impl SensorList {
    /// The sensor nodes of a scenario: drawn from its seed, or read from its file.
    ///
    /// # Errors
    /// If the file cannot be read or has an invalid row.
    pub fn of(scenario: &Scenario) -> Result<Self, InputError> {
        let Some(path) = scenario.sensor_file() else {
            let count = scenario.sensors.count.unwrap_or(0);
            let border = scenario.area.border();
            let sensors = (0..count).map(|id| draw(scenario, border.as_ref(), id)).collect();
            return Self::new(Rows { sensors, ..Rows::default() }, scenario);
        };
        let text = read_text("sensor list", &path).map_err(|error| {
            let source = path.with_file_name("SOURCE.md");
            let key = "the file of sensors.file in";
            let scenario = scenario.path.display();
            let remedy =
                if source.is_file() { format!("; {} says how to get it", source.display()) } else { String::new() };
            InputError::new("sensor list", &path, format_args!("{} ({key} {scenario}){remedy}", error.message))
        })?;
        Self::parse(&text, &path, scenario)
    }

    /// The same without its arrivals, whose file is not read.
    ///
    /// # Errors
    /// As [`Self::of`].
    pub fn without_arrivals(scenario: &Scenario) -> Result<Self, InputError> {
        let mut scenario = scenario.clone();
        scenario.sensors.arrivals = None;
        Self::of(&scenario)
    }

    /// Parses the text of the list `path`. Missing columns are drawn, or filled with the value of the scenario;
    /// latitude and longitude are projected onto the area.
    ///
    /// # Errors
    /// If a row is invalid, or there is none.
    pub fn parse(text: &str, path: &Path, scenario: &Scenario) -> Result<Self, InputError> {
        Self::parse_rows(text, path, scenario, |_, line| format!("line {line}"))
    }

    /// Parses a list that was converted from the file `path`. For errors, `locate` describes the origin of a row, given
    /// its index and its line in the text.
    ///
    /// # Errors
    /// If a row is invalid, or there is none.
    pub fn parse_rows(
        text: &str,
        path: &Path,
        scenario: &Scenario,
        locate: impl Fn(usize, u64) -> String,
    ) -> Result<Self, InputError> {
        let refuse = |message| InputError::new("sensor list", path, message);
        Self::new(rows::read(text, scenario, locate).map_err(refuse)?, scenario)
    }

    /// The location of sensor node `id` in the list `path`, for messages: its line, or its id if the list is gone.
    #[must_use]
    pub fn place_of(path: &Path, id: usize) -> String {
        let line = read_text("sensor list", path).ok().and_then(|text| rows::line_of_row(&text, id));
        line.map_or_else(|| format!("SN {id}"), |line| format!("line {line}"))
    }

    fn new(rows: Rows, scenario: &Scenario) -> Result<Self, InputError> {
        let Rows { sensors, mut names, ground_m, columns } = rows;
        if names.iter().all(String::is_empty) {
            names.clear();
        }
        let sampling_bps: Vec<f64> = sensors.iter().map(|sensor| sensor.sampling_bps).collect();
        let trace = match (&scenario.trace, scenario.trace_file()) {
            (None, Some(path)) => Some(ArrivalTrace::read(&path, &sampling_bps)?),
            (held, _) => held.clone(),
        };
        let keys = scenario.node_keys();
        let mut files = Vec::new();
        for file in keys.rows().filter_map(|row| row.file) {
            if let Some(path) = (file.of_keys)(&mut keys.sensors.clone()) {
                files.push((file.name, HarvestTrace::read(&scenario.beside(path), sensors.len())?));
            }
        }
        let law = scenario.arrival_law();
        let refuse = |key: &str, value: f64, expected: &str| {
            Err(InputError::new("scenario", &scenario.path, format_args!("{key} = {value}: expected {expected}")))
        };
        if law.is_random() && sensors.len() as f64 * scenario.slots as f64 > MOST_ARRIVALS {
            let most = (MOST_ARRIVALS / sensors.len() as f64).floor();
            let expected = format!("at most {most} with arrivals at random from {} sensor nodes", sensors.len());
            return refuse("slots", scenario.slots as f64, &expected);
        }
        if let Some(refusal) = keys.rows().find_map(|row| (row.refusal)(&keys, sensors.len())) {
            return refuse(refusal.key, refusal.value, &refusal.expected);
        }
        if let ArrivalLaw::OnOff { on_slots, off_slots } = law {
            let highest_bps = sampling_bps.iter().copied().fold(0.0, f64::max);
            let always_on = highest_bps * (on_slots + off_slots) / on_slots * scenario.slot_s * scenario.slots as f64;
            if always_on > MAX_SAMPLED_BITS {
                let expected =
                    "at most 9e15 bits in the mission from a sensor node that is always on, at s (on_s + off_s)/on_s";
                return refuse("sensors.arrivals.off_s", off_slots * scenario.slot_s, expected);
            }
        }
        let plain_bits = scenario.sensors.capacity_bits.ends();
        let has_own_buffers = sensors.iter().any(|sensor| [sensor.capacity_bits; 2] != plain_bits);
        let columns = FeatureColumn::of(scenario, sensors.len(), &columns);
        Ok(Self { sensors, names, ground_m, trace, columns, files, has_own_buffers })
    }

    /// Hash (XXH3) of the list as CSV files, seeded with the hash of its scenario.
    pub fn hash(&self, scenario_hash: u64) -> u64 {
        let hash = |seed, text: String| xxhash_rust::xxh3::xxh3_64_with_seed(text.as_bytes(), seed);
        let listed = hash(scenario_hash, self.to_csv());
        let arrivals = self.trace.iter().fold(listed, |seed, trace| hash(seed, trace.to_csv()));
        self.files.iter().fold(arrivals, |seed, (_, file)| hash(seed, file.to_csv()))
    }

    /// The files that a scenario with this list names besides the list, by their names in a run folder.
    pub fn files_beside(&self, scenario: &Scenario) -> impl Iterator<Item = (&'static str, String)> {
        let trace = self.trace.as_ref().map(|trace| (TRACE, trace.to_csv()));
        let of_features = self.files.iter().map(|(name, file)| (*name, file.to_csv()));
        let table = scenario.link.table.as_ref().map(|table| (CHANNEL, table.to_csv()));
        let (levels, rates) = scenario.link.map.as_ref().map_or((None, None), |map| {
            let (levels, rates) = map.to_csv();
            (Some((CHANNEL, levels)), rates.map(|rates| (RATES, rates)))
        });
        trace.into_iter().chain(of_features).chain(table).chain(levels).chain(rates)
    }

    /// The arrivals, if they are those of a file.
    pub fn trace(&self) -> Option<&ArrivalTrace> {
        self.trace.as_ref()
    }

    /// The list as a CSV file with all columns: that of buffers if one is not that of the scenario, that of weights if
    /// one is not 1, those of a feature if one is not that of the scenario, that of the ground if the list had it, and
    /// that of names if there are some. Floats round-trip exactly.
    pub fn to_csv(&self) -> String {
        let has_buffers = self.has_own_buffers;
        let has_weights = self.has_own_weights();
        let own_columns = || self.columns.iter().filter(|column| column.is_own);
        let mut text = rows::WRITTEN.join(",");
        let further = [(has_buffers, rows::CAPACITY), (has_weights, rows::WEIGHT)].into_iter();
        let further = further.chain(own_columns().map(|column| (true, column.name)));
        let further = further.chain([(!self.ground_m.is_empty(), rows::GROUND)]);
        further.filter(|(is_written, _)| *is_written).for_each(|(_, name)| text.push_str(&format!(",{name}")));
        self.end_line(&mut text, rows::NAME);
        for (id, sensor) in self.sensors.iter().enumerate() {
            let Sensor { position, queue_bits, gain_db, sampling_bps, capacity_bits, weight } = sensor;
            text.push_str(&format!("{},{},{queue_bits},{gain_db},{sampling_bps}", position.x, position.y));
            if has_buffers {
                text.push_str(&format!(",{capacity_bits}"));
            }
            if has_weights {
                text.push_str(&format!(",{weight}"));
            }
            own_columns().for_each(|column| text.push_str(&format!(",{}", column.values[id])));
            if let Some(ground_m) = self.ground_m.get(id) {
                text.push_str(&format!(",{ground_m}"));
            }
            self.end_line(&mut text, self.name(id).unwrap_or_default());
        }
        text
    }

    /// Ends a line of a CSV file about sensor nodes, with `name` as its last cell if there are names.
    pub fn end_line(&self, text: &mut String, name: &str) {
        if !self.names.is_empty() {
            let needs_quotes = name.contains([',', '"']);
            let name = if needs_quotes { format!("\"{}\"", name.replace('"', "\"\"")) } else { name.to_owned() };
            text.push_str(&format!(",{name}"));
        }
        text.push('\n');
    }

    /// The names in the list of a scenario, by id; none if the list has none, or cannot be read.
    #[must_use]
    pub fn names_of(scenario: &Scenario) -> Vec<String> {
        scenario.sensor_file().and_then(|_| Self::of(scenario).ok()).map_or_else(Vec::new, |list| list.names)
    }

    /// The name of sensor node `id`; `None` if it has none.
    pub fn name(&self, id: usize) -> Option<&str> {
        self.names.get(id).map(String::as_str).filter(|name| !name.is_empty())
    }

    /// The sensor nodes of this name, by id.
    pub fn ids_named(&self, name: &str) -> impl Iterator<Item = usize> {
        self.names.iter().enumerate().filter(move |(_, own)| !name.is_empty() && *own == name).map(|(id, _)| id)
    }

    /// The name of sensor node `id`, or `SN id` if it has none.
    pub fn label(&self, id: usize) -> String {
        self.name(id).map_or_else(|| format!("SN {id}"), str::to_owned)
    }

    /// The sensor nodes, by id.
    pub fn sensors(&self) -> &[Sensor] {
        &self.sensors
    }

    /// The altitude of the ground at each sensor node [m], above the same level, by id; empty if the list does not have
    /// it.
    pub fn ground_m(&self) -> &[f64] {
        &self.ground_m
    }

    /// Whether a sensor node has a weight other than 1.
    pub fn has_own_weights(&self) -> bool {
        self.sensors.iter().any(|sensor| sensor.weight != 1.0)
    }

    /// The weights of the sensor nodes (decision D25).
    pub fn weights(&self, sampling: &Sampling) -> Weights {
        Weights::new(self.sensors.iter().map(|sensor| sensor.weight).collect(), sampling)
    }

    /// The queues before slot 1 [bit], by id.
    pub fn queues_bits(&self) -> Vec<u32> {
        self.sensors.iter().map(|sensor| sensor.queue_bits).collect()
    }

    /// The sampling of the sensor nodes in the slots of their scenario, with the arrivals that are drawn from its seed.
    pub fn sampling(&self, scenario: &Scenario) -> Sampling {
        let mean_bits = self.sensors.iter().map(|sensor| mean_bits(sensor.sampling_bps, scenario.slot_s)).collect();
        let streams = Streams::new(scenario.seed);
        let law = scenario.arrival_law();
        let arrivals = Arrivals::of(law, self.trace.as_ref(), streams, self.sensors.len(), scenario.slots);
        let capacities_bits = self.sensors.iter().map(|sensor| sensor.capacity_bits).collect();
        Sampling::new(mean_bits, capacities_bits)
            .with_arrivals(arrivals)
            .with_lasting_slots(scenario.node_traits().lasting_slots)
    }

    /// The columns of the features that the mission has.
    pub fn columns(&self) -> &[FeatureColumn] {
        &self.columns
    }

    /// The features of the sensor nodes before slot 1.
    pub fn features(&self, scenario: &Scenario) -> NodeFeatures {
        let keys = scenario.node_keys();
        let queues_bits = self.queues_bits();
        let column = |name: &str| -> &[f64] {
            let found = self.columns.iter().find(|column| column.name == name);
            &found.expect("a list has the columns of the features of its mission").values
        };
        let position = |id: usize| self.sensors[id].position;
        let make = |row: NodeRow| {
            let file = row.file.and_then(|file| self.files.iter().find(|(name, _)| *name == file.name));
            (row.make)(&NodeSetup {
                keys,
                queues_bits: &queues_bits,
                position: &position,
                column: &column,
                file: file.map(|(_, file)| file),
            })
        };
        keys.rows().filter_map(make).collect()
    }

    /// The ledger before slot 1.
    pub fn ledger(&self, scenario: &Scenario) -> Ledger {
        Ledger::new(self.sampling(scenario), self.queues_bits()).with_features(self.features(scenario))
    }

    /// The sensor nodes with what they sample: the truth, which a planner does not know.
    pub fn sensors_of(&self, scenario: &Scenario) -> Sensors {
        Sensors { sampling: self.sampling(scenario), ..Sensors::of(scenario, &self.nodes()) }
    }

    /// Mean bits that each sensor node samples in a slot, `s_i τ`.
    fn means_bits(&self, scenario: &Scenario) -> impl Iterator<Item = f64> {
        self.sensors.iter().map(|sensor| mean_bits(sensor.sampling_bps, scenario.slot_s))
    }

    /// Mean bits that all sensor nodes sample in a slot, `Σ s_i τ`.
    pub fn slot_bits(&self, scenario: &Scenario) -> f64 {
        self.means_bits(scenario).sum()
    }

    /// The loss rate of all sensor nodes.
    pub fn loss_rate(&self, scenario: &Scenario) -> LossRate {
        LossRate::of(scenario, self.means_bits(scenario))
    }

    /// Bits that count as sampled in the whole mission ([`LossRate::sampled_bits`]).
    pub fn mission_bits(&self, scenario: &Scenario) -> f64 {
        let initial_bits = self.sensors.iter().map(|sensor| f64::from(sensor.queue_bits)).sum();
        let drawn_bits = || {
            let sampling = self.sampling(scenario);
            (0..self.sensors.len()).map(|id| sampling.sampled_bits(id, scenario.slots)).sum::<u64>() as f64
        };
        self.loss_rate(scenario).sampled_bits(scenario.slots, initial_bits, drawn_bits)
    }

    /// The list as published on the topic `sensors`.
    pub fn nodes(&self) -> Vec<SensorNode> {
        let node = |sensor: &Sensor| SensorNode {
            x_m: sensor.position.x,
            y_m: sensor.position.y,
            gain: ratio_of_db(sensor.gain_db),
            sampling_bps: sensor.sampling_bps,
            capacity_bits: sensor.capacity_bits,
            reserved: 0,
            weight: sensor.weight,
        };
        self.sensors.iter().map(node).collect()
    }
}

/// Draws sensor node `id` from the seed, within the `border` of the area if it has one.
fn draw(scenario: &Scenario, border: Option<&Polygon>, id: u32) -> Sensor {
    let mut stream = Streams::new(scenario.seed).stream(Purpose::Position, 0, id);
    let position = loop {
        let [x, y] = [stream.random::<f64>(), stream.random::<f64>()];
        let drawn = match border.map(Polygon::extent) {
            None => Position::new(x * scenario.area.width_m(), y * scenario.area.height_m()),
            Some([low, high]) => Position::new(interpolate(low.x, high.x, x), interpolate(low.y, high.y, y)),
        };
        if border.is_none_or(|border| border.encloses(&drawn)) {
            break drawn;
        }
    };
    let capacity_bits = draw_capacity_bits(scenario, id);
    Sensor {
        position,
        queue_bits: draw_queue_bits(scenario, id, capacity_bits),
        gain_db: draw_gain_db(scenario.link.gain_range_db(), &Streams::new(scenario.seed), 0, id),
        sampling_bps: draw_sampling_bps(scenario, id),
        capacity_bits,
        weight: 1.0,
    }
}

/// Buffer [bit] of sensor node `id`.
pub(super) fn draw_capacity_bits(scenario: &Scenario, id: u32) -> u32 {
    let [lowest, highest] = scenario.sensors.capacity_bits.ends();
    if lowest == highest {
        return lowest;
    }
    Streams::new(scenario.seed).stream(Purpose::Capacity, 0, id).random_range(lowest..=highest)
}

/// Sampling rate [bit/s] of sensor node `id`.
pub(super) fn draw_sampling_bps(scenario: &Scenario, id: u32) -> f64 {
    draw_between(scenario, scenario.sensors.sampling_bps, Purpose::SamplingRate, id)
}

/// Draws a number for sensor node `id`, uniform in the interval.
fn draw_between(scenario: &Scenario, interval: Interval, purpose: Purpose, id: u32) -> f64 {
    let [lowest, highest] = interval.ends();
    if lowest == highest {
        return lowest;
    }
    let fraction: f64 = Streams::new(scenario.seed).stream(purpose, 0, id).random();
    interpolate(lowest, highest, fraction).min(highest)
}

/// Initial queue [bit] of sensor node `id`: Poisson with a mean drawn for it, capped at its buffer [bit].
pub(super) fn draw_queue_bits(scenario: &Scenario, id: u32, capacity_bits: u32) -> u32 {
    let mean_bits = draw_between(scenario, scenario.sensors.initial_queue_mean_bits, Purpose::InitialQueueMean, id);
    if mean_bits == 0.0 {
        return 0;
    }
    let mut stream = Streams::new(scenario.seed).stream(Purpose::InitialQueue, 0, id);
    let drawn_bits: f64 = Poisson::new(mean_bits)
        .expect("a mean in the scenario's range is finite, and above 0 here")
        .sample(&mut stream);
    drawn_bits.min(f64::from(capacity_bits)) as u32
}
