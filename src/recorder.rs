//! The recorder: reads every slot off the ring, puts it on record, and commits it to field-sim.

use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::Service;
use skysink_common::message::{Commit, FLAG_TICK, FlightReport, HoldReason, Plan, QueuesHeader, SlotHeader};
use skysink_common::node::{NodeError, Patience, Role, Stop};
use skysink_common::pace::Pace;
use skysink_common::reader::Reader;
use skysink_common::ring::{Ring, VIEWER_READY};
use skysink_common::topic::VIEWER_BUFFER;
use skysink_common::writer::Writer;

use crate::error::Error;
use crate::record::SlotLog;
use crate::summary::Tally;

/// How often the surroundings of the ring are looked after.
const CARE: Duration = Duration::from_millis(100);

/// How often it is looked whether the viewer is there.
const GATHER: Duration = Duration::from_millis(5);

/// Puts a mission on record while the ring turns.
pub struct Recorder<'a, S: Service + 'static> {
    ring: &'a Ring<S>,
    queues: Reader<S, [u32], QueuesHeader>,
    plans: Reader<S, Plan, SlotHeader>,
    flights: Reader<S, FlightReport, SlotHeader>,
    commits: Writer<S, Commit, SlotHeader>,
    viewer: Listener<S>,
    clock: Clock,
}

impl<'a, S: Service + 'static> Recorder<'a, S> {
    /// Connects to the ring; to be done before any other process is started.
    ///
    /// # Errors
    /// If a topic cannot be read or written.
    pub fn new(ring: &'a Ring<S>, slot_s: f64, stop: &Stop) -> Result<Self, Error> {
        Ok(Self {
            ring,
            queues: ring.queues.reader(VIEWER_BUFFER)?,
            plans: ring.plan.reader(VIEWER_BUFFER)?,
            flights: ring.flight.reader(VIEWER_BUFFER)?,
            commits: ring.commit.writer(ring.terms.pace, stop, ring.timeout())?,
            viewer: ring.commit.listener()?,
            clock: Clock::new(ring.terms.pace.period(slot_s)),
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
        let header = self.gather(patience, || care(tally))?;
        tally.start(&header);
        self.commit(0, 0)?;
        let begin = Instant::now();
        let mut cared = begin;
        for slot in 1..=slots {
            if cared.elapsed() >= CARE {
                cared = Instant::now();
                care(tally)?;
            }
            let (header, flight, plan) = self.next(slot, patience, || care(tally))?;
            let hash = log.add(&flight, &header)?;
            tally.add(plan.as_ref(), &flight, &header);
            tally.set_late_slots(self.clock.late_slots);
            self.commit(slot, hash)?;
        }
        Ok(begin.elapsed())
    }

    /// Waits until every process has shown itself, and returns the state before slot 1. The viewer must be connected
    /// before the ring turns, or it would miss the first slots.
    fn gather(
        &mut self,
        patience: &mut Patience,
        mut idle: impl FnMut() -> Result<(), Error>,
    ) -> Result<QueuesHeader, Error> {
        let header = self.state(0, patience, &mut idle)?;
        self.flights.wait_until_there(patience, 0, &mut idle)?;
        self.plans.wait_until_there(patience, 1, &mut idle)?;
        let deadline = Instant::now() + self.ring.timeout();
        let mut ready = !self.ring.terms.viewer;
        while !ready {
            idle()?;
            patience.stop().check()?;
            if Instant::now() > deadline {
                let (what, seconds) = ("the viewer to be ready".to_owned(), self.ring.timeout().as_secs_f64());
                return Err(NodeError::TimedOut { what, from: Role::Viewer.name(), seconds }.into());
            }
            let look = |event: iceoryx2::prelude::EventActivation| ready |= event.id.as_value() == VIEWER_READY;
            let _ = self.viewer.timed_wait(look, GATHER); // an interrupted wait is a short one
        }
        Ok(header)
    }

    /// Waits for the queues after `slot`.
    fn state(
        &mut self,
        slot: u64,
        patience: &mut Patience,
        mut care: impl FnMut() -> Result<(), Error>,
    ) -> Result<QueuesHeader, Error> {
        let commits = &self.commits;
        let idle = || {
            commits.serve_joiners()?;
            care()
        };
        let clock = &mut self.clock;
        let is_state = |header: &QueuesHeader| {
            let tick = header.head.flags & FLAG_TICK != 0;
            if tick {
                clock.tick(header.head.sent_ns);
            }
            !tick && header.head.slot == slot
        };
        Ok(*self.queues.wait_for(patience, slot, is_state, idle)?.user_header())
    }

    /// Waits for everything of `slot`; there is no plan if it came too late.
    fn next(
        &mut self,
        slot: u64,
        patience: &mut Patience,
        mut care: impl FnMut() -> Result<(), Error>,
    ) -> Result<(QueuesHeader, FlightReport, Option<Plan>), Error> {
        let header = self.state(slot, patience, &mut care)?;
        let flight = *self.flights.wait(patience, slot, &mut care)?.payload();
        let plan = match self.ring.terms.pace {
            Pace::Max => Some(self.plans.wait(patience, slot, &mut care)?),
            Pace::Factor(_) => self.plans.take(slot)?,
        };
        let in_time = HoldReason::of_code(flight.hold) != HoldReason::NoPlan;
        Ok((header, flight, plan.map(|plan| *plan.payload()).filter(|_| in_time)))
    }

    fn commit(&mut self, slot: u64, hash: u64) -> Result<(), Error> {
        Ok(self.commits.send(self.ring.header(slot, 0), Commit { hash })?)
    }
}

/// Watches the starts of the slots in a paced run.
struct Clock {
    period: Option<Duration>,
    last_ns: Option<u64>,
    late_slots: u64,
}

impl Clock {
    fn new(period: Option<Duration>) -> Self {
        Self { period, last_ns: None, late_slots: 0 }
    }

    /// A slot begins. It is late if it comes more than one and a half periods after the last.
    fn tick(&mut self, sent_ns: u64) {
        if let (Some(period), Some(last_ns)) = (self.period, self.last_ns.replace(sent_ns)) {
            let apart = Duration::from_nanos(sent_ns.saturating_sub(last_ns));
            self.late_slots += u64::from(apart > period.mul_f64(1.5));
        }
    }
}
