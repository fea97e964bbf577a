//! The restart policy of a process: whether it is restarted after it has ended, and when.

use std::collections::VecDeque;
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

/// Maximum number of restarts within [`WINDOW`].
const MAX_RESTARTS: usize = 50;

/// Maximum number of consecutive exits in the same slot.
const MAX_EXITS: u32 = 8;

/// See [`MAX_RESTARTS`].
const WINDOW: Duration = Duration::from_secs(10);

/// Minimum and maximum delay before a restart. The delay doubles with each restart within [`BACK_OFF_WINDOW`].
const BACK_OFF: [Duration; 2] = [Duration::from_millis(10), Duration::from_millis(200)];

/// See [`BACK_OFF`].
const BACK_OFF_WINDOW: Duration = Duration::from_secs(1);

/// The restarts of one process.
#[derive(Debug)]
pub struct Restarts {
    /// The policy.
    pub policy: Restart,
    recent: VecDeque<Instant>,
    /// Number of restarts.
    pub count: i32,
    /// Slot of the last exit.
    exit_slot: u64,
    /// Number of consecutive exits in that slot.
    exits: u32,
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
    #[must_use]
    pub fn new(policy: Restart) -> Self {
        Self { policy, recent: VecDeque::new(), count: 0, exit_slot: 0, exits: 0 }
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
        let is_futile = cause == EndCause::Refused || self.exits >= MAX_EXITS;
        if self.policy == Restart::Never || is_futile || self.recent.len() >= MAX_RESTARTS {
            return None;
        }
        let is_recent = |restart: &&Instant| now.saturating_duration_since(**restart) <= BACK_OFF_WINDOW;
        let doublings = u32::try_from(self.recent.iter().filter(is_recent).count()).unwrap_or(u32::MAX).min(16);
        let due = now + (BACK_OFF[0] * 2u32.pow(doublings)).min(BACK_OFF[1]);
        self.recent.push_back(now);
        self.count += 1;
        Some(due)
    }

    /// The limit that prevents a restart, as a suffix of the error message; empty if none is reached.
    #[must_use]
    pub fn reached_limit(&self) -> String {
        if self.recent.len() >= MAX_RESTARTS {
            return format!(", after {MAX_RESTARTS} restarts within {} s", WINDOW.as_secs());
        }
        if self.exits >= MAX_EXITS { format!(", {MAX_EXITS} times in a row") } else { String::new() }
    }
}

/// The policy of one process, or of all.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rule {
    role: Option<Role>,
    policy: Restart,
}

/// The role of this name, if `skysink run` starts its process.
#[must_use]
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
    #[must_use]
    pub fn policy(rules: &[Self], role: Role) -> Restart {
        let last = |role: Option<Role>| rules.iter().rev().find(|rule| rule.role == role).map(|rule| rule.policy);
        last(Some(role)).or_else(|| last(None)).unwrap_or(Restart::OnFailure)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_back_off_doubles_up_to_its_limit_and_is_reset() {
        let mut restarts = Restarts::new(Restart::OnFailure);
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
        let mut restarts = Restarts::new(Restart::OnFailure);
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
    fn a_process_that_would_fail_again_is_not_restarted() {
        for (policy, cause) in [(Restart::Never, EndCause::Killed), (Restart::OnFailure, EndCause::Refused)] {
            let mut restarts = Restarts::new(policy);
            assert_eq!(restarts.schedule(Instant::now(), cause), None);
            assert_eq!(restarts.reached_limit(), "");
        }
    }

    #[test]
    fn a_process_that_exits_eight_times_in_a_row_in_one_slot_is_not_restarted() {
        let mut restarts = Restarts::new(Restart::OnFailure);
        let now = Instant::now();
        let slots = [1, 1, 1, 1, 1, 1, 1, 2, 1, 1, 1, 1, 1, 1, 1];
        assert!(slots.iter().all(|&slot| restarts.schedule(now, EndCause::Exited(slot)).is_some()));
        assert_eq!(restarts.schedule(now, EndCause::Exited(1)), None);
        assert_eq!(restarts.reached_limit(), ", 8 times in a row");
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
