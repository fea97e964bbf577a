//! The slots as a typed table, with the columns of `slots.csv` and the uploads of each served sensor node.

use std::sync::Arc;

use arrow_array::types::UInt64Type;
use arrow_array::{ListArray, UInt32Array, UInt64Array};
use skysink_mission::replay::RecordedRun;
use skysink_mission::trace::RecordedSlot;

use super::format::{ExportFormat, WriteFormat};
use crate::parquet_file::parquet;
use crate::tables::slot_columns_by;

/// A row for each slot and UAV in the frame of the area, with types; needs no origin.
pub static FORMAT: ExportFormat = ExportFormat {
    name: "parquet",
    about: "Parquet, for pandas and MATLAB: slots.csv with types, and uploads per sensor node",
    extension: "parquet",
    write: WriteFormat::Slots(write),
};

fn write(run: &RecordedRun) -> Vec<u8> {
    let lines: Vec<&RecordedSlot> = run.slots.iter().flatten().collect();
    let mut columns = slot_columns_by(&lines, |counts| Arc::new(UInt64Array::from(counts)));
    let uavs = UInt32Array::from_iter_values(lines.iter().map(|slot| slot.uav as u32));
    let uploads_bits = run.uploads_bits.iter().flatten().map(|slot| Some(slot.iter().copied().map(Some)));
    let uploads_bits = ListArray::from_iter_primitive::<UInt64Type, _, _>(uploads_bits);
    let place = |name: &str| columns.iter().position(|(column, _)| *column == name).expect("a column of the slots");
    let [uav, scheduled] = ["uav", "scheduled"].map(place);
    columns[uav].1 = Arc::new(uavs);
    columns.insert(scheduled + 1, ("uploads_bits", Arc::new(uploads_bits)));
    parquet(columns)
}
