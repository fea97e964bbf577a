//! flight-sim as a process of the ring: waits for the plan, or for the slot to begin, and publishes the flight.

use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::Service;
use skysink_common::message::{FLAG_END, FLAG_TICK, QueuesHeader};
use skysink_common::node::{NodeError, Patience, Role, Stop};
use skysink_common::pace::Pace;
use skysink_common::ring::Ring;
use skysink_common::ring_folder::RingFolder;
use skysink_common::scenario::Scenario;
use skysink_common::topic::{RING_BUFFER, Reader};

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
    let (mut plans, plan_bell) = (ring.plan.reader(RING_BUFFER)?, ring.plan.listener()?);
    let (mut sensors, sensor_bell) = (ring.sensors.reader(RING_BUFFER)?, ring.sensors.listener()?);
    let mut ticks = Ticks { queues: ring.queues.reader(RING_BUFFER)?, bell: ring.queues.listener()? };
    let serve_joiners = || -> Result<(), NodeError> { Ok(flights.serve_joiners()?) };

    let listed = ("sensors", 0, Role::FieldSim);
    let nodes = patience.wait(&sensor_bell, listed, || Ok(sensors.receive()?), serve_joiners)?;
    let mut flight = Flight::new(scenario, nodes.payload());
    flights.send(ring.header(0, 0), flight.start())?;
    for slot in 1..=scenario.slots {
        let planned = ("plan", slot, Role::Planner);
        let plan = match pace {
            Pace::Max => {
                ticks.skip()?;
                Some(patience.wait(&plan_bell, planned, || Ok(plans.take(slot)?), serve_joiners)?)
            }
            Pace::Factor(_) => {
                ticks.wait(&mut patience, "queues", slot, FLAG_TICK, serve_joiners)?;
                plans.take(slot)?
            }
        };
        let report = flight.step(slot, plan.as_ref().map(|plan| plan.payload()));
        flights.send(ring.header(slot, 0), report)?;
    }
    ticks.wait(&mut patience, "queues", scenario.slots, FLAG_END, serve_joiners)
}

/// What flight-sim reads of the queues: when a slot begins, and when the mission has ended.
struct Ticks<S: Service + 'static> {
    queues: Reader<S, [u32], QueuesHeader>,
    bell: Listener<S>,
}

impl<S: Service + 'static> Ticks<S> {
    /// Drops what has arrived, so that the writer never waits for this reader.
    fn skip(&mut self) -> Result<(), NodeError> {
        while self.queues.receive()?.is_some() {}
        Ok(())
    }

    /// Waits for the sample of `slot` with `flag`.
    fn wait(
        &mut self,
        patience: &mut Patience,
        what: &str,
        slot: u64,
        flag: u32,
        idle: impl FnMut() -> Result<(), NodeError>,
    ) -> Result<(), NodeError> {
        let look = || {
            while let Some(sample) = self.queues.receive()? {
                let head = sample.user_header().head;
                if head.slot == slot && head.flags & flag != 0 {
                    return Ok(Some(()));
                }
            }
            Ok(None)
        };
        patience.wait(&self.bell, (what, slot, Role::FieldSim), look, idle)
    }
}
