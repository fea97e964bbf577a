//! The folder of a sweep: its lock, and its journal.

use std::collections::BTreeMap;
use std::fs;
use std::io::ErrorKind;
use std::mem;
use std::path::Path;

use skysink_common::build::build;
use skysink_common::error::InputError;
use skysink_common::stop::Stop;
use skysink_mission::MissionError;
use skysink_mission::error::FileContext;
use skysink_mission::files::{read_regular, write_whole};
use skysink_mission::folder::OutputFolder;

use super::definition::{Definition, MissionKey};
use super::journal::{self, MissionRow, MissionRows, SweepJournal, missions_of};
use super::manifest::{LAYOUT, MANIFEST, Manifest, RECORDING, RESULTS, STANDINGS, SWEEP, add_builds, saved};
use super::plan::Sweep;
use super::results;
use super::saved::SavedFile;
use super::shard::Shard;
use crate::error::LabError;
use skysink_mission::metrics::Metric;

/// File name of the journal.
pub const JOURNAL: &str = "journal.csv";

/// The folder of a running sweep, locked by this process.
#[derive(Debug)]
pub struct SweepRecord {
    folder: OutputFolder,
    manifest: Manifest,
    journal: SweepJournal,
}

impl SweepRecord {
    /// Creates or opens the folder of a shard of a sweep. A sweep in it is extended if it has fewer seeds or
    /// strategies.
    ///
    /// # Errors
    /// If the folder contains another sweep or other files, cannot be created, or is in use by another process.
    pub fn open(sweep: &Sweep, folder: &Path, shard: Shard) -> Result<Self, LabError> {
        let manifest = Manifest { shard, builds: vec![build().to_owned()], definition: sweep.definition.clone() };
        Self::of(manifest, &sweep.files()?, folder)
    }

    /// Creates or opens the folder with this manifest and these files. The builds are added if missions are missing.
    pub(crate) fn of(manifest: Manifest, files: &[SavedFile], path: &Path) -> Result<Self, LabError> {
        let refuse = |message| InputError::new("sweep folder", path, message);
        if path.exists() && !path.is_dir() {
            return Err(refuse("it is a file: choose another --out").into());
        }
        let cannot_create = |source| MissionError::File { path: path.to_owned(), source }.into();
        let folder = LAYOUT.open(path, cannot_create, || check(path, &manifest).map(drop))?;
        let message = "another process is running this sweep: stop it, or choose another --out";
        let folder = folder.ok_or_else(|| refuse(message))?;
        let held = check(path, &manifest)?;
        if held.is_none() {
            manifest.write(path)?;
        }
        let journal = SweepJournal::open(&path.join(JOURNAL), &manifest.definition)?;
        let mut record = Self { folder, manifest, journal };
        if let Some(held) = &held {
            record.continue_from(held)?;
        }
        for (name, bytes) in files {
            let file = path.join(name);
            if !read_regular(&file).is_ok_and(|found| found == *bytes) {
                fs::create_dir_all(file.parent().unwrap_or(path)).at(&file)?;
                write_whole(&file, bytes)?;
            }
        }
        Ok(record)
    }

    /// Adds the builds to those of the manifest `held`, if missions are missing. If the sweep extends that, removes
    /// what no longer belongs to it first.
    fn continue_from(&mut self, held: &Manifest) -> Result<(), LabError> {
        let builds = mem::replace(&mut self.manifest.builds, held.builds.clone());
        if self.missing().next().is_some() {
            add_builds(&mut self.manifest.builds, builds);
        }
        if self.manifest.definition != held.definition {
            let outdated = RESULTS.into_iter().chain([SWEEP, STANDINGS, RECORDING]);
            remove(self.folder.path(), outdated)?;
        }
        if self.manifest == *held { Ok(()) } else { self.manifest.write(self.folder.path()) }
    }

    /// The missions that are not in the journal, in the order of the results.
    pub fn missing(&self) -> impl Iterator<Item = MissionKey> {
        self.manifest
            .definition
            .missions(self.manifest.shard)
            .filter(|&mission| !self.journal.rows.contains_key(&mission))
    }

    /// Adds a mission unless it exists. When this returns, the mission survives a crash of the process.
    ///
    /// # Errors
    /// If the mission does not belong to the sweep, or the journal cannot be written.
    pub fn add(&mut self, row: &MissionRow) -> Result<(), LabError> {
        if self.journal.rows.contains_key(&row.key) { Ok(()) } else { self.journal.add(row) }
    }

    /// Writes the results, and returns the journal.
    ///
    /// # Errors
    /// If a mission is missing, a file cannot be written, or on a stop.
    pub fn finish(self, stop: &Stop) -> Result<SweepJournal, LabError> {
        let missing = self.missing().count();
        if missing > 0 {
            let message = format_args!("{missing} missions are missing: fly them first");
            return Err(InputError::new("sweep folder", self.folder.path(), message).into());
        }
        self.write(stop)
    }

    /// Writes the results of the missions in the journal, and returns the journal.
    pub(crate) fn write(self, stop: &Stop) -> Result<SweepJournal, LabError> {
        results::write(self.folder.path(), &self.journal, stop)?;
        Ok(self.journal)
    }
}

/// Removes those of these files that are in a folder.
fn remove(folder: &Path, names: impl Iterator<Item = &'static str>) -> Result<(), LabError> {
    for name in names {
        let file = folder.join(name);
        match fs::remove_file(&file) {
            Err(error) if error.kind() != ErrorKind::NotFound => Err(error).at(&file)?,
            _ => {}
        }
    }
    Ok(())
}

/// Refuses a folder that contains other files, or a sweep that `manifest` does not continue or extend. Returns the
/// manifest in the folder.
fn check(path: &Path, manifest: &Manifest) -> Result<Option<Manifest>, LabError> {
    let refuse = |message| InputError::new("sweep folder", path, message);
    let file = path.join(MANIFEST);
    match read_regular(&file) {
        Ok(text) => {
            let invalid = "its sweep.json is invalid, or an earlier version wrote it: choose another --out";
            let held: Manifest = serde_json::from_slice(&text).map_err(|_| refuse(invalid))?;
            if let Some(lacking) = held.definition.lacking_in(&manifest.definition) {
                let message =
                    format_args!("its sweep.json describes another sweep, with {lacking}: choose another --out");
                return Err(InputError::new("sweep folder", path, message).into());
            }
            if held.shard != manifest.shard {
                let message = format_args!("it contains shard {} of this sweep: choose another --out", held.shard);
                return Err(InputError::new("sweep folder", path, message).into());
            }
            Ok(Some(held))
        }
        Err(error) if error.kind() == ErrorKind::NotFound => {
            let is_empty = LAYOUT.content(path).at(path)?.is_empty();
            if is_empty { Ok(None) } else { Err(refuse("it contains other files: choose another --out").into()) }
        }
        Err(source) => Err(MissionError::File { path: file, source }.into()),
    }
}

/// Removes the comparison in the folder `path`, a sweep over one scenario with standings, unless `sweep` continues or
/// extends it. Its lock stays.
///
/// # Errors
/// If it is a sweep, which is kept; if it is in use by another process, or a file cannot be removed.
pub fn remove_comparison(path: &Path, sweep: &Sweep) -> Result<(), LabError> {
    let Ok(text) = read_regular(&path.join(MANIFEST)) else { return Ok(()) };
    let refuse = |message| LabError::from(InputError::new("sweep folder", path, message));
    let held = serde_json::from_slice::<Manifest>(&text).ok().map(|held| held.definition);
    if held.as_ref().is_some_and(|held| held.lacking_in(&sweep.definition).is_none()) {
        return Ok(());
    }
    if held.is_none_or(|held| held.points.len() > 1) || !path.join(STANDINGS).is_file() {
        return Err(refuse(
            "it contains a sweep, or a comparison that is unfinished or of an earlier version: --force keeps these",
        ));
    }
    let message = "another process is writing it: stop it, or choose another --out";
    let folder = LAYOUT.lock(path)?.ok_or_else(|| refuse(message))?;
    remove(path, RESULTS.into_iter().chain([JOURNAL, RECORDING]).chain(saved()))?;
    folder.remove_results()?;
    remove(path, [STANDINGS].into_iter()) // last: without them it is no comparison
}

/// The finished missions of a sweep.
#[derive(Debug, Clone)]
pub struct FlownSweep {
    /// The sweep.
    pub definition: Definition,
    /// Commit, compiler and target of each program that flew missions of it, in order.
    pub builds: Vec<String>,
    /// Its finished missions.
    pub rows: MissionRows,
}

impl FlownSweep {
    /// Reads the folder `path`, even while a process writes it. `what` names the folder in errors.
    ///
    /// # Errors
    /// If the folder is not that of a sweep, or its journal belongs to another one.
    pub fn read(what: &'static str, path: &Path) -> Result<Self, LabError> {
        let refuse =
            |missing: &str| InputError::new(what, path, format_args!("it has no {missing}: run the {what} first"));
        let Manifest { definition, builds, .. } = Manifest::read(what, path)?.ok_or_else(|| refuse(MANIFEST))?;
        let journal = path.join(JOURNAL);
        if !journal.is_file() {
            return Err(refuse(JOURNAL).into());
        }
        let rows = journal::read(&journal, &definition)?;
        Ok(Self { definition, builds, rows })
    }

    /// Reads the folder `path` of a sweep whose results are written.
    ///
    /// # Errors
    /// As [`FlownSweep::read`], and if it has no results.
    pub fn read_results(what: &'static str, path: &Path) -> Result<Self, LabError> {
        let sweep = Self::read(what, path)?;
        if path.join(results::MISSIONS).is_file() {
            return Ok(sweep);
        }
        let message = format_args!("it has no {}: run the {what} to its end", results::MISSIONS);
        Err(InputError::new(what, path, message).into())
    }

    /// A metric of the missions of a point and a strategy, by seed; NaN if a mission has no value.
    pub fn values(&self, point: usize, strategy: usize, metric: Metric) -> BTreeMap<u64, f64> {
        missions_of(&self.rows, point, strategy).map(|row| (row.key.seed, row[metric])).collect()
    }
}
