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
}

impl Restarts {
    /// None yet.
    #[must_use]
    pub fn new(policy: Restart) -> Self {
        Self { policy, recent: VecDeque::new(), count: 0 }
    }

    /// When the process that has ended at `now` is to be started again; `None` if it is given up: by its policy, after
    /// too many restarts, or because it was `refused` its input, which it would be again.
    pub fn next(&mut self, now: Instant, refused: bool) -> Option<Instant> {
        while self.recent.front().is_some_and(|&restart| now.saturating_duration_since(restart) > WINDOW) {
            self.recent.pop_front();
        }
        if self.policy == Restart::Never || refused || self.recent.len() >= MAX_RESTARTS {
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
        let is_reached = self.recent.len() >= MAX_RESTARTS;
        let limit = || format!(", after {MAX_RESTARTS} restarts within {} s", WINDOW.as_secs());
        if is_reached { limit() } else { String::new() }
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
        let wait = |restarts: &mut Restarts, now: Instant| restarts.next(now, false).map(|due| (due - now).as_millis());
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
            assert!(restarts.next(start + Duration::from_millis(i * 100), false).is_some());
        }
        assert_eq!(restarts.next(start + Duration::from_secs(6), false), None);
        assert_eq!(restarts.limit(), ", after 50 restarts within 10 s");
        assert!(restarts.next(start + Duration::from_secs(11), false).is_some(), "the first ones are long ago");
    }

    #[test]
    fn what_would_fail_again_is_not_tried_again() {
        for (policy, refused) in [(Restart::Never, false), (Restart::OnFailure, true)] {
            let mut restarts = Restarts::new(policy);
            assert_eq!(restarts.next(Instant::now(), refused), None);
            assert_eq!(restarts.limit(), "");
        }
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
