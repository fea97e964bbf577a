//! The journal of the viewer: which slots were shown, and periodically the sums over them, whose size grows with the
//! field.
//!
//! If the viewer is killed, the contribution of the slots since the last sums is lost.

use skysink_common::checkpoint::Checkpoint;
use skysink_ring::error::RingError;
use skysink_ring::folder::RingFolder;
use skysink_ring::journal::{Journal, Policy};

/// Period of the sums [slots].
const SUMS_EVERY: u64 = 64;

/// Sums that are kept: the last, which may be cut, and those before.
const SUMS: u64 = 2;

/// Opens the journal in the ring folder, and restores `state`, of at most `room` bytes, from the last sums. A slot that
/// was shown is saved before its sums, so that it is never added twice.
///
/// # Errors
/// If a file cannot be opened or read.
pub(crate) fn resume(folder: &RingFolder, room: usize, state: &mut dyn Checkpoint) -> Result<Journal, RingError> {
    let policy = Policy { state_every: SUMS_EVERY, states: SUMS, state_bytes: room, input_bytes: Some(0) };
    let journal = Journal::open(&folder.journal("viewer"), policy)?;
    journal.restore_before(u64::MAX, state)?;
    Ok(journal)
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::checkpoint::CheckpointError;
    use skysink_ring::terms::Terms;

    /// The last slot that was added.
    struct Sums(u64);

    impl Checkpoint for Sums {
        fn save(&self, bytes: &mut Vec<u8>) {
            bytes.extend(self.0.to_le_bytes());
        }

        fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
            let bytes = bytes.try_into();
            CheckpointError::ensure(bytes.is_ok(), "eight bytes")?;
            self.0 = u64::from_le_bytes(bytes.unwrap());
            Ok(())
        }
    }

    /// A state that is none.
    struct Cut;

    impl Checkpoint for Cut {
        fn save(&self, bytes: &mut Vec<u8>) {
            bytes.extend([7; 3]);
        }
    }

    /// The journal of a viewer that is started now, the last slot shown, and its sums; `u64::MAX` if there are none.
    fn resumed(folder: &RingFolder) -> (Journal, Option<u64>, u64) {
        let mut sums = Sums(u64::MAX);
        let journal = resume(folder, 8, &mut sums).unwrap();
        let last = journal.last_slot().unwrap();
        (journal, last, sums.0)
    }

    fn folder() -> RingFolder {
        RingFolder::create(Terms::default()).unwrap()
    }

    #[test]
    fn every_slot_and_every_64th_sums_are_saved() {
        let folder = folder();
        let (mut journal, last, sums) = resumed(&folder);
        assert_eq!((last, sums), (None, u64::MAX));
        for slot in 0..300 {
            journal.save(slot, &[], &Sums(slot)).unwrap();
            let (_, last, sums) = resumed(&folder);
            assert_eq!((last, sums), (Some(slot), slot / 64 * 64));
        }
    }

    #[test]
    fn sums_due_in_a_missed_slot_are_saved_in_the_next() {
        let folder = folder();
        let (mut journal, ..) = resumed(&folder);
        for slot in [5, 63, 66, 70, 300] {
            journal.save(slot, &[], &Sums(slot)).unwrap();
        }
        assert_eq!(resumed(&folder).2, 300);
        let (mut journal, ..) = resumed(&folder);
        journal.save(301, &[], &Sums(301)).unwrap();
        let (_, last, sums) = resumed(&folder);
        assert_eq!((last, sums), (Some(301), 300));
    }

    #[test]
    fn the_previous_sums_are_restored_after_incomplete_ones() {
        let folder = folder();
        let (mut journal, ..) = resumed(&folder);
        (0..=63).for_each(|slot| journal.save(slot, &[], &Sums(slot)).unwrap());
        journal.save(64, &[], &Cut).unwrap();
        assert_eq!(resumed(&folder).2, 0);
    }
}
