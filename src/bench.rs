//! `skysink bench`: how fast planner, field, missions and ring are on this machine, beside their lower bounds, measured
//! in the same run.

mod field;
pub mod hop;
mod machine;
mod mission;
mod planner;
mod ring;
mod table;

use std::fmt::Write as _;
use std::path::Path;
use std::time::Instant;

use clap::{Args, ValueEnum};
use hdrhistogram::Histogram;
use serde::Serialize;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::stop::Stop;
use skysink_planner::settings;

use crate::error::Error;
use crate::report::print;
use skysink_mission::latency::{Spread, histogram};

/// Options of `skysink bench`.
#[derive(Debug, Args)]
pub struct BenchOptions {
    /// Measure roughly: seconds instead of minutes.
    #[arg(long)]
    quick: bool,
    /// Print the measurements as JSON.
    #[arg(long)]
    json: bool,
    /// Measure this only (repeatable).
    #[arg(long, value_name = "PART")]
    only: Vec<BenchPart>,
}

/// What can be measured by itself, in the order in which it is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum BenchPart {
    /// A slot's plan, by strategy and number of SNs.
    Planner,
    /// A slot of the field, beside a copy.
    Field,
    /// Missions in one process, on one core and on all.
    Mission,
    /// The ring of processes, beside bare hops.
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
    /// One of two, by the effort.
    fn choose<T>(self, full: T, quick: T) -> T {
        match self {
            Self::Full => full,
            Self::Quick => quick,
        }
    }
}

/// Numbers of sensor nodes (SNs) that everything is measured with, at the letter's density.
fn counts(effort: Effort) -> &'static [u32] {
    effort.choose(&[200, 10_000, 1_000_000], &[200, 10_000])
}

/// What was measured; a part that was not asked for is none.
#[derive(Debug, Default, Serialize)]
struct Report {
    version: &'static str,
    machine: machine::Machine,
    planner: Option<planner::PlannerSpeeds>,
    field: Option<Vec<field::FieldRow>>,
    mission: Option<mission::MissionSpeeds>,
    ring: Option<Vec<ring::RingRow>>,
}

impl BenchOptions {
    /// Measures the parts, all if none is named, and prints what was measured.
    ///
    /// # Errors
    /// If an executable is missing or fails, nothing can be written to the folder for temporary files, or on a stop.
    ///
    /// # Panics
    /// Never: the report's keys and values are plain.
    pub fn bench(&self, stop: &Stop) -> Result<(), Error> {
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

/// The letter's scenario with `count` SNs at its density, as a file's text.
fn letter_text(count: u32, slots: u64) -> String {
    let side_m = 100.0 * (f64::from(count) / 200.0).sqrt();
    let mut text = format!("name = \"bench\"\nslots = {slots}\n");
    let _ = write!(text, "[area]\nside_m = {side_m:?}\n[sensors]\ncount = {count}\n[uav]\nendurance_s = 1e9\n");
    text
}

/// The same as a scenario.
fn letter(count: u32, strategy: &'static str) -> Scenario {
    let overrides = Overrides { strategy: Some(strategy), ..Overrides::default() };
    Scenario::parse(&letter_text(count, 600), Path::new("bench.toml"), overrides)
        .and_then(settings::resolve)
        .expect("a valid scenario")
}

/// Times that are being collected, down to a nanosecond.
struct Times(Histogram<u64>);

impl Times {
    fn new() -> Self {
        Self(histogram())
    }

    /// Takes the time since `begin`, divided among `steps` steps.
    fn add(&mut self, begin: Instant, steps: u64) {
        let ns = u64::try_from(begin.elapsed().as_nanos()).unwrap_or(u64::MAX) / steps;
        self.0.saturating_record(ns.max(1));
    }

    fn spread(&self) -> Spread {
        Spread::of(&self.0)
    }
}

/// The middle value.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// The middle of several distributions, quantile by quantile, with the longest of all.
fn median_spread(spreads: &[Spread]) -> Spread {
    let middle = |of: fn(&Spread) -> f64| median(spreads.iter().map(of).collect());
    Spread {
        p50_us: middle(|spread| spread.p50_us),
        p99_us: middle(|spread| spread.p99_us),
        p999_us: middle(|spread| spread.p999_us),
        max_us: spreads.iter().map(|spread| spread.max_us).fold(0.0, f64::max),
    }
}
