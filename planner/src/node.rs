//! planner as a process of the ring: answers the queues of a slot with the plan of the next.

use std::time::{Duration, Instant};

use iceoryx2::prelude::Service;
use skysink_common::message::{FLAG_END, FLAG_TICK, QueuesHeader, SlotHeader};
use skysink_common::pace::Pace;
use skysink_common::path::{MAX_POINTS, PathPoint};
use skysink_common::scenario::Scenario;
use skysink_common::stop::Stop;
use skysink_ring::error::{NodeError, RingError};
use skysink_ring::folder::RingFolder;
use skysink_ring::reader::Found;
use skysink_ring::refusals::Refusal;
use skysink_ring::role::Role;
use skysink_ring::topics::{Full, RING_BUFFER, Ring};
use skysink_ring::writer::Writer;

use crate::planner::Planner;
use crate::recollection::Recollection;
use crate::settings::Settings;

/// Plans until the mission ends. Started again, it answers what the others still have, as it did before.
///
/// # Errors
/// If a peer is missing or wrong, the ring breaks, or `stop` is requested.
pub fn run<S: Service + 'static>(scenario: &Scenario, folder: &RingFolder, stop: &Stop) -> Result<(), NodeError> {
    let settings = Settings::of(scenario)?;
    let seat = folder.take_seat(Role::Planner)?;
    let ring = Ring::<S>::open(folder, scenario, Role::Planner, &seat)?;
    let mut patience = ring.wait_context(folder, Some(seat), stop)?;
    // Before the plans, so that whoever has a plan finds the writer of its path.
    let path_writer = || ring.path.list_writer(MAX_POINTS, Full::Miss, stop, ring.timeout());
    let paths = settings.strategy.has_path().then(path_writer).transpose()?;
    let plans = ring.plan.writer(Full::of(ring.terms.pace), stop, ring.timeout())?;
    let mut sensors = ring.sensors.reader(RING_BUFFER)?;
    let mut queues = ring.queues.reader(RING_BUFFER)?;
    let mut flights = ring.flight.reader(RING_BUFFER)?;
    let serve_joiners = || -> Result<(), NodeError> {
        plans.serve_joiners()?;
        Ok(paths.as_ref().map_or(Ok(()), Writer::serve_joiners)?)
    };

    let nodes = sensors.wait_for(&mut patience, 0, |_| true, serve_joiners)?;
    let mut planner = Planner::new(scenario, nodes.payload())?;
    if let Pace::Factor(_) = ring.terms.pace {
        planner.limit(settings.horizon.budget_ms.map(Duration::from));
    }
    let mut recollection = Recollection::open(folder, &planner, nodes.payload().len()).map_err(RingError::from)?;
    let mut next = 0;
    loop {
        let is_state = |header: &QueuesHeader| header.head.flags & FLAG_TICK == 0;
        let mut state = queues.wait_for(&mut patience, next, is_state, serve_joiners)?;
        if let Pace::Factor(_) = ring.terms.pace {
            // Only the newest is planned for, because a plan for a slot that has begun is void; what the UAV was told in
            // the others counts all the same.
            while let Some(newer) = queues.receive()? {
                if !is_state(newer.user_header()) {
                    continue;
                }
                let older = std::mem::replace(&mut state, newer);
                let slot = older.user_header().head.slot;
                if slot >= next
                    && let Found::Here(flight) = flights.look_for(slot)?
                {
                    recollection.before(slot + 1, &mut planner).map_err(RingError::from)?;
                    planner.observe(slot, &flight, older.payload());
                }
            }
        }
        let SlotHeader { slot, flags, .. } = state.user_header().head;
        if flags & FLAG_END != 0 {
            return Ok(());
        }
        if slot < next {
            continue; // a field-sim that was started again repeats itself; the plan is there for whoever needs it
        }
        if state.payload().len() != nodes.payload().len() {
            ring.refusals.add("queues", slot, Refusal::Length, 1);
            continue;
        }
        // A writer that waits for another reader's buffer may reach this one later than the queues do. A flight that has
        // passed was sent before this process was there: others have flown on since, so its plan is not missing.
        let Some(flight) = flights.wait_or_pass(&mut patience, slot, serve_joiners)? else { continue };
        next = slot + 1;
        recollection.before(next, &mut planner).map_err(RingError::from)?;
        let begin = Instant::now();
        planner.observe(slot, &flight, state.payload());
        let mut plan = planner.step(next, &flight.position(), flight.z_m, state.payload());
        plan.plan_ns = u64::try_from(begin.elapsed().as_nanos()).unwrap_or(u64::MAX);
        recollection.after(next, &planner).map_err(RingError::from)?;
        if let (Some(paths), [_, _, ..]) = (&paths, planner.path()) {
            let path: Vec<_> = planner.path().iter().copied().map(PathPoint::from).collect();
            paths.send_list(ring.header(next, 0), &path)?; // whoever has the plan then has the path
        }
        plans.send(ring.header(next, 0), plan)?;
    }
}
