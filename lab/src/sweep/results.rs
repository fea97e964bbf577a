//! The files that a sweep leaves: a row per mission, the summary with confidence intervals, and the timings.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use arrow_array::{ArrayRef, Float64Array, Int64Array, RecordBatch, StringArray, UInt64Array};
use arrow_schema::{DataType, Field, Schema};
use parquet::arrow::ArrowWriter;
use parquet::basic::Compression;
use parquet::file::properties::WriterProperties;
use skysink_mission::record::write_whole;
use skysink_planner::strategies::offline;

use super::journal::{MissionRow, MissionRows, missions_of};
use super::plan::Definition;
use super::statistics::MeanInterval;
use crate::error::LabError;

/// A column of the results that is summarised.
type Metric = (&'static str, fn(&MissionRow) -> f64);

/// The name under which the least loss of all strategies over each field is summarised.
pub const BEST_KNOWN: &str = "best-known";

/// The metrics of a mission, in the order of the columns, NaN where it has none; defined in `docs/metrics.md`.
pub const METRICS: [Metric; 11] = [
    ("loss_rate", |row| row.loss_rate),
    ("eta_letter", |row| row.eta_letter),
    ("delivered_bits", |row| row.delivered_bits as f64),
    ("bits_per_waypoint", |row| row.bits_per_waypoint),
    ("mean_served", |row| row.mean_served),
    ("flown_m", |row| row.flown_m),
    ("energy_j", |row| row.energy_j),
    ("aoi_mean_s", |row| row.aoi_mean_s),
    ("aoi_p99_s", |row| row.aoi_p99_s),
    ("jain", |row| row.jain),
    ("loss_bound", |row| row.loss_bound.unwrap_or(f64::NAN)),
];

/// Writes all files into `folder`; equal missions give equal bytes, but for the timings.
///
/// # Errors
/// If a file cannot be written.
pub fn write(folder: &Path, definition: &Definition, rows: &MissionRows) -> Result<(), LabError> {
    write_whole(&folder.join("results.csv"), &results_csv(definition, rows))?;
    write_whole(&folder.join("results.parquet"), &results_parquet(definition, rows))?;
    write_whole(&folder.join("summary.csv"), &summary_csv(definition, rows))?;
    Ok(write_whole(&folder.join("timings.csv"), &timings_csv(definition, rows))?)
}

/// A mission per row: swept keys, strategy, seed, metrics. Floats read back exactly.
fn results_csv(definition: &Definition, rows: &MissionRows) -> Vec<u8> {
    let header = header(definition, ["strategy", "seed"].into_iter().chain(METRICS.map(|(name, _)| name)));
    table(header, rows.values().map(|row| mission(definition, row).chain(METRICS.map(|metric| number(metric, row)))))
}

/// The same as Parquet, with a type for each column.
fn results_parquet(definition: &Definition, rows: &MissionRows) -> Vec<u8> {
    let (mut fields, mut columns) = (Vec::new(), Vec::<ArrayRef>::new());
    let mut add = |name: &str, kind, column: ArrayRef| {
        fields.push(Field::new(name, kind, column.is_nullable()));
        columns.push(column);
    };
    for (place, key) in definition.keys.iter().enumerate() {
        let (kind, column) = swept(definition, rows, place);
        add(key, kind, column);
    }
    let strategies = rows.values().map(|row| definition.strategies[row.strategy].name);
    add("strategy", DataType::Utf8, Arc::new(StringArray::from_iter_values(strategies)));
    add("seed", DataType::UInt64, Arc::new(UInt64Array::from_iter_values(rows.values().map(|row| row.seed))));
    for (name, value) in METRICS {
        if name == "delivered_bits" {
            let bits = rows.values().map(|row| row.delivered_bits);
            add(name, DataType::UInt64, Arc::new(UInt64Array::from_iter_values(bits)));
        } else {
            let values = rows.values().map(value).map(|value| Some(value).filter(|value| !value.is_nan()));
            add(name, DataType::Float64, Arc::new(values.collect::<Float64Array>()));
        }
    }
    let schema = Arc::new(Schema::new(fields));
    let batch =
        RecordBatch::try_new(Arc::clone(&schema), columns).expect("columns of one length and the schema's types");
    let properties = WriterProperties::builder().set_compression(Compression::SNAPPY).build();
    let mut bytes = Vec::new();
    let mut writer = ArrowWriter::try_new(&mut bytes, schema, Some(properties)).expect("plain types");
    writer.write(&batch).expect("memory takes everything");
    writer.close().expect("memory takes everything");
    bytes
}

/// The column of a swept key: whole numbers, numbers, or text.
fn swept(definition: &Definition, rows: &MissionRows, place: usize) -> (DataType, ArrayRef) {
    let values = || rows.values().map(|row| &definition.points[row.point][place]);
    if let Some(whole) = values().map(toml::Value::as_integer).collect::<Option<Vec<_>>>() {
        return (DataType::Int64, Arc::new(Int64Array::from(whole)));
    }
    let float = |value: &toml::Value| value.as_float().or_else(|| value.as_integer().map(|whole| whole as f64));
    match values().map(float).collect::<Option<Vec<_>>>() {
        Some(floats) => (DataType::Float64, Arc::new(Float64Array::from(floats))),
        None => (DataType::Utf8, Arc::new(StringArray::from_iter_values(values().map(text)))),
    }
}

/// A metric of a point and strategy per row: mean, standard deviation and confidence interval over the seeds. Where an
/// offline plan was flown, too, the best known loss of each point follows.
fn summary_csv(definition: &Definition, rows: &MissionRows) -> Vec<u8> {
    let names = ["strategy", "metric", "n", "mean", "standard_deviation", "ci95_low", "ci95_high"];
    let line = |point: usize, strategy: &str, metric: &str, values: &[f64]| {
        let estimate = MeanInterval::of(values);
        let interval = estimate.half_width.map(|half_width| (estimate.mean - half_width, estimate.mean + half_width));
        let figures = [
            strategy.to_owned(),
            metric.to_owned(),
            estimate.n.to_string(),
            estimate.mean.to_string(),
            estimate.deviation.map_or_else(String::new, |value| value.to_string()),
            interval.map_or_else(String::new, |(low, _)| low.to_string()),
            interval.map_or_else(String::new, |(_, high)| high.to_string()),
        ];
        definition.points[point].iter().map(text).chain(figures).collect::<Vec<_>>().into_iter()
    };
    let mut lines = Vec::new();
    for point in 0..definition.points.len() {
        for (strategy, name) in definition.strategies.iter().map(|strategy| strategy.name).enumerate() {
            for (metric, value) in METRICS {
                let values: Vec<f64> = missions_of(rows, point, strategy).map(value).collect();
                if !values.is_empty() && !values.iter().any(|value| value.is_nan()) {
                    lines.push(line(point, name, metric, &values));
                }
            }
        }
    }
    if definition.strategies.contains(&&offline::STRATEGY) {
        for (point, losses) in best_known(rows) {
            lines.push(line(point, BEST_KNOWN, "loss_rate", &losses));
        }
    }
    table(header(definition, names), lines.into_iter())
}

/// The least loss of all strategies, by point and seed.
#[must_use]
pub fn best_known(rows: &MissionRows) -> BTreeMap<usize, Vec<f64>> {
    let mut least: BTreeMap<(usize, u64), f64> = BTreeMap::new();
    for row in rows.values() {
        let known = least.entry((row.point, row.seed)).or_insert(f64::INFINITY);
        *known = known.min(row.loss_rate);
    }
    let mut points: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
    for ((point, _), loss_rate) in least {
        points.entry(point).or_default().push(loss_rate);
    }
    points
}

/// Planning times per mission, by the wall clock of whoever flew it.
fn timings_csv(definition: &Definition, rows: &MissionRows) -> Vec<u8> {
    let header = header(definition, ["strategy", "seed", "plan_p50_us", "plan_p99_us"]);
    let timed = |row: &MissionRow| [row.plan_p50_us, row.plan_p99_us].map(|time_us| time_us.to_string());
    table(header, rows.values().map(|row| mission(definition, row).chain(timed(row))))
}

fn header<'a>(definition: &Definition, names: impl IntoIterator<Item = &'a str>) -> Vec<String> {
    definition.keys.iter().cloned().chain(names.into_iter().map(str::to_owned)).collect()
}

/// Swept values, strategy and seed of a mission.
fn mission(definition: &Definition, row: &MissionRow) -> impl Iterator<Item = String> {
    let strategy = definition.strategies[row.strategy].name.to_owned();
    definition.points[row.point]
        .iter()
        .map(text)
        .collect::<Vec<_>>()
        .into_iter()
        .chain([strategy, row.seed.to_string()])
}

/// A metric as text; bits stay whole, and what a mission has not stays empty.
fn number((name, value): Metric, row: &MissionRow) -> String {
    match value(row) {
        _ if name == "delivered_bits" => row.delivered_bits.to_string(),
        value if value.is_nan() => String::new(),
        value => value.to_string(),
    }
}

/// A swept value as text: as in the sweep file, strings without quotes.
fn text(value: &toml::Value) -> String {
    match value {
        toml::Value::String(text) => text.clone(),
        toml::Value::Float(float) => float.to_string(),
        other => other.to_string(),
    }
}

fn table(header: Vec<String>, lines: impl Iterator<Item = impl Iterator<Item = String>>) -> Vec<u8> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(header).expect("memory takes everything");
    for line in lines {
        writer
            .write_record(line.collect::<Vec<_>>())
            .expect("memory takes everything, and all lines are of one length");
    }
    writer.into_inner().expect("memory takes everything")
}
