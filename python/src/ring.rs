//! `skysink.ring`: strategies and vehicles in Python as processes of a running ring.

use std::path::PathBuf;

use iceoryx2::prelude::ipc;
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use skysink::worker::{self, RingArguments};
use skysink_common::scenario::Scenario;
use skysink_common::stop::{Stop, Stopped};
use skysink_flight_sim::node as flight_sim;
use skysink_planner::node as planner;
use skysink_ring::error::NodeError;
use skysink_ring::folder::RingFolder;
use skysink_ring::role::Role;

use crate::errors::refused;
use crate::signals::StopOnSignals;
use crate::strategy::{PyStrategies, Raised};
use crate::vehicle::PyVehicle;

/// Plans for the ring in the folder `ring` by `strategy`, an object or what makes one for each UAV, until the mission
/// ends, and returns the exit code.
#[pyfunction]
pub fn plan_ring(py: Python<'_>, strategy: &Bound<'_, PyAny>, ring: PathBuf, scenario: PathBuf) -> PyResult<u8> {
    let (scenario, folder) = join(ring, scenario)?;
    let signals = StopOnSignals::new(py)?;
    let raised = Raised::new(&signals.stop);
    let mut strategies = PyStrategies::new(strategy, scenario.uav.uavs(), &raised)?;
    let planned = py.detach(|| {
        planner::run_by::<ipc::Service>(&scenario, &folder, &signals.stop, &mut |setup| strategies.next(setup))
    });
    end(py, Role::Planner, planned, &raised, &signals.stop)
}

/// Flies the plans of the ring in the folder `ring` by `vehicle` until the mission ends, and returns the exit code.
#[pyfunction]
pub fn fly_ring(py: Python<'_>, vehicle: Py<PyAny>, ring: PathBuf, scenario: PathBuf, reached_m: f64) -> PyResult<u8> {
    let (scenario, folder) = join(ring, scenario)?;
    let signals = StopOnSignals::new(py)?;
    let raised = Raised::new(&signals.stop);
    let flown = py.detach(|| {
        let mut vehicles = PyVehicle::of_uavs(vehicle, &scenario, &raised);
        flight_sim::run_by::<ipc::Service>(&scenario, &folder, &signals.stop, &mut vehicles, reached_m)
    });
    end(py, Role::FlightSim, flown, &raised, &signals.stop)
}

/// Reads the scenario, and enters the ring.
fn join(ring: PathBuf, scenario: PathBuf) -> PyResult<(Scenario, RingFolder)> {
    worker::join(&RingArguments { scenario, ring }).map_err(refused)
}

/// The exit code of a process, or the exception of its Python code.
fn end(py: Python<'_>, role: Role, result: Result<(), NodeError>, raised: &Raised, stop: &Stop) -> PyResult<u8> {
    // The handler in Python of a signal that has stopped the process may raise an exception.
    if let Err(error) = py.check_signals()
        && !error.is_instance_of::<PyKeyboardInterrupt>(py)
    {
        return Err(error);
    }
    let interrupted = |_| Err(NodeError::Stopped(Stopped(2)));
    let result = match raised.check() {
        Err(error) if !error.is_instance_of::<PyKeyboardInterrupt>(py) => return Err(error),
        raised => raised.map_or_else(interrupted, |()| result),
    };
    Ok(worker::exit_code(role, result, stop))
}
