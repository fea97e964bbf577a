//! What flight-sim remembers.

use skysink_common::message::FlightReport;
use skysink_flight_sim::memory::Memory;

use super::flight_message::report;
use super::place::{in_ring, spoil};
use crate::cursor::Cursor;

/// Flights are remembered and the journal is spoilt: whatever is recalled was remembered, three at most, without a gap; an
/// unspoilt journal recalls the last.
///
/// # Panics
/// If not.
pub fn flight_journal(bytes: &[u8]) {
    let mut input = Cursor::new(bytes);
    in_ring(&["flights"], |ring| {
        let memory = Memory::open(ring).expect("the journal opens");
        let mut kept: Vec<(u64, FlightReport)> = Vec::new();
        let mut slot = input.u64();
        for _ in 0..input.u8() % 7 {
            let flight = report(&mut input, 2);
            memory.keep(slot, &flight).expect("the flight is written");
            kept.push((slot, flight));
            slot = slot.saturating_add(u64::from(input.u8() % 4));
        }
        let spoilt = spoil(&ring.journal("flights"), &mut input);
        let recalled = Memory::open(ring).and_then(|memory| memory.recall()).expect("the journal is read");
        assert!(recalled.len() <= 3);
        assert!(recalled.windows(2).all(|pair| pair[0].0 + 1 == pair[1].0), "{recalled:?}");
        for (slot, flight) in &recalled {
            let same = |kept: &(u64, FlightReport)| kept.0 == *slot && bytes_of(&kept.1) == bytes_of(flight);
            assert!(kept.iter().any(same), "recalled a flight of slot {slot} that was not remembered");
        }
        if !spoilt {
            assert_eq!(recalled.last().map(|(slot, _)| *slot), kept.iter().map(|(slot, _)| *slot).max());
        }
    });
}

/// Equality of every bit: a report may hold NaN.
fn bytes_of(flight: &FlightReport) -> &[u8] {
    bytemuck::bytes_of(flight)
}
