//! The core of the single Gymnasium environment.

use std::slice;
use std::sync::Arc;

use numpy::{AllowTypeChange, PyArray1, PyArrayLike1};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use skysink_common::message::{Mode, Plan};
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::UAV;
use skysink_planner::strategies::PYTHON;

use crate::episode::{Episode, Observations, Outcome};
use crate::errors::{of_mission, refused};
use crate::field::PyField;
use crate::pilot::{PyDecision, believed_bps};
use crate::run::{PyRun, python_mode};
use crate::scenario::PyScenario;
use crate::simulate::checked_label;

/// Observation, reward, terminated, truncated, information.
type Step<'py> = (Bound<'py, PyDict>, f64, bool, bool, Bound<'py, PyDict>);

/// The environment without its spaces.
#[pyclass(name = "EnvironmentCore", module = "skysink")]
#[derive(Clone)]
pub struct PyEnvironmentCore {
    episode: Episode,
    /// The plans of the episode so far, shared with clones.
    plans: Vec<Arc<Plan>>,
}

impl PyEnvironmentCore {
    fn observation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let Self { episode, .. } = self;
        let mut observed = Observations::new(1, episode.field.count());
        episode.observe(&mut observed.uav, &mut observed.queues, &mut observed.slot[0]);
        observed.into_dict(py, slice::from_ref(episode), None)
    }

    fn fly_plan<'py>(&mut self, py: Python<'py>, plan: Plan) -> PyResult<Step<'py>> {
        if self.episode.plant.is_over() {
            return Err(refused("the episode is over: expected reset()"));
        }
        let Outcome { reward, delivered_bits, lost_bits, is_over } = self.episode.fly(&plan);
        self.plans.push(Arc::new(plan));
        let information = PyDict::new(py);
        information.set_item(intern!(py, "lost_bits"), lost_bits)?;
        information.set_item(intern!(py, "delivered_bits"), delivered_bits)?;
        Ok((self.observation(py)?, reward, false, is_over, information))
    }
}

#[pymethods]
impl PyEnvironmentCore {
    #[new]
    #[pyo3(signature = (scenario, fields = None, positions = false))]
    fn new(scenario: &Bound<'_, PyScenario>, fields: Option<u64>, positions: bool) -> PyResult<Self> {
        Ok(Self { episode: Episode::first(scenario.get(), fields, positions)?, plans: Vec::new() })
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
    fn field(&self) -> PyField {
        PyField::new(Arc::clone(&self.episode.field))
    }

    #[getter]
    fn uav(&self) -> (f64, f64, f64) {
        let position = self.episode.plant.flight(UAV).position();
        (position.x, position.y, position.z)
    }

    #[getter]
    fn queues_bits<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        PyArray1::from_slice(py, self.episode.plant.field().believed_bits())
    }

    #[getter]
    fn sampling_bps<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        believed_bps(py, &self.episode.plant, &self.episode.field)
    }

    fn reset<'py>(&mut self, py: Python<'py>, number: u64) -> PyResult<Bound<'py, PyDict>> {
        self.episode.begin(number)?;
        self.plans.clear();
        self.observation(py)
    }

    fn step<'py>(&mut self, py: Python<'py>, action: PyArrayLike1<'py, f32, AllowTypeChange>) -> PyResult<Step<'py>> {
        let axes = self.episode.axes();
        let components = action.as_array().to_vec();
        if components.len() != axes || components.iter().any(|component| !component.is_finite()) {
            return Err(refused(format!("action {components:?}: expected {axes} finite numbers, -1 to 1")));
        }
        let plan = self.episode.plan(&components);
        self.fly_plan(py, plan)
    }

    #[pyo3(signature = (decision, transit = false))]
    fn fly<'py>(&mut self, py: Python<'py>, decision: &Bound<'py, PyDecision>, transit: bool) -> PyResult<Step<'py>> {
        let Episode { field, plant, .. } = &self.episode;
        let mode = if transit { Mode::Transit } else { Mode::Serve };
        let plan = decision.get().plan(field, plant.flight(UAV).position(), plant.field().believed_bits(), mode);
        self.fly_plan(py, plan)
    }

    fn clone(&self) -> Self {
        Clone::clone(self)
    }

    /// The episode as bytes, and the plans of its slots.
    fn save(&self) -> (Vec<u8>, Vec<u8>) {
        let plans: Vec<Plan> = self.plans.iter().map(|plan| **plan).collect();
        (self.episode.save(), bytemuck::cast_slice(&plans).to_vec())
    }

    fn restore(&mut self, saved: (Vec<u8>, Vec<u8>)) -> PyResult<()> {
        let (episode, plans) = saved;
        self.episode.restore(&episode)?;
        self.plans = bytemuck::pod_collect_to_vec(&plans).into_iter().map(Arc::new).collect();
        Ok(())
    }

    fn run(&self, label: &str) -> PyResult<PyRun> {
        let label = checked_label(label)?;
        let scenario = PyScenario::on_record(&self.episode.scenario()?)?.flown_by(&format!("{PYTHON}{label}"))?;
        let plans = self.plans.iter().map(|plan| Some(**plan));
        let list = SensorList::clone(&self.episode.list);
        PyRun::of_plans(scenario, list, plans, python_mode(label, Vec::new())).map_err(of_mission)
    }
}
