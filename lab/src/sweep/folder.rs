//! The folder of a sweep: its manifest, its lock, and its journal.

use std::collections::BTreeMap;
use std::fs::{self, File, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use skysink_common::error::InputError;
use skysink_common::stop::Stop;
use skysink_mission::MissionError;
use skysink_mission::error::FileContext;
use skysink_mission::record::{is_unfinished, write_whole};

use super::journal::{self, MissionRow, MissionRows, SweepJournal, missions_of};
use super::plan::{Definition, MissionKey, Shard, Sweep};
use super::results;
use crate::error::LabError;
use crate::metrics::Metric;

/// File name of the journal.
pub const JOURNAL: &str = "journal.csv";

/// File name of the manifest.
const MANIFEST: &str = "sweep.json";

/// The content of `sweep.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// The shard in the folder.
    pub shard: Shard,
    /// The sweep.
    #[serde(flatten)]
    pub definition: Definition,
}

/// The folder of a running sweep, locked by this process.
#[derive(Debug)]
pub struct SweepRecord {
    /// Released when the record is dropped or the process ends.
    _lock: File,
    folder: PathBuf,
    manifest: Manifest,
    journal: SweepJournal,
}

impl SweepRecord {
    /// Creates or opens the folder of a shard of a sweep.
    ///
    /// # Errors
    /// If the folder contains another sweep or other files, cannot be created, or is in use by another process.
    pub fn open(sweep: &Sweep, folder: &Path, shard: Shard) -> Result<Self, LabError> {
        Self::of(Manifest { shard, definition: sweep.definition.clone() }, folder)
    }

    /// Creates or opens the folder with this manifest.
    pub(super) fn of(manifest: Manifest, folder: &Path) -> Result<Self, LabError> {
        let lock = lock_folder(folder, &manifest)?;
        let journal = SweepJournal::open(&folder.join(JOURNAL), &manifest.definition)?;
        Ok(Self { _lock: lock, folder: folder.to_owned(), manifest, journal })
    }

    /// The missions that are not in the journal, in the order of the results.
    pub fn missing(&self) -> impl Iterator<Item = MissionKey> {
        self.manifest.definition.missions(self.manifest.shard).filter(|&mission| !self.journal.has(mission))
    }

    /// Adds a mission unless it exists. When this returns, the mission survives a crash of the process.
    ///
    /// # Errors
    /// If the mission does not belong to the sweep, or the journal cannot be written.
    pub fn add(&mut self, row: &MissionRow) -> Result<(), LabError> {
        if self.journal.has(row.key) { Ok(()) } else { self.journal.add(row) }
    }

    /// Writes the results, and returns the journal.
    ///
    /// # Errors
    /// If a mission is missing, a file cannot be written, or on a stop.
    pub fn finish(self, stop: &Stop) -> Result<SweepJournal, LabError> {
        let missing = self.missing().count();
        if missing > 0 {
            let message = format_args!("{missing} missions are missing: fly them first");
            return Err(InputError::new("sweep folder", &self.folder, message).into());
        }
        self.write(stop)
    }

    /// Writes the results of the missions in the journal, and returns the journal.
    pub(super) fn write(self, stop: &Stop) -> Result<SweepJournal, LabError> {
        results::write(&self.folder, &self.manifest.definition, &self.journal, stop)?;
        Ok(self.journal)
    }
}

/// Creates or opens the folder of a sweep, and locks it.
///
/// # Errors
/// As [`SweepRecord::open`].
fn lock_folder(path: &Path, manifest: &Manifest) -> Result<File, LabError> {
    let refuse = |message| InputError::new("sweep folder", path, message);
    if path.exists() && !path.is_dir() {
        return Err(refuse("it is a file: choose another --out").into());
    }
    fs::create_dir_all(path).at(path)?;
    is_begun(path, manifest)?; // refuses the folder before the lock file is created
    let lock_path = path.join("lock");
    let lock = File::options().write(true).create(true).truncate(false).open(&lock_path).at(&lock_path)?;
    lock.try_lock().map_err(|error| match error {
        TryLockError::WouldBlock => {
            MissionError::from(refuse("another process is running this sweep: stop it, or choose another --out"))
        }
        TryLockError::Error(source) => MissionError::File { path: lock_path, source },
    })?;
    for entry in fs::read_dir(path).at(path)?.flatten().filter(|entry| is_unfinished(&entry.file_name())) {
        let _ = fs::remove_file(entry.path()); // left by a killed process
    }
    if !is_begun(path, manifest)? {
        let text = serde_json::to_string_pretty(manifest).expect("plain values") + "\n";
        write_whole(&path.join(MANIFEST), text.as_bytes())?;
    }
    Ok(lock)
}

/// Whether the folder contains this sweep. Fails if it contains another sweep or other files.
fn is_begun(path: &Path, manifest: &Manifest) -> Result<bool, LabError> {
    let refuse = |message| InputError::new("sweep folder", path, message);
    let file = path.join(MANIFEST);
    match fs::read(&file) {
        Ok(text) => {
            let held: Manifest = serde_json::from_slice(&text)
                .map_err(|_| refuse("its sweep.json is invalid: delete the folder, or choose another --out"))?;
            if held.definition == manifest.definition && held.shard != manifest.shard {
                let Manifest { shard, .. } = held;
                let message = format_args!("it contains shard {shard} of this sweep: choose another --out");
                return Err(InputError::new("sweep folder", path, message).into());
            }
            if held != *manifest {
                return Err(refuse("its sweep.json describes another sweep: choose another --out").into());
            }
            Ok(true)
        }
        Err(error) if error.kind() == ErrorKind::NotFound => {
            if has_foreign_files(path)? {
                return Err(refuse("it contains other files: choose another --out").into());
            }
            Ok(false)
        }
        Err(source) => Err(MissionError::File { path: file, source }.into()),
    }
}

/// Reads the manifest of the folder `path`; `None` if the sweep has not begun. `what` names the folder in errors.
///
/// # Errors
/// If the folder is not that of a sweep, or was written by another version.
pub fn manifest(what: &'static str, path: &Path) -> Result<Option<Manifest>, LabError> {
    let refuse = |message: String| InputError::new(what, path, message);
    if path.is_file() {
        return Err(refuse("it is a file: expected the folder of a sweep".to_owned()).into());
    }
    let text = match fs::read(path.join(MANIFEST)) {
        Err(_) if path.is_dir() && !has_foreign_files(path)? => return Ok(None),
        text => text.map_err(|error| refuse(format!("{MANIFEST}: {error}: expected the folder of a sweep")))?,
    };
    let manifest: Manifest = serde_json::from_slice(&text).map_err(|error| {
        refuse(format!("{MANIFEST}: {error}: expected that of a sweep: delete the folder and run the {what} again"))
    })?;
    let version = &manifest.definition.version;
    if version != env!("CARGO_PKG_VERSION") {
        let expected = concat!("expected ", env!("CARGO_PKG_VERSION"), ": run the");
        return Err(refuse(format!("it was written by Skysink {version}: {expected} {what} again")).into());
    }
    Ok(Some(manifest))
}

/// Whether a folder contains files other than the lock and temporary files, which a killed process can leave before it
/// has written `sweep.json`.
fn has_foreign_files(path: &Path) -> Result<bool, LabError> {
    let is_foreign = |entry: fs::DirEntry| entry.file_name() != "lock" && !is_unfinished(&entry.file_name());
    Ok(fs::read_dir(path).at(path)?.flatten().any(is_foreign))
}

/// The finished missions of a sweep.
#[derive(Debug, Clone)]
pub struct FlownSweep {
    /// The sweep.
    pub definition: Definition,
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
        let Manifest { definition, .. } = manifest(what, path)?.ok_or_else(|| refuse(MANIFEST))?;
        let journal = path.join(JOURNAL);
        if !journal.is_file() {
            return Err(refuse(JOURNAL).into());
        }
        let rows = journal::read(&journal, &definition)?;
        Ok(Self { definition, rows })
    }

    /// A metric of the missions of a point and a strategy, by seed; NaN if a mission has no value.
    #[must_use]
    pub fn values(&self, point: usize, strategy: usize, metric: Metric) -> BTreeMap<u64, f64> {
        missions_of(&self.rows, point, strategy).map(|row| (row.key.seed, row[metric])).collect()
    }
}
