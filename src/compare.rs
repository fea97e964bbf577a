//! `skysink compare`: compares missions in tables and in one recording.

mod contenders;
mod folder;
#[cfg(feature = "viewer")]
mod recording;
mod standings;

use std::path::{Path, PathBuf};

use clap::Args;
use skysink_common::scenario::Overrides;
use skysink_common::stop::Stop;
use skysink_lab::compare::{Contender, standings};
use skysink_lab::metrics::Metric;
use skysink_mission::files::write_whole;
use skysink_planner::strategies::names;
use skysink_planner::strategy::Registered;

use crate::error::Error;
use crate::options::Changes;
use crate::report::{print, warn_of_few};
use contenders::{ComparedStrategies, ShownContender, differing_keys, read_runs};
use folder::{RECORDING, STANDINGS};

/// Default number of missions per strategy.
const SEEDS: u64 = 20;

/// Compare strategies on the same fields, or finished runs: a table and a recording with all side by side.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  skysink compare scenarios/sparse.toml uts horizon
  skysink compare scenarios/letter.toml gfs uts exact --seeds 100 --no-record
  skysink compare runs/letter-uts-1 runs/letter-gfs-1")]
pub struct CompareCommand {
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
    /// Show p-values of the differences, adjusted for their number by Holm's method, instead of their intervals.
    #[arg(long)]
    holm: bool,
    /// Print all metrics as JSON instead of the table.
    #[arg(long)]
    json: bool,
}

impl CompareCommand {
    /// Simulates missing missions, prints the standings, and writes a recording.
    ///
    /// # Errors
    /// If an input is refused, a file cannot be written, or on a stop.
    pub fn run(self, stop: &Stop) -> Result<(), Error> {
        if self.what[0].is_dir() { self.compare_runs(stop) } else { self.compare_strategies(stop) }
    }

    /// Compares finished runs.
    fn compare_runs(&self, stop: &Stop) -> Result<(), Error> {
        if self.seeds.is_some() || self.changes.overrides() != Overrides::default() {
            let message =
                "--seeds, --seed, --set: expected none of them with run folders, whose missions are already flown";
            return Err(Error::Usage(message.to_owned()));
        }
        if self.what.len() < 2 {
            let message = format!("{}: expected the folders of two runs or more", self.what[0].display());
            return Err(Error::Usage(message));
        }
        let shown = read_runs(&self.what, stop)?;
        let folder = folder::make_for_runs(&self.what, self.out.as_deref())?;
        self.write(&shown, &differing_keys(&shown), folder.path(), stop)
    }

    /// Compares strategies over the fields of a scenario.
    fn compare_strategies(&self, stop: &Stop) -> Result<(), Error> {
        let strategies = self.what[1..].iter().map(|name| find_strategy(name)).collect::<Result<Vec<_>, _>>()?;
        if strategies.len() < 2 {
            let expected = "expected a scenario file with two strategies or more behind it, or folders of runs";
            let message = format!("{}: {expected}", self.what[0].display());
            return Err(Error::Usage(message));
        }
        let compared = ComparedStrategies {
            scenario: self.what[0].clone(),
            overrides: self.changes.overrides(),
            strategies,
            seeds: self.seeds.unwrap_or(SEEDS),
        };
        let sweep = compared.sweep()?;
        let out = self.out.clone().unwrap_or_else(|| folder::of_strategies(&sweep, &compared.scenario));
        let shown = compared.contenders(&sweep, &out, stop)?;
        self.write(&shown, &[], &out, stop)
    }

    /// Writes the standings and the recording into the folder `out`, and prints the keys that differ and the standings.
    fn write(
        &self,
        shown: &[ShownContender],
        differing: &[(String, Vec<String>)],
        out: &Path,
        stop: &Stop,
    ) -> Result<(), Error> {
        let contenders: Vec<Contender> = shown.iter().map(|shown| shown.contender.clone()).collect();
        let standings = standings(&contenders);
        let text = serde_json::to_string_pretty(&standings).expect("plain numbers and strings");
        write_whole(&out.join(STANDINGS), (text.clone() + "\n").as_bytes())?;
        let is_recorded = !self.no_record && cfg!(feature = "viewer");
        #[cfg(feature = "viewer")]
        if is_recorded {
            recording::record(shown, &out.join(RECORDING), stop)?;
        }
        let loss_rates = standings.iter().filter(|standing| standing.metric == Metric::LossRate.name());
        let few = loss_rates.filter(|standing| standing.n > 1 && standing.concentration.is_few());
        warn_of_few(few.map(|standing| (standing.label.clone(), standing.concentration)));
        if self.json {
            return print(text);
        }
        for (key, values) in differing {
            print(format_args!("{key}: {}", values.join(" | ")))?;
        }
        standings::print_tables(&contenders, &standings, self.holm)?;
        print(format_args!("All metrics:     {}", out.join(STANDINGS).display()))?;
        if is_recorded {
            print(format_args!("Open recording:  skysink view {}", out.join(RECORDING).display()))?;
        }
        Ok(())
    }
}

/// Finds the strategy of this name.
fn find_strategy(name: &Path) -> Result<&'static Registered, Error> {
    let name = name.to_string_lossy();
    Registered::find(&name).ok_or_else(|| {
        Error::Usage(format!("strategy {name}: expected one of {} (or the folders of runs alone)", names().join(", ")))
    })
}
