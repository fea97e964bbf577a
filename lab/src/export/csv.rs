//! The flight as a table: one row per slot; row 0 is the start.

use skysink_common::csv_cell::decimal;
use skysink_mission::trace::RecordedSlot;

use super::format::{ExportFormat, WriteFormat};
use super::track::GeodeticTrack;

/// A row for each slot, from the start in row 0: `slot`, `time_s`, `lat_deg`, `lon_deg`, `altitude_m`, `scheduled`,
/// `delivered_bits`, `lost_bits`, `queued_bits`, `mode`.
pub static FORMAT: ExportFormat = ExportFormat {
    name: "csv",
    about: "table: latitude, longitude, altitude, time and served sensor nodes of each slot",
    extension: "csv",
    write: WriteFormat::Flight(write),
};

fn write(track: &GeodeticTrack<'_>) -> Vec<u8> {
    let mut text =
        "slot,time_s,lat_deg,lon_deg,altitude_m,scheduled,delivered_bits,lost_bits,queued_bits,mode\n".to_owned();
    for point in &track.points {
        let place = point.place;
        let slot = point.slot.map_or(0, |slot| slot.slot);
        let figures = point.slot.map_or_else(
            || ",,,,".to_owned(), // the start has no results
            |slot| {
                let RecordedSlot { delivered_bits, lost_bits, queued_bits, mode, .. } = slot;
                let served = point.served().iter().map(u32::to_string).collect::<Vec<_>>().join(" ");
                format!("{served},{delivered_bits},{lost_bits},{queued_bits},{mode}")
            },
        );
        let numbers = [point.time_s, place.lat_deg, place.lon_deg, point.position.z].map(decimal).join(",");
        text += &format!("{slot},{numbers},{figures}\n");
    }
    text.into_bytes()
}
