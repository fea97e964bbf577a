//! What field-sim saves once a slot: the flight, and now and then the whole field.
//!
//! A state is as large as the field, a flight is not: so a slot costs the same however many sensor nodes there are.

use bytemuck::Zeroable;
use skysink_common::checkpoint::Checkpoint;
use skysink_common::estimate::BYTES_PER_SENSOR;
use skysink_common::message::FlightReport;
use skysink_ring::error::RingError;
use skysink_ring::folder::RingFolder;
use skysink_ring::journal::{Journal, Record};

use crate::field::Field;

/// Slots from one state to the next. Of 10^6 sensor nodes a state takes as long as ten slots: it is to be seen in less than
/// one slot in a hundred.
const STATE_EVERY: u64 = 256;

/// Slots on record: those since the state before the last, which counts where the last is cut.
const SLOTS: u64 = 2 * STATE_EVERY;

/// Bytes of a state beside those of its sensor nodes, and for each of them.
const STATE_BYTES: [usize; 2] = [1024, size_of::<u32>() + size_of::<u64>() + BYTES_PER_SENSOR];

/// The journal of field-sim.
#[derive(Debug)]
pub struct FieldJournal {
    journal: Journal,
    state: Vec<u8>,
}

impl FieldJournal {
    /// Opens the journal in the ring's folder and restores `field`, before slot 1, to the last slot but one that is on
    /// record, so that what the last two led to is published again: a peer may have died without it. Returns the flight
    /// of the last slot.
    ///
    /// An empty journal begins with the state that `field` is in.
    ///
    /// # Errors
    /// If the file cannot be opened, read or written.
    pub fn open(folder: &RingFolder, field: &mut Field) -> Result<(Self, Option<FlightReport>), RingError> {
        let room = size_of::<FlightReport>() + STATE_BYTES[0] + STATE_BYTES[1] * field.queues_bits().len();
        let journal = Journal::open(&folder.journal("field"), SLOTS, room)?;
        let mut opened = Self { journal, state: Vec::new() };
        let records = opened.journal.read()?;
        if records.is_empty() {
            opened.save_state(&FlightReport::zeroed(), field)?;
        }
        Ok((opened, restore(field, &records)))
    }

    /// Saves the flight that has led to the state of the field, and now and then the state; to be done before it is
    /// published.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn save(&mut self, flight: &FlightReport, field: &Field) -> Result<(), RingError> {
        if field.slot().is_multiple_of(STATE_EVERY) {
            self.save_state(flight, field)
        } else {
            self.journal.write(field.slot(), &[bytemuck::bytes_of(flight)])
        }
    }

    fn save_state(&mut self, flight: &FlightReport, field: &Field) -> Result<(), RingError> {
        self.state.clear();
        field.save(&mut self.state);
        self.journal.write(field.slot(), &[bytemuck::bytes_of(flight), &self.state])
    }
}

/// Restores the last state before the last record, or else that of the last record, and steps through the flights after
/// it. Returns the last flight, which is left to the caller.
fn restore(field: &mut Field, records: &[Record]) -> Option<FlightReport> {
    let (last, before) = records.split_last()?;
    for record in before.iter().rev().chain([last]) {
        let state = record.bytes.get(size_of::<FlightReport>()..);
        if state.is_some_and(|state| field.restore(state).is_ok()) {
            break;
        }
    }
    let mut next: Option<FlightReport> = None;
    for record in records {
        if record.slot <= field.slot() {
            continue;
        }
        if let Some(flight) = next.take()
            && field.step(field.slot() + 1, &flight).is_err()
        {
            break;
        }
        let flight = record.bytes.get(..size_of::<FlightReport>()).map(bytemuck::pod_read_unaligned);
        next = flight.filter(|_| record.slot == field.slot() + 1);
        if next.is_none() {
            break;
        }
    }
    next
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::message::{LinkReport, Mode};
    use skysink_common::pace::Pace;
    use skysink_common::scenario::{Overrides, Scenario};
    use skysink_common::sensors::SensorList;
    use skysink_ring::wait::Waiting;

    fn field() -> Field {
        let scenario = Scenario::letter(Overrides::default()).unwrap();
        Field::new(&scenario, &SensorList::of(&scenario).unwrap())
    }

    /// A flight that serves another SN in each slot.
    fn flight(slot: u64) -> FlightReport {
        let mut report = FlightReport::at([50.0, 50.0, 20.0], Mode::Serve);
        let sensor = u32::try_from(slot * 7 % 200).unwrap();
        report.links[0] = LinkReport { sensor, capacity_bits: 5_000, ..LinkReport::default() };
        report.served = 1;
        report
    }

    fn folder() -> RingFolder {
        RingFolder::create(Pace::Max, Waiting::Event, 1.0, false, None).unwrap()
    }

    #[test]
    fn a_field_is_restored_to_the_slot_before_the_last_with_the_flight_of_the_last() {
        let folder = folder();
        let mut stepped = field();
        let (mut journal, first) = FieldJournal::open(&folder, &mut stepped).unwrap();
        assert_eq!(first, None);
        for slot in 1..=600 {
            let before = stepped.clone();
            stepped.step(slot, &flight(slot)).unwrap();
            journal.save(&flight(slot), &stepped).unwrap();
            if (slot + 5) % STATE_EVERY > 10 {
                continue; // it is the slots about a state that differ
            }
            let mut restored = field();
            let (_, last) = FieldJournal::open(&folder, &mut restored).unwrap();
            assert_eq!((restored, last), (before, Some(flight(slot))), "slot {slot}");
        }
    }

    #[test]
    fn a_journal_begins_with_the_state_that_it_is_opened_with() {
        let folder = folder();
        let mut stepped = field();
        (1..=77).for_each(|slot| assert!(stepped.step(slot, &flight(slot)).is_ok()));
        let seeded = stepped.clone();
        assert_eq!(FieldJournal::open(&folder, &mut stepped).unwrap().1, None);
        let mut restored = field();
        let (mut journal, last) = FieldJournal::open(&folder, &mut restored).unwrap();
        assert_eq!((&restored, last), (&seeded, None));
        for slot in [78, 79] {
            restored.step(slot, &flight(slot)).unwrap();
            journal.save(&flight(slot), &restored).unwrap();
        }
        let mut restored = field();
        let last = FieldJournal::open(&folder, &mut restored).unwrap().1;
        assert_eq!((restored.slot(), last), (78, Some(flight(79))));
    }

    #[test]
    fn a_state_of_another_field_does_not_count() {
        let folder = folder();
        let (journal, _) = FieldJournal::open(&folder, &mut field()).unwrap();
        journal.journal.write(0, &[&[1; 20]]).unwrap();
        journal.journal.write(2, &[&[0; 4000]]).unwrap();
        let mut restored = field();
        assert_eq!(FieldJournal::open(&folder, &mut restored).unwrap().1, None);
        assert_eq!(restored, field());
    }
}
