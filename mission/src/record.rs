//! The run folder: the scenario and the sensor nodes as flown, a line per slot, and the summary.
//!
//! A process locks `slots.csv` before it changes anything in the folder.

use std::ffi::OsStr;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, BufReader, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};

use serde::Serialize;
use skysink_common::error::InputError;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use tempfile::NamedTempFile;

use crate::error::{FileContext, MissionError};
use crate::origin::{self, RunMode};
use crate::slot_log::{CHECK, SlotLog};
use crate::summary::Summary;

/// The results of each sensor node.
pub(crate) const SENSOR_RESULTS: &str = "sensors_out.csv";

/// The trace, which identifies a run folder.
const TRACE: &str = "slots.csv";

/// The other files of a run, except its recordings.
const FILES: [&str; 7] =
    [origin::FILE, "scenario.toml", "sensors.csv", CHECK, "summary.json", "optimum.json", SENSOR_RESULTS];

/// Suffix of unfinished files.
pub const UNFINISHED: &str = ".new";

/// Characters of a file's name that are used for its unfinished file, whose name may have at most 255 bytes.
const NAME_CHARACTERS: usize = 40;

/// A run folder, locked by this process.
#[derive(Debug)]
pub struct RunFolder {
    path: PathBuf,
    mode: RunMode,
    /// `slots.csv`, locked.
    trace: File,
    /// Whether the slots are flown in a ring. The plans may then not be reproducible, so each slot is checked.
    in_a_ring: bool,
}

impl RunFolder {
    /// Creates the folder `out`, or `runs/<name>-<strategy>-<seed>` with the first free suffix, and writes `run.toml`,
    /// the scenario and the sensor list. With `force`, a run in `out` is replaced.
    ///
    /// # Errors
    /// If `out` is not empty and not to be replaced, holds anything but a run, or holds a running one; or if a file
    /// cannot be written.
    pub fn create(
        out: Option<&Path>,
        force: bool,
        scenario: &Scenario,
        list: &SensorList,
        mode: &RunMode,
    ) -> Result<Self, MissionError> {
        let path = match out {
            Some(out) => {
                Self::check(Some(out), force)?;
                out.parent().map_or(Ok(()), fs::create_dir_all).map_err(|error| cannot_make(out, error))?;
                match fs::create_dir(out) {
                    Err(error) if error.kind() == io::ErrorKind::AlreadyExists && (force || is_empty(out)) => {}
                    made => made.map_err(|error| cannot_make(out, error))?, // another process may have created it
                }
                out.to_owned()
            }
            None => make_default(scenario, mode)?,
        };
        let in_a_ring = mode.pace.is_some();
        let folder = Self { trace: lock(&path, true)?, mode: mode.clone(), path, in_a_ring };
        for name in file_names(&folder.path).at(&folder.path)? {
            if name != TRACE && is_of_run(&name) {
                let file = folder.path.join(name);
                fs::remove_file(&file).at(&file)?;
            }
        }
        folder.trace.set_len(0).at(&folder.slots())?;
        let scenario = scenario.to_toml_with_list("sensors.csv");
        let sensors = list.to_csv();
        folder.write("scenario.toml", &scenario)?;
        folder.write("sensors.csv", &sensors)?;
        folder.write(origin::FILE, &origin::write(mode, &scenario, &sensors))?;
        Ok(folder)
    }

    /// Checks whether a run may be written to `out`, without creating it, such as before a long computation.
    ///
    /// # Errors
    /// If `out` exists and is not to be replaced, or holds anything but a run.
    pub fn check(out: Option<&Path>, force: bool) -> Result<(), MissionError> {
        let Some(out) = out.filter(|out| fs::symlink_metadata(out).is_ok()) else { return Ok(()) };
        if !out.is_dir() {
            return Err(refuse(out, "it is no folder: choose another --out"));
        }
        if is_empty(out) {
            return Ok(());
        }
        if !force {
            return Err(refuse(out, "it exists: choose another --out, or pass --force to replace the run in it"));
        }
        let names = file_names(out).map_err(|error| refuse(out, error))?;
        let is_run = names.iter().any(|name| name == TRACE) && !names.iter().any(|name| name == "sweep.json");
        match names.into_iter().find(|name| is_of_run(name) && !is_plain_file(&out.join(name))) {
            Some(name) => Err(refuse(&out.join(name), "expected a file of a run: --force replaces nothing else")),
            None if is_run => Ok(()),
            None => Err(refuse(out, "it holds something else than a run: --force replaces nothing else")),
        }
    }

    /// The folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The scenario as flown.
    #[must_use]
    pub fn scenario(&self) -> PathBuf {
        self.path.join("scenario.toml")
    }

    /// The rerun recording; its first file, if the viewer was restarted.
    #[must_use]
    pub fn recording(&self) -> PathBuf {
        self.path.join("mission.rrd")
    }

    /// The path or glob pattern of all files of the recording; `None` without a recording.
    #[must_use]
    pub fn recording_pattern(&self) -> Option<PathBuf> {
        let mut names = file_names(&self.path).unwrap_or_default();
        names.retain(|name| is_recording(name));
        match &names[..] {
            [] => None,
            [name] => Some(self.path.join(name)),
            _ => Some(self.path.join("*.rrd")),
        }
    }

    /// How the run is flown.
    #[must_use]
    pub fn run_mode(&self) -> &RunMode {
        &self.mode
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
        let trace = lock(path, false)?;
        Ok(Self { mode: origin::read(path)?, path: path.to_owned(), trace, in_a_ring: true })
    }

    /// Opens a run folder for reading, with a shared lock.
    ///
    /// # Errors
    /// If `path` is not a run folder, its scenario or sensor list was changed, or the run is not over.
    pub fn open_to_read(path: &Path) -> Result<Self, MissionError> {
        require(path)?;
        let slots = path.join(TRACE);
        let trace = File::open(&slots).at(&slots)?;
        check_lock(trace.try_lock_shared(), &slots)?;
        Ok(Self { mode: origin::read(path)?, path: path.to_owned(), trace, in_a_ring: false })
    }

    /// The path of the trace.
    #[must_use]
    pub fn slots(&self) -> PathBuf {
        self.path.join(TRACE)
    }

    /// Opens `slots.csv` to read the recorded slots and to resume it.
    ///
    /// # Errors
    /// If it does not begin with the header of a trace.
    pub fn reopen_slot_log(&self) -> Result<(SlotLog, BufReader<File>), MissionError> {
        let file = self.trace.try_clone().at(&self.slots())?;
        SlotLog::open(&self.path, self.slots(), file, self.in_a_ring)
    }

    /// Whether `summary.json` says that all slots were flown.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        let text = fs::read(self.path.join("summary.json")).unwrap_or_default();
        serde_json::from_slice(&text).is_ok_and(|summary: serde_json::Value| summary["complete"] == true)
    }

    /// Removes the results of each SN, if present.
    ///
    /// # Errors
    /// If the file cannot be removed.
    pub fn remove_sensor_results(&self) -> Result<(), MissionError> {
        let path = self.path.join(SENSOR_RESULTS);
        match fs::remove_file(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
            removed => removed.at(&path),
        }
    }

    /// The summary of the run.
    ///
    /// # Errors
    /// If the run has not ended, or the summary was written by another version.
    pub fn summary(&self) -> Result<Summary, MissionError> {
        let path = self.path.join("summary.json");
        let refuse = |message: String| InputError::new("summary", &path, message);
        let text =
            fs::read(&path).map_err(|error| refuse(format!("{error}: expected the folder of a run that has ended")))?;
        let summary = serde_json::from_slice(&text);
        Ok(summary.map_err(|error| refuse(format!("{error}: expected a summary.json of this version")))?)
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
        write_whole(&self.path.join(name), text.as_bytes())
    }
}

/// Writes a file, whole or not at all.
///
/// # Errors
/// If it cannot be written.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), MissionError> {
    write_unfinished(path, bytes).and_then(|file| file.persist(path).map_err(io::Error::from)).map(drop).at(path)
}

/// Writes the content of `path` to a new temporary file beside it, `.NAME.*.new`. [`NamedTempFile::persist`] renames it
/// to `path`; dropping removes it.
///
/// # Errors
/// If it cannot be written.
pub fn write_unfinished(path: &Path, bytes: &[u8]) -> io::Result<NamedTempFile> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let prefix = format!(".{}.", name.chars().take(NAME_CHARACTERS).collect::<String>());
    let create = |path: &Path| File::options().write(true).create_new(true).open(path); // with the usual permissions
    let mut file = tempfile::Builder::new().prefix(&prefix).suffix(UNFINISHED).make_in(folder, create)?;
    file.write_all(bytes)?;
    Ok(file)
}

/// Whether this is the name of an unfinished file, such as a killed process leaves.
#[must_use]
pub fn is_unfinished(name: &OsStr) -> bool {
    let name = name.as_encoded_bytes();
    name.starts_with(b".") && name.ends_with(UNFINISHED.as_bytes())
}

/// Refuses a path that is not a run folder, or in which a file of a run is something else than a file.
fn require(path: &Path) -> Result<(), MissionError> {
    let files = ["scenario.toml", TRACE, origin::FILE];
    if let Some(missing) = files.into_iter().find(|name| !path.join(name).is_file()) {
        let found = if fs::symlink_metadata(path.join(missing)).is_ok() { "is no file" } else { "is missing" };
        let message = format_args!("{missing} {found}: expected the folder of a run");
        return Err(InputError::new("run folder", path, message).into());
    }
    let names = file_names(path).at(path)?;
    match names.iter().find(|name| is_of_run(name) && !is_plain_file(&path.join(name))) {
        Some(name) => Err(InputError::new("run folder", path, format_args!("{name} is no file")).into()),
        None => Ok(()),
    }
}

/// The result of locking the trace `path`; an error if a run has locked it.
fn check_lock(locked: Result<(), TryLockError>, path: &Path) -> Result<(), MissionError> {
    match locked {
        Ok(()) => Ok(()),
        Err(TryLockError::WouldBlock) => {
            let message = "a run is writing it: end that run first, or choose another folder";
            Err(InputError::new("trace", path, message).into())
        }
        Err(TryLockError::Error(error)) => Err(error).at(path),
    }
}

/// Opens and locks the trace in `folder`; creates it if `create`.
fn lock(folder: &Path, create: bool) -> Result<File, MissionError> {
    let path = folder.join(TRACE);
    let mut open = OpenOptions::new();
    open.read(true)
        .write(true)
        .create(create)
        .truncate(false)
        .custom_flags(rustix::fs::OFlags::NOFOLLOW.bits().cast_signed());
    let file = open.open(&path).at(&path)?;
    check_lock(file.try_lock(), &path)?;
    Ok(file)
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

/// Whether `path` is a regular file, not a link.
fn is_plain_file(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok_and(|file| file.is_file())
}

fn is_empty(folder: &Path) -> bool {
    fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_none())
}

/// Whether a run has a file of this name.
fn is_of_run(name: &str) -> bool {
    name == TRACE || FILES.contains(&name) || is_recording(name)
}

/// The names of the files in a folder.
fn file_names(folder: &Path) -> io::Result<Vec<String>> {
    fs::read_dir(folder)?.map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned())).collect()
}

/// Whether a file of this name is one of the recording: `mission.rrd`, `mission-2.rrd` ...
fn is_recording(name: &str) -> bool {
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

#[cfg(test)]
mod tests {
    use std::os::unix::fs::{PermissionsExt as _, symlink};

    use super::*;

    #[test]
    fn a_planted_link_is_not_followed() {
        let folder = tempfile::tempdir().unwrap();
        let [path, victim] = ["summary.json", "victim"].map(|name| folder.path().join(name));
        fs::write(&victim, "mine").unwrap();
        symlink(&victim, folder.path().join(".summary.json.new")).unwrap();
        write_whole(&path, b"new").unwrap();
        assert_eq!([&victim, &path].map(|path| fs::read_to_string(path).unwrap()), ["mine", "new"]);
        assert!(is_plain_file(&path));
        assert_eq!(file_names(folder.path()).unwrap().len(), 3);
    }

    #[test]
    fn a_trace_that_became_a_link_is_not_opened() {
        let folder = tempfile::tempdir().unwrap();
        let victim = folder.path().join("victim");
        fs::write(&victim, "mine").unwrap();
        symlink(&victim, folder.path().join(TRACE)).unwrap();
        assert!([false, true].iter().all(|&create| lock(folder.path(), create).is_err()));
    }

    #[test]
    fn a_failed_write_leaves_no_file_and_a_written_file_has_the_usual_permissions() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("taken")).unwrap();
        assert!(write_whole(&folder.path().join("taken"), b"new").is_err());
        assert_eq!(file_names(folder.path()).unwrap(), ["taken"]);
        let long = folder.path().join("ä".repeat(100));
        write_whole(&long, b"new").unwrap();
        let plain = folder.path().join("plain");
        fs::write(&plain, "").unwrap();
        let [ours, usual] = [long, plain].map(|path| fs::metadata(path).unwrap().permissions().mode());
        assert_eq!(ours, usual);
    }

    #[test]
    fn an_unfinished_file_is_recognised_by_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let begun = write_unfinished(&folder.path().join("sweep.json"), b"{").unwrap();
        assert!(is_unfinished(begun.path().file_name().unwrap()));
        assert!(!is_unfinished(OsStr::new("sweep.json")) && !is_unfinished(OsStr::new("a.new")));
    }
}
