//! The recorder: reads every slot off the ring, puts it on record, and commits it to field-sim.

use std::time::{Duration, Instant};

use iceoryx2::prelude::Service;
use skysink_common::message::{Commit, FLAG_TICK, FlightReport, HoldReason, Plan, QueuesHeader};
use skysink_common::node::{NodeError, Patience, Role};
use skysink_common::ring::{Ring, VIEWER_READY};
use skysink_common::topic::{CommitTopic, Reader, VIEWER_BUFFER, Writer};

use crate::error::Error;
use crate::record::SlotLog;
use crate::summary::Tally;

/// How often the surroundings of the ring are looked after.
const CARE: Duration = Duration::from_millis(100);

/// Puts a mission on record while the ring turns.
pub struct Recorder<'a, S: Service + 'static> {
    ring: &'a Ring<S>,
    bell: iceoryx2::port::listener::Listener<S>,
    queues: Reader<S, [u32], QueuesHeader>,
    plans: Reader<S, Plan, skysink_common::message::SlotHeader>,
    flights: Reader<S, FlightReport, skysink_common::message::SlotHeader>,
    commits: Writer<S, Commit, skysink_common::message::SlotHeader>,
    viewer_bell: iceoryx2::port::listener::Listener<S>,
    cared: Instant,
}

impl<'a, S: Service + 'static> Recorder<'a, S> {
    /// Connects to the ring; to be done before any other process is started.
    ///
    /// # Errors
    /// If a topic cannot be read or written.
    pub fn new(ring: &'a Ring<S>, stop: &skysink_common::node::Stop) -> Result<Self, Error> {
        Ok(Self {
            ring,
            bell: ring.queues.listener()?,
            queues: ring.queues.reader(VIEWER_BUFFER)?,
            plans: ring.plan.reader(VIEWER_BUFFER)?,
            flights: ring.flight.reader(VIEWER_BUFFER)?,
            commits: CommitTopic::writer(&ring.commit, ring.terms.pace, stop, ring.timeout())?,
            viewer_bell: ring.commit.listener()?,
            cared: Instant::now(),
        })
    }

    /// Records `slots` slots into the log and the tally, and returns the wall time from the first to the last. `care`
    /// looks after the processes every tenth of a second, and may end the run.
    ///
    /// # Errors
    /// Those of `care` and of the log; a peer that is missing or wrong, a broken ring, or a requested stop.
    pub fn record(
        &mut self,
        slots: u64,
        patience: &mut Patience,
        log: &mut SlotLog,
        tally: &mut Tally,
        mut care: impl FnMut(&Tally) -> Result<(), Error>,
    ) -> Result<Duration, Error> {
        let header = self.assemble(patience, |tally_now| care(tally_now), tally)?;
        tally.start(&header);
        self.commit(0, 0)?;
        let begin = Instant::now();
        for slot in 1..=slots {
            let header = self.wait_for_queues(slot, patience, &mut care, tally)?;
            let missing = || NodeError::Peer(format!("queues({slot}) came without flight({slot})"));
            let flight = self.flights.take(slot)?.ok_or_else(missing)?;
            let plan = self.plans.take(slot)?;
            let in_time = HoldReason::of_code(flight.payload().hold) != HoldReason::NoPlan;
            let plan = plan.as_ref().map(|plan| plan.payload()).filter(|_| in_time);
            let hash = log.add(flight.payload(), &header)?;
            tally.add(plan, flight.payload(), &header);
            self.commit(slot, hash)?;
        }
        Ok(begin.elapsed())
    }

    /// Waits until every process has shown itself, and returns the state before slot 1. The viewer must be connected
    /// before the ring turns, or it would miss the first slots.
    fn assemble(
        &mut self,
        patience: &mut Patience,
        mut care: impl FnMut(&Tally) -> Result<(), Error>,
        tally: &Tally,
    ) -> Result<QueuesHeader, Error> {
        let header = self.wait_for_queues(0, patience, &mut care, tally)?;
        let (flights, plans, viewer) = (&mut self.flights, &mut self.plans, self.ring.terms.viewer);
        let mut present = Vec::from([(Role::FlightSim, "flight", 0), (Role::Planner, "plan", 1)]);
        if viewer {
            present.push((Role::Viewer, "viewer ready", 0));
        }
        for (role, what, slot) in present {
            let mut cared = Ok(());
            let look = || {
                cared = care(tally);
                if cared.is_err() {
                    return Ok(Some(()));
                }
                let here = match role {
                    Role::FlightSim => flights.peek(slot)?,
                    Role::Planner => plans.peek(slot)?,
                    _ => {
                        let mut ready = false;
                        let _ = self.viewer_bell.try_wait(|event| ready |= event.id.as_value() == VIEWER_READY);
                        ready
                    }
                };
                Ok(here.then_some(()))
            };
            patience.wait(&self.bell, (what, slot, role), look, || Ok(()))?;
            cared?;
        }
        Ok(header)
    }

    /// Waits for the queues after `slot`.
    fn wait_for_queues(
        &mut self,
        slot: u64,
        patience: &mut Patience,
        care: &mut impl FnMut(&Tally) -> Result<(), Error>,
        tally: &Tally,
    ) -> Result<QueuesHeader, Error> {
        let mut cared = Ok(());
        let (queues, last_care, commits) = (&mut self.queues, &mut self.cared, &self.commits);
        let look = || {
            let now = Instant::now();
            if now - *last_care >= CARE {
                *last_care = now;
                cared = care(tally);
                if cared.is_err() {
                    return Ok(Some(QueuesHeader::default()));
                }
            }
            while let Some(sample) = queues.receive()? {
                let header = *sample.user_header();
                if header.head.flags & FLAG_TICK == 0 && header.head.slot == slot {
                    return Ok(Some(header));
                }
            }
            Ok(None)
        };
        let from = ("queues", slot, Role::FieldSim);
        let header = patience.wait(&self.bell, from, look, || Ok(commits.serve_joiners()?))?;
        cared.map(|()| header)
    }

    fn commit(&mut self, slot: u64, hash: u64) -> Result<(), Error> {
        Ok(self.commits.send(self.ring.header(slot, 0), Commit { hash })?)
    }
}
