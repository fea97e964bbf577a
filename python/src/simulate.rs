//! `skysink.simulate`: simulates a mission with a built-in or a Python strategy.

use std::cell::Cell;

use pyo3::exceptions::PyRecursionError;
use pyo3::prelude::*;
use pyo3::types::PyString;
use skysink::run::options::parse_label;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::drive::Observer;
use skysink_mission::origin::RunMode;
use skysink_mission::summary::OperatorUse;
use skysink_mission::{Mission, MissionError, Plant};
use skysink_planner::strategy::Registered;

use crate::errors::{of_mission, refused};
use crate::run::{PyRun, RunRecorder, Sources, python_mode};
use crate::scenario::PyScenario;
use crate::signals::interruptible;
use crate::strategy::{PyStrategies, Raised};

/// Maximum number of missions in each other, limited by the stack.
const MAX_DEPTH: u32 = 10;

/// Simulates a mission in this process, with a built-in strategy, given by name, or in Python: an object, or what makes
/// one for each UAV. `origin` is its name in the scenario and the source files, by default those of its class.
#[pyfunction]
#[pyo3(signature = (scenario, strategy = None, *, seed = None, label = None, origin = None))]
pub fn simulate(
    py: Python<'_>,
    scenario: &Bound<'_, PyScenario>,
    strategy: Option<&Bound<'_, PyAny>>,
    seed: Option<i64>,
    label: Option<String>,
    origin: Option<(String, Sources)>,
) -> PyResult<PyRun> {
    let name = strategy.and_then(|strategy| strategy.cast::<PyString>().ok()).map(|name| name.to_string());
    let seed = seed.map(|seed| ("seed".to_owned(), seed.into()));
    let label = label.as_deref().map(checked_label).transpose()?;
    let planner = name.as_ref().map(|name| ("planner.strategy".to_owned(), name.as_str().into()));
    let scenario = scenario.get().with(seed.into_iter().chain(planner))?;
    let list = scenario.list()?;
    let Some(strategy) = strategy.filter(|_| name.is_none()) else {
        let run = interruptible(py, |stop| by_registry(scenario, list, stop))?.map_err(of_mission)?;
        run.warn(py)?;
        return Ok(run);
    };
    let stop = Stop::default();
    let raised = Raised::new(&stop);
    let strategies = PyStrategies::new(strategy, scenario.scenario.uav.uavs(), &raised)?;
    let class = strategies.class.clone();
    let (name, sources) = match origin {
        Some(origin) => origin,
        None => py.import("skysink.strategy")?.call_method1("origin", (&strategies.first,))?.extract()?,
    };
    let scenario = scenario.flown_by(&name)?;
    let mut recorder = RunRecorder::new(&scenario.scenario, &list);
    let plant = drive_python(py, &scenario.scenario, &list, strategies, &mut recorder)?;
    let run = recorder.end(scenario, list, &plant, python_mode(label.unwrap_or(class), sources));
    run.warn(py)?;
    Ok(run)
}

pub fn checked_label(text: &str) -> PyResult<String> {
    let is_taken = Registered::find(text).is_some();
    match parse_label(text) {
        Ok(label) if !is_taken => Ok(label),
        Ok(_) => Err(refused(format!("label {text:?}: it is the name of a built-in strategy: expected another name"))),
        Err(expected) => Err(refused(format!("label {text:?}: {expected}"))),
    }
}

fn by_registry(scenario: PyScenario, list: SensorList, stop: &Stop) -> Result<PyRun, MissionError> {
    let mut mission = Mission::until(&scenario.scenario, &list, stop)?;
    let mut recorder = RunRecorder::new(&scenario.scenario, &list);
    mission.drive(&mut [&mut recorder], stop)?.unless_stopped()?;
    let mut run = recorder.end(scenario, list, mission.plant(), RunMode::default());
    run.summary.search = mission.planner.counts().into_iter().map(OperatorUse::from).collect();
    Ok(run)
}

/// Drives a mission with Python strategies, in this thread, and returns the plant after it.
pub fn drive_python(
    py: Python<'_>,
    scenario: &Scenario,
    list: &SensorList,
    mut strategies: PyStrategies,
    observer: &mut (dyn Observer + Send),
) -> PyResult<Plant> {
    let raised = strategies.raised.clone();
    let stop = &raised.stop;
    let driven = nested(|| {
        Ok(py.detach(|| {
            let mut mission = Mission::by(scenario, list, &mut |setup| strategies.next(setup), stop)?;
            mission.drive(&mut [observer], stop)?.unless_stopped()?;
            Ok(mission.plant().clone())
        }))
    })?;
    raised.check()?;
    driven.map_err(of_mission)
}

/// Runs `work`, in which a strategy may simulate missions of its own. Refuses more than [`MAX_DEPTH`] in each other.
fn nested<T>(work: impl FnOnce() -> PyResult<T>) -> PyResult<T> {
    thread_local!(static DEPTH: Cell<u32> = const { Cell::new(0) });
    let depth = DEPTH.get();
    if depth == MAX_DEPTH {
        return Err(PyRecursionError::new_err("nested missions: expected a depth of at most ten"));
    }
    DEPTH.set(depth + 1);
    let result = work();
    DEPTH.set(depth);
    result
}
