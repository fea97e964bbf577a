//! The results of a mission as columns: of its slots as in `slots.csv`, and of its sensor nodes (SNs) as in
//! `sensors_out.csv`. Counts are signed, so that differences are correct; no count of a mission exceeds 2^63.

use std::sync::Arc;

use arrow_array::types::UInt32Type;
use arrow_array::{ArrayRef, Float64Array, Int64Array, ListArray, StringArray, UInt32Array};
use skysink_common::sensors::SensorList;
use skysink_mission::sensor_results::SensorResult;
use skysink_mission::trace::RecordedSlot;

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
pub(crate) fn slot_columns_by(lines: &[&RecordedSlot], counts: fn(Vec<u64>) -> ArrayRef) -> Vec<NamedColumn> {
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
