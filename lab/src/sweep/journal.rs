//! The journal of a sweep: a line for each mission that is flown, so that an interrupted sweep can be resumed.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::ops::Index;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use skysink_common::error::InputError;
use skysink_mission::error::FileContext;

use super::plan::{Definition, MissionKey};
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
    /// Opens the journal of this sweep, drops a line that was cut off, and returns what is in it.
    ///
    /// # Errors
    /// If it cannot be read or written, or is not the journal of this sweep.
    pub fn open(path: &Path, definition: &Definition) -> Result<(Self, MissionRows), LabError> {
        let mut file = OpenOptions::new().read(true).append(true).create(true).open(path).at(path)?;
        let mut text = Vec::new();
        file.read_to_end(&mut text).at(path)?;
        let whole = whole_lines(&text);
        let rows = parse(path, whole, definition)?;
        file.set_len(whole.len() as u64).at(path)?;
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

/// The missions in a journal of this sweep.
///
/// # Errors
/// If it cannot be read, or is not the journal of this sweep.
pub fn read(path: &Path, definition: &Definition) -> Result<MissionRows, LabError> {
    parse(path, whole_lines(&std::fs::read(path).at(path)?), definition)
}

/// The text up to its last line end.
fn whole_lines(text: &[u8]) -> &[u8] {
    &text[..text.iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1)]
}

fn parse(path: &Path, text: &[u8], definition: &Definition) -> Result<MissionRows, LabError> {
    let mut reader = csv::ReaderBuilder::new().has_headers(false).from_reader(text);
    let mut rows = MissionRows::new();
    for (index, row) in reader.deserialize::<MissionRow>().enumerate() {
        let refuse = |message: String| InputError::new("sweep journal", path, format!("line {}: {message}", index + 1));
        let row = row.map_err(|error| refuse(error.to_string()))?;
        if !definition.contains(row.key) {
            let MissionKey { point, strategy, seed } = row.key;
            let mission = format!("point {point}, strategy {strategy}, seed {seed}");
            return Err(refuse(format!("{mission}: expected a mission of the sweep")).into());
        }
        rows.insert(row.key, row);
    }
    Ok(rows)
}
