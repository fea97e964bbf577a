//! The core of the environments: episodes that are flown by actions. The Gymnasium environment has one, its vector many
//! of one UAV, and the batch of several agents many of several.

use std::sync::Arc;

use numpy::{
    PyArray1, PyArrayDyn, PyArrayMethods as _, PyReadwriteArray1, PyReadwriteArray2, PyReadwriteArray3,
    PyUntypedArrayMethods as _,
};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use skysink_common::message::{Mode, Plan};
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::{Plans, UAV};
use skysink_planner::strategies::PYTHON;

use crate::batch::{begin_over, check, each, expect, fly};
use crate::belief::PyBelief;
use crate::control;
use crate::episode::{Episode, Outcome};
use crate::errors::{of_mission, refused};
use crate::field::PyField;
use crate::observation::Observations;
use crate::rules::{Control, Kind, Observed, Reward, Rules};
use crate::run::{PyRun, python_mode};
use crate::scenario::PyScenario;
use crate::signals::interruptible;
use crate::simulate::checked_label;
use crate::strategy::PyDecision;
use crate::values::read_only;

/// Maximum number of environments of a vector.
const MAX_ENVIRONMENTS: usize = 100_000;

/// Observation, reward, terminated, truncated, information.
type Step<'py> = (Bound<'py, PyDict>, f64, bool, bool, Bound<'py, PyDict>);

/// Observation, rewards, whether the UAVs are down, whether the missions are over, lost bits, delivered bits.
type Steps<'py> = (
    Bound<'py, PyDict>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<u64>>,
    Bound<'py, PyArray1<u64>>,
);

/// The environments without their spaces: E episodes of U UAVs each.
#[pyclass(name = "EnvironmentCore", module = "skysink")]
#[derive(Clone)]
pub struct PyEnvironmentCore {
    episodes: Vec<Episode>,
    /// The actions of the last step, whose room the next one uses.
    actions: Vec<f32>,
    /// The plans of a single episode so far, shared with clones.
    plans: Vec<Arc<Plan>>,
}

impl PyEnvironmentCore {
    fn width(&self) -> usize {
        self.episodes[0].width()
    }

    /// The numbers of the episodes with these seeds, or the next ones, where a mask has `masked` entries. Refuses those
    /// that have no seed.
    fn numbers_of(&self, seeds: Vec<Option<u64>>, masked: usize) -> PyResult<Vec<u64>> {
        let expected = self.episodes.len();
        if [seeds.len(), masked] != [expected; 2] {
            let seeds = seeds.len();
            return Err(refused(format!("{seeds} seeds, reset_mask of {masked}: expected {expected} of each")));
        }
        let count = expected as u64;
        let number = |(episode, seed): (&Episode, Option<u64>)| {
            let number = seed.unwrap_or_else(|| episode.following(count));
            episode.course.checked_seed(number).map(|_| number)
        };
        self.episodes.iter().zip(seeds).map(number).collect()
    }

    /// Refuses observations of another shape than [E, U, width].
    fn expect_observations(&self, observations: &PyReadwriteArray3<'_, f32>) -> PyResult<()> {
        let expected = [self.episodes.len(), self.agents(), self.width()];
        expect("observations", observations.shape(), &expected, observations.is_c_contiguous())
    }

    /// Flies the next slot of a single episode.
    fn fly_plan<'py>(&mut self, py: Python<'py>, plan: Plan) -> PyResult<Step<'py>> {
        let episode = &mut self.episodes[0];
        if episode.is_over() {
            return Err(refused("the episode is over: expected reset()"));
        }
        let Outcome { reward, delivered_bits, lost_bits, is_over, is_down } = episode.fly(&[Some(plan)]);
        self.plans.push(Arc::new(plan));
        let information = PyDict::new(py);
        information.set_item(intern!(py, "lost_bits"), lost_bits)?;
        information.set_item(intern!(py, "delivered_bits"), delivered_bits)?;
        if episode.control() == Control::Sensor {
            information.set_item(intern!(py, "action_mask"), PyArray1::from_vec(py, episode.action_mask()))?;
        }
        let mut observed = Observations::of(&self.episodes);
        self.episodes[0].observe(&mut observed.rows().0);
        let observation = observed.into_dict(py, &self.episodes[0])?;
        Ok((observation, reward, is_down, is_over && !is_down, information))
    }
}

#[pymethods]
impl PyEnvironmentCore {
    /// `count` environments, or a single one, that of one mission. `agents`: whether the scenario may have several
    /// UAVs, whose actions and rewards then are arrays of one more dimension.
    #[new]
    #[expect(clippy::too_many_arguments, reason = "those of the environment")]
    fn new(
        py: Python<'_>,
        scenarios: Vec<Bound<'_, PyScenario>>,
        agents: bool,
        count: Option<usize>,
        fields: Option<u64>,
        observation: Vec<String>,
        nearest: Option<usize>,
        action: &str,
        reward: &str,
        prepare: Option<Py<PyAny>>,
        return_rule: bool,
    ) -> PyResult<Self> {
        let kind = match count {
            None => Kind::One,
            Some(_) if agents => Kind::Agents,
            Some(_) => Kind::Vector,
        };
        let count = count.unwrap_or(1);
        if !(1..=MAX_ENVIRONMENTS).contains(&count) {
            return Err(refused(format!("num_envs = {count}: expected 1 to {MAX_ENVIRONMENTS}")));
        }
        check(scenarios.len(), count)?;
        if fields == Some(0) {
            return Err(refused("fields = 0: expected 1 or more, or None"));
        }
        let rules = Arc::new(Rules {
            fields,
            observed: Observed::of(py, kind, &observation, nearest)?,
            control: Control::named(action)?,
            reward: Reward::named(reward, kind)?,
            prepare,
            has_return_rule: return_rule,
            kind,
        });
        let mut firsts = vec![Episode::first(scenarios[0].get(), &rules)?];
        if firsts[0].width() == 0 {
            return Err(refused(format!("observation = {observation:?}: expected more, or several UAVs")));
        }
        for scenario in &scenarios[1..] {
            firsts.push(firsts[0].over(scenario.get())?);
        }
        let mut episodes = vec![firsts[0].clone(); count];
        begin_over(&mut episodes, &firsts, &vec![true; count])?;
        Ok(Self { episodes, actions: Vec::new(), plans: Vec::new() })
    }

    /// Begins the first episodes over other scenarios, where `mask` is true. Environment i gets scenario i, modulo
    /// their number.
    fn replace(&mut self, scenarios: Vec<Bound<'_, PyScenario>>, mask: Vec<bool>) -> PyResult<()> {
        let mut episodes = self.episodes.clone();
        check(scenarios.len(), episodes.len())?;
        if mask.len() != episodes.len() {
            return Err(refused(format!("reset_mask of {}: expected {}", mask.len(), episodes.len())));
        }
        let firsts = scenarios.iter().map(|scenario| episodes[0].over(scenario.get())).collect::<PyResult<Vec<_>>>()?;
        begin_over(&mut episodes, &firsts, &mask)?;
        self.episodes = episodes;
        self.plans.clear();
        Ok(())
    }

    /// Names, shapes and least numbers of what is observed by one agent.
    #[getter]
    fn observed(&self) -> Vec<(&'static str, Vec<usize>, f64)> {
        self.episodes[0].boxes()
    }

    /// Number of coordinates of an action, or of sensor nodes to choose from.
    #[getter]
    fn action_size(&self) -> usize {
        self.episodes[0].action_size()
    }

    /// Number of agents of an environment.
    #[getter]
    fn agents(&self) -> usize {
        self.episodes[0].plant.flights().len()
    }

    #[getter]
    fn seeds(&self) -> Vec<u64> {
        self.episodes.iter().map(Episode::seed).collect()
    }

    #[getter]
    fn numbers(&self) -> Vec<u64> {
        self.episodes.iter().map(|episode| episode.number).collect()
    }

    #[getter]
    fn field(&self) -> PyField {
        PyField::new(Arc::clone(&self.episodes[0].field))
    }

    #[getter]
    fn belief(&self, py: Python<'_>) -> PyResult<PyBelief> {
        let episode = &self.episodes[0];
        PyBelief::of(py, &episode.view(), &self.queues_bits(py), &self.sampling_bps(py)?, &episode.contacts)
    }

    #[getter]
    fn uav(&self) -> (f64, f64, f64) {
        let position = self.episodes[0].plant.flight(UAV).position();
        (position.x, position.y, position.z)
    }

    #[getter]
    fn queues_bits<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        PyArray1::from_slice(py, self.episodes[0].plant.field().believed_bits())
    }

    #[getter]
    fn sampling_bps<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let Episode { field, plant, .. } = &self.episodes[0];
        match plant.field().belief().learnt_bps(field.limits.slot_s) {
            Some(learnt_bps) => read_only(PyArray1::from_iter(py, learnt_bps)),
            None => field.sampling_bps(py),
        }
    }

    /// Lost and delivered bits of each mission so far.
    #[getter]
    fn totals<'py>(&self, py: Python<'py>) -> (Bound<'py, PyArray1<u64>>, Bound<'py, PyArray1<u64>>) {
        let totals = || self.episodes.iter().map(|episode| episode.plant.header().totals);
        let lost_bits = PyArray1::from_iter(py, totals().map(|totals| totals.lost_bits));
        (lost_bits, PyArray1::from_iter(py, totals().map(|totals| totals.delivered_bits)))
    }

    /// Begins the episodes with these seeds, or the next ones, where `mask` is true; what all observe, by quantity.
    fn reset<'py>(
        &mut self,
        py: Python<'py>,
        seeds: Vec<Option<u64>>,
        mask: Vec<bool>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let numbers = self.numbers_of(seeds, mask.len())?;
        let mut observed = Observations::of(&self.episodes);
        let (mut rows, kinds) = observed.rows();
        let entries = numbers.into_iter().zip(mask).zip(rows.chunks_mut(kinds));
        py.detach(|| {
            each(&mut self.episodes, entries, |_, episode, ((number, is_reset), rows)| {
                if is_reset {
                    episode.reset(number)?;
                }
                episode.observe(rows);
                Ok(())
            })
        })?;
        self.plans.clear();
        observed.into_dict(py, &self.episodes[0])
    }

    /// Begins all episodes with these seeds, or the next ones, and observes all, [E, U, width].
    fn reset_into(
        &mut self,
        py: Python<'_>,
        seeds: Vec<Option<u64>>,
        mut observations: PyReadwriteArray3<'_, f32>,
    ) -> PyResult<()> {
        let numbers = self.numbers_of(seeds, self.episodes.len())?;
        self.expect_observations(&observations)?;
        let row = self.agents() * self.width();
        let entries = numbers.into_iter().zip(observations.as_slice_mut()?.chunks_mut(row));
        py.detach(|| {
            each(&mut self.episodes, entries, |_, episode, (number, observed)| {
                episode.reset(number)?;
                episode.observe_flat(observed);
                Ok(())
            })
        })
    }

    /// Flies one slot of a single episode by an action.
    fn step_one<'py>(&mut self, py: Python<'py>, action: &Bound<'py, PyAny>) -> PyResult<Step<'py>> {
        let episode = &mut self.episodes[0];
        self.actions = control::one(episode, action)?;
        let decision = episode.decision(&self.actions);
        let plan = episode.ruled(decision, Mode::Serve, None);
        self.fly_plan(py, plan)
    }

    /// The same by a decision of a strategy.
    fn fly<'py>(&mut self, py: Python<'py>, decision: &Bound<'py, PyDecision>, transit: bool) -> PyResult<Step<'py>> {
        let mode = if transit { Mode::Transit } else { Mode::Serve };
        let plan = self.episodes[0].decided(decision.get(), mode)?;
        self.fly_plan(py, plan)
    }

    /// The same by the plan of a built-in strategy.
    fn follow<'py>(&mut self, py: Python<'py>, strategy: &str) -> PyResult<Step<'py>> {
        let plans = interruptible(py, |stop| self.episodes[0].expert_plans(strategy, stop))??;
        self.fly_plan(py, plans[UAV])
    }

    /// Flies one slot of every episode. An episode that is over is replaced by the next one of its environment instead.
    fn step<'py>(&mut self, py: Python<'py>, actions: &Bound<'py, PyAny>) -> PyResult<Steps<'py>> {
        let Self { episodes, actions: flown, .. } = self;
        let count = episodes.len();
        control::read(episodes, actions, flown)?;
        let mut outcomes = vec![Outcome::default(); count];
        let mut observed = Observations::of(episodes);
        let (mut rows, kinds) = observed.rows();
        let entries = outcomes.iter_mut().zip(rows.chunks_mut(kinds));
        py.detach(|| {
            each(episodes, entries, |index, episode, (outcome, rows)| {
                *outcome = fly(index, count, episode, flown, &mut [])?;
                episode.observe(rows);
                Ok(())
            })
        })?;
        Ok((
            observed.into_dict(py, &self.episodes[0])?,
            PyArray1::from_iter(py, outcomes.iter().map(|outcome| outcome.reward)),
            PyArray1::from_iter(py, outcomes.iter().map(|outcome| outcome.is_down)),
            PyArray1::from_iter(py, outcomes.iter().map(|outcome| outcome.is_over && !outcome.is_down)),
            PyArray1::from_iter(py, outcomes.iter().map(|outcome| outcome.lost_bits)),
            PyArray1::from_iter(py, outcomes.iter().map(|outcome| outcome.delivered_bits)),
        ))
    }

    /// The same, and writes into the other arrays: observations [E, U, width], rewards [E, U], terminated and truncated
    /// [E].
    fn step_into(
        &mut self,
        py: Python<'_>,
        actions: &Bound<'_, PyAny>,
        mut observations: PyReadwriteArray3<'_, f32>,
        mut rewards: PyReadwriteArray2<'_, f32>,
        mut terminated: PyReadwriteArray1<'_, bool>,
        mut truncated: PyReadwriteArray1<'_, bool>,
    ) -> PyResult<()> {
        let count = self.episodes.len();
        let uavs = self.agents();
        let width = self.width();
        if !self.episodes[0].has_begun {
            return Err(refused("no episode has begun: expected reset_into()"));
        }
        self.expect_observations(&observations)?;
        expect("rewards", rewards.shape(), &[count, uavs], rewards.is_c_contiguous())?;
        expect("terminated", terminated.shape(), &[count], terminated.is_c_contiguous())?;
        expect("truncated", truncated.shape(), &[count], truncated.is_c_contiguous())?;
        let Self { episodes, actions: flown, .. } = self;
        control::read(episodes, actions, flown)?;
        let ends = terminated.as_slice_mut()?.iter_mut().zip(truncated.as_slice_mut()?);
        let rows = observations.as_slice_mut()?.chunks_mut(uavs * width);
        let entries = rows.zip(rewards.as_slice_mut()?.chunks_mut(uavs)).zip(ends);
        py.detach(|| {
            each(episodes, entries, |index, episode, ((observed, rewards), (down, over))| {
                let outcome = fly(index, count, episode, flown, rewards)?;
                (*down, *over) = (outcome.is_down, outcome.is_over && !outcome.is_down);
                episode.observe_flat(observed);
                Ok(())
            })
        })
    }

    /// For each agent whether each sensor node to choose from is within the reach of one slot, [size], [E, size] or [E,
    /// U, size].
    fn action_masks<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<bool>>> {
        let size = self.action_size();
        let of_episode = self.agents() * size;
        let mut masks = vec![false; self.episodes.len() * of_episode];
        py.detach(|| {
            each(&mut self.episodes, masks.chunks_mut(of_episode), |_, episode, masks| {
                for (uav, mask) in masks.chunks_mut(size).enumerate() {
                    episode.act_as(uav);
                    mask.copy_from_slice(&episode.action_mask());
                }
                Ok(())
            })
        })?;
        PyArray1::from_vec(py, masks).reshape(control::shape(&self.episodes, &[size]))
    }

    /// The actions that come closest to the plans of a built-in strategy, [size], [E, size] or [E, U, size], or [], [E]
    /// or [E, U] of sensor nodes; 0 where one of several episodes is over.
    fn expert<'py>(&mut self, py: Python<'py>, strategy: &str) -> PyResult<Bound<'py, PyAny>> {
        let of_episode = self.agents() * self.episodes[0].action_width();
        let mut actions = vec![0.0; self.episodes.len() * of_episode];
        interruptible(py, |stop| {
            each(&mut self.episodes, actions.chunks_mut(of_episode), |_, episode, into| {
                match episode.is_over() && episode.rules().kind != Kind::One {
                    true => Ok(()),
                    false => episode.write_expert(strategy, stop, into),
                }
            })
        })??;
        if self.episodes[0].control() == Control::Sensor {
            let choices = PyArray1::from_iter(py, actions.iter().map(|&choice| choice as i64));
            let choices = choices.reshape(control::shape(&self.episodes, &[]))?.into_any();
            return if self.episodes[0].rules().kind == Kind::One { choices.call_method0("item") } else { Ok(choices) };
        }
        let shape = control::shape(&self.episodes, &[self.action_size()]);
        Ok(PyArray1::from_vec(py, actions).reshape(shape)?.into_any())
    }

    /// The state of the first environment: positions of all UAVs as fractions, the queues as fractions, the slot.
    fn state<'py>(&mut self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        PyArray1::from_vec(py, self.episodes[0].state())
    }

    fn clone(&self) -> Self {
        Clone::clone(self)
    }

    /// A copy of one environment of a vector, by its number from 0.
    fn alone(&self, index: usize) -> PyResult<Self> {
        let count = self.episodes.len();
        let episode = self.episodes.get(index);
        let episode = episode.ok_or_else(|| refused(format!("environment {index}: expected 0 to {}", count - 1)))?;
        Ok(Self { episodes: vec![episode.clone()], actions: Vec::new(), plans: Vec::new() })
    }

    /// The episodes as bytes, and the plans of the slots of a single one.
    fn save(&self) -> (Vec<Vec<u8>>, Vec<u8>) {
        let plans: Vec<Plan> = self.plans.iter().map(|plan| **plan).collect();
        (self.episodes.iter().map(Episode::save).collect(), bytemuck::cast_slice(&plans).to_vec())
    }

    fn restore(&mut self, saved: (Vec<Vec<u8>>, Vec<u8>)) -> PyResult<()> {
        let (episodes, plans) = saved;
        if episodes.len() != self.episodes.len() {
            return Err(refused(format!("{} episodes: expected {}", episodes.len(), self.episodes.len())));
        }
        self.episodes.iter_mut().zip(episodes).try_for_each(|(episode, bytes)| episode.restore(&bytes))?;
        self.plans = bytemuck::pod_collect_to_vec(&plans).into_iter().map(Arc::new).collect();
        Ok(())
    }

    /// The slots of a single episode so far, as a run.
    fn run(&self, label: &str) -> PyResult<PyRun> {
        let label = checked_label(label)?;
        let episode = &self.episodes[0];
        let scenario =
            PyScenario::on_record(&episode.course.prepared(episode.number)?)?.flown_by(&format!("{PYTHON}{label}"))?;
        let plans = self.plans.iter().map(|plan| Plans::from_buf([Some(**plan)]));
        let list = SensorList::clone(&episode.list);
        PyRun::of_plans(scenario, list, plans, python_mode(label, Vec::new())).map_err(of_mission)
    }
}
