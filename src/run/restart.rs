//! The restarts of a process: whether it is started again after it has ended, and when.

use std::collections::VecDeque;
use std::os::unix::process::ExitStatusExt as _;
use std::process::ExitStatus;
use std::str::FromStr;
use std::time::{Duration, Instant};

use clap::ValueEnum;
use skysink_ring::role::Role;

/// The processes that `skysink run` starts.
pub const WORKERS: [Role; 4] = [Role::FieldSim, Role::FlightSim, Role::Planner, Role::Viewer];

/// What to do if a process ends before the mission.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Restart {
    /// End the run.
    Never,
    /// Restart the process, unless it has refused its input.
    OnFailure,
}

/// How often a kind of process is restarted.
#[derive(Debug)]
pub struct RestartLimits {
    /// Maximum number of restarts within `WINDOW`.
    pub restarts: usize,
    /// Maximum number of consecutive exits in the same slot.
    pub exits: u32,
    /// Minimum and maximum delay before a restart. The delay doubles with each restart within `BACK_OFF_WINDOW`.
    pub back_off: [Duration; 2],
    /// What an exit means that cannot be helped by a restart.
    pub refusal: RefusedInput,
}

/// By which exit a process refuses its input.
#[derive(Debug)]
pub enum RefusedInput {
    /// That with code 2.
    Code2,
    /// Any, unless it has run for this long before, and so has accepted its input.
    EarlyExit(Duration),
}

/// The limits of the processes of the ring.
pub const OF_WORKERS: RestartLimits = RestartLimits {
    restarts: 50,
    exits: 8,
    back_off: [Duration::from_millis(10), Duration::from_millis(200)],
    refusal: RefusedInput::Code2,
};

/// The limits of the link to other hosts, which is restarted as long as the run lasts.
pub const OF_LINK: RestartLimits = RestartLimits {
    restarts: usize::MAX,
    exits: u32::MAX,
    back_off: [Duration::from_millis(500); 2],
    refusal: RefusedInput::EarlyExit(Duration::from_secs(2)),
};

/// See [`RestartLimits::restarts`].
const WINDOW: Duration = Duration::from_secs(10);

/// See [`RestartLimits::back_off`].
const BACK_OFF_WINDOW: Duration = Duration::from_secs(1);

/// The restarts of one process.
#[derive(Debug)]
pub struct Restarts {
    pub policy: Restart,
    limits: &'static RestartLimits,
    recent: VecDeque<Instant>,
    /// Number of restarts.
    pub count: i32,
    /// Slot of the last exit.
    exit_slot: u64,
    /// Number of consecutive exits in that slot.
    exits: u32,
    /// Whether a start has lasted beyond the time of [`RefusedInput::EarlyExit`].
    has_lasted: bool,
}

/// Why a process has ended before the mission.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EndCause {
    /// SIGKILL or SIGTERM.
    Killed,
    /// It exited or crashed in this slot.
    Exited(u64),
    /// It refused its input, and would again.
    Refused,
}

impl Restarts {
    /// No restarts yet.
    pub fn new(policy: Restart, limits: &'static RestartLimits) -> Self {
        Self { policy, limits, recent: VecDeque::new(), count: 0, exit_slot: 0, exits: 0, has_lasted: false }
    }

    /// The cause of an end in `slot` after a process has run for `lifetime`.
    pub fn cause(&mut self, status: ExitStatus, slot: u64, lifetime: Duration) -> EndCause {
        let is_refusal = match self.limits.refusal {
            RefusedInput::Code2 => status.code() == Some(2),
            RefusedInput::EarlyExit(trial) => {
                self.has_lasted |= lifetime >= trial;
                status.code().is_some() && !self.has_lasted
            }
        };
        match status.signal() {
            _ if is_refusal => EndCause::Refused,
            Some(9 | 15) => EndCause::Killed, // SIGKILL or SIGTERM from another process
            _ => EndCause::Exited(slot),
        }
    }

    /// Schedules the restart of a process that has ended at `now`. Returns its time, or `None` if the process is not
    /// restarted: by its policy, after too many restarts, or because it would end again for the same cause.
    pub fn schedule(&mut self, now: Instant, cause: EndCause) -> Option<Instant> {
        match cause {
            EndCause::Exited(slot) => {
                self.exits = if slot == self.exit_slot { self.exits + 1 } else { 1 };
                self.exit_slot = slot;
            }
            EndCause::Killed | EndCause::Refused => {
                self.exits = 0;
                self.exit_slot = 0;
            }
        }
        while self.recent.front().is_some_and(|&restart| now.saturating_duration_since(restart) > WINDOW) {
            self.recent.pop_front();
        }
        let is_futile = cause == EndCause::Refused || self.exits >= self.limits.exits;
        if self.policy == Restart::Never || is_futile || self.recent.len() >= self.limits.restarts {
            return None;
        }
        let is_recent = |restart: &&Instant| now.saturating_duration_since(**restart) <= BACK_OFF_WINDOW;
        let doublings = u32::try_from(self.recent.iter().filter(is_recent).count()).unwrap_or(u32::MAX).min(16);
        let [least, most] = self.limits.back_off;
        let due = now + (least * 2u32.pow(doublings)).min(most);
        self.recent.push_back(now);
        self.count += 1;
        Some(due)
    }

    /// The limit that prevents a restart, as a suffix of the error message; empty if none is reached.
    pub fn reached_limit(&self) -> String {
        let RestartLimits { restarts, exits, .. } = self.limits;
        if self.recent.len() >= *restarts {
            return format!(", after {restarts} restarts within {} s", WINDOW.as_secs());
        }
        if self.exits >= *exits { format!(", {exits} times in a row") } else { String::new() }
    }
}

/// The policy of one process, or of all.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rule {
    role: Option<Role>,
    policy: Restart,
}

/// The role of this name, if `skysink run` starts its process.
pub fn worker(name: &str) -> Option<Role> {
    name.parse().ok().filter(|role| *role != Role::Launcher)
}

impl FromStr for Rule {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let refuse = || "expected never or on-failure, for one process as in planner=never".to_owned();
        let (role, policy) = match text.split_once('=') {
            Some((name, policy)) => (Some(worker(name).ok_or_else(refuse)?), policy),
            None => (None, text),
        };
        let policy = Restart::from_str(policy, false).map_err(|_| refuse())?;
        Ok(Self { role, policy })
    }
}

impl Rule {
    /// The policy of a process: the last rule that names it, else the last rule for all, else on-failure.
    pub fn policy(rules: &[Self], role: Role) -> Restart {
        let last = |role: Option<Role>| rules.iter().rev().find(|rule| rule.role == role).map(|rule| rule.policy);
        last(Some(role)).or_else(|| last(None)).unwrap_or(Restart::OnFailure)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_backoff_doubles_to_its_limit_and_is_reset() {
        let mut restarts = Restarts::new(Restart::OnFailure, &OF_WORKERS);
        let start = Instant::now();
        let wait =
            |restarts: &mut Restarts, now| restarts.schedule(now, EndCause::Killed).map(|due| (due - now).as_millis());
        let waits: Vec<_> = (0..6).map(|_| wait(&mut restarts, start).unwrap()).collect();
        assert_eq!(waits, [10, 20, 40, 80, 160, 200]);
        assert_eq!(wait(&mut restarts, start + Duration::from_secs(2)), Some(10));
        assert_eq!(restarts.count, 7);
    }

    #[test]
    fn the_51st_restart_within_ten_seconds_is_refused() {
        let mut restarts = Restarts::new(Restart::OnFailure, &OF_WORKERS);
        let start = Instant::now();
        for i in 0..50 {
            assert!(restarts.schedule(start + Duration::from_millis(i * 100), EndCause::Killed).is_some());
        }
        assert_eq!(restarts.schedule(start + Duration::from_secs(6), EndCause::Killed), None);
        assert_eq!(restarts.reached_limit(), ", after 50 restarts within 10 s");
        let later = restarts.schedule(start + Duration::from_secs(11), EndCause::Killed);
        assert!(later.is_some(), "the first restarts are outside the window");
    }

    #[test]
    fn a_process_with_a_permanent_failure_is_not_restarted() {
        for (policy, cause) in [(Restart::Never, EndCause::Killed), (Restart::OnFailure, EndCause::Refused)] {
            let mut restarts = Restarts::new(policy, &OF_WORKERS);
            assert_eq!(restarts.schedule(Instant::now(), cause), None);
            assert_eq!(restarts.reached_limit(), "");
        }
    }

    #[test]
    fn a_process_that_exits_eight_times_in_a_row_in_one_slot_is_not_restarted() {
        let mut restarts = Restarts::new(Restart::OnFailure, &OF_WORKERS);
        let now = Instant::now();
        let slots = [1, 1, 1, 1, 1, 1, 1, 2, 1, 1, 1, 1, 1, 1, 1];
        assert!(slots.iter().all(|&slot| restarts.schedule(now, EndCause::Exited(slot)).is_some()));
        assert_eq!(restarts.schedule(now, EndCause::Exited(1)), None);
        assert_eq!(restarts.reached_limit(), ", 8 times in a row");
    }

    #[test]
    fn an_exit_with_code_2_refuses_the_input_of_a_worker_and_a_first_early_exit_that_of_the_link() {
        let seconds = Duration::from_secs;
        let exit = |code: i32| ExitStatus::from_raw(code << 8);
        let mut worker = Restarts::new(Restart::OnFailure, &OF_WORKERS);
        assert_eq!(worker.cause(exit(2), 5, seconds(9)), EndCause::Refused);
        assert_eq!(worker.cause(exit(1), 5, seconds(0)), EndCause::Exited(5));
        assert_eq!(worker.cause(ExitStatus::from_raw(9), 5, seconds(0)), EndCause::Killed);
        let mut link = Restarts::new(Restart::OnFailure, &OF_LINK);
        assert_eq!(link.cause(ExitStatus::from_raw(9), 5, seconds(1)), EndCause::Killed);
        assert_eq!(link.cause(exit(0), 5, seconds(1)), EndCause::Refused);
        assert_eq!(link.cause(exit(0), 5, seconds(2)), EndCause::Exited(5));
        assert_eq!(link.cause(exit(2), 5, seconds(1)), EndCause::Exited(5), "it has run before");
    }

    #[test]
    fn a_rule_for_one_process_overrides_a_rule_for_all() {
        let rules = ["planner=on-failure", "never"].map(|rule| rule.parse().unwrap());
        assert_eq!(Rule::policy(&rules, Role::Planner), Restart::OnFailure);
        assert_eq!(Rule::policy(&rules, Role::Viewer), Restart::Never);
        assert_eq!(Rule::policy(&[], Role::Viewer), Restart::OnFailure);
        for text in ["always", "planner", "pilot=never", "skysink=never", "planner=", "=never"] {
            assert!(text.parse::<Rule>().is_err(), "{text}");
        }
    }
}
