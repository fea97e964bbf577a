//! The journal of field-sim: the flights of each slot, and periodically the state of the field.
//!
//! The size of a state grows with the field, that of a flight does not, so the mean cost of a slot stays low.

use bytemuck::Zeroable;
use skysink_common::checkpoint::Checkpoint;
use skysink_common::estimate::BYTES_PER_SENSOR;
use skysink_common::message::FlightReport;
use skysink_common::slot_record::ByUav;
use skysink_ring::error::RingError;
use skysink_ring::folder::RingFolder;
use skysink_ring::journal::{Journal, Policy};
use skysink_ring::records::Record;

use crate::field::Field;

/// Period of the states [slots]. With 10^6 sensor nodes a state takes as long as ten slots: less than one slot in a
/// hundred should be affected.
pub const STATE_EVERY: u64 = 256;

/// The last state and the one before, which is used if the last is cut.
pub const STATES: u64 = 2;

/// Slots whose flights are kept.
pub const SLOTS: u64 = STATES * STATE_EVERY;

/// Bytes of a state: constant, and per sensor node.
const STATE_BYTES: [usize; 2] = [1024, size_of::<u32>() + 2 * size_of::<u64>() + BYTES_PER_SENSOR];

/// The journal of field-sim over `field` with `uavs` UAVs, in the ring's folder.
///
/// # Errors
/// If a file cannot be opened or read.
pub fn journal(folder: &RingFolder, field: &Field, uavs: usize) -> Result<Journal, RingError> {
    let state_bytes = STATE_BYTES[0] + STATE_BYTES[1] * field.queues_bits().len() + field.features().most_bytes();
    let input_bytes = Some(uavs * size_of::<FlightReport>());
    let policy = Policy { state_every: STATE_EVERY, states: STATES, state_bytes, input_bytes };
    Journal::open(&folder.journal("field"), policy)
}

/// Saves the flights of the field's last slot, and periodically the field. Must be called before the queues are
/// published.
///
/// # Errors
/// If a file cannot be written.
pub fn save(journal: &mut Journal, flights: &ByUav<FlightReport>, field: &Field) -> Result<(), RingError> {
    let mut bytes = Vec::new();
    flights.save(&mut bytes);
    journal.save(field.slot(), &bytes, field)
}

/// Resumes `field` at the last saved slot but one, and returns the flights of the last. So the results of the last two
/// slots are published again, which a peer may have missed. The state of `field` is written to an empty journal.
///
/// # Errors
/// If a file cannot be read or written.
pub fn resume(journal: &mut Journal, field: &mut Field, uavs: usize) -> Result<Option<ByUav<FlightReport>>, RingError> {
    let flown = journal.inputs()?;
    let Some(last) = flown.last() else {
        save(journal, &ByUav::from_elem(FlightReport::zeroed(), uavs), field)?;
        return Ok(None);
    };
    if journal.restore_before(last.slot, field)?.is_none() {
        journal.restore_before(u64::MAX, field)?;
    }
    Ok(advance(field, &flown, uavs))
}

/// Advances the field by the flights after its slot except those of the last, which are returned.
fn advance(field: &mut Field, flown: &[Record], uavs: usize) -> Option<ByUav<FlightReport>> {
    let first = flown.partition_point(|record| record.slot <= field.slot());
    let mut next: Option<ByUav<FlightReport>> = None;
    for record in &flown[first..] {
        if let Some(flights) = next.take()
            && field.step(field.slot() + 1, &flights).is_err()
        {
            break;
        }
        let mut flights = ByUav::from_elem(FlightReport::zeroed(), uavs);
        if record.slot != field.slot() + 1 || flights.restore(&record.bytes).is_err() {
            break;
        }
        next = Some(flights);
    }
    next
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::message::{LinkReport, Mode};
    use skysink_common::scenario::{Overrides, Scenario};
    use skysink_common::sensors::SensorList;
    use skysink_ring::terms::Terms;

    fn field() -> Field {
        let scenario = Scenario::letter(Overrides::default()).unwrap();
        Field::new(&scenario, &SensorList::of(&scenario).unwrap())
    }

    /// A flight that serves another SN in each slot.
    fn flight(slot: u64) -> ByUav<FlightReport> {
        let mut report = FlightReport::at([50.0, 50.0, 20.0], Mode::Serve);
        let sensor = u32::try_from(slot * 7 % 200).unwrap();
        report.links[0] = LinkReport { sensor, capacity_bits: 5_000, ..LinkReport::default() };
        report.served = 1;
        ByUav::from_elem(report, 1)
    }

    fn folder() -> RingFolder {
        RingFolder::create(Terms::default()).unwrap()
    }

    /// The journal, and what is resumed from it.
    fn open(folder: &RingFolder, field: &mut Field) -> (Journal, Option<ByUav<FlightReport>>) {
        let mut journal = journal(folder, field, 1).unwrap();
        let last = resume(&mut journal, field, 1).unwrap();
        (journal, last)
    }

    #[test]
    fn a_field_is_restored_one_slot_back_with_the_last_flight() {
        let folder = folder();
        let mut stepped = field();
        let (mut journal, first) = open(&folder, &mut stepped);
        assert_eq!(first, None);
        for slot in 1..=600 {
            let before = stepped.clone();
            stepped.step(slot, &flight(slot)).unwrap();
            save(&mut journal, &flight(slot), &stepped).unwrap();
            if (slot + 5) % STATE_EVERY > 10 {
                continue; // only slots near a state differ
            }
            let mut restored = field();
            let (_, last) = open(&folder, &mut restored);
            assert_eq!((restored, last), (before, Some(flight(slot))), "slot {slot}");
        }
    }

    #[test]
    fn an_empty_journal_begins_with_the_state_of_the_field() {
        let folder = folder();
        let mut stepped = field();
        (1..=77).for_each(|slot| assert!(stepped.step(slot, &flight(slot)).is_ok()));
        let seeded = stepped.clone();
        assert_eq!(open(&folder, &mut stepped).1, None);
        let mut restored = field();
        let (mut journal, last) = open(&folder, &mut restored);
        assert_eq!((&restored, last), (&seeded, None));
        for slot in [78, 79] {
            restored.step(slot, &flight(slot)).unwrap();
            save(&mut journal, &flight(slot), &restored).unwrap();
        }
        let mut restored = field();
        let last = open(&folder, &mut restored).1;
        assert_eq!((restored.slot(), last), (78, Some(flight(79))));
    }

    /// A state of so many bytes.
    struct Other(usize);

    impl Checkpoint for Other {
        fn save(&self, bytes: &mut Vec<u8>) {
            bytes.resize(self.0, 0);
        }
    }

    #[test]
    fn a_state_of_another_field_is_ignored() {
        let folder = folder();
        let mut journal = journal(&folder, &field(), 1).unwrap();
        journal.save(0, &[1; 20], &Other(20)).unwrap();
        journal.save(STATE_EVERY, &[], &Other(2000)).unwrap();
        let mut restored = field();
        assert_eq!(open(&folder, &mut restored).1, None);
        assert_eq!(restored, field());
    }
}
