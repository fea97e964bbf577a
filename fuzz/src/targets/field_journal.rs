//! What field-sim saves.

use std::sync::LazyLock;

use skysink_common::message::{FlightReport, LinkReport, Mode};
use skysink_field_sim::Field;
use skysink_field_sim::journal::FieldJournal;
use skysink_ring::folder::RingFolder;
use skysink_ring::journal::Journal;

use super::flight_message::{balanced, report};
use super::place::{in_ring, spoil};
use super::world::WORLDS;
use crate::cursor::Cursor;

const JOURNAL: &str = "field";

/// Slots flown, with two states among them beside the first.
const FLOWN_SLOTS: u64 = 140;

/// The first world from the beginning, and the flight of each slot: another sensor node is served in each.
static FLOWN: LazyLock<Vec<(FlightReport, Field)>> = LazyLock::new(|| {
    let [world, ..] = &*WORLDS;
    let mut scenario = world.scenario.clone();
    scenario.slots = FLOWN_SLOTS;
    let mut field = Field::new(&scenario, &world.list);
    let nobody = FlightReport::at([1.0, 2.0, 20.0], Mode::Hold);
    let mut flown = vec![(nobody, field.clone())];
    for slot in 1..FLOWN_SLOTS {
        let mut flight = FlightReport::at([1.0, 2.0, 20.0], Mode::Serve);
        let sensor = u32::try_from(slot % 10).expect("below 10");
        flight.links[0] = LinkReport { sensor, capacity_bits: 7 * slot, ..LinkReport::default() };
        flight.served = 1;
        field.step(slot, &flight).expect("the sensor node is known");
        flown.push((flight, field.clone()));
    }
    flown
});

/// From the spoilt journal of a field comes a state that it has been in; from a journal that somebody else has written
/// comes a field whose ledger balances.
///
/// # Panics
/// If not.
pub fn field_journal(bytes: &[u8]) {
    let mut input = Cursor::new(bytes);
    let [world, ..] = &*WORLDS;
    let mut field = FLOWN[0].1.clone();
    let foreign = input.u8() % 2 == 1;
    in_ring(&[JOURNAL], |ring| {
        if foreign { forged(ring, &mut field, &mut input) } else { saved(ring, &mut field, &mut input) }
    });
    balanced(&field, world.scenario.sensors.capacity_bits);
}

/// Saves some slots, spoils the journal and compares what is restored with what was.
fn saved(ring: &RingFolder, field: &mut Field, input: &mut Cursor) {
    let slots = u64::from(input.u8()) % FLOWN_SLOTS;
    let (mut journal, _) = FieldJournal::open(ring, field).expect("the journal opens");
    for (flight, field) in FLOWN.iter().skip(1).take(slots as usize) {
        journal.save(flight, field).expect("the slot is written");
    }
    let spoilt = spoil(&ring.journal(JOURNAL), input);
    let (_, last) = FieldJournal::open(ring, field).expect("the journal is read");
    assert!(field.slot() <= slots && *field == FLOWN[field.slot() as usize].1, "{}", field.slot());
    if let Some(last) = last {
        assert_eq!(FLOWN[field.slot() as usize + 1].0, last);
    }
    if !spoilt {
        assert_eq!((field.slot(), last.is_some()), (slots.saturating_sub(1), slots > 0));
    }
}

/// Writes flights and states of any numbers, whole and with their hashes, and restores them.
fn forged(ring: &RingFolder, field: &mut Field, input: &mut Cursor) {
    let room = size_of::<FlightReport>() + 200;
    let journal = Journal::open(&ring.journal(JOURNAL), 128, room).expect("the journal opens");
    let slot = input.u64();
    for next in 0..u64::from(input.u8() % 5) {
        let flight = report(input, 2);
        let state = input.bytes(200).to_vec();
        let state = if input.u8().is_multiple_of(2) { &state[..] } else { &[] };
        let parts = [bytemuck::bytes_of(&flight), state];
        journal.write(slot.wrapping_add(next), &parts).expect("the slot is written");
    }
    let _ = FieldJournal::open(ring, field).expect("the journal is read");
}
