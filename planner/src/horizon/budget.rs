//! How long the search of a slot goes on: a number of steps, and in a run paced by a clock a time.

use std::time::{Duration, Instant};

/// Steps between two looks at the clock: a search ends at most this many late.
const LOOK: u32 = 64;

/// What one search may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Budget {
    steps: u32,
    until: Option<Instant>,
}

impl Budget {
    /// At most `steps` steps, and none that begins later than `limit` from now. Without a limit no clock is read.
    #[must_use]
    pub fn from_now(steps: u32, limit: Option<Duration>) -> Self {
        Self { steps, until: limit.and_then(|limit| Instant::now().checked_add(limit)) }
    }

    /// Whether step `step`, from 0, may begin.
    #[inline]
    #[must_use]
    pub fn allows(&self, step: u32) -> bool {
        step < self.steps && (!step.is_multiple_of(LOOK) || self.until.is_none_or(|until| Instant::now() < until))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_budget_without_a_limit_is_its_number_of_steps() {
        let budget = Budget::from_now(3, None);
        assert_eq!([0, 1, 2, 3].map(|step| budget.allows(step)), [true, true, true, false]);
        assert!(!Budget::from_now(0, None).allows(0));
    }

    #[test]
    fn a_budget_whose_time_is_over_ends_with_the_next_look_at_the_clock() {
        let budget = Budget::from_now(1_000, Some(Duration::ZERO));
        assert!(!budget.allows(0) && budget.allows(63) && !budget.allows(64));
    }
}
