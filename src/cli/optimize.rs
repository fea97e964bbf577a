//! `skysink optimize`: arguments.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::stop::Stop;
use skysink_lab::optimize::{Budget, optimize};
use skysink_mission::record::RunFolder;
use skysink_planner::settings;
use skysink_planner::strategies::STRATEGIES;
use skysink_planner::strategies::offline::MAX_STEPS;
use skysink_planner::strategy::Registered;

use crate::error::{Error, ended_early};
use crate::options::{Changes, NewFolder, RecordingOptions};
use crate::report::{OutputForm, TerminalProgress, print_optimum, print_run};
use crate::simulate::{Simulation, simulate};

/// Search for the flight with the least data loss and compare all strategies with it.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  skysink optimize scenarios/sparse.toml --budget 60s
  skysink optimize scenarios/letter.toml --seed 3 --steps 5000000 --record

The result is the best known flight, not a proven optimum; the command also
prints a lower bound on the loss of any flight. The same --steps find the same
flight on every machine; --budget is converted to steps by a short trial.")]
pub struct OptimizeCommand {
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

impl OptimizeCommand {
    /// Searches, flies the best known flight, and prints the comparison with all strategies.
    ///
    /// # Errors
    /// If the scenario is refused, something cannot be written, or on a stop.
    pub fn run(self, stop: &Stop) -> Result<(), Error> {
        let scenario_of = |strategy: &Registered| {
            let overrides = Overrides { strategy: Some(strategy.name), ..self.changes.overrides() };
            Scenario::read(&self.scenario, overrides).and_then(settings::resolve)
        };
        let scenarios = STRATEGIES.iter().copied().map(scenario_of).collect::<Result<Vec<_>, _>>()?;
        let Self { budget, steps, folder, recording, form, .. } = self;
        RunFolder::check(folder.out.as_deref(), folder.earlier())?;
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
