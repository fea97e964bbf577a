//! `skysink.simulate`: simulates a mission with a built-in or a Python strategy.

use std::cell::Cell;
use std::time::Instant;

use pyo3::exceptions::PyRecursionError;
use pyo3::prelude::*;
use pyo3::types::PyString;
use skysink::run::options::parse_label;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::drive::Observer;
use skysink_mission::{Mission, MissionError, Plant, drive};
use skysink_planner::strategy::Registered;

use crate::episode::plant;
use crate::errors::{of_mission, refused};
use crate::field::PyField;
use crate::pilot::{PythonPilot, PythonPlanner};
use crate::run::{PyRun, RunRecorder};
use crate::scenario::PyScenario;
use crate::signals::interruptible;

/// Simulates a mission in this process, with a built-in strategy, given by name, or a Python strategy.
#[pyfunction]
#[pyo3(signature = (scenario, strategy = None, *, seed = None, label = None))]
pub fn simulate(
    py: Python<'_>,
    scenario: &Bound<'_, PyScenario>,
    strategy: Option<&Bound<'_, PyAny>>,
    seed: Option<i64>,
    label: Option<String>,
) -> PyResult<PyRun> {
    let name = strategy.and_then(|strategy| strategy.cast::<PyString>().ok()).map(|name| name.to_string());
    let seed = seed.map(|seed| ("seed".to_owned(), seed.into()));
    let label = label.as_deref().map(checked_label).transpose()?;
    let planner = name.as_ref().map(|name| ("planner.strategy".to_owned(), name.as_str().into()));
    let scenario = scenario.get().with(seed.into_iter().chain(planner))?;
    let list = scenario.list()?;
    match strategy.filter(|_| name.is_none()) {
        Some(strategy) => by_python(py, scenario, list, strategy, label),
        None => interruptible(py, |stop| by_registry(scenario, list, stop))?.map_err(of_mission),
    }
}

/// Checks the label of a mission.
pub fn checked_label(text: &str) -> PyResult<String> {
    let is_taken = Registered::find(text).is_some();
    match parse_label(text) {
        Ok(label) if !is_taken => Ok(label),
        Ok(_) => Err(refused(format!("label {text:?}: it is the name of a built-in strategy: expected another name"))),
        Err(expected) => Err(refused(format!("label {text:?}: {expected}"))),
    }
}

fn by_registry(scenario: PyScenario, list: SensorList, stop: &Stop) -> Result<PyRun, MissionError> {
    let mut mission = Mission::new(&scenario.scenario, &list)?;
    let mut recorder = RunRecorder::new(&scenario.scenario, &list);
    let begin = Instant::now();
    mission.drive(&mut [&mut recorder], stop)?.unless_stopped()?;
    Ok(recorder.end(scenario, list, mission.plant(), begin.elapsed(), None))
}

/// Counts nested missions: a strategy may simulate missions.
struct Depth;

impl Depth {
    /// Maximum depth, limited by the stack.
    const MOST: u32 = 10;

    /// The depth on this thread.
    fn on_thread(change: impl FnOnce(u32) -> u32) -> u32 {
        thread_local!(static DEPTH: Cell<u32> = const { Cell::new(0) });
        DEPTH.with(|depth| {
            depth.set(change(depth.get()));
            depth.get()
        })
    }

    fn enter() -> PyResult<Self> {
        let depth = Self::on_thread(|depth| depth + 1);
        let entered = Self; // counts down when it is dropped
        if depth > Self::MOST {
            return Err(PyRecursionError::new_err("nested missions: expected a depth of at most ten"));
        }
        Ok(entered)
    }
}

impl Drop for Depth {
    fn drop(&mut self) {
        Self::on_thread(|depth| depth - 1);
    }
}

fn by_python(
    py: Python<'_>,
    scenario: PyScenario,
    list: SensorList,
    strategy: &Bound<'_, PyAny>,
    label: Option<String>,
) -> PyResult<PyRun> {
    let _depth = Depth::enter()?;
    let mut recorder = RunRecorder::new(&scenario.scenario, &list);
    let begin = Instant::now();
    let plant = drive_python(py, &scenario.scenario, &list, strategy.clone().unbind(), &mut recorder)?;
    let wall = begin.elapsed();
    let label = label.map_or_else(|| strategy.get_type().name().map(|name| name.to_string()), Ok)?;
    Ok(recorder.end(scenario, list, &plant, wall, Some(label)))
}

/// Drives a mission with a Python strategy, and returns the plant after it.
pub fn drive_python(
    py: Python<'_>,
    scenario: &Scenario,
    list: &SensorList,
    strategy: Py<PyAny>,
    observer: &mut dyn Observer,
) -> PyResult<Plant> {
    let mut plant = plant(scenario, list)?;
    let mut pilot = PythonPilot { py, planner: PythonPlanner::new(py, strategy, PyField::of(scenario, list))? };
    drive(&mut plant, &mut pilot, &mut [observer], &Stop::default()).map_err(of_mission)?;
    Ok(plant)
}
