//! The checkpoints of the viewer: the number of the last shown slot, in every slot, and the sums, once in
//! [`SUMS_EVERY`] slots, because their size grows with the field.
//!
//! If the viewer is killed, the contribution of the slots since the last sums is lost.

use skysink_common::checkpoint::Checkpoint;
use skysink_ring::error::RingError;
use skysink_ring::folder::RingFolder;
use skysink_ring::journal::Journal;

/// Number of slots between two checkpoints of the sums.
const SUMS_EVERY: u64 = 64;

/// Records of each kind: the last, which may be incomplete, and the one before.
const PLACES: u64 = 2;

/// The journals of the viewer.
#[derive(Debug)]
pub(crate) struct ViewerJournal {
    /// An empty record per slot.
    shown: Journal,
    /// A numbered record once in [`SUMS_EVERY`] slots.
    sums: Journal,
    /// The number of the last record of the sums, if any.
    saved: Option<u64>,
    /// The slot after the last one shown; `None` before the first.
    pub(crate) next: Option<u64>,
}

impl ViewerJournal {
    /// Opens the journals in the ring folder and restores `state`, of at most `room` bytes, from the last record of the
    /// sums.
    ///
    /// # Errors
    /// If a file cannot be opened or read.
    pub(crate) fn open(folder: &RingFolder, room: usize, state: &mut dyn Checkpoint) -> Result<Self, RingError> {
        let shown = Journal::open(&folder.journal("viewer"), PLACES, 0)?;
        let sums = Journal::open(&folder.journal("viewer-sums"), PLACES, room)?;
        let saved = sums.restore_before(u64::MAX, state)?;
        let next = shown.read()?.last().map(|record| record.slot + 1);
        Ok(Self { shown, sums, saved, next })
    }

    /// Records that `slot` has been shown, then, once in [`SUMS_EVERY`] slots, `state`, which includes the slot. In
    /// this order, no slot can be added to the sums twice.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub(crate) fn save(&mut self, slot: u64, state: &dyn Checkpoint) -> Result<(), RingError> {
        self.shown.write(slot, &[])?;
        self.next = Some(slot + 1);
        let number = slot / SUMS_EVERY;
        if self.saved != Some(number) {
            self.sums.save(number, state)?;
            self.saved = Some(number);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::checkpoint::CheckpointError;
    use skysink_common::pace::Pace;
    use skysink_ring::wait::Waiting;

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

    /// Where a viewer that is started now goes on, and its sums; `u64::MAX` if there are none.
    fn opened(folder: &RingFolder) -> (ViewerJournal, u64) {
        let mut sums = Sums(u64::MAX);
        (ViewerJournal::open(folder, 8, &mut sums).unwrap(), sums.0)
    }

    fn folder() -> RingFolder {
        RingFolder::create(Pace::Max, Waiting::Event, 1.0, false, None).unwrap()
    }

    #[test]
    fn every_slot_and_every_64th_sums_are_saved() {
        let folder = folder();
        let (mut journal, sums) = opened(&folder);
        assert_eq!((journal.next, sums), (None, u64::MAX));
        for slot in 0..300 {
            journal.save(slot, &Sums(slot)).unwrap();
            let (again, sums) = opened(&folder);
            assert_eq!((again.next, sums), (Some(slot + 1), slot / 64 * 64));
        }
    }

    #[test]
    fn sums_due_in_a_missed_slot_are_saved_in_the_next() {
        let folder = folder();
        let (mut journal, _) = opened(&folder);
        for slot in [5, 63, 66, 70, 300] {
            journal.save(slot, &Sums(slot)).unwrap();
        }
        assert_eq!(opened(&folder).1, 300);
        let (mut journal, _) = opened(&folder);
        journal.save(301, &Sums(301)).unwrap();
        assert_eq!((opened(&folder).0.next, opened(&folder).1), (Some(302), 300));
    }

    #[test]
    fn after_incomplete_sums_the_previous_ones_are_restored() {
        let folder = folder();
        let (mut journal, _) = opened(&folder);
        (0..=64).for_each(|slot| journal.save(slot, &Sums(slot)).unwrap());
        journal.sums.write(1, &[&[7; 3]]).unwrap();
        assert_eq!(opened(&folder).1, 0);
    }
}
