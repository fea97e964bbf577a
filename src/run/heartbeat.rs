//! The signs of life of a process, as its supervisor sees them.

use std::time::{Duration, Instant, SystemTime};

use skysink_ring::health::ProcessEvent;
use skysink_ring::wait::Stopwatch;

/// A process that has shown itself and then gives no sign of life for so long is reported. Time in which the supervisor
/// does not run either does not count: after a laptop's sleep everybody was silent.
pub(crate) const SILENT_AFTER: Duration = Duration::from_secs(1);

/// The signs of life of a process.
#[derive(Debug)]
pub struct Heartbeat {
    last: Option<SystemTime>,
    since: Stopwatch,
    state: State,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// No sign yet: it is on its way.
    Awaited,
    Alive,
    Silent,
}

impl Heartbeat {
    /// No sign yet but `last`, which the process before it has left.
    #[must_use]
    pub fn after(last: Option<SystemTime>) -> Self {
        Self { last, since: Stopwatch::start(Instant::now()), state: State::Awaited }
    }

    /// Notes the last sign of life; returns what is new.
    pub fn note(&mut self, last: Option<SystemTime>, now: Instant) -> Option<ProcessEvent> {
        let silence = self.since.advance(now);
        let ms = i32::try_from(silence.as_millis()).unwrap_or(i32::MAX);
        if self.last != last {
            let before = std::mem::replace(&mut self.state, State::Alive);
            self.last = last;
            self.since = Stopwatch::start(now);
            return (before == State::Silent).then_some(ProcessEvent::Back(ms));
        }
        if self.state == State::Alive && silence >= SILENT_AFTER {
            self.state = State::Silent;
            return Some(ProcessEvent::Silent(ms));
        }
        None
    }

    /// Whether there has been no sign of life for so long.
    #[must_use]
    pub fn is_silent_for(&self, long: Duration) -> bool {
        self.state == State::Silent && self.since.elapsed() >= long
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn beat(ms: u64) -> Option<SystemTime> {
        Some(SystemTime::UNIX_EPOCH + Duration::from_millis(ms))
    }

    /// What is new in polls every 100 ms, from one time [ms] to another, with the last beat at `last`.
    fn poll(
        heartbeat: &mut Heartbeat,
        start: Instant,
        times: std::ops::Range<u64>,
        last: Option<SystemTime>,
    ) -> Vec<ProcessEvent> {
        times.step_by(100).filter_map(|ms| heartbeat.note(last, start + Duration::from_millis(ms))).collect()
    }

    #[test]
    fn a_process_without_a_heartbeat_is_reported_once_and_so_is_its_return() {
        let start = Instant::now();
        let mut heartbeat = Heartbeat { since: Stopwatch::start(start), ..Heartbeat::after(None) };
        assert_eq!(poll(&mut heartbeat, start, 0..5_000, None), [], "it may still be on its way");
        assert_eq!(poll(&mut heartbeat, start, 5_000..6_000, beat(1)), []);
        assert_eq!(poll(&mut heartbeat, start, 6_000..7_500, beat(1)), [ProcessEvent::Silent(1_000)]);
        assert!(heartbeat.is_silent_for(Duration::from_secs(2)) && !heartbeat.is_silent_for(Duration::from_secs(3)));
        assert_eq!(poll(&mut heartbeat, start, 7_500..8_000, beat(2)), [ProcessEvent::Back(2_500)]);
    }

    #[test]
    fn a_machine_that_slept_has_no_silent_processes() {
        let start = Instant::now();
        let mut heartbeat = Heartbeat { since: Stopwatch::start(start), ..Heartbeat::after(None) };
        assert_eq!(poll(&mut heartbeat, start, 0..100, beat(1)), []);
        assert_eq!(poll(&mut heartbeat, start, 60_000..60_100, beat(1)), [], "a minute later, at its first poll");
        assert_eq!(poll(&mut heartbeat, start, 60_100..60_200, beat(2)), []);
    }
}
