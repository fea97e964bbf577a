//! Writing of the trace `slots.csv`, line by line, and of its check file.

use std::fs::{File, OpenOptions};
use std::io::{self, BufRead as _, BufReader, Seek as _, SeekFrom, Write as _};
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};

use skysink_common::error::InputError;
use skysink_common::message::{FlightReport, QueuesHeader};
use skysink_common::slot_record::SlotRecord;

use crate::drive::SlotSink;
use crate::error::{FileContext, MissionError};
use crate::trace::{SLOT_COLUMNS, TraceHash};

/// The file of [`Check`].
pub(crate) const CHECK: &str = "slots.check";

/// The trace `slots.csv` of a run. Each line is written when its slot is recorded, so that a kill loses no recorded
/// slot.
#[derive(Debug)]
pub struct SlotLog {
    path: PathBuf,
    file: File,
    /// Bytes of complete lines.
    length: u64,
    trace: TraceHash,
    /// Present if the slots are flown in a ring.
    check: Option<Check>,
}

/// The check file of a trace: the last recorded slot and the hash of all lines up to it, 16 bytes, written in each slot
/// after its line.
#[derive(Debug)]
struct Check {
    path: PathBuf,
    /// `None` before the first slot.
    file: Option<File>,
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
    /// Opens the trace `path` in `folder`, which is the locked `file`, to read and resume it. In a ring each slot is
    /// checked.
    pub(crate) fn open(
        folder: &Path,
        path: PathBuf,
        file: File,
        in_a_ring: bool,
    ) -> Result<(Self, BufReader<File>), MissionError> {
        let mut reader = BufReader::new(file.try_clone().at(&path)?);
        reader.rewind().at(&path)?;
        let mut header = Vec::new();
        reader.read_until(b'\n', &mut header).at(&path)?;
        if !SLOT_COLUMNS.as_bytes().starts_with(&header) {
            let found = String::from_utf8_lossy(&header);
            let expected = SLOT_COLUMNS.trim_end();
            let remedy = "the run of an earlier version is flown again by skysink simulate RUN/scenario.toml";
            let message = format_args!("expected {expected} ({remedy})");
            return Err(InputError::line("trace", &path, 1, &found, message).into());
        }
        // With a cut header, no slot was recorded.
        let length = if header.len() == SLOT_COLUMNS.len() { header.len() as u64 } else { 0 };
        let check = in_a_ring.then(|| Check::open(folder)).transpose()?;
        Ok((Self { length, path, file, trace: TraceHash::default(), check }, reader))
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
        self.length += lines.len() as u64;
        self.trace.chain();
        let Some(check) = &mut self.check else { return Ok(is_same) };
        check.repeated = header.head.slot;
        let before = check.before.filter(|(slot, _)| *slot == header.head.slot);
        Ok(is_same && before.is_none_or(|(_, hash)| hash == self.trace.value()))
    }

    /// Whether the recorded slots were flown in a ring.
    #[must_use]
    pub fn was_in_a_ring(&self) -> bool {
        self.check.as_ref().is_some_and(|check| check.before.is_some())
    }

    /// The last slot of the check file that an earlier process has written.
    #[must_use]
    pub fn last_checked(&self) -> Option<u64> {
        self.check.as_ref().and_then(|check| check.before).map(|(slot, _)| slot)
    }

    /// Whether the repeated lines were covered by the check file, except for the last, which may have been written
    /// after it.
    #[must_use]
    pub fn was_checked(&self) -> bool {
        let check = self.check.as_ref();
        check.is_some_and(|check| check.before.is_some_and(|(slot, _)| slot + 1 >= check.repeated))
    }

    /// Truncates the trace after the last repeated line, to resume it there.
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

    /// Chained hash of all lines so far.
    #[must_use]
    pub fn hash(&self) -> u64 {
        self.trace.value()
    }
}

impl SlotSink for SlotLog {
    /// Writes the lines of a slot.
    ///
    /// # Errors
    /// If the ledger does not balance, or the lines cannot be written; the trace is then unchanged.
    fn add(&mut self, record: &SlotRecord) -> Result<(), MissionError> {
        let lines = self.trace.write(&record.flights, &record.header)?;
        let written = self.file.write_all(lines.as_bytes());
        if written.is_err() {
            let cut = self.file.set_len(self.length).and_then(|()| self.file.seek(SeekFrom::Start(self.length)));
            let _ = cut; // a resumed run cuts an incomplete line, too
        }
        written.at(&self.path)?;
        self.length += lines.len() as u64;
        self.trace.chain();
        self.check.as_mut().map_or(Ok(()), |check| check.write(record.slot(), self.trace.value()))
    }
}

#[cfg(test)]
mod tests {
    use skysink_common::message::Mode;
    use skysink_common::slot_record::{ByUav, Plans};

    use super::*;

    #[test]
    fn a_line_that_cannot_be_written_is_not_in_the_hash() {
        let path = PathBuf::from("/dev/full");
        let file = File::options().write(true).open(&path).unwrap();
        let mut log = SlotLog { path, file, length: 0, trace: TraceHash::default(), check: None };
        let record = SlotRecord {
            plans: Plans::from_buf([None]),
            paths: ByUav::new(),
            flights: ByUav::from_buf([FlightReport::at([1.0, 2.0, 20.0], Mode::Hold)]),
            header: QueuesHeader::default(),
        };
        let error = log.add(&record).unwrap_err();
        assert!(error.to_string().contains("/dev/full"), "{error}");
        assert_eq!((log.hash(), log.length), (0, 0));
    }
}
