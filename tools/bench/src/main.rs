//! Measures planner, field, missions and ring against their lower bounds, and fleets against one UAV, in the same run.

mod error;
mod field;
mod fleet;
mod hop;
mod mission;
mod planner;
mod ring;
mod setting;
mod table;

use std::env;
use std::ffi::OsString;
use std::fs;
use std::process::ExitCode;

use clap::{Parser, ValueEnum};
use serde::Serialize;
use skysink::report::print;
use skysink::{programs, usage, worker};
use skysink_common::stop::Stop;
use skysink_ring::role::Role;
use skysink_ring::wait::{exit_on_second_signal, stop_on_signals};

use error::BenchError;
use setting::{BenchEffort, cores};

/// Benchmark planner, field, missions and ring against their lower bounds, and fleets against one UAV.
#[derive(Debug, Parser)]
#[command(
    name = "skysink-bench",
    version = usage::VERSION,
    after_help = "\
Examples:
  skysink-bench --quick               less accurate, takes seconds
  skysink-bench --only ring           slot latency of the ring and of bare hops
  skysink-bench --json > bench.json   all results as JSON, takes minutes"
)]
struct Cli {
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
enum BenchPart {
    /// Plan times, by strategy and number of SNs.
    Planner,
    /// A slot of the field, against a copy of its queues.
    Field,
    /// Missions in one process, on one core and on all.
    Mission,
    /// The ring of processes, against bare iceoryx2 hops.
    Ring,
    /// Several UAVs, against one.
    Fleet,
}

/// What was measured; `None` for a part that was not asked for.
#[derive(Debug, Default, Serialize)]
struct Report {
    version: &'static str,
    machine: Machine,
    planner: Option<Vec<planner::PlanRow>>,
    field: Option<Vec<field::FieldRow>>,
    mission: Option<mission::MissionSpeeds>,
    ring: Option<Vec<ring::RingRow>>,
    fleet: Option<Vec<fleet::FleetRow>>,
}

impl Cli {
    /// Measures the parts, all if none is named, and prints the report.
    fn run(self, stop: &Stop) -> Result<(), BenchError> {
        let effort = if self.quick { BenchEffort::Quick } else { BenchEffort::Full };
        let machine = Machine::this();
        let mut report = Report { version: env!("CARGO_PKG_VERSION"), machine, ..Report::default() };
        let is_wanted = |part: &&BenchPart| self.only.is_empty() || self.only.contains(part);
        for part in BenchPart::value_variants().iter().filter(is_wanted) {
            match part {
                BenchPart::Planner => report.planner = Some(planner::measure(effort, stop)?),
                BenchPart::Field => report.field = Some(field::measure(effort, stop)?),
                BenchPart::Mission => report.mission = Some(mission::measure(effort, stop)?),
                BenchPart::Ring => report.ring = Some(ring::measure(effort, stop)?),
                BenchPart::Fleet => report.fleet = Some(fleet::measure(effort, stop)?),
            }
        }
        if self.json {
            print(serde_json::to_string_pretty(&report).expect("plain keys and values"))?;
        } else {
            print(table::of(&report))?;
        }
        Ok(())
    }
}

/// What a measurement depends on besides the program.
#[derive(Debug, Default, Serialize)]
struct Machine {
    /// Model of the processor.
    cpu: String,
    /// Cores that this process may use.
    cores: usize,
    /// The compiler.
    rustc: &'static str,
    /// How it was built: `release` or `debug`.
    build: &'static str,
    /// Load average over the last minute, before the first measurement: what else runs here.
    load_average: f64,
}

impl Machine {
    /// This machine; what the system does not tell is empty or 0.
    fn this() -> Self {
        let read = |path| fs::read_to_string(path).unwrap_or_default();
        let processor = read("/proc/cpuinfo");
        let model = processor.lines().find_map(|line| line.strip_prefix("model name")).unwrap_or_default();
        let load = read("/proc/loadavg");
        Self {
            cpu: model.trim_start_matches([' ', '\t', ':']).to_owned(),
            cores: cores(),
            rustc: usage::COMPILER,
            build: if cfg!(debug_assertions) { "debug" } else { "release" },
            load_average: load.split(' ').next().and_then(|minute| minute.parse().ok()).unwrap_or(0.0),
        }
    }
}

fn main() -> ExitCode {
    let arguments: Vec<OsString> = env::args_os().collect();
    // The programs of the ring are this executable, with their names as its first argument.
    if let Some(program) = arguments.get(1).and_then(|name| programs::of(name.to_str()?)) {
        return program(arguments[1..].to_vec()).into();
    }
    worker::silence_iceoryx2();
    if arguments.get(1).is_some_and(|name| name == hop::PROGRAM) {
        return hop::program(&arguments[1..]);
    }
    let stop = stop_on_signals();
    exit_on_second_signal();
    let cli: Cli = match usage::parse(arguments) {
        Ok(cli) => cli,
        Err(message) => return usage::print(Role::Launcher, message).into(),
    };
    match cli.run(&stop) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("skysink-bench: {error}");
            error.exit_code().into()
        }
    }
}
