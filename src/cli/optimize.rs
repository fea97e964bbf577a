//! `skysink optimize`: arguments and printed results.

use clap::Args;
use indicatif::HumanCount;
use skysink_common::scenario::Overrides;
use skysink_common::stop::Stop;
use skysink_lab::optimize::{BestKnown, Budget, SearchEnd, optimize};
use skysink_mission::record::RunFolder;
use skysink_planner::strategies::STRATEGIES;
use skysink_planner::strategy::Registered;

use crate::error::{Error, ended_early};
use crate::options::{Changes, NewFolder, RecordingOptions, ScenarioFile};
use crate::report::{OutputForm, TerminalProgress, print, print_run, table, with_numbers_from};
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
    #[command(flatten)]
    scenario: ScenarioFile,
    #[command(flatten)]
    budget: Budget,
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
            self.scenario.read(overrides)
        };
        let scenarios = STRATEGIES.iter().copied().map(scenario_of).collect::<Result<Vec<_>, _>>()?;
        let Self { budget, folder, recording, form, .. } = self;
        RunFolder::check(folder.out.as_deref(), folder.earlier())?;
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

/// Prints the result of a search: the lower bound, the best known loss rate, and that of every strategy.
fn print_optimum(found: &BestKnown) -> Result<(), Error> {
    let optimum = &found.optimum;
    let best = optimum.best_known;
    let mut table = table();
    let is_weighted = best.weighted_loss_rate.is_some();
    let columns: &[&str] =
        if is_weighted { &["", "η", "η_w", "relative to best"] } else { &["", "η", "relative to best"] };
    table.set_header(columns.iter().copied());
    let number = |rate: f64| format!("{rate:.6}");
    let ratio = |rate: Option<f64>| match rate.map(|rate| rate / best.compared()) {
        Some(ratio) if ratio.is_finite() => format!("{ratio:.3}"),
        _ => String::new(),
    };
    let mut row = |name: &str, loss_rate: f64, weighted: Option<f64>| {
        let compared = if is_weighted { weighted } else { Some(loss_rate) };
        let weighted = is_weighted.then(|| weighted.map_or_else(String::new, number));
        table.add_row([name.to_owned(), number(loss_rate)].into_iter().chain(weighted).chain([ratio(compared)]));
    };
    row("lower bound", optimum.loss_bound, None);
    if let Some(expected) = optimum.expected_loss_bound {
        row("expected lower bound", expected, None);
    }
    row("best known", best.loss_rate, best.weighted_loss_rate);
    for standing in &optimum.strategies {
        row(standing.strategy, standing.loss_rate, standing.weighted_loss_rate);
    }
    print(with_numbers_from(1, table))?;
    let done = HumanCount(optimum.steps_done);
    let budget = HumanCount(optimum.steps);
    let took = format!("{:.2} s", found.took.as_secs_f64());
    let searched = match optimum.search_end {
        SearchEnd::AllSteps => format!("Searched {done} steps in {took}, the whole budget."),
        SearchEnd::Optimal => {
            let reason = match optimum.loss_bound {
                0.0 => "the plan loses nothing",
                _ => "the best known flight reaches the lower bound",
            };
            format!("Searched {done} of up to {budget} steps in {took}: {reason}, so it is optimal.")
        }
        SearchEnd::ModelOptimal => {
            let reason = "the plan is optimal in the search model (fractional bits, expected rates)";
            format!("Searched {done} of up to {budget} steps in {took}: {reason}.")
        }
        SearchEnd::NothingInReach => {
            "Nothing to search: no sensor node that can lose data can be reached in time.".to_owned()
        }
    };
    print(format_args!("{searched} Repeat the search with --steps {}.", optimum.steps))
}
