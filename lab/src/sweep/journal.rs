//! The journal of a sweep: one line per finished mission, so that an interrupted sweep can be resumed.
//!
//! Each line ends with a hash of its bytes, seeded by what its mission depends on, so that changed lines and lines of
//! other sweeps are detected, and those of a sweep that is extended stay.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Read, Write};
use std::ops::Index;
use std::path::{Path, PathBuf};

use csv::ByteRecord;
use serde::{Deserialize, Serialize};
use skysink_common::error::InputError;
use skysink_mission::error::FileContext;
use strum::VariantArray;
use xxhash_rust::xxh3::{xxh3_64, xxh3_64_with_seed};

use super::definition::{Definition, MissionKey};
use crate::error::LabError;
use skysink_mission::metrics::{Metric, MetricValues};

/// The metrics of a mission, as in the journal.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MissionRow {
    /// The mission.
    pub key: MissionKey,
    /// Its metrics.
    #[serde(with = "metric_values")]
    pub values: MetricValues,
}

impl Index<Metric> for MissionRow {
    type Output = f64;

    fn index(&self, metric: Metric) -> &f64 {
        &self.values[metric as usize]
    }
}

/// The metrics as a list, because serde has no arrays of more than 32 numbers.
mod metric_values {
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    use skysink_mission::metrics::MetricValues;

    pub fn serialize<S: Serializer>(values: &MetricValues, serializer: S) -> Result<S::Ok, S::Error> {
        values.as_slice().serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<MetricValues, D::Error> {
        let values = Vec::<f64>::deserialize(deserializer)?;
        let found = values.len();
        MetricValues::try_from(values).map_err(|_| D::Error::invalid_length(found, &"a value of each metric"))
    }
}

/// The missions of a sweep, in the order of the results.
pub type MissionRows = BTreeMap<MissionKey, MissionRow>;

/// The missions of a point and a strategy, by ascending seed.
pub fn missions_of(rows: &MissionRows, point: usize, strategy: usize) -> impl Iterator<Item = &MissionRow> {
    let key = |seed| MissionKey { point, strategy, seed };
    rows.range(key(0)..=key(u64::MAX)).map(|(_, row)| row)
}

/// Maximum length of a line with its line break [byte].
const MAX_LINE: usize = 4096;

/// Maximum length of a number with its comma [byte].
const MAX_NUMBER: usize = 26;

const _: () = assert!((4 + Metric::VARIANTS.len()) * MAX_NUMBER <= MAX_LINE);

/// The journal of a running sweep, with its missions.
#[derive(Debug)]
pub struct SweepJournal {
    path: PathBuf,
    file: File,
    seeds: CheckSeeds,
    /// The sweep.
    pub(crate) definition: Definition,
    /// The finished missions.
    pub rows: MissionRows,
    /// Length of the file.
    end: u64,
}

impl SweepJournal {
    /// Opens or creates the journal of this sweep, and drops an incomplete last line.
    ///
    /// # Errors
    /// If the journal cannot be read or written, or belongs to another sweep.
    pub fn open(path: &Path, definition: &Definition) -> Result<Self, LabError> {
        if path.exists() && !path.is_file() {
            return Err(InputError::new("sweep journal", path, "expected a regular file").into());
        }
        let file = OpenOptions::new().read(true).append(true).create(true).open(path).at(path)?;
        let seeds = CheckSeeds::of(definition);
        let (rows, end) = read_lines(path, definition, &seeds)?;
        file.set_len(end).at(path)?;
        Ok(Self { path: path.to_owned(), file, seeds, definition: definition.clone(), rows, end })
    }

    /// The number of missions.
    pub fn count(&self) -> usize {
        self.rows.len()
    }

    /// Adds a mission. When this returns, the line survives a crash of the process.
    ///
    /// # Errors
    /// If the mission does not belong to the sweep, or the file cannot be written.
    pub fn add(&mut self, row: &MissionRow) -> Result<(), LabError> {
        if self.definition.index(row.key).is_none() {
            let message = format_args!("{:?}: expected a mission of the sweep", row.key);
            return Err(InputError::new("sweep journal", &self.path, message).into());
        }
        let line = line(row, &self.seeds);
        if let Err(error) = self.file.write_all(&line) {
            self.file.set_len(self.end).at(&self.path)?; // the next mission starts on a new line
            return Err(error).at(&self.path)?;
        }
        self.rows.insert(row.key, *row);
        self.end += line.len() as u64;
        Ok(())
    }
}

/// Reads all missions of the journal of this sweep.
///
/// # Errors
/// If the journal cannot be read, or belongs to another sweep.
pub fn read(path: &Path, definition: &Definition) -> Result<MissionRows, LabError> {
    let (rows, _) = read_lines(path, definition, &CheckSeeds::of(definition))?;
    Ok(rows)
}

/// The missions of a journal, and its length without an incomplete last line.
fn read_lines(path: &Path, definition: &Definition, seeds: &CheckSeeds) -> Result<(MissionRows, u64), LabError> {
    let mut reader = BufReader::new(File::open(path).at(path)?);
    let mut rows = MissionRows::new();
    let mut end = 0;
    for number in 1.. {
        let mut line = Vec::new();
        reader.by_ref().take(MAX_LINE as u64).read_until(b'\n', &mut line).at(path)?;
        let row = match line.strip_suffix(b"\n") {
            Some(text) => mission(text, definition, seeds),
            None if line.len() < MAX_LINE => break,
            None => Err(format!("expected at most {MAX_LINE} bytes")),
        };
        let refuse =
            |message| InputError::line("sweep journal", path, number, &String::from_utf8_lossy(&line), message);
        let row = row.map_err(refuse)?;
        rows.insert(row.key, row);
        end += line.len() as u64;
    }
    Ok((rows, end))
}

/// The seeds of the hashes in the journal of a sweep. The seed of a line depends on the sweep's grid and on the name
/// and the source of the line's strategy.
#[derive(Debug)]
pub struct CheckSeeds(Vec<u64>);

impl CheckSeeds {
    /// The seeds of this sweep, and one for lines of no strategy of it.
    #[must_use]
    pub fn of(definition: &Definition) -> Self {
        let seed = |name: &str| {
            let source = definition.sources.get(name).map_or("", String::as_str);
            xxh3_64([&definition.grid, name, source].join("\n").as_bytes())
        };
        Self(definition.strategies.iter().map(String::as_str).chain([""]).map(seed).collect())
    }

    /// The seed of the line with the numbers `text`, which begin with the point and the strategy.
    fn seed(&self, text: &[u8]) -> u64 {
        let strategy = text.split(|&byte| byte == b',').nth(1).and_then(|number| str::from_utf8(number).ok());
        let last = self.0.len() - 1;
        self.0[strategy.and_then(|number| number.parse().ok()).map_or(last, |index: usize| index.min(last))]
    }
}

/// The line of a mission.
fn line(row: &MissionRow, seeds: &CheckSeeds) -> Vec<u8> {
    let mut writer = csv::WriterBuilder::new().has_headers(false).from_writer(Vec::new());
    writer.serialize(row).expect("plain numbers");
    let text = writer.into_inner().expect("memory takes everything");
    checked_line(text.trim_ascii_end(), seeds)
}

/// The journal line with the numbers `text` and their hash.
#[must_use]
pub fn checked_line(text: &[u8], seeds: &CheckSeeds) -> Vec<u8> {
    [text, b",", check(text, seeds).as_bytes(), b"\n"].concat()
}

/// The hash at the end of the line with the numbers `text`.
fn check(text: &[u8], seeds: &CheckSeeds) -> String {
    format!("{:016x}", xxh3_64_with_seed(text, seeds.seed(text)))
}

/// Parses and checks a line.
fn mission(line: &[u8], definition: &Definition, seeds: &CheckSeeds) -> Result<MissionRow, String> {
    let (text, found) = line.split_at(line.iter().rposition(|&byte| byte == b',').unwrap_or(0));
    let expected = check(text, seeds);
    if found.strip_prefix(b",") != Some(expected.as_bytes()) {
        let remedy = "delete the line, and `skysink sweep` runs its mission again";
        return Err(format!("expected the checksum {expected}: the line or sweep.json was modified: {remedy}"));
    }
    let numbers: ByteRecord = text.split(|&byte| byte == b',').collect();
    let row: MissionRow = numbers.deserialize(None).map_err(|error| error.to_string())?;
    definition.index(row.key).map(|_| row).ok_or_else(|| "expected a mission of the sweep".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_mission::files::write_whole;
    use skysink_planner::strategies::STRATEGIES;

    fn definition(identity: &str) -> Definition {
        Definition {
            identity: String::new(),
            grid: identity.to_owned(),
            version: "1".to_owned(),
            keys: Vec::new(),
            points: vec![Vec::new()],
            strategies: vec![STRATEGIES[0].name.to_owned()],
            sources: BTreeMap::new(),
            models: Vec::new(),
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
        let mut journal = SweepJournal::open(&path, &definition("a")).unwrap();
        assert!(journal.rows.is_empty());
        rows.iter().for_each(|row| journal.add(row).unwrap());
        (folder, path)
    }

    #[test]
    fn a_changed_byte_is_detected() {
        let (_folder, path) = journal(&[row(0, 0, 1), row(0, 0, 2)]);
        let text = std::fs::read(&path).unwrap();
        let whole = read(&path, &definition("a")).unwrap();
        assert_eq!(whole.len(), 2);
        let lines = [0, text.iter().position(|&byte| byte == b'\n').unwrap() + 1];
        for at in 0..text.len() - 1 {
            let mut changed = text.clone();
            changed[at] ^= 1 << (at % 8);
            write_whole(&path, &changed).unwrap();
            let refusal = read(&path, &definition("a")).unwrap_err().to_string();
            let line = if at < lines[1] { 1 } else { 2 };
            assert!(refusal.contains(&format!("line {line}: ")) && !refusal.contains('\n'), "{at}: {refusal}");
            assert!(refusal.contains("expected the checksum "), "{at}: {refusal}");
        }
    }

    #[test]
    fn a_line_of_another_sweep_is_refused() {
        let (_folder, path) = journal(&[row(0, 0, 1)]);
        let refusal = read(&path, &definition("b")).unwrap_err().to_string();
        assert!(refusal.contains("line 1: ") && refusal.contains("the line or sweep.json was modified"), "{refusal}");
    }

    #[test]
    fn an_extended_sweep_keeps_the_lines_of_each_strategy() {
        let (_folder, path) = journal(&[row(0, 0, 1), row(0, 0, 2)]);
        let mut other = definition("a");
        other.seeds.push(3);
        other.strategies.push(STRATEGIES[1].name.to_owned());
        assert_eq!(read(&path, &other).unwrap().len(), 2);
        other.strategies.swap(0, 1);
        assert!(read(&path, &other).unwrap_err().to_string().contains("expected the checksum"));
        let mut changed = definition("a");
        changed.sources.insert(changed.strategies[0].clone(), "1".to_owned());
        assert!(read(&path, &changed).unwrap_err().to_string().contains("expected the checksum"));
    }

    #[test]
    fn a_mission_of_another_sweep_is_refused() {
        for (point, strategy, seed) in [(1, 0, 1), (0, 1, 1), (0, 0, 3), (usize::MAX, usize::MAX, 1)] {
            let (_folder, path) = journal(&[row(0, 0, 1)]);
            let foreign = row(point, strategy, seed);
            let mut journal = SweepJournal::open(&path, &definition("a")).unwrap();
            assert!(journal.add(&foreign).unwrap_err().to_string().ends_with("expected a mission of the sweep"));
            let text = [std::fs::read(&path).unwrap(), line(&foreign, &CheckSeeds::of(&definition("a")))].concat();
            write_whole(&path, &text).unwrap();
            let refusal = read(&path, &definition("a")).unwrap_err().to_string();
            assert!(refusal.contains("line 2: ") && refusal.ends_with("expected a mission of the sweep"), "{refusal}");
        }
    }

    #[test]
    fn rows_are_in_the_order_of_the_results() {
        let (_folder, path) = journal(&[row(0, 0, 2), row(0, 0, 1)]);
        let journal = SweepJournal::open(&path, &definition("a")).unwrap();
        assert_eq!(journal.rows.keys().map(|key| key.seed).collect::<Vec<_>>(), [1, 2]);
        assert_eq!(missions_of(&journal.rows, 0, 0).map(|row| row.key.seed).collect::<Vec<_>>(), [1, 2]);
        let first = journal.rows.values().next().unwrap();
        assert!(first.values[3].is_nan() && first.values[4].to_bits() == row(0, 0, 1).values[4].to_bits());
    }

    #[test]
    fn an_incomplete_last_line_is_dropped() {
        let (_folder, path) = journal(&[row(0, 0, 1), row(0, 0, 2)]);
        let text = std::fs::read(&path).unwrap();
        std::fs::write(&path, &text[..text.len() - 1]).unwrap();
        let mut journal = SweepJournal::open(&path, &definition("a")).unwrap();
        assert_eq!(journal.rows.keys().collect::<Vec<_>>(), [&row(0, 0, 1).key]);
        journal.add(&row(0, 0, 2)).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), text);
    }

    #[test]
    fn a_line_that_is_too_long_is_refused() {
        let (_folder, path) = journal(&[row(0, 0, 1)]);
        let good = std::fs::read(&path).unwrap();
        let text = [&[b'1'; MAX_LINE][..], b"\n", &good].concat();
        std::fs::write(&path, &text).unwrap();
        let refusal = SweepJournal::open(&path, &definition("a")).unwrap_err().to_string();
        assert!(refusal.contains("line 1: ") && refusal.ends_with("expected at most 4096 bytes"), "{refusal}");
        assert_eq!(std::fs::read(&path).unwrap(), text);
    }
}
