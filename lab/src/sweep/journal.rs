//! The journal of a sweep: one line per finished mission, so that an interrupted sweep can be resumed.
//!
//! Each line ends with a hash of its bytes, seeded by what its mission depends on, so that changed lines and lines of
//! other sweeps are detected, and those of a sweep that is extended stay.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Read, Write};
use std::ops::Index;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use csv::ByteRecord;
use serde::{Deserialize, Serialize};
use skysink_common::error::InputError;
use skysink_mission::error::FileContext;
use strum::VariantArray;
use xxhash_rust::xxh3::{xxh3_64, xxh3_64_with_seed};

use super::definition::{Definition, MissionKey};
use crate::error::LabError;
use crate::metrics::{Metric, MetricValues};

/// The metrics of a mission, as in the journal.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MissionRow {
    /// The mission.
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

/// The missions of a point and a strategy, by ascending seed.
pub fn missions_of(rows: &MissionRows, point: usize, strategy: usize) -> impl Iterator<Item = &MissionRow> {
    let key = |seed| MissionKey { point, strategy, seed };
    rows.range(key(0)..=key(u64::MAX)).map(|(_, row)| row)
}

/// The offset of a mission that was not flown.
const NOT_FLOWN: u64 = u64::MAX;

/// Maximum length of a line with its line break [byte].
const MAX_LINE: usize = 4096;

/// Maximum length of a number with its comma [byte].
const MAX_NUMBER: usize = 26;

const _: () = assert!((4 + Metric::VARIANTS.len()) * MAX_NUMBER <= MAX_LINE);

/// The journal of a running sweep. The rows stay in the file; only their offsets are in memory.
#[derive(Debug)]
pub struct SweepJournal {
    path: PathBuf,
    file: File,
    seeds: CheckSeeds,
    /// The sweep.
    pub(crate) definition: Definition,
    /// The offset of each mission's line, in the order of the results, or [`NOT_FLOWN`].
    begins: Vec<u64>,
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
        let mut begins = vec![NOT_FLOWN; definition.mission_count()];
        let mut lines = JournalLines::open(path, definition, &seeds)?;
        let mut end = 0;
        while let Some(row) = lines.next() {
            begins[definition.index(row?.key).expect("lines of other missions are refused")] = end;
            end = lines.end;
        }
        file.set_len(end).at(path)?;
        Ok(Self { path: path.to_owned(), file, seeds, definition: definition.clone(), begins, end })
    }

    /// Whether the journal contains this mission.
    #[must_use]
    pub fn has(&self, mission: MissionKey) -> bool {
        self.definition.index(mission).is_some_and(|index| self.begins[index] != NOT_FLOWN)
    }

    /// The number of missions in the journal.
    #[must_use]
    pub fn count(&self) -> usize {
        self.begins.iter().filter(|&&begin| begin != NOT_FLOWN).count()
    }

    /// Adds a mission. When this returns, the line survives a crash of the process.
    ///
    /// # Errors
    /// If the mission does not belong to the sweep, or the file cannot be written.
    pub fn add(&mut self, row: &MissionRow) -> Result<(), LabError> {
        let Some(index) = self.definition.index(row.key) else {
            let message = format_args!("{:?}: expected a mission of the sweep", row.key);
            return Err(InputError::new("sweep journal", &self.path, message).into());
        };
        let line = line(row, &self.seeds);
        if let Err(error) = self.file.write_all(&line) {
            self.file.set_len(self.end).at(&self.path)?; // the next mission starts on a new line
            return Err(error).at(&self.path)?;
        }
        self.begins[index] = self.end;
        self.end += line.len() as u64;
        Ok(())
    }

    /// Reads the missions one by one, in the order of the results.
    pub fn rows(&self) -> impl Iterator<Item = Result<MissionRow, LabError>> {
        self.rows_between(0, self.begins.len())
    }

    /// Reads the missions of a point and a strategy, by ascending seed.
    ///
    /// # Panics
    /// If the sweep has no such point or strategy.
    pub fn rows_of(&self, point: usize, strategy: usize) -> impl Iterator<Item = Result<MissionRow, LabError>> {
        let seeds = &self.definition.seeds;
        let first = self.definition.index(MissionKey { point, strategy, seed: seeds[0] });
        let first = first.expect("a point and a strategy of the sweep");
        self.rows_between(first, first + seeds.len())
    }

    /// Reads all missions.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn all(&self) -> Result<MissionRows, LabError> {
        self.rows().map(|row| row.map(|row| (row.key, row))).collect()
    }

    fn rows_between(&self, first: usize, end: usize) -> impl Iterator<Item = Result<MissionRow, LabError>> {
        self.begins[first..end].iter().filter(|&&begin| begin != NOT_FLOWN).map(|&begin| self.row_at(begin))
    }

    fn row_at(&self, begin: u64) -> Result<MissionRow, LabError> {
        let mut text = [0; MAX_LINE];
        let count = self.file.read_at(&mut text, begin).at(&self.path)?;
        let line = text[..count].split(|&byte| byte == b'\n').next().unwrap_or_default();
        let refuse = |message| InputError::new("sweep journal", &self.path, format_args!("byte {begin}: {message}"));
        Ok(mission(line, &self.seeds).map_err(refuse)?)
    }
}

/// Iterator over the missions of a journal, in the order of its lines. It stops at an incomplete line.
#[derive(Debug)]
pub struct JournalLines<'a> {
    path: &'a Path,
    definition: &'a Definition,
    seeds: &'a CheckSeeds,
    reader: BufReader<File>,
    number: usize,
    /// The offset after the last line that was read.
    end: u64,
}

impl<'a> JournalLines<'a> {
    /// Opens the journal of this sweep; `seeds` are its own.
    ///
    /// # Errors
    /// If the file cannot be opened.
    pub fn open(path: &'a Path, definition: &'a Definition, seeds: &'a CheckSeeds) -> Result<Self, LabError> {
        let reader = BufReader::new(File::open(path).at(path)?);
        Ok(Self { path, definition, seeds, reader, number: 0, end: 0 })
    }
}

impl Iterator for JournalLines<'_> {
    type Item = Result<MissionRow, LabError>;

    fn next(&mut self) -> Option<Self::Item> {
        let mut line = Vec::new();
        let read = self.reader.by_ref().take(MAX_LINE as u64).read_until(b'\n', &mut line);
        if let Err(error) = read.at(self.path) {
            return Some(Err(error.into()));
        }
        self.number += 1;
        self.end += line.len() as u64;
        let row = match line.strip_suffix(b"\n") {
            Some(text) => mission(text, self.seeds),
            None if line.len() < MAX_LINE => return None,
            None => Err(format!("expected at most {MAX_LINE} bytes")),
        };
        let row = row.and_then(|row| {
            self.definition.index(row.key).map(|_| row).ok_or_else(|| "expected a mission of the sweep".to_owned())
        });
        let quoted = String::from_utf8_lossy(&line);
        let refuse = |message| InputError::line("sweep journal", self.path, self.number, &quoted, message).into();
        Some(row.map_err(refuse))
    }
}

/// Reads all missions of the journal of this sweep.
///
/// # Errors
/// If the journal cannot be read, or belongs to another sweep.
pub fn read(path: &Path, definition: &Definition) -> Result<MissionRows, LabError> {
    let seeds = CheckSeeds::of(definition);
    JournalLines::open(path, definition, &seeds)?.map(|row| row.map(|row| (row.key, row))).collect()
}

/// The seeds of the hashes in the journal of a sweep. That of a line depends on the sweep's grid and on the name and
/// the source of the line's strategy.
#[derive(Debug)]
pub struct CheckSeeds(Vec<u64>);

impl CheckSeeds {
    /// Those of this sweep, and one for lines of no strategy of it.
    #[must_use]
    pub fn of(definition: &Definition) -> Self {
        let seed = |name: &str| {
            let source = definition.sources.get(name).map_or("", String::as_str);
            xxh3_64([&definition.grid, name, source].join("\n").as_bytes())
        };
        Self(definition.strategies.iter().map(String::as_str).chain([""]).map(seed).collect())
    }

    /// That of the line with the numbers `text`, which begin with the point and the strategy.
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
fn mission(line: &[u8], seeds: &CheckSeeds) -> Result<MissionRow, String> {
    let (text, found) = line.split_at(line.iter().rposition(|&byte| byte == b',').unwrap_or(0));
    let expected = check(text, seeds);
    if found.strip_prefix(b",") != Some(expected.as_bytes()) {
        let remedy = "delete the line, and `skysink sweep` runs its mission again";
        return Err(format!("expected the checksum {expected}: the line or sweep.json was modified: {remedy}"));
    }
    let numbers: ByteRecord = text.split(|&byte| byte == b',').collect();
    numbers.deserialize(None).map_err(|error| error.to_string())
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
        assert_eq!(journal.count(), 0);
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
            for bit in 0..8 {
                let mut changed = text.clone();
                changed[at] ^= 1 << bit;
                write_whole(&path, &changed).unwrap();
                let refusal = read(&path, &definition("a")).unwrap_err().to_string();
                let line = if at < lines[1] { 1 } else { 2 };
                assert!(refusal.contains(&format!("line {line}: ")) && !refusal.contains('\n'), "{at}: {refusal}");
                assert!(refusal.contains("expected the checksum "), "{at}: {refusal}");
            }
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
        let seeds = |rows: Vec<MissionRow>| rows.iter().map(|row| row.key.seed).collect::<Vec<_>>();
        assert_eq!(seeds(journal.rows().collect::<Result<_, _>>().unwrap()), [1, 2]);
        assert_eq!(seeds(journal.rows_of(0, 0).collect::<Result<_, _>>().unwrap()), [1, 2]);
        let first = journal.rows().next().unwrap().unwrap();
        assert!(first.values[3].is_nan() && first.values[4].to_bits() == row(0, 0, 1).values[4].to_bits());
    }

    #[test]
    fn a_row_changed_after_opening_is_refused() {
        let (_folder, path) = journal(&[row(0, 0, 1), row(0, 0, 2)]);
        let journal = SweepJournal::open(&path, &definition("a")).unwrap();
        let mut text = std::fs::read(&path).unwrap();
        let second = text.iter().position(|&byte| byte == b'\n').unwrap() + 1;
        text[second] = b'1';
        std::fs::write(&path, &text).unwrap();
        let refusal = journal.all().unwrap_err().to_string();
        assert!(refusal.contains(&format!("byte {second}: expected the checksum ")), "{refusal}");
    }

    #[test]
    fn an_incomplete_last_line_is_dropped() {
        let (_folder, path) = journal(&[row(0, 0, 1), row(0, 0, 2)]);
        let text = std::fs::read(&path).unwrap();
        std::fs::write(&path, &text[..text.len() - 1]).unwrap();
        let mut journal = SweepJournal::open(&path, &definition("a")).unwrap();
        assert!(journal.has(row(0, 0, 1).key) && !journal.has(row(0, 0, 2).key));
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
