//! planner as a process of the ring: answers the queues of a slot with the plan of the next.

use std::time::Instant;

use iceoryx2::prelude::Service;
use skysink_common::message::{FLAG_END, FLAG_TICK};
use skysink_common::node::{NodeError, Role, Stop};
use skysink_common::ring::Ring;
use skysink_common::ring_folder::RingFolder;
use skysink_common::scenario::Scenario;
use skysink_common::topic::RING_BUFFER;

use crate::planner::Planner;

/// Plans until the mission ends. It keeps nothing between slots: of the queues that have arrived only the newest count.
///
/// # Errors
/// If a peer is missing or wrong, the ring breaks, or `stop` is requested.
pub fn run<S: Service + 'static>(scenario: &Scenario, folder: &RingFolder, stop: &Stop) -> Result<(), NodeError> {
    let ring = Ring::<S>::open(folder, scenario, Role::Planner)?;
    let mut patience = ring.patience(folder, stop)?;
    let plans = ring.plan.writer(ring.terms.pace, stop, ring.timeout())?;
    let (mut sensors, sensor_bell) = (ring.sensors.reader(RING_BUFFER)?, ring.sensors.listener()?);
    let (mut queues, queue_bell) = (ring.queues.reader(RING_BUFFER)?, ring.queues.listener()?);
    let mut flights = ring.flight.reader(RING_BUFFER)?;
    let serve_joiners = || -> Result<(), NodeError> { Ok(plans.serve_joiners()?) };

    let listed = ("sensors", 0, Role::FieldSim);
    let nodes = patience.wait(&sensor_bell, listed, || Ok(sensors.receive()?), serve_joiners)?;
    let mut planner = Planner::new(scenario, nodes.payload());
    let (mut next, mut state) = (0, None);
    loop {
        let look = || {
            while let Some(sample) = queues.receive()? {
                if sample.user_header().head.flags & FLAG_TICK == 0 {
                    state = Some(sample);
                }
            }
            let Some(queues) = &state else { return Ok(None) };
            let head = queues.user_header().head;
            if head.flags & FLAG_END != 0 {
                return Ok(Some(None));
            }
            let flight = flights.take(head.slot)?; // sent before the queues, but a joiner may be connected to it later
            Ok(flight.and_then(|flight| state.take().map(|queues| Some((queues, flight)))))
        };
        let Some((queues, flight)) =
            patience.wait(&queue_bell, ("queues", next, Role::FieldSim), look, serve_joiners)?
        else {
            return Ok(());
        };
        next = queues.user_header().head.slot + 1;
        let begin = Instant::now();
        let mut plan = planner.step(next, &flight.position(), queues.payload());
        plan.plan_ns = u64::try_from(begin.elapsed().as_nanos()).unwrap_or(u64::MAX);
        plans.send(ring.header(next, 0), plan)?;
    }
}
