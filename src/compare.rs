//! `skysink compare`: compares missions in tables and in one recording.

mod contenders;
mod folder;
#[cfg(feature = "viewer")]
mod recording;
mod standings;

use std::path::{Path, PathBuf};

use clap::Args;
use skysink_common::error::{InputError, did_you_mean};
use skysink_common::scenario::Overrides;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_common::terminal::shell_path;
use skysink_lab::compare::{Contender, standings};
use skysink_lab::sweep::folder::remove_comparison;
use skysink_lab::sweep::manifest::{RECORDING, STANDINGS};
use skysink_lab::sweep::plan::Sweep;
use skysink_lab::sweep::settings::{Seeds, SweepChanges};
use skysink_mission::files::write_whole;
use skysink_mission::folder::Earlier;
use skysink_mission::metrics::Metric;
use skysink_planner::settings::Settings;
use skysink_planner::strategies::names;
use skysink_planner::strategy::Registered;

use crate::check::shortfalls;
use crate::error::Error;
use crate::options::Changes;
use crate::report::{print, warn_of_few};
use crate::unflown::warn_of_flights;
use contenders::{ShownContender, differing_keys, fly_contenders, read_runs, sweep_of};
use folder::compared_runs;

/// Default number of missions per strategy.
const SEEDS: u64 = 20;

/// Compare strategies on the same fields, or finished runs: a table and a recording with all side by side.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  skysink compare scenarios/sparse.toml uts horizon
  skysink compare scenarios/letter.toml gfs uts exact --seeds 100 --no-record
  skysink compare runs/letter-uts-1 runs/letter-gfs-1
  skysink compare runs/compare-sparse-uts-horizon-20-1234abcd --out again")]
pub struct CompareCommand {
    /// A scenario file followed by two or more strategies, or two or more run folders, or the folder of a comparison,
    /// which is repeated.
    #[arg(required = true, num_args = 1.., value_name = "SCENARIO STRATEGY | RUN | COMPARISON")]
    what: Vec<PathBuf>,
    /// Missions per strategy, with consecutive seeds starting at the scenario's [default: 20].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    seeds: Option<u64>,
    #[command(flatten)]
    changes: Changes,
    /// Output folder; a comparison in it is resumed, or extended by seeds and strategies [default:
    /// runs/compare-NAMES-IDENTITY, or COMPARISON].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace another finished comparison in the folder --out.
    #[arg(long, requires = "out")]
    force: bool,
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
    pub fn run(self, stop: &Stop) -> Result<(), Error> {
        match &self.what[..] {
            [folder] if folder.is_dir() => self.repeat(folder, stop),
            [folder, ..] if folder.is_dir() => self.compare_runs(&self.what, self.out.as_deref(), stop),
            _ => self.compare_strategies(stop),
        }
    }

    /// Repeats the comparison in a folder, there or in the output folder, or extends it by seeds.
    fn repeat(&self, folder: &Path, stop: &Stop) -> Result<(), Error> {
        let out = self.out.as_deref().unwrap_or(folder);
        if let Some(runs) = compared_runs(folder)? {
            return self.compare_runs(&runs, Some(out), stop);
        }
        if !folder.join("sweep.json").is_file() {
            let message = format!("{}: expected the folders of two runs or more, or of a comparison", folder.display());
            return Err(Error::Usage(message));
        }
        if self.changes.overrides() != Overrides::default() {
            let message =
                "--seed, --set: expected none of them with the folder of a comparison, which has its scenario";
            return Err(Error::Usage(message.to_owned()));
        }
        let read = |changes| Sweep::read(folder, Vec::new(), changes);
        let mut sweep = read(SweepChanges::default())?;
        if sweep.definition.points.len() > 1 {
            let message = "it is a sweep of several points: expected the folder of a comparison, of one scenario";
            return Err(InputError::new("comparison", folder, message).into());
        }
        if let Some(count) = self.seeds {
            let seeds = (sweep.definition.seeds[0]..).take(count as usize).collect();
            sweep = read(SweepChanges { seeds: Some(Seeds::List(seeds)), ..SweepChanges::default() })?;
        }
        self.write(&fly_contenders(&sweep, out, stop)?, &[], out, stop)
    }

    /// Compares finished runs.
    fn compare_runs(&self, runs: &[PathBuf], out: Option<&Path>, stop: &Stop) -> Result<(), Error> {
        if self.seeds.is_some() || self.changes.overrides() != Overrides::default() {
            let message =
                "--seeds, --seed, --set: expected none of them with run folders, whose missions are already flown";
            return Err(Error::Usage(message.to_owned()));
        }
        let shown = read_runs(runs, stop)?;
        let folder = folder::make_for_runs(runs, out, Earlier::by_force(self.force))?;
        self.write(&shown, &differing_keys(&shown), folder.path(), stop)
    }

    /// Compares strategies over the fields of a scenario.
    fn compare_strategies(&self, stop: &Stop) -> Result<(), Error> {
        let scenario = &self.what[0];
        let strategies = self.what[1..].iter().map(|name| find_strategy(name)).collect::<Result<Vec<_>, _>>()?;
        if strategies.len() < 2 {
            let expected = "expected a scenario file with two strategies or more behind it, or folders of runs";
            return Err(Error::Usage(format!("{}: {expected}", scenario.display())));
        }
        let sweep = sweep_of(scenario, self.changes.overrides(), strategies, self.seeds.unwrap_or(SEEDS))?;
        if let Some(out) = self.out.as_ref().filter(|_| self.force) {
            remove_comparison(out, &sweep)?;
        }
        let out = self.out.clone().unwrap_or_else(|| folder::of_strategies(&sweep, scenario));
        self.write(&fly_contenders(&sweep, &out, stop)?, &[], &out, stop)
    }

    /// Writes the standings and the recording into the folder `out`, and prints the keys that differ and the standings.
    #[cfg_attr(not(feature = "viewer"), expect(unused_variables, reason = "`stop` ends the recording"))]
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
        let few = loss_rates.filter(|standing| standing.concentration.is_few());
        warn_of_few(few.map(|standing| (standing.label.clone(), standing.concentration)));
        let unflown = shown.iter().filter_map(|shown| shown.contender.unflown(&shown.scenario));
        warn_of_flights(&unflown.collect::<Vec<_>>());
        if self.json {
            return print(text);
        }
        for (key, values) in differing {
            print(format_args!("{key}: {}", values.join(" | ")))?;
        }
        let mut ignored = Vec::new();
        let flown: Vec<&str> = shown.iter().map(|one| one.scenario.planner.strategy.as_str()).collect();
        for one in shown {
            ignored.extend(shortfalls::of(&one.scenario, &SensorList::of(&one.scenario)?, &flown));
        }
        ignored.sort_unstable();
        ignored.dedup();
        ignored.into_iter().try_for_each(|sentence| print(format_args!("Planned: {sentence}.")))?;
        let objectives = shown.iter().map(|one| Ok(Settings::of(&one.scenario)?.objective));
        let objectives = objectives.collect::<Result<Vec<_>, InputError>>()?;
        let for_costs = objectives.windows(2).all(|pair| pair[0] == pair[1]) && !objectives[0].is_loss();
        standings::print_tables(&contenders, &standings, for_costs, self.holm)?;
        print(format_args!("All metrics:     {}", out.join(STANDINGS).display()))?;
        if is_recorded {
            print(format_args!("Open recording:  skysink view {}", shell_path(&out.join(RECORDING))))?;
        }
        Ok(())
    }
}

/// The name of a strategy, which is one of the registry.
fn find_strategy(name: &Path) -> Result<String, Error> {
    let name = name.to_string_lossy();
    Registered::find(&name).map(|strategy| strategy.name.to_owned()).ok_or_else(|| {
        let meant = did_you_mean(&name, names().iter().copied());
        let meant = meant.map(|meant| format!("; did you mean `{meant}`?")).unwrap_or_default();
        let expected = format!("expected one of {} (or the folders of runs alone)", names().join(", "));
        Error::Usage(format!("strategy {name}: {expected}{meant}"))
    })
}
