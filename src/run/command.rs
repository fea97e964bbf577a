//! `skysink run`: arguments.

use std::path::PathBuf;

use clap::Args;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::stop::Stop;
use skysink_planner::settings;

use super::options::RunOptions;
use super::{Run, run};
use crate::error::Error;
use crate::options::MissionOptions;
use crate::report::{OutputForm, print_run};

/// Fly a mission as a ring of processes over shared memory, and record it.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  skysink run                          the paper's mission, unpaced
  skysink run --pace realtime --live   watch it with
                                       rerun rerun+http://127.0.0.1:9876/proxy
  skysink run --external planner       waits for a planner that you start
  skysink run --resume runs/letter-uts-1")]
pub struct RunCommand {
    /// Scenario file [default: the paper's mission].
    scenario: Option<PathBuf>,
    #[command(flatten)]
    mission: MissionOptions,
    /// Resume the interrupted run in this folder.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["scenario", "strategy", "seed", "keys", "out", "force"])]
    resume: Option<PathBuf>,
    #[command(flatten)]
    options: RunOptions,
    #[command(flatten)]
    form: OutputForm,
}

impl RunCommand {
    /// Flies the mission and prints its results.
    ///
    /// # Errors
    /// If the scenario is refused, or as [`run`].
    pub fn run(self, stop: &Stop) -> Result<(), Error> {
        let scenario = match (&self.resume, &self.scenario) {
            (Some(folder), _) => Scenario::read(&folder.join("scenario.toml"), Overrides::default()),
            (None, Some(path)) => Scenario::read(path, self.mission.overrides()),
            (None, None) => Scenario::letter(self.mission.overrides()),
        };
        let scenario = settings::resolve(scenario?)?;
        let mission = Run { scenario, folder: self.mission.folder, resume: self.resume, options: self.options };
        let (folder, summary) = run(&mission, stop)?;
        self.form.print(&summary, || print_run(&folder, &summary))
    }
}
