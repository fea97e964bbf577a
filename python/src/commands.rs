//! Runs the command line and the processes of the ring with the Python interpreter.

use std::ffi::OsString;

use pyo3::prelude::*;
use skysink::programs;
use skysink::run::executables::{Interpreter, set_interpreter};

use crate::errors::refused;

/// Runs the program `name` with these arguments, program name first, and returns its
/// exit code. `interpreter` is the command `python -m skysink.programs`.
#[pyfunction]
pub fn run_program(py: Python<'_>, name: &str, arguments: Vec<OsString>, interpreter: Vec<OsString>) -> PyResult<u8> {
    let Some(program) = programs::of(name) else {
        return Err(refused(format!("{name}: expected skysink, field-sim, flight-sim or planner")));
    };
    set_interpreter(Interpreter(interpreter));
    Ok(py.detach(|| program(arguments)))
}
