//! The journal of flight-sim: its last flights, so that a restarted process does not fly a slot twice.

use std::collections::VecDeque;

use bytemuck::Zeroable;
use skysink_common::message::FlightReport;
use skysink_common::slot_record::ByUav;
use skysink_ring::error::RingError;
use skysink_ring::folder::RingFolder;
use skysink_ring::journal::{Journal, Policy};
use skysink_ring::topics::FLIGHT_HISTORY;

/// The journal of flight-sim in the ring's folder, of `uavs` UAVs: their last flights, and one that may be cut. The
/// state after a slot is the flights of its UAVs.
///
/// # Errors
/// If the file cannot be opened.
pub fn journal(folder: &RingFolder, uavs: usize) -> Result<Journal, RingError> {
    let states = FLIGHT_HISTORY as u64 + 1;
    let policy = Policy { state_every: 1, states, state_bytes: uavs * size_of::<FlightReport>(), input_bytes: None };
    Journal::open(&folder.journal("flights"), policy)
}

/// The flights of the last saved slots, as many as late joiners receive: consecutive, ascending.
///
/// # Errors
/// If the file cannot be read.
pub fn restore(journal: &Journal, uavs: usize) -> Result<Vec<(u64, ByUav<FlightReport>)>, RingError> {
    let mut slots = VecDeque::new();
    let mut flights = ByUav::from_elem(FlightReport::zeroed(), uavs);
    let mut before = u64::MAX;
    while slots.len() < FLIGHT_HISTORY
        && let Some(slot) = journal.restore_before(before, &mut flights)?
        && (slots.is_empty() || slot + 1 == before)
    {
        slots.push_front((slot, flights.clone()));
        before = slot;
    }
    Ok(slots.into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::checkpoint::Checkpoint;
    use skysink_common::message::Mode;
    use skysink_ring::terms::Terms;

    /// A state that is none.
    struct Cut;

    impl Checkpoint for Cut {
        fn save(&self, bytes: &mut Vec<u8>) {
            bytes.extend([1; 20]);
        }
    }

    fn flight(slot: u64) -> ByUav<FlightReport> {
        ByUav::from_elem(FlightReport::at([slot as f64, 0.5, 20.0], Mode::Serve), 1)
    }

    #[test]
    fn the_last_three_flights_are_restored_in_order() {
        let folder = RingFolder::create(Terms::default()).unwrap();
        let mut flights = journal(&folder, 1).unwrap();
        assert_eq!(restore(&flights, 1).unwrap(), []);
        flights.save(0, &[], &flight(0)).unwrap();
        assert_eq!(restore(&flights, 1).unwrap(), [(0, flight(0))]);
        for slot in 1..=9 {
            flights.save(slot, &[], &flight(slot)).unwrap();
            let again = journal(&folder, 1).unwrap();
            let last: Vec<_> = (slot.saturating_sub(2)..=slot).map(|slot| (slot, flight(slot))).collect();
            assert_eq!(restore(&again, 1).unwrap(), last);
        }
        flights.save(14, &[], &flight(14)).unwrap(); // 11 to 13 are cut
        assert_eq!(restore(&flights, 1).unwrap(), [(14, flight(14))]);
    }

    #[test]
    fn a_truncated_flight_leaves_the_three_before_it() {
        let folder = RingFolder::create(Terms::default()).unwrap();
        let mut flights = journal(&folder, 1).unwrap();
        (1..=5).for_each(|slot| flights.save(slot, &[], &flight(slot)).unwrap());
        flights.save(6, &[], &Cut).unwrap();
        assert_eq!(restore(&flights, 1).unwrap(), [3, 4, 5].map(|slot| (slot, flight(slot))));
    }
}
