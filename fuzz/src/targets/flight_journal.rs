//! What flight-sim saves.

use skysink_common::message::FlightReport;
use skysink_flight_sim::journal::{journal, restore, save};

use super::flight_message::report;
use super::place::{in_ring, spoil};
use crate::cursor::Cursor;

/// Flights are saved and the journal is spoilt: whatever is restored was saved, three at most, without a gap; an
/// unspoilt journal restores the last.
///
/// # Panics
/// If not.
pub fn flight_journal(bytes: &[u8]) {
    let mut input = Cursor::new(bytes);
    in_ring(&["flights"], |ring| {
        let flights = journal(ring).expect("the journal opens");
        let mut saved: Vec<(u64, FlightReport)> = Vec::new();
        let mut slot = input.u64();
        for _ in 0..input.u8() % 7 {
            let flight = report(&mut input, 2);
            save(&flights, slot, &flight).expect("the flight is written");
            saved.push((slot, flight));
            slot = slot.saturating_add(u64::from(input.u8() % 4));
        }
        let spoilt = spoil(&ring.journal("flights"), &mut input);
        let restored = journal(ring).and_then(|flights| restore(&flights)).expect("the journal is read");
        assert!(restored.len() <= 3);
        assert!(restored.windows(2).all(|pair| pair[0].0 + 1 == pair[1].0), "{restored:?}");
        for (slot, flight) in &restored {
            let same = |saved: &(u64, FlightReport)| saved.0 == *slot && bytes_of(&saved.1) == bytes_of(flight);
            assert!(saved.iter().any(same), "restored a flight of slot {slot} that was not saved");
        }
        if !spoilt {
            assert_eq!(restored.last().map(|(slot, _)| *slot), saved.iter().map(|(slot, _)| *slot).max());
        }
    });
}

/// Equality of every bit: a report may hold NaN.
fn bytes_of(flight: &FlightReport) -> &[u8] {
    bytemuck::bytes_of(flight)
}
