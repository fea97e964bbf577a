//! Harvested power by slot and SN, from a file.

use std::path::Path;
use std::sync::Arc;

use serde::Deserialize;

use crate::csv_rows::read_rows;
use crate::error::{InputError, read_text};

/// A row: an SN harvests `harvest_w` from this slot on, until its next row.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
struct HarvestRow {
    /// From 1.
    slot: u64,
    /// `None` for all SNs without rows of their own.
    sensor: Option<u32>,
    harvest_w: f64,
}

/// The harvested power of a file. Before its first row an SN has the power of its list, or of the scenario.
#[derive(Debug, Clone, PartialEq)]
pub struct HarvestTrace {
    /// By SN, those of all others first, then by slot.
    rows: Arc<[HarvestRow]>,
}

/// The columns of the file.
const COLUMNS: [&str; 3] = ["slot", "sensor", "harvest_w"];

impl HarvestTrace {
    /// Reads the file `path` for `count` SNs.
    ///
    /// # Errors
    /// If the file cannot be read, or has an invalid row.
    pub fn read(path: &Path, count: usize) -> Result<Self, InputError> {
        let text = read_text("harvest", path)?;
        Self::parse(&text, count).map_err(|message| InputError::new("harvest", path, message))
    }

    /// Parses the text of a file; messages name the line, or the row.
    fn parse(text: &str, count: usize) -> Result<Self, String> {
        let is_row = |row: &HarvestRow| row.slot > 0 && row.harvest_w >= 0.0 && row.harvest_w.is_finite();
        let expected = "a slot from 1, an SN or nothing, and finite watts, 0 or above";
        let mut rows: Vec<HarvestRow> = read_rows(text, &COLUMNS, expected, is_row)?;
        let unknown = |row: &HarvestRow| Some((row.sensor.filter(|&sensor| sensor as usize >= count)?, row.slot));
        if let Some((sensor, slot)) = rows.iter().find_map(unknown) {
            return Err(format!("sensor = {sensor} in slot {slot}: expected 0 to {}", count - 1));
        }
        rows.sort_by_key(|row| (row.sensor, row.slot));
        let is_repeated = |rows: &&[HarvestRow]| (rows[0].sensor, rows[0].slot) == (rows[1].sensor, rows[1].slot);
        if let Some([HarvestRow { slot, sensor, .. }, ..]) = rows.windows(2).find(is_repeated) {
            let of = sensor.map_or("all other SNs".to_owned(), |sensor| format!("SN {sensor}"));
            return Err(format!("slot {slot} of {of} twice: expected it once"));
        }
        Ok(Self { rows: rows.into() })
    }

    /// The file, with its rows by SN and slot. Floats round-trip exactly.
    pub fn to_csv(&self) -> String {
        let mut text = COLUMNS.join(",") + "\n";
        for HarvestRow { slot, sensor, harvest_w } in &self.rows[..] {
            let sensor = sensor.map_or_else(String::new, |sensor| sensor.to_string());
            text.push_str(&format!("{slot},{sensor},{harvest_w}\n"));
        }
        text
    }

    /// The power of SN `sensor` in `slot` [W]; `None` before its first row.
    pub fn harvest_w(&self, slot: u64, sensor: usize) -> Option<f64> {
        let sensor = u32::try_from(sensor).ok();
        let [own, end] =
            [0, u64::MAX].map(|slot| self.rows.partition_point(|row| (row.sensor, row.slot) < (sensor, slot)));
        let of_others = self.rows.partition_point(|row| row.sensor.is_none());
        let rows = if own < end { &self.rows[own..end] } else { &self.rows[..of_others] };
        rows[..rows.partition_point(|row| row.slot <= slot)].last().map(|row| row.harvest_w)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_power_lasts_until_the_next_row_and_an_empty_sensor_is_all_others() {
        let trace = HarvestTrace::parse("harvest_w,sensor,slot\n0.5,,3\n2,1,5\n0,,9\n0.25,1,7\n", 3).unwrap();
        let of = |sensor| [1, 2, 3, 4, 5, 6, 7, 8, 9, 99].map(|slot| trace.harvest_w(slot, sensor));
        let [half, none] = [Some(0.5), Some(0.0)];
        assert_eq!(of(0), [None, None, half, half, half, half, half, half, none, none]);
        assert_eq!(of(2), of(0));
        let [two, quarter] = [Some(2.0), Some(0.25)];
        assert_eq!(of(1), [None, None, None, None, two, two, quarter, quarter, quarter, quarter]);
        assert_eq!(trace.to_csv(), "slot,sensor,harvest_w\n3,,0.5\n9,,0\n5,1,2\n7,1,0.25\n");
        assert_eq!(HarvestTrace::parse(&trace.to_csv(), 3).unwrap(), trace);
    }

    #[test]
    fn an_impossible_row_is_refused_with_its_line_and_value() {
        let expected = "expected a slot from 1, an SN or nothing, and finite watts, 0 or above";
        for (text, message) in [
            ("slot,harvest_w\n", "header `slot,harvest_w`: expected slot,sensor,harvest_w".to_owned()),
            ("slot,sensor,harvest_w\n1,0,-1\n", format!("line 2: `1,0,-1`: {expected}")),
            ("slot,sensor,harvest_w\n1,0,1\n0,0,1\n", format!("line 3: `0,0,1`: {expected}")),
            ("slot,sensor,harvest_w\n1,0,inf\n", format!("line 2: `1,0,inf`: {expected}")),
            ("slot,sensor,harvest_w\n1,x,1\n", format!("line 2: `1,x,1`: {expected}")),
            ("slot,sensor,harvest_w\n1,0\n", "line 2: expected 3 fields, as in the header".to_owned()),
            ("slot,sensor,harvest_w\n1,3,4\n", "sensor = 3 in slot 1: expected 0 to 2".to_owned()),
            ("slot,sensor,harvest_w\n1,2,4\n1,2,4\n", "slot 1 of SN 2 twice: expected it once".to_owned()),
            ("slot,sensor,harvest_w\n2,,4\n2,,5\n", "slot 2 of all other SNs twice: expected it once".to_owned()),
        ] {
            assert_eq!(HarvestTrace::parse(text, 3).unwrap_err(), message);
        }
    }
}
