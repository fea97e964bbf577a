//! Options that several commands share.

use std::fmt;
use std::num::NonZeroU64;
use std::path::{Path, PathBuf};

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use skysink_common::error::InputError;
use skysink_common::scenario::{Overrides, Scenario, Setting};
use skysink_mission::folder::Earlier;
use skysink_planner::settings;
use skysink_planner::strategies::STRATEGIES;
use skysink_planner::strategy::Registered;

/// The scenario of a command.
#[derive(Debug, Args)]
pub struct ScenarioFile {
    /// Scenario file [default: the paper's mission].
    #[arg(id = "scenario", value_name = "SCENARIO")]
    path: Option<PathBuf>,
}

impl ScenarioFile {
    /// Reads it, with the keys of the planner completed.
    pub fn read(&self, overrides: Overrides) -> Result<Scenario, InputError> {
        let scenario = self.path.as_deref().map(|path| Scenario::read(path, overrides.clone()));
        scenario.unwrap_or_else(|| Scenario::letter(overrides)).and_then(settings::resolve)
    }
}

impl fmt::Display for ScenarioFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.path.as_deref().unwrap_or(Path::new("the paper's mission")).display().fmt(f)
    }
}

/// Options of every command that flies one mission.
#[derive(Debug, Args)]
pub struct MissionOptions {
    /// Strategy [default: the scenario's].
    #[arg(long, value_parser = strategy())]
    strategy: Option<&'static str>,
    #[command(flatten)]
    changes: Changes,
    /// The folder of the run.
    #[command(flatten)]
    pub folder: NewFolder,
}

impl MissionOptions {
    /// The keys of the scenario that are overridden.
    pub fn overrides(&self) -> Overrides {
        Overrides { strategy: self.strategy, ..self.changes.overrides() }
    }
}

/// Options of every command that takes a scenario: changes of its keys.
#[derive(Debug, Clone, Args)]
pub struct Changes {
    /// Random seed [default: the scenario's].
    #[arg(long, allow_negative_numbers = true, value_parser = parse_seed)]
    seed: Option<u64>,
    /// Override a scenario key, for example link.bandwidth_hz=5e3 (repeatable).
    #[arg(long = "set", value_name = "KEY=VALUE")]
    keys: Vec<Setting>,
}

/// Parses a seed, which TOML can hold.
fn parse_seed(text: &str) -> Result<u64, String> {
    let seed = text.parse().ok().filter(|seed| i64::try_from(*seed).is_ok());
    seed.ok_or_else(|| "expected a whole number, 0 to 2^63 - 1".to_owned())
}

impl Changes {
    /// The keys of the scenario that are overridden.
    pub fn overrides(&self) -> Overrides {
        Overrides { seed: self.seed, keys: self.keys.clone(), ..Overrides::default() }
    }
}

/// The folder of a new run.
#[derive(Debug, Clone, Args)]
pub struct NewFolder {
    /// Run folder [default: runs/NAME-STRATEGY-SEED].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Replace an existing run in the folder --out.
    #[arg(long, requires = "out")]
    force: bool,
}

impl NewFolder {
    /// What happens to an earlier run in the folder.
    pub fn earlier(&self) -> Earlier {
        Earlier::by_force(self.force)
    }

    /// The folder of the run of a seed, one of several: within `--out`.
    #[cfg(feature = "lab")]
    pub fn of_seed(&self, seed: u64) -> Self {
        Self { out: self.out.as_ref().map(|out| out.join(seed.to_string())), ..self.clone() }
    }
}

/// Options for the recording of a simulation.
#[derive(Debug, Args)]
pub struct RecordingOptions {
    /// Write a recording for rerun, mission.rrd.
    #[arg(long)]
    record: bool,
    /// Write a recording with every K-th slot only; events are always recorded.
    #[arg(long, value_name = "K")]
    record_every: Option<NonZeroU64>,
}

impl RecordingOptions {
    /// K of the recording, which contains every K-th slot; `None` for no recording.
    pub fn every(&self) -> Option<NonZeroU64> {
        self.record_every.or(self.record.then_some(NonZeroU64::MIN))
    }
}

/// Parses the name of a strategy, as in scenario files.
pub fn strategy() -> impl TypedValueParser<Value = &'static str> {
    PossibleValuesParser::new(STRATEGIES.iter().map(|strategy| PossibleValue::new(strategy.name).help(strategy.about)))
        .map(|name| Registered::find(&name).expect("one of the possible values").name)
}
