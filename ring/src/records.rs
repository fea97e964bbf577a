//! A file with the last records of a process by slot, which survives a kill at any moment.
//!
//! A record is not synced to the disk: the operating system keeps the writes of a killed process, and a crash of the
//! machine ends the ring, too. The content of a record is left to the caller.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use xxhash_rust::xxh3::Xxh3;

use crate::error::RingError;

/// The last records of a process, each in its own entry of a file. A record that was cut by a kill is ignored, and does
/// not damage the others.
#[derive(Debug)]
pub struct Records {
    file: File,
    path: PathBuf,
    /// Number of entries.
    entries: u64,
    /// Slots per entry: the last record of so many slots stays.
    every: u64,
    /// Most bytes of a record.
    max_bytes: usize,
}

/// A valid record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Record {
    /// The slot it was written for.
    pub slot: u64,
    /// The content.
    pub bytes: Vec<u8>,
}

/// Bytes before a record: slot, length, hash.
const HEAD: usize = 24;

/// Entries begin on page boundaries, so that a cut record cannot damage another.
const PAGE: u64 = 4096;

impl Records {
    /// Opens or creates the file at `path`, with `entries` entries for records of at most `max_bytes` bytes. Each entry
    /// has room for one record of `every` consecutive slots, and is reused after `entries * every` slots.
    ///
    /// # Errors
    /// If the file cannot be opened.
    pub fn open(path: &Path, entries: u64, every: u64, max_bytes: usize) -> Result<Self, RingError> {
        let file = OpenOptions::new().read(true).write(true).create(true).truncate(false).mode(0o600).open(path);
        let file = file.map_err(|source| RingError::Journal { path: path.to_owned(), source })?;
        Ok(Self { file, path: path.to_owned(), entries, every, max_bytes })
    }

    /// Writes the record of `slot`, usually by one system call.
    ///
    /// # Errors
    /// If the file cannot be written, for example because the disk is full.
    ///
    /// # Panics
    /// If the record is longer than `max_bytes`.
    pub fn write(&self, slot: u64, bytes: &[u8]) -> Result<(), RingError> {
        let length = bytes.len();
        assert!(length <= self.max_bytes, "a record of {length} bytes: expected at most {}", self.max_bytes);
        let mut record = Vec::with_capacity(HEAD + length);
        for number in [slot, length as u64, hash(slot, bytes)] {
            record.extend_from_slice(&number.to_le_bytes());
        }
        record.extend_from_slice(bytes);
        self.file.write_all_at(&record, self.start(self.entry(slot))).map_err(|source| self.refuse(source))
    }

    /// All valid records, ascending by slot. Anything else in the file is ignored.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn read(&self) -> Result<Vec<Record>, RingError> {
        let mut records = Vec::new();
        for entry in 0..self.entries {
            records.extend(self.read_entry(entry).map_err(|source| self.refuse(source))?);
        }
        records.sort_unstable_by_key(|record| record.slot);
        Ok(records)
    }

    fn read_entry(&self, entry: u64) -> io::Result<Option<Record>> {
        let start = self.start(entry);
        let Some(head) = self.read_at(start, HEAD)? else { return Ok(None) };
        let number = |i: usize| u64::from_le_bytes(head[8 * i..8 * i + 8].try_into().expect("eight bytes"));
        let [slot, length, expected] = [0, 1, 2].map(number);
        if self.entry(slot) != entry || length > self.max_bytes as u64 {
            return Ok(None);
        }
        let length = usize::try_from(length).expect("at most `max_bytes`");
        let Some(bytes) = self.read_at(start + HEAD as u64, length)? else { return Ok(None) };
        Ok((hash(slot, &bytes) == expected).then_some(Record { slot, bytes }))
    }

    /// Reads `length` bytes; `None` if the file ends before.
    fn read_at(&self, start: u64, length: usize) -> io::Result<Option<Vec<u8>>> {
        let mut bytes = vec![0; length];
        match self.file.read_exact_at(&mut bytes, start) {
            Ok(()) => Ok(Some(bytes)),
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// The entry of `slot`.
    fn entry(&self, slot: u64) -> u64 {
        slot / self.every % self.entries
    }

    /// Offset of an entry in the file.
    fn start(&self, entry: u64) -> u64 {
        entry * (HEAD as u64 + self.max_bytes as u64).next_multiple_of(PAGE)
    }

    fn refuse(&self, source: io::Error) -> RingError {
        RingError::Journal { path: self.path.clone(), source }
    }
}

fn hash(slot: u64, bytes: &[u8]) -> u64 {
    let mut hash = Xxh3::new();
    hash.update(&slot.to_le_bytes());
    hash.update(&(bytes.len() as u64).to_le_bytes());
    hash.update(bytes);
    hash.digest()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::os::unix::fs::PermissionsExt as _;

    fn records(folder: &tempfile::TempDir) -> Records {
        Records::open(&folder.path().join("journal"), 3, 1, 5000).unwrap()
    }

    fn slots(records: &Records) -> Vec<u64> {
        records.read().unwrap().iter().map(|record| record.slot).collect()
    }

    #[test]
    fn the_last_records_are_found_in_order() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(records(&folder).read().unwrap(), []);
        for slot in 0..=7u64 {
            records(&folder).write(slot, format!("slot {slot}").as_bytes()).unwrap();
        }
        assert_eq!(slots(&records(&folder)), [5, 6, 7]);
        assert_eq!(records(&folder).read().unwrap()[2].bytes, b"slot 7");
    }

    #[test]
    fn records_of_maximum_size_do_not_overlap() {
        let folder = tempfile::tempdir().unwrap();
        let records = Records::open(&folder.path().join("journal"), 3, 1, 4096).unwrap();
        for slot in [3, 2, 1] {
            records.write(slot, &[slot as u8; 4096]).unwrap();
        }
        assert_eq!(slots(&records), [1, 2, 3]);
    }

    #[test]
    fn a_record_is_valid_only_in_its_own_cell_and_slot() {
        let folder = tempfile::tempdir().unwrap();
        let records = records(&folder);
        (1..=3).for_each(|slot| records.write(slot, b"state").unwrap());
        let fewer = Records::open(&folder.path().join("journal"), 2, 1, 5000).unwrap();
        assert_eq!(slots(&fewer), [1], "slot 3 lies where slots 0, 2, 4 would");
        records.file.write_all_at(&[4], records.start(records.entry(4))).unwrap(); // slot 1, said to be slot 4
        assert_eq!(slots(&records), [2, 3]);
    }

    #[test]
    fn saved_files_are_private_to_the_owner() {
        let folder = tempfile::tempdir().unwrap();
        let mode = records(&folder).file.metadata().unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
    }

    #[test]
    #[should_panic(expected = "a record of 5001 bytes")]
    fn a_record_that_is_too_long_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let _ = records(&folder).write(1, &[0; 5001]);
    }

    #[test]
    fn the_error_for_a_missing_folder_names_it() {
        let error = Records::open(Path::new("/nowhere/journal"), 1, 1, 1).unwrap_err().to_string();
        assert!(error.starts_with("journal /nowhere/journal: No such file"), "{error}");
    }

    proptest! {
        /// A kill leaves the first of the new bytes, and after them those of the record before.
        #[test]
        fn a_truncated_record_does_not_damage_the_others(cut in 0usize..=4024, new in any::<u8>()) {
            let folder = tempfile::tempdir().unwrap();
            let records = records(&folder);
            for slot in 1..=3u64 {
                records.write(slot, &[7; 4000]).unwrap();
            }
            let start = records.start(records.entry(4)); // where slot 1 was
            let before = records.read_at(start, HEAD + 4000).unwrap().unwrap();
            records.write(4, &[new; 4000]).unwrap();
            records.file.write_all_at(&before[cut..], start + cut as u64).unwrap();
            let expected: &[u64] = match cut {
                0 => &[1, 2, 3],
                HEAD.. if cut == before.len() || new == 7 => &[2, 3, 4],
                _ => &[2, 3],
            };
            prop_assert_eq!(slots(&records), expected);
        }

        #[test]
        fn arbitrary_bytes_contain_no_record(bytes in prop::collection::vec(any::<u8>(), 0..20_000)) {
            let folder = tempfile::tempdir().unwrap();
            std::fs::write(folder.path().join("journal"), bytes).unwrap();
            prop_assert_eq!(records(&folder).read().unwrap(), []);
        }
    }
}
