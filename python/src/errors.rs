//! Converts Skysink's errors to Python exceptions.

use pyo3::PyErr;
use pyo3::create_exception;
use pyo3::exceptions::{PyKeyboardInterrupt, PyOSError, PyRuntimeError, PyValueError};
use skysink_lab::LabError;
use skysink_mission::MissionError;

create_exception!(
    skysink,
    InputError,
    PyValueError,
    "Invalid scenario, sweep, folder or value. The message is one line with the value and the expectation."
);

pub fn refused(message: impl ToString) -> PyErr {
    InputError::new_err(message.to_string())
}

pub fn of_mission(error: MissionError) -> PyErr {
    match error {
        MissionError::Input(error) => refused(error),
        MissionError::Stopped(_) => PyKeyboardInterrupt::new_err(()),
        MissionError::File { .. } => PyOSError::new_err(error.to_string()),
        MissionError::Unbalanced { .. } => PyRuntimeError::new_err(error.to_string()),
        MissionError::Foreign(error) => match error.downcast::<PyErr>() {
            Ok(error) => *error,
            Err(error) => PyRuntimeError::new_err(error.to_string()),
        },
    }
}

pub fn of_lab(error: LabError) -> PyErr {
    match error {
        LabError::Mission(error) => of_mission(error),
        LabError::FigureMean { .. } | LabError::FigureZeros { .. } | LabError::FigureText { .. } => {
            PyRuntimeError::new_err(error.to_string())
        }
    }
}
