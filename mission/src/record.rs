//! The run folder: the scenario and the sensor nodes as flown, a line per slot, and the summary.
//!
//! Whoever has `slots.csv` locked has the folder: the lock comes before any change of it.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, BufRead as _, BufReader, Seek as _, SeekFrom, Write as _};
use std::os::unix::fs::{FileExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};

use serde::Serialize;
use skysink_common::error::InputError;
use skysink_common::message::{FlightReport, QueuesHeader};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;

use crate::error::{FileContext, MissionError};
use crate::origin::{self, Manner};
use crate::trace::{SLOT_COLUMNS, TraceHash};

/// The trace, by which a folder is known to hold a run.
const TRACE: &str = "slots.csv";

/// What [`Check`] writes.
const CHECK: &str = "slots.check";

/// The other files of a run, but for its recordings.
const FILES: [&str; 6] = [origin::FILE, "scenario.toml", "sensors.csv", CHECK, "summary.json", "optimum.json"];

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
        let files = ["scenario.toml", TRACE, origin::FILE];
        if let Some(missing) = files.into_iter().find(|name| !path.join(name).is_file()) {
            let found = if fs::symlink_metadata(path.join(missing)).is_ok() { "is no file" } else { "is missing" };
            let message = format_args!("{missing} {found}: expected the folder of a run that has ended early");
            return Err(InputError::new("run folder", path, message).into());
        }
        let names = file_names(path).at(path)?;
        if let Some(name) = names.iter().find(|name| is_of_run(name) && !is_plain_file(&path.join(name))) {
            return Err(InputError::new("run folder", path, format_args!("{name} is no file")).into());
        }
        let trace = lock(path, false)?;
        Ok(Self { manner: origin::read(path)?, path: path.to_owned(), trace, in_a_ring: true })
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
        let path = self.slots();
        let file = self.trace.try_clone().at(&path)?;
        let mut reader = BufReader::new(self.trace.try_clone().at(&path)?);
        reader.rewind().at(&path)?;
        let mut header = Vec::new();
        reader.read_until(b'\n', &mut header).at(&path)?;
        if !SLOT_COLUMNS.as_bytes().starts_with(&header) {
            let found = String::from_utf8_lossy(&header);
            let expected = SLOT_COLUMNS.trim_end();
            return Err(InputError::line("trace", &path, 1, &found, format_args!("expected {expected}")).into());
        }
        // Where the header is cut, nothing is on record.
        let length = if header.len() == SLOT_COLUMNS.len() { header.len() as u64 } else { 0 };
        let check = self.in_a_ring.then(|| Check::open(&self.path)).transpose()?;
        Ok((SlotLog { length, path, file, trace: TraceHash::default(), check }, reader))
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
    /// Where slots are flown in a ring, see [`RunFolder`].
    check: Option<Check>,
}

/// The last slot on record and the hash of all lines up to it, in a file beside the trace: 16 bytes, written in each
/// slot after its line.
#[derive(Debug)]
struct Check {
    path: PathBuf,
    /// None before the first slot.
    file: Option<File>,
    /// Slot and hash that were written before this process.
    before: Option<(u64, u64)>,
    /// The last slot that was gone over.
    repeated: u64,
}

impl Check {
    fn open(folder: &Path) -> Result<Self, MissionError> {
        let path = folder.join(CHECK);
        let file = match OpenOptions::new().read(true).write(true).open(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            file => Some(file.at(&path)?),
        };
        let mut bytes = [0; 16];
        let is_whole = file.as_ref().is_some_and(|file| file.read_exact_at(&mut bytes, 0).is_ok());
        let number = u128::from_le_bytes(bytes);
        let before = is_whole.then_some(((number & u128::from(u64::MAX)) as u64, (number >> 64) as u64));
        Ok(Self { path, file, before, repeated: 0 })
    }

    fn write(&mut self, slot: u64, hash: u64) -> Result<(), MissionError> {
        let file = match &self.file {
            Some(file) => file,
            None => self.file.insert(File::create(&self.path).at(&self.path)?),
        };
        let number = u128::from(slot) | u128::from(hash) << 64;
        file.write_all_at(&number.to_le_bytes(), 0).at(&self.path)
    }
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
        self.check.as_mut().map_or(Ok(()), |check| check.write(header.head.slot, self.trace.value()))?;
        Ok(self.trace.value())
    }

    /// Goes over a line that is on record already. Says whether it is that of the slot, and all lines so far those that
    /// were written.
    ///
    /// # Errors
    /// If a bit of the ledger is unaccounted for.
    pub fn repeat(&mut self, line: &[u8], flight: &FlightReport, header: &QueuesHeader) -> Result<bool, MissionError> {
        let is_same = self.trace.write(flight, header)?.as_bytes() == line;
        self.length += line.len() as u64;
        self.trace.add();
        let Some(check) = &mut self.check else { return Ok(is_same) };
        check.repeated = header.head.slot;
        let before = check.before.filter(|(slot, _)| *slot == header.head.slot);
        Ok(is_same && before.is_none_or(|(_, hash)| hash == self.trace.value()))
    }

    /// Whether slots of the trace were flown in a ring.
    #[must_use]
    pub fn was_in_a_ring(&self) -> bool {
        self.check.as_ref().is_some_and(|check| check.before.is_some())
    }

    /// The last slot that was on record before this process, as far as was checked.
    #[must_use]
    pub fn last_checked(&self) -> Option<u64> {
        self.check.as_ref().and_then(|check| check.before).map(|(slot, _)| slot)
    }

    /// Whether the lines that were gone over are those that were written: but for the last, which may have come after
    /// the check.
    #[must_use]
    pub fn was_checked(&self) -> bool {
        let check = self.check.as_ref();
        check.is_some_and(|check| check.before.is_some_and(|(slot, _)| slot + 1 >= check.repeated))
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
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => {
            let message = "a run is writing it: end that run first, or choose another folder";
            Err(InputError::new("trace", &path, message).into())
        }
        Err(TryLockError::Error(error)) => Err(error).at(&path),
    }
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
    use skysink_common::message::Mode;

    use super::*;

    #[test]
    fn a_line_that_cannot_be_written_is_not_in_the_hash() {
        let path = PathBuf::from("/dev/full");
        let file = File::options().write(true).open(&path).unwrap();
        let mut log = SlotLog { path, file, length: 0, trace: TraceHash::default(), check: None };
        let flight = FlightReport::at([1.0, 2.0, 20.0], Mode::Hold);
        let error = log.add(&flight, &QueuesHeader::default()).unwrap_err();
        assert!(error.to_string().contains("/dev/full"), "{error}");
        assert_eq!((log.hash(), log.length), (0, 0));
    }
}
