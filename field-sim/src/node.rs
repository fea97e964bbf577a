//! field-sim as a process of the ring: publishes the queues, waits for the flight, keeps the slot clock.

use std::time::{Duration, Instant};

use iceoryx2::prelude::Service;
use skysink_common::message::{FLAG_END, FLAG_TICK, QueuesHeader};
use skysink_common::node::{NodeError, Role, Stop};
use skysink_common::ring::Ring;
use skysink_common::ring_folder::RingFolder;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::topic::RING_BUFFER;

use crate::field::{Field, SlotBits};

/// Turns the ring until the mission ends.
///
/// # Errors
/// If a peer is missing or wrong, the ring breaks, or `stop` is requested.
pub fn run<S: Service + 'static>(scenario: &Scenario, folder: &RingFolder, stop: &Stop) -> Result<(), NodeError> {
    let list = SensorList::of(scenario)?;
    let ring = Ring::<S>::open(folder, scenario, Role::FieldSim)?;
    let mut patience = ring.patience(folder, stop)?;
    let (pace, timeout) = (ring.terms.pace, ring.timeout());
    let sensors = ring.sensors.list_writer(list.sensors().len(), pace, stop, timeout)?;
    let queues = ring.queues.list_writer(list.sensors().len(), pace, stop, timeout)?;
    let mut flights = ring.flight.reader(RING_BUFFER)?;
    let mut commits = ring.commit.reader(RING_BUFFER)?;

    let mut field = Field::new(scenario, &list);
    let header = |slot, flags, field: &Field, bits: SlotBits| QueuesHeader {
        head: ring.header(slot, flags),
        totals: *field.totals(),
        delivered_bits: bits.delivered_bits,
        lost_bits: bits.lost_bits,
    };
    let serve_joiners = || -> Result<(), NodeError> {
        sensors.serve_joiners()?;
        Ok(queues.serve_joiners()?)
    };
    sensors.send_list(ring.header(0, 0), &list.nodes(scenario.sensors.capacity_bits))?;
    queues.send_list(header(0, 0, &field, SlotBits::default()), field.queues_bits())?;

    let mut clock = pace.period(scenario.slot_s).map(Clock::new);
    for slot in 1..=scenario.slots {
        if let Some(clock) = &mut clock {
            if slot == 1 {
                commits.wait_until_there(&mut patience, 0, serve_joiners)?; // everybody is here
                clock.start();
            }
            patience.sleep_until(clock.next_slot())?;
            queues.send_list(header(slot, FLAG_TICK, &field, SlotBits::default()), &[])?;
        }
        let flight = flights.wait(&mut patience, slot, serve_joiners)?;
        let bits = field.step(slot, flight.payload()).map_err(|error| NodeError::Peer(error.to_string()))?;
        drop(flight);
        commits.wait(&mut patience, slot - 1, serve_joiners)?;
        let end = if slot == scenario.slots { FLAG_END } else { 0 };
        queues.send_list(header(slot, end, &field, bits), field.queues_bits())?;
    }
    commits.wait(&mut patience, scenario.slots, serve_joiners)?;
    Ok(())
}

/// The starts of the slots on a grid of wall time.
struct Clock {
    period: Duration,
    next: Instant,
}

impl Clock {
    fn new(period: Duration) -> Self {
        Self { period, next: Instant::now() }
    }

    /// Slot 1 begins one period from now, so that its plan has as much time as any other.
    fn start(&mut self) {
        self.next = Instant::now() + self.period;
    }

    /// When the next slot begins. A ring that was held up does not hurry to catch up: the grid moves.
    fn next_slot(&mut self) -> Instant {
        let slot = self.next.max(Instant::now());
        self.next = slot + self.period;
        slot
    }
}
