//! The recorder: waits for the parts of every slot, puts it on record, and commits it to field-sim.

use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::Service;
use skysink_common::message::{Commit, FLAG_END, FlightReport, HoldReason, Plan, QueuesHeader, SlotHeader, Tick};
use skysink_common::pace::Pace;
use skysink_mission::latency::SlotTimes;
use skysink_mission::record::SlotLog;
use skysink_mission::summary::Tally;
use skysink_ring::error::RingError;
use skysink_ring::health::Ready;
use skysink_ring::reader::Reader;
use skysink_ring::role::Role;
use skysink_ring::topics::{RING_BUFFER, Ring, VIEWER_BUFFER};
use skysink_ring::wait::WaitContext;
use skysink_ring::writer::Writer;

use crate::error::Error;
use crate::run::watch::Alarm;

/// How often the processes are supervised.
const SUPERVISE: Duration = Duration::from_millis(10);

/// A wait after which a process may have died that is not the launcher's.
const STALL: Duration = Duration::from_millis(200);

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
    parts: Parts,
    viewer: Viewer,
    clock: Clock,
    alarm: Alarm,
    supervised: Instant,
}

/// What has arrived of a slot.
#[derive(Default)]
struct Parts {
    queues: Option<QueuesHeader>,
    flight: Option<(SlotHeader, FlightReport)>,
    plan: Option<(SlotHeader, Plan)>,
}

/// What has to be there of a slot before it is put on record, beside its queues.
#[derive(Debug, Clone, Copy)]
enum Needed {
    /// Its flight: in paced runs a plan may be late, and a viewer may lag.
    Flight,
    /// Its flight, the plan of the slot `plan_of`, and the viewer, which would otherwise miss what comes next.
    All { plan_of: u64 },
}

/// The restart counts of the viewer.
#[derive(Default)]
struct Viewer {
    /// That of the process that is now, or will be started next.
    current: u32,
    /// That of the newest that is ready.
    ready: Option<u32>,
}

/// Supervises the processes of the run; may end it. Returns the restart count of the current viewer.
pub type Supervise<'a> = dyn FnMut(&Tally) -> Result<u32, Error> + 'a;

impl<'a, S: Service + 'static> Recorder<'a, S> {
    /// Connects to the ring; to be done before any other process is started. `alarm` tells at once when one has died.
    ///
    /// # Errors
    /// If a topic cannot be read or written.
    pub fn new(ring: &'a Ring<S>, wait: WaitContext, slot_s: f64, alarm: Alarm) -> Result<Self, Error> {
        Ok(Self {
            ring,
            wait,
            listener: ring.queues.listener()?,
            queues: ring.queues.reader(VIEWER_BUFFER)?,
            plans: ring.plan.reader(VIEWER_BUFFER)?,
            flights: ring.flight.reader(VIEWER_BUFFER)?,
            ticks: ring.tick.reader(VIEWER_BUFFER)?,
            ready: ring.ready.reader(RING_BUFFER)?,
            commits: ring.commit.writer()?,
            parts: Parts::default(),
            viewer: Viewer::default(),
            clock: Clock::new(ring.terms.pace.period(slot_s)),
            alarm,
            supervised: Instant::now(),
        })
    }

    /// Records all slots after those of the tally, up to `slots`, into the log and the tally, and returns the wall time
    /// from the first to the last. `supervise` runs when a process has died, and now and then.
    ///
    /// # Errors
    /// Those of `supervise` and of the log; a peer that is missing or wrong, a broken ring, or a requested stop.
    pub fn record(
        &mut self,
        slots: u64,
        log: &mut SlotLog,
        tally: &mut Tally,
        supervise: &mut Supervise,
    ) -> Result<Duration, Error> {
        let first = tally.last_slot();
        // Every process has shown itself once the plan of the first slot is there.
        let (header, _) = self.wait_for_parts(first, Needed::All { plan_of: first + 1 }, tally, supervise)?;
        self.listener = self.ring.queues.listener()?; // behind the planner's, which is in a hurry; a record is not
        if first == 0 {
            tally.start(&header);
        }
        self.commit(first, log.hash())?;
        let begin = Instant::now();
        for slot in first + 1..=slots {
            self.supervise(tally, supervise)?;
            let needed = match self.ring.terms.pace {
                Pace::Max => Needed::All { plan_of: slot },
                Pace::Factor(_) => Needed::Flight,
            };
            let (header, (flight_head, flight)) = self.wait_for_parts(slot, needed, tally, supervise)?;
            self.clock.read(&mut self.ticks)?;
            let plan = self.parts.plan.take();
            let plan_head = plan.as_ref().map(|(head, _)| head);
            let times = SlotTimes::of(self.clock.began(slot), plan_head, &flight_head, &header.head);
            let in_time = flight.hold != HoldReason::NoPlan as u32;
            let plan = plan.map(|(_, plan)| plan).filter(|_| in_time);

            let hash = log.add(&flight, &header)?;
            tally.add(plan.as_ref(), &flight, &header);
            tally.add_times(times);
            tally.set_late_slots(self.clock.late_slots);
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

    /// How long a process waits for another.
    #[must_use]
    pub fn timeout(&self) -> Duration {
        self.ring.terms.timeout()
    }

    /// Pauses after the last slot; processes that are started again get the last commits.
    ///
    /// # Errors
    /// A requested stop, or a broken ring.
    pub fn pause(&mut self, long: Duration) -> Result<(), Error> {
        Ok(self.wait.sleep_until(Instant::now() + long)?)
    }

    /// Waits for what is `needed` of `slot`, and returns its queues and its flight.
    fn wait_for_parts(
        &mut self,
        slot: u64,
        needed: Needed,
        tally: &Tally,
        supervise: &mut Supervise,
    ) -> Result<(QueuesHeader, (SlotHeader, FlightReport)), Error> {
        let mut awaited = self.wait.begin("queues", slot, Role::FieldSim)?;
        loop {
            self.read(slot, needed)?;
            let (topic, topic_slot, from) = match self.missing(slot, needed)? {
                Some(missing) => missing,
                None => {
                    let Parts { queues: Some(queues), flight: Some(flight), .. } = self.parts else { continue };
                    self.parts = Parts { plan: self.parts.plan.take(), ..Parts::default() };
                    return Ok((queues, flight));
                }
            };
            if (topic, topic_slot) != (awaited.topic, awaited.slot) {
                awaited = self.wait.begin(topic, topic_slot, from)?;
            }
            self.supervise(tally, supervise)?;
            if awaited.since.elapsed() >= STALL {
                self.ring.remove_dead_nodes();
            }
            self.wait.pause(&self.listener, &awaited)?;
        }
    }

    /// The first sample of what is `needed` that is missing, and who sends it.
    fn missing(&mut self, slot: u64, needed: Needed) -> Result<Option<(&'static str, u64, Role)>, RingError> {
        let Parts { queues, flight, plan } = &self.parts;
        Ok(match needed {
            _ if queues.is_none() => Some(("queues", slot, Role::FieldSim)),
            _ if flight.is_none() => Some(("flight", slot, Role::FlightSim)),
            Needed::Flight => None,
            Needed::All { plan_of } if plan.is_none() => Some(("plan", plan_of, Role::Planner)),
            Needed::All { .. } if self.viewer_is_ready()? => None,
            Needed::All { .. } => Some(("ready", slot, Role::Viewer)), // one time-out for all its restarts
        })
    }

    /// Takes what has arrived. It looks at every topic: a writer must not wait because of what is refused here.
    fn read(&mut self, slot: u64, needed: Needed) -> Result<(), RingError> {
        let plan_of = if let Needed::All { plan_of } = needed { plan_of } else { slot };
        let Parts { queues, flight, plan } = &mut self.parts;
        if queues.is_none() {
            *queues = self.queues.of_slot(slot)?.here().map(|sample| *sample.user_header());
        }
        if flight.is_none() {
            *flight = self.flights.of_slot(slot)?.here().map(|sample| (*sample.user_header(), *sample.payload()));
        }
        if plan.is_none() {
            *plan = self.plans.of_slot(plan_of)?.here().map(|sample| (*sample.user_header(), *sample.payload()));
        }
        Ok(())
    }

    /// Whether the current viewer is ready, if one takes part.
    fn viewer_is_ready(&mut self) -> Result<bool, RingError> {
        if !self.ring.terms.viewer {
            return Ok(true);
        }
        let Viewer { current, ready } = &mut self.viewer;
        while *ready < Some(*current)
            && let Some(sample) = self.ready.next_sample()?
        {
            *ready = (*ready).max(Some(sample.payload().restarts));
        }
        Ok(*ready >= Some(*current))
    }

    /// Supervises the processes when one has died, and now and then.
    fn supervise(&mut self, tally: &Tally, supervise: &mut Supervise) -> Result<(), Error> {
        if self.alarm.rung() || self.supervised.elapsed() >= SUPERVISE {
            self.supervised = Instant::now();
            self.viewer.current = supervise(tally)?;
        }
        Ok(())
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

    /// Reads which slots have begun. One is late if it comes more than one and a half periods after the last.
    fn read<S: Service>(&mut self, ticks: &mut Reader<S, Tick, SlotHeader>) -> Result<(), RingError> {
        let Some(period) = self.period else { return Ok(()) };
        while let Some(tick) = ticks.next_sample()? {
            let SlotHeader { slot, sent_ns, .. } = *tick.user_header();
            if let Some((_, last_ns)) = self.last.replace((slot, sent_ns)) {
                let apart = Duration::from_nanos(sent_ns.saturating_sub(last_ns));
                self.late_slots += u64::from(apart > period.mul_f64(1.5));
            }
        }
        Ok(())
    }

    /// When a slot began.
    fn began(&self, slot: u64) -> Option<u64> {
        self.last.filter(|(last, _)| *last == slot).map(|(_, sent_ns)| sent_ns)
    }
}
