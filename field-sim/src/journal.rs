//! The journal of field-sim: the flight of each slot, and periodically the state of the field.
//!
//! The size of a state grows with the field, that of a flight does not, so the mean cost of a slot stays low.

use bytemuck::Zeroable;
use skysink_common::checkpoint::Checkpoint;
use skysink_common::estimate::BYTES_PER_SENSOR;
use skysink_common::message::FlightReport;
use skysink_ring::error::RingError;
use skysink_ring::folder::RingFolder;
use skysink_ring::journal::{Journal, Record};

use crate::field::Field;

/// Period of the states [slots]. With 10^6 sensor nodes a state takes as long as ten slots: less than one slot in a
/// hundred should be affected.
const STATE_EVERY: u64 = 256;

/// Recorded slots: those since the last state but one, which is used if the last is cut.
pub const SLOTS: u64 = 2 * STATE_EVERY;

/// Bytes of a state: constant, and per sensor node.
const STATE_BYTES: [usize; 2] = [1024, size_of::<u32>() + size_of::<u64>() + BYTES_PER_SENSOR];

/// The journal of field-sim.
#[derive(Debug)]
pub struct FieldJournal {
    journal: Journal,
    state: Vec<u8>,
}

impl FieldJournal {
    /// Opens the journal in the ring's folder, restores `field` to the last recorded slot but one, and returns the
    /// flight of the last. So the results of the last two slots are published again, which a peer may have missed.
    ///
    /// The state of `field` is written to an empty journal.
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

    /// Saves the flight of the last slot, and periodically the state of the field. Must be called before the queues are
    /// published.
    ///
    /// # Errors
    /// If the file cannot be written.
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

/// Restores the last state before the last record, or else that of the last record, and replays the flights after it
/// except the last, which it returns.
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
                continue; // only slots near a state differ
            }
            let mut restored = field();
            let (_, last) = FieldJournal::open(&folder, &mut restored).unwrap();
            assert_eq!((restored, last), (before, Some(flight(slot))), "slot {slot}");
        }
    }

    #[test]
    fn an_empty_journal_begins_with_the_state_of_the_field() {
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
    fn a_state_of_another_field_is_ignored() {
        let folder = folder();
        let (journal, _) = FieldJournal::open(&folder, &mut field()).unwrap();
        journal.journal.write(0, &[&[1; 20]]).unwrap();
        journal.journal.write(2, &[&[0; 4000]]).unwrap();
        let mut restored = field();
        assert_eq!(FieldJournal::open(&folder, &mut restored).unwrap().1, None);
        assert_eq!(restored, field());
    }
}
