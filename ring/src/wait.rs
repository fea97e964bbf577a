//! How the processes of a ring wait for messages: asleep until they are woken, or polling, and what ends a wait.

use std::fmt;
use std::str::FromStr;
use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::Service;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use signal_hook::consts::{SIGINT, SIGTERM};
use skysink_common::stop::Stop;

use crate::error::NodeError;
use crate::role::{Role, Seat};

/// How a process waits for messages.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Waiting {
    /// Asleep, until the writer wakes it.
    #[default]
    Event,
    /// Polling, which keeps a core busy for each process: for machines with cores to spare.
    Poll,
}

/// Longest sleep: somebody may have just joined, and a ring that stands still should not wait for long.
pub(crate) const PAUSE: Duration = Duration::from_millis(10);

/// Polls in a row before the core is offered to others: where there are fewer cores than processes, the one whose
/// message is awaited needs it.
const POLLS: u32 = 64;

/// Why a way of waiting is refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("wait {0}: expected event or poll")]
pub struct WaitingError(String);

impl Waiting {
    /// Every way, by its spelling.
    const ALL: [(Self, &'static str); 2] = [(Self::Event, "event"), (Self::Poll, "poll")];

    /// Waits a little for what `look` finds in `reader`: until its listener is notified, or for some polls, at most for 10 ms.
    ///
    /// Whoever polls leaves the listener alone: notifying one that is notified already costs its writer next to nothing.
    ///
    /// # Errors
    /// Those of `look`.
    pub fn poll<S: Service, R, T, E>(
        self,
        reader: &mut R,
        listener: impl Fn(&R) -> &Listener<S>,
        mut look: impl FnMut(&mut R) -> Result<Option<T>, E>,
    ) -> Result<Option<T>, E> {
        match self {
            Self::Event => {
                let _ = listener(reader).timed_wait(|_| {}, PAUSE); // an interrupted wait is a short one
                look(reader)
            }
            Self::Poll => {
                for _ in 0..POLLS {
                    if let Some(found) = look(reader)? {
                        return Ok(Some(found));
                    }
                    std::hint::spin_loop();
                }
                std::thread::yield_now();
                Ok(None)
            }
        }
    }
}

impl FromStr for Waiting {
    type Err = WaitingError;

    fn from_str(text: &str) -> Result<Self, WaitingError> {
        let found = Self::ALL.into_iter().find(|(_, name)| *name == text);
        found.map(|(waiting, _)| waiting).ok_or_else(|| WaitingError(text.to_owned()))
    }
}

impl fmt::Display for Waiting {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Event => "event",
            Self::Poll => "poll",
        })
    }
}

impl Serialize for Waiting {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Waiting {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

/// A [`Stop`] that SIGINT and SIGTERM request.
///
/// # Panics
/// If the operating system refuses a handler for them, which it never does.
#[must_use]
pub fn stop_on_signals() -> Stop {
    let stop = Stop::default();
    for signal in [SIGINT, SIGTERM] {
        let number = usize::try_from(signal).expect("signals are positive");
        signal_hook::flag::register_usize(signal, stop.flag(), number).expect("a catchable signal");
    }
    stop
}

/// What a process watches while it waits: the request to stop, its supervisor, its heartbeat, and the time.
#[derive(Debug)]
pub struct WaitContext {
    stop: Stop,
    supervisor: Option<Supervisor>,
    supervised: Instant,
    seat: Option<Seat>,
    idled: Instant,
    timeout: Duration,
    waiting: Waiting,
}

/// How often the supervisor's lock is tried.
const SUPERVISOR_CHECK: Duration = Duration::from_millis(500);

impl WaitContext {
    /// A wait context: waits as `waiting` says, ends on `stop`, on the supervisor's death or after `timeout`, and keeps
    /// the heartbeat of `seat` going.
    #[must_use]
    pub fn new(
        stop: Stop,
        supervisor: Option<Supervisor>,
        seat: Option<Seat>,
        timeout: Duration,
        waiting: Waiting,
    ) -> Self {
        let now = Instant::now();
        Self { stop, supervisor, supervised: now, seat, idled: now, timeout, waiting }
    }

    /// The request to stop.
    #[must_use]
    pub fn stop(&self) -> &Stop {
        &self.stop
    }

    /// Waits until `look` finds something in `reader`, and returns it. `what` is the topic and the slot of the message,
    /// and who should send it, for the time-out.
    ///
    /// `look` runs before the first wait and after every one, because iceoryx2 may lose a notification; `idle` runs now
    /// and then while nothing is found, and is the place to serve late joiners.
    ///
    /// # Errors
    /// Those of `look` and `idle`, a requested stop, the supervisor's death, or the time-out.
    pub(crate) fn wait<S: Service, R, T, E: From<NodeError>>(
        &mut self,
        (topic, slot, from): (&'static str, u64, Role),
        reader: &mut R,
        mut look: impl FnMut(&mut R) -> Result<Option<T>, E>,
        listener: impl Fn(&R) -> &Listener<S>,
        mut idle: impl FnMut() -> Result<(), E>,
    ) -> Result<T, E> {
        let start = Instant::now();
        let mut now = start;
        self.beat(start); // a process that always finds its message gets no further
        self.idle(start, &mut idle)?;
        if let Some(found) = look(reader)? {
            return Ok(found);
        }
        loop {
            self.check(now)?;
            if let Some(found) = self.waiting.poll(reader, &listener, &mut look)? {
                return Ok(found);
            }
            now = Instant::now();
            self.idle(now, &mut idle)?;
            if now - start >= self.timeout {
                let what = format!("{topic}({slot})");
                return Err(NodeError::TimedOut { what, from: from.name(), seconds: self.timeout.as_secs_f64() }.into());
            }
        }
    }

    /// Shows that the process is alive; fails once a stop is requested or the supervisor is dead.
    fn check(&mut self, now: Instant) -> Result<(), NodeError> {
        self.stop.check()?;
        self.beat(now);
        if let Some(supervisor) = &mut self.supervisor
            && now - self.supervised >= SUPERVISOR_CHECK
        {
            self.supervised = now;
            if !supervisor.alive() {
                return Err(NodeError::Orphaned);
            }
        }
        Ok(())
    }

    fn beat(&mut self, now: Instant) {
        if let Some(seat) = &mut self.seat {
            seat.beat(now);
        }
    }

    /// Runs `idle` if it has not run for a while.
    fn idle<E>(&mut self, now: Instant, idle: &mut impl FnMut() -> Result<(), E>) -> Result<(), E> {
        if now.saturating_duration_since(self.idled) >= PAUSE {
            self.idled = now;
            idle()?;
        }
        Ok(())
    }

    /// Sleeps until `deadline`; ends early with a requested stop. `idle` runs now and then.
    ///
    /// # Errors
    /// Those of `idle`, [`Stopped`], or [`NodeError::Orphaned`].
    pub fn sleep_until<E: From<NodeError>>(
        &mut self,
        deadline: Instant,
        mut idle: impl FnMut() -> Result<(), E>,
    ) -> Result<(), E> {
        loop {
            let now = Instant::now();
            self.check(now)?;
            self.idle(now, &mut idle)?;
            let remaining = deadline.saturating_duration_since(now);
            if remaining.is_zero() {
                return Ok(());
            }
            std::thread::sleep(remaining.min(PAUSE));
        }
    }
}

/// The watch over the process that supervises the ring: it holds a lock as long as it lives.
#[derive(Debug)]
pub struct Supervisor {
    lock: std::fs::File,
}

impl Supervisor {
    /// Watches the holder of the lock file.
    #[must_use]
    pub fn new(lock: std::fs::File) -> Self {
        Self { lock }
    }

    /// Whether somebody holds the lock.
    fn alive(&mut self) -> bool {
        match self.lock.try_lock_shared() {
            Ok(()) => {
                let _ = self.lock.unlock();
                false
            }
            Err(_) => true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_way_of_waiting_is_read_as_it_is_written() {
        for (waiting, text) in Waiting::ALL {
            assert_eq!(text.parse(), Ok(waiting));
            assert_eq!(waiting.to_string(), text);
        }
    }

    #[test]
    fn a_way_that_is_none_is_refused() {
        for text in ["", "Event", "spin", "events"] {
            assert_eq!(
                text.parse::<Waiting>().unwrap_err().to_string(),
                format!("wait {text}: expected event or poll")
            );
        }
    }
}
