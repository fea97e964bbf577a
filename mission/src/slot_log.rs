//! Writing of the trace `slots.csv`, line by line, and of its check file. Meanwhile nobody else may change them, or the
//! other files of the run.

use std::fs::{File, OpenOptions};
use std::io::{self, BufRead as _, BufReader, Seek as _};
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use skysink_common::error::InputError;
use skysink_common::message::{FlightReport, QueuesHeader};
use skysink_common::slot_record::SlotRecord;
use skysink_common::written_file::{ExpectedFile, Extent, WrittenFile};

use crate::drive::SlotSink;
use crate::error::{FileContext, MissionError};
use crate::origin::{self, INPUTS};
use crate::trace::TraceHash;

/// The file of [`Check`].
pub(crate) const CHECK: &str = "slots.check";

/// Minimum time between two comparisons of the files of a run with what was written.
const COMPARE_EVERY: Duration = Duration::from_secs(1);

/// The trace `slots.csv` of a run. Each line is written when its slot is recorded, so that a kill loses no recorded
/// slot.
#[derive(Debug)]
pub struct SlotLog {
    /// The complete lines.
    file: WrittenFile,
    /// Its header.
    columns: &'static str,
    trace: TraceHash,
    /// Present if the slots are flown in a ring.
    check: Option<Check>,
    /// The files from which the run is flown; empty before slots are written.
    inputs: Vec<ExpectedFile>,
    /// Time of the last comparison of all files.
    compared: Instant,
}

/// The check file of a trace: the last recorded slot and the hash of all lines up to it, 16 bytes, written in each slot
/// after its line.
#[derive(Debug)]
struct Check {
    path: PathBuf,
    /// `None` before the first slot.
    file: Option<WrittenFile>,
    /// Slot and hash that an earlier process has written.
    before: Option<(u64, u64)>,
    /// The last repeated slot.
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
        let is_whole = |file: &File| file.metadata().is_ok_and(|file| file.len() == 16);
        let file = file.filter(|file| is_whole(file) && file.read_exact_at(&mut bytes, 0).is_ok());
        let number = u128::from_le_bytes(bytes);
        let before = file.is_some().then_some(((number & u128::from(u64::MAX)) as u64, (number >> 64) as u64));
        let mut file = file.map(|file| WrittenFile::new(&path, file));
        file.iter_mut().for_each(|file| file.add_known(&bytes));
        Ok(Self { path, file, before, repeated: 0 })
    }

    fn write(&mut self, slot: u64, hash: u64) -> Result<(), MissionError> {
        let file = match &mut self.file {
            Some(file) => file,
            None => self.file.insert(WrittenFile::new(&self.path, File::create(&self.path).at(&self.path)?)),
        };
        let number = u128::from(slot) | u128::from(hash) << 64;
        file.overwrite(&number.to_le_bytes()).at(&self.path)
    }
}

impl SlotLog {
    /// Opens the trace `path`, which is the locked `file`, to read and resume it. In a ring each slot is checked.
    pub(crate) fn open(
        path: &Path,
        file: File,
        in_a_ring: bool,
        columns: &'static str,
    ) -> Result<(Self, BufReader<File>), MissionError> {
        let mut reader = BufReader::new(file.try_clone().at(path)?);
        reader.rewind().at(path)?;
        let mut header = Vec::new();
        reader.read_until(b'\n', &mut header).at(path)?;
        if !columns.as_bytes().starts_with(&header) {
            let found = String::from_utf8_lossy(&header);
            let expected = columns.trim_end();
            let remedy = "the run of an earlier version is flown again by skysink simulate RUN/scenario.toml";
            let message = format_args!("expected {expected} ({remedy})");
            return Err(InputError::line("trace", path, 1, &found, message).into());
        }
        let mut file = WrittenFile::new(path, file);
        if header.len() == columns.len() {
            file.add_known(&header); // with a cut header, no slot was recorded
        }
        let check = in_a_ring.then(|| Check::open(folder_of(path))).transpose()?;
        let trace = TraceHash::default();
        let log = Self { file, columns, trace, check, inputs: Vec::new(), compared: Instant::now() };
        Ok((log, reader))
    }

    /// Repeats the recorded lines of a slot. Returns whether they are those of the flights, and all lines so far are
    /// those that were written.
    ///
    /// # Errors
    /// If the ledger does not balance.
    pub fn repeat(
        &mut self,
        lines: &[u8],
        flights: &[FlightReport],
        header: &QueuesHeader,
    ) -> Result<bool, MissionError> {
        let is_same = self.trace.write(flights, header)?.as_bytes() == lines;
        self.file.add_known(lines);
        self.trace.chain();
        let Some(check) = &mut self.check else { return Ok(is_same) };
        check.repeated = header.head.slot;
        let before = check.before.filter(|(slot, _)| *slot == header.head.slot);
        Ok(is_same && before.is_none_or(|(_, hash)| hash == self.trace.value()))
    }

    /// Whether the recorded slots were flown in a ring.
    pub fn was_in_a_ring(&self) -> bool {
        self.check.as_ref().is_some_and(|check| check.before.is_some())
    }

    /// The last slot of the check file that an earlier process has written.
    pub fn last_checked(&self) -> Option<u64> {
        self.check.as_ref().and_then(|check| check.before).map(|(slot, _)| slot)
    }

    /// Whether the repeated lines were covered by the check file, except for the last, which may have been written
    /// after it.
    pub fn was_checked(&self) -> bool {
        let check = self.check.as_ref();
        check.is_some_and(|check| check.before.is_some_and(|(slot, _)| slot + 1 >= check.repeated))
    }

    /// Truncates the trace after the last repeated line, to resume it there. From here on, changes of the run's files
    /// by others end the run.
    ///
    /// # Errors
    /// If a file cannot be changed or read, or an input is not that of the run.
    pub fn resume(&mut self) -> Result<(), MissionError> {
        let path = self.file.path().to_owned();
        self.file.cut().at(&path)?;
        if self.file.length() == 0 {
            self.file.append(self.columns.as_bytes()).at(&path)?;
        }
        let folder = folder_of(&path);
        let sources = origin::source_names(folder);
        let inputs = INPUTS.into_iter().chain(sources.iter().map(String::as_str)).map(|name| folder.join(name));
        self.inputs = inputs.map(|path| ExpectedFile::read(&path).at(&path)).collect::<Result<_, _>>()?;
        origin::read(folder)?; // refuses what has changed before
        Ok(())
    }

    /// Compares the files of the run with what was written: the trace, its check file, and those from which the run is
    /// flown.
    ///
    /// # Errors
    /// If one was changed by another process, or cannot be read.
    pub fn compare(&self, extent: Extent) -> Result<(), MissionError> {
        let check = self.check.as_ref().and_then(|check| check.file.as_ref());
        for file in [&self.file].into_iter().chain(check) {
            file.compare(extent).at(file.path())?;
        }
        self.inputs.iter().try_for_each(|file| file.compare(extent).at(file.path()))
    }

    /// Chained hash of all lines so far.
    pub fn hash(&self) -> u64 {
        self.trace.value()
    }
}

impl SlotSink for SlotLog {
    /// Writes the lines of a slot.
    ///
    /// # Errors
    /// If the ledger does not balance, the lines cannot be written, or another process has changed a file of the run;
    /// the trace is then unchanged.
    fn add(&mut self, record: &SlotRecord) -> Result<(), MissionError> {
        if self.compared.elapsed() >= COMPARE_EVERY {
            self.compare(Extent::Quick)?;
            self.compared = Instant::now();
        }
        let lines = self.trace.write(record.flights(), &record.header)?;
        self.file.append(lines.as_bytes()).at(self.file.path())?;
        self.trace.chain();
        self.check.as_mut().map_or(Ok(()), |check| check.write(record.slot(), self.trace.value()))
    }
}

/// The run folder of the trace `path`.
fn folder_of(path: &Path) -> &Path {
    path.parent().unwrap_or(Path::new("."))
}

#[cfg(test)]
mod tests {
    use skysink_common::message::Mode;
    use skysink_common::slot_record::ByUav;

    use super::*;

    #[test]
    fn a_failed_line_does_not_enter_the_hash() {
        let path = Path::new("/dev/full");
        let file = WrittenFile::new(path, File::options().write(true).open(path).unwrap());
        let trace = TraceHash::default();
        let mut log = SlotLog { file, columns: "", trace, check: None, inputs: Vec::new(), compared: Instant::now() };
        let flights = ByUav::from_buf([FlightReport::at([1.0, 2.0, 20.0], Mode::Hold)]);
        let record = SlotRecord::unplanned(flights, QueuesHeader::default());
        let error = log.add(&record).unwrap_err();
        assert!(error.to_string().contains("/dev/full"), "{error}");
        assert_eq!((log.hash(), log.file.length()), (0, 0));
    }
}
