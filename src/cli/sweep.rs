//! `skysink sweep`: arguments and printed results.

use std::path::{Path, PathBuf};

use clap::Args;
use skysink_common::stop::Stop;
use skysink_common::terminal::shell_path;
use skysink_lab::sweep::estimate::estimate;
use skysink_lab::sweep::manifest::Manifest;
use skysink_lab::sweep::plan::Sweep;
use skysink_lab::sweep::results::few;
use skysink_lab::sweep::settings::{Seeds, SweepChanges};
use skysink_lab::sweep::shard::Shard;
use skysink_lab::sweep::sweep;
use skysink_lab::unflown::UnflownFlights;

use crate::error::{Error, ended_early, flown_in};
use crate::report::{TerminalProgress, print, warn_of_few};
use crate::unflown::warn_of_flights;

/// Simulate a grid of scenarios with several strategies and seeds. Running the command again resumes the sweep, or
/// extends it by more seeds and strategies.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  skysink sweep scenarios/sweeps/letter.toml
  skysink sweep scenarios/sweeps/letter.toml --seeds 300    flies what is missing
  skysink sweep runs/letter --out again               repeats the sweep in a folder
  skysink sweep area.toml --out area-1 --shard 1/2    on one machine,
  skysink sweep area.toml --out area-2 --shard 2/2    on another; then
  skysink merge area-1 area-2 --out area              merges the two
  skysink sweep area.toml --out area-$SLURM_ARRAY_TASK_ID \\
    --shard $SLURM_ARRAY_TASK_ID/100                  in a job array")]
pub struct SweepCommand {
    /// Sweep file: scenario, strategies, seeds and axes, as in docs/src/sweep.md. Or the folder of a sweep, which is
    /// repeated.
    #[arg(value_name = "SWEEP")]
    sweep: PathBuf,
    /// Strategies in place of the file's; to extend a sweep, its own come first.
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    strategies: Option<Vec<String>>,
    /// Seeds in place of the file's: 1 to N, or a list.
    #[arg(long, value_name = "N | SEED,...", value_delimiter = ',')]
    seeds: Option<Vec<u64>>,
    /// Output folder; a sweep in it is resumed or extended [default: runs/NAME, named like the sweep file, or the
    /// folder SWEEP].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Missions simulated in parallel [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
    /// Simulate only shard K of N; all strategies of one grid point and seed stay in one shard. In a job array K is its
    /// index, from 1. [default: all; with a folder SWEEP and no --out, its own]
    #[arg(long, value_name = "K/N", value_parser = parse_shard)]
    shard: Option<Shard>,
    /// Print the number of missions and the estimated time, and simulate none.
    #[arg(long, conflicts_with_all = ["out", "threads", "shard"])]
    plan: bool,
}

impl SweepCommand {
    /// Simulates the missions, or prints their number and estimated time.
    pub fn run(self, stop: &Stop) -> Result<(), Error> {
        let seeds =
            self.seeds.map(|seeds| if let [count] = seeds[..] { Seeds::Count(count) } else { Seeds::List(seeds) });
        let plan = Sweep::read(
            &self.sweep,
            Vec::new(),
            SweepChanges { strategies: self.strategies, seeds, ..SweepChanges::default() },
        )?;
        if self.plan {
            return print_plan(&plan, stop);
        }
        let is_in_place = self.sweep.is_dir() && self.out.is_none();
        let own = if is_in_place { Manifest::read("sweep", &self.sweep)?.map(|manifest| manifest.shard) } else { None };
        let shard = self.shard.or(own).unwrap_or(Shard::WHOLE);
        let out = self.out.unwrap_or_else(|| {
            let name = self.sweep.file_stem().unwrap_or(self.sweep.as_os_str());
            if is_in_place { self.sweep.clone() } else { Path::new("runs").join(name) }
        });
        let journal = sweep(&plan, &out, shard, self.threads, stop, &TerminalProgress::of_missions());
        let journal = journal.map_err(|error| ended_early(error, &flown_in(&out)))?;
        let count = journal.count();
        if count == 0 {
            let fields = plan.definition.fields();
            return print(format_args!("No missions: shard {shard} is beyond the {fields} fields"));
        }
        print(format_args!("{count} missions: {}", out.join("results.csv").display()))?;
        warn_of_flights(&UnflownFlights::of_sweep(&plan, &journal.rows)?);
        if shard != Shard::WHOLE {
            return print("Merge all shards: skysink merge SHARD... --out DIR");
        }
        print(format_args!("Means: {}", out.join("summary.csv").display()))?;
        warn_of_few(few(&journal).into_iter());
        print(format_args!("Draw them: skysink plot {} --x KEY", shell_path(&out)))
    }
}

/// Prints the size of a sweep and its estimated time.
fn print_plan(sweep: &Sweep, stop: &Stop) -> Result<(), Error> {
    let mission_s = estimate(sweep, stop).map_err(|error| ended_early(error, "nothing was flown"))?;
    let definition = &sweep.definition;
    let [points, seeds, fields] = [definition.points.len(), definition.seeds.len(), definition.fields()];
    print(format_args!("Points:    {points}, with {seeds} seeds: {fields} fields"))?;
    print(format_args!("Missions:  {}, of {} strategies", definition.mission_count(), mission_s.len()))?;
    for (name, each_s) in definition.strategies.iter().zip(&mission_s) {
        print(format_args!("  {name:<20} {each_s:>12.4} s each"))?;
    }
    let cpu_s: f64 = mission_s.iter().map(|each_s| each_s * fields as f64).sum();
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    print(format_args!(
        "Time:      about {cpu_s:.1} s of one core as busy as now, {:.1} s on {cores} cores",
        cpu_s / cores as f64
    ))
}

/// Parses `K/N`.
fn parse_shard(text: &str) -> Result<Shard, String> {
    let shard = text.split_once('/').and_then(|(k, n)| Shard::new(k.parse().ok()?, n.parse().ok()?));
    let expected = "expected k/n with k from 1 to n; in a job array k is its index, such as $SLURM_ARRAY_TASK_ID";
    shard.ok_or_else(|| expected.to_owned())
}
