//! The recorder: receives the messages of every slot, writes the slot to the run folder, and commits it to field-sim.

use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::Service;
use skysink_common::message::{Commit, FLAG_END, FlightReport, HoldReason, Plan, QueuesHeader, SlotHeader, Tick};
use skysink_common::pace::Pace;
use skysink_common::scenario::Scenario;
use skysink_common::slot_record::{ByUav, Plans, SlotRecord, UAV};
use skysink_mission::drive::SlotSink;
use skysink_mission::latency::SlotTimes;
use skysink_mission::slot_log::SlotLog;
use skysink_mission::summary::Tally;
use skysink_ring::error::RingError;
use skysink_ring::health::{ProcessEvent, Ready};
use skysink_ring::reader::Reader;
use skysink_ring::role::Role;
use skysink_ring::sample::{Header, Payload};
use skysink_ring::topic::Topic;
use skysink_ring::topics::Ring;
use skysink_ring::wait::{Awaited, WaitContext};
use skysink_ring::writer::Writer;

use crate::error::Error;
use crate::run::plan_watch::{LateMessage, PlanWatch};
use crate::run::supervise::SampleEvent;

/// Time between two polls of the processes.
const SUPERVISE_EVERY: Duration = Duration::from_millis(10);

/// After waiting this long for a message, the recorder checks for dead external processes.
const STALL: Duration = Duration::from_millis(200);

/// The trace of a ring, to which slots are committed.
pub trait RingTrace: SlotSink {
    /// The chained hash of all slots so far.
    fn hash(&self) -> u64;
}

impl RingTrace for SlotLog {
    fn hash(&self) -> u64 {
        Self::hash(self)
    }
}

/// Records the mission of a running ring.
pub struct Recorder<'a, S: Service + 'static> {
    ring: &'a Ring<S>,
    wait: WaitContext,
    /// Notified with `queues`, the last message of a slot.
    listener: Listener<S>,
    queues: Reader<S, [u32], QueuesHeader>,
    plans: Reader<S, [Plan], SlotHeader>,
    flights: Reader<S, [FlightReport], SlotHeader>,
    ticks: Reader<S, Tick, SlotHeader>,
    ready: Reader<S, Ready, SlotHeader>,
    commits: Writer<S, Commit, SlotHeader>,
    external: ExternalTimeout,
    received: SlotMessages,
    /// Restart count of the current viewer, or of the next one if there is none.
    viewer: u32,
    /// Restart count of the newest viewer that is ready.
    ready_viewer: Option<u32>,
    supervised: Instant,
    /// The plans, in a paced run that has begun.
    plan_watch: Option<PlanWatch>,
}

/// How long the recorder waits for a message from processes that the launcher does not start, and from vehicles. They
/// are not killed when they are overdue.
#[derive(Debug, Clone, Default)]
pub struct ExternalTimeout {
    /// Their roles.
    pub roles: Vec<Role>,
    /// The longest wait.
    pub timeout: Duration,
    /// Whether they say themselves what they wait for before the mission, as the bridge to vehicles does.
    pub speaks: bool,
}

impl ExternalTimeout {
    /// Whether `role` says itself why it takes so long.
    fn speaks_for(&self, role: Role) -> bool {
        self.speaks && self.roles.contains(&role)
    }
}

/// A message that the recorder needs.
#[derive(Debug, Clone, Copy)]
struct Expected {
    topic: &'static str,
    slot: u64,
    from: Role,
    has_arrived: bool,
}

impl Expected {
    fn on<S: Service, P: Payload + ?Sized, H: Header>(topic: &Topic<S, P, H>, slot: u64, has_arrived: bool) -> Self {
        Self { topic: topic.name(), slot, from: topic.written_by(), has_arrived }
    }
}

/// The messages of a slot that have arrived.
#[derive(Default)]
struct SlotMessages {
    queues: Option<QueuesHeader>,
    flight: Option<(SlotHeader, ByUav<FlightReport>)>,
    plan: Option<(SlotHeader, ByUav<Plan>)>,
    /// In paced runs: when the slot began [ns].
    tick_ns: Option<u64>,
}

/// How long a message was waited for [ms].
fn ms(awaited: &Awaited) -> i32 {
    i32::try_from(awaited.waited.elapsed().as_millis()).unwrap_or(i32::MAX)
}

/// Callback that supervises the processes of the run; an error ends the run. Returns the restart count of the current
/// viewer.
pub type Supervise<'a> = dyn FnMut(&mut Tally, Option<SampleEvent>) -> Result<u32, Error> + 'a;

impl<'a, S: Service + 'static> Recorder<'a, S> {
    /// Connects to the ring. Call it before any other process is started.
    ///
    /// # Errors
    /// If a topic cannot be opened.
    pub fn new(ring: &'a Ring<S>, wait: WaitContext, external: ExternalTimeout) -> Result<Self, Error> {
        Ok(Self {
            ring,
            wait,
            listener: ring.queues.listener()?,
            queues: ring.queues.reader()?,
            plans: ring.plan.reader()?,
            flights: ring.flight.reader()?,
            ticks: ring.tick.reader()?,
            ready: ring.ready.reader()?,
            commits: ring.commit.writer()?,
            external,
            received: SlotMessages::default(),
            viewer: 0,
            ready_viewer: None,
            supervised: Instant::now(),
            plan_watch: None,
        })
    }

    /// Records all slots of `scenario` after those of the tally into the trace and the tally, and returns the wall time
    /// from the first to the last. Calls `supervise` periodically.
    ///
    /// # Errors
    /// If `supervise` or the trace fails, a peer is missing or wrong, the ring is broken, or on a stop.
    pub fn record(
        &mut self,
        scenario: &Scenario,
        trace: &mut dyn RingTrace,
        tally: &mut Tally,
        supervise: &mut Supervise,
    ) -> Result<Duration, Error> {
        let first = tally.last_slot();
        // The first plan proves that all processes are connected.
        let (header, _) = self.wait_for_slot(first, Some(first + 1), tally, supervise)?;
        self.listener = self.ring.queues.listener()?; // re-attached, so that the planner's listener is notified first
        if first == 0 {
            tally.start(&header);
        }
        self.commit(first, trace.hash())?;
        let begin = Instant::now();
        let limit = self.ring.terms.overdue_limit();
        let period = self.ring.terms.pace.period(scenario.slot_s);
        self.plan_watch = period.map(|period| PlanWatch::new(period, limit, scenario.slots, begin));
        let is_local = self.ring.terms.link.is_none(); // otherwise the clocks of two hosts are not comparable
        let mut late = LateMessage::Plan;
        for slot in first + 1..=scenario.slots {
            self.supervise(tally, None, supervise)?;
            let plan_of = (self.ring.terms.pace == Pace::Max).then_some(slot);
            let (header, (flight_head, flights)) = self.wait_for_slot(slot, plan_of, tally, supervise)?;
            let plan = self.received.plan.take();
            let times = SlotTimes {
                tick_ns: self.received.tick_ns.take(),
                plan_ns: plan.as_ref().map(|(head, _)| head.sent_ns),
                flight_ns: flight_head.sent_ns,
                queues_ns: header.head.sent_ns,
            };
            let mut record = SlotRecord::unplanned(flights, header);
            if let Some((_, plans)) = plan {
                let plans: Plans = plans.into_iter().map(Some).collect();
                record.begin(&plans);
            }
            trace.add(&record)?;
            tally.add(&record)?;
            if is_local {
                tally.add_times(times);
            }
            tally.set_refused_messages(self.ring.refusals.total());
            self.commit(slot, trace.hash())?;
            let held_for = (record.flights()[UAV].hold == HoldReason::NoPlan as u32).then_some(late);
            if let Some(event) = self.plan_watch.as_mut().and_then(|watch| watch.count(held_for, Instant::now())) {
                self.supervise(tally, Some(event), supervise)?;
            }
            let took = times.tick_ns.map(|tick_ns| Duration::from_nanos(times.flight_ns.saturating_sub(tick_ns)));
            let late_flight = took.filter(|took| is_local && period.is_some_and(|period| *took >= period));
            late = late_flight.map_or(LateMessage::Plan, LateMessage::Flight);
        }
        let wall = begin.elapsed();
        if let Some(event) = self.plan_watch.as_ref().and_then(PlanWatch::end) {
            self.supervise(tally, Some(event), supervise)?;
        }
        Ok(wall)
    }

    /// Sends the final commit, after which the processes end. Until then, they serve restarted peers.
    ///
    /// # Errors
    /// If the ring is broken.
    pub fn release(&self, slot: u64, hash: u64) -> Result<(), Error> {
        Ok(self.commits.send(self.ring.header(slot, FLAG_END), Commit { hash })?)
    }

    /// Sleeps for `duration` after the last slot. The last commits stay available to restarted processes.
    ///
    /// # Errors
    /// If the ring is broken, or on a stop.
    pub fn pause(&mut self, duration: Duration) -> Result<(), Error> {
        Ok(self.wait.sleep_until(Instant::now() + duration)?)
    }

    /// Waits for the messages of `slot`, and returns its queues and its flights. In lock-step (`plan_of` is set), also
    /// waits for the plan of the slot `plan_of` and for the viewer, which would otherwise miss messages. In paced runs,
    /// a plan may be late and a viewer may lag.
    fn wait_for_slot(
        &mut self,
        slot: u64,
        plan_of: Option<u64>,
        tally: &mut Tally,
        supervise: &mut Supervise,
    ) -> Result<(QueuesHeader, (SlotHeader, ByUav<FlightReport>)), Error> {
        let queues = Expected::on(&self.ring.queues, slot, false);
        let mut awaited = self.begin_wait(&queues)?;
        let mut is_reported = false; // an overdue process is reported and killed once
        let mut is_late = false; // the flight of a paced run, which is reported long before
        loop {
            let missing = self.poll(slot, plan_of)?;
            if is_late && self.received.flight.is_some() {
                is_late = false;
                let event = ProcessEvent::Recovered(ms(&awaited));
                let recovered = SampleEvent { from: self.ring.flight.written_by(), event, is_hung: false };
                self.supervise(tally, Some(recovered), supervise)?;
            }
            if missing.is_none()
                && let Some(header) = self.received.queues
                && let Some(flights) = self.received.flight.take()
            {
                self.received.queues = None;
                self.wait.end(awaited);
                return Ok((header, flights));
            }
            let missing = missing.unwrap_or(queues);
            if (missing.topic, missing.slot) != (awaited.topic, awaited.slot) {
                self.wait.end(awaited);
                awaited = self.begin_wait(&missing)?;
                is_reported = false;
            }
            let waited = awaited.waited.elapsed();
            // Before the mission, the bridge to vehicles says itself what it waits for.
            let says_itself = self.external.speaks_for(missing.from) && self.plan_watch.is_none();
            let is_overdue = !is_reported && !says_itself && waited >= self.ring.terms.overdue_limit();
            is_reported |= is_overdue;
            let report_after = self.plan_watch.as_ref().map(PlanWatch::report_after);
            let is_late_now = !is_late
                && !is_overdue
                && missing.topic == self.ring.flight.name()
                && report_after.is_some_and(|report_after| waited >= report_after);
            is_late |= is_late_now;
            let is_hung = is_overdue && !self.external.roles.contains(&missing.from);
            let overdue = SampleEvent { from: missing.from, event: ProcessEvent::Overdue(ms(&awaited)), is_hung };
            let [plan, queues] = [self.plans.newest_slot(), self.queues.newest_slot()];
            let plans = self.plan_watch.as_mut().and_then(|watch| watch.poll(plan, queues, Instant::now()));
            for event in [Some(overdue).filter(|_| is_overdue || is_late_now), plans].into_iter().flatten() {
                self.supervise(tally, Some(event), supervise)?;
            }
            self.supervise(tally, None, supervise)?;
            if waited >= STALL {
                self.ring.remove_dead_nodes();
            }
            self.wait.pause(&self.listener, &mut awaited)?;
        }
    }

    /// Starts the wait for a message.
    fn begin_wait(&mut self, expected: &Expected) -> Result<Awaited, RingError> {
        let mut awaited = self.wait.begin(expected.topic, expected.slot, expected.from)?;
        if self.external.roles.contains(&expected.from) {
            awaited.timeout = Some(self.external.timeout);
        }
        Ok(awaited)
    }

    /// Takes the messages that have arrived, and returns the first missing one in the order of the ring; later ones
    /// depend on it. Reads every topic, so that no writer blocks on a full buffer.
    fn poll(&mut self, slot: u64, plan_of: Option<u64>) -> Result<Option<Expected>, RingError> {
        let SlotMessages { queues, flight, plan, tick_ns } = &mut self.received;
        if queues.is_none() {
            *queues = self.queues.poll_slot(slot)?.available().map(|sample| *sample.user_header());
        }
        if flight.is_none() {
            let found = self.flights.poll_slot(slot)?.available();
            *flight = found.map(|sample| (*sample.user_header(), ByUav::from_slice(&sample)));
        }
        let plan_slot = plan_of.unwrap_or(slot);
        if plan.is_none() {
            let found = self.plans.poll_slot(plan_slot)?.available();
            *plan = found.map(|sample| (*sample.user_header(), ByUav::from_slice(&sample)));
        }
        if plan_of.is_none() && tick_ns.is_none() {
            *tick_ns = self.ticks.poll_slot(slot)?.available().map(|sample| sample.user_header().sent_ns);
        }
        let ring = self.ring;
        let tick = Expected::on(&ring.tick, slot, tick_ns.is_some() || flight.is_some());
        let queues = Expected::on(&ring.queues, slot, queues.is_some());
        let plan = Expected::on(&ring.plan, plan_slot, plan.is_some());
        let flight = Expected::on(&ring.flight, slot, flight.is_some());
        let order = match plan_of {
            None => [tick, flight, queues],
            Some(of) if of == slot => [plan, flight, queues],
            Some(_) => [queues, flight, plan], // the queues before a slot precede its plan
        };
        let missing = order.into_iter().find(|expected| !expected.has_arrived);
        if missing.is_some() || plan_of.is_none() {
            return Ok(missing);
        }
        let ready = Expected::on(&ring.ready, slot, self.is_viewer_ready()?); // one timeout for all restarts
        Ok(Some(ready).filter(|ready| !ready.has_arrived))
    }

    /// Whether the current viewer is ready; true for a run without one.
    fn is_viewer_ready(&mut self) -> Result<bool, RingError> {
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

    /// Supervises the processes if samples show an event or [`SUPERVISE_EVERY`] has passed.
    fn supervise(
        &mut self,
        tally: &mut Tally,
        sample: Option<SampleEvent>,
        supervise: &mut Supervise,
    ) -> Result<(), Error> {
        if sample.is_some() || self.supervised.elapsed() >= SUPERVISE_EVERY {
            self.supervised = Instant::now();
            self.viewer = supervise(tally, sample)?;
        }
        Ok(())
    }

    fn commit(&mut self, slot: u64, hash: u64) -> Result<(), Error> {
        Ok(self.commits.send(self.ring.header(slot, 0), Commit { hash })?)
    }
}
