//! The slots as a typed table, with the columns of `slots.csv` and the uploads of each served sensor node.

use std::sync::Arc;

use arrow_array::types::{UInt32Type, UInt64Type};
use arrow_array::{ArrayRef, Float64Array, ListArray, StringArray, UInt32Array, UInt64Array};
use skysink_mission::replay::RecordedRun;
use skysink_mission::trace::RecordedSlot;

use super::format::{ExportFormat, WriteFormat};
use crate::parquet_file::parquet;
use crate::tables::NamedColumn;

/// A row for each slot and UAV in the frame of the area, with types; needs no origin.
pub static FORMAT: ExportFormat = ExportFormat {
    name: "parquet",
    about: "Parquet, for pandas and MATLAB: slots.csv with types, and uploads per sensor node",
    extension: "parquet",
    write: WriteFormat::Slots(write),
};

fn write(run: &RecordedRun) -> Vec<u8> {
    let lines: Vec<&RecordedSlot> = run.slots.iter().flatten().collect();
    let lines = || lines.iter().copied();
    let whole = |of: fn(&RecordedSlot) -> u64| -> ArrayRef { Arc::new(UInt64Array::from_iter_values(lines().map(of))) };
    let small = |of: fn(&RecordedSlot) -> u32| -> ArrayRef { Arc::new(UInt32Array::from_iter_values(lines().map(of))) };
    let metres =
        |axis: usize| -> ArrayRef { Arc::new(Float64Array::from_iter_values(lines().map(|slot| slot.position[axis]))) };
    let scheduled = lines().map(|slot| Some(slot.scheduled.iter().copied().map(Some)));
    let uploads_bits = run.uploads_bits.iter().flatten().map(|slot| Some(slot.iter().copied().map(Some)));
    let mut columns: Vec<NamedColumn> = vec![
        ("slot", whole(|slot| slot.slot)),
        ("uav", small(|slot| slot.uav as u32)),
        ("x_m", metres(0)),
        ("y_m", metres(1)),
        ("z_m", metres(2)),
        ("scheduled", Arc::new(ListArray::from_iter_primitive::<UInt32Type, _, _>(scheduled))),
        ("uploads_bits", Arc::new(ListArray::from_iter_primitive::<UInt64Type, _, _>(uploads_bits))),
        ("delivered_bits", whole(|slot| slot.delivered_bits)),
        ("lost_bits", whole(|slot| slot.lost_bits)),
        ("queued_bits", whole(|slot| slot.queued_bits)),
        ("mode", Arc::new(StringArray::from_iter_values(lines().map(|slot| slot.mode.to_string())))),
        ("refused", small(|slot| slot.refused)),
    ];
    if lines().any(|slot| slot.energy_j.is_finite()) {
        let energy_j = Float64Array::from_iter_values(lines().map(|slot| slot.energy_j));
        columns.push(("energy_j", Arc::new(energy_j)));
    }
    parquet(columns)
}
