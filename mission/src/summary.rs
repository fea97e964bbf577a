//! The parts of a summary that have figures of their own.

mod uses;

use std::borrow::Cow;

use serde::{Deserialize, Serialize};
use skysink_common::figure::{FigureValue, ReportRow};
use skysink_common::pace::Pace;

use crate::latency::{Latencies, Spread};
use crate::numbers::grouped;

pub(crate) use uses::is_late;
pub use uses::{EnergyUse, FleetUse, OperatorUse, score};

/// An event of a process, as in `summary.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// The current slot.
    pub slot: u64,
    /// Wall time since the run began [s].
    pub at_s: f64,
    /// The process.
    pub process: Cow<'static, str>,
    /// Description of the event.
    pub event: String,
}

/// The wall-clock figures of a run.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct RunTiming {
    /// Pace; `None` in one process.
    pub pace: Option<Pace>,
    /// Duration [s], from the first slot to the last.
    pub wall_s: f64,
    /// Slots per second.
    pub slots_per_s: f64,
    /// Slots whose plan had not arrived when they began, including those before a resumption.
    pub missed_deadlines: u64,
    /// Slots that began late, because the ring did not keep up with the clock.
    pub late_slots: u64,
    /// Planning time, median [µs].
    pub plan_p50_us: f64,
    /// Planning time, 99th percentile [µs].
    pub plan_p99_us: f64,
    /// Planning time, 99.9th percentile [µs].
    #[serde(default)] // runs of older builds have none
    pub plan_p999_us: f64,
    /// Planning time, longest [µs].
    pub plan_max_us: f64,
    /// Latencies between samples; `None` in one process.
    pub latency: Option<Latencies>,
}

impl FigureValue for RunTiming {}

impl RunTiming {
    /// Its rows of the printed report.
    pub(crate) fn report(&self) -> Vec<ReportRow> {
        let row = |heading, value| ReportRow { heading, value };
        let mut rows = vec![
            row("plan time p50 / p99", format!("{:.1} µs / {:.1} µs", self.plan_p50_us, self.plan_p99_us)),
            row("slots per second", format!("{:.0}", self.slots_per_s)),
        ];
        if self.pace.is_some_and(|pace| pace != Pace::Max) {
            rows.push(row("deadlines missed", grouped(self.missed_deadlines)));
            rows.push(row("late slots", grouped(self.late_slots)));
        }
        if let Some(latency) = self.latency.filter(|_| self.pace != Some(Pace::Max)) {
            let spread = |spread: Spread| {
                let Spread { p50_us, p99_us, p999_us, max_us } = spread;
                format!("{p50_us:.0} / {p99_us:.0} / {p999_us:.0} / {max_us:.0} µs")
            };
            rows.push(row("latency p50 / p99 / p99.9 / max", String::new()));
            rows.push(row("  queues to plan", spread(latency.queues_to_plan)));
            rows.push(row("  slot start to flight", spread(latency.to_flight)));
            rows.push(row("  flight to queues", spread(latency.flight_to_queues)));
            rows.push(row("  slot start to next plan", spread(latency.slot)));
            rows.extend(latency.jitter.map(|jitter| row("  jitter of the slot start", spread(jitter))));
        }
        rows
    }
}
