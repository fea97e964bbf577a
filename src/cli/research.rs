//! The research commands: sweep, merge, figures, plot, optimize, compare.

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::{Args, Subcommand};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::stop::Stop;
use skysink_lab::figures;
use skysink_lab::figures::choice::{Choice, FigurePart, HORIZON_ITERATIONS};
use skysink_lab::optimize::{Budget, MAX_STEPS, optimize};
use skysink_lab::sweep;
use skysink_lab::sweep::estimate::{SweepEstimate, estimate};
use skysink_lab::sweep::merge::{Completeness, merge};
use skysink_lab::sweep::plan::{Shard, Sweep};
use skysink_mission::record::RunFolder;
use skysink_planner::settings;
use skysink_planner::strategies::{Registered, STRATEGIES, names};

use super::plot::{self, PlotOptions};
use super::{Changes, job_array};
use crate::compare::{Compare, Compared, compare};
use crate::error::{Error, ended_early, flown_in};
use crate::report::{OutputForm, TerminalProgress, print, print_optimum, print_run};
use crate::simulate::{NewFolder, RecordingOptions, Simulation, simulate};

/// The research commands.
#[derive(Debug, Subcommand)]
pub enum Research {
    /// Simulate a grid of scenarios with several strategies and seeds. Running the command again resumes the sweep.
    #[command(after_help = "\
Examples:
  skysink sweep scenarios/sweeps/letter.toml
  skysink sweep area.toml --out area-1 --shard 1/2    on one machine,
  skysink sweep area.toml --out area-2 --shard 2/2    on another; then
  skysink merge area-1 area-2 --out area              merges the two
  skysink sweep area.toml --out area-$SLURM_ARRAY_TASK_ID --shard auto
                                                      in a job array")]
    Sweep {
        /// Sweep file: scenario, strategies, seeds and axes, as in docs/src/sweep.md.
        sweep: PathBuf,
        /// Output folder; a sweep in it is resumed [default: runs/NAME, named like the sweep file].
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Missions simulated in parallel [default: one per core].
        #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
        threads: usize,
        /// Simulate only shard K of N; all strategies of one grid point and seed stay in one shard. In a job array of
        /// Slurm or Grid Engine with indices from 1: auto; in any job array: auto/N.
        #[arg(long, value_name = "K/N", value_parser = parse_shard, default_value = "1/1")]
        shard: Shard,
        /// Print the number of missions and the estimated time, and simulate none.
        #[arg(long, conflicts_with_all = ["out", "threads", "shard"])]
        plan: bool,
    },
    /// Reproduce the paper's figures: run the sweeps and draw them. Running the command again resumes the sweeps.
    #[command(after_help = "\
Examples:
  skysink figures --quick             few missions, takes minutes
  skysink figures --only area,maps    some of them
  skysink figures --runs 300          the paper's number of missions per point")]
    Figures {
        /// Draw only these figures (repeatable or comma-separated).
        #[arg(long, value_name = "PART", value_enum, value_delimiter = ',')]
        only: Vec<FigurePart>,
        /// Simulate 5 missions per point.
        #[arg(long, conflicts_with = "runs")]
        quick: bool,
        /// Missions per point.
        #[arg(long, value_name = "N", default_value_t = 50, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
        runs: u64,
        /// Output folder; sweeps in it are resumed [default: runs/figures-N].
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Search steps of horizon per slot; the search for the best known flight takes 200 times as many. In sparse
        /// fields, both take four times as many.
        #[arg(long, value_name = "N", default_value_t = HORIZON_ITERATIONS)]
        #[arg(value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
        horizon_iterations: u32,
        /// Missions simulated in parallel [default: one per core].
        #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
        threads: usize,
    },
    /// Plot a metric of a sweep against one of its keys, with confidence intervals and tables.
    #[command(after_help = plot::EXAMPLES)]
    Plot(PlotOptions),
    /// Search for the flight with the least data loss and compare all strategies with it.
    #[command(after_help = "\
Examples:
  skysink optimize scenarios/sparse.toml --budget 60s
  skysink optimize scenarios/letter.toml --seed 3 --steps 5000000 --record

The result is the best known flight, not a proven optimum; the command also
prints a lower bound on the loss of any flight. The same --steps find the same
flight on every machine; --budget is converted to steps by a short trial.")]
    Optimize(OptimizeOptions),
    /// Compare strategies on the same fields, or finished runs: a table and a recording with all side by side.
    #[command(after_help = "\
Examples:
  skysink compare scenarios/sparse.toml uts horizon
  skysink compare scenarios/letter.toml gfs uts exact --seeds 100 --no-record
  skysink compare runs/letter-uts-1 runs/letter-gfs-1")]
    Compare(CompareOptions),
    /// Merge the shards of a sweep.
    #[command(after_help = "\
Examples:
  skysink merge area-1 area-2 --out area
  skysink merge area-shards/* --out area --partial    before all shards are done")]
    Merge {
        /// Output folders of the shards.
        #[arg(required = true)]
        shards: Vec<PathBuf>,
        /// Output folder.
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
        /// Accept missing missions.
        #[arg(long)]
        partial: bool,
    },
}

/// Missions per point of `--quick`.
const QUICK_RUNS: u64 = 5;

impl Research {
    /// Runs the command.
    ///
    /// # Errors
    /// If an input is refused, something cannot be written, or on a stop.
    pub fn run(self, stop: &Stop) -> Result<(), Error> {
        match self {
            Self::Sweep { sweep, plan: true, .. } => print_plan(&Sweep::read(&sweep, Vec::new())?, stop)?,
            Self::Sweep { sweep, out, threads, shard, .. } => {
                let plan = Sweep::read(&sweep, Vec::new())?;
                let name = sweep.file_stem().unwrap_or(sweep.as_os_str());
                let out = out.unwrap_or_else(|| Path::new("runs").join(name));
                let journal = sweep::sweep(&plan, &out, shard, threads, stop, &TerminalProgress::of_missions());
                let count = journal.map_err(|error| ended_early(error, &flown_in(&out)))?.count();
                if count == 0 {
                    let fields = plan.definition.fields();
                    return print(format_args!("No missions: shard {shard} is beyond the {fields} fields"));
                }
                print(format_args!("{count} missions: {}", out.join("results.csv").display()))?;
                if shard == Shard::WHOLE {
                    print(format_args!("Means: {}", out.join("summary.csv").display()))?;
                    print(format_args!("Draw them: skysink plot {} --x KEY", out.display()))?;
                } else {
                    print("Merge all shards: skysink merge SHARD... --out DIR")?;
                }
            }
            Self::Figures { only, quick, runs, horizon_iterations, out, threads } => {
                let runs = if quick { QUICK_RUNS } else { runs };
                let out = out.unwrap_or_else(|| Path::new("runs").join(format!("figures-{runs}")));
                let choice = Choice { only, runs, horizon_iterations, threads, out };
                let stems = figures::draw(&choice, stop, &TerminalProgress::of_missions());
                let stems = stems.map_err(|error| ended_early(error, &flown_in(&choice.out)))?;
                stems.iter().try_for_each(|stem| print(format_args!("{}.svg, .pdf, .png", stem.display())))?;
                print(format_args!("Tables: {}", choice.out.join("tables.md").display()))?;
            }
            Self::Merge { shards, out, partial } => {
                let completeness = if partial { Completeness::Partial } else { Completeness::Whole };
                let merged = merge(&shards, &out, completeness, stop);
                let merged = merged.map_err(|error| ended_early(error, "the shards are unchanged"))?;
                let results = out.join("results.csv");
                print(format_args!("{} missions: {}", merged.journal.count(), results.display()))?;
                match merged.missing {
                    Some(missing) => print(format_args!("Not all: {missing}"))?,
                    None => print(format_args!("Draw them: skysink plot {} --x KEY", out.display()))?,
                }
            }
            Self::Plot(options) => options.plot()?,
            Self::Optimize(options) => options.optimize(stop)?,
            Self::Compare(options) => options.compare(stop)?,
        }
        Ok(())
    }
}

/// Prints the size of a sweep and its estimated time.
fn print_plan(sweep: &Sweep, stop: &Stop) -> Result<(), Error> {
    let estimate = estimate(sweep, stop).map_err(|error| ended_early(error, "nothing was flown"))?;
    let SweepEstimate { missions, cpu_s, mission_s } = &estimate;
    let [points, seeds, fields] =
        [sweep.definition.points.len(), sweep.definition.seeds.len(), sweep.definition.fields()];
    print(format_args!("Points:    {points}, with {seeds} seeds: {fields} fields"))?;
    print(format_args!("Missions:  {missions}, of {} strategies", mission_s.len()))?;
    for (name, each_s) in mission_s {
        print(format_args!("  {name:<20} {each_s:>12.4} s each"))?;
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    print(format_args!("CPU time:  about {cpu_s:.1} s, {:.1} s on {cores} cores", cpu_s / cores as f64))
}

/// Default number of missions per strategy.
const SEEDS: u64 = 20;

/// Options of `skysink compare`.
#[derive(Debug, Args)]
pub struct CompareOptions {
    /// A scenario file followed by two or more strategies, or two or more run folders.
    #[arg(required = true, num_args = 1.., value_name = "SCENARIO STRATEGY | RUN")]
    what: Vec<PathBuf>,
    /// Missions per strategy, with consecutive seeds starting at the scenario's [default: 20].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    seeds: Option<u64>,
    #[command(flatten)]
    changes: Changes,
    /// Output folder [default: runs/compare-NAMES-IDENTITY].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Do not write a recording.
    #[arg(long)]
    no_record: bool,
    /// Print all metrics as JSON instead of the table.
    #[arg(long)]
    json: bool,
}

impl CompareOptions {
    /// Compares the strategies or runs and prints the tables.
    ///
    /// # Errors
    /// If an input is refused, something cannot be written, or on a stop.
    pub fn compare(self, stop: &Stop) -> Result<(), Error> {
        let overrides = self.changes.overrides();
        let what = if self.what[0].is_dir() {
            if self.seeds.is_some() || overrides != Overrides::default() {
                let message =
                    "--seeds, --seed, --set: expected none of them with run folders, whose missions are already flown";
                return Err(Error::Usage(message.to_owned()));
            }
            if self.what.len() < 2 {
                let message = format!("{}: expected the folders of two runs or more", self.what[0].display());
                return Err(Error::Usage(message));
            }
            Compared::Runs(self.what)
        } else {
            let strategies = self.what[1..].iter().map(|name| find_strategy(name)).collect::<Result<Vec<_>, _>>()?;
            if strategies.len() < 2 {
                let expected = "expected a scenario file with two strategies or more behind it, or folders of runs";
                let message = format!("{}: {expected}", self.what[0].display());
                return Err(Error::Usage(message));
            }
            let seeds = self.seeds.unwrap_or(SEEDS);
            Compared::Strategies { scenario: self.what[0].clone(), overrides, strategies, seeds }
        };
        let record = !self.no_record && cfg!(feature = "viewer");
        compare(&Compare { what, out: self.out, record, json: self.json }, stop)
    }
}

/// Finds the strategy of this name.
fn find_strategy(name: &Path) -> Result<&'static Registered, Error> {
    let name = name.to_string_lossy();
    Registered::find(&name).ok_or_else(|| {
        Error::Usage(format!("strategy {name}: expected one of {} (or the folders of runs alone)", names().join(", ")))
    })
}

/// Options of `skysink optimize`.
#[derive(Debug, Args)]
pub struct OptimizeOptions {
    /// Scenario file.
    scenario: PathBuf,
    /// Search time in seconds, or with a unit, for example 500ms, 60s, 5m or 1h.
    #[arg(long, value_name = "TIME", default_value = "10s", value_parser = parse_time)]
    budget: Duration,
    /// Number of search steps; replaces --budget.
    #[arg(long, value_name = "N", conflicts_with = "budget", value_parser = clap::value_parser!(u64).range(..=MAX_STEPS))]
    steps: Option<u64>,
    #[command(flatten)]
    changes: Changes,
    #[command(flatten)]
    folder: NewFolder,
    #[command(flatten)]
    recording: RecordingOptions,
    #[command(flatten)]
    form: OutputForm,
}

impl OptimizeOptions {
    /// Searches, flies the best known flight, and prints the comparison with all strategies.
    ///
    /// # Errors
    /// If the scenario is refused, something cannot be written, or on a stop.
    pub fn optimize(self, stop: &Stop) -> Result<(), Error> {
        let scenario_of = |strategy: &Registered| {
            let overrides = Overrides { strategy: Some(strategy.name), ..self.changes.overrides() };
            Scenario::read(&self.scenario, overrides).and_then(settings::resolve)
        };
        let scenarios = STRATEGIES.into_iter().map(scenario_of).collect::<Result<Vec<_>, _>>()?;
        let Self { budget, steps, folder, recording, form, .. } = self;
        RunFolder::check(folder.out.as_deref(), folder.force)?;
        let budget = steps.map_or(Budget::Time(budget), Budget::Steps);
        let found = optimize(&scenarios, budget, stop, &TerminalProgress::of_steps());
        let left = "nothing was written; run the command again, with a smaller --budget to end earlier";
        let found = found.map_err(|error| ended_early(error, left))?;
        let simulation = Simulation { scenario: found.scenario.clone(), folder, record: recording.every() };
        let (folder, summary) = simulate(&simulation, &found.list, found.mission()?, stop)?;
        folder.write_json("optimum.json", &found.optimum)?;
        form.print(&found.optimum, || {
            print_optimum(&found)?;
            print_run(&folder, &summary)
        })
    }
}

/// Maximum search time [s].
const MAX_BUDGET_S: f64 = 1e6;

/// Parses a time with its unit; without a unit, in seconds.
fn parse_time(text: &str) -> Result<Duration, String> {
    let digits = text.trim_end_matches(|character: char| character.is_ascii_alphabetic());
    let unit_s = match &text[digits.len()..] {
        "ms" => 1e-3,
        "" | "s" => 1.0,
        "m" => 60.0,
        "h" => 3600.0,
        _ => f64::NAN,
    };
    let seconds = digits.parse().map_or(f64::NAN, |number: f64| number * unit_s);
    let is_allowed = seconds > 0.0 && seconds <= MAX_BUDGET_S;
    let expected = "expected a time above 0, such as 500ms, 60s, 5m or 1h, at most 1000000s; steps are --steps N";
    if is_allowed { Ok(Duration::from_secs_f64(seconds)) } else { Err(expected.to_owned()) }
}

/// Parses `K/N`, or `auto` and `auto/N` in a job array.
fn parse_shard(text: &str) -> Result<Shard, String> {
    let variable = |name: &str| std::env::var(name).ok();
    let expected = || "expected k/n with k from 1 to n, auto, or auto/n".to_owned();
    let parsed = |number: &str| number.parse::<usize>().ok().filter(|&number| number > 0).ok_or_else(expected);
    match text.split_once('/') {
        None if text == "auto" => job_array::shard(variable, None),
        None => Err(expected()),
        Some(("auto", n)) => job_array::shard(variable, Some(parsed(n)?)),
        Some((k, n)) => Shard::new(parsed(k)?, parsed(n)?).ok_or_else(expected),
    }
}
