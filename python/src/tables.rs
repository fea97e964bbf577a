//! Results as columns: of a mission the slots as in `slots.csv` and the sensor nodes (SNs) as in `sensors_out.csv`, of
//! a sweep the missions as in `results.csv`. Counts of a mission are signed, so that differences are correct; none
//! exceeds 2^63. In the tables of folders, which become Parquet files, they are unsigned.

use std::path::PathBuf;
use std::sync::Arc;

use arrow_array::types::{UInt32Type, UInt64Type};
use arrow_array::{ArrayRef, Float64Array, Int64Array, ListArray, StringArray, UInt32Array, UInt64Array};
use pyo3::prelude::*;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_lab::sweep::definition::Definition;
use skysink_lab::sweep::folder::FlownSweep;
use skysink_lab::sweep::journal::MissionRow;
use skysink_lab::sweep::results::{AxisType, MISSIONS, number, text};
use skysink_mission::metrics::Metric;
use skysink_mission::record::is_run_folder;
use skysink_mission::replay::RecordedRun;
use skysink_mission::sensor_results::SensorResult;
use skysink_mission::trace::RecordedSlot;

use crate::errors::{of_lab, of_mission};
use crate::signals::interruptible;
use crate::table::PyTable;

/// A column with its name.
pub type NamedColumn = (&'static str, ArrayRef);

fn counts(values: impl Iterator<Item = u64>) -> ArrayRef {
    Arc::new(Int64Array::from_iter_values(values.map(|count| count as i64)))
}

fn numbers(values: impl Iterator<Item = f64>) -> ArrayRef {
    Arc::new(Float64Array::from_iter_values(values))
}

fn ids(values: impl Iterator<Item = u32>) -> ArrayRef {
    Arc::new(UInt32Array::from_iter_values(values))
}

/// The columns of these lines of `slots.csv`; `scheduled` has lists of ids.
#[must_use]
pub fn slot_columns(lines: &[&RecordedSlot]) -> Vec<NamedColumn> {
    slot_columns_by(lines, |values| counts(values.into_iter()))
}

/// The columns of these lines of `slots.csv`, those of counts by `counts`.
fn slot_columns_by(lines: &[&RecordedSlot], counts: fn(Vec<u64>) -> ArrayRef) -> Vec<NamedColumn> {
    let lines = || lines.iter().copied();
    let counts = |of: fn(&RecordedSlot) -> u64| counts(lines().map(of).collect());
    let scheduled = lines().map(|slot| Some(slot.scheduled.iter().copied().map(Some)));
    let mut columns: Vec<NamedColumn> = vec![
        ("slot", counts(|slot| slot.slot)),
        ("uav", counts(|slot| slot.uav as u64)),
        ("x_m", numbers(lines().map(|slot| slot.position.x))),
        ("y_m", numbers(lines().map(|slot| slot.position.y))),
        ("z_m", numbers(lines().map(|slot| slot.position.z))),
        ("scheduled", Arc::new(ListArray::from_iter_primitive::<UInt32Type, _, _>(scheduled))),
        ("delivered_bits", counts(|slot| slot.delivered_bits)),
        ("lost_bits", counts(|slot| slot.lost_bits)),
        ("queued_bits", counts(|slot| slot.queued_bits)),
        ("mode", Arc::new(StringArray::from_iter_values(lines().map(|slot| <&str>::from(slot.mode))))),
        ("refused", ids(lines().map(|slot| slot.refused))),
    ];
    if lines().any(|slot| slot.energy_j.is_finite()) {
        columns.push(("energy_j", numbers(lines().map(|slot| slot.energy_j))));
    }
    columns
}

/// The columns of `sensors_out.csv` for the SNs of `list` with these results; `first_loss_slot` is null where nothing
/// was lost.
#[must_use]
pub fn sensor_columns(list: &SensorList, results: &[SensorResult]) -> Vec<NamedColumn> {
    let sensors = || list.sensors().iter();
    let results = || results.iter();
    let first_loss = results().map(|result| result.first_loss_slot.map(|slot| slot as f64));
    let mut columns = vec![
        ("sensor", ids((0..).zip(sensors()).map(|(id, _)| id))),
        ("x_m", numbers(sensors().map(|sensor| sensor.position.x))),
        ("y_m", numbers(sensors().map(|sensor| sensor.position.y))),
        ("sampled_bits", counts(results().map(|result| result.sampled_bits))),
        ("delivered_bits", counts(results().map(|result| result.delivered_bits))),
        ("lost_bits", counts(results().map(|result| result.lost_bits))),
        ("queued_bits", counts(results().map(|result| result.queued_bits.into()))),
        ("loss_rate", numbers(results().map(|result| result.loss_rate))),
        ("served_slots", counts(results().map(|result| result.served_slots))),
        ("mean_age_s", numbers(results().map(|result| result.mean_age_s))),
        ("longest_gap_s", numbers(results().map(|result| result.longest_gap_s))),
        ("first_loss_slot", Arc::new(first_loss.collect::<Float64Array>())),
    ];
    if list.has_own_weights() {
        columns.push(("weight", numbers(sensors().map(|sensor| sensor.weight))));
    }
    columns
}

/// The columns of a recorded run: those of `slots.csv`, and `uploads_bits`, the bits uploaded by each served SN.
fn recorded_columns(run: &RecordedRun) -> Vec<NamedColumn> {
    let lines: Vec<&RecordedSlot> = run.slots.iter().flatten().collect();
    let mut columns = slot_columns_by(&lines, |counts| Arc::new(UInt64Array::from(counts)));
    let uploads_bits = run.uploads_bits.iter().flatten().map(|slot| Some(slot.iter().copied().map(Some)));
    let uploads_bits = ListArray::from_iter_primitive::<UInt64Type, _, _>(uploads_bits);
    let place = |name: &str| columns.iter().position(|(column, _)| *column == name).expect("a column of the slots");
    let [uav, scheduled] = ["uav", "scheduled"].map(place);
    columns[uav].1 = ids(lines.iter().map(|slot| slot.uav as u32));
    columns.insert(scheduled + 1, ("uploads_bits", Arc::new(uploads_bits)));
    columns
}

/// The columns of `results.csv`, with one row per mission.
///
/// # Panics
/// If a row does not belong to the sweep.
pub fn mission_columns<'a>(definition: &'a Definition, rows: &[MissionRow]) -> Vec<(&'a str, ArrayRef)> {
    let mut columns: Vec<(&str, ArrayRef)> = Vec::new();
    for (axis, key) in definition.keys.iter().enumerate() {
        columns.push((key, swept(definition, rows, axis)));
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

/// The column of a swept key.
fn swept(definition: &Definition, rows: &[MissionRow], axis: usize) -> ArrayRef {
    let values = || rows.iter().map(|row| &definition.points[row.key.point][axis]);
    match AxisType::of(definition, axis) {
        AxisType::Whole => Arc::new(values().map(toml::Value::as_integer).collect::<Int64Array>()),
        AxisType::Real => Arc::new(values().map(number).collect::<Float64Array>()),
        AxisType::Text => Arc::new(StringArray::from_iter_values(values().map(text))),
    }
}

/// The text in LaTeX, for every engine and encoding of fonts.
#[pyfunction]
pub fn latex(text: &str) -> String {
    skysink_common::markup::latex(text)
}

/// The table of a folder, of a complete run or of a sweep with results, and the name of the CSV file with its rows.
#[pyfunction]
pub fn table_of(py: Python<'_>, folder: PathBuf) -> PyResult<(&'static str, PyTable)> {
    if is_run_folder(&folder) {
        let read = move |stop: &Stop| RecordedRun::read(&folder, stop);
        let run = interruptible(py, read)?.map_err(of_mission)?;
        return Ok(("slots.csv", PyTable::new(recorded_columns(&run))?));
    }
    let sweep = FlownSweep::read_results("sweep", &folder).map_err(of_lab)?;
    let rows: Vec<MissionRow> = sweep.rows.into_values().collect();
    Ok((MISSIONS, PyTable::new(mission_columns(&sweep.definition, &rows))?))
}
