//! The progress of sweeps and searches. The lab reports it to a callback and prints nothing.

use std::time::Duration;

/// The progress of a sweep or a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LabProgress {
    /// Finished missions of a sweep, or steps of a search.
    pub done: u64,
    /// Total number of missions or steps.
    pub of: u64,
    /// In a search: loss rate of the best flight so far, as predicted; η, or η_w where weights differ.
    pub loss_rate: Option<f64>,
    /// In a sweep: the estimated remaining time; `None` until there is an estimate.
    pub left: Option<Duration>,
}

/// Callback for progress, called from any thread: once at the beginning, and after every mission or batch of steps.
pub type OnProgress<'a> = &'a (dyn Fn(LabProgress) + Sync);

/// Estimates the remaining time of a sweep, from the remaining missions and their duration per strategy. A strategy
/// with a search can take ten thousand times as long as a simple rule.
#[derive(Debug, Clone)]
pub struct Workload(Vec<StrategyWork>);

/// The workload of one strategy.
#[derive(Debug, Clone, Copy, Default)]
struct StrategyWork {
    /// Remaining missions.
    missing: u32,
    /// Finished missions.
    flown: u32,
    /// Total duration of the finished missions.
    took: Duration,
}

impl Workload {
    /// The workload before the first mission. `missing` yields the strategy index of every remaining mission.
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

    /// Adds a finished mission and its duration.
    pub fn add(&mut self, strategy: usize, took: Duration) {
        let work = &mut self.0[strategy];
        work.missing -= 1;
        work.flown += 1;
        work.took += took;
    }

    /// The number of remaining missions.
    pub fn missing(&self) -> usize {
        self.0.iter().map(|work| work.missing as usize).sum()
    }

    /// The remaining time on `threads` threads; `None` until every strategy has finished a mission.
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
    fn the_remaining_time_is_estimated_per_strategy() {
        let mut work = Workload::new([0, 0, 0, 0, 2, 2, 2].into_iter());
        work.add(0, seconds(1));
        assert_eq!(work.left(1), None, "strategy 2 has no estimate");
        work.add(2, seconds(40));
        assert_eq!(work.left(1), Some(seconds(3 + 80)));
        assert_eq!(work.left(2), Some(seconds(83) / 2));
        // The mean of 1 s and 3 s is 2 s.
        work.add(0, seconds(3));
        assert_eq!(work.left(1), Some(seconds(4 + 80)));
    }

    #[test]
    fn idle_threads_do_not_shorten_the_estimate() {
        let mut work = Workload::new([0, 0].into_iter());
        work.add(0, seconds(8));
        assert_eq!(work.left(4), Some(seconds(8)));
        work.add(0, seconds(8));
        assert_eq!(work.left(4), Some(seconds(0)));
        assert_eq!(Workload::new(std::iter::empty()).left(1), Some(seconds(0)));
    }
}
