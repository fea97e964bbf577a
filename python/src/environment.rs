//! The core of the single Gymnasium environment.

use std::sync::Arc;

use numpy::{IntoPyArray, PyArray1, PyArrayMethods, PyReadonlyArray1};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use skysink_common::checkpoint::Checkpoint;
use skysink_common::message::{Mode, Plan};
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::UAV;

use crate::episode::{Episode, Fields, Outcome};
use crate::errors::{of_checkpoint, of_mission, refused};
use crate::field::{PyField, coordinates};
use crate::pilot::PyDecision;
use crate::run::PyRun;
use crate::scenario::PyScenario;
use crate::simulate::checked_label;

/// Observation, reward, terminated, truncated, information.
type Step<'py> = (Bound<'py, PyDict>, f64, bool, bool, Bound<'py, PyDict>);

/// The environment without its spaces.
#[pyclass(name = "EnvironmentCore", module = "skysink")]
pub struct PyEnvironmentCore {
    episode: Episode,
    /// The plans of the episode so far, shared with clones.
    plans: Vec<Arc<Plan>>,
    /// Whether the positions of the sensor nodes are observed.
    positions: bool,
}

impl PyEnvironmentCore {
    fn observation<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let mut uav = [0.0; 3];
        let mut queues = vec![0.0; self.episode.field.count()];
        let mut slot = 0.0;
        self.episode.observe(&mut uav, &mut queues, &mut slot);
        let observation = PyDict::new(py);
        observation.set_item(intern!(py, "uav"), PyArray1::from_slice(py, &uav))?;
        observation.set_item(intern!(py, "queues"), queues.into_pyarray(py))?;
        observation.set_item(intern!(py, "slot"), PyArray1::from_slice(py, &[slot]))?;
        if self.positions {
            let count = self.episode.field.count();
            let mut positions = vec![0.0; 2 * count];
            self.episode.observe_positions(&mut positions);
            observation.set_item(intern!(py, "positions"), positions.into_pyarray(py).reshape([count, 2])?)?;
        }
        Ok(observation)
    }

    fn fly_plan<'py>(&mut self, py: Python<'py>, plan: &Plan) -> PyResult<Step<'py>> {
        let Outcome { reward, delivered_bits, lost_bits, is_over } = self.episode.fly(plan);
        self.plans.push(Arc::new(*plan));
        let information = PyDict::new(py);
        information.set_item(intern!(py, "lost_bits"), lost_bits)?;
        information.set_item(intern!(py, "delivered_bits"), delivered_bits)?;
        Ok((self.observation(py)?, reward, false, is_over, information))
    }

    fn must_fly(&self) -> PyResult<()> {
        if self.episode.plant.is_over() {
            return Err(refused("the episode is over: expected reset()"));
        }
        Ok(())
    }
}

#[pymethods]
impl PyEnvironmentCore {
    #[new]
    #[pyo3(signature = (scenario, fields = None, positions = false))]
    fn new(scenario: &Bound<'_, PyScenario>, fields: Option<u64>, positions: bool) -> PyResult<Self> {
        Ok(Self { episode: first_episode(scenario, fields)?, plans: Vec::new(), positions })
    }

    #[getter]
    fn seed(&self) -> u64 {
        self.episode.seed()
    }

    #[getter]
    fn number(&self) -> u64 {
        self.episode.number()
    }

    #[getter]
    fn slot(&self) -> u64 {
        self.episode.plant.slot()
    }

    #[getter]
    fn field(&self) -> PyField {
        PyField(Arc::clone(&self.episode.field))
    }

    #[getter]
    fn uav(&self) -> (f64, f64, f64) {
        let position = self.episode.plant.flight(UAV).position();
        (position.x, position.y, position.z)
    }

    #[getter]
    fn queues_bits<'py>(&mut self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        PyArray1::from_slice(py, self.episode.plant.known_bits())
    }

    fn reset<'py>(&mut self, py: Python<'py>, number: u64) -> PyResult<(Bound<'py, PyDict>, Bound<'py, PyDict>)> {
        self.episode.begin(number)?;
        self.plans.clear();
        let information = PyDict::new(py);
        information.set_item("seed", self.episode.seed())?;
        Ok((self.observation(py)?, information))
    }

    fn step<'py>(&mut self, py: Python<'py>, action: &Bound<'py, PyAny>) -> PyResult<Step<'py>> {
        self.must_fly()?;
        let mut components = [0.0; 3];
        let axes = self.episode.axes();
        let count = match action.extract::<PyReadonlyArray1<'_, f32>>() {
            Ok(array) => {
                let array = array.as_array();
                components.iter_mut().zip(array).for_each(|(component, &value)| *component = value.into());
                array.len()
            }
            Err(_) => {
                let values = coordinates(action)?;
                let single = values.iter().map(|&value| f64::from(value as f32)); // as in a vector
                components.iter_mut().zip(single).for_each(|(component, value)| *component = value);
                values.len()
            }
        };
        if count != axes || components.iter().any(|component| !component.is_finite()) {
            return Err(refused(format!("action {action}: expected {axes} finite numbers, -1 to 1")));
        }
        let plan = self.episode.plan(&components[..axes]);
        self.fly_plan(py, &plan)
    }

    #[pyo3(signature = (decision, transit = false))]
    fn fly<'py>(&mut self, py: Python<'py>, decision: &Bound<'py, PyDecision>, transit: bool) -> PyResult<Step<'py>> {
        self.must_fly()?;
        let waypoint = decision.get().waypoint_from(self.episode.plant.flight(UAV).position().z);
        let mode = if transit { Mode::Transit } else { Mode::Serve };
        let plan = self.episode.plan_to(waypoint, decision.get().schedule(), mode);
        self.fly_plan(py, &plan)
    }

    fn clone(&self) -> Self {
        Self { episode: self.episode.clone(), plans: self.plans.clone(), positions: self.positions }
    }

    /// The episode as bytes, and the plans of its slots.
    fn save<'py>(&self, py: Python<'py>) -> (Bound<'py, PyBytes>, Bound<'py, PyBytes>) {
        let mut bytes = Vec::new();
        self.episode.save(&mut bytes);
        let plans: Vec<Plan> = self.plans.iter().map(|plan| **plan).collect();
        (PyBytes::new(py, &bytes), PyBytes::new(py, bytemuck::cast_slice(&plans)))
    }

    fn restore(&mut self, saved: (Vec<u8>, Vec<u8>)) -> PyResult<()> {
        let (episode, plans) = saved;
        self.episode.restore(&episode).map_err(of_checkpoint)?;
        self.plans = bytemuck::pod_collect_to_vec(&plans).into_iter().map(Arc::new).collect();
        Ok(())
    }

    fn run(&self, label: &str) -> PyResult<PyRun> {
        let scenario = PyScenario::on_record(&self.episode.scenario()?)?;
        let plans = self.plans.iter().map(|plan| Some(**plan));
        let label = Some(checked_label(label)?);
        PyRun::of_plans(scenario, SensorList::clone(&self.episode.list), plans, label).map_err(of_mission)
    }
}

/// The first episode of an environment over `fields` fields.
pub fn first_episode(scenario: &Bound<'_, PyScenario>, fields: Option<u64>) -> PyResult<Episode> {
    if fields == Some(0) {
        return Err(refused("fields = 0: expected 1 or more, or None"));
    }
    let scenario = scenario.get().scenario.clone();
    if fields.is_some_and(|count| scenario.seed.checked_add(count).is_none_or(|end| i64::try_from(end).is_err())) {
        return Err(refused(format!("fields = {}: expected fewer", fields.unwrap_or(0))));
    }
    let number = if fields.is_some() { 0 } else { scenario.seed };
    Episode::new(Arc::new(Fields { scenario, count: fields }), number)
}
