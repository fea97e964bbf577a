//! The run folder: the scenario and the sensor nodes as flown, a line per slot, and the summary.
//!
//! A process locks `slots.csv` before it changes anything in the folder.

use std::fs::{self, DirEntry, File};
use std::io::{self, BufReader};
use std::path::{Path, PathBuf};

use serde::Serialize;
use skysink_common::error::InputError;
use skysink_common::keys::dotted;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::written_file::Extent;
use toml::{Table, Value};

use crate::error::{FileContext, MissionError};
use crate::figures::Summary;
use crate::files::{read_regular, write_whole};
use crate::folder::{Earlier, FolderLayout, OutputFolder};
use crate::origin::{self, RunMode, SourceFile, hash};
use crate::slot_log::{CHECK, SlotLog};
use crate::trace::SLOT_COLUMNS;

/// The results of each sensor node.
pub(crate) const SENSOR_RESULTS: &str = "sensors_out.csv";

/// What other commands, and the Python package, make of a run.
const DERIVED: [&str; 2] = [SENSOR_RESULTS, "slots.parquet"];

/// The figures of the run.
const SUMMARY: &str = "summary.json";

/// In the summary, between the lines with the figures and their check value.
const CHECK_KEY: &str = ",\n  \"check\": ";

/// The trace, which identifies a run folder.
const TRACE: &str = "slots.csv";

/// The other files of a run, except its recordings.
const FILES: [&str; 7] =
    [origin::FILE, "scenario.toml", "sensors.csv", CHECK, SUMMARY, "optimum.json", "vehicles.json"];

/// The files of a run.
static LAYOUT: FolderLayout = FolderLayout {
    lock: TRACE,
    is_result: |name| FILES.contains(&name) || DERIVED.contains(&name) || is_recording(name),
    is_temporary: origin::is_source,
};

/// Whether `folder` holds a run.
#[must_use]
pub fn is_run_folder(folder: &Path) -> bool {
    folder.join(TRACE).is_file() && !folder.join("sweep.json").exists()
}

/// Whether `file` is one that the run in its folder has written, or is to.
#[must_use]
pub fn is_of_run(file: &Path) -> bool {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    let is_own = name == TRACE || (LAYOUT.is_result)(&name) || (LAYOUT.is_temporary)(&name);
    is_own && file.parent().is_some_and(|folder| is_run_folder(&Path::new(".").join(folder)))
}

/// A run folder, locked by this process.
#[derive(Debug)]
pub struct RunFolder {
    folder: OutputFolder,
    mode: RunMode,
    /// Whether the slots are flown in a ring. The plans may then not be reproducible, so each slot is checked.
    in_a_ring: bool,
}

impl RunFolder {
    /// Creates the folder `out`, or `runs/<name>-<strategy>-<seed>` with the first free suffix, and writes `run.toml`,
    /// the scenario and the sensor list. A run in `out` may be replaced.
    ///
    /// # Errors
    /// If `out` is not empty and not to be replaced, holds anything but a run, or holds a running one; or if a file
    /// cannot be written.
    pub fn create(
        out: Option<&Path>,
        earlier: Earlier,
        scenario: &Scenario,
        list: &SensorList,
        mode: &RunMode,
    ) -> Result<Self, MissionError> {
        Self::check(out, earlier)?;
        let path = out.map_or_else(|| make_default(scenario, mode), |out| Ok(out.to_owned()))?;
        let check = || Self::check(Some(&path), earlier);
        let opened = LAYOUT.open(&path, |error| cannot_make(&path, error), check).inspect_err(|_| {
            if out.is_none() {
                let _ = fs::remove_dir(&path); // the new folder of a default name is empty
            }
        });
        let folder = opened?.ok_or_else(|| locked(&path))?;
        let beside = list.files_beside(scenario);
        let beside = beside.map(|(name, text)| SourceFile { name: name.to_owned(), bytes: text.into() });
        let sources = mode.sources.iter().cloned().chain(beside).collect();
        let mode = &RunMode { sources, ..mode.clone() };
        let earlier_sources = origin::source_names(&path);
        let is_foreign = |source: &&SourceFile| {
            !earlier_sources.contains(&source.name) && fs::symlink_metadata(path.join(&source.name)).is_ok()
        };
        if let Some(source) = mode.sources.iter().find(is_foreign) {
            return Err(refuse(&path.join(&source.name), "expected a file of a run: --force replaces nothing else"));
        }
        for source in earlier_sources {
            remove_if_present(&path.join(source))?;
        }
        folder.remove_results()?;
        folder.lock.set_len(0).at(&path.join(TRACE))?;
        let folder = Self { folder, mode: mode.clone(), in_a_ring: mode.pace.is_some() };
        let scenario = scenario.to_toml_with_list("sensors.csv");
        let sensors = list.to_csv();
        folder.write("scenario.toml", &scenario)?;
        folder.write("sensors.csv", &sensors)?;
        // Before the sources, which it lists: those of a killed command are known as its own.
        folder.write(origin::FILE, &origin::write(mode, &scenario, &sensors))?;
        for SourceFile { name, bytes } in &mode.sources {
            write_whole(&folder.path().join(name), bytes)?;
        }
        Ok(folder)
    }

    /// Checks whether a run may be written to `out`, without creating it, such as before a long computation.
    ///
    /// # Errors
    /// If `out` exists and is not to be replaced, or holds anything but a run.
    pub fn check(out: Option<&Path>, earlier: Earlier) -> Result<(), MissionError> {
        let Some(out) = out.filter(|out| fs::symlink_metadata(out).is_ok()) else { return Ok(()) };
        if !out.is_dir() {
            return Err(refuse(out, "it is no folder: choose another --out"));
        }
        if is_empty(out) {
            return Ok(());
        }
        if earlier == Earlier::Kept {
            // That of vehicles may have ended because somebody took them over.
            let may_fly_on = |run: &Self| run.mode.pace.is_some() && !run.mode.has_reported_flights();
            let is_interrupted = |run: Self| may_fly_on(&run) && !run.is_complete();
            let fly_on = match Self::open_to_read(out).is_ok_and(is_interrupted) {
                true => ", fly on with skysink run --resume",
                false => "",
            };
            let message = format!("it exists: choose another --out{fly_on}, or pass --force to replace the run in it");
            return Err(refuse(out, message));
        }
        let content = LAYOUT.content(out).map_err(|error| refuse(out, error))?;
        if let Some(name) = content.own().find(|name| !is_plain_file(&out.join(name))) {
            return Err(refuse(&out.join(name), "expected a file of a run: --force replaces nothing else"));
        }
        if content.lock.is_none() || content.foreign.iter().any(|name| name == "sweep.json") {
            return Err(refuse(out, "it holds something else than a run: --force replaces nothing else"));
        }
        Ok(())
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// The scenario as flown.
    pub fn scenario(&self) -> PathBuf {
        self.path().join("scenario.toml")
    }

    /// The rerun recording; its first file, if the viewer was restarted.
    pub fn recording(&self) -> PathBuf {
        self.path().join("mission.rrd")
    }

    /// The path or glob pattern of all files of the recording; `None` without a recording.
    pub fn recording_pattern(&self) -> Option<PathBuf> {
        let mut names = LAYOUT.content(self.path()).unwrap_or_default().results;
        names.retain(|name| is_recording(name));
        match &names[..] {
            [] => None,
            [name] => Some(self.path().join(name)),
            _ => Some(self.path().join("*.rrd")),
        }
    }

    /// How the run is flown.
    pub fn run_mode(&self) -> &RunMode {
        &self.mode
    }

    /// Changes the roles of external processes, by name, in `run.toml`, too. Its build stays.
    ///
    /// # Errors
    /// If a file cannot be read or written.
    pub fn set_external(&mut self, external: &[String]) -> Result<(), MissionError> {
        if self.mode.external != external {
            self.write(origin::FILE, &origin::with_external(self.path(), external)?)?;
            external.clone_into(&mut self.mode.external);
        }
        Ok(())
    }

    /// Starts `slots.csv`.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn slot_log(&self) -> Result<SlotLog, MissionError> {
        let (mut log, _) = self.reopen_slot_log()?;
        log.resume()?;
        Ok(log)
    }

    /// Opens the folder of a run that has ended early.
    ///
    /// # Errors
    /// If `path` is not a run folder, its scenario or sensor list was changed, or the run is not over.
    pub fn reopen(path: &Path) -> Result<Self, MissionError> {
        require(path)?;
        let folder = LAYOUT.lock(path)?.ok_or_else(|| locked(path))?;
        Ok(Self { folder, mode: origin::read(path)?, in_a_ring: true })
    }

    /// Opens a run folder for reading, with a shared lock.
    ///
    /// # Errors
    /// If `path` is not a run folder, its scenario or sensor list was changed, or the run is not over.
    pub fn open_to_read(path: &Path) -> Result<Self, MissionError> {
        require(path)?;
        let folder = LAYOUT.lock_shared(path)?.ok_or_else(|| locked(path))?;
        Ok(Self { folder, mode: origin::read(path)?, in_a_ring: false })
    }

    /// The path of the trace.
    pub fn slots(&self) -> PathBuf {
        self.path().join(TRACE)
    }

    /// Opens `slots.csv` to read the recorded slots and to resume it.
    ///
    /// # Errors
    /// If it does not begin with the header of a trace.
    pub fn reopen_slot_log(&self) -> Result<(SlotLog, BufReader<File>), MissionError> {
        let file = self.folder.lock.try_clone().at(&self.slots())?;
        let text = fs::read_to_string(self.scenario()).at(&self.scenario())?;
        let of_each = |table: &Table| {
            let tables = dotted::value(table, "uav.each").and_then(Value::as_array);
            tables.into_iter().flatten().any(|own| own.get("battery").is_some())
        };
        let has = |table: &Table| dotted::value(table, "uav.battery").is_some() || of_each(table);
        let has_battery = text.parse().is_ok_and(|table| has(&table));
        SlotLog::open(&self.slots(), file, self.in_a_ring, SLOT_COLUMNS[usize::from(has_battery)])
    }

    /// Whether an unchanged `summary.json` says that all slots were flown.
    pub fn is_complete(&self) -> bool {
        self.summary().is_ok_and(|summary| summary.complete)
    }

    /// Removes what was made of the slots so far: the results of each SN, and the slots as Parquet.
    ///
    /// # Errors
    /// If a file cannot be removed.
    pub fn remove_derived(&self) -> Result<(), MissionError> {
        DERIVED.iter().try_for_each(|name| remove_if_present(&self.path().join(name)))
    }

    /// The summary of the run, as it was written.
    ///
    /// # Errors
    /// If the run has not ended, or the summary was changed or written by another version.
    pub fn summary(&self) -> Result<Summary, MissionError> {
        let path = self.path().join(SUMMARY);
        let refuse = |message: String| InputError::new("summary", &path, message);
        let text = read_regular(&path)
            .map_err(|error| refuse(format!("{error}: expected the folder of a run that has ended")))?;
        let summary = std::str::from_utf8(&text).ok().and_then(|text| text.rsplit_once(CHECK_KEY));
        if summary.is_none_or(|(summary, check)| check != check_value(summary)) {
            let remedy = "skysink run --resume RUN writes that of a complete run again, without times and events";
            return Err(refuse(format!("it was modified, or written by an earlier version ({remedy})")).into());
        }
        let summary = serde_json::from_slice(&text);
        Ok(summary.map_err(|error| refuse(format!("{error}: expected a summary.json of this version")))?)
    }

    /// Ends a run: compares its files with what was written, and writes `summary.json`; it says that the run is not
    /// complete if they differ.
    ///
    /// # Errors
    /// If a file was changed by another process, or one cannot be read or written.
    pub fn finish(&self, log: &SlotLog, summary: &mut Summary) -> Result<(), MissionError> {
        let compared = log.compare(Extent::Full);
        summary.complete &= compared.is_ok();
        compared.and(self.write_summary(summary))
    }

    /// Writes `summary.json`, with a check value of the lines before it.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write_summary(&self, summary: &Summary) -> Result<(), MissionError> {
        let text = serde_json::to_string_pretty(summary).expect("plain numbers and strings");
        let lines = text.strip_suffix("\n}").expect("an object with keys");
        self.write(SUMMARY, &[lines, CHECK_KEY, &check_value(lines)].concat())
    }

    /// Writes `value` to the JSON file `name`, whole or not at all.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write_json(&self, name: &str, value: &impl Serialize) -> Result<(), MissionError> {
        let text = serde_json::to_string_pretty(value).expect("plain numbers and strings") + "\n";
        self.write(name, &text)
    }

    fn write(&self, name: &str, text: &str) -> Result<(), MissionError> {
        write_whole(&self.path().join(name), text.as_bytes())
    }
}

/// Removes a file, if there is one.
fn remove_if_present(path: &Path) -> Result<(), MissionError> {
    match fs::remove_file(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        removed => removed.at(path),
    }
}

/// The end of a summary with these lines: their hash.
fn check_value(lines: &str) -> String {
    format!("\"{}\"\n}}\n", hash(lines.as_bytes()))
}

/// Refuses a path that is not a run folder, or in which a file of a run is something else than a file.
fn require(path: &Path) -> Result<(), MissionError> {
    let files = ["scenario.toml", TRACE, origin::FILE];
    if let Some(missing) = files.into_iter().find(|name| !path.join(name).is_file()) {
        let found = if fs::symlink_metadata(path.join(missing)).is_ok() { "is no file" } else { "is missing" };
        let message = format_args!("{missing} {found}: expected the folder of a run");
        return Err(InputError::new("run folder", path, message).into());
    }
    let content = LAYOUT.content(path).at(path)?;
    match content.own().find(|name| !is_plain_file(&path.join(name))) {
        Some(name) => Err(InputError::new("run folder", path, format_args!("{name} is no file")).into()),
        None => Ok(()),
    }
}

/// The refusal of a run folder that another process has locked.
fn locked(folder: &Path) -> MissionError {
    let message = "a run is writing it: end that run first, or choose another folder";
    InputError::new("trace", &folder.join(TRACE), message).into()
}

/// The refusal of an output folder.
fn refuse(out: &Path, message: impl std::fmt::Display) -> MissionError {
    InputError::new("output folder", out, message).into()
}

/// The error for a folder `out` that cannot be created: a refusal of its path, or a failure of the system.
fn cannot_make(out: &Path, error: io::Error) -> MissionError {
    use io::ErrorKind::{AlreadyExists, InvalidFilename, NotADirectory, NotFound};
    match error.kind() {
        AlreadyExists | InvalidFilename | NotADirectory | NotFound => refuse(out, error),
        _ => MissionError::File { path: out.to_owned(), source: error },
    }
}

/// Whether `path` is a regular file, not a link, or was removed since.
fn is_plain_file(path: &Path) -> bool {
    !fs::symlink_metadata(path).is_ok_and(|file| !file.is_file())
}

/// Whether a folder holds nothing but the lock of a run that has not begun.
fn is_empty(folder: &Path) -> bool {
    let is_lock = |file: DirEntry| file.file_name() == TRACE && file.metadata().is_ok_and(|file| file.len() == 0);
    fs::read_dir(folder).is_ok_and(|mut entries| entries.all(|entry| entry.is_ok_and(is_lock)))
}

/// Whether a file of this name is one of the recording: `mission.rrd`, `mission-2.rrd` ...
pub fn is_recording(name: &str) -> bool {
    let number = name.strip_prefix("mission").and_then(|rest| rest.strip_suffix(".rrd"));
    number.is_some_and(|number| {
        number.is_empty() || number.strip_prefix('-').is_some_and(|digits| digits.parse::<u32>().is_ok())
    })
}

/// Creates the first free folder of `runs/<name>-<strategy>-<seed>`, `...-2`, `...-3`.
fn make_default(scenario: &Scenario, mode: &RunMode) -> Result<PathBuf, MissionError> {
    let runs = Path::new("runs");
    fs::create_dir_all(runs).at(runs)?;
    let planner = mode.external_planner.as_ref().unwrap_or(&scenario.planner.strategy);
    let name = format!("{}-{planner}-{}", scenario.name, scenario.seed);
    let mut number = 1u64;
    loop {
        let path = runs.join(if number == 1 { name.clone() } else { format!("{name}-{number}") });
        match fs::create_dir(&path) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => number += 1,
            made => return made.map(|()| path.clone()).at(&path),
        }
    }
}
