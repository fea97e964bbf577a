//! The result files of a sweep: one row per mission, a summary with confidence intervals, and the timings.

use std::collections::BTreeMap;
use std::io;
use std::path::Path;

use skysink_common::csv_cell::decimal;
use skysink_common::stop::Stop;
use skysink_mission::error::FileContext;
use skysink_mission::files::{write_unfinished, write_whole};
use skysink_planner::strategies::look_ahead;
use strum::VariantArray;

use super::definition::{Definition, MissionKey};
use super::journal::{MissionRow, MissionRows, SweepJournal, missions_of};
use crate::error::LabError;
use crate::statistics::{Concentration, MeanInterval};
use skysink_mission::metrics::Metric;

/// The name of the minimum loss over all strategies, per field, in the summary.
pub const BEST_KNOWN: &str = "best-known";

/// File name of the results by mission.
pub const MISSIONS: &str = "results.csv";

/// Writes all files into `folder`. Equal missions give equal bytes, except for the timings.
///
/// # Errors
/// If a file cannot be written, or on a stop.
pub fn write(folder: &Path, journal: &SweepJournal, stop: &Stop) -> Result<(), LabError> {
    let (timings, results): (Vec<_>, Vec<_>) = Metric::VARIANTS.iter().partition(|metric| metric.is_timing());
    write_missions(&folder.join(MISSIONS), journal, &results, stop)?;
    write_missions(&folder.join("timings.csv"), journal, &timings, stop)?;
    Ok(write_whole(&folder.join("summary.csv"), &summary_csv(&journal.definition, &journal.rows, &results, stop)?)?)
}

/// Writes a file with one row per mission and these metrics.
fn write_missions(path: &Path, journal: &SweepJournal, metrics: &[Metric], stop: &Stop) -> Result<(), LabError> {
    let definition = &journal.definition;
    let mut csv = csv::Writer::from_writer(write_unfinished(path, b"").at(path)?);
    let names = ["strategy", "seed"].into_iter().chain(metrics.iter().map(|metric| metric.name()));
    csv.write_record(definition.keys.iter().map(String::as_str).chain(names)).map_err(io::Error::from).at(path)?;
    for row in journal.rows.values() {
        stop.check()?;
        csv.write_record(mission_line(definition, row, metrics)).map_err(io::Error::from).at(path)?;
    }
    let file = csv.into_inner().map_err(|error| error.into_error()).at(path)?;
    file.persist(path).map_err(io::Error::from).at(path)?;
    Ok(())
}

/// The row of a mission: swept keys, strategy, seed, metrics (empty for NaN). Floats can be parsed back exactly, and
/// have a point.
fn mission_line(definition: &Definition, row: &MissionRow, metrics: &[Metric]) -> Vec<String> {
    let number = |metric: &Metric| match row[*metric] {
        value if value.is_nan() => String::new(),
        value if metric.is_count() => value.to_string(),
        value => decimal(value),
    };
    let strategy_and_seed = [definition.strategies[row.key.strategy].clone(), row.key.seed.to_string()];
    point_cells(definition, row.key.point).chain(strategy_and_seed).chain(metrics.iter().map(number)).collect()
}

/// The values of the swept keys at a point, as in its rows.
fn point_cells(definition: &Definition, point: usize) -> impl Iterator<Item = String> {
    let values = definition.points[point].iter().enumerate();
    values.map(|(axis, value)| AxisType::of(definition, axis).cell(value))
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
        let figures = figures.map(|figure| figure.map_or_else(String::new, decimal));
        let words = [strategy.to_owned(), metric.name().to_owned(), n.to_string()];
        point_cells(definition, point).chain(words).chain(figures).collect::<Vec<_>>()
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

/// The type of a swept key's column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AxisType {
    /// All values are whole numbers.
    Whole,
    /// All values are numbers.
    Real,
    /// Some are not.
    Text,
}

impl AxisType {
    /// The type of the column of the key number `axis`, by all its values in the sweep.
    #[must_use]
    pub fn of(definition: &Definition, axis: usize) -> Self {
        Self::of_values(definition.points.iter().map(|point| &point[axis]))
    }

    /// The type of a column with these values.
    pub(crate) fn of_values<'a>(values: impl Iterator<Item = &'a toml::Value> + Clone) -> Self {
        if values.clone().all(toml::Value::is_integer) {
            Self::Whole
        } else if values.clone().all(|value| number(value).is_some()) {
            Self::Real
        } else {
            Self::Text
        }
    }

    /// A value of the column, as in a CSV table.
    pub(crate) fn cell(self, value: &toml::Value) -> String {
        match number(value) {
            Some(value) if self == Self::Real => decimal(value),
            _ => text(value),
        }
    }
}

/// A swept value as a number, if it is one.
#[must_use]
pub fn number(value: &toml::Value) -> Option<f64> {
    value.as_float().or_else(|| value.as_integer().map(|whole| whole as f64))
}

/// A swept value as text: as in the sweep file, but strings without quotes.
#[must_use]
pub fn text(value: &toml::Value) -> String {
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

    /// A journal in `folder` of a sweep over this axis with a mission per value, each with these metrics.
    fn journal(folder: &Path, axis: Vec<toml::Value>, value: f64) -> SweepJournal {
        let definition = Definition {
            identity: "a".to_owned(),
            grid: "b".to_owned(),
            version: "1".to_owned(),
            keys: vec!["key".to_owned()],
            points: axis.into_iter().map(|value| vec![value]).collect(),
            strategies: vec!["uts".to_owned()],
            sources: BTreeMap::new(),
            models: Vec::new(),
            seeds: vec![7],
        };
        let mut journal = SweepJournal::open(&folder.join("journal.csv"), &definition).unwrap();
        for point in 0..definition.points.len() {
            let key = MissionKey { point, strategy: 0, seed: 7 };
            journal.add(&MissionRow { key, values: [value; Metric::COUNT] }).unwrap();
        }
        journal
    }

    #[test]
    fn every_mission_has_a_row() {
        let folder = tempfile::tempdir().unwrap();
        for count in 0..5 {
            let axis = (0..count).map(|value| toml::Value::from(i64::from(value))).collect();
            let path = folder.path().join(format!("{count}.csv"));
            let place = tempfile::tempdir().unwrap();
            write_missions(&path, &journal(place.path(), axis, 0.5), &[Metric::LossRate], &Stop::default()).unwrap();
            let rows: String = (0..count).map(|value| format!("{value},uts,7,0.5\n")).collect();
            assert_eq!(std::fs::read_to_string(path).unwrap(), format!("key,strategy,seed,loss_rate\n{rows}"));
        }
    }

    #[test]
    fn a_real_number_has_a_point_and_a_count_has_none() {
        let cells = |axis: Vec<toml::Value>, value: f64| -> Vec<String> {
            let folder = tempfile::tempdir().unwrap();
            let journal = journal(folder.path(), axis, value);
            let metrics = [Metric::LossRate, Metric::DeliveredBits, Metric::Dead];
            journal.rows.values().map(|row| mission_line(&journal.definition, row, &metrics).join(" ")).collect()
        };
        assert_eq!(cells(vec![20.into(), 30.into()], 3.0), ["20 uts 7 3.0 3 3.0", "30 uts 7 3.0 3 3.0"]);
        assert_eq!(cells(vec![20.into(), 30.5.into()], 0.0), ["20.0 uts 7 0.0 0 0.0", "30.5 uts 7 0.0 0 0.0"]);
        assert_eq!(cells(vec![20.into(), "inf".into()], f64::NAN), ["20 uts 7   ", "inf uts 7   "]);
        assert_eq!(
            cells(vec![5e3.into(), f64::INFINITY.into()], 3.0),
            ["5000.0 uts 7 3.0 3 3.0", "inf uts 7 3.0 3 3.0"]
        );
    }
}
