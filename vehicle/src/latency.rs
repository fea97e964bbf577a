//! The times from the plans to the messages that they become.

use std::time::Duration;

/// Times between two events on the monotonic clock.
#[derive(Debug, Clone, Default)]
pub struct OrderLatencies(Vec<Duration>);

impl OrderLatencies {
    /// Adds the time from `from_ns` to `to_ns` [ns].
    pub fn add(&mut self, from_ns: u64, to_ns: u64) {
        self.0.push(Duration::from_nanos(to_ns.saturating_sub(from_ns)));
    }

    /// What is said of them when the mission has ended; `None` without times.
    pub fn said(&self) -> Option<String> {
        let [median_ms, rare_ms] = self.quantiles([0.5, 0.99])?.map(|time| time.as_secs_f64() * 1e3);
        Some(format!("from plan to MAVLink: median {median_ms:.2} ms, 99 % within {rare_ms:.2} ms"))
    }

    /// The quantiles of these levels, 0 to 1, by nearest rank; `None` without times.
    pub fn quantiles<const N: usize>(&self, levels: [f64; N]) -> Option<[Duration; N]> {
        let mut sorted = self.0.clone();
        sorted.sort_unstable();
        let last = sorted.len().checked_sub(1)?;
        Some(levels.map(|level| sorted[((level * sorted.len() as f64).ceil() as usize).clamp(1, last + 1) - 1]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quantile_is_a_measured_time() {
        let mut latencies = OrderLatencies::default();
        assert_eq!(latencies.quantiles([0.5]), None);
        (1..=10).rev().for_each(|ns| latencies.add(100, 100 + ns));
        assert_eq!(latencies.quantiles([0.0, 0.5, 0.99]), Some([1, 5, 10].map(Duration::from_nanos)));
        latencies.add(7, 3);
        assert_eq!(latencies.quantiles([0.0]), Some([Duration::ZERO]), "clocks of two hosts");
        (0..90).for_each(|_| latencies.add(0, 2_500_000));
        assert_eq!(latencies.said().unwrap(), "from plan to MAVLink: median 2.50 ms, 99 % within 2.50 ms");
    }
}
