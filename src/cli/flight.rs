//! The options of `skysink run` and `skysink soak`.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser as _};
use skysink_common::pace::Pace;
use skysink_common::scenario::Overrides;
use skysink_common::stop::Stop;
use skysink_planner::settings;
use skysink_ring::role::Role;
use skysink_ring::wait::Waiting;

use super::Choice;
use crate::error::Error;
use crate::run::restart::Rule;
use crate::run::{Run, RunPlace};
use crate::soak::{self, Soak};

/// Options of `skysink run`.
#[derive(Debug, Args)]
pub struct RunOptions {
    /// Scenario file; the letter's mission if left out.
    scenario: Option<PathBuf>,
    #[command(flatten)]
    choice: Choice,
    /// Resume a run that has ended early, in its folder.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["scenario", "strategy", "seed", "out", "force"])]
    resume: Option<PathBuf>,
    /// max, realtime, or a factor such as 10x.
    #[arg(long, default_value = "max", value_name = "PACE")]
    pace: Pace,
    /// How the processes wait for each other: event, asleep until they are woken; or poll, which
    /// keeps a core busy for each of them and is faster only where there are cores to spare.
    #[arg(long, default_value = "event", value_name = "WAY")]
    wait: Waiting,
    /// Serve the recording live on 127.0.0.1.
    #[arg(long, value_name = "PORT", num_args = 0..=1, require_equals = true, default_missing_value = "9876")]
    live: Option<u16>,
    /// Leave the recording out.
    #[arg(long, conflicts_with = "live")]
    no_viewer: bool,
    /// Leave this process to somebody else and wait for it (repeatable).
    #[arg(long, value_name = "ROLE", value_parser = PossibleValuesParser::new(WORKERS.map(Role::name)).map(worker))]
    external: Vec<Role>,
    /// What is done when a process ends too early: never, or on-failure; planner=never for one of them (repeatable)
    /// [default: on-failure, at most 50 times in 10 s].
    #[arg(long, value_name = "POLICY")]
    restart: Vec<Rule>,
    /// How long a process waits for another [s; default 30, with --external 600].
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    timeout: Option<f64>,
}

impl RunOptions {
    /// What to run.
    ///
    /// # Errors
    /// If the scenario is refused, or this build has no viewer.
    pub fn run(self) -> Result<Run, Error> {
        let scenario = match (&self.resume, &self.scenario) {
            (Some(folder), _) => settings::read(&folder.join("scenario.toml"), Overrides::default())?,
            (None, Some(path)) => settings::read(path, self.choice.overrides())?,
            (None, None) => settings::letter(self.choice.overrides())?,
        };
        let viewer = !self.no_viewer;
        if viewer && !cfg!(feature = "viewer") {
            return Err(Error::NoViewer);
        }
        let timeout_s = self.timeout.unwrap_or(if self.external.is_empty() { 30.0 } else { 600.0 });
        let place = match self.resume {
            Some(folder) => RunPlace::Resume(folder),
            None => RunPlace::New { out: self.choice.flight.out, force: self.choice.flight.force },
        };
        let Self { pace, wait, live, external, restart, .. } = self;
        Ok(Run { scenario, pace, wait, place, viewer, live, external, restart, timeout_s })
    }
}

/// Options of `skysink soak`.
#[derive(Debug, Args)]
pub struct SoakOptions {
    /// Scenario file; the letter's field if left out.
    scenario: Option<PathBuf>,
    #[command(flatten)]
    choice: Choice,
    /// Slots to fly, instead of the scenario's.
    #[arg(long, value_name = "N", default_value_t = 1_000_000, value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    slots: u64,
    /// Mean time between two kills [s] in the first half of the mission; the second half is calm.
    #[arg(long, value_name = "SECONDS", default_value = "0.1", value_parser = seconds)]
    kill_every: f64,
    /// Let the viewer take part, too.
    #[arg(long)]
    viewer: bool,
}

impl SoakOptions {
    /// Flies it, and prints what became of it.
    ///
    /// # Errors
    /// As the run, or if the trace is not that of the undisturbed mission, or something has grown.
    pub fn soak(self, stop: &Stop) -> Result<(), Error> {
        let overrides = Overrides { slots: Some(self.slots), ..self.choice.overrides() };
        let scenario = match &self.scenario {
            Some(path) => settings::read(path, overrides)?,
            None => settings::letter(overrides)?,
        };
        if self.viewer && !cfg!(feature = "viewer") {
            return Err(Error::NoViewer);
        }
        let place = RunPlace::New { out: self.choice.flight.out, force: self.choice.flight.force };
        let run = Run {
            scenario,
            pace: Pace::Max,
            wait: Waiting::Event,
            place,
            viewer: self.viewer,
            live: None,
            external: Vec::new(),
            restart: Vec::new(),
            timeout_s: 30.0,
        };
        soak::soak(&Soak { run, kill_every: Duration::from_secs_f64(self.kill_every) }, stop)
    }
}

/// The processes that can be left to somebody else.
const WORKERS: [Role; 4] = [Role::FieldSim, Role::FlightSim, Role::Planner, Role::Viewer];

fn worker(name: String) -> Role {
    WORKERS.into_iter().find(|role| role.name() == name).expect("one of the possible values")
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if seconds > 0.0 && seconds <= 1e6 => Ok(seconds),
        _ => Err("expected seconds, above 0".to_owned()),
    }
}
