//! A flight log: where the UAV was at which time, and the signal-to-noise ratios (SNRs) that it measured there.
//!
//! CSV with the columns `time_s`; `x_m` and `y_m`, or `lat_deg` and `lon_deg`; `z_m`, the altitude above ground;
//! `sensor`, a name or an id; and `snr_db`, empty if the sensor node was not heard. Times do not descend; rows of one
//! time are of one place. Other columns are ignored.

use std::path::Path;

use ::csv::{ReaderBuilder, StringRecord, Trim};
use skysink_common::error::{InputError, line_of, quoted, read_text};

use super::imported::Frame;

/// Largest SNR, and the negative of the smallest [dB].
const MOST_DB: f64 = 300.0;

/// The kind of input in error messages.
const WHAT: &str = "flight log";

/// The names of the columns of positions in each frame.
const POSITIONS: [(Frame, [&str; 2]); 2] = [(Frame::Plane, ["x_m", "y_m"]), (Frame::Geodetic, ["lat_deg", "lon_deg"])];

/// A log, in the frame of its file.
#[derive(Debug, Clone, PartialEq)]
pub struct FlightLog {
    /// The frame of all positions.
    pub frame: Frame,
    /// The rows, at least two of different times, by time.
    pub rows: Vec<LogRow>,
}

/// A row of a log.
#[derive(Debug, Clone, PartialEq)]
pub struct LogRow {
    /// Its line in the file.
    pub line: u64,
    /// Time [s].
    pub time_s: f64,
    /// x and y [m], or latitude and longitude [°].
    pub position: [f64; 2],
    /// Altitude above ground [m].
    pub z_m: f64,
    /// Name or id of the sensor node, and its SNR [dB]; `None` if it was not heard.
    pub heard: Option<(String, f64)>,
}

impl FlightLog {
    /// Reads the file `path`.
    ///
    /// # Errors
    /// If it cannot be read, a column is missing, a value is invalid, or all rows are of one time.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let text = read_text(WHAT, path)?;
        Self::parse(&text).map_err(|message| InputError::new(WHAT, path, message))
    }

    fn parse(text: &str) -> Result<Self, String> {
        let mut reader = ReaderBuilder::new().trim(Trim::All).from_reader(text.as_bytes());
        let header = reader.headers().map_err(|error| format!("line 1: {error}"))?.clone();
        let column = |name: &str| header.iter().position(|column| column == name);
        let frames = POSITIONS.into_iter().filter_map(|(frame, names)| match names.map(column) {
            [Some(first), Some(second)] => Some((frame, [first, second])),
            _ => None,
        });
        let frames: Vec<_> = frames.collect();
        let others = ["time_s", "z_m", "sensor", "snr_db"].map(column);
        let ([(frame, places)], [Some(time), Some(altitude), Some(sensor), Some(snr)]) = (&frames[..], others) else {
            let found = quoted(&header.iter().collect::<Vec<_>>().join(","));
            let expected = "time_s,x_m,y_m,z_m,sensor,snr_db, or lat_deg,lon_deg instead of x_m,y_m";
            return Err(format!("line 1: header `{found}`: expected {expected}"));
        };
        let mut rows: Vec<LogRow> = Vec::new();
        for record in reader.records() {
            let record = record.map_err(|error| {
                let line = line_of(text, error.position());
                format!("line {line}: expected {} fields of UTF-8 text, as in the header", header.len())
            })?;
            let line = line_of(text, record.position());
            let refuse = |message: String| format!("line {line}: {message}");
            let number = |column: usize| number(&record, &header, column).map_err(refuse);
            let position = [number(places[0])?, number(places[1])?];
            frame.check(position).map_err(refuse)?;
            let is_heard = !record[snr].is_empty();
            let heard = is_heard.then(|| Ok::<_, String>((record[sensor].to_owned(), number(snr)?))).transpose()?;
            if let Some((_, snr_db)) = heard.as_ref().filter(|(_, snr_db)| snr_db.abs() > MOST_DB) {
                return Err(refuse(format!("snr_db = {snr_db}: expected a number from −{MOST_DB} to {MOST_DB}")));
            }
            if heard.as_ref().is_some_and(|(name, _)| name.is_empty()) {
                return Err(refuse("sensor = : expected a name or an id, as there is an SNR".to_owned()));
            }
            let row = LogRow { line, time_s: number(time)?, position, z_m: number(altitude)?, heard };
            if let Some(last) = rows.last() {
                if last.time_s > row.time_s {
                    return Err(refuse(format!(
                        "time_s = {}: expected at least {}, as before",
                        row.time_s, last.time_s
                    )));
                }
                if last.time_s == row.time_s && (last.position, last.z_m) != (row.position, row.z_m) {
                    return Err(refuse(format!("time_s = {}: expected one place at one time", row.time_s)));
                }
            }
            rows.push(row);
        }
        match (rows.first(), rows.last()) {
            (Some(first), Some(last)) if first.time_s < last.time_s => Ok(Self { frame: *frame, rows }),
            _ => Err("expected rows of at least two times".to_owned()),
        }
    }

    /// Keeps the rows within `about_m` of the median altitude, and returns it [m], with the number of rows left out.
    pub fn keep_level(&mut self, about_m: f64) -> (f64, usize) {
        let mut altitudes_m: Vec<f64> = self.rows.iter().map(|row| row.z_m).collect();
        altitudes_m.sort_by(f64::total_cmp);
        let median_m = altitudes_m[altitudes_m.len() / 2];
        let all = self.rows.len();
        self.rows.retain(|row| (row.z_m - median_m).abs() <= about_m);
        (median_m, all - self.rows.len())
    }
}

/// The finite number in a column.
fn number(record: &StringRecord, header: &StringRecord, column: usize) -> Result<f64, String> {
    let number = record[column].parse().ok().filter(|number: &f64| number.is_finite());
    number.ok_or_else(|| format!("{} = {}: expected a finite number", &header[column], quoted(&record[column])))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_found_by_name_and_a_silent_sensor_node_has_no_snr() {
        let text = "snr_db,sensor,z_m,y_m,x_m,time_s,mode\n7.5,a,30,2,1,0,auto\n,,30,2,1,0.0,auto\n,b,55,4,3,2,land\n";
        let mut log = FlightLog::parse(text).unwrap();
        assert_eq!((log.frame, log.rows[0].position, log.rows[2].line), (Frame::Plane, [1.0, 2.0], 4));
        let heard: Vec<_> = log.rows.iter().map(|row| row.heard.clone()).collect();
        assert_eq!(heard, [Some(("a".to_owned(), 7.5)), None, None]);
        assert_eq!((log.keep_level(10.0), log.rows.len()), ((30.0, 1), 2));
    }

    #[test]
    fn an_invalid_log_is_refused_with_its_line() {
        let head = "time_s,lat_deg,lon_deg,z_m,sensor,snr_db\n";
        for (text, message) in [
            (String::new(), "line 1: header ``: expected time_s,x_m,y_m,z_m,sensor,snr_db"),
            ("time_s,x_m,y_m,lat_deg,lon_deg,z_m,sensor,snr_db\n".to_owned(), "line 1: header"),
            (head.to_owned(), "expected rows of at least two times"),
            (format!("{head}0,1,2,30,a,5\n0,1,2,30,b,5\n"), "expected rows of at least two times"),
            (format!("{head}0,95,2,30,a,5\n"), "line 2: latitude 95: expected -90 to 90"),
            (format!("{head}0,1,2,30,a,x\n"), "line 2: snr_db = x: expected a finite number"),
            (format!("{head}0,1,2,30,,5\n"), "line 2: sensor = : expected a name or an id"),
            (format!("{head}0,1,2\n"), "line 2: expected 6 fields of UTF-8 text"),
            (format!("{head}1,1,2,30,a,5\n0,1,2,30,a,5\n"), "line 3: time_s = 0: expected at least 1, as before"),
            (format!("{head}1,1,2,30,a,5\n1,1,3,30,a,5\n"), "line 3: time_s = 1: expected one place at one time"),
        ] {
            let error = FlightLog::parse(&text).unwrap_err();
            assert!(error.starts_with(message), "{error}");
        }
    }
}
