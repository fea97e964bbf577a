//! How far a piece of research is, for whoever shows it: the lab itself prints nothing.

use std::time::Duration;

/// How far a sweep or a search is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LabProgress {
    /// Missions flown of a sweep, or steps taken of a search.
    pub done: u64,
    /// All missions or steps.
    pub of: u64,
    /// Loss rate η of the best flight so far, of a search.
    pub loss_rate: Option<f64>,
    /// The time that is left of a sweep; none until it can be told.
    pub left: Option<Duration>,
    /// Which of several sweeps it is.
    pub sweep: SweepNumber,
}

/// A sweep as one of several that are flown one after the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SweepNumber {
    /// Its number, from 1.
    pub number: usize,
    /// All of them.
    pub of: usize,
}

impl SweepNumber {
    /// The only one.
    pub const ONLY: Self = Self { number: 1, of: 1 };
}

/// Hears of progress, from any thread: once at the beginning, and then as it is made.
pub type OnProgress<'a> = &'a (dyn Fn(LabProgress) + Sync);

/// The missions of a sweep that are left and what they take, by the strategy's index: a search takes ten thousand times
/// as long as a rule.
#[derive(Debug, Clone)]
pub struct Workload(Vec<StrategyWork>);

/// The same of one strategy.
#[derive(Debug, Clone, Copy, Default)]
struct StrategyWork {
    /// Missions that are left.
    missing: u32,
    /// Missions flown.
    flown: u32,
    /// What these took together.
    took: Duration,
}

impl Workload {
    /// Before the first mission; `missing` are the strategies of all that are left.
    pub fn new(missing: impl Iterator<Item = usize>) -> Self {
        let mut work = Vec::<StrategyWork>::new();
        for strategy in missing {
            if work.len() <= strategy {
                work.resize(strategy + 1, StrategyWork::default());
            }
            work[strategy].missing += 1;
        }
        Self(work)
    }

    /// Takes in that a mission was flown, and how long it took.
    pub fn add(&mut self, strategy: usize, took: Duration) {
        let work = &mut self.0[strategy];
        work.missing -= 1;
        work.flown += 1;
        work.took += took;
    }

    /// The missions that are left.
    pub fn missing(&self) -> usize {
        self.0.iter().map(|work| work.missing as usize).sum()
    }

    /// The time that is left on `threads` threads; none before a mission of every strategy was flown.
    pub fn left(&self, threads: usize) -> Option<Duration> {
        let threads = threads.clamp(1, self.missing().max(1));
        let missing = self.0.iter().filter(|work| work.missing > 0);
        let left: Option<Duration> = missing.map(|work| Some(work.took.checked_div(work.flown)? * work.missing)).sum();
        left.map(|left| left / threads as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn seconds(seconds: u64) -> Duration {
        Duration::from_secs(seconds)
    }

    #[test]
    fn what_is_left_is_weighed_by_what_each_strategy_takes() {
        let mut work = Workload::new([0, 0, 0, 0, 2, 2, 2].into_iter());
        work.add(0, seconds(1));
        assert_eq!(work.left(1), None, "strategy 2 is not known");
        work.add(2, seconds(40));
        assert_eq!(work.left(1), Some(seconds(3 + 80)));
        assert_eq!(work.left(2), Some(seconds(83) / 2));
        // The mean of 1 s and 3 s is 2 s.
        work.add(0, seconds(3));
        assert_eq!(work.left(1), Some(seconds(4 + 80)));
    }

    #[test]
    fn more_threads_than_missions_do_not_help() {
        let mut work = Workload::new([0, 0].into_iter());
        work.add(0, seconds(8));
        assert_eq!(work.left(4), Some(seconds(8)));
        work.add(0, seconds(8));
        assert_eq!(work.left(4), Some(seconds(0)));
        assert_eq!(Workload::new(std::iter::empty()).left(1), Some(seconds(0)));
    }
}
