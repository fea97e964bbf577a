//! The recorder: reads every slot off the ring, puts it on record, and commits it to field-sim.

use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::Service;
use skysink_common::message::{Commit, FLAG_END, FLAG_TICK, FlightReport, HoldReason, Plan, QueuesHeader, SlotHeader};
use skysink_common::pace::Pace;
use skysink_common::stop::Stop;
use skysink_ring::error::NodeError;
use skysink_ring::reader::Reader;
use skysink_ring::role::Role;
use skysink_ring::topics::{Full, Ring, VIEWER_BUFFER, VIEWER_READY};
use skysink_ring::wait::WaitContext;
use skysink_ring::writer::Writer;

use crate::error::Error;
use crate::run::watch::{Alarm, ViewerState};
use skysink_mission::latency::SlotTimes;
use skysink_mission::record::SlotLog;
use skysink_mission::summary::Tally;

/// How often the surroundings of the ring are looked after.
const CARE: Duration = Duration::from_millis(100);

/// How often it is looked whether the viewer is there.
const GATHER: Duration = Duration::from_millis(5);

/// A wait after which a process may have died that is not the launcher's.
const STALL: Duration = Duration::from_millis(200);

/// Puts a mission on record while the ring turns.
pub struct Recorder<'a, S: Service + 'static> {
    ring: &'a Ring<S>,
    queues: Reader<S, [u32], QueuesHeader>,
    plans: Reader<S, Plan, SlotHeader>,
    flights: Reader<S, FlightReport, SlotHeader>,
    commits: Writer<S, Commit, SlotHeader>,
    viewer: Listener<S>,
    viewer_state: ViewerState,
    alarm: Alarm,
    clock: Clock,
}

/// Everything of a slot.
struct Seen {
    header: QueuesHeader,
    flight: FlightReport,
    /// None if it came too late.
    plan: Option<Plan>,
    times: SlotTimes,
}

impl<'a, S: Service + 'static> Recorder<'a, S> {
    /// Connects to the ring; to be done before any other process is started. `alarm` tells at once when one has died.
    ///
    /// # Errors
    /// If a topic cannot be read or written.
    pub fn new(ring: &'a Ring<S>, slot_s: f64, alarm: Alarm, stop: &Stop) -> Result<Self, Error> {
        Ok(Self {
            ring,
            queues: ring.queues.reader(VIEWER_BUFFER)?,
            plans: ring.plan.reader(VIEWER_BUFFER)?,
            flights: ring.flight.reader(VIEWER_BUFFER)?,
            commits: ring.commit.writer(Full::of(ring.terms.pace), stop, ring.timeout())?,
            viewer: ring.commit.listener()?,
            viewer_state: if ring.terms.viewer { ViewerState::Lost } else { ViewerState::There },
            alarm,
            clock: Clock::new(ring.terms.pace.period(slot_s)),
        })
    }

    /// Records all slots after those of the tally, up to `slots`, into the log and the tally, and returns the wall time
    /// from the first to the last. `care` looks after the processes whenever one has died, and every tenth of a second;
    /// it may end the run.
    ///
    /// # Errors
    /// Those of `care` and of the log; a peer that is missing or wrong, a broken ring, or a requested stop.
    pub fn record(
        &mut self,
        slots: u64,
        patience: &mut WaitContext,
        log: &mut SlotLog,
        tally: &mut Tally,
        mut care: impl FnMut(&Tally) -> Result<ViewerState, Error>,
    ) -> Result<Duration, Error> {
        let first = tally.last_slot();
        let header = self.gather(first, patience, || care(tally))?;
        if first == 0 {
            tally.start(&header);
        }
        self.commit(first, log.hash())?;
        let begin = Instant::now();
        let mut cared = begin;
        for slot in first + 1..=slots {
            if self.alarm.rung() || cared.elapsed() >= CARE {
                cared = Instant::now();
                let state = care(tally)?;
                self.note(state)?;
            }
            let seen = self.next(slot, patience, || care(tally))?;
            let hash = log.add(&seen.flight, &seen.header)?;
            tally.add(seen.plan.as_ref(), &seen.flight, &seen.header);
            tally.add_times(seen.times);
            tally.set_late_slots(self.clock.late_slots);
            tally.set_refused_messages(self.ring.refusals.total());
            if self.ring.terms.pace == Pace::Max {
                self.wait_for_viewer(patience, || care(tally))?; // or it would miss more than it has to
            }
            self.commit(slot, hash)?;
        }
        Ok(begin.elapsed())
    }

    /// Lets field-sim end, after everybody else has: until then it serves those who are started again.
    ///
    /// # Errors
    /// If the ring is broken.
    pub fn release(&self, slot: u64, hash: u64) -> Result<(), Error> {
        Ok(self.commits.send(self.ring.header(slot, FLAG_END), Commit { hash })?)
    }

    /// Lets processes that are started again have the last commits.
    ///
    /// # Errors
    /// If the ring is broken.
    pub fn serve_joiners(&self) -> Result<(), Error> {
        Ok(self.commits.serve_joiners()?)
    }

    /// Waits until every process has shown itself, and returns the state after slot `first`. The viewer must be connected
    /// before the ring turns, or it would miss the first slots.
    fn gather(
        &mut self,
        first: u64,
        patience: &mut WaitContext,
        mut idle: impl FnMut() -> Result<ViewerState, Error>,
    ) -> Result<QueuesHeader, Error> {
        let header = self.state(first, patience, &mut idle)?;
        let mut state = ViewerState::There;
        let mut look = || {
            if idle()? == ViewerState::Lost {
                state = ViewerState::Lost;
            }
            Ok::<_, Error>(())
        };
        self.flights.wait_until_there(patience, first, &mut look)?;
        self.plans.wait_until_there(patience, first + 1, &mut look)?;
        self.note(state)?;
        self.wait_for_viewer(patience, idle)?;
        self.queues.reattach(self.ring.queues.listener()?); // the planner is in a hurry, a record is not
        Ok(header)
    }

    /// Notes if the viewer has died: it is waited for once more.
    fn note(&mut self, state: ViewerState) -> Result<(), Error> {
        if state == ViewerState::Lost && self.ring.terms.viewer {
            self.viewer_state = ViewerState::Lost;
            while matches!(self.viewer.try_wait(|_| {}), Ok(1..)) {} // what it said before it died
        }
        Ok(())
    }

    /// Waits until the viewer has said that it is there.
    fn wait_for_viewer(
        &mut self,
        patience: &mut WaitContext,
        mut idle: impl FnMut() -> Result<ViewerState, Error>,
    ) -> Result<(), Error> {
        let deadline = Instant::now() + self.ring.timeout();
        while self.viewer_state == ViewerState::Lost {
            let mut ready = false;
            let look = |event: iceoryx2::prelude::EventActivation| ready |= event.id.as_value() == VIEWER_READY;
            let _ = self.viewer.timed_wait(look, GATHER); // an interrupted wait is a short one
            if ready {
                self.viewer_state = ViewerState::There;
            }
            let state = idle()?;
            self.note(state)?;
            self.commits.serve_joiners()?;
            patience.stop().check()?;
            if Instant::now() > deadline {
                let (what, seconds) = ("the viewer to be ready".to_owned(), self.ring.timeout().as_secs_f64());
                return Err(NodeError::TimedOut { what, from: Role::Viewer.name(), seconds }.into());
            }
        }
        Ok(())
    }

    /// Waits for the queues after `slot`.
    fn state(
        &mut self,
        slot: u64,
        patience: &mut WaitContext,
        mut care: impl FnMut() -> Result<ViewerState, Error>,
    ) -> Result<QueuesHeader, Error> {
        let (ring, commits, begin) = (self.ring, &self.commits, Instant::now());
        let (plans, flights) = (&mut self.plans, &mut self.flights);
        let mut viewer = ViewerState::There;
        let idle = || {
            commits.serve_joiners()?;
            plans.make_room(slot)?;
            flights.make_room(slot)?;
            if care()? == ViewerState::Lost {
                viewer = ViewerState::Lost;
            }
            if begin.elapsed() >= STALL {
                ring.remove_dead_nodes();
            }
            Ok::<_, Error>(())
        };
        let clock = &mut self.clock;
        let is_state = |header: &QueuesHeader| {
            let tick = header.head.flags & FLAG_TICK != 0;
            if tick {
                clock.tick(header.head.slot, header.head.sent_ns);
            }
            !tick && header.head.slot == slot
        };
        let header = *self.queues.wait_for(patience, slot, is_state, idle)?.user_header();
        self.note(viewer)?;
        Ok(header)
    }

    /// Waits for everything of `slot`.
    fn next(
        &mut self,
        slot: u64,
        patience: &mut WaitContext,
        mut care: impl FnMut() -> Result<ViewerState, Error>,
    ) -> Result<Seen, Error> {
        let header = self.state(slot, patience, &mut care)?;
        let mut viewer = ViewerState::There;
        let mut idle = || {
            if care()? == ViewerState::Lost {
                viewer = ViewerState::Lost;
            }
            Ok::<_, Error>(())
        };
        let flight = self.flights.wait(patience, slot, &mut idle)?;
        let plan = match self.ring.terms.pace {
            Pace::Max => Some(self.plans.wait(patience, slot, &mut idle)?),
            Pace::Factor(_) => self.plans.take(slot)?,
        };
        self.note(viewer)?;
        let plan_head = plan.as_ref().map(|plan| plan.user_header());
        let times = SlotTimes::of(self.clock.began(slot), plan_head, flight.user_header(), &header.head);
        let flight = *flight.payload();
        let in_time = HoldReason::of_code(flight.hold) != HoldReason::NoPlan;
        let plan = plan.map(|plan| *plan.payload()).filter(|_| in_time);
        Ok(Seen { header, flight, plan, times })
    }

    fn commit(&mut self, slot: u64, hash: u64) -> Result<(), Error> {
        Ok(self.commits.send(self.ring.header(slot, 0), Commit { hash })?)
    }
}

/// Watches the starts of the slots in a paced run.
struct Clock {
    period: Option<Duration>,
    /// The last slot that has begun, and when.
    last: Option<(u64, u64)>,
    late_slots: u64,
}

impl Clock {
    fn new(period: Option<Duration>) -> Self {
        Self { period, last: None, late_slots: 0 }
    }

    /// A slot begins. It is late if it comes more than one and a half periods after the last.
    fn tick(&mut self, slot: u64, sent_ns: u64) {
        if let (Some(period), Some((_, last_ns))) = (self.period, self.last.replace((slot, sent_ns))) {
            let apart = Duration::from_nanos(sent_ns.saturating_sub(last_ns));
            self.late_slots += u64::from(apart > period.mul_f64(1.5));
        }
    }

    /// When a slot began.
    fn began(&self, slot: u64) -> Option<u64> {
        self.last.filter(|(last, _)| *last == slot).map(|(_, sent_ns)| sent_ns)
    }
}
