//! Warnings of flights whose plans were not flown as they were decided.

use std::ffi::CString;

use pyo3::exceptions::PyRuntimeWarning;
use pyo3::prelude::*;
use skysink_common::scenario::Scenario;
use skysink_lab::sweep::journal::MissionRows;
use skysink_lab::sweep::plan::Sweep;
use skysink_lab::unflown::{UnflownFlights, text_of};
use skysink_mission::figures::Summary;
use skysink_mission::unflown::{REASONS, UnflownPlans};

use crate::errors::{of_lab, refused};

/// Warns of the missions of a sweep or a comparison, if there are such.
pub fn warn_of_sweep(py: Python<'_>, sweep: &Sweep, rows: &MissionRows) -> PyResult<()> {
    let flights = UnflownFlights::of_sweep(sweep, rows).map_err(of_lab)?;
    text_of(&flights).map_or(Ok(()), |flights| warn(py, &flights))
}

/// Warns of a mission, if more than 1 % of its slots are held or refused.
pub fn warn_of_run(py: Python<'_>, summary: &Summary, scenario: &Scenario) -> PyResult<()> {
    UnflownPlans::of_summary(summary, scenario).map_or(Ok(()), |plans| warn(py, &plans.to_string()))
}

/// Warns of these plans, where the caller of the package is.
fn warn(py: Python<'_>, plans: &str) -> PyResult<()> {
    let text = CString::new(format!("{plans}: {REASONS}")).map_err(refused)?;
    PyErr::warn(py, &py.get_type::<PyRuntimeWarning>(), &text, 2)
}
