//! What viewer saves across its own death: in every slot which one it has shown, and now and then the sums until then.
//!
//! The sums are as large as the field, the number of a slot is not, and most slots cost no more than that.
//! What the slots since the last sums would have added is lost if the viewer is killed.

use skysink_common::checkpoint::Checkpoint;
use skysink_ring::error::RingError;
use skysink_ring::folder::RingFolder;
use skysink_ring::journal::Journal;

/// Slots from one saving of the sums to the next.
const SUMS_EVERY: u64 = 64;

/// Records of each kind: the last, which may be cut, and the one before.
const PLACES: u64 = 2;

/// The journal of viewer.
#[derive(Debug)]
pub(crate) struct ViewerJournal {
    /// A record without content for each slot.
    shown: Journal,
    /// A record for every [`SUMS_EVERY`] slots, by its number.
    sums: Journal,
    /// The number of the last one; none if none is on record.
    saved: Option<u64>,
    /// The slot after the last one shown; none before the first.
    pub(crate) next: Option<u64>,
}

impl ViewerJournal {
    /// Opens the journal in the ring's folder and restores `state`, of at most `room` bytes, to the last sums on
    /// record.
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

    /// Saves that `slot` has been shown, and now and then `state`, which includes it. In this order, so that a slot
    /// that is on record in the sums is never shown, and added, again.
    ///
    /// # Errors
    /// If the system refuses.
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
    fn every_slot_shown_is_on_record_and_the_sums_of_every_sixty_fourth() {
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
    fn sums_that_are_due_in_a_slot_that_was_missed_are_saved_in_the_next() {
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
    fn sums_that_are_cut_leave_those_before() {
        let folder = folder();
        let (mut journal, _) = opened(&folder);
        (0..=64).for_each(|slot| journal.save(slot, &Sums(slot)).unwrap());
        journal.sums.write(1, &[&[7; 3]]).unwrap();
        assert_eq!(opened(&folder).1, 0);
    }
}
