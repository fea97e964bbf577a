//! field-sim as a process of the ring: publishes the queues, waits for the flight, keeps the slot clock.

use std::time::{Duration, Instant};

use iceoryx2::prelude::Service;
use skysink_common::message::{FLAG_END, FLAG_TICK, QueuesHeader, SlotHeader};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_ring::error::{NodeError, RingError};
use skysink_ring::folder::RingFolder;
use skysink_ring::role::Role;
use skysink_ring::topics::{Full, RING_BUFFER, Ring};

use crate::field::{Field, SlotBits};
use crate::memory::{Memory, Reached};

/// Turns the ring until the mission ends. Started again, it goes on where it was killed: it publishes the last two slots
/// that it remembers once more, because a peer may have died without them.
///
/// # Errors
/// If a peer is missing or wrong, the ring breaks, or `stop` is requested.
pub fn run<S: Service + 'static>(scenario: &Scenario, folder: &RingFolder, stop: &Stop) -> Result<(), NodeError> {
    let list = SensorList::of(scenario)?;
    let seat = folder.take_seat(Role::FieldSim)?;
    let ring = Ring::<S>::open(folder, scenario, Role::FieldSim, &seat)?;
    let mut patience = ring.wait_context(folder, Some(seat), stop)?;
    let (pace, full, timeout) = (ring.terms.pace, Full::of(ring.terms.pace), ring.timeout());
    let sensors = ring.sensors.list_writer(list.sensors().len(), full, stop, timeout)?;
    let queues = ring.queues.list_writer(list.sensors().len(), full, stop, timeout)?;
    let mut flights = ring.flight.reader(RING_BUFFER)?;
    let mut commits = ring.commit.reader(RING_BUFFER)?;

    let mut field = Field::new(scenario, &list);
    let memory = Memory::open(folder, list.sensors().len()).map_err(RingError::from)?;
    let (mut reached, mut remembered) = memory.recall(&mut field).map_err(RingError::from)?;
    let header = |slot, flags, field: &Field, bits: SlotBits| QueuesHeader {
        head: ring.header(slot, flags),
        totals: *field.totals(),
        delivered_bits: bits.delivered_bits,
        lost_bits: bits.lost_bits,
    };
    let state = |reached: Reached, field: &Field| {
        let end = if reached.slot == scenario.slots { FLAG_END } else { 0 };
        header(reached.slot, end, field, reached.bits)
    };
    let serve_joiners = || -> Result<(), NodeError> {
        sensors.serve_joiners()?;
        Ok(queues.serve_joiners()?)
    };
    sensors.send_list(ring.header(0, 0), &list.nodes())?;
    queues.send_list(state(reached, &field), field.queues_bits())?;

    let mut clock = pace.period(scenario.slot_s).map(Clock::new);
    for slot in reached.slot + 1..=scenario.slots {
        let flight = match remembered.take() {
            Some(flight) => flight,
            None => {
                if let Some(clock) = &mut clock {
                    if !clock.started {
                        commits.wait_until_there(&mut patience, slot - 1, serve_joiners)?; // everybody is here
                        clock.start();
                    }
                    patience.sleep_until(clock.next_slot(), serve_joiners)?;
                    queues.send_list(header(slot, FLAG_TICK, &field, SlotBits::default()), &[])?;
                }
                *flights.wait(&mut patience, slot, serve_joiners)?.payload()
            }
        };
        let mut message = queues.blank(list.sensors().len())?;
        let bits = field.step_into(slot, &flight, message.places());
        let bits = bits.map_err(|error| NodeError::Peer(error.to_string()))?;
        memory.add(slot, &flight).map_err(RingError::from)?;
        commits.wait_or_pass(&mut patience, slot - 1, serve_joiners)?; // where a later slot is on record, it is, too
        reached = Reached { slot, bits };
        // SAFETY: the step has not failed, so it has written every place.
        unsafe { message.send(state(reached, &field)) }?;
        memory.rest(reached, &field).map_err(RingError::from)?;
    }
    // The others end with the last queues. Those who are started again must find them, and those who lag in a paced run,
    // whose buffers may have been full.
    let end = || -> Result<(), NodeError> {
        serve_joiners()?;
        match full {
            Full::Wait => Ok(()),
            Full::Miss => Ok(queues.send_list(state(reached, &field), field.queues_bits())?),
        }
    };
    let ended = |header: &SlotHeader| header.flags & FLAG_END != 0;
    commits.wait_for(&mut patience, scenario.slots, ended, end)?;
    Ok(())
}

/// The starts of the slots on a grid of wall time.
struct Clock {
    period: Duration,
    next: Instant,
    started: bool,
}

impl Clock {
    fn new(period: Duration) -> Self {
        Self { period, next: Instant::now(), started: false }
    }

    /// The first slot begins one period from now, so that its plan has as much time as any other.
    fn start(&mut self) {
        self.started = true;
        self.next = Instant::now() + self.period;
    }

    /// When the next slot begins. A ring that was held up does not hurry to catch up: the grid moves.
    fn next_slot(&mut self) -> Instant {
        let slot = self.next.max(Instant::now());
        self.next = slot + self.period;
        slot
    }
}
