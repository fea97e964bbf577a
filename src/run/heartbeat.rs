//! The heartbeat of a process, as seen by its supervisor.

use std::time::{Duration, Instant, SystemTime};

use skysink_ring::health::ProcessEvent;
use skysink_ring::wait::Stopwatch;

/// A process whose heartbeat stops for this long is reported as silent. Time in which the supervisor was suspended,
/// too, does not count.
pub(crate) const SILENT_AFTER: Duration = Duration::from_secs(1);

/// The heartbeat of a process.
#[derive(Debug)]
pub struct Heartbeat {
    /// Time of the last beat.
    last: Option<SystemTime>,
    /// Time since that beat was noticed.
    since: Stopwatch,
    state: HeartbeatState,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum HeartbeatState {
    /// No beat yet: the process is starting.
    Awaited,
    Alive,
    Silent,
}

impl Heartbeat {
    /// The heartbeat of a process that is starting. `last` is the last beat of its predecessor.
    pub fn after(last: Option<SystemTime>) -> Self {
        Self { last, since: Stopwatch::start(Instant::now()), state: HeartbeatState::Awaited }
    }

    /// Takes in the time of the last beat; returns the change of state, if any.
    pub fn update(&mut self, last: Option<SystemTime>, now: Instant) -> Option<ProcessEvent> {
        let silence = self.since.advance(now);
        let ms = i32::try_from(silence.as_millis()).unwrap_or(i32::MAX);
        if self.last != last {
            let before = std::mem::replace(&mut self.state, HeartbeatState::Alive);
            self.last = last;
            self.since = Stopwatch::start(now);
            return (before == HeartbeatState::Silent).then_some(ProcessEvent::Recovered(ms));
        }
        if self.state == HeartbeatState::Alive && silence >= SILENT_AFTER {
            self.state = HeartbeatState::Silent;
            return Some(ProcessEvent::Silent(ms));
        }
        None
    }

    /// Whether the process is silent, for at least `limit`.
    pub fn is_silent_for(&self, limit: Duration) -> bool {
        self.state == HeartbeatState::Silent && self.since.elapsed() >= limit
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn beat(ms: u64) -> Option<SystemTime> {
        Some(SystemTime::UNIX_EPOCH + Duration::from_millis(ms))
    }

    /// The changes in polls every 100 ms over `times` [ms], with the last beat at `last`.
    fn poll(
        heartbeat: &mut Heartbeat,
        start: Instant,
        times: std::ops::Range<u64>,
        last: Option<SystemTime>,
    ) -> Vec<ProcessEvent> {
        times.step_by(100).filter_map(|ms| heartbeat.update(last, start + Duration::from_millis(ms))).collect()
    }

    #[test]
    fn a_silent_process_and_its_recovery_are_reported_once() {
        let start = Instant::now();
        let mut heartbeat = Heartbeat { since: Stopwatch::start(start), ..Heartbeat::after(None) };
        assert_eq!(poll(&mut heartbeat, start, 0..5_000, None), [], "it may still be starting");
        assert_eq!(poll(&mut heartbeat, start, 5_000..6_000, beat(1)), []);
        assert_eq!(poll(&mut heartbeat, start, 6_000..7_500, beat(1)), [ProcessEvent::Silent(1_000)]);
        assert!(heartbeat.is_silent_for(Duration::from_secs(2)) && !heartbeat.is_silent_for(Duration::from_secs(3)));
        assert_eq!(poll(&mut heartbeat, start, 7_500..8_000, beat(2)), [ProcessEvent::Recovered(2_500)]);
    }

    #[test]
    fn a_suspended_machine_makes_no_process_silent() {
        let start = Instant::now();
        let mut heartbeat = Heartbeat { since: Stopwatch::start(start), ..Heartbeat::after(None) };
        assert_eq!(poll(&mut heartbeat, start, 0..100, beat(1)), []);
        assert_eq!(poll(&mut heartbeat, start, 60_000..60_100, beat(1)), [], "a minute later, at its first poll");
        assert_eq!(poll(&mut heartbeat, start, 60_100..60_200, beat(2)), []);
    }
}
