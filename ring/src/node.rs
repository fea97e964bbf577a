//! What every process of the ring shares: its role, when to stop, and how to wait for a message.

use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::Service;
use signal_hook::consts::{SIGINT, SIGTERM};

use skysink_common::scenario::ScenarioError;
use skysink_common::sensors::SensorListError;
use skysink_common::stop::{Stop, Stopped};

use crate::claim::Claim;
use crate::ring::RingError;
use crate::waiting::{LOOK_AROUND, Waiting};

/// A process of the ring.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Owns the queues and the slot clock.
    FieldSim,
    /// Owns the UAV and the channel.
    FlightSim,
    /// Decides whom to serve and where to fly.
    Planner,
    /// Logs everything to rerun.
    Viewer,
    /// `skysink run`: launches the others and records.
    Launcher,
}

impl Role {
    /// Every process, by its number in messages.
    pub const ALL: [Self; 5] = [Self::FieldSim, Self::FlightSim, Self::Planner, Self::Viewer, Self::Launcher];

    /// The number in messages.
    #[must_use]
    pub fn code(self) -> u32 {
        self as u32
    }

    /// The process of a number.
    #[must_use]
    pub fn of_code(code: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|role| role.code() == code)
    }

    /// The name of the executable.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::FieldSim => "field-sim",
            Self::FlightSim => "flight-sim",
            Self::Planner => "planner",
            Self::Viewer => "viewer",
            Self::Launcher => "skysink",
        }
    }
}

/// Why a process of the ring ends before the mission does.
#[derive(Debug, thiserror::Error)]
pub enum NodeError {
    /// A signal asked for it.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// A peer did not answer in time.
    #[error("waited {seconds} s for {what}: is {from} running?")]
    TimedOut {
        /// What did not come.
        what: String,
        /// Who should have sent it.
        from: &'static str,
        /// How long it was waited for.
        seconds: f64,
    },
    /// Nobody supervises the ring any more.
    #[error("skysink run has ended without stopping this process")]
    Orphaned,
    /// A peer sent what cannot be.
    #[error("{0}")]
    Peer(String),
    /// The ring cannot be used.
    #[error(transparent)]
    Ring(#[from] RingError),
    /// The scenario is refused.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// The sensor list is refused.
    #[error(transparent)]
    Sensors(#[from] SensorListError),
}

impl NodeError {
    /// Exit code of a process that ends with this error.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Stopped(stopped) => stopped.exit_code(),
            Self::Scenario(_)
            | Self::Sensors(_)
            | Self::Peer(_)
            | Self::Ring(RingError::Folder { .. } | RingError::Differs { .. } | RingError::Taken { .. }) => 2,
            Self::TimedOut { .. } | Self::Orphaned | Self::Ring(_) => 1,
        }
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

/// Patience of a process: what it watches while it waits.
#[derive(Debug)]
pub struct Patience {
    stop: Stop,
    supervisor: Option<Supervisor>,
    supervised: Instant,
    claim: Option<Claim>,
    idled: Instant,
    timeout: Duration,
    waiting: Waiting,
}

/// How often the supervisor's lock is tried.
const SUPERVISOR_CHECK: Duration = Duration::from_millis(500);

impl Patience {
    /// Waits, in the way `waiting`, that end with `stop`, with the death of `supervisor`, or after `timeout` without the
    /// message, and that show by `claim` that the process is alive.
    #[must_use]
    pub fn new(
        stop: Stop,
        supervisor: Option<Supervisor>,
        claim: Option<Claim>,
        timeout: Duration,
        waiting: Waiting,
    ) -> Self {
        let now = Instant::now();
        Self { stop, supervisor, supervised: now, claim, idled: now, timeout, waiting }
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
        bell: impl Fn(&R) -> &Listener<S>,
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
            if let Some(found) = self.waiting.look(reader, &bell, &mut look)? {
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
        if let Some(claim) = &mut self.claim {
            claim.beat(now);
        }
    }

    /// Runs `idle` if it has not run for a while.
    fn idle<E>(&mut self, now: Instant, idle: &mut impl FnMut() -> Result<(), E>) -> Result<(), E> {
        if now.saturating_duration_since(self.idled) >= LOOK_AROUND {
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
            std::thread::sleep(remaining.min(LOOK_AROUND));
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
