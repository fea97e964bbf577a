//! flight-sim as a process of the ring: waits for the plan, or for the slot to begin, and publishes the flight.

use iceoryx2::prelude::Service;
use skysink_common::message::{FLAG_END, FlightReport, HoldReason, QueuesHeader};
use skysink_common::pace::Pace;
use skysink_common::scenario::Scenario;
use skysink_common::stop::Stop;
use skysink_ring::error::{NodeError, RingError};
use skysink_ring::folder::RingFolder;
use skysink_ring::refusals::{Refusal, Refusals};
use skysink_ring::role::Role;
use skysink_ring::topics::{Full, RING_BUFFER, Ring};

use crate::flight::Flight;
use crate::memory::Memory;

/// Flies until the mission ends. Started again, it goes on where it was killed: what was flown stays flown, and the last
/// two flights are published once more, because a peer may have died without them.
///
/// # Errors
/// If a peer is missing or wrong, the ring breaks, or `stop` is requested.
pub fn run<S: Service + 'static>(scenario: &Scenario, folder: &RingFolder, stop: &Stop) -> Result<(), NodeError> {
    let seat = folder.take_seat(Role::FlightSim)?;
    let ring = Ring::<S>::open(folder, scenario, Role::FlightSim, &seat)?;
    let mut patience = ring.wait_context(folder, Some(seat), stop)?;
    let pace = ring.terms.pace;
    let flights = ring.flight.writer(Full::of(pace), stop, ring.timeout())?;
    let mut sensors = ring.sensors.reader(RING_BUFFER)?;
    let mut plans = ring.plan.reader(RING_BUFFER)?;
    let mut queues = ring.queues.reader(RING_BUFFER)?;
    let serve_joiners = || -> Result<(), NodeError> { Ok(flights.serve_joiners()?) };

    let nodes = sensors.wait_for(&mut patience, 0, |_| true, serve_joiners)?;
    let mut flight = Flight::new(scenario, nodes.payload());
    let memory = Memory::open(folder).map_err(RingError::from)?;
    let mut flown = memory.recall().map_err(RingError::from)?;
    match flown.last() {
        Some((_, report)) => flight.take_over(report),
        None => flown.push((0, flight.start())),
    }
    let mut next = 0;
    for (slot, report) in flown {
        flights.send(ring.header(slot, 0), report)?;
        next = slot + 1;
    }
    for slot in next..=scenario.slots {
        let plan = match pace {
            Pace::Max => {
                while queues.receive()?.is_some() {} // not needed, but the writer must never wait for this reader
                Some(plans.wait(&mut patience, slot, serve_joiners)?)
            }
            Pace::Factor(_) => {
                // By its tick, or, where this process comes back late, by what came after it.
                let begins = |header: &QueuesHeader| header.head.slot >= slot;
                queues.wait_for(&mut patience, slot, begins, serve_joiners)?;
                plans.take(slot)?
            }
        };
        let report = flight.step(slot, plan.as_ref().map(|plan| plan.payload()));
        drop(plan);
        count_refusals(&ring.refusals, slot, &report);
        memory.keep(slot, &report).map_err(RingError::from)?;
        flights.send(ring.header(slot, 0), report)?;
    }
    let ended = |header: &QueuesHeader| header.head.flags & FLAG_END != 0;
    queues.wait_for(&mut patience, scenario.slots, ended, serve_joiners)?;
    Ok(())
}

/// What was refused of the slot's plan, in words.
fn count_refusals(refusals: &Refusals, slot: u64, report: &FlightReport) {
    if report.refused > 0 {
        let refusal = match HoldReason::of_code(report.hold) {
            HoldReason::Waypoint => Refusal::Waypoint,
            HoldReason::None | HoldReason::NoPlan => Refusal::Sensor,
        };
        refusals.add("plan", slot, refusal, u64::from(report.refused));
    }
}
