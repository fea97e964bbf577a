//! The core of the single Gymnasium environment.

use std::slice;
use std::sync::Arc;

use numpy::PyArray1;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use skysink_common::message::{Mode, Plan};
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::{Plans, UAV};
use skysink_planner::strategies::PYTHON;

use crate::belief::{PyBelief, believed, believed_bps};
use crate::control::Actions;
use crate::episode::{Episode, Outcome};
use crate::errors::{of_mission, refused};
use crate::field::PyField;
use crate::observation::Observations;
use crate::rules::{Control, Kind, Rules};
use crate::run::{PyRun, python_mode};
use crate::scenario::PyScenario;
use crate::signals::interruptible;
use crate::simulate::checked_label;
use crate::strategy::PyDecision;

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
        let mut observed = Observations::of(slice::from_ref(episode));
        episode.observe(&mut observed.rows().0);
        observed.into_dict(py, episode, None)
    }

    fn fly_plan<'py>(&mut self, py: Python<'py>, plan: Plan) -> PyResult<Step<'py>> {
        if self.episode.is_over() {
            return Err(refused("the episode is over: expected reset()"));
        }
        let Outcome { reward, delivered_bits, lost_bits, is_over, is_down } = self.episode.fly(&[Some(plan)]);
        self.plans.push(Arc::new(plan));
        let information = PyDict::new(py);
        information.set_item(intern!(py, "lost_bits"), lost_bits)?;
        information.set_item(intern!(py, "delivered_bits"), delivered_bits)?;
        if self.episode.control() == Control::Sensor {
            information.set_item(intern!(py, "action_mask"), self.action_masks(py))?;
        }
        Ok((self.observation(py)?, reward, is_down, is_over && !is_down, information))
    }
}

#[pymethods]
impl PyEnvironmentCore {
    #[new]
    #[expect(clippy::too_many_arguments, reason = "those of the environment")]
    fn new(
        py: Python<'_>,
        scenario: &Bound<'_, PyScenario>,
        fields: Option<u64>,
        observation: Vec<String>,
        nearest: Option<usize>,
        action: &str,
        reward: &str,
        prepare: Option<Py<PyAny>>,
        return_rule: bool,
    ) -> PyResult<Self> {
        let rules = Rules::of(py, Kind::One, fields, &observation, nearest, action, reward, prepare, return_rule)?;
        Ok(Self { episode: Episode::first(scenario.get(), &Arc::new(rules))?, plans: Vec::new() })
    }

    /// Begins the first episode over another scenario.
    fn replace(&mut self, scenario: &Bound<'_, PyScenario>) -> PyResult<()> {
        self.episode = self.episode.over(scenario.get())?;
        self.plans.clear();
        Ok(())
    }

    /// Names, shapes and least numbers of what is observed.
    #[getter]
    fn observed(&self) -> Vec<(&'static str, Vec<usize>, f64)> {
        self.episode.boxes()
    }

    /// Number of coordinates of an action, or of sensor nodes to choose from.
    #[getter]
    fn action_size(&self) -> usize {
        self.episode.action_size()
    }

    fn action_masks<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        PyArray1::from_vec(py, self.episode.action_mask())
    }

    #[getter]
    fn belief(&self, py: Python<'_>) -> PyResult<PyBelief> {
        let Episode { field, plant, contacts, .. } = &self.episode;
        let sampling_bps = believed_bps(py, plant, field)?;
        let believed = believed(plant, field);
        PyBelief::of(py, &believed, field, &self.queues_bits(py), &sampling_bps, contacts, plant.slot())
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

    fn step<'py>(&mut self, py: Python<'py>, action: &Bound<'py, PyAny>) -> PyResult<Step<'py>> {
        let decision = Actions::one(&self.episode, action)?.decision(0, &self.episode);
        let plan = self.episode.ruled(decision, Mode::Serve);
        self.fly_plan(py, plan)
    }

    #[pyo3(signature = (decision, transit = false))]
    fn fly<'py>(&mut self, py: Python<'py>, decision: &Bound<'py, PyDecision>, transit: bool) -> PyResult<Step<'py>> {
        let mode = if transit { Mode::Transit } else { Mode::Serve };
        let plan = self.episode.decided(decision.get(), mode)?;
        self.fly_plan(py, plan)
    }

    /// Flies the next slot by the plan of a built-in strategy.
    fn follow<'py>(&mut self, py: Python<'py>, strategy: &str) -> PyResult<Step<'py>> {
        let plans = interruptible(py, |stop| self.episode.expert_plans(strategy, stop))??;
        self.fly_plan(py, plans[UAV])
    }

    /// The action that comes closest to the plan of a built-in strategy.
    fn expert<'py>(&mut self, py: Python<'py>, strategy: &str) -> PyResult<Bound<'py, PyAny>> {
        let is_choice = self.episode.control() == Control::Sensor;
        let mut action = vec![0.0; if is_choice { 1 } else { self.episode.action_size() }];
        interruptible(py, |stop| self.episode.write_expert(strategy, stop, &mut action))??;
        if is_choice {
            return Ok((action[0] as i64).into_pyobject(py)?.into_any());
        }
        Ok(PyArray1::from_vec(py, action).into_any())
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
        let plans = self.plans.iter().map(|plan| Plans::from_buf([Some(**plan)]));
        let list = SensorList::clone(&self.episode.list);
        PyRun::of_plans(scenario, list, plans, python_mode(label, Vec::new())).map_err(of_mission)
    }
}
