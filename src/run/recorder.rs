//! The recorder: waits for the parts of every slot, puts it on record, and commits it to field-sim.

use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::Service;
use skysink_common::message::{Commit, FLAG_END, FlightReport, HoldReason, Plan, QueuesHeader, SlotHeader, Tick};
use skysink_common::pace::Pace;
use skysink_mission::latency::SlotTimes;
use skysink_mission::slot_log::SlotLog;
use skysink_mission::summary::Tally;
use skysink_ring::error::RingError;
use skysink_ring::health::Ready;
use skysink_ring::reader::Reader;
use skysink_ring::role::Role;
use skysink_ring::topics::{RING_BUFFER, Ring, VIEWER_BUFFER};
use skysink_ring::wait::{Awaited, WaitContext};
use skysink_ring::writer::Writer;

use crate::error::Error;

/// How often the processes are supervised.
const SUPERVISE: Duration = Duration::from_millis(10);

/// A wait after which a process may have died that is not the launcher's.
const STALL: Duration = Duration::from_millis(200);

/// What becomes of the slots of a ring.
pub trait SlotSink {
    /// Adds a slot, with the plan that was there, in time or not, and returns the hash of all so far.
    ///
    /// # Errors
    /// If the slot cannot be, or cannot be written; then it is as if it had not been tried.
    fn add(&mut self, plan: Option<&Plan>, flight: &FlightReport, header: &QueuesHeader) -> Result<u64, Error>;

    /// The hash of all slots so far, chained.
    fn hash(&self) -> u64;
}

impl SlotSink for SlotLog {
    fn add(&mut self, _plan: Option<&Plan>, flight: &FlightReport, header: &QueuesHeader) -> Result<u64, Error> {
        Ok(Self::add(self, flight, header)?)
    }

    fn hash(&self) -> u64 {
        Self::hash(self)
    }
}

/// Puts a mission on record while the ring runs.
pub struct Recorder<'a, S: Service + 'static> {
    ring: &'a Ring<S>,
    wait: WaitContext,
    /// The wake-ups of `queues`, which are the last part of a slot.
    listener: Listener<S>,
    queues: Reader<S, [u32], QueuesHeader>,
    plans: Reader<S, Plan, SlotHeader>,
    flights: Reader<S, FlightReport, SlotHeader>,
    ticks: Reader<S, Tick, SlotHeader>,
    ready: Reader<S, Ready, SlotHeader>,
    commits: Writer<S, Commit, SlotHeader>,
    /// Roles of processes that the launcher did not start, and how long it waits for their samples.
    outside: Vec<Role>,
    outside_timeout: Duration,
    parts: Parts,
    /// Restart count of the viewer that is there, or will be started next.
    viewer: u32,
    /// That of the newest viewer that is ready.
    ready_viewer: Option<u32>,
    supervised: Instant,
}

/// What has arrived of a slot.
#[derive(Default)]
struct Parts {
    queues: Option<QueuesHeader>,
    flight: Option<(SlotHeader, FlightReport)>,
    plan: Option<(SlotHeader, Plan)>,
    /// In paced runs: when the slot began [ns].
    tick_ns: Option<u64>,
}

/// Supervises the processes of the run, of which one may be overdue, for so long; may end the run. Returns the restart
/// count of the current viewer.
pub type Supervise<'a> = dyn FnMut(&mut Tally, Option<(Role, Duration)>) -> Result<u32, Error> + 'a;

impl<'a, S: Service + 'static> Recorder<'a, S> {
    /// Connects to the ring; to be done before any other process is started.
    ///
    /// # Errors
    /// If a topic cannot be read or written.
    pub fn new(ring: &'a Ring<S>, wait: WaitContext) -> Result<Self, Error> {
        Ok(Self {
            ring,
            wait,
            listener: ring.truth.listener()?,
            queues: ring.truth.reader(VIEWER_BUFFER)?,
            plans: ring.plan.reader(VIEWER_BUFFER)?,
            flights: ring.flight.reader(VIEWER_BUFFER)?,
            ticks: ring.tick.reader(VIEWER_BUFFER)?,
            ready: ring.ready.reader(RING_BUFFER)?,
            commits: ring.commit.writer()?,
            outside: Vec::new(),
            outside_timeout: Duration::ZERO,
            parts: Parts::default(),
            viewer: 0,
            ready_viewer: None,
            supervised: Instant::now(),
        })
    }

    /// Waits so long for the samples of these roles, whose processes the launcher did not start.
    #[must_use]
    pub fn with_outside(mut self, roles: &[Role], timeout: Duration) -> Self {
        self.outside = roles.to_vec();
        self.outside_timeout = timeout;
        self
    }

    /// Records all slots after those of the tally, up to `slots`, into the log and the tally, and returns the wall time
    /// from the first to the last. `supervise` runs now and then.
    ///
    /// # Errors
    /// Those of `supervise` and of the log; a peer that is missing or wrong, a broken ring, or a requested stop.
    pub fn record(
        &mut self,
        slots: u64,
        log: &mut dyn SlotSink,
        tally: &mut Tally,
        supervise: &mut Supervise,
    ) -> Result<Duration, Error> {
        let first = tally.last_slot();
        // Every process has shown itself once the plan of the first slot is there.
        let (header, _) = self.wait_for_parts(first, Some(first + 1), tally, supervise)?;
        self.listener = self.ring.truth.listener()?; // behind the planner's, which is in a hurry; a record is not
        if first == 0 {
            tally.start(&header);
        }
        self.commit(first, log.hash())?;
        let begin = Instant::now();
        for slot in first + 1..=slots {
            self.supervise(tally, None, supervise)?;
            let plan_of = (self.ring.terms.pace == Pace::Max).then_some(slot);
            let (header, (flight_head, flight)) = self.wait_for_parts(slot, plan_of, tally, supervise)?;
            let plan = self.parts.plan.take();
            let times = SlotTimes {
                tick_ns: self.parts.tick_ns.take(),
                plan_ns: plan.as_ref().map(|(head, _)| head.sent_ns),
                flight_ns: flight_head.sent_ns,
                queues_ns: header.head.sent_ns,
            };
            let in_time = flight.hold != HoldReason::NoPlan as u32;
            let plan = plan.map(|(_, plan)| plan);
            let hash = log.add(plan.as_ref(), &flight, &header)?;
            let plan = plan.filter(|_| in_time);
            tally.add(plan.as_ref(), &flight, &header);
            if self.ring.terms.link.is_none() {
                tally.add_times(times); // the clocks of two hosts have nothing in common
            }
            tally.set_refused_messages(self.ring.refusals.total());
            self.commit(slot, hash)?;
        }
        Ok(begin.elapsed())
    }

    /// Lets the processes end. Until then they are there for those that are started again.
    ///
    /// # Errors
    /// If the ring is broken.
    pub fn release(&self, slot: u64, hash: u64) -> Result<(), Error> {
        Ok(self.commits.send(self.ring.header(slot, FLAG_END), Commit { hash })?)
    }

    /// Pauses after the last slot; processes that are started again get the last commits.
    ///
    /// # Errors
    /// A requested stop, or a broken ring.
    pub fn pause(&mut self, long: Duration) -> Result<(), Error> {
        Ok(self.wait.sleep_until(Instant::now() + long)?)
    }

    /// Waits for the parts of `slot`, and returns its queues and its flight. In lock-step, the plan of the slot
    /// `plan_of` must be there, too, and the viewer, which would otherwise miss what comes next; in paced runs, a plan
    /// may be late and a viewer may lag.
    fn wait_for_parts(
        &mut self,
        slot: u64,
        plan_of: Option<u64>,
        tally: &mut Tally,
        supervise: &mut Supervise,
    ) -> Result<(QueuesHeader, (SlotHeader, FlightReport)), Error> {
        let mut awaited = self.begin("queues", slot, Role::FieldSim)?;
        let mut is_told = false; // whoever is overdue is killed once
        loop {
            let missing = self.poll(slot, plan_of)?;
            if let (None, Parts { queues: Some(queues), flight: Some(flight), .. }) = (missing, &mut self.parts) {
                let parts = (*queues, *flight);
                self.parts.queues = None;
                self.parts.flight = None;
                self.wait.end(awaited);
                return Ok(parts);
            }
            let (topic, topic_slot, from) = missing.unwrap_or(("queues", slot, Role::FieldSim));
            if (topic, topic_slot) != (awaited.topic, awaited.slot) {
                self.wait.end(awaited);
                awaited = self.begin(topic, topic_slot, from)?;
                is_told = false;
            }
            let waited = awaited.waited.elapsed();
            let is_overdue = !is_told && waited >= self.ring.terms.overdue_limit();
            is_told |= is_overdue;
            self.supervise(tally, is_overdue.then_some((from, waited)), supervise)?;
            if waited >= STALL {
                self.ring.remove_dead_nodes();
            }
            self.wait.pause(&self.listener, &mut awaited)?;
        }
    }

    /// Begins to wait for a sample.
    fn begin(&mut self, topic: &'static str, slot: u64, from: Role) -> Result<Awaited, RingError> {
        let mut awaited = self.wait.begin(topic, slot, from)?;
        if self.outside.contains(&from) {
            awaited.timeout = Some(self.outside_timeout);
        }
        Ok(awaited)
    }

    /// Takes what has arrived, and returns the first sample of the chain that is missing and who sends it: those behind
    /// it wait as well. It reads every topic: a writer must not wait because of what is refused here.
    fn poll(&mut self, slot: u64, plan_of: Option<u64>) -> Result<Option<(&'static str, u64, Role)>, RingError> {
        let Parts { queues, flight, plan, tick_ns } = &mut self.parts;
        if queues.is_none() {
            *queues = self.queues.poll_slot(slot)?.available().map(|sample| *sample.user_header());
        }
        if flight.is_none() {
            *flight =
                self.flights.poll_slot(slot)?.available().map(|sample| (*sample.user_header(), *sample.payload()));
        }
        if plan.is_none() {
            let found = self.plans.poll_slot(plan_of.unwrap_or(slot))?.available();
            *plan = found.map(|sample| (*sample.user_header(), *sample.payload()));
        }
        if plan_of.is_none() && tick_ns.is_none() {
            *tick_ns = self.ticks.poll_slot(slot)?.available().map(|sample| sample.user_header().sent_ns);
        }
        let queues_here = queues.is_some();
        let flight_here = flight.is_some();
        let plan_here = plan.is_some();
        let tick_here = tick_ns.is_some();
        let next_plan = plan_of.filter(|&of| of > slot); // the state before a slot comes before its plan
        Ok(match plan_of {
            Some(_) if next_plan.is_some() && !queues_here => Some(("queues", slot, Role::FieldSim)),
            Some(of) if next_plan.is_none() && !plan_here => Some(("plan", of, Role::Planner)),
            None if !flight_here && !tick_here => Some(("tick", slot, Role::FieldSim)),
            _ if !flight_here => Some(("flight", slot, Role::FlightSim)),
            _ if !queues_here => Some(("queues", slot, Role::FieldSim)),
            Some(of) if !plan_here => Some(("plan", of, Role::Planner)),
            Some(_) if !self.viewer_is_ready()? => Some(("ready", slot, Role::Viewer)), // one time-out for all its restarts
            _ => None,
        })
    }

    /// Whether the current viewer is ready, if one takes part.
    fn viewer_is_ready(&mut self) -> Result<bool, RingError> {
        if !self.ring.terms.viewer {
            return Ok(true);
        }
        while self.ready_viewer < Some(self.viewer)
            && let Some(sample) = self.ready.next_sample()?
        {
            self.ready_viewer = self.ready_viewer.max(Some(sample.payload().restarts));
        }
        Ok(self.ready_viewer >= Some(self.viewer))
    }

    /// Supervises the processes now and then, and when one is overdue.
    fn supervise(
        &mut self,
        tally: &mut Tally,
        overdue: Option<(Role, Duration)>,
        supervise: &mut Supervise,
    ) -> Result<(), Error> {
        if overdue.is_some() || self.supervised.elapsed() >= SUPERVISE {
            self.supervised = Instant::now();
            self.viewer = supervise(tally, overdue)?;
        }
        Ok(())
    }

    fn commit(&mut self, slot: u64, hash: u64) -> Result<(), Error> {
        Ok(self.commits.send(self.ring.header(slot, 0), Commit { hash })?)
    }
}
