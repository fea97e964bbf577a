//! Common code of the executables of the ring: arguments, joining the run, and exit codes.

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, Parser};
use iceoryx2::prelude::{LogLevel, ipc, set_log_level_from_env_or};
use skysink_common::error::InputError;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::stop::{Stop, Stopped};
use skysink_flight_sim::outside::{OutsideVehicle, REACHED_M};
use skysink_planner::settings;
use skysink_planner::strategy::{Setup, Strategy};
use skysink_ring::error::{NodeError, RingError};
use skysink_ring::folder::RingFolder;
use skysink_ring::role::Role;
use skysink_ring::wait::stop_on_signals;

use crate::usage::{self, VERSION};

/// The arguments of every process of a ring.
#[derive(Debug, Args)]
pub struct RingArguments {
    /// Scenario file: scenario.toml in the run folder.
    #[arg(long, value_name = "FILE", env = "SKYSINK_SCENARIO", hide_env_values = true)]
    pub scenario: PathBuf,
    /// Ring folder, which contains the iceoryx2 configuration of the run; skysink run prints it.
    #[arg(long, value_name = "DIR", env = "SKYSINK_RING", hide_env_values = true)]
    pub ring: PathBuf,
}

/// One of the processes of the ring; skysink run starts and supervises it.
#[derive(Debug, Parser)]
#[command(version = VERSION)]
struct Cli<A: Args> {
    #[command(flatten)]
    ring: RingArguments,
    #[command(flatten)]
    additional: A,
}

/// No additional arguments.
#[derive(Debug, Args)]
pub struct NoArguments {}

/// Runs the program of `role` with the additional arguments `A`, and returns its exit code.
#[must_use]
pub fn run<A: Args>(
    role: Role,
    arguments: Vec<OsString>,
    node: impl FnOnce(&Scenario, &RingFolder, &Stop, &A) -> Result<(), NodeError>,
) -> u8 {
    let Cli { ring, additional } = match usage::parse(arguments) {
        Ok(cli) => cli,
        Err(message) => return usage::print(role, message),
    };
    let stop = stop_on_signals();
    let result = join(&ring).and_then(|(scenario, folder)| node(&scenario, &folder, &stop, &additional));
    exit_code(role, result, &stop)
}

/// Runs the strategies that `make` makes, one for each UAV, as the planner of a ring. `skysink run --planner` starts
/// such an executable; for `skysink run --external planner`, start it with `--scenario` and `--ring`.
#[must_use]
pub fn plan_by(mut make: impl FnMut(&Setup<'_>) -> Box<dyn Strategy>) -> ExitCode {
    let node = |scenario: &_, folder: &_, stop: &_, NoArguments {}: &_| {
        skysink_planner::node::run_by::<ipc::Service>(scenario, folder, stop, &mut |setup| Ok(make(setup)))
    };
    run(Role::Planner, std::env::args_os().collect(), node).into()
}

/// Flies `vehicles`, one for each UAV, in the place of flight-sim. `skysink run --vehicle` starts such an executable;
/// for `skysink run --external flight-sim`, start it with `--scenario` and `--ring`.
#[must_use]
pub fn fly_by(mut vehicles: Vec<Box<dyn OutsideVehicle>>) -> ExitCode {
    let node = |scenario: &Scenario, folder: &_, stop: &_, NoArguments {}: &_| {
        let found = vehicles.len();
        let expected = scenario.uav.uavs();
        if found != expected {
            let message =
                format_args!("uav.count = {expected}: expected {found}, the number of vehicles of the program");
            return Err(InputError::new("scenario", &scenario.path, message).into());
        }
        skysink_flight_sim::node::run_by::<ipc::Service>(scenario, folder, stop, &mut vehicles, REACHED_M)
    };
    run(Role::FlightSim, std::env::args_os().collect(), node).into()
}

/// Joins the run: reads its scenario and enters its iceoryx2 domain.
///
/// # Errors
/// If the ring folder does not exist, or the scenario is refused.
pub fn join(arguments: &RingArguments) -> Result<(Scenario, RingFolder), NodeError> {
    silence_iceoryx2();
    let scenario = Scenario::read(&arguments.scenario, Overrides::default()).and_then(settings::resolve)?;
    let folder = RingFolder::open(&arguments.ring)?;
    folder.set_global_config()?;
    Ok((scenario, folder))
}

/// The exit code of the program of `role`. Prints the error, unless a signal has requested the end.
#[must_use]
pub fn exit_code(role: Role, result: Result<(), NodeError>, stop: &Stop) -> u8 {
    match (result, stop.requested()) {
        (Ok(()), _) => 0,
        // A signal interrupts what iceoryx2 waits for, such as a topic that is being created.
        (Err(NodeError::Ring(RingError::Topic { .. })), Some(signal)) => Stopped(signal).exit_code(),
        (Err(NodeError::Stopped(stopped) | NodeError::Ring(RingError::Stopped(stopped))), _) => stopped.exit_code(),
        (Err(error), _) => {
            let code = error.exit_code();
            role.log(error);
            code
        }
    }
}

/// Turns the log of iceoryx2 off unless `IOX2_LOG_LEVEL` is set. Its failures are returned as errors.
pub fn silence_iceoryx2() {
    set_log_level_from_env_or(LogLevel::Fatal);
}
