//! What field-sim remembers across its own death: the state of the field now and then, and every flight since.
//!
//! A state is as large as the field, a flight is not: so a slot costs the same however many sensor nodes there are.

use bytemuck::{Pod, Zeroable};
use skysink_common::ledger::Totals;
use skysink_common::message::FlightReport;
use skysink_ring::error::JournalError;
use skysink_ring::folder::RingFolder;
use skysink_ring::journal::{Journal, Record};

use crate::field::{Field, SlotBits};

/// Slots from one state to the next.
const STATE_EVERY: u64 = 64;

/// Flights since the state before the last, which counts where the last is cut.
const FLIGHTS: u64 = 2 * STATE_EVERY + 2;

/// The journals of field-sim.
#[derive(Debug)]
pub struct Memory {
    states: Journal,
    flights: Journal,
}

/// A state, before its queues.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct StateHead {
    slot: u64,
    totals: Totals,
    delivered_bits: u64,
    lost_bits: u64,
}

/// Where a field has got to.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Reached {
    /// The slot that is over.
    pub slot: u64,
    /// What it moved.
    pub bits: SlotBits,
}

impl Memory {
    /// The memory of a field of `count` sensor nodes in the ring's folder.
    ///
    /// # Errors
    /// If a file cannot be opened.
    pub fn open(folder: &RingFolder, count: usize) -> Result<Self, JournalError> {
        let room = size_of::<StateHead>() + count * size_of::<u32>();
        Ok(Self {
            states: Journal::open(&folder.journal("field-states"), 2, room)?,
            flights: Journal::open(&folder.journal("field-flights"), FLIGHTS, size_of::<FlightReport>())?,
        })
    }

    /// Remembers the flight of a slot; to be done before what it leads to is published.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn add(&self, slot: u64, flight: &FlightReport) -> Result<(), JournalError> {
        self.flights.write(slot, &[bytemuck::bytes_of(flight)])
    }

    /// Remembers the state of the field now and then.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn rest(&self, reached: Reached, field: &Field) -> Result<(), JournalError> {
        if reached.slot.is_multiple_of(STATE_EVERY) { self.keep(reached, field) } else { Ok(()) }
    }

    /// Remembers the state of the field.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn keep(&self, reached: Reached, field: &Field) -> Result<(), JournalError> {
        let Reached { slot, bits: SlotBits { delivered_bits, lost_bits } } = reached;
        let head = StateHead { slot, totals: *field.totals(), delivered_bits, lost_bits };
        let parts = [bytemuck::bytes_of(&head), bytemuck::cast_slice(field.queues_bits())];
        self.states.write(slot / STATE_EVERY, &parts)
    }

    /// Brings a field before slot 1 to the last slot but one that is remembered, and returns where that is and the
    /// flight of the last: so that both are published again, because a peer may have died without them.
    ///
    /// # Errors
    /// If the files cannot be read.
    pub fn recall(&self, field: &mut Field) -> Result<(Reached, Option<FlightReport>), JournalError> {
        let mut reached = Reached::default();
        let flights = self.flights.read()?;
        let newest = flights.last().map_or(u64::MAX, |flight| flight.slot);
        for state in self.states.read()?.iter().rev() {
            if let Some(found) = take_over(field, state, newest) {
                reached = found;
                break;
            }
        }
        let mut last = None;
        for record in flights {
            let Ok(flight) = bytemuck::try_pod_read_unaligned::<FlightReport>(&record.bytes) else { break };
            if record.slot <= reached.slot {
                continue;
            }
            if let Some(flight) = last.take() {
                let Ok(bits) = field.step(reached.slot + 1, &flight) else { break };
                reached = Reached { slot: reached.slot + 1, bits };
            }
            if record.slot != reached.slot + 1 {
                break;
            }
            last = Some(flight);
        }
        Ok((reached, last))
    }
}

/// Brings the field to a remembered state, if it is one of a slot before `newest`.
fn take_over(field: &mut Field, state: &Record, newest: u64) -> Option<Reached> {
    let (head, queues) = state.bytes.split_at_checked(size_of::<StateHead>())?;
    let head: StateHead = bytemuck::pod_read_unaligned(head);
    if head.slot >= newest {
        return None;
    }
    let queues: Vec<u32> = queues.as_chunks().0.iter().map(|bytes| u32::from_le_bytes(*bytes)).collect();
    let bits = SlotBits { delivered_bits: head.delivered_bits, lost_bits: head.lost_bits };
    field.take_over(&queues, head.totals).then_some(Reached { slot: head.slot, bits })
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

    #[test]
    fn a_field_comes_back_to_the_slot_before_the_last_with_the_flight_of_the_last() {
        let folder = RingFolder::create(Pace::Max, Waiting::Event, 1.0, false).unwrap();
        let mut lived = field();
        let mut before = (lived.clone(), Reached::default());
        for slot in 1..=300 {
            let memory = Memory::open(&folder, 200).unwrap();
            memory.add(slot, &flight(slot)).unwrap();
            let mut recalled = field();
            let (reached, last) = memory.recall(&mut recalled).unwrap();
            assert_eq!((reached, last), (before.1, Some(flight(slot))), "slot {slot}");
            assert_eq!((recalled.queues_bits(), recalled.totals()), (before.0.queues_bits(), before.0.totals()));
            let bits = lived.step(slot, &flight(slot)).unwrap();
            before = (lived.clone(), Reached { slot, bits });
            let last_but_one = memory.recall(&mut field()).unwrap();
            memory.rest(before.1, &lived).unwrap();
            assert_eq!(memory.recall(&mut field()).unwrap(), last_but_one, "slot {slot}: a state changes nothing");
        }
    }

    #[test]
    fn a_kept_state_is_enough() {
        let folder = RingFolder::create(Pace::Max, Waiting::Event, 1.0, false).unwrap();
        let memory = Memory::open(&folder, 200).unwrap();
        let mut lived = field();
        assert_eq!(memory.recall(&mut field()).unwrap(), (Reached::default(), None));
        let mut bits = SlotBits::default();
        for slot in 1..=77 {
            bits = lived.step(slot, &flight(slot)).unwrap();
        }
        memory.keep(Reached { slot: 77, bits }, &lived).unwrap();
        let mut recalled = field();
        assert_eq!(memory.recall(&mut recalled).unwrap(), (Reached { slot: 77, bits }, None));
        assert_eq!(recalled.queues_bits(), lived.queues_bits());
        // and on from there
        memory.add(78, &flight(78)).unwrap();
        memory.add(79, &flight(79)).unwrap();
        let (reached, last) = memory.recall(&mut field()).unwrap();
        assert_eq!((reached.slot, last), (78, Some(flight(79))));
    }

    #[test]
    fn a_state_of_another_field_does_not_count() {
        let folder = RingFolder::create(Pace::Max, Waiting::Event, 1.0, false).unwrap();
        let memory = Memory::open(&folder, 200).unwrap();
        memory.states.write(1, &[&[1; 20]]).unwrap();
        memory.states.write(2, &[&[0; 400]]).unwrap();
        let mut recalled = field();
        assert_eq!(memory.recall(&mut recalled).unwrap().0.slot, 0);
        assert_eq!(recalled.queues_bits(), field().queues_bits());
    }
}
