//! The journal of a process: what it must know to continue after a slot, in the ring's folder.
//!
//! A journal has the state after a slot, once in so many slots, and what the process has received in each slot since.
//! How often the state is written is a number: in every slot where it is small, and seldom where it grows with the
//! field. A restarted process restores the last state, and advances it by what was received since.

use std::path::Path;

use skysink_common::checkpoint::Checkpoint;

use crate::error::RingError;
use crate::records::{Record, Records};

/// How often a journal has the state, and how much it keeps.
#[derive(Debug, Clone, Copy)]
pub struct Policy {
    /// The state is written once in so many slots.
    pub state_every: u64,
    /// States that are kept. The last may be cut.
    pub states: u64,
    /// Most bytes of a state.
    pub state_bytes: usize,
    /// Most bytes of what is received in a slot; `None` for a process whose states are enough.
    pub input_bytes: Option<usize>,
}

/// The journal of a process.
#[derive(Debug)]
pub struct Journal {
    policy: Policy,
    states: Records,
    /// What was received in each slot since the oldest state.
    inputs: Option<Records>,
    /// The slot of the last state, if there is one.
    last_state: Option<u64>,
    buffer: Vec<u8>,
}

impl Journal {
    /// Opens or creates the journal whose states are in the file `path`. The inputs are in the file with the extension
    /// `inputs`.
    ///
    /// # Errors
    /// If a file cannot be opened or read.
    pub fn open(path: &Path, policy: Policy) -> Result<Self, RingError> {
        let Policy { state_every, states, state_bytes, input_bytes } = policy;
        let open_inputs = |bytes| Records::open(&path.with_extension("inputs"), states * state_every, 1, bytes);
        let inputs = input_bytes.map(open_inputs).transpose()?;
        let states = Records::open(path, states, state_every, state_bytes)?;
        let last_state = states.read()?.last().map(|record| record.slot);
        Ok(Self { policy, states, inputs, last_state, buffer: Vec::new() })
    }

    /// Saves what was received in `slot` and, if it is due, the state after it; a state without bytes is not written.
    /// Must be called before the results of the slot are published.
    ///
    /// The input is written first: if the process is killed in between, the state before leads to the same.
    ///
    /// # Errors
    /// If a file cannot be written, for example because the disk is full.
    ///
    /// # Panics
    /// If the input or the state is longer than the policy says.
    pub fn save(&mut self, slot: u64, input: &[u8], state: &dyn Checkpoint) -> Result<(), RingError> {
        if let Some(inputs) = &self.inputs {
            inputs.write(slot, input)?;
        }
        if !self.is_state_due(slot) {
            return Ok(());
        }
        self.buffer.clear();
        state.save(&mut self.buffer);
        if !self.buffer.is_empty() {
            self.states.write(slot, &self.buffer)?;
            self.last_state = Some(slot);
        }
        Ok(())
    }

    /// Whether no state of these `state_every` slots has been written, or `slot` is run again.
    fn is_state_due(&self, slot: u64) -> bool {
        let number = |slot: u64| slot / self.policy.state_every;
        self.last_state.is_none_or(|last| slot <= last || number(slot) != number(last))
    }

    /// Restores the newest state before `slot` that `state` accepts, and returns its slot; `None`, with `state`
    /// unchanged, if there is none.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn restore_before(&self, slot: u64, state: &mut dyn Checkpoint) -> Result<Option<u64>, RingError> {
        let records = self.states.read()?;
        let mut before = records.iter().rev().filter(|record| record.slot < slot);
        Ok(before.find(|record| state.restore(&record.bytes).is_ok()).map(|record| record.slot))
    }

    /// The last saved slot.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn last_slot(&self) -> Result<Option<u64>, RingError> {
        Ok(self.inputs()?.last().map(|input| input.slot).or(self.last_state))
    }

    /// What was received in the last slots, ascending by slot. A slot whose record was cut is missing.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn inputs(&self) -> Result<Vec<Record>, RingError> {
        self.inputs.as_ref().map_or_else(|| Ok(Vec::new()), Records::read)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::checkpoint::CheckpointError;

    fn journal(folder: &tempfile::TempDir, state_every: u64, input_bytes: Option<usize>) -> Journal {
        let policy = Policy { state_every, states: 3, state_bytes: 1, input_bytes };
        Journal::open(&folder.path().join("x.journal"), policy).unwrap()
    }

    fn states(journal: &Journal) -> Vec<u64> {
        journal.states.read().unwrap().iter().map(|record| record.slot).collect()
    }

    /// A number below 100, which nobody else's state is; 0 is none.
    struct Number(u8);

    impl Checkpoint for Number {
        fn save(&self, bytes: &mut Vec<u8>) {
            bytes.extend((self.0 > 0).then_some(self.0));
        }

        fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
            CheckpointError::ensure(bytes.len() == 1 && bytes[0] < 100, "a small number")?;
            self.0 = bytes[0];
            Ok(())
        }
    }

    #[test]
    fn the_newest_acceptable_state_before_a_slot_is_restored() {
        let folder = tempfile::tempdir().unwrap();
        let mut journal = journal(&folder, 1, None);
        let mut state = Number(0);
        assert_eq!(journal.restore_before(9, &mut state).unwrap(), None);
        [(3, 30), (4, 40), (5, 200)]
            .into_iter()
            .for_each(|(slot, number)| journal.save(slot, &[], &Number(number)).unwrap());
        for (before, slot, number) in [(9, Some(4), 40), (5, Some(4), 40), (4, Some(3), 30), (3, None, 7)] {
            state = Number(7);
            assert_eq!(journal.restore_before(before, &mut state).unwrap(), slot, "before slot {before}");
            assert_eq!(state.0, number);
        }
    }

    #[test]
    fn an_empty_state_keeps_the_previous_record() {
        let folder = tempfile::tempdir().unwrap();
        let mut journal = journal(&folder, 1, None);
        journal.save(1, &[], &Number(1)).unwrap();
        journal.save(4, &[], &Number(0)).unwrap();
        assert_eq!(states(&journal), [1]);
    }

    #[test]
    fn the_state_is_saved_at_its_interval_and_the_input_in_every_slot() {
        let folder = tempfile::tempdir().unwrap();
        for slot in 5..=27 {
            journal(&folder, 8, Some(2)).save(slot, &[slot as u8; 2], &Number(1)).unwrap();
        }
        let journal = journal(&folder, 8, Some(2));
        assert_eq!(states(&journal), [8, 16, 24], "and slot 5, replaced by 24");
        let inputs = journal.inputs().unwrap();
        assert!(inputs.iter().map(|input| input.slot).eq(5..=27) && inputs[22].bytes == [27; 2], "{inputs:?}");
    }

    #[test]
    fn a_state_due_in_a_missed_slot_is_saved_in_the_next() {
        let folder = tempfile::tempdir().unwrap();
        let mut journal = journal(&folder, 8, None);
        [5, 7, 10, 15, 40].into_iter().for_each(|slot| journal.save(slot, &[], &Number(1)).unwrap());
        assert_eq!(states(&journal), [5, 10, 40]);
    }

    #[test]
    fn a_repeated_slot_replaces_its_state() {
        let folder = tempfile::tempdir().unwrap();
        let mut journal = journal(&folder, 1, None);
        [(7, 70), (8, 80), (9, 90), (8, 81)]
            .into_iter()
            .for_each(|(slot, number)| journal.save(slot, &[], &Number(number)).unwrap());
        let mut state = Number(1);
        journal.restore_before(9, &mut state).unwrap();
        assert_eq!((states(&journal), state.0), (vec![7, 8, 9], 81));
    }
}
