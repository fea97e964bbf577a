//! The entry points of the programs. The executable `skysink` contains all of them: its first argument may be the name
//! of one.

#[cfg(feature = "viewer")]
mod viewer;

use std::ffi::OsString;

use iceoryx2::prelude::ipc;
use skysink_ring::role::Role;

use crate::cli;
use crate::replay::process;
use crate::worker::{self, NoArguments};

#[cfg(feature = "viewer")]
pub use viewer::viewer;

/// The entry point of the program `name`; `None` if there is no such one.
#[must_use]
pub fn of(name: &str) -> Option<fn(Vec<OsString>) -> u8> {
    match name {
        "skysink" => Some(cli::execute),
        "field-sim" => Some(field_sim),
        "flight-sim" => Some(flight_sim),
        "planner" => Some(planner),
        #[cfg(feature = "mavlink")]
        "mavlink" => Some(mavlink),
        #[cfg(feature = "viewer")]
        "viewer" => Some(viewer),
        _ => None,
    }
}

/// Runs a command line, program name first, or the program that its first argument names, and returns its exit code.
#[must_use]
pub fn skysink(arguments: Vec<OsString>) -> u8 {
    match arguments.get(1).and_then(|name| of(name.to_str()?)) {
        Some(program) => program(arguments[1..].to_vec()),
        None => cli::execute(arguments),
    }
}

/// Runs field-sim with these arguments, program name first, and returns its exit code.
#[must_use]
pub fn field_sim(arguments: Vec<OsString>) -> u8 {
    worker::run(Role::FieldSim, arguments, |scenario, folder, stop, NoArguments {}| {
        skysink_field_sim::node::run::<ipc::Service>(scenario, folder, stop)
    })
}

/// Runs flight-sim with these arguments, program name first, and returns its exit code.
#[must_use]
pub fn flight_sim(arguments: Vec<OsString>) -> u8 {
    worker::run(Role::FlightSim, arguments, process::flight_sim)
}

/// Runs planner with these arguments, program name first, and returns its exit code.
#[must_use]
pub fn planner(arguments: Vec<OsString>) -> u8 {
    worker::run(Role::Planner, arguments, process::planner)
}

/// The arguments of the bridge to vehicles.
#[cfg(feature = "mavlink")]
#[derive(Debug, clap::Args)]
struct BridgeArguments {
    /// MAVLink addresses of the vehicles: one for all, as the systems 1 to U, or one for each.
    #[arg(long, value_name = "ADDRESS")]
    connect: skysink_vehicle::wire::WireAddresses,
}

/// Runs mavlink, the bridge to vehicles, with these arguments, and returns its exit code.
#[cfg(feature = "mavlink")]
#[must_use]
pub fn mavlink(arguments: Vec<OsString>) -> u8 {
    worker::run(Role::FlightSim, arguments, |scenario, folder, stop, BridgeArguments { connect }: &_| {
        skysink_vehicle::node::run::<ipc::Service>(scenario, folder, stop, &connect.0)
    })
}
