//! The signs of life of a process, as its supervisor sees them.

use std::time::{Duration, Instant, SystemTime};

use skysink_ring::health::Fate;

/// A process that has shown itself and then gives no sign of life for so long is reported.
const SILENT_AFTER: Duration = Duration::from_secs(1);

/// The signs of life of a process.
#[derive(Debug)]
pub struct Heartbeat {
    last: Option<SystemTime>,
    since: Instant,
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
        Self { last, since: Instant::now(), state: State::Awaited }
    }

    /// Notes the last sign of life; returns what is new.
    pub fn note(&mut self, last: Option<SystemTime>, now: Instant) -> Option<Fate> {
        let silence = now.saturating_duration_since(self.since);
        let ms = i32::try_from(silence.as_millis()).unwrap_or(i32::MAX);
        if self.last != last {
            let before = std::mem::replace(&mut self.state, State::Alive);
            self.last = last;
            self.since = now;
            return (before == State::Silent).then_some(Fate::Back(ms));
        }
        if self.state == State::Alive && silence >= SILENT_AFTER {
            self.state = State::Silent;
            return Some(Fate::Silent(ms));
        }
        None
    }

    /// Whether there has been no sign of life for so long.
    #[must_use]
    pub fn is_silent_for(&self, long: Duration, now: Instant) -> bool {
        self.state == State::Silent && now.saturating_duration_since(self.since) >= long
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_without_a_heartbeat_is_reported_once_and_so_is_its_return() {
        let mut heartbeat = Heartbeat::after(None);
        let start = heartbeat.since;
        let at = |ms| start + Duration::from_millis(ms);
        let beat = |ms| Some(SystemTime::UNIX_EPOCH + Duration::from_millis(ms));
        assert_eq!(heartbeat.note(None, at(5_000)), None, "it may still be on its way");
        assert_eq!(heartbeat.note(beat(1), at(5_100)), None);
        assert_eq!(heartbeat.note(beat(1), at(6_000)), None);
        assert_eq!(heartbeat.note(beat(1), at(6_200)), Some(Fate::Silent(1_100)));
        assert_eq!(heartbeat.note(beat(1), at(7_000)), None);
        assert_eq!(heartbeat.note(beat(2), at(7_600)), Some(Fate::Back(2_500)));
        assert_eq!(heartbeat.note(beat(2), at(7_700)), None);
    }
}
