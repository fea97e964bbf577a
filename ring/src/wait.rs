//! How the processes of a ring wait for messages: asleep until they are woken, or polling, and what ends a wait.

use std::cell::RefCell;
use std::fmt::Debug;
use std::fs::File;
use std::rc::{Rc, Weak};
use std::sync::Arc;
use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::Service;
use serde::{Deserialize, Serialize};
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use skysink_common::stop::Stop;
use strum::{Display, EnumString, VariantArray, VariantNames};

use crate::error::{NodeError, RingError};
use crate::role::{Role, Seat};

/// How a process waits for messages.
#[derive(
    Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, Display, EnumString, VariantArray, VariantNames,
)]
#[serde(rename_all = "lowercase")]
#[strum(serialize_all = "lowercase")]
pub enum Waiting {
    /// Polling for as long as a sleep and its wake-up take, then asleep.
    #[default]
    Adaptive,
    /// Asleep, until the writer wakes it.
    Event,
    /// Polling, which is quicker and keeps every core busy.
    Poll,
}

/// Longest sleep: somebody may have just joined, and a ring that stands still should not wait for long.
pub(crate) const PAUSE: Duration = Duration::from_millis(10);

/// Polls in a row before the core is offered to others: where there are fewer cores than processes, the one whose
/// message is awaited needs it.
const POLLS: u32 = 8;

/// Polls in a row before an adaptive wait sleeps: some 50 µs, about as long as a sleep and its wake-up take.
const POLLS_BEFORE_SLEEP: u32 = 512;

/// After a wait that took longer, the next one for the same topic sleeps at once: nothing comes while it polls.
const LONG_WAIT: Duration = Duration::from_micros(150);

/// Of so many slots in so many every wait polls at first: where all sleep because all have slept, nobody would find that
/// polling is quicker.
const PROBED: u64 = 2;

/// See [`PROBED`].
const PROBE_EVERY: u64 = 64;

/// Whoever offers its core and does not get it back for so long shares it with a program that computes all the time.
const CORE_TAKEN: Duration = Duration::from_micros(200);

/// Fewest and most waits that then sleep at once: whoever sleeps is woken when its message comes, whoever offers its core
/// comes back when the other's time slice ends.
const ASLEEP_WAITS: [u32; 2] = [64, 16_384];

impl Waiting {
    /// All of them.
    pub const ALL: &'static [Self] = <Self as VariantArray>::VARIANTS;

    /// The names of all.
    pub const NAMES: &'static [&'static str] = <Self as VariantNames>::VARIANTS;

    /// Whether a process sleeps after so many polls in vain.
    fn sleeps_after(self, polls: u32) -> bool {
        match self {
            Self::Adaptive => polls >= POLLS_BEFORE_SLEEP,
            Self::Event => true,
            Self::Poll => false,
        }
    }

    /// Pauses after so many polls in vain: until `listener` is notified, for 10 ms at most, or until the next poll.
    ///
    /// Whoever polls leaves the listener alone: notifying it once more costs its writer next to nothing.
    pub fn pause<S: Service>(self, listener: &Listener<S>, polls: u32) {
        if self.sleeps_after(polls) {
            let _ = listener.timed_wait(|_| {}, PAUSE); // an interrupted wait is a short one
        } else if polls.is_multiple_of(POLLS) {
            std::thread::yield_now();
        } else {
            std::hint::spin_loop();
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

/// Signals that follow each other so closely are one: `timeout` sends a process two.
const ONE_SIGNAL: Duration = Duration::from_millis(200);

/// Ends the process at once with the second SIGINT or SIGTERM, whatever it waits for.
///
/// # Panics
/// As [`stop_on_signals`].
pub fn exit_on_second_signal() {
    let mut signals = Signals::new([SIGINT, SIGTERM]).expect("catchable signals");
    std::thread::spawn(move || {
        let mut first: Option<Instant> = None;
        for signal in signals.forever() {
            if first.get_or_insert_with(Instant::now).elapsed() >= ONE_SIGNAL {
                signal_hook::low_level::exit(128 + signal);
            }
        }
    });
}

/// A writer with readers that may join late.
pub(crate) trait ServeJoiners: Debug {
    /// Sends late joiners the newest samples, and wakes them.
    fn serve_joiners(&self) -> Result<(), RingError>;
}

/// The writers of a process, whose late joiners are served as long as they live.
#[derive(Debug, Clone, Default)]
pub(crate) struct LateJoiners(pub(crate) Rc<RefCell<Vec<Weak<dyn ServeJoiners>>>>);

/// A wait context: ends waits on a requested stop, on the supervisor's death or, in the launcher, after a time-out;
/// keeps the heartbeat going, and serves late joiners.
#[derive(Debug)]
pub struct WaitContext {
    pub(crate) stop: Stop,
    /// The supervisor's lock file; none in the launcher.
    pub(crate) supervisor: Option<File>,
    /// None in the launcher.
    pub(crate) seat: Option<Arc<Seat>>,
    pub(crate) late_joiners: LateJoiners,
    /// How long a sample is waited for: in the launcher alone, which knows who is at the beginning of the chain.
    pub(crate) timeout: Option<Duration>,
    pub(crate) waiting: Waiting,
    pub(crate) supervised: Instant,
    pub(crate) served: Instant,
    /// How often late joiners are served.
    pub(crate) serve_every: Duration,
    pub(crate) polls: u32,
    pub(crate) shared_core: SharedCore,
    /// Topics whose last sample was waited for so long that polling for the next one would be in vain.
    pub(crate) slow_topics: Vec<&'static str>,
}

/// Whether others compute on the cores that an adaptive wait offers while it polls.
#[derive(Debug, Default)]
pub(crate) struct SharedCore {
    /// Waits that sleep at once.
    asleep: u32,
    /// How many they were the last time.
    backoff: u32,
    /// Waits since then that polled and kept their core.
    undisturbed: u32,
}

/// So many of them in a row, and the next core that is taken is the first again.
const UNDISTURBED_WAITS: u32 = 64;

impl SharedCore {
    /// Counts a wait; whether it polls before it sleeps.
    fn may_poll(&mut self) -> bool {
        if self.asleep > 0 {
            self.asleep -= 1;
            return false;
        }
        self.undisturbed = self.undisturbed.saturating_add(1);
        if self.undisturbed > UNDISTURBED_WAITS {
            self.backoff = 0;
        }
        true
    }

    /// Notes how long the core was away that was offered. If too long, the next waits sleep at once, twice as many as the
    /// last time.
    fn note(&mut self, away: Duration) {
        if away >= CORE_TAKEN {
            let [fewest, most] = ASLEEP_WAITS;
            self.backoff = (2 * self.backoff).clamp(fewest, most);
            self.asleep = self.backoff;
            self.undisturbed = 0;
        }
    }
}

/// What a process waits for.
#[derive(Debug)]
pub struct Awaited {
    /// The topic.
    pub topic: &'static str,
    /// The slot of the sample.
    pub slot: u64,
    /// Who should send it.
    pub from: Role,
    /// How long it has been waited for.
    pub waited: Stopwatch,
    /// How long it is waited for; none in the processes of the ring, which leave that to the launcher.
    pub timeout: Option<Duration>,
}

/// Measures time only while this process runs: a longer gap between two looks at the clock is that of a process, or a
/// machine, that was stopped.
#[derive(Debug, Clone, Copy)]
pub struct Stopwatch {
    last: Instant,
    elapsed: Duration,
}

/// Longest time between two looks at the clock that counts.
const MAX_GAP: Duration = Duration::from_millis(200);

impl Stopwatch {
    /// Starts at zero.
    #[must_use]
    pub fn start(now: Instant) -> Self {
        Self { last: now, elapsed: Duration::ZERO }
    }

    /// Advances to `now`, and returns the time since the start.
    pub fn advance(&mut self, now: Instant) -> Duration {
        self.elapsed += now.saturating_duration_since(self.last).min(MAX_GAP);
        self.last = now;
        self.elapsed
    }

    /// The time from the start to the last advance.
    #[must_use]
    pub fn elapsed(&self) -> Duration {
        self.elapsed
    }
}

/// How often the supervisor's lock is tried.
const SUPERVISOR_CHECK: Duration = Duration::from_millis(500);

impl WaitContext {
    /// Begins a wait for the sample of `slot` on `topic`, which comes from `from`.
    ///
    /// # Errors
    /// If a late joiner cannot be served.
    pub fn begin(&mut self, topic: &'static str, slot: u64, from: Role) -> Result<Awaited, RingError> {
        let now = Instant::now();
        self.stay_present(now)?; // a process that always finds its sample gets no further
        // The first poll in vain offers the core to whoever is to send the sample.
        let is_slow = slot % PROBE_EVERY >= PROBED && self.slow_topics.contains(&topic);
        let may_poll = self.shared_core.may_poll() && !is_slow;
        self.polls = if may_poll { 0 } else { POLLS_BEFORE_SLEEP };
        Ok(Awaited { topic, slot, from, waited: Stopwatch::start(now), timeout: self.timeout })
    }

    /// Ends a wait whose sample is there.
    pub fn end(&mut self, mut awaited: Awaited) {
        let was_slow = awaited.waited.advance(Instant::now()) > LONG_WAIT;
        if was_slow != self.slow_topics.contains(&awaited.topic) {
            self.slow_topics.retain(|topic| *topic != awaited.topic);
            self.slow_topics.extend(was_slow.then_some(awaited.topic));
        }
    }

    /// Pauses until `listener` is notified, for 10 ms at most.
    ///
    /// # Errors
    /// A requested stop, the supervisor's death, or, in the launcher, the time-out.
    pub fn pause<S: Service>(&mut self, listener: &Listener<S>, awaited: &mut Awaited) -> Result<(), NodeError> {
        let has_slept = self.waiting.sleeps_after(self.polls);
        if self.waiting == Waiting::Adaptive && !has_slept && self.polls.is_multiple_of(POLLS) {
            let offered = Instant::now();
            self.waiting.pause(listener, self.polls);
            self.shared_core.note(offered.elapsed());
            if self.shared_core.asleep > 0 {
                self.polls = POLLS_BEFORE_SLEEP;
            }
        } else {
            self.waiting.pause(listener, self.polls);
        }
        self.polls = self.polls.wrapping_add(1);
        if !has_slept && !self.polls.is_multiple_of(POLLS) {
            return Ok(());
        }
        let now = Instant::now();
        self.check(now)?;
        let waited = awaited.waited.advance(now);
        match awaited.timeout {
            Some(timeout) if waited >= timeout => {
                let what = format!("{}({})", awaited.topic, awaited.slot);
                Err(NodeError::TimedOut { what, from: awaited.from.name(), seconds: timeout.as_secs_f64() })
            }
            _ => Ok(()),
        }
    }

    /// Sleeps until `deadline`.
    ///
    /// # Errors
    /// A requested stop, the supervisor's death, or a broken ring.
    pub fn sleep_until(&mut self, deadline: Instant) -> Result<(), NodeError> {
        loop {
            let now = Instant::now();
            self.check(now)?;
            let remaining = deadline.saturating_duration_since(now);
            if remaining.is_zero() {
                return Ok(());
            }
            std::thread::sleep(remaining.min(PAUSE));
        }
    }

    /// Fails once a stop is requested or the supervisor is dead.
    fn check(&mut self, now: Instant) -> Result<(), NodeError> {
        self.stop.check()?;
        self.stay_present(now)?;
        if let Some(lock) = &self.supervisor
            && now - self.supervised >= SUPERVISOR_CHECK
        {
            self.supervised = now;
            if lock.try_lock_shared().is_ok() {
                let _ = lock.unlock(); // for the others, who try it, too
                return Err(NodeError::Orphaned);
            }
        }
        Ok(())
    }

    /// Keeps the heartbeat going, and serves late joiners now and then.
    fn stay_present(&mut self, now: Instant) -> Result<(), RingError> {
        if let Some(seat) = &self.seat {
            seat.beat(now);
        }
        if now.saturating_duration_since(self.served) >= self.serve_every {
            self.served = now;
            // The newest writer first: a reader that attaches to topics in the order of their writers, and has a sample
            // of the last one, then soon has those of the others.
            let writers = self.late_joiners.0.borrow();
            writers.iter().rev().filter_map(Weak::upgrade).try_for_each(|writer| writer.serve_joiners())?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_sleep_at_once_while_another_program_takes_the_core() {
        let mut core = SharedCore::default();
        let poll = |core: &mut SharedCore, away_us| {
            let slept = (0..).take_while(|_| !core.may_poll()).count();
            core.note(Duration::from_micros(away_us));
            slept
        };
        assert_eq!([2, 199, 200, 5_000, 5_000].map(|away_us| poll(&mut core, away_us)), [0, 0, 0, 64, 128]);
        assert_eq!([2, 200, 2].map(|away_us| poll(&mut core, away_us)), [256, 0, 512]);
        assert_eq!((0..64).map(|_| poll(&mut core, 2)).max(), Some(0));
        assert_eq!([200, 2].map(|away_us| poll(&mut core, away_us)), [0, 64], "forgotten after as many waits");
        assert_eq!((0..20).map(|_| poll(&mut core, 5_000)).max(), Some(16_384), "at most");
    }

    #[test]
    fn a_stopwatch_counts_little_of_the_time_in_which_the_process_was_stopped() {
        let begin = Instant::now();
        let mut watch = Stopwatch::start(begin);
        assert_eq!(watch.advance(begin + Duration::from_millis(150)), Duration::from_millis(150));
        assert_eq!(watch.advance(begin + Duration::from_secs(3_600)), Duration::from_millis(350));
        assert_eq!(watch.elapsed(), Duration::from_millis(350));
    }

    #[test]
    fn a_topic_that_was_long_in_coming_is_waited_for_asleep_until_it_is_quick_again() {
        let now = Instant::now();
        let mut wait = WaitContext {
            stop: Stop::default(),
            supervisor: None,
            seat: None,
            late_joiners: LateJoiners::default(),
            timeout: None,
            waiting: Waiting::Adaptive,
            supervised: now,
            served: now,
            serve_every: PAUSE,
            polls: 0,
            shared_core: SharedCore::default(),
            slow_topics: Vec::new(),
        };
        let mut is_asleep = |topic, slot, waited: Duration| {
            let mut awaited = wait.begin(topic, slot, Role::Planner).unwrap();
            awaited.waited.last -= waited;
            let is_asleep = wait.polls == POLLS_BEFORE_SLEEP;
            wait.end(awaited);
            is_asleep
        };
        let long = Duration::from_millis(100);
        assert!(!is_asleep("plan", 10, long));
        assert!(is_asleep("plan", 11, long) && !is_asleep("flight", 11, Duration::ZERO));
        assert!(!is_asleep("plan", PROBE_EVERY, long), "now and then it is tried");
    }

    #[test]
    fn a_way_of_waiting_is_read_as_it_is_written() {
        for (waiting, text) in [(Waiting::Adaptive, "adaptive"), (Waiting::Event, "event"), (Waiting::Poll, "poll")] {
            assert_eq!(text.parse(), Ok(waiting));
            assert_eq!(waiting.to_string(), text);
        }
    }

    #[test]
    fn a_way_that_is_none_is_refused() {
        for text in ["", "Event", "spin", "events"] {
            assert!(text.parse::<Waiting>().is_err(), "{text}");
        }
    }
}
