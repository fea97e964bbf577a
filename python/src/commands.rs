//! The command line of Skysink, and the processes of its ring, by the interpreter.

use std::ffi::OsString;

use pyo3::prelude::*;
use skysink::programs::{self, Interpreter};

use crate::errors::refused;

/// Runs a program of Skysink by its name and arguments, the first of which is what it was called by, and returns its
/// exit code. `interpreter` are the words that start `python -m skysink.programs`.
#[pyfunction]
pub fn run_program(py: Python<'_>, name: &str, arguments: Vec<OsString>, interpreter: Vec<OsString>) -> PyResult<u8> {
    let program = match name {
        "skysink" => skysink::cli::execute,
        "field-sim" => programs::field_sim,
        "flight-sim" => programs::flight_sim,
        "planner" => programs::planner,
        _ => return Err(refused(format!("{name}: expected skysink, field-sim, flight-sim or planner"))),
    };
    programs::start_by(Interpreter(interpreter));
    Ok(py.detach(|| program(arguments)))
}
