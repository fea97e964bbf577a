//! `skysink bench`: planner, field, missions and ring against their lower bounds, measured in the same run.

mod field;
mod hop;
mod machine;
mod mission;
mod planner;
mod ring;
mod table;

use std::path::Path;
use std::time::Instant;

use clap::{Args, ValueEnum};
use serde::Serialize;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::stop::Stop;
use skysink_mission::error::FileContext;
use skysink_planner::settings;

use crate::error::Error;
use crate::report::print;

/// Options of `skysink bench`.
#[derive(Debug, Args)]
pub struct BenchOptions {
    /// Measure for seconds instead of minutes, with less precision.
    #[arg(long)]
    quick: bool,
    /// Print the measurements as JSON.
    #[arg(long)]
    json: bool,
    /// Measure this part only (repeatable).
    #[arg(long, value_name = "PART")]
    only: Vec<BenchPart>,
}

/// What can be measured by itself, in the order of measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum BenchPart {
    /// Plan times, by strategy and number of SNs.
    Planner,
    /// A slot of the field, against a copy of its queues.
    Field,
    /// Missions in one process, on one core and on all.
    Mission,
    /// The ring of processes, against bare iceoryx2 hops.
    Ring,
}

/// How much is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Effort {
    /// Minutes: the medians repeat within some percent on a quiet machine.
    Full,
    /// Seconds: whether it works, and about how fast.
    Quick,
}

impl Effort {
    fn choose<T>(self, full: T, quick: T) -> T {
        match self {
            Self::Full => full,
            Self::Quick => quick,
        }
    }

    /// Numbers of sensor nodes (SNs) that are measured, at the paper's density.
    fn counts(self) -> &'static [u32] {
        self.choose(&[200, 10_000, 1_000_000], &[200, 10_000])
    }
}

/// What was measured; `None` for a part that was not asked for.
#[derive(Debug, Default, Serialize)]
struct Report {
    version: &'static str,
    machine: machine::Machine,
    planner: Option<Vec<planner::PlanRow>>,
    field: Option<Vec<field::FieldRow>>,
    mission: Option<mission::MissionSpeeds>,
    ring: Option<Vec<ring::RingRow>>,
}

impl BenchOptions {
    /// Measures the parts, all if none is named, and prints the report.
    pub(crate) fn bench(&self, stop: &Stop) -> Result<(), Error> {
        let effort = if self.quick { Effort::Quick } else { Effort::Full };
        let machine = machine::Machine::this();
        let mut report = Report { version: env!("CARGO_PKG_VERSION"), machine, ..Report::default() };
        let is_wanted = |part: &&BenchPart| self.only.is_empty() || self.only.contains(part);
        for part in BenchPart::value_variants().iter().filter(is_wanted) {
            match part {
                BenchPart::Planner => report.planner = Some(planner::measure(effort, stop)?),
                BenchPart::Field => report.field = Some(field::measure(effort, stop)?),
                BenchPart::Mission => report.mission = Some(mission::measure(effort, stop)?),
                BenchPart::Ring => report.ring = Some(ring::measure(effort, stop)?),
            }
        }
        if self.json {
            print(serde_json::to_string_pretty(&report).expect("plain keys and values"))
        } else {
            print(report)
        }
    }
}

/// What the paper's mission becomes with `count` SNs at its density: keys and values of a scenario.
fn letter_keys(count: u32, slots: u64) -> [String; 4] {
    let side_m = 100.0 * (f64::from(count) / 200.0).sqrt();
    [
        format!("slots={slots}"),
        format!("area.side_m={side_m:?}"),
        format!("sensors.count={count}"),
        "uav.endurance_s=1e9".to_owned(),
    ]
}

/// The same as the text of a scenario file.
fn letter_text(count: u32, slots: u64) -> String {
    format!("name = \"bench\"\n{}", letter_keys(count, slots).join("\n"))
}

/// The same as a scenario.
fn letter(count: u32, strategy: &'static str) -> Scenario {
    let overrides = Overrides { strategy: Some(strategy), ..Overrides::default() };
    Scenario::parse(&letter_text(count, 600), Path::new("bench.toml"), overrides)
        .and_then(settings::resolve)
        .expect("a valid scenario")
}

/// Time since `begin` [ns].
fn nanoseconds(begin: Instant) -> u64 {
    u64::try_from(begin.elapsed().as_nanos()).unwrap_or(u64::MAX)
}

/// The element whose `value` is the median. There must be one.
fn median_by<T>(mut elements: Vec<T>, value: impl Fn(&T) -> f64) -> T {
    elements.sort_by(|a, b| value(a).total_cmp(&value(b)));
    elements.swap_remove(elements.len() / 2)
}

/// A folder that goes with the measurement.
fn temporary_folder() -> Result<tempfile::TempDir, Error> {
    Ok(tempfile::tempdir().at(Path::new("folder for temporary files"))?)
}
