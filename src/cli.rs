//! The command line of `skysink`.

mod bench;
mod flight;
mod optimize;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand, ValueEnum};
use skysink_common::node::Stop;
use skysink_common::scenario::{Overrides, Scenario, Strategy};
use skysink_common::sensors::SensorList;

use crate::error::Error;
use crate::figures::campaign;
use crate::run::run;
use crate::simulate::{Simulation, simulate};
use crate::sweep::plan::Sweep;
use crate::{report, sweep, worker};
use bench::{BenchOptions, HopOptions};
use flight::{RunOptions, SoakOptions};
use optimize::OptimizeOptions;

/// Plans and flies a UAV that collects data from wireless sensor nodes, slot by slot.
#[derive(Debug, Parser)]
#[command(
    name = "skysink",
    version,
    arg_required_else_help = true,
    after_help = "\
Examples:
  skysink run                                      the letter's mission
  skysink run scenarios/sparse.toml --strategy gfs --pace 10x --live
  skysink simulate scenarios/letter.toml --seed 7  the same in one process
  skysink check scenarios/letter.toml              every key with its value

Exit codes: 0 done, 1 failed while running, 2 bad input or usage, 130 Ctrl-C, 143 SIGTERM."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Print the scenario with every default, or what is wrong with it.
    Check {
        /// Scenario file.
        scenario: PathBuf,
    },
    /// Fly a mission in one process.
    #[command(after_help = "\
Examples:
  skysink simulate scenarios/letter.toml
  skysink simulate scenarios/sparse.toml --strategy gfs --seed 3 --record --out /tmp/sparse")]
    Simulate {
        /// Scenario file.
        scenario: PathBuf,
        #[command(flatten)]
        choice: Choice,
        /// Leave a recording for rerun, mission.rrd.
        #[arg(long)]
        record: bool,
    },
    /// Fly a mission with a process for each part of the ring, and record it.
    #[command(after_help = "\
Examples:
  skysink run                          the letter's mission, as fast as it goes
  skysink run --pace realtime --live   then: rerun rerun+http://127.0.0.1:9876/proxy
  skysink run --external planner       waits for your planner, and says where
  skysink run --resume runs/letter-uts-1")]
    Run(RunOptions),
    /// Fly a long mission with processes that are killed at random, and check that nothing is lost and nothing grows.
    Soak(SoakOptions),
    /// Fly many missions: a grid of scenarios, by strategy and seed. Interrupted, it goes on where it was.
    #[command(after_help = "\
Examples:
  skysink sweep scenarios/sweeps/letter.toml
  skysink sweep area.toml --out area-1 --shard 1/2     and on another machine --shard 2/2;
  skysink merge area-1 area-2 --out area               then joins the two")]
    Sweep {
        /// Sweep file.
        sweep: PathBuf,
        /// Folder to write, or to go on with [default: runs/<file's name>].
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Missions flown at the same time [default: one per core].
        #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
        threads: usize,
        /// Fly every n-th point only, from the k-th.
        #[arg(long, value_name = "K/N", value_parser = shard, default_value = "1/1")]
        shard: (usize, usize),
    },
    /// Draw the letter's figures, with the sweeps behind them. Interrupted, it goes on where it was.
    #[command(after_help = "\
Examples:
  skysink figures --quick             a first look, in minutes
  skysink figures --only area,maps    some of them
  skysink figures --runs 300          the letter's number of missions per point")]
    Figures {
        /// Only these figures (repeatable, or separated by commas).
        #[arg(long, value_name = "PART", value_enum, value_delimiter = ',')]
        only: Vec<campaign::Part>,
        /// 5 missions per point.
        #[arg(long, conflicts_with = "runs")]
        quick: bool,
        /// Missions per point.
        #[arg(long, value_name = "N", default_value_t = 50, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
        runs: u64,
        /// Folder to write, or to go on with [default: runs/figures-<runs>].
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Search steps of horizon in a slot, and 200 times as many for the best known; four times that in sparse fields.
        #[arg(long, value_name = "N", default_value_t = campaign::HORIZON_ITERATIONS)]
        #[arg(value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
        horizon_iterations: u32,
        /// Missions flown at the same time [default: one per core].
        #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
        threads: usize,
    },
    /// Search for the flight that loses least, fly it, and say how far every strategy is from it.
    #[command(after_help = "\
Examples:
  skysink optimize scenarios/sparse.toml --budget 60s
  skysink optimize scenarios/letter.toml --seed 3 --budget 5000000 --record

The result is the best known, not a proven optimum; what no flight avoids is
shown beside it. The same number of steps finds the same flight on every
machine; a time is turned into steps by a trial.")]
    Optimize(OptimizeOptions),
    /// Measure how fast planner, field, missions and ring are on this machine, beside what they cannot be faster than.
    #[command(after_help = "\
Examples:
  skysink bench --quick               does it work, and about how fast: seconds
  skysink bench --only ring           slot latency of the ring, beside bare hops
  skysink bench --json > bench.json   everything, for machines: minutes")]
    Bench(BenchOptions),
    /// A process of a benchmark.
    #[command(hide = true)]
    Hop(HopOptions),
    /// Join the shards of a sweep.
    Merge {
        /// Folders of the shards.
        #[arg(required = true)]
        shards: Vec<PathBuf>,
        /// Folder to write.
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
    },
}

/// Missions per point of `--quick`.
const QUICK_RUNS: u64 = 5;

/// What every flight lets choose.
#[derive(Debug, Args)]
struct Choice {
    /// Strategy, instead of the scenario's.
    #[arg(long)]
    strategy: Option<StrategyName>,
    #[command(flatten)]
    flight: Flown,
}

/// Which field is flown over, and where the run is put.
#[derive(Debug, Args)]
struct Flown {
    /// Seed, instead of the scenario's.
    #[arg(long, value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    seed: Option<u64>,
    /// Folder to write [default: runs/<name>-<strategy>-<seed>].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace the run in DIR if it exists.
    #[arg(long, requires = "out")]
    force: bool,
}

impl Choice {
    fn overrides(&self) -> Overrides {
        Overrides { seed: self.flight.seed, strategy: self.strategy.map(|name| name.0), slots: None }
    }
}

/// A strategy by its name in scenario files.
#[derive(Debug, Clone, Copy)]
struct StrategyName(Strategy);

impl ValueEnum for StrategyName {
    fn value_variants<'a>() -> &'a [Self] {
        const {
            &[
                Self(Strategy::Rfs),
                Self(Strategy::Gfs),
                Self(Strategy::Uts),
                Self(Strategy::UtsWide),
                Self(Strategy::Exact),
                Self(Strategy::Tour),
                Self(Strategy::RoundRobin),
                Self(Strategy::MaxAgeFirst),
                Self(Strategy::Horizon),
                Self(Strategy::Offline),
            ]
        }
    }

    fn to_possible_value(&self) -> Option<clap::builder::PossibleValue> {
        Some(clap::builder::PossibleValue::new(self.0.name()))
    }
}

fn shard(text: &str) -> Result<(usize, usize), String> {
    let parts = text.split_once('/').and_then(|(k, n)| Some((k.parse().ok()?, n.parse().ok()?)));
    parts.filter(|(k, n)| (1..=*n).contains(k)).ok_or_else(|| "expected k/n with k from 1 to n".to_owned())
}

/// Runs the command line of this process.
#[must_use]
pub fn main() -> ExitCode {
    worker::quiet_iceoryx2();
    let stop = Stop::on_signals();
    match command(Cli::parse().command, &stop) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("skysink: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}

fn command(command: Command, stop: &Stop) -> Result<(), Error> {
    let (folder, summary) = match command {
        Command::Check { scenario } => return check(&scenario),
        Command::Sweep { sweep, out, threads, shard } => {
            let plan = Sweep::read(&sweep)?;
            let name = sweep.file_stem().unwrap_or(sweep.as_os_str());
            let out = out.unwrap_or_else(|| Path::new("runs").join(name));
            let rows = sweep::sweep(&plan, &out, shard, threads, stop)?;
            println!("{} missions: {}", rows.len(), out.join("results.csv").display());
            return Ok(());
        }
        Command::Figures { only, quick, runs, horizon_iterations, out, threads } => {
            let runs = if quick { QUICK_RUNS } else { runs };
            let out = out.unwrap_or_else(|| Path::new("runs").join(format!("figures-{runs}")));
            let choice = campaign::Choice { only, runs, horizon_iterations, threads, out };
            let stems = campaign::draw(&choice, stop)?;
            stems.iter().for_each(|stem| println!("{}.svg, .png", stem.display()));
            println!("Tables: {}", choice.out.join("tables.md").display());
            return Ok(());
        }
        Command::Merge { shards, out } => {
            let rows = sweep::merge(&shards, &out)?;
            println!("{} missions: {}", rows.len(), out.join("results.csv").display());
            return Ok(());
        }
        Command::Simulate { scenario, choice, record } => {
            let scenario = Scenario::read(&scenario, choice.overrides())?;
            simulate(&Simulation { scenario, out: choice.flight.out, force: choice.flight.force, record }, stop)?
        }
        Command::Run(options) => run(&options.run()?, stop)?,
        Command::Optimize(options) => options.optimize(stop)?,
        Command::Soak(options) => return options.soak(stop),
        Command::Bench(options) => return options.bench(stop),
        Command::Hop(options) => return options.hop(stop),
    };
    report::print(&folder, &summary);
    Ok(())
}

fn check(path: &Path) -> Result<(), Error> {
    let scenario = Scenario::read(path, Overrides::default())?;
    let list = SensorList::of(&scenario)?;
    println!("# {}: {} sensor nodes", path.display(), list.sensors().len());
    print!("{}", scenario.to_toml());
    Ok(())
}
