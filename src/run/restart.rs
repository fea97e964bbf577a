//! When a process that has ended is started again, and how soon.

use std::collections::VecDeque;
use std::str::FromStr;
use std::time::{Duration, Instant};

use clap::ValueEnum;
use skysink_ring::role::Role;

/// The processes that `skysink run` starts.
pub const WORKERS: [Role; 4] = [Role::FieldSim, Role::FlightSim, Role::Planner, Role::Viewer];

/// What is done about a process that ends before the mission does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Restart {
    /// The run ends.
    Never,
    /// It is started again, unless it was refused its input.
    OnFailure,
}

/// Restarts within [`WINDOW`] after which it is given up.
const MAX_RESTARTS: usize = 50;

/// Times in a row that it may end by itself in one slot: it would again.
const MAX_EXITS: u32 = 8;

/// See [`MAX_RESTARTS`].
const WINDOW: Duration = Duration::from_secs(10);

/// Shortest and longest wait before a restart; it doubles with each one in the last second.
const BACK_OFF: [Duration; 2] = [Duration::from_millis(10), Duration::from_millis(200)];

/// How long a restart lengthens the wait before the next.
const BACK_OFF_WINDOW: Duration = Duration::from_secs(1);

/// The restarts of one process.
#[derive(Debug)]
pub struct Restarts {
    /// What is done when it ends too early.
    pub policy: Restart,
    recent: VecDeque<Instant>,
    /// How often it was started again.
    pub count: i32,
    /// The slot in which it has ended by itself, and how often in a row.
    exits: (u64, u32),
}

/// How a process has ended too early.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// By a signal.
    Killed,
    /// By itself, in this slot.
    Exited(u64),
    /// It was refused its input, and would be again.
    Refused,
}

impl Restarts {
    /// None yet.
    #[must_use]
    pub fn new(policy: Restart) -> Self {
        Self { policy, recent: VecDeque::new(), count: 0, exits: (0, 0) }
    }

    /// When the process that has ended at `now` is to be started again; `None` if it is given up: by its policy, after
    /// too many restarts, or because it would end so again.
    pub fn next(&mut self, now: Instant, end: End) -> Option<Instant> {
        self.exits = match end {
            End::Exited(slot) if self.exits.0 == slot => (slot, self.exits.1 + 1),
            End::Exited(slot) => (slot, 1),
            End::Killed | End::Refused => (0, 0),
        };
        while self.recent.front().is_some_and(|&restart| now.saturating_duration_since(restart) > WINDOW) {
            self.recent.pop_front();
        }
        let is_useless = end == End::Refused || self.exits.1 >= MAX_EXITS;
        if self.policy == Restart::Never || is_useless || self.recent.len() >= MAX_RESTARTS {
            return None;
        }
        let just_now = |restart: &&Instant| now.saturating_duration_since(**restart) <= BACK_OFF_WINDOW;
        let doublings = u32::try_from(self.recent.iter().filter(just_now).count()).unwrap_or(u32::MAX).min(16);
        let due = now + (BACK_OFF[0] * 2u32.pow(doublings)).min(BACK_OFF[1]);
        self.recent.push_back(now);
        self.count += 1;
        Some(due)
    }

    /// What to add to the end of a process that is given up: the limit, if it has reached it.
    #[must_use]
    pub fn limit(&self) -> String {
        if self.recent.len() >= MAX_RESTARTS {
            return format!(", after {MAX_RESTARTS} restarts within {} s", WINDOW.as_secs());
        }
        if self.exits.1 >= MAX_EXITS { format!(", {MAX_EXITS} times in a row") } else { String::new() }
    }
}

/// A policy for one process, or for all.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rule {
    role: Option<Role>,
    policy: Restart,
}

/// The process of that name, if `skysink run` starts it.
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
    /// The policy of a process: the last rule that names it, else the last for all, else on-failure.
    #[must_use]
    pub fn policy(rules: &[Self], role: Role) -> Restart {
        let last = |wanted: Option<Role>| rules.iter().rev().find(|rule| rule.role == wanted).map(|rule| rule.policy);
        last(Some(role)).or_else(|| last(None)).unwrap_or(Restart::OnFailure)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_back_off_doubles_up_to_its_limit_and_is_forgotten() {
        let mut restarts = Restarts::new(Restart::OnFailure);
        let start = Instant::now();
        let wait =
            |restarts: &mut Restarts, now: Instant| restarts.next(now, End::Killed).map(|due| (due - now).as_millis());
        let waits: Vec<_> = (0..6).map(|_| wait(&mut restarts, start).unwrap()).collect();
        assert_eq!(waits, [10, 20, 40, 80, 160, 200]);
        assert_eq!(wait(&mut restarts, start + Duration::from_secs(2)), Some(10));
        assert_eq!(restarts.count, 7);
    }

    #[test]
    fn the_51st_restart_within_ten_seconds_is_one_too_many() {
        let mut restarts = Restarts::new(Restart::OnFailure);
        let start = Instant::now();
        for i in 0..50 {
            assert!(restarts.next(start + Duration::from_millis(i * 100), End::Killed).is_some());
        }
        assert_eq!(restarts.next(start + Duration::from_secs(6), End::Killed), None);
        assert_eq!(restarts.limit(), ", after 50 restarts within 10 s");
        assert!(restarts.next(start + Duration::from_secs(11), End::Killed).is_some(), "the first ones are long ago");
    }

    #[test]
    fn what_would_fail_again_is_not_tried_again() {
        for (policy, end) in [(Restart::Never, End::Killed), (Restart::OnFailure, End::Refused)] {
            let mut restarts = Restarts::new(policy);
            assert_eq!(restarts.next(Instant::now(), end), None);
            assert_eq!(restarts.limit(), "");
        }
    }

    #[test]
    fn a_process_that_ends_by_itself_again_and_again_in_one_slot_is_given_up() {
        let mut restarts = Restarts::new(Restart::OnFailure);
        let now = Instant::now();
        let slots = [1, 1, 1, 1, 1, 1, 1, 2, 1, 1, 1, 1, 1, 1, 1];
        assert!(slots.iter().all(|&slot| restarts.next(now, End::Exited(slot)).is_some()));
        assert_eq!(restarts.next(now, End::Exited(1)), None);
        assert_eq!(restarts.limit(), ", 8 times in a row");
    }

    #[test]
    fn a_rule_for_a_process_comes_before_one_for_all() {
        let rules = ["planner=on-failure", "never"].map(|rule| rule.parse().unwrap());
        assert_eq!(Rule::policy(&rules, Role::Planner), Restart::OnFailure);
        assert_eq!(Rule::policy(&rules, Role::Viewer), Restart::Never);
        assert_eq!(Rule::policy(&[], Role::Viewer), Restart::OnFailure);
        for text in ["always", "planner", "pilot=never", "skysink=never", "planner=", "=never"] {
            assert!(text.parse::<Rule>().is_err(), "{text}");
        }
    }
}
