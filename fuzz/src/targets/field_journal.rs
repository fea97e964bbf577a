//! What field-sim remembers.

use std::sync::LazyLock;

use skysink_common::ledger::Totals;
use skysink_common::message::{FlightReport, LinkReport, Mode};
use skysink_field_sim::Field;
use skysink_field_sim::memory::{Memory, Reached};
use skysink_ring::folder::RingFolder;
use skysink_ring::journal::Journal;

use super::flight_message::{balanced, report};
use super::place::{in_ring, spoil};
use super::world::WORLDS;
use crate::cursor::Cursor;

const STATES: &str = "field-states";
const FLIGHTS: &str = "field-flights";

/// Slots of a life, with two states in it.
const LIFE_SLOTS: u64 = 140;

/// A slot that was lived through.
struct Lived {
    flight: FlightReport,
    reached: Reached,
    field: Field,
}

/// A life over the first world, from the beginning: another sensor node is served in each slot.
static LIFE: LazyLock<Vec<Lived>> = LazyLock::new(|| {
    let [world, ..] = &*WORLDS;
    let mut field = Field::new(&world.scenario, &world.list);
    let nobody = FlightReport::at([1.0, 2.0, 20.0], Mode::Hold);
    let mut life = vec![Lived { flight: nobody, reached: Reached::default(), field: field.clone() }];
    for slot in 1..LIFE_SLOTS {
        let mut flight = FlightReport::at([1.0, 2.0, 20.0], Mode::Serve);
        let sensor = u32::try_from(slot % 10).expect("below 10");
        flight.links[0] = LinkReport { sensor, capacity_bits: 7 * slot, ..LinkReport::default() };
        flight.served = 1;
        let bits = field.step(slot, &flight).expect("the sensor node is known");
        life.push(Lived { flight, reached: Reached { slot, bits }, field: field.clone() });
    }
    life
});

/// From the journals of a field that has lived, spoilt, comes a state that it has lived through; from journals that
/// somebody else has written comes a field whose books agree.
///
/// # Panics
/// If not.
pub fn field_journal(bytes: &[u8]) {
    let mut input = Cursor::new(bytes);
    let [world, ..] = &*WORLDS;
    let mut field = LIFE[0].field.clone();
    let foreign = input.u8() % 2 == 1;
    in_ring(&[STATES, FLIGHTS], |ring| {
        let memory = Memory::open(ring, field.queues_bits().len()).expect("the journals open");
        if foreign {
            forged(ring, &memory, &mut field, &mut input);
        } else {
            lived(ring, &memory, &mut field, &mut input);
        }
    });
    balanced(&field, world.scenario.sensors.capacity_bits);
}

/// Remembers some slots of a life, spoils a journal and compares what is recalled with what was.
fn lived(ring: &RingFolder, memory: &Memory, field: &mut Field, input: &mut Cursor) {
    let slots = u64::from(input.u8()) % LIFE_SLOTS;
    for Lived { flight, reached, field } in LIFE.iter().skip(1).take(slots as usize) {
        memory.add(reached.slot, flight).expect("the flight is written");
        memory.rest(*reached, field).expect("the state is written");
    }
    let spoilt = spoil(&ring.journal(if input.u8().is_multiple_of(2) { STATES } else { FLIGHTS }), input);
    let (reached, last) = memory.recall(field).expect("the journals are read");
    let was = &LIFE[reached.slot as usize];
    assert!(reached == was.reached && reached.slot <= slots, "{reached:?}");
    assert_eq!((field.queues_bits(), field.totals()), (was.field.queues_bits(), was.field.totals()));
    if let Some(last) = last {
        assert_eq!(LIFE[reached.slot as usize + 1].flight, last);
    }
    if !spoilt {
        assert_eq!((reached.slot, last.is_some()), (slots.saturating_sub(1), slots > 0));
    }
}

/// Writes states and flights of any numbers, whole and with their hashes, and recalls them.
fn forged(ring: &RingFolder, memory: &Memory, field: &mut Field, input: &mut Cursor) {
    let head = size_of::<u64>() * 3 + size_of::<Totals>();
    let room = head + size_of_val(field.queues_bits());
    let states = Journal::open(&ring.journal(STATES), 2, room).expect("the journal opens");
    let slot = input.u64();
    for _ in 0..input.u8() % 3 {
        let (place, state) = (input.u64(), input.bytes(room - 8));
        states.write(place, &[&slot.to_le_bytes(), state]).expect("the state is written");
    }
    for next in 1..=u64::from(input.u8() % 4) {
        let flight = report(input, 2);
        memory.add(slot.wrapping_add(next), &flight).expect("the flight is written");
    }
    let (reached, _) = memory.recall(field).expect("the journals are read");
    assert!(reached == Reached::default() || reached.slot >= slot || reached.slot < 4, "{reached:?}");
}
