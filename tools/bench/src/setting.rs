//! What all benchmarks share: how much is measured, on which missions, and medians.

use std::path::Path;
use std::time::Instant;

use skysink_common::scenario::{Overrides, Scenario};
use skysink_mission::error::FileContext;
use skysink_planner::settings;

use crate::error::BenchError;

/// How much is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BenchEffort {
    /// Minutes: the medians repeat within some percent on a quiet machine.
    Full,
    /// Seconds: whether it works, and about how fast.
    Quick,
}

impl BenchEffort {
    /// The value for this effort.
    pub fn choose<T>(self, full: T, quick: T) -> T {
        match self {
            Self::Full => full,
            Self::Quick => quick,
        }
    }

    /// Numbers of sensor nodes (SNs) that are measured, at the paper's density.
    pub fn counts(self) -> &'static [u32] {
        self.choose(&[200, 10_000, 1_000_000], &[200, 10_000])
    }
}

/// What the paper's mission becomes with `count` SNs at its density: keys and values of a scenario.
pub fn letter_keys(count: u32, slots: u64) -> [String; 4] {
    let side_m = 100.0 * (f64::from(count) / 200.0).sqrt();
    [
        format!("slots={slots}"),
        format!("area.side_m={side_m:?}"),
        format!("sensors.count={count}"),
        "uav.endurance_s=1e9".to_owned(),
    ]
}

/// The same as the text of a scenario file.
pub fn letter_text(count: u32, slots: u64) -> String {
    format!("name = \"bench\"\n{}", letter_keys(count, slots).join("\n"))
}

/// The same as a scenario.
pub fn letter(count: u32, strategy: &'static str) -> Scenario {
    let overrides = Overrides { strategy: Some(strategy), ..Overrides::default() };
    Scenario::parse(&letter_text(count, 600), Path::new("bench.toml"), overrides)
        .and_then(settings::resolve)
        .expect("a valid scenario")
}

/// Time since `begin` [ns].
pub fn nanoseconds(begin: Instant) -> u64 {
    u64::try_from(begin.elapsed().as_nanos()).unwrap_or(u64::MAX)
}

/// The element whose `value` is the median. There must be one.
pub fn median_by<T>(mut elements: Vec<T>, value: impl Fn(&T) -> f64) -> T {
    elements.sort_by(|a, b| value(a).total_cmp(&value(b)));
    elements.swap_remove(elements.len() / 2)
}

/// A folder that goes with the measurement.
pub fn temporary_folder() -> Result<tempfile::TempDir, BenchError> {
    Ok(tempfile::tempdir().at(Path::new("folder for temporary files"))?)
}

/// Cores that this process may use.
pub fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}
