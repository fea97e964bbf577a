//! Arrivals of a file, or of a model of the user's: what each SN samples in each slot.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use serde::Deserialize;

use super::{DrawnArrivals, MAX_SAMPLED_BITS};
use crate::csv_rows::read_rows;
use crate::error::{InputError, read_text};
use crate::per_sensor::PerSensor;

/// A row of a trace.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
pub struct Arrival {
    /// The slot, from 1.
    pub slot: u64,
    /// The SN.
    pub sensor: u32,
    /// The bits that it samples in the slot.
    pub bits: u32,
}

/// The arrivals of a mission as rows; an SN samples nothing in a slot without a row.
#[derive(Debug, Clone, PartialEq)]
pub struct ArrivalTrace {
    /// By slot, then by SN.
    rows: Arc<[Arrival]>,
}

/// The columns of the file.
const COLUMNS: [&str; 3] = ["slot", "sensor", "bits"];

impl ArrivalTrace {
    /// The trace of these rows; those without bits are dropped.
    ///
    /// # Errors
    /// A message, if they do not fit a mission with SNs of the rates `sampling_bps` [bit/s], or one repeats another.
    pub fn new(mut rows: Vec<Arrival>, sampling_bps: &[f64]) -> Result<Self, String> {
        let mut total_bits = 0.0;
        for Arrival { slot, sensor, bits } in &rows {
            total_bits += f64::from(*bits);
            let count = sampling_bps.len();
            match sampling_bps.get(*sensor as usize) {
                None => return Err(format!("sensor = {sensor} in slot {slot}: expected 0 to {}", count - 1)),
                Some(&rate_bps) if rate_bps == 0.0 && *bits > 0 => {
                    return Err(format!(
                        "bits = {bits} of SN {sensor} in slot {slot}: expected 0, because its sampling_bps is 0"
                    ));
                }
                _ if *slot == 0 => return Err("slot = 0: expected a slot from 1".to_owned()),
                _ => {}
            }
        }
        if total_bits > MAX_SAMPLED_BITS {
            return Err(format!("{total_bits:e} bits: expected at most 9e15 altogether"));
        }
        rows.sort_unstable();
        let is_repeated = |rows: &&[Arrival]| (rows[0].slot, rows[0].sensor) == (rows[1].slot, rows[1].sensor);
        if let Some([Arrival { slot, sensor, .. }, ..]) = rows.windows(2).find(is_repeated) {
            return Err(format!("slot {slot} of SN {sensor} twice: expected it once"));
        }
        rows.retain(|row| row.bits > 0);
        Ok(Self { rows: rows.into() })
    }

    /// Reads the file `path`, for SNs of the rates `sampling_bps` [bit/s].
    ///
    /// # Errors
    /// If the file cannot be read, or has an invalid row.
    pub fn read(path: &Path, sampling_bps: &[f64]) -> Result<Self, InputError> {
        let text = read_text("arrivals", path)?;
        Self::parse(&text, path, sampling_bps)
    }

    /// Parses the text of the file `path`.
    ///
    /// # Errors
    /// If a row is invalid.
    pub fn parse(text: &str, path: &Path, sampling_bps: &[f64]) -> Result<Self, InputError> {
        let refuse = |message: String| InputError::new("arrivals", path, message);
        let expected = "a slot from 1, an SN and whole bits below 2^32";
        let rows = read_rows(text, &COLUMNS, expected, |_| true).map_err(refuse)?;
        Self::new(rows, sampling_bps).map_err(refuse)
    }

    /// The trace as a CSV file.
    pub fn to_csv(&self) -> String {
        let mut text = COLUMNS.join(",") + "\n";
        for Arrival { slot, sensor, bits } in &self.rows[..] {
            text.push_str(&format!("{slot},{sensor},{bits}\n"));
        }
        text
    }

    /// The rows with bits, by slot and then by SN.
    pub fn rows(&self) -> &[Arrival] {
        &self.rows
    }

    /// The rows of the consecutive `sensors` in `slot`.
    fn rows_of(&self, slot: u64, sensors: Range<usize>) -> &[Arrival] {
        let first = |sensor: usize| self.rows.partition_point(|row| (row.slot, row.sensor as usize) < (slot, sensor));
        &self.rows[first(sensors.start)..first(sensors.end)]
    }
}

impl DrawnArrivals for ArrivalTrace {
    fn bits(&self, slot: u64, sensor: u32, _mean_bits: f64) -> u64 {
        self.rows_of(slot, sensor as usize..sensor as usize + 1).first().map_or(0, |row| row.bits.into())
    }

    fn fill(&self, slot: u64, sensors: Range<usize>, _mean_bits: &PerSensor<f64>, bits: &mut [u64]) {
        bits.fill(0);
        for row in self.rows_of(slot, sensors.clone()) {
            bits[row.sensor as usize - sensors.start] = row.bits.into();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<ArrivalTrace, String> {
        ArrivalTrace::parse(text, Path::new("a.csv"), &[5.0, 0.0, 7.0]).map_err(|error| error.to_string())
    }

    #[test]
    fn an_sn_samples_the_bits_of_its_rows() {
        let trace = parse("sensor,slot,bits\n2,1,70\n0,3,9\n0,1,5\n1,1,0\n").unwrap();
        assert_eq!([(1, 0), (1, 2), (2, 0), (3, 0)].map(|(slot, sensor)| trace.bits(slot, sensor, 1.0)), [5, 70, 0, 9]);
        let mut bits = [9; 3];
        trace.fill(1, 0..3, &PerSensor::Equal(1.0), &mut bits);
        assert_eq!(bits, [5, 0, 70]);
        assert_eq!(trace.to_csv(), "slot,sensor,bits\n1,0,5\n1,2,70\n3,0,9\n");
        assert_eq!(parse(&trace.to_csv()).unwrap(), trace);
    }

    #[test]
    fn an_impossible_row_is_refused_with_its_line_and_value() {
        for (text, message) in [
            ("slot,sensor\n", "header `slot,sensor`: expected slot,sensor,bits"),
            (
                "slot,sensor,bits\n1,0,2.5\n",
                "line 2: `1,0,2.5`: expected a slot from 1, an SN and whole bits below 2^32",
            ),
            ("slot,sensor,bits\n1,0\n", "line 2: expected 3 fields, as in the header"),
            ("slot,sensor,bits\n0,0,4\n", "slot = 0: expected a slot from 1"),
            ("slot,sensor,bits\n1,3,4\n", "sensor = 3 in slot 1: expected 0 to 2"),
            ("slot,sensor,bits\n1,1,4\n", "bits = 4 of SN 1 in slot 1: expected 0, because its sampling_bps is 0"),
            ("slot,sensor,bits\n1,0,4\n1,0,4\n", "slot 1 of SN 0 twice: expected it once"),
        ] {
            let error = parse(text).unwrap_err();
            assert!(error.ends_with(message), "{error}");
        }
    }
}
