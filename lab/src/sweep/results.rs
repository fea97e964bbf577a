//! The result files of a sweep: one row per mission, a summary with confidence intervals, and the timings.

use std::collections::BTreeMap;
use std::io::{self, BufWriter};
use std::path::Path;
use std::sync::Arc;

use arrow_array::{ArrayRef, Float64Array, Int64Array, StringArray, UInt64Array};
use skysink_common::stop::Stop;
use skysink_mission::error::FileContext;
use skysink_mission::files::{write_unfinished, write_whole};
use skysink_planner::strategies::look_ahead;
use strum::VariantArray;

use super::definition::{Definition, MissionKey};
use super::journal::{MissionRow, MissionRows, SweepJournal, missions_of};
use crate::error::LabError;
use crate::parquet_file::{ROWS_PER_GROUP, batch, begin};
use crate::statistics::{Concentration, MeanInterval};
use skysink_mission::metrics::Metric;

/// The name of the minimum loss over all strategies, per field, in the summary.
pub const BEST_KNOWN: &str = "best-known";

/// Writes all files into `folder`. Equal missions give equal bytes, except for the timings.
///
/// # Errors
/// If a file cannot be written, or on a stop.
pub fn write(folder: &Path, journal: &SweepJournal, stop: &Stop) -> Result<(), LabError> {
    let (timings, results): (Vec<_>, Vec<_>) = Metric::VARIANTS.iter().partition(|metric| metric.is_timing());
    let tables = [("results.csv", &results[..]), ("timings.csv", &timings)];
    write_missions(folder, journal, tables, ROWS_PER_GROUP, stop)?;
    Ok(write_whole(&folder.join("summary.csv"), &summary_csv(&journal.definition, &journal.rows, &results, stop)?)?)
}

/// Writes the files with one row per mission, `part` rows at a time: two tables with these metrics, and the Parquet
/// file.
fn write_missions(
    folder: &Path,
    journal: &SweepJournal,
    tables: [(&str, &[Metric]); 2],
    part: usize,
    stop: &Stop,
) -> Result<(), LabError> {
    let definition = &journal.definition;
    let path = folder.join("results.parquet");
    let begun = BufWriter::new(write_unfinished(&path, b"").at(&path)?);
    let mut parquet = begin(begun, &batch(mission_columns(definition, &[]))).at(&path)?;
    let mut csvs = Vec::new();
    for (name, metrics) in tables {
        let path = folder.join(name);
        let mut csv = csv::Writer::from_writer(write_unfinished(&path, b"").at(&path)?);
        let names = ["strategy", "seed"].into_iter().chain(metrics.iter().map(|metric| metric.name()));
        csv.write_record(definition.keys.iter().map(String::as_str).chain(names)).map_err(io::Error::from).at(&path)?;
        csvs.push((path, csv, metrics));
    }
    let mut rows = journal.rows.values().copied();
    loop {
        stop.check()?;
        let read: Vec<MissionRow> = rows.by_ref().take(part).collect();
        for (path, csv, metrics) in &mut csvs {
            let mut lines = read.iter().map(|row| mission_line(definition, row, metrics));
            lines.try_for_each(|line| csv.write_record(line)).map_err(io::Error::from).at(path)?;
        }
        parquet.write(&batch(mission_columns(definition, &read))).map_err(io::Error::other).at(&path)?;
        if read.len() < part {
            break;
        }
    }
    for (path, csv, _) in csvs {
        let file = csv.into_inner().map_err(|error| error.into_error()).at(&path)?;
        file.persist(&path).map_err(io::Error::from).at(&path)?;
    }
    let file = parquet.into_inner().map_err(io::Error::other).and_then(|file| Ok(file.into_inner()?)).at(&path)?;
    file.persist(&path).map_err(io::Error::from).at(&path)?;
    Ok(())
}

/// The row of a mission: swept keys, strategy, seed, metrics (empty for NaN). Floats can be parsed back exactly.
fn mission_line(definition: &Definition, row: &MissionRow, metrics: &[Metric]) -> Vec<String> {
    let number = |metric: &Metric| Some(row[*metric]).filter(|value| !value.is_nan());
    let numbers = metrics.iter().map(|metric| number(metric).map_or_else(String::new, |value| value.to_string()));
    let strategy_and_seed = [definition.strategies[row.key.strategy].clone(), row.key.seed.to_string()];
    definition.points[row.key.point].iter().map(text).chain(strategy_and_seed).chain(numbers).collect()
}

/// The typed columns of `results.parquet`, with one row per mission.
///
/// # Panics
/// If a row does not belong to the sweep.
#[must_use]
pub fn mission_columns<'a>(definition: &'a Definition, rows: &[MissionRow]) -> Vec<(&'a str, ArrayRef)> {
    let mut columns: Vec<(&str, ArrayRef)> = Vec::new();
    for (place, key) in definition.keys.iter().enumerate() {
        columns.push((key, swept(definition, rows, place)));
    }
    let strategies = rows.iter().map(|row| &definition.strategies[row.key.strategy]);
    columns.push(("strategy", Arc::new(StringArray::from_iter_values(strategies))));
    columns.push(("seed", Arc::new(UInt64Array::from_iter_values(rows.iter().map(|row| row.key.seed)))));
    for metric in Metric::all().filter(|metric| !metric.is_timing()) {
        let values = rows.iter().map(|row| row[metric]);
        let column: ArrayRef = if metric.is_count() {
            Arc::new(UInt64Array::from_iter_values(values.map(|count| count as u64)))
        } else {
            Arc::new(values.map(|value| Some(value).filter(|value| !value.is_nan())).collect::<Float64Array>())
        };
        columns.push((metric.name(), column));
    }
    columns
}

/// The column of a swept key: integers, floats or text, depending on all its values in the sweep.
fn swept(definition: &Definition, rows: &[MissionRow], place: usize) -> ArrayRef {
    let all = || definition.points.iter().map(|point| &point[place]);
    let values = || rows.iter().map(|row| &definition.points[row.key.point][place]);
    if all().all(|value| value.is_integer()) {
        return Arc::new(values().map(toml::Value::as_integer).collect::<Int64Array>());
    }
    match all().all(|value| number(value).is_some()) {
        true => Arc::new(values().map(number).collect::<Float64Array>()),
        false => Arc::new(StringArray::from_iter_values(values().map(text))),
    }
}

/// The summary, with one row per point, strategy and metric: mean, standard deviation and confidence interval over the
/// seeds. If the sweep contains `offline`, the best known loss of each point follows.
fn summary_csv(
    definition: &Definition,
    rows: &MissionRows,
    metrics: &[Metric],
    stop: &Stop,
) -> Result<Vec<u8>, LabError> {
    let names = ["strategy", "metric", "n", "mean", "standard_deviation", "ci95_low", "ci95_high"];
    let line = |point: usize, strategy: &str, metric: Metric, interval: MeanInterval| {
        let MeanInterval { n, mean, deviation, limits } = interval;
        let figures = [Some(mean), deviation, limits.map(|[low, _]| low), limits.map(|[_, high]| high)];
        let figures = figures.map(|figure| figure.map_or_else(String::new, |value| value.to_string()));
        let words = [strategy.to_owned(), metric.name().to_owned(), n.to_string()];
        definition.points[point].iter().map(text).chain(words).chain(figures).collect::<Vec<_>>()
    };
    let mut lines = Vec::new();
    for point in 0..definition.points.len() {
        stop.check()?;
        for (strategy, name) in definition.strategies.iter().enumerate() {
            for &metric in metrics {
                let values: Vec<f64> = missions_of(rows, point, strategy).map(|row| row[metric]).collect();
                // None if a mission has no value, or there is no mission.
                if !values.is_empty() && !values.iter().any(|value| value.is_nan()) {
                    lines.push(line(point, name, metric, MeanInterval::of(&values, metric.support())));
                }
            }
        }
    }
    if definition.strategies.iter().any(|name| name == look_ahead::OFFLINE.name) {
        let strategies = 0..definition.strategies.len();
        for (point, least) in best_known(rows.values()) {
            let is_flown = |strategy, seed| rows.contains_key(&MissionKey { point, strategy, seed });
            let is_whole = |(seed, _): &(u64, f64)| strategies.clone().all(|strategy| is_flown(strategy, *seed));
            let losses: Vec<f64> = least.into_iter().filter(is_whole).map(|(_, least)| least).collect();
            if !losses.is_empty() {
                let interval = MeanInterval::of(&losses, Metric::LossRate.support());
                lines.push(line(point, BEST_KNOWN, Metric::LossRate, interval));
            }
        }
    }
    let mut writer = csv::Writer::from_writer(Vec::new());
    let header = definition.keys.iter().map(String::as_str).chain(names);
    writer.write_record(header).expect("memory takes everything");
    for line in lines {
        writer.write_record(line).expect("memory takes everything, and all lines are of one length");
    }
    Ok(writer.into_inner().expect("memory takes everything"))
}

/// The means of η that few fields determine, by strategy and point; none for a single seed.
#[must_use]
pub fn few(SweepJournal { definition, rows, .. }: &SweepJournal) -> Vec<(String, Concentration)> {
    let strategies = 0..definition.strategies.len();
    let means =
        (0..definition.points.len()).flat_map(|point| strategies.clone().map(move |strategy| (point, strategy)));
    few_of(definition, rows, means)
}

/// Those of these means of η, by point and strategy, that few fields determine.
pub(crate) fn few_of(
    definition: &Definition,
    rows: &MissionRows,
    means: impl Iterator<Item = (usize, usize)>,
) -> Vec<(String, Concentration)> {
    let mean = |(point, strategy): (usize, usize)| {
        let losses = missions_of(rows, point, strategy).map(|row| row[Metric::LossRate]);
        (named(definition, &definition.strategies[strategy], point), Concentration::of(losses))
    };
    means.map(mean).filter(|(_, concentration)| concentration.is_few()).collect()
}

/// A strategy at a point, for messages: only keys that vary are named.
#[must_use]
pub fn named(definition: &Definition, strategy: &str, point: usize) -> String {
    let point = &definition.points[point];
    let varies = |place: &usize| definition.points.iter().any(|other| other[*place] != point[*place]);
    let places = (0..point.len()).filter(varies);
    let values: Vec<String> =
        places.map(|place| format!("{} = {}", definition.keys[place], text(&point[place]))).collect();
    if values.is_empty() { strategy.to_owned() } else { format!("{strategy} at {}", values.join(", ")) }
}

/// The minimum loss over all strategies, by point and seed.
pub fn best_known<'a>(rows: impl Iterator<Item = &'a MissionRow>) -> BTreeMap<usize, BTreeMap<u64, f64>> {
    let mut points: BTreeMap<usize, BTreeMap<u64, f64>> = BTreeMap::new();
    for row in rows {
        let known = points.entry(row.key.point).or_default().entry(row.key.seed).or_insert(f64::INFINITY);
        *known = known.min(row[Metric::LossRate]);
    }
    points
}

/// A swept value as a number, if it is one.
pub(crate) fn number(value: &toml::Value) -> Option<f64> {
    value.as_float().or_else(|| value.as_integer().map(|whole| whole as f64))
}

/// A swept value as text: as in the sweep file, but strings without quotes.
pub(crate) fn text(value: &toml::Value) -> String {
    match value {
        toml::Value::String(text) => text.clone(),
        toml::Value::Float(float) => float.to_string(),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use strum::EnumCount;

    /// The files of a sweep with these seeds, written `part` rows at a time.
    fn written(seeds: u64, part: usize) -> [Vec<u8>; 2] {
        let folder = tempfile::tempdir().unwrap();
        let definition = Definition {
            identity: "a".to_owned(),
            grid: "b".to_owned(),
            version: "1".to_owned(),
            keys: vec!["slots".to_owned()],
            points: vec![vec![60.into()]],
            strategies: vec!["uts".to_owned()],
            sources: BTreeMap::new(),
            models: Vec::new(),
            seeds: (0..seeds).collect(),
        };
        let mut journal = SweepJournal::open(&folder.path().join("journal.csv"), &definition).unwrap();
        for seed in 0..seeds {
            let row = MissionRow { key: MissionKey { point: 0, strategy: 0, seed }, values: [0.5; Metric::COUNT] };
            journal.add(&row).unwrap();
        }
        let metrics = [Metric::LossRate];
        let tables = [("results.csv", &metrics[..]), ("timings.csv", &metrics)];
        write_missions(folder.path(), &journal, tables, part, &Stop::default()).unwrap();
        ["results.csv", "results.parquet"].map(|name| std::fs::read(folder.path().join(name)).unwrap())
    }

    #[test]
    fn all_rows_are_written_for_any_part_size() {
        for seeds in 0..5 {
            let [csv, _] = written(seeds, 2);
            let rows: String = (0..seeds).map(|seed| format!("60,uts,{seed},0.5\n")).collect();
            assert_eq!(String::from_utf8(csv).unwrap(), format!("slots,strategy,seed,loss_rate\n{rows}"));
        }
        assert_eq!(written(4, 2), written(4, 2));
    }
}
