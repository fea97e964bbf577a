//! Waiting for messages: by polling, or asleep until a notification. Stops, timeouts and the launcher's death end a
//! wait.

use std::cell::RefCell;
use std::fmt::Debug;
use std::fs::File;
use std::rc::{Rc, Weak};
use std::sync::Arc;
use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::Service;
use serde::{Deserialize, Serialize};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
use signal_hook::iterator::Signals;
use skysink_common::stop::Stop;
use strum::{Display, EnumString, VariantArray, VariantNames};

use crate::error::{NodeError, RingError};
use crate::role::{HEARTBEAT, Role, RoleLock};

/// How a process waits for messages.
#[derive(
    Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, Display, EnumString, VariantArray, VariantNames,
)]
#[serde(rename_all = "lowercase")]
#[strum(serialize_all = "lowercase")]
pub enum Waiting {
    /// Polls for as long as a sleep and its wake-up take, then sleeps.
    #[default]
    Adaptive,
    /// Sleeps until the writer notifies it.
    Event,
    /// Polls, which is faster and keeps a core busy.
    Poll,
}

/// Longest sleep, after which late joiners are served and stops are checked.
pub(crate) const PAUSE: Duration = Duration::from_millis(10);

/// Polls before the process yields its core: with fewer cores than processes, the sender of the awaited message needs
/// it.
const POLLS_BEFORE_YIELD: u32 = 8;

/// Polls before an adaptive wait sleeps: some 50 µs, about as long as a sleep and its wake-up take.
const POLLS_BEFORE_SLEEP: u32 = 512;

/// After a longer wait, the next wait for the same topic sleeps at once, because polling would be in vain.
const LONG_WAIT: Duration = Duration::from_micros(150);

/// In this many slots of each [`PROBE_PERIOD`], waits poll first even after long waits, to detect that polling has
/// become faster.
const PROBE_SLOTS: u64 = 2;

/// Period of the probes [slots].
const PROBE_PERIOD: u64 = 64;

/// A yield that takes longer indicates that the core is shared with a busy program.
const CONTENDED_YIELD: Duration = Duration::from_micros(200);

/// Fewest and most waits that sleep at once after a contended yield. A sleeping process is woken by its message; a
/// yielding one continues only after the time slice of the other program.
const BACKOFF_WAITS: [u32; 2] = [64, 16_384];

impl Waiting {
    /// All variants.
    pub const ALL: &'static [Self] = <Self as VariantArray>::VARIANTS;

    /// The names of all variants.
    pub const NAMES: &'static [&'static str] = <Self as VariantNames>::VARIANTS;

    /// Whether a process sleeps after this number of polls in vain.
    fn sleeps_after(self, polls: u32) -> bool {
        match self {
            Self::Adaptive => polls >= POLLS_BEFORE_SLEEP,
            Self::Event => true,
            Self::Poll => false,
        }
    }

    /// Pauses after this number of polls in vain: until `listener` is notified, for at most 10 ms, or until the next
    /// poll.
    ///
    /// A poll does not consume notifications: repeated ones cost the writer almost nothing.
    pub fn pause<S: Service>(self, listener: &Listener<S>, polls: u32) {
        if self.sleeps_after(polls) {
            let _ = listener.timed_wait(|_| {}, PAUSE); // an interrupted wait is a short pause
        } else if polls.is_multiple_of(POLLS_BEFORE_YIELD) {
            std::thread::yield_now();
        } else {
            std::hint::spin_loop();
        }
    }
}

/// The signals that end a process in order: Ctrl-C, a request to end, and, unless it is ignored as under `nohup`, the
/// end of its terminal.
fn ending_signals() -> impl Iterator<Item = i32> {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| u64::from_str_radix(line.strip_prefix("SigIgn:")?.trim(), 16).ok());
    let is_ignored = ignored.is_some_and(|mask| mask & 1 << (SIGHUP - 1) != 0);
    [SIGINT, SIGTERM].into_iter().chain((!is_ignored).then_some(SIGHUP))
}

/// A [`Stop`] that SIGINT, SIGTERM and the end of the terminal (SIGHUP) request. From here on, a write beyond the limit
/// `ulimit -f` is an error instead of the end of the process without a word.
///
/// # Panics
/// If the signal handlers cannot be installed.
#[must_use]
pub fn stop_on_signals() -> Stop {
    signal_hook::flag::register(SIGXFSZ, Arc::default()).expect("a catchable signal");
    let stop = Stop::default();
    for signal in ending_signals() {
        let number = usize::try_from(signal).expect("signals are positive");
        signal_hook::flag::register_usize(signal, stop.flag(), number).expect("a catchable signal");
    }
    stop
}

/// Signals within this time count as one: `timeout` sends a process two.
const SIGNAL_WINDOW: Duration = Duration::from_millis(200);

/// Ends the process at once on the second of these signals, even during a wait.
///
/// # Panics
/// As [`stop_on_signals`].
pub fn exit_on_second_signal() {
    let mut signals = Signals::new(ending_signals()).expect("catchable signals");
    std::thread::spawn(move || {
        let mut first: Option<Instant> = None;
        for signal in signals.forever() {
            if first.get_or_insert_with(Instant::now).elapsed() >= SIGNAL_WINDOW {
                signal_hook::low_level::exit(128 + signal);
            }
        }
    });
}

/// A writer with readers that may join late.
pub(crate) trait ServeJoiners: Debug {
    /// Sends late joiners the newest samples, and notifies them.
    fn serve_joiners(&self) -> Result<(), RingError>;
}

/// The writers of a process whose late joiners are served.
#[derive(Debug, Clone, Default)]
pub(crate) struct LateJoiners(pub(crate) Rc<RefCell<Vec<Weak<dyn ServeJoiners>>>>);

/// A wait context: ends waits on a requested stop, on the launcher's death or, in the launcher, after a timeout; keeps
/// the heartbeat going, and serves late joiners.
#[derive(Debug)]
pub struct WaitContext {
    pub(crate) stop: Stop,
    /// The launcher's lock file; `None` in the launcher.
    pub(crate) supervisor: Option<File>,
    /// `None` in the launcher.
    pub(crate) role_lock: Option<Arc<RoleLock>>,
    pub(crate) late_joiners: LateJoiners,
    /// Longest wait for a sample; `None` except in the launcher, which finds out which process is overdue.
    pub(crate) timeout: Option<Duration>,
    pub(crate) waiting: Waiting,
    pub(crate) last_supervisor_check: Instant,
    pub(crate) last_served: Instant,
    /// Period of serving late joiners.
    pub(crate) serve_every: Duration,
    pub(crate) polls: u32,
    pub(crate) contention: CoreContention,
    /// Topics whose last wait was longer than [`LONG_WAIT`].
    pub(crate) slow_topics: Vec<&'static str>,
}

/// Detects other programs on the cores that polling waits yield.
#[derive(Debug, Default)]
pub(crate) struct CoreContention {
    /// Remaining waits that sleep at once.
    sleeping_waits: u32,
    /// Length of the last backoff [waits].
    backoff: u32,
    /// Polling waits since then.
    polling_waits: u32,
}

/// Polling waits without contention after which the backoff starts again with the shortest.
const UNCONTENDED_WAITS: u32 = 64;

impl CoreContention {
    /// Counts a wait; returns whether it may poll before it sleeps.
    fn may_poll(&mut self) -> bool {
        if self.sleeping_waits > 0 {
            self.sleeping_waits -= 1;
            return false;
        }
        self.polling_waits = self.polling_waits.saturating_add(1);
        if self.polling_waits > UNCONTENDED_WAITS {
            self.backoff = 0;
        }
        true
    }

    /// Records the duration of a yield. After a contended one the next waits sleep at once, twice as many as the last
    /// time.
    fn record(&mut self, yielded: Duration) {
        if yielded >= CONTENDED_YIELD {
            let [fewest, most] = BACKOFF_WAITS;
            self.backoff = (2 * self.backoff).clamp(fewest, most);
            self.sleeping_waits = self.backoff;
            self.polling_waits = 0;
        }
    }
}

/// A wait for a sample.
#[derive(Debug)]
pub struct Awaited {
    /// The topic.
    pub topic: &'static str,
    /// The slot of the sample.
    pub slot: u64,
    /// The process that should send it.
    pub from: Role,
    /// Time waited.
    pub waited: Stopwatch,
    /// Longest wait; `None` except in the launcher.
    pub timeout: Option<Duration>,
}

/// Measures the time in which this process runs. A longer gap between two readings of the clock means that the process
/// or the machine was stopped.
#[derive(Debug, Clone, Copy)]
pub struct Stopwatch {
    last: Instant,
    elapsed: Duration,
}

/// Most time that counts between two readings of the clock.
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
    pub fn elapsed(&self) -> Duration {
        self.elapsed
    }
}

/// Period of the checks of the launcher's lock.
pub(crate) const SUPERVISOR_CHECK: Duration = Duration::from_millis(500);

impl WaitContext {
    /// Begins a wait for the sample of `slot` on `topic`, which comes from `from`.
    ///
    /// # Errors
    /// If a late joiner cannot be served.
    pub fn begin(&mut self, topic: &'static str, slot: u64, from: Role) -> Result<Awaited, RingError> {
        let now = Instant::now();
        self.keep_alive(now)?; // a process that always finds its sample never pauses
        // The first poll in vain yields the core to the sender.
        let is_slow = slot % PROBE_PERIOD >= PROBE_SLOTS && self.slow_topics.contains(&topic);
        let may_poll = self.contention.may_poll() && !is_slow;
        self.polls = if may_poll { 0 } else { POLLS_BEFORE_SLEEP };
        Ok(Awaited { topic, slot, from, waited: Stopwatch::start(now), timeout: self.timeout })
    }

    /// Ends a wait whose sample has arrived.
    pub fn end(&mut self, mut awaited: Awaited) {
        let was_slow = awaited.waited.advance(Instant::now()) > LONG_WAIT;
        if was_slow != self.slow_topics.contains(&awaited.topic) {
            self.slow_topics.retain(|topic| *topic != awaited.topic);
            self.slow_topics.extend(was_slow.then_some(awaited.topic));
        }
    }

    /// Pauses until `listener` is notified, for at most 10 ms.
    ///
    /// # Errors
    /// On a requested stop, on the launcher's death or, in the launcher, after the timeout.
    pub fn pause<S: Service>(&mut self, listener: &Listener<S>, awaited: &mut Awaited) -> Result<(), NodeError> {
        let has_slept = self.waiting.sleeps_after(self.polls);
        if self.waiting == Waiting::Adaptive && !has_slept && self.polls.is_multiple_of(POLLS_BEFORE_YIELD) {
            let begin = Instant::now();
            self.waiting.pause(listener, self.polls);
            self.contention.record(begin.elapsed());
            if self.contention.sleeping_waits > 0 {
                self.polls = POLLS_BEFORE_SLEEP;
            }
        } else {
            self.waiting.pause(listener, self.polls);
        }
        self.polls = self.polls.wrapping_add(1);
        if !has_slept && !self.polls.is_multiple_of(POLLS_BEFORE_YIELD) {
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
    /// On a requested stop, on the launcher's death, or if iceoryx2 fails.
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

    /// Fails once a stop is requested or the launcher is dead.
    fn check(&mut self, now: Instant) -> Result<(), NodeError> {
        self.stop.check()?;
        self.keep_alive(now)?;
        if let Some(lock) = &self.supervisor
            && now - self.last_supervisor_check >= SUPERVISOR_CHECK
        {
            self.last_supervisor_check = now;
            if lock.try_lock_shared().is_ok() {
                let _ = lock.unlock(); // the other processes try it, too
                return Err(NodeError::Orphaned);
            }
        }
        Ok(())
    }

    /// Keeps the heartbeat going while a computation of this process polls the stop request, until the process leaves
    /// the ring: one that takes long is not one that hangs.
    pub fn beat_while_computing(&self) {
        let Some(lock) = self.role_lock.as_ref().map(Arc::downgrade) else { return };
        let stop = self.stop.clone();
        std::thread::spawn(move || {
            while let Some(lock) = lock.upgrade() {
                if stop.take_polled() {
                    lock.beat(Instant::now());
                }
                drop(lock); // the process may leave meanwhile
                std::thread::sleep(HEARTBEAT);
            }
        });
    }

    /// Keeps the heartbeat going, and serves late joiners if it is time to.
    fn keep_alive(&mut self, now: Instant) -> Result<(), RingError> {
        if let Some(lock) = &self.role_lock {
            lock.beat(now);
        }
        if now.saturating_duration_since(self.last_served) >= self.serve_every {
            self.last_served = now;
            // The newest writer first: a reader that attaches to the topics in the order of their writers has a sample
            // of the last topic only after those of the others.
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
    fn waits_do_not_spin_on_a_busy_core() {
        let mut core = CoreContention::default();
        let poll = |core: &mut CoreContention, yielded_us| {
            let slept = (0..).take_while(|_| !core.may_poll()).count();
            core.record(Duration::from_micros(yielded_us));
            slept
        };
        assert_eq!([2, 199, 200, 5_000, 5_000].map(|yielded_us| poll(&mut core, yielded_us)), [0, 0, 0, 64, 128]);
        assert_eq!([2, 200, 2].map(|yielded_us| poll(&mut core, yielded_us)), [256, 0, 512]);
        assert_eq!((0..64).map(|_| poll(&mut core, 2)).max(), Some(0));
        assert_eq!([200, 2].map(|yielded_us| poll(&mut core, yielded_us)), [0, 64], "reset after 64 waits");
        assert_eq!((0..20).map(|_| poll(&mut core, 5_000)).max(), Some(16_384), "at most");
    }

    #[test]
    fn a_stopwatch_excludes_most_of_a_suspension() {
        let begin = Instant::now();
        let mut watch = Stopwatch::start(begin);
        assert_eq!(watch.advance(begin + Duration::from_millis(150)), Duration::from_millis(150));
        assert_eq!(watch.advance(begin + Duration::from_secs(3_600)), Duration::from_millis(350));
        assert_eq!(watch.elapsed(), Duration::from_millis(350));
    }

    #[test]
    fn a_slow_topic_is_waited_for_asleep_until_it_is_fast_again() {
        let now = Instant::now();
        let mut wait = WaitContext {
            stop: Stop::default(),
            supervisor: None,
            role_lock: None,
            late_joiners: LateJoiners::default(),
            timeout: None,
            waiting: Waiting::Adaptive,
            last_supervisor_check: now,
            last_served: now,
            serve_every: PAUSE,
            polls: 0,
            contention: CoreContention::default(),
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
        assert!(!is_asleep("plan", PROBE_PERIOD, long), "now and then it is tried");
    }

    #[test]
    fn wait_mode_names_round_trip() {
        for (waiting, text) in [(Waiting::Adaptive, "adaptive"), (Waiting::Event, "event"), (Waiting::Poll, "poll")] {
            assert_eq!(text.parse(), Ok(waiting));
            assert_eq!(waiting.to_string(), text);
        }
    }

    #[test]
    fn an_unknown_name_is_refused() {
        for text in ["", "Event", "spin", "events"] {
            assert!(text.parse::<Waiting>().is_err(), "{text}");
        }
    }
}
