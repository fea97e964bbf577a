//! flight-sim as a process of the ring: waits for the plan, or for the slot to begin, and publishes the flight.

use iceoryx2::prelude::Service;
use skysink_common::message::{FLAG_END, FLAG_TICK, QueuesHeader};
use skysink_common::node::{NodeError, Role, Stop};
use skysink_common::pace::Pace;
use skysink_common::ring::Ring;
use skysink_common::ring_folder::RingFolder;
use skysink_common::scenario::Scenario;
use skysink_common::topic::RING_BUFFER;

use crate::flight::Flight;

/// Flies until the mission ends.
///
/// # Errors
/// If a peer is missing or wrong, the ring breaks, or `stop` is requested.
pub fn run<S: Service + 'static>(scenario: &Scenario, folder: &RingFolder, stop: &Stop) -> Result<(), NodeError> {
    let ring = Ring::<S>::open(folder, scenario, Role::FlightSim)?;
    let mut patience = ring.patience(folder, stop)?;
    let pace = ring.terms.pace;
    let flights = ring.flight.writer(pace, stop, ring.timeout())?;
    let mut sensors = ring.sensors.reader(RING_BUFFER)?;
    let mut plans = ring.plan.reader(RING_BUFFER)?;
    let mut queues = ring.queues.reader(RING_BUFFER)?;
    let serve_joiners = || -> Result<(), NodeError> { Ok(flights.serve_joiners()?) };

    let nodes = sensors.wait_for(&mut patience, 0, |_| true, serve_joiners)?;
    let mut flight = Flight::new(scenario, nodes.payload());
    flights.send(ring.header(0, 0), flight.start())?;
    for slot in 1..=scenario.slots {
        let plan = match pace {
            Pace::Max => {
                while queues.receive()?.is_some() {} // not needed, but the writer must never wait for this reader
                Some(plans.wait(&mut patience, slot, serve_joiners)?)
            }
            Pace::Factor(_) => {
                let begins = |header: &QueuesHeader| header.head.slot == slot && header.head.flags & FLAG_TICK != 0;
                queues.wait_for(&mut patience, slot, begins, serve_joiners)?;
                plans.take(slot)?
            }
        };
        let report = flight.step(slot, plan.as_ref().map(|plan| plan.payload()));
        flights.send(ring.header(slot, 0), report)?;
    }
    let ended = |header: &QueuesHeader| header.head.flags & FLAG_END != 0;
    queues.wait_for(&mut patience, scenario.slots, ended, serve_joiners)?;
    Ok(())
}
