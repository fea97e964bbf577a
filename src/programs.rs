//! The programs of the ring: what each does, and how one starts another.

use std::env;
use std::ffi::OsString;
use std::io;
use std::path::PathBuf;
use std::sync::OnceLock;

use iceoryx2::prelude::ipc;
use skysink_ring::role::Role;

use crate::replay::process;
use crate::worker::{self, NoArguments};

/// The words that start a program where there are no executables beside each other, such as `python3 -m
/// skysink.programs`; its name and its arguments follow.
#[derive(Debug)]
pub struct Interpreter(pub Vec<OsString>);

/// How programs are started, if not from the folder of this executable.
static INTERPRETER: OnceLock<Interpreter> = OnceLock::new();

/// The name of the command line.
const COMMAND_LINE: &str = "skysink";

/// Has programs started by an interpreter from now on; the first one counts.
pub fn start_by(interpreter: Interpreter) {
    let _ = INTERPRETER.set(interpreter);
}

/// The words that start the program of this name.
///
/// # Errors
/// If the place of this executable is not known.
pub fn words(name: &str) -> io::Result<(PathBuf, Vec<OsString>)> {
    if let Some((program, words)) = INTERPRETER.get().and_then(|Interpreter(words)| words.split_first()) {
        return Ok((program.into(), [words, &[name.into()]].concat()));
    }
    let this = env::current_exe()?;
    Ok((if name == COMMAND_LINE { this } else { this.with_file_name(name) }, Vec::new()))
}

/// field-sim: runs it by its arguments, the first of which is what it was called by, and returns its exit code.
#[must_use]
pub fn field_sim(arguments: Vec<OsString>) -> u8 {
    worker::run(Role::FieldSim, arguments, |scenario, folder, stop, NoArguments {}| {
        skysink_field_sim::node::run::<ipc::Service>(scenario, folder, stop)
    })
}

/// flight-sim, likewise.
#[must_use]
pub fn flight_sim(arguments: Vec<OsString>) -> u8 {
    worker::run(Role::FlightSim, arguments, process::flight_sim)
}

/// planner, likewise.
#[must_use]
pub fn planner(arguments: Vec<OsString>) -> u8 {
    worker::run(Role::Planner, arguments, process::planner)
}
