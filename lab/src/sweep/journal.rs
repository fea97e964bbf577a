//! The journal of a sweep: a line for each mission that is flown, so that an interrupted sweep can be resumed.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::ops::Index;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use skysink_mission::error::FileContext;

use super::plan::MissionKey;
use crate::error::LabError;
use crate::metrics::{Metric, MetricValues};

/// What a mission comes to, as in the journal.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MissionRow {
    /// Which mission it is.
    pub key: MissionKey,
    /// Its metrics.
    pub values: MetricValues,
}

impl Index<Metric> for MissionRow {
    type Output = f64;

    fn index(&self, metric: Metric) -> &f64 {
        &self.values[metric as usize]
    }
}

/// The missions of a sweep, in the order of the results.
pub type MissionRows = BTreeMap<MissionKey, MissionRow>;

/// The missions of a point by a strategy, by ascending seed.
pub fn missions_of(rows: &MissionRows, point: usize, strategy: usize) -> impl Iterator<Item = &MissionRow> {
    let key = |seed| MissionKey { point, strategy, seed };
    rows.range(key(0)..=key(u64::MAX)).map(|(_, row)| row)
}

/// A journal that is written.
#[derive(Debug)]
pub struct SweepJournal {
    path: PathBuf,
    file: File,
}

impl SweepJournal {
    /// Opens the journal, drops a line that was cut off, and returns what is in it.
    ///
    /// # Errors
    /// If it cannot be read or written, or is no journal.
    pub fn open(path: &Path) -> Result<(Self, MissionRows), LabError> {
        let mut file = OpenOptions::new().read(true).append(true).create(true).open(path).at(path)?;
        let mut text = Vec::new();
        file.read_to_end(&mut text).at(path)?;
        let whole = whole_lines(&text);
        file.set_len(whole.len() as u64).at(path)?;
        let rows = parse(path, whole)?;
        Ok((Self { path: path.to_owned(), file }, rows))
    }

    /// Adds a mission; it is on record when this returns, whatever happens to the process.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn add(&mut self, row: &MissionRow) -> Result<(), LabError> {
        let mut writer = csv::WriterBuilder::new().has_headers(false).from_writer(Vec::new());
        writer.serialize(row).expect("plain numbers");
        let line = writer.into_inner().expect("memory takes everything");
        Ok(self.file.write_all(&line).at(&self.path)?)
    }
}

/// The missions of a journal.
///
/// # Errors
/// If it cannot be read or is no journal.
pub fn read(path: &Path) -> Result<MissionRows, LabError> {
    parse(path, whole_lines(&std::fs::read(path).at(path)?))
}

/// The text up to its last line end.
fn whole_lines(text: &[u8]) -> &[u8] {
    &text[..text.iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1)]
}

fn parse(path: &Path, text: &[u8]) -> Result<MissionRows, LabError> {
    let mut reader = csv::ReaderBuilder::new().has_headers(false).from_reader(text);
    let rows = reader.deserialize().enumerate().map(|(line, row)| {
        let row: MissionRow = row.map_err(|error| LabError::Journal {
            path: path.to_owned(),
            line: line + 1,
            message: error.to_string().replace('\n', " "),
        })?;
        Ok((row.key, row))
    });
    rows.collect()
}
