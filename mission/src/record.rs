//! The run folder: the scenario and the sensor nodes as flown, a line per slot, and the summary.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, BufRead as _, BufReader, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};

use serde::Serialize;
use skysink_common::error::InputError;
use skysink_common::message::{FlightReport, QueuesHeader};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;

use crate::error::{FileContext, MissionError};
use crate::trace::{SLOT_COLUMNS, TraceHash};

/// The files of a run, but for its recordings.
const FILES: [&str; 5] = ["scenario.toml", "sensors.csv", "slots.csv", "summary.json", "optimum.json"];

/// A run's folder, with what is flown.
#[derive(Debug, Clone)]
pub struct RunFolder {
    path: PathBuf,
}

impl RunFolder {
    /// Makes the folder `out`, or `runs/<name>-<strategy>-<seed>` with the first free suffix, and writes the scenario
    /// and the sensor nodes into it.
    ///
    /// # Errors
    /// If `out` exists and `force` does not allow to replace the run in it, or something cannot be written.
    pub fn create(
        out: Option<&Path>,
        force: bool,
        scenario: &Scenario,
        list: &SensorList,
    ) -> Result<Self, MissionError> {
        let path = match out {
            Some(out) => make(out, force)?,
            None => make_default(scenario)?,
        };
        let folder = Self { path };
        folder.write("scenario.toml", &scenario.to_toml_with_list("sensors.csv"))?;
        folder.write("sensors.csv", &list.to_csv())?;
        Ok(folder)
    }

    /// Whether a run may be put into `out`: before something takes long, and without making it.
    ///
    /// # Errors
    /// If `out` exists and `force` does not allow to replace the run in it.
    pub fn check(out: Option<&Path>, force: bool) -> Result<(), MissionError> {
        match out {
            Some(out) if !force && out.exists() => Err(exists(out)),
            _ => Ok(()),
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
    /// If it is none.
    pub fn reopen(path: &Path) -> Result<Self, MissionError> {
        let path = path.to_owned();
        match ["scenario.toml", "slots.csv"].into_iter().find(|name| !path.join(name).is_file()) {
            Some(missing) => {
                let message = format_args!("{missing} is missing: expected the folder of a run that has ended early");
                Err(InputError::new("run folder", &path, message).into())
            }
            None => Ok(Self { path }),
        }
    }

    /// The trace.
    #[must_use]
    pub fn slots(&self) -> PathBuf {
        self.path.join("slots.csv")
    }

    /// Opens `slots.csv` to read what is on record and to resume it.
    ///
    /// # Errors
    /// If another run is writing it, or it does not begin as a trace.
    pub fn reopen_slot_log(&self) -> Result<(SlotLog, BufReader<File>), MissionError> {
        let path = self.slots();
        let file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path).at(&path)?;
        lock(&file, &path)?;
        let mut reader = BufReader::new(file.try_clone().at(&path)?);
        let mut header = Vec::new();
        reader.read_until(b'\n', &mut header).at(&path)?;
        if !SLOT_COLUMNS.as_bytes().starts_with(&header) {
            let found = String::from_utf8_lossy(&header);
            let message = format_args!("line 1: header {:?}: expected {}", found.trim_end(), SLOT_COLUMNS.trim_end());
            return Err(InputError::new("trace", &path, message).into());
        }
        // Where the header is cut, nothing is on record.
        let length = if header.len() == SLOT_COLUMNS.len() { header.len() as u64 } else { 0 };
        Ok((SlotLog { length, path, file, trace: TraceHash::default() }, reader))
    }

    /// Whether `summary.json` says that all slots were flown.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        let text = fs::read(self.path.join("summary.json")).unwrap_or_default();
        serde_json::from_slice(&text).is_ok_and(|summary: serde_json::Value| summary["complete"] == true)
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
    let name = path.file_name().map_or_else(Default::default, |name| name.to_string_lossy());
    let new = path.with_file_name(format!(".{name}.new"));
    let written = fs::write(&new, bytes).and_then(|()| fs::rename(&new, path));
    if written.is_err() {
        let _ = fs::remove_file(&new); // half-written at best
    }
    written.at(path)
}

/// `slots.csv` under way. Each line reaches the system when its slot is recorded, so that nothing recorded is lost.
#[derive(Debug)]
pub struct SlotLog {
    path: PathBuf,
    file: File,
    /// Bytes of whole lines.
    length: u64,
    trace: TraceHash,
}

impl SlotLog {
    /// Adds the slot, and returns the hash of all lines so far.
    ///
    /// # Errors
    /// If a bit of the ledger is unaccounted for, or the line cannot be written; then it is as if it had not been
    /// tried.
    pub fn add(&mut self, flight: &FlightReport, header: &QueuesHeader) -> Result<u64, MissionError> {
        let line = self.trace.write(flight, header)?;
        let written = self.file.write_all(line.as_bytes());
        if written.is_err() {
            let cut = self.file.set_len(self.length).and_then(|()| self.file.seek(SeekFrom::Start(self.length)));
            let _ = cut; // of a part of a line at best, which a resumed run cuts, too
        }
        written.at(&self.path)?;
        self.length += line.len() as u64;
        self.trace.add();
        Ok(self.trace.value())
    }

    /// Goes over a line that is on record already. Says whether it is that of the slot.
    ///
    /// # Errors
    /// If a bit of the ledger is unaccounted for.
    pub fn repeat(&mut self, line: &[u8], flight: &FlightReport, header: &QueuesHeader) -> Result<bool, MissionError> {
        let is_same = self.trace.write(flight, header)?.as_bytes() == line;
        self.length += line.len() as u64;
        self.trace.add();
        Ok(is_same)
    }

    /// Cuts the trace behind the last line that was gone over, to resume it there.
    ///
    /// # Errors
    /// If the file cannot be changed.
    pub fn resume(&mut self) -> Result<(), MissionError> {
        let mut cut = || {
            self.file.set_len(self.length)?;
            self.file.seek(SeekFrom::End(0))?;
            if self.length == 0 {
                self.file.write_all(SLOT_COLUMNS.as_bytes())?;
                self.length = SLOT_COLUMNS.len() as u64;
            }
            Ok(())
        };
        cut().at(&self.path)
    }

    /// Hash of all lines so far, chained.
    #[must_use]
    pub fn hash(&self) -> u64 {
        self.trace.value()
    }
}

/// Keeps a second run from writing the same trace.
fn lock(file: &File, path: &Path) -> Result<(), MissionError> {
    match file.try_lock() {
        Ok(()) => Ok(()),
        Err(TryLockError::WouldBlock) => {
            let message = "a run is writing it: end that run first, or choose another folder";
            Err(InputError::new("trace", path, message).into())
        }
        Err(TryLockError::Error(error)) => Err(error).at(path),
    }
}

/// The refusal of an output folder.
fn exists(out: &Path) -> MissionError {
    let message = "it exists: choose another --out, or pass --force to replace the run in it";
    InputError::new("output folder", out, message).into()
}

/// Makes the folder that the user named.
fn make(out: &Path, force: bool) -> Result<PathBuf, MissionError> {
    let parent = out.parent().unwrap_or(Path::new(""));
    if !parent.as_os_str().is_empty() {
        fs::create_dir_all(parent).at(parent)?;
    }
    match fs::create_dir(out) {
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists && !force => {
            return Err(exists(out));
        }
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => replace(out)?,
        made => made.at(out)?,
    }
    Ok(out.to_owned())
}

/// Removes the run in `out`, and nothing else that may be there.
fn replace(out: &Path) -> Result<(), MissionError> {
    let trace = out.join("slots.csv");
    if let Ok(file) = File::open(&trace) {
        lock(&file, &trace)?;
    }
    let names = file_names(out).at(out)?;
    for name in names.iter().filter(|name| FILES.contains(&name.as_str()) || is_recording(name)) {
        let path = out.join(name);
        fs::remove_file(&path).at(&path)?;
    }
    Ok(())
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
fn make_default(scenario: &Scenario) -> Result<PathBuf, MissionError> {
    let runs = Path::new("runs");
    fs::create_dir_all(runs).at(runs)?;
    let name = format!("{}-{}-{}", scenario.name, scenario.planner.strategy, scenario.seed);
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
    use skysink_common::message::Mode;

    use super::*;

    #[test]
    fn a_line_that_cannot_be_written_is_not_in_the_hash() {
        let path = PathBuf::from("/dev/full");
        let file = File::options().write(true).open(&path).unwrap();
        let mut log = SlotLog { path, file, length: 0, trace: TraceHash::default() };
        let flight = FlightReport::at([1.0, 2.0, 20.0], Mode::Hold);
        let error = log.add(&flight, &QueuesHeader::default()).unwrap_err();
        assert!(error.to_string().contains("/dev/full"), "{error}");
        assert_eq!((log.hash(), log.length), (0, 0));
    }
}
