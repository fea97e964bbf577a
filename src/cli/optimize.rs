//! `skysink optimize`: arguments and printed results.

use clap::Args;
use indicatif::HumanCount;
use skysink_common::scenario::Overrides;
use skysink_common::stop::Stop;
use skysink_lab::optimize::{BestKnown, Budget, SearchEnd, Standing, optimize};
use skysink_mission::record::RunFolder;
use skysink_planner::strategies::STRATEGIES;
use skysink_planner::strategy::Registered;

use crate::error::{Error, ended_early};
use crate::options::{Changes, NewFolder, RecordingOptions, ScenarioFile};
use crate::report::{OutputForm, TerminalProgress, print, print_run, table, with_numbers_from};
use crate::simulate::simulate;
use crate::unflown::warn_of_flights;
use skysink_mission::numbers::figure;

/// Search for the best flight by planner.objective and compare all strategies with it.
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
        let mission = found.mission()?;
        let (folder, summary) = simulate(&found.scenario, &found.list, mission, &folder, recording.every(), stop)?;
        folder.write_json("optimum.json", &found.optimum)?;
        warn_of_flights(&found.unflown);
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
    // The last of the first three that the flights have is what they are compared by.
    let columns = [
        ("η", true),
        ("η_w", best.weighted_loss_rate.is_some()),
        ("objective", best.objective.is_some()),
        ("score", best.score.is_some()),
    ];
    let names = columns.iter().filter(|(_, is_shown)| *is_shown).map(|(name, _)| *name);
    table.set_header([""].into_iter().chain(names).chain(["relative to best"]));
    let mut row = |name: &str, numbers: [Option<f64>; 4]| {
        let shown = || numbers.iter().zip(columns).filter(|(_, (_, is_shown))| *is_shown).map(|(number, _)| *number);
        let text = |number: Option<f64>| number.map_or_else(String::new, figure);
        let compared = numbers[..3].iter().zip(columns).rfind(|(_, (_, is_shown))| *is_shown);
        let ratio = compared.and_then(|(number, _)| *number).map(|number| number / best.compared());
        let ratio = ratio.filter(|ratio| ratio.is_finite());
        let cells = shown().map(text).chain([ratio.map_or_else(String::new, |ratio| format!("{ratio:.3}"))]);
        table.add_row([name.to_owned()].into_iter().chain(cells));
    };
    let bound = if optimum.score_bound.is_some() { "bound" } else { "lower bound" }; // that of a score is an upper one
    row(bound, [Some(optimum.loss_bound), None, optimum.objective_bound, optimum.score_bound]);
    if let Some(expected) = optimum.expected_loss_bound {
        row("expected lower bound", [Some(expected), None, None, None]);
    }
    row("best known", numbers_of(&best));
    for standing in &optimum.strategies {
        row(standing.strategy, numbers_of(standing));
    }
    print(with_numbers_from(1, table))?;
    let done = HumanCount(optimum.steps_done);
    let budget = HumanCount(optimum.steps);
    let took = format!("{:.2} s", found.took.as_secs_f64());
    let searched = match optimum.search_end {
        SearchEnd::AllSteps => format!("Searched {done} steps in {took}, the whole budget."),
        SearchEnd::Optimal => {
            let reason = match optimum.objective_bound.unwrap_or(optimum.loss_bound) {
                0.0 if optimum.objective_bound.is_none() => "the plan loses nothing",
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

/// The loss rate, the weighted one, the cost and the score of a strategy.
fn numbers_of(standing: &Standing) -> [Option<f64>; 4] {
    [Some(standing.loss_rate), standing.weighted_loss_rate, standing.objective, standing.score]
}
