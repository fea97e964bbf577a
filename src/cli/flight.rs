//! The arguments of `skysink run` and `skysink soak`.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::Mission;
use skysink_planner::settings;

use super::Choice;
use crate::error::Error;
use crate::report::OutputForm;
use crate::run::Run;
use crate::run::options::{RunOptions, seconds};
use crate::simulate::{Simulation, simulate};
use crate::soak::anywhere::Anywhere;
use crate::soak::soak;

/// Arguments of `skysink run`.
#[derive(Debug, Args)]
pub struct RunArguments {
    /// Scenario file; the paper's mission if left out.
    scenario: Option<PathBuf>,
    #[command(flatten)]
    choice: Choice,
    /// Resume a run that has ended early, in its folder.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["scenario", "strategy", "seed", "keys", "out", "force"])]
    resume: Option<PathBuf>,
    #[command(flatten)]
    options: RunOptions,
    /// How its figures are printed.
    #[command(flatten)]
    pub form: OutputForm,
}

impl RunArguments {
    /// What to run.
    ///
    /// # Errors
    /// If the scenario is refused.
    pub fn run(self) -> Result<Run, Error> {
        let scenario = match (&self.resume, &self.scenario) {
            (Some(folder), _) => Scenario::read(&folder.join("scenario.toml"), Overrides::default()),
            (None, Some(path)) => Scenario::read(path, self.choice.overrides()),
            (None, None) => Scenario::letter(self.choice.overrides()),
        };
        let scenario = settings::resolve(scenario?)?;
        Ok(Run { scenario, folder: self.choice.folder, resume: self.resume, options: self.options })
    }
}

/// Arguments of `skysink soak`.
#[derive(Debug, Args)]
pub struct SoakArguments {
    /// Scenario file; the paper's field if left out.
    scenario: Option<PathBuf>,
    #[command(flatten)]
    choice: Choice,
    /// Slots to fly, instead of the scenario's [default: 1000000; with --anywhere 2000].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    slots: Option<u64>,
    /// Mean time between two kills [s] in the first half of the mission; the second half is calm.
    #[arg(long, value_name = "SECONDS", default_value = "0.1", value_parser = seconds)]
    kill_every: f64,
    /// Include the viewer.
    #[arg(long)]
    viewer: bool,
    /// Fly many short missions instead, and kill any process, the launcher included, at any instant: while they start,
    /// in between, and at their end.
    #[arg(long, conflicts_with = "kill_every")]
    anywhere: bool,
    /// Number of missions.
    #[arg(long, value_name = "N", default_value_t = 100, requires = "anywhere")]
    missions: u64,
    /// Kills in each mission; those that would come after its end are left out.
    #[arg(long, value_name = "N", default_value_t = 10, requires = "anywhere")]
    kills: u32,
}

impl SoakArguments {
    /// Flies it, and prints what became of it.
    ///
    /// # Errors
    /// As the run, or if the trace is not that of the undisturbed mission, or something has grown.
    pub fn soak(self, stop: &Stop) -> Result<(), Error> {
        let slots = self.slots.unwrap_or(if self.anywhere { 2000 } else { 1_000_000 });
        let overrides = Overrides { slots: Some(slots), ..self.choice.overrides() };
        let scenario = match &self.scenario {
            Some(path) => Scenario::read(path, overrides).and_then(settings::resolve)?,
            None => Scenario::letter(overrides).and_then(settings::resolve)?,
        };
        if self.anywhere {
            let list = SensorList::of(&scenario)?;
            let mission = Mission::new(&scenario, &list)?;
            let seed = scenario.seed;
            let simulation = Simulation { scenario, folder: self.choice.folder, record: None };
            let (alone, _) = simulate(&simulation, &list, mission, stop)?;
            let Self { missions, kills, viewer, .. } = self;
            return Anywhere { alone, missions, kills, seed, viewer }.fly(stop);
        }
        let options = RunOptions { no_viewer: !self.viewer, ..RunOptions::default() };
        let run = Run { scenario, folder: self.choice.folder, resume: None, options };
        soak(&run, Duration::from_secs_f64(self.kill_every), stop)
    }
}
