//! The plans of a paced run, in which no process waits for them: notices a planner that sends none, and slots in which
//! the UAV holds because there is no plan.

use std::time::{Duration, Instant};

use skysink_ring::health::ProcessEvent;
use skysink_ring::role::Role;
use skysink_ring::wait::Stopwatch;

use crate::run::heartbeat::SILENT_AFTER;
use crate::run::supervise::SampleEvent;

/// Why a UAV had no plan when its slot began.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LateMessage {
    /// The planner had the flight in time.
    Plan,
    /// The flight of the slot before came after that slot, this long after its beginning: there was no time to plan.
    Flight(Duration),
}

/// The plans of a paced run.
#[derive(Debug)]
pub struct PlanWatch {
    /// Without a plan that it can make for this long, the planner is reported: a second after its next plan was due.
    report_after: Duration,
    /// Without one for each multiple of this, the planner is hung.
    limit: Duration,
    /// The last slot of the mission, after which there is no plan.
    last_slot: u64,
    /// The slot of the newest plan.
    newest: Option<u64>,
    /// Time since it has come, or since there are newer queues to plan for.
    since: Stopwatch,
    is_reported: bool,
    /// When the planner is hung for the next time.
    hung_after: Duration,
    /// Number of slots held in a row.
    held: i32,
    /// How many of them were reported.
    held_reported: i32,
    /// How many of them followed a late flight.
    late_flights: i32,
    /// How long the last late flight took.
    flight_took: Duration,
    /// Time since the first of them.
    held_for: Stopwatch,
    /// When they are reported for the next time.
    report_held_after: Duration,
}

impl PlanWatch {
    /// The plans of a run with slots every `period` of wall time, up to `last_slot`. After `limit` without a plan the
    /// planner is hung.
    pub fn new(period: Duration, limit: Duration, last_slot: u64, now: Instant) -> Self {
        Self {
            report_after: SILENT_AFTER.saturating_add(period),
            limit,
            last_slot,
            newest: None,
            since: Stopwatch::start(now),
            is_reported: false,
            hung_after: limit,
            held: 0,
            held_reported: 0,
            late_flights: 0,
            flight_took: Duration::ZERO,
            held_for: Stopwatch::start(now),
            report_held_after: SILENT_AFTER,
        }
    }

    /// How long after the beginning of a slot its flight is reported as overdue: a second after it was due.
    pub fn report_after(&self) -> Duration {
        self.report_after
    }

    /// Takes in the slots of the newest plan and of the newest queues; returns a change of the planner. Before there
    /// are queues after those of its newest plan, the planner has nothing to plan for: another process may be silent.
    pub fn poll(&mut self, newest: Option<u64>, queues: Option<u64>, now: Instant) -> Option<SampleEvent> {
        self.held_for.advance(now);
        let waited = self.since.advance(now);
        let ms = i32::try_from(waited.as_millis()).unwrap_or(i32::MAX);
        let is_new = newest > self.newest;
        if is_new || queues < newest {
            self.newest = newest;
            self.since = Stopwatch::start(now);
            self.hung_after = self.limit;
            let has_recovered = is_new && std::mem::take(&mut self.is_reported);
            return has_recovered.then_some(event(ProcessEvent::Recovered(ms), false));
        }
        let is_hung = waited >= self.hung_after;
        let is_overdue = is_hung || !self.is_reported && waited >= self.report_after;
        if !is_overdue || newest >= Some(self.last_slot) {
            return None;
        }
        self.is_reported = true;
        if is_hung {
            self.hung_after = waited.saturating_add(self.limit);
        }
        Some(event(ProcessEvent::Overdue(ms), is_hung))
    }

    /// Counts a slot in which the UAV held for want of a plan, because of a late message, or not. Held slots in a row
    /// are reported after 1, 10, 100 seconds, and so on.
    pub fn count(&mut self, late: Option<LateMessage>, now: Instant) -> Option<SampleEvent> {
        let Some(late) = late else {
            self.held = 0;
            self.held_reported = 0;
            self.late_flights = 0;
            return None;
        };
        if let LateMessage::Flight(took) = late {
            self.late_flights += 1;
            self.flight_took = took;
        }
        if self.held == 0 {
            self.held_for = Stopwatch::start(now);
            self.report_held_after = SILENT_AFTER;
        }
        self.held = self.held.saturating_add(1);
        if self.held_for.advance(now) < self.report_held_after {
            return None;
        }
        self.report_held_after = self.report_held_after.saturating_mul(10);
        self.held_reported = self.held;
        Some(self.held_event())
    }

    /// The event of the process that the held slots in a row are due to: of flight-sim, if most followed a late flight.
    fn held_event(&self) -> SampleEvent {
        if self.late_flights > self.held / 2 {
            let ms = i32::try_from(self.flight_took.as_millis()).unwrap_or(i32::MAX);
            return SampleEvent { from: Role::FlightSim, event: ProcessEvent::Overdue(ms), is_hung: false };
        }
        event(ProcessEvent::Held(self.held), false)
    }

    /// Reports the slots held in a row up to the end of the mission, unless that is done.
    pub fn end(&self) -> Option<SampleEvent> {
        (self.held > 1 && self.held > self.held_reported).then(|| self.held_event())
    }
}

/// An event of the planner.
fn event(event: ProcessEvent, is_hung: bool) -> SampleEvent {
    SampleEvent { from: Role::Planner, event, is_hung }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SLOT: Duration = Duration::from_millis(500);
    const LIMIT: Duration = Duration::from_secs(20);

    /// The events in polls every 100 ms over `times` [ms] with the newest plan for slot `newest` and queues after it,
    /// and when they came.
    fn poll(
        watch: &mut PlanWatch,
        start: Instant,
        times: std::ops::Range<u64>,
        newest: u64,
    ) -> Vec<(u64, ProcessEvent, bool)> {
        let poll = |ms: u64| {
            let event = watch.poll(Some(newest), Some(newest), start + Duration::from_millis(ms))?;
            Some((ms, event.event, event.is_hung))
        };
        times.step_by(100).filter_map(poll).collect()
    }

    #[test]
    fn a_missing_plan_is_overdue_once_and_then_hung_at_intervals() {
        let start = Instant::now();
        let mut watch = PlanWatch::new(SLOT, LIMIT, 1_000, start);
        let overdue = |ms: u64, is_hung| (ms, ProcessEvent::Overdue(ms as i32), is_hung);
        assert_eq!(poll(&mut watch, start, 0..1_500, 1), []);
        let events = poll(&mut watch, start, 1_500..45_000, 1);
        assert_eq!(events, [overdue(1_500, false), overdue(20_000, true), overdue(40_000, true)]);
        assert_eq!(poll(&mut watch, start, 45_000..46_000, 90), [(45_000, ProcessEvent::Recovered(45_000), false)]);
        assert_eq!(poll(&mut watch, start, 46_000..46_500, 91), []);
        assert_eq!(poll(&mut watch, start, 46_500..60_000, 91), [(47_500, ProcessEvent::Overdue(1_500), false)]);
    }

    #[test]
    fn no_plan_is_awaited_after_the_last_slot() {
        let start = Instant::now();
        let mut watch = PlanWatch::new(SLOT, LIMIT, 7, start);
        assert_eq!(poll(&mut watch, start, 0..60_000, 7), []);
    }

    #[test]
    fn a_plan_is_awaited_only_after_its_queues() {
        let start = Instant::now();
        let mut watch = PlanWatch::new(SLOT, LIMIT, 1_000, start);
        let mut idle = |ms: u64| watch.poll(Some(8), Some(7), start + Duration::from_millis(ms));
        assert!((0..60_000).step_by(100).all(|ms| idle(ms).is_none()), "another process is silent");
        let events = poll(&mut watch, start, 60_000..62_000, 8);
        assert_eq!(events, [(61_400, ProcessEvent::Overdue(1_500), false)]);
    }

    #[test]
    fn held_slots_up_to_the_end_are_reported_once() {
        let start = Instant::now();
        let mut watch = PlanWatch::new(SLOT, LIMIT, 1_000, start);
        let mut held = |ms: u64| {
            let event = watch.count(Some(LateMessage::Plan), start + Duration::from_millis(ms));
            [event, watch.end()].map(|event| event.map(|event| event.event))
        };
        assert_eq!(held(0), [None, None], "one is not in a row");
        assert_eq!(held(100), [None, Some(ProcessEvent::Held(2))]);
        assert!((200..1_000).step_by(100).all(|ms| held(ms)[0].is_none()));
        assert_eq!(held(1_000), [Some(ProcessEvent::Held(11)), None], "that was reported");
        assert_eq!(held(1_100), [None, Some(ProcessEvent::Held(12))]);
        assert!(watch.count(None, start).is_none() && watch.end().is_none());
    }

    #[test]
    fn a_flight_that_leaves_no_time_to_plan_is_held_against_flight_sim() {
        let start = Instant::now();
        let mut watch = PlanWatch::new(SLOT, LIMIT, 1_000, start);
        let flight = Some(LateMessage::Flight(Duration::from_millis(700)));
        let mut slot = |ms: u64, held_for| {
            for ms in (ms.saturating_sub(400)..=ms).step_by(100) {
                let _ = watch.poll(Some(ms), Some(ms), start + Duration::from_millis(ms));
            }
            watch.count(held_for, start + Duration::from_millis(ms))
        };
        assert!(slot(0, Some(LateMessage::Plan)).is_none() && slot(500, flight).is_none());
        let late = slot(1_000, flight).unwrap();
        assert_eq!((late.from, late.event, late.is_hung), (Role::FlightSim, ProcessEvent::Overdue(700), false));
        assert!(slot(1_500, None).is_none() && slot(2_000, flight).is_none());
        assert!(slot(2_500, Some(LateMessage::Plan)).is_none());
        let held = slot(3_000, Some(LateMessage::Plan)).unwrap();
        assert_eq!(
            (held.from, held.event),
            (Role::Planner, ProcessEvent::Held(3)),
            "most plans were late by themselves"
        );
    }

    #[test]
    fn consecutive_held_slots_are_reported_at_growing_intervals() {
        let start = Instant::now();
        let mut watch = PlanWatch::new(SLOT, LIMIT, 1_000, start);
        let mut slots = |slots: std::ops::Range<u64>, is_held: bool| {
            let mut events = Vec::new();
            for ms in slots.step_by(100) {
                let now = start + Duration::from_millis(ms);
                let _ = watch.poll(Some(ms), Some(ms), now); // there are plans, but late ones
                let slot = (ms % 500 == 0).then(|| watch.count(is_held.then_some(LateMessage::Plan), now)).flatten();
                events.extend(slot.map(|event| (ms, event.event)));
            }
            events
        };
        let held = |ms, slots| (ms, ProcessEvent::Held(slots));
        assert_eq!(slots(0..1_000, true), []);
        assert_eq!(slots(1_000..60_000, true), [held(1_000, 3), held(10_000, 21)]);
        assert_eq!(slots(60_000..61_000, false), []);
        assert_eq!(slots(61_000..63_000, true), [held(62_000, 3)]);
    }
}
