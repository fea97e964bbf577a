//! Latencies of the ring by hop, from the times at which samples were sent.

use std::time::Duration;

use hdrhistogram::Histogram;
use serde::{Deserialize, Serialize};
use skysink_common::pace::Pace;

/// A histogram of times [ns] up to an hour, with three significant digits.
///
/// # Panics
/// Never: its bounds are valid.
#[must_use]
pub fn histogram() -> Histogram<u64> {
    const HOUR_NS: u64 = 3_600_000_000_000;
    Histogram::new_with_bounds(1, HOUR_NS, 3).expect("valid bounds and digits")
}

/// Send times of the samples of a slot; `None` for missed samples.
#[derive(Debug, Clone, Copy, Default)]
pub struct SlotTimes {
    /// The beginning of the slot, in paced runs.
    pub tick_ns: Option<u64>,
    /// The plan.
    pub plan_ns: Option<u64>,
    /// The flight.
    pub flight_ns: u64,
    /// The queues after it.
    pub queues_ns: u64,
}

/// A distribution of times [µs].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Median.
    pub p50_us: f64,
    /// 99th percentile.
    pub p99_us: f64,
    /// 99.9th percentile.
    pub p999_us: f64,
    /// Longest.
    pub max_us: f64,
}

impl Spread {
    /// The distribution of times in nanoseconds.
    #[must_use]
    pub fn of(ns: &Histogram<u64>) -> Self {
        let us = |quantile| ns.value_at_quantile(quantile) as f64 / 1e3;
        Self { p50_us: us(0.5), p99_us: us(0.99), p999_us: us(0.999), max_us: ns.max() as f64 / 1e3 }
    }
}

/// The latencies of a run, from sample to sample.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Latencies {
    /// `queues(t−1)` to `plan(t)`.
    pub queues_to_plan: Spread,
    /// `plan(t)` to `flight(t)`; in paced runs from the beginning of the slot.
    pub to_flight: Spread,
    /// `flight(t)` to `queues(t)`.
    pub flight_to_queues: Spread,
    /// `queues(t−1)` to `queues(t)`; in paced runs from the beginning of the slot to the next plan, which must be less
    /// than the period.
    pub slot: Spread,
    /// Deviation of the time between two slots from the period, in paced runs.
    pub jitter: Option<Spread>,
}

/// Collects the latencies of a run.
#[derive(Debug)]
pub struct Latency {
    /// Period of the slots; `None` in lock-step.
    period: Option<Duration>,
    last: Option<SlotTimes>,
    /// Slots that began more than 1.5 periods after the one before.
    pub(crate) late_slots: u64,
    plan: Histogram<u64>,
    flight: Histogram<u64>,
    queues: Histogram<u64>,
    slot: Histogram<u64>,
    jitter: Histogram<u64>,
}

impl Latency {
    /// Starts the measurement of a run at `pace`.
    #[must_use]
    pub fn new(pace: Pace, slot_s: f64) -> Self {
        Self {
            period: pace.period(slot_s),
            last: None,
            late_slots: 0,
            plan: histogram(),
            flight: histogram(),
            queues: histogram(),
            slot: histogram(),
            jitter: histogram(),
        }
    }

    /// Adds a slot, the first or the successor of the last one.
    pub fn add(&mut self, times: SlotTimes) {
        let flight_begin_ns = if self.period.is_some() { times.tick_ns } else { times.plan_ns };
        record(&mut self.flight, flight_begin_ns, Some(times.flight_ns));
        record(&mut self.queues, Some(times.flight_ns), Some(times.queues_ns));
        let Some(last) = self.last.replace(times) else { return };
        record(&mut self.plan, Some(last.queues_ns), times.plan_ns);
        let Some(period) = self.period else {
            return record(&mut self.slot, Some(last.queues_ns), Some(times.queues_ns));
        };
        record(&mut self.slot, last.tick_ns, times.plan_ns);
        if let (Some(last_ns), Some(tick_ns)) = (last.tick_ns, times.tick_ns) {
            let apart = Duration::from_nanos(tick_ns.saturating_sub(last_ns));
            self.late_slots += u64::from(apart > period.mul_f64(1.5));
            let off_ns = u64::try_from(apart.abs_diff(period).as_nanos()).unwrap_or(u64::MAX);
            self.jitter.saturating_record(off_ns.max(1));
        }
    }

    /// The distributions so far; `None` before the second slot.
    pub fn spreads(&self) -> Option<Latencies> {
        (!self.queues.is_empty()).then(|| Latencies {
            queues_to_plan: Spread::of(&self.plan),
            to_flight: Spread::of(&self.flight),
            flight_to_queues: Spread::of(&self.queues),
            slot: Spread::of(&self.slot),
            jitter: self.period.map(|_| Spread::of(&self.jitter)),
        })
    }
}

/// Adds the time between two samples, if both are known and in order. After a restart one may have been sent again.
fn record(histogram: &mut Histogram<u64>, from_ns: Option<u64>, to_ns: Option<u64>) {
    if let (Some(from_ns), Some(to_ns)) = (from_ns, to_ns)
        && let Some(ns) = to_ns.checked_sub(from_ns)
    {
        histogram.saturating_record(ns.max(1));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The times of slot t that begins at `begin` [µs] after which plan, flight and queues come 10, 30 and 60 µs apart.
    fn times(begin_us: u64) -> SlotTimes {
        let ns = |us: u64| (begin_us + us) * 1_000;
        SlotTimes { tick_ns: Some(ns(0)), plan_ns: Some(ns(10)), flight_ns: ns(40), queues_ns: ns(100) }
    }

    fn about(spread: Spread, us: f64) -> bool {
        [spread.p50_us, spread.p99_us, spread.p999_us, spread.max_us]
            .iter()
            .all(|value| (value / us - 1.0).abs() < 2e-3)
    }

    #[test]
    fn hop_latency_is_measured_between_samples() {
        let mut latency = Latency::new(Pace::Max, 1.0);
        assert_eq!(latency.spreads(), None);
        (0..100).for_each(|slot| latency.add(times(slot * 500)));
        let spreads = latency.spreads().unwrap();
        // queues at 100 µs, the next plan at 510 µs
        assert!(about(spreads.queues_to_plan, 410.0) && about(spreads.to_flight, 30.0), "{spreads:?}");
        assert!(about(spreads.flight_to_queues, 60.0) && about(spreads.slot, 500.0), "{spreads:?}");
        assert_eq!(spreads.jitter, None);
    }

    #[test]
    fn latency_of_a_paced_slot_is_measured_from_its_start() {
        let mut latency = Latency::new(Pace::Factor(2000.0), 1.0); // 500 µs
        (0..100).for_each(|slot| latency.add(times(slot * 500 + slot % 2 * 3)));
        let spreads = latency.spreads().unwrap();
        assert!(about(spreads.to_flight, 40.0), "{spreads:?}");
        assert!(about(spreads.jitter.unwrap(), 3.0), "{spreads:?}");
        assert!(spreads.slot.max_us > 512.0 && spreads.slot.max_us < 514.5, "tick to the next plan: {spreads:?}");
    }

    #[test]
    fn missed_and_repeated_samples_are_not_measured() {
        let mut latency = Latency::new(Pace::Max, 1.0);
        latency.add(times(0));
        latency.add(SlotTimes { plan_ns: None, ..times(500) });
        latency.add(SlotTimes { flight_ns: 5, ..times(1_000) });
        assert!(about(latency.spreads().unwrap().to_flight, 30.0));
    }
}
