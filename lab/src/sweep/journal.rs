//! The journal of a sweep: a line for each mission that is flown, so that an interrupted sweep goes on where it was.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::error::SweepError;
use super::plan::Flight;
use crate::error::LabError;

/// What a mission comes to, as in the journal.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)] // the columns of the results, defined in docs/metrics.md
pub struct Row {
    pub point: usize,
    pub strategy: usize,
    pub seed: u64,
    pub loss_rate: f64,
    pub eta_letter: f64,
    pub delivered_bits: u64,
    pub bits_per_waypoint: f64,
    pub mean_served: f64,
    pub flown_m: f64,
    pub energy_j: f64,
    pub aoi_mean_s: f64,
    pub aoi_p99_s: f64,
    pub jain: f64,
    pub loss_bound: Option<f64>,
    pub plan_p50_us: f64,
    pub plan_p99_us: f64,
}

impl Row {
    /// Which mission it is.
    #[must_use]
    pub fn flight(&self) -> Flight {
        Flight { point: self.point, strategy: self.strategy, seed: self.seed }
    }
}

/// A journal that is written.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    file: File,
}

impl Journal {
    /// Opens the journal, drops a line that was cut off, and returns what is in it.
    ///
    /// # Errors
    /// If it cannot be read or written, or is no journal.
    pub fn open(path: &Path) -> Result<(Self, BTreeMap<Flight, Row>), LabError> {
        let open = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path);
        let mut file = open.map_err(LabError::file(path))?;
        let mut text = Vec::new();
        file.read_to_end(&mut text).map_err(LabError::file(path))?;
        let whole = text.iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1);
        file.set_len(whole as u64).map_err(LabError::file(path))?;
        file.seek(SeekFrom::End(0)).map_err(LabError::file(path))?;
        let rows = parse(path, &text[..whole])?;
        Ok((Self { path: path.to_owned(), file }, rows))
    }

    /// Adds a mission; it is on record when this returns, whatever happens to the process.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn add(&mut self, row: &Row) -> Result<(), LabError> {
        let mut writer = csv::WriterBuilder::new().has_headers(false).from_writer(Vec::new());
        let line = writer
            .serialize(row)
            .map_err(std::io::Error::other)
            .and_then(|()| writer.into_inner().map_err(|error| std::io::Error::other(error.to_string())));
        line.and_then(|line| self.file.write_all(&line)).map_err(LabError::file(&self.path))
    }
}

/// The missions of a journal.
///
/// # Errors
/// If it cannot be read or is no journal.
pub fn read(path: &Path) -> Result<BTreeMap<Flight, Row>, LabError> {
    let text = std::fs::read(path).map_err(LabError::file(path))?;
    let whole = text.iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1);
    parse(path, &text[..whole])
}

fn parse(path: &Path, text: &[u8]) -> Result<BTreeMap<Flight, Row>, LabError> {
    let mut reader = csv::ReaderBuilder::new().has_headers(false).from_reader(text);
    let rows = reader.deserialize().enumerate().map(|(line, row)| {
        let row: Row = row.map_err(|error| SweepError::Journal {
            path: path.to_owned(),
            line: line + 1,
            message: error.to_string().replace('\n', " "),
        })?;
        Ok((row.flight(), row))
    });
    rows.collect()
}
