//! `skysink run` and `skysink soak`: arguments.

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
use crate::run::options::{RunOptions, parse_seconds};
use crate::simulate::{Simulation, simulate};
use crate::soak::anywhere::KillAnywhere;
use crate::soak::soak;

/// Arguments of `skysink run`.
#[derive(Debug, Args)]
pub struct RunArguments {
    /// Scenario file [default: the paper's mission].
    scenario: Option<PathBuf>,
    #[command(flatten)]
    choice: Choice,
    /// Resume the interrupted run in this folder.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["scenario", "strategy", "seed", "keys", "out", "force"])]
    resume: Option<PathBuf>,
    #[command(flatten)]
    options: RunOptions,
    /// How the results are printed.
    #[command(flatten)]
    pub form: OutputForm,
}

impl RunArguments {
    /// Reads the scenario and returns the run.
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
    /// Scenario file [default: the paper's field].
    scenario: Option<PathBuf>,
    #[command(flatten)]
    choice: Choice,
    /// Number of slots, overrides the scenario [default: 1000000, with --anywhere 2000].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    slots: Option<u64>,
    /// Mean time between kills in the first half of the mission [s]; no process is killed in the second half.
    #[arg(long, value_name = "SECONDS", default_value = "0.1", value_parser = parse_seconds)]
    kill_every: f64,
    /// Run the viewer process, too.
    #[arg(long)]
    viewer: bool,
    /// Fly many short missions and kill any process, including the launcher, at any time, including start-up and
    /// shutdown.
    #[arg(long, conflicts_with = "kill_every")]
    anywhere: bool,
    /// Number of missions with --anywhere.
    #[arg(long, value_name = "N", default_value_t = 100, requires = "anywhere")]
    missions: u64,
    /// Maximum number of kills per mission with --anywhere.
    #[arg(long, value_name = "N", default_value_t = 10, requires = "anywhere")]
    kills: u32,
}

impl SoakArguments {
    /// Flies the missions and prints the result.
    ///
    /// # Errors
    /// Those of the run. [`Error::Soak`] if the trace differs from that of the undisturbed mission, or a process leaks
    /// memory or file descriptors.
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
            let (undisturbed, _) = simulate(&simulation, &list, mission, stop)?;
            let Self { missions, kills, viewer, .. } = self;
            return KillAnywhere { undisturbed, missions, kills, seed, viewer }.fly(stop);
        }
        let options = RunOptions { no_viewer: !self.viewer, ..RunOptions::default() };
        let run = Run { scenario, folder: self.choice.folder, resume: None, options };
        soak(&run, Duration::from_secs_f64(self.kill_every), stop)
    }
}
