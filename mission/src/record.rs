//! The run folder: the scenario and the sensor nodes as flown, a line per slot, and the summary.
//!
//! Whoever has `slots.csv` locked has the folder: the lock comes before any change of it.

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
use crate::origin::{self, Manner};
use crate::slot_log::{CHECK, SlotLog};
use crate::summary::Summary;

/// What every sensor node lost, delivered and waited for.
pub(crate) const SENSOR_RESULTS: &str = "sensors_out.csv";

/// The trace, by which a folder is known to hold a run.
const TRACE: &str = "slots.csv";

/// The other files of a run, but for its recordings.
const FILES: [&str; 7] =
    [origin::FILE, "scenario.toml", "sensors.csv", CHECK, "summary.json", "optimum.json", SENSOR_RESULTS];

/// End of the names of files under way.
pub const UNFINISHED: &str = ".new";

/// Letters of a file's name that are in the name of what becomes it; file systems end at 255 bytes.
const MOST_LETTERS: usize = 40;

/// A run's folder, which this process has to itself.
#[derive(Debug)]
pub struct RunFolder {
    path: PathBuf,
    manner: Manner,
    /// `slots.csv`, locked.
    trace: File,
    /// Whether slots are flown in a ring, where plans may be known to the trace alone: then each is checked.
    in_a_ring: bool,
}

impl RunFolder {
    /// Makes the folder `out`, or `runs/<name>-<strategy>-<seed>` with the first free suffix, and writes how the run is
    /// begun, the scenario and the sensor nodes into it. `force` allows to replace a run in `out`, whole.
    ///
    /// # Errors
    /// If `out` is not empty and not to be replaced, holds anything but a run, or has one under way; or something
    /// cannot be written.
    pub fn create(
        out: Option<&Path>,
        force: bool,
        scenario: &Scenario,
        list: &SensorList,
        manner: &Manner,
    ) -> Result<Self, MissionError> {
        let path = match out {
            Some(out) => {
                Self::check(Some(out), force)?;
                out.parent().map_or(Ok(()), fs::create_dir_all).map_err(|error| cannot_make(out, error))?;
                match fs::create_dir(out) {
                    Err(error) if error.kind() == io::ErrorKind::AlreadyExists && (force || is_empty(out)) => {}
                    made => made.map_err(|error| cannot_make(out, error))?, // or another process was quicker
                }
                out.to_owned()
            }
            None => make_default(scenario, manner)?,
        };
        let in_a_ring = manner.pace.is_some();
        let folder = Self { trace: lock(&path, true)?, manner: manner.clone(), path, in_a_ring };
        for name in file_names(&folder.path).at(&folder.path)? {
            if name != TRACE && is_of_run(&name) {
                let file = folder.path.join(name);
                fs::remove_file(&file).at(&file)?;
            }
        }
        folder.trace.set_len(0).at(&folder.slots())?;
        let [scenario, sensors] = [scenario.to_toml_with_list("sensors.csv"), list.to_csv()];
        folder.write("scenario.toml", &scenario)?;
        folder.write("sensors.csv", &sensors)?;
        folder.write(origin::FILE, &origin::write(manner, &scenario, &sensors))?;
        Ok(folder)
    }

    /// Whether a run may be put into `out`: before something takes long, and without making it.
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

    /// The recording for rerun; its first file, if the viewer was started again.
    #[must_use]
    pub fn recording(&self) -> PathBuf {
        self.path.join("mission.rrd")
    }

    /// How to name all files of the recording to rerun; none if there is no recording.
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
    pub fn manner(&self) -> &Manner {
        &self.manner
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
    /// If it is none, its scenario or sensor list was changed since, or the run is still under way.
    pub fn reopen(path: &Path) -> Result<Self, MissionError> {
        require(path)?;
        let trace = lock(path, false)?;
        Ok(Self { manner: origin::read(path)?, path: path.to_owned(), trace, in_a_ring: true })
    }

    /// Opens the folder of a run to read it: others may read it, too, but nobody may write it meanwhile.
    ///
    /// # Errors
    /// If it is none, its scenario or sensor list was changed since, or the run is still under way.
    pub fn open_to_read(path: &Path) -> Result<Self, MissionError> {
        require(path)?;
        let slots = path.join(TRACE);
        let trace = File::open(&slots).at(&slots)?;
        held(trace.try_lock_shared(), &slots)?;
        Ok(Self { manner: origin::read(path)?, path: path.to_owned(), trace, in_a_ring: false })
    }

    /// The trace.
    #[must_use]
    pub fn slots(&self) -> PathBuf {
        self.path.join(TRACE)
    }

    /// Opens `slots.csv` to read what is on record and to resume it.
    ///
    /// # Errors
    /// If it does not begin as a trace.
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

    /// Removes what the run came to for each SN, if that was written.
    ///
    /// # Errors
    /// If it cannot be removed.
    pub fn remove_sensor_results(&self) -> Result<(), MissionError> {
        let path = self.path.join(SENSOR_RESULTS);
        match fs::remove_file(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
            removed => removed.at(&path),
        }
    }

    /// The figures of the run, as it ended.
    ///
    /// # Errors
    /// If it has not ended, or they were written by another version.
    pub fn summary(&self) -> Result<Summary, MissionError> {
        let path = self.path.join("summary.json");
        let refuse = |message: String| InputError::new("summary", &path, message);
        let text =
            fs::read(&path).map_err(|error| refuse(format!("{error}: expected the folder of a run that has ended")))?;
        let summary = serde_json::from_slice(&text);
        Ok(summary.map_err(|error| refuse(format!("{error}: expected what this version writes")))?)
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

/// Writes what will be the file `path` into a new file beside it, `.NAME.*.new`, that nobody else has or can have put
/// there. It becomes `path` by [`NamedTempFile::persist`]; dropped, it is removed.
///
/// # Errors
/// If it cannot be written.
pub fn write_unfinished(path: &Path, bytes: &[u8]) -> io::Result<NamedTempFile> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let prefix = format!(".{}.", name.chars().take(MOST_LETTERS).collect::<String>());
    let begin = |path: &Path| File::options().write(true).create_new(true).open(path); // with the usual permissions
    let mut file = tempfile::Builder::new().prefix(&prefix).suffix(UNFINISHED).make_in(folder, begin)?;
    file.write_all(bytes)?;
    Ok(file)
}

/// Whether something of this name is what a process that was killed has begun to write.
#[must_use]
pub fn is_unfinished(name: &OsStr) -> bool {
    let name = name.as_encoded_bytes();
    name.starts_with(b".") && name.ends_with(UNFINISHED.as_bytes())
}

/// Refuses what is no folder of a run, or has something else under the name of a file of a run.
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

/// Says that a run has the trace `path`, if one has.
fn held(locked: Result<(), TryLockError>, path: &Path) -> Result<(), MissionError> {
    match locked {
        Ok(()) => Ok(()),
        Err(TryLockError::WouldBlock) => {
            let message = "a run is writing it: end that run first, or choose another folder";
            Err(InputError::new("trace", path, message).into())
        }
        Err(TryLockError::Error(error)) => Err(error).at(path),
    }
}

/// Opens the trace in `folder`, or makes it if `create` allows, and keeps a second run from the folder.
fn lock(folder: &Path, create: bool) -> Result<File, MissionError> {
    let path = folder.join(TRACE);
    let mut open = OpenOptions::new();
    open.read(true)
        .write(true)
        .create(create)
        .truncate(false)
        .custom_flags(rustix::fs::OFlags::NOFOLLOW.bits().cast_signed());
    let file = open.open(&path).at(&path)?;
    held(file.try_lock(), &path)?;
    Ok(file)
}

/// The refusal of an output folder.
fn refuse(out: &Path, message: impl std::fmt::Display) -> MissionError {
    InputError::new("output folder", out, message).into()
}

/// Why the folder `out` cannot be made: because of its name, or of what it lies on.
fn cannot_make(out: &Path, error: io::Error) -> MissionError {
    use io::ErrorKind::{AlreadyExists, InvalidFilename, NotADirectory, NotFound};
    match error.kind() {
        AlreadyExists | InvalidFilename | NotADirectory | NotFound => refuse(out, error),
        _ => MissionError::File { path: out.to_owned(), source: error },
    }
}

/// Whether it is a file, and no link to one.
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

/// Makes the first free of `runs/<name>-<strategy>-<seed>`, `...-2`, `...-3`.
fn make_default(scenario: &Scenario, manner: &Manner) -> Result<PathBuf, MissionError> {
    let runs = Path::new("runs");
    fs::create_dir_all(runs).at(runs)?;
    let planner = manner.outside_planner.as_ref().unwrap_or(&scenario.planner.strategy);
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
    fn a_link_that_somebody_has_planted_is_not_followed() {
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
    fn what_cannot_be_written_leaves_nothing_and_what_is_written_others_may_read() {
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
    fn what_a_killed_process_has_begun_is_known_by_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let begun = write_unfinished(&folder.path().join("sweep.json"), b"{").unwrap();
        assert!(is_unfinished(begun.path().file_name().unwrap()));
        assert!(!is_unfinished(OsStr::new("sweep.json")) && !is_unfinished(OsStr::new("a.new")));
    }
}
