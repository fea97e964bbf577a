//! The journal of a sweep: a line for each mission that is flown, so that an interrupted sweep can be resumed.
//!
//! Each line ends with a check of its bytes, seeded by the sweep: neither a changed line nor one of another sweep is
//! used.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::ops::Index;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use skysink_common::error::InputError;
use skysink_mission::error::FileContext;
use xxhash_rust::xxh3::{xxh3_64, xxh3_64_with_seed};

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
    seed: u64,
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
        Ok((Self { path: path.to_owned(), file, seed: check_seed(definition) }, rows))
    }

    /// Adds a mission; it is on record when this returns, whatever happens to the process.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn add(&mut self, row: &MissionRow) -> Result<(), LabError> {
        let mut writer = csv::WriterBuilder::new().has_headers(false).from_writer(Vec::new());
        writer.serialize(row).expect("plain numbers");
        let text = writer.into_inner().expect("memory takes everything");
        let line = checked_line(text.trim_ascii_end(), self.seed);
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

/// The seed of the checks in a sweep's journal.
///
/// # Panics
/// Never: a definition is plain values.
#[must_use]
pub fn check_seed(definition: &Definition) -> u64 {
    xxh3_64(serde_json::to_string(definition).expect("plain values").as_bytes())
}

/// The line of a mission whose numbers are `text`.
#[must_use]
pub fn checked_line(text: &[u8], seed: u64) -> Vec<u8> {
    [text, b",", check(text, seed).as_bytes(), b"\n"].concat()
}

/// What the line that holds `text` ends with.
fn check(text: &[u8], seed: u64) -> String {
    format!("{:016x}", xxh3_64_with_seed(text, seed))
}

fn parse(path: &Path, text: &[u8], definition: &Definition) -> Result<MissionRows, LabError> {
    let seed = check_seed(definition);
    let mut rows = MissionRows::new();
    for (number, line) in (1..).zip(text.split_inclusive(|&byte| byte == b'\n')) {
        let row = mission(line.trim_ascii_end(), seed).and_then(|row| match definition.contains(row.key) {
            true => Ok(row),
            false => Err("expected a mission of the sweep".to_owned()),
        });
        let quoted = String::from_utf8_lossy(line);
        let row = row.map_err(|message| InputError::line("sweep journal", path, number, &quoted, message))?;
        rows.insert(row.key, row);
    }
    Ok(rows)
}

/// The mission in a line, or what is wrong with it.
fn mission(line: &[u8], seed: u64) -> Result<MissionRow, String> {
    let (text, found) = line.split_at(line.iter().rposition(|&byte| byte == b',').unwrap_or(0));
    let expected = check(text, seed);
    if found.strip_prefix(b",") != Some(expected.as_bytes()) {
        let remedy = "delete the line, and `skysink sweep` flies its mission again";
        return Err(format!("expected the check {expected}: the line, or sweep.json beside it, was changed: {remedy}"));
    }
    let mut reader = csv::ReaderBuilder::new().has_headers(false).from_reader(text);
    let row = reader.deserialize().next().ok_or("expected a mission")?;
    row.map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_mission::record::write_whole;
    use skysink_planner::strategies::STRATEGIES;

    fn definition(identity: &str) -> Definition {
        Definition {
            identity: identity.to_owned(),
            version: "1".to_owned(),
            keys: Vec::new(),
            points: vec![Vec::new()],
            strategies: vec![STRATEGIES[0].name.to_owned()],
            seeds: vec![1, 2],
        }
    }

    fn row(point: usize, strategy: usize, seed: u64) -> MissionRow {
        let values = std::array::from_fn(|metric| if metric == 3 { f64::NAN } else { 0.1 * metric as f64 });
        MissionRow { key: MissionKey { point, strategy, seed }, values }
    }

    /// The journal of a sweep in a folder of its own, with these rows.
    fn journal(rows: &[MissionRow]) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal.csv");
        let (mut journal, there) = SweepJournal::open(&path, &definition("a")).unwrap();
        assert!(there.is_empty());
        rows.iter().for_each(|row| journal.add(row).unwrap());
        (folder, path)
    }

    #[test]
    fn no_changed_byte_is_taken_over() {
        let (_folder, path) = journal(&[row(0, 0, 1), row(0, 0, 2)]);
        let text = std::fs::read(&path).unwrap();
        let whole = read(&path, &definition("a")).unwrap();
        assert_eq!(whole.len(), 2);
        let lines = [0, text.iter().position(|&byte| byte == b'\n').unwrap() + 1];
        for at in 0..text.len() - 1 {
            for bit in 0..8 {
                let mut changed = text.clone();
                changed[at] ^= 1 << bit;
                write_whole(&path, &changed).unwrap();
                let refusal = read(&path, &definition("a")).unwrap_err().to_string();
                let line = if at < lines[1] { 1 } else { 2 };
                assert!(refusal.contains(&format!("line {line}: ")) && !refusal.contains('\n'), "{at}: {refusal}");
                assert!(refusal.contains("expected the check "), "{at}: {refusal}");
            }
        }
    }

    #[test]
    fn a_line_of_another_sweep_is_refused() {
        let (_folder, path) = journal(&[row(0, 0, 1)]);
        let refusal = read(&path, &definition("b")).unwrap_err().to_string();
        assert!(refusal.contains("line 1: ") && refusal.contains("sweep.json beside it, was changed"), "{refusal}");
    }

    #[test]
    fn a_mission_that_the_sweep_has_not_is_refused() {
        for (point, strategy, seed) in [(1, 0, 1), (0, 1, 1), (0, 0, 3), (usize::MAX, usize::MAX, 1)] {
            let (_folder, path) = journal(&[row(0, 0, 1), row(point, strategy, seed)]);
            let refusal = read(&path, &definition("a")).unwrap_err().to_string();
            assert!(refusal.contains("line 2: ") && refusal.ends_with("expected a mission of the sweep"), "{refusal}");
        }
    }
}
