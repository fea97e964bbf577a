//! The journal of flight-sim: its last flights, so that a restarted process does not fly a slot twice.

use skysink_common::message::FlightReport;
use skysink_ring::error::RingError;
use skysink_ring::folder::RingFolder;
use skysink_ring::journal::Journal;
use skysink_ring::topics::FLIGHT_HISTORY;

/// Saved flights: the last ones, and one that may be cut.
const FLIGHTS: u64 = FLIGHT_HISTORY as u64 + 1;

/// The journal of flight-sim in the ring's folder.
///
/// # Errors
/// If the file cannot be opened.
pub fn journal(folder: &RingFolder) -> Result<Journal, RingError> {
    Journal::open(&folder.journal("flights"), FLIGHTS, size_of::<FlightReport>())
}

/// Saves the flight of a slot. Must be called before it is published.
///
/// # Errors
/// If the file cannot be written.
pub fn save(journal: &Journal, slot: u64, flight: &FlightReport) -> Result<(), RingError> {
    journal.write(slot, &[bytemuck::bytes_of(flight)])
}

/// The last recorded flights, as many as late joiners receive: consecutive slots, ascending.
///
/// # Errors
/// If the file cannot be read.
pub fn restore(journal: &Journal) -> Result<Vec<(u64, FlightReport)>, RingError> {
    let mut flights: Vec<(u64, FlightReport)> = Vec::new();
    for record in journal.read()?.iter().rev() {
        let Ok(flight) = bytemuck::try_pod_read_unaligned(&record.bytes) else { continue };
        match flights.last() {
            Some((later, _)) if record.slot + 1 != *later => break,
            _ => flights.push((record.slot, flight)),
        }
    }
    flights.truncate(FLIGHT_HISTORY);
    flights.reverse();
    Ok(flights)
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::message::Mode;
    use skysink_common::pace::Pace;
    use skysink_ring::wait::Waiting;

    #[test]
    fn the_last_three_flights_are_restored_in_order() {
        let folder = RingFolder::create(Pace::Max, Waiting::Event, 1.0, false, None).unwrap();
        let flights = journal(&folder).unwrap();
        let flight = |slot: u64| FlightReport::at([slot as f64, 0.5, 20.0], Mode::Serve);
        assert_eq!(restore(&flights).unwrap(), []);
        save(&flights, 0, &flight(0)).unwrap();
        assert_eq!(restore(&flights).unwrap(), [(0, flight(0))]);
        for slot in 1..=9 {
            save(&flights, slot, &flight(slot)).unwrap();
            let again = journal(&folder).unwrap();
            let last: Vec<_> = (slot.saturating_sub(2)..=slot).map(|slot| (slot, flight(slot))).collect();
            assert_eq!(restore(&again).unwrap(), last);
        }
        save(&flights, 14, &flight(14)).unwrap(); // 11 to 13 are cut
        assert_eq!(restore(&flights).unwrap(), [(14, flight(14))]);
    }

    #[test]
    fn a_flight_that_is_cut_leaves_the_three_before_it() {
        let folder = RingFolder::create(Pace::Max, Waiting::Event, 1.0, false, None).unwrap();
        let flights = journal(&folder).unwrap();
        let flight = |slot: u64| FlightReport::at([slot as f64, 0.5, 20.0], Mode::Serve);
        (1..=5).for_each(|slot| save(&flights, slot, &flight(slot)).unwrap());
        flights.write(6, &[&[1; 20]]).unwrap();
        assert_eq!(restore(&flights).unwrap(), [3, 4, 5].map(|slot| (slot, flight(slot))));
    }
}
