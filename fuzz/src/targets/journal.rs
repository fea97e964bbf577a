//! The journal of a process.

use std::collections::BTreeMap;

use skysink_ring::journal::{Journal, Record};

use super::place::{in_folder, spoil, write};
use crate::cursor::Cursor;

/// Places of the journal.
const PLACES: u64 = 3;

/// Longest record: a head and a record of one page, and one that takes two.
const ROOMS: [usize; 2] = [200, 5000];

/// Records are written and the file is spoilt: whatever is found was written, in ascending order; an unspoilt file
/// holds the last record of each place. Afterwards the journal can be written again.
///
/// # Panics
/// If not.
pub fn journal(bytes: &[u8]) {
    let mut input = Cursor::new(bytes);
    in_folder(|folder| {
        let path = folder.join("journal");
        write(&path, &[]);
        let room = ROOMS[usize::from(input.u8()) % ROOMS.len()];
        let journal = Journal::open(&path, PLACES, room).expect("the journal opens");
        let mut written = Vec::new();
        let mut last = BTreeMap::new();
        for _ in 0..input.u8() % 8 {
            let slot = input.u64();
            let length = usize::from(input.u16()) % (room + 1);
            let mut record = input.bytes(length.min(64)).to_vec();
            record.resize(length, input.u8());
            let (head, tail) = record.split_at(length / 3);
            journal.write(slot, &[head, tail]).expect("the record is written");
            let record = Record { slot, bytes: record };
            last.insert(slot % PLACES, record.clone());
            written.push(record);
        }
        let spoilt = spoil(&path, &mut input);
        let found = journal.read().expect("the journal is read");
        assert!(found.iter().all(|record| written.contains(record)), "found what was not written");
        assert!(found.is_sorted_by(|a, b| a.slot < b.slot), "{found:?}");
        if !spoilt {
            let mut last: Vec<Record> = last.into_values().collect();
            last.sort_unstable_by_key(|record| record.slot);
            assert_eq!(found, last);
        }
        let slot = u64::MAX;
        journal.write(slot, &[b"last"]).expect("the record is written");
        let found = journal.read().expect("the journal is read").pop().expect("a record was just written");
        assert_eq!(found, Record { slot, bytes: b"last".to_vec() });
    });
}
