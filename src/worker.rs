//! What the executables of the ring have in common: arguments, joining the run, and how they end.

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, Parser};
use iceoryx2::prelude::{LogLevel, ipc, set_log_level_from_env_or};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::stop::Stop;
use skysink_planner::settings;
use skysink_planner::strategies::Strategy;
use skysink_ring::error::NodeError;
use skysink_ring::folder::RingFolder;
use skysink_ring::role::Role;
use skysink_ring::wait::stop_on_signals;

use crate::usage;

/// Where the ring of a process is: its arguments.
#[derive(Debug, Args)]
pub struct RingArguments {
    /// Scenario file: the scenario.toml of the run's folder.
    #[arg(long, value_name = "FILE", env = "SKYSINK_SCENARIO", hide_env_values = true)]
    pub scenario: PathBuf,
    /// The run's own iceoryx2 folder, as skysink run prints it.
    #[arg(long, value_name = "DIR", env = "SKYSINK_RING", hide_env_values = true)]
    pub ring: PathBuf,
}

/// A process of a run that skysink run supervises.
#[derive(Debug, Parser)]
#[command(version)]
struct Cli<A: Args> {
    #[command(flatten)]
    place: RingArguments,
    #[command(flatten)]
    own: A,
}

/// The own arguments of an executable that has none.
#[derive(Debug, Args)]
pub struct NoArguments {}

/// Runs the program of `role`, which takes the arguments `A` beside those of every process of the ring, and returns its
/// exit code.
#[must_use]
pub fn run<A: Args>(
    role: Role,
    arguments: Vec<OsString>,
    node: impl FnOnce(&Scenario, &RingFolder, &Stop, &A) -> Result<(), NodeError>,
) -> u8 {
    let Cli { place, own } = usage::parse(arguments).unwrap_or_else(|message| message.exit());
    let stop = stop_on_signals();
    let ended = join(&place).and_then(|(scenario, folder)| node(&scenario, &folder, &stop, &own));
    exit(role, ended)
}

/// Runs an executable that plans by `strategy`, in the place of Skysink's planner: started by `skysink run --planner`,
/// or by hand with `--scenario` and `--ring` for `skysink run --external planner`.
#[must_use]
pub fn plan_by(strategy: Box<dyn Strategy>) -> ExitCode {
    let node = |scenario: &_, folder: &_, stop: &_, NoArguments {}: &_| {
        skysink_planner::node::run_by::<ipc::Service>(scenario, folder, stop, strategy)
    };
    run(Role::Planner, std::env::args_os().collect(), node).into()
}

/// Joins the run: reads its scenario and makes its iceoryx2 domain that of this process.
///
/// # Errors
/// If there is no such run, or the scenario is refused.
pub fn join(place: &RingArguments) -> Result<(Scenario, RingFolder), NodeError> {
    quiet_iceoryx2();
    let scenario = Scenario::read(&place.scenario, Overrides::default()).and_then(settings::resolve)?;
    let folder = RingFolder::open(&place.ring)?;
    folder.set_global_config()?;
    Ok((scenario, folder))
}

/// The exit code of the program of `role`, with one line on standard error unless a signal asked for the end.
#[must_use]
pub fn exit(role: Role, ended: Result<(), NodeError>) -> u8 {
    let Err(error) = ended else { return 0 };
    let code = error.exit_code();
    if code < 128 {
        role.log(error);
    }
    code
}

/// Leaves iceoryx2's own messages to those who ask for them by `IOX2_LOG_LEVEL`; what matters comes back as an error.
pub fn quiet_iceoryx2() {
    set_log_level_from_env_or(LogLevel::Fatal);
}
