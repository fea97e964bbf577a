//! The core of the environments of several agents: many episodes of a fleet in parallel, stepped in place.

use std::sync::Arc;

use numpy::{
    PyArray1, PyReadonlyArray2, PyReadonlyArray3, PyReadwriteArray1, PyReadwriteArray2, PyReadwriteArray3,
    PyUntypedArrayMethods as _,
};
use pyo3::prelude::*;
use rayon::prelude::*;
use skysink_common::geometry::within;
use skysink_common::message::{Mode, Plan};
use skysink_common::slot_record::Plans;

use crate::batch::{BATCH, MAX_ENVIRONMENTS, begun_over, check, pool};
use crate::episode::{Episode, Outcome};
use crate::errors::refused;
use crate::field::PyField;
use crate::rules::{Control, Reward, Rules};
use crate::scenario::PyScenario;

/// The actions of all agents: components of displacements or waypoints, or numbers of sensor nodes.
enum AgentActions<'a> {
    Components(&'a [f32]),
    Choices(&'a [i64]),
}

/// The environments without their spaces: E episodes of U UAVs each.
#[pyclass(name = "FleetCore", module = "skysink")]
#[derive(Clone)]
pub struct PyFleetCore {
    episodes: Vec<Episode>,
    /// Whether rewards are difference rewards instead of that of the team.
    is_difference: bool,
}

/// Refuses an array of another shape, or one that is not C-contiguous.
fn expect(name: &str, shape: &[usize], expected: &[usize], is_contiguous: bool) -> PyResult<()> {
    if shape != expected || !is_contiguous {
        return Err(refused(format!("{name} of shape {shape:?}: expected {expected:?}, C-contiguous")));
    }
    Ok(())
}

/// Bits delivered by sensor node `id` so far.
fn delivered_bits(episode: &Episode, id: u32) -> u64 {
    episode.plant.field().delivered_bits()[id as usize]
}

impl PyFleetCore {
    fn uavs(&self) -> usize {
        self.episodes[0].plant.flights().len()
    }

    fn width(&self) -> usize {
        self.episodes[0].width()
    }
}

/// Writes the observations of all agents of `episode`.
fn observe(episode: &mut Episode, numbers: &mut [f32]) {
    let width = episode.width();
    for uav in 0..episode.plant.flights().len() {
        episode.uav = uav;
        episode.observe_flat(&mut numbers[uav * width..][..width]);
    }
}

/// The plans of all agents of `episode`, which is number `index`.
fn plans(episode: &mut Episode, index: usize, actions: &AgentActions) -> Plans {
    let uavs = episode.plant.flights().len();
    let mut plans = Plans::new();
    for uav in 0..uavs {
        episode.uav = uav;
        let agent = index * uavs + uav;
        let plan = match actions {
            AgentActions::Choices(choices) => episode.plan_choice(choices[agent] as usize),
            AgentActions::Components(components) => {
                let axes = episode.axes();
                episode.plan_components(&components[agent * axes..][..axes])
            }
        };
        plans.push(Some(episode.ruled(plan)));
    }
    plans
}

/// The difference reward of each UAV: the bits that are delivered because of it, as a fraction of the mean bits that are sampled
/// in a slot. What another UAV would have collected in its place does not count.
fn differences(episode: &mut Episode, plans: &Plans, rewards: &mut [f32]) -> Outcome {
    let scheduled = |plan: &Option<Plan>| plan.as_ref().map_or(&[][..], |plan| plan.scheduled()).to_vec();
    let ids: Vec<Vec<u32>> = plans.iter().map(scheduled).collect();
    let before: Vec<Vec<u64>> =
        ids.iter().map(|ids| ids.iter().map(|&id| delivered_bits(episode, id)).collect()).collect();
    let outcome = episode.fly(plans);
    let slot_bits = (episode.expected_bits / episode.field.limits.slots as f64).max(f64::MIN_POSITIVE);
    let reaches = |uav: usize, id: u32| {
        let flight = episode.plant.flight(uav);
        let serves = !matches!(flight.flown_mode(), Mode::Hold | Mode::Charge | Mode::Down);
        let (sensor, radius_m) = (episode.field.sensors.position(id), episode.field.limits.comm_radius_m);
        serves && ids[uav].contains(&id) && within(sensor, &flight.position().xy(), radius_m)
    };
    for (uav, reward) in rewards.iter_mut().enumerate() {
        let own = ids[uav].iter().zip(&before[uav]).filter(|(id, _)| {
            let is_served = episode.plant.flight(uav).serves(**id);
            is_served && !(0..ids.len()).any(|other| other != uav && reaches(other, **id))
        });
        let bits: u64 = own.map(|(id, before)| delivered_bits(episode, *id) - before).sum();
        *reward = (bits as f64 / slot_bits) as f32;
    }
    outcome
}

#[pymethods]
impl PyFleetCore {
    #[new]
    #[expect(clippy::too_many_arguments, reason = "those of the environment")]
    fn new(
        py: Python<'_>,
        scenarios: Vec<Bound<'_, PyScenario>>,
        count: usize,
        fields: Option<u64>,
        observation: Vec<String>,
        nearest: Option<usize>,
        action: &str,
        reward: &str,
        prepare: Option<Py<PyAny>>,
        return_rule: bool,
    ) -> PyResult<Self> {
        if !(1..=MAX_ENVIRONMENTS).contains(&count) {
            return Err(refused(format!("num_envs = {count}: expected 1 to {MAX_ENVIRONMENTS}")));
        }
        check(scenarios.len(), count)?;
        let is_difference = reward == "difference";
        if !is_difference && Reward::named(reward).is_err() {
            let expected = "lost, weighted, age, loss_fraction or difference";
            return Err(refused(format!("reward = {reward:?}: expected {expected}")));
        }
        let reward = if is_difference { "lost" } else { reward };
        let rules = Rules::of(py, fields, &observation, nearest, action, reward, prepare, return_rule)?.of_fleet();
        let first = Episode::first(scenarios[0].get(), &Arc::new(rules))?;
        let episodes = begun_over(&vec![first; count], &scenarios, &vec![true; count])?;
        Ok(Self { episodes, is_difference })
    }

    /// Begins the first episodes over other scenarios, where `mask` is true.
    fn replace(&mut self, scenarios: Vec<Bound<'_, PyScenario>>, mask: Vec<bool>) -> PyResult<()> {
        self.episodes = begun_over(&self.episodes, &scenarios, &mask)?;
        Ok(())
    }

    /// Names, shapes and least numbers of what is observed by one agent.
    #[getter]
    fn observed(&self) -> Vec<(&'static str, Vec<usize>, f64)> {
        self.episodes[0].boxes()
    }

    /// How many numbers an agent observes.
    #[getter]
    fn observation_size(&self) -> usize {
        self.width()
    }

    /// Number of coordinates of an action, or of sensor nodes to choose from.
    #[getter]
    fn action_size(&self) -> usize {
        self.episodes[0].action_size()
    }

    /// Number of agents of an environment.
    #[getter]
    fn agents(&self) -> usize {
        self.uavs()
    }

    #[getter]
    fn seeds(&self) -> Vec<u64> {
        self.episodes.iter().map(Episode::seed).collect()
    }

    #[getter]
    fn numbers(&self) -> Vec<u64> {
        self.episodes.iter().map(Episode::number).collect()
    }

    #[getter]
    fn field(&self) -> PyField {
        PyField::new(Arc::clone(&self.episodes[0].field))
    }

    /// Lost and delivered bits of each mission so far.
    #[getter]
    fn totals<'py>(&self, py: Python<'py>) -> [Bound<'py, PyArray1<u64>>; 2] {
        let totals = || self.episodes.iter().map(|episode| episode.plant.header().totals);
        [
            PyArray1::from_iter(py, totals().map(|totals| totals.lost_bits)),
            PyArray1::from_iter(py, totals().map(|totals| totals.delivered_bits)),
        ]
    }

    /// Begins the episodes with these numbers, where `mask` is true, and observes all, [E, U, width].
    fn reset_into(
        &mut self,
        py: Python<'_>,
        numbers: Vec<u64>,
        mask: Vec<bool>,
        mut observations: PyReadwriteArray3<'_, f32>,
    ) -> PyResult<()> {
        let count = self.episodes.len();
        if [numbers.len(), mask.len()] != [count; 2] {
            let [seeds, mask] = [numbers.len(), mask.len()];
            return Err(refused(format!("{seeds} seeds, reset_mask of {mask}: expected {count} of each")));
        }
        self.episodes.iter().zip(&numbers).try_for_each(|(episode, &number)| episode.check(number))?;
        let row = self.uavs() * self.width();
        expect(
            "observations",
            observations.as_array().shape(),
            &[count, self.uavs(), self.width()],
            observations.is_c_contiguous(),
        )?;
        let numbers_of = observations.as_slice_mut()?;
        let episodes = &mut self.episodes;
        py.detach(|| {
            pool()?.install(|| {
                let all = episodes.par_iter_mut().zip(numbers_of.par_chunks_mut(row)).zip(numbers).zip(mask);
                all.with_min_len(BATCH).try_for_each(|(((episode, observed), number), is_reset)| {
                    if is_reset {
                        episode.begin(number)?;
                    }
                    observe(episode, observed);
                    PyResult::Ok(())
                })
            })
        })
    }

    /// Flies one slot of every episode, and writes into the other arrays: observations [E, U, width], rewards [E, U],
    /// terminated and truncated [E]. An episode that is over is replaced by the next one of its environment instead.
    ///
    /// Actions are float32 [E, U, size], or int64 [E, U] if they are sensor nodes.
    fn step_into(
        &mut self,
        py: Python<'_>,
        actions: &Bound<'_, PyAny>,
        mut observations: PyReadwriteArray3<'_, f32>,
        mut rewards: PyReadwriteArray2<'_, f32>,
        mut terminated: PyReadwriteArray1<'_, bool>,
        mut truncated: PyReadwriteArray1<'_, bool>,
    ) -> PyResult<()> {
        let (count, uavs, width) = (self.episodes.len(), self.uavs(), self.width());
        let size = self.episodes[0].action_size();
        expect("observations", observations.as_array().shape(), &[count, uavs, width], observations.is_c_contiguous())?;
        expect("rewards", rewards.as_array().shape(), &[count, uavs], rewards.is_c_contiguous())?;
        expect("terminated", terminated.as_array().shape(), &[count], terminated.is_c_contiguous())?;
        expect("truncated", truncated.as_array().shape(), &[count], truncated.is_c_contiguous())?;
        let choices;
        let components;
        let actions = if self.episodes[0].control() == Control::Sensor {
            choices = actions.extract::<PyReadonlyArray2<'_, i64>>()?;
            let array = choices.as_array();
            expect("actions", array.shape(), &[count, uavs], array.is_standard_layout())?;
            let choices = choices.as_slice()?;
            if let Some(choice) = choices.iter().copied().find(|choice| !(0..size as i64).contains(choice)) {
                return Err(refused(format!("action {choice}: expected 0 to {}", size - 1)));
            }
            AgentActions::Choices(choices)
        } else {
            components = actions.extract::<PyReadonlyArray3<'_, f32>>()?;
            let array = components.as_array();
            expect("actions", array.shape(), &[count, uavs, size], array.is_standard_layout())?;
            let components = components.as_slice()?;
            if let Some(component) = components.iter().find(|component| !component.is_finite()) {
                let range = self.episodes[0].range();
                return Err(refused(format!("action {component}: expected finite numbers, {range}")));
            }
            AgentActions::Components(components)
        };
        let (observed, rewards) = (observations.as_slice_mut()?, rewards.as_slice_mut()?);
        let ends = terminated.as_slice_mut()?.par_iter_mut().zip(truncated.as_slice_mut()?);
        let is_difference = self.is_difference;
        let episodes = &mut self.episodes;
        py.detach(|| {
            pool()?.install(|| {
                let rows = observed.par_chunks_mut(uavs * width).zip(rewards.par_chunks_mut(uavs)).zip(ends);
                let all = episodes.par_iter_mut().enumerate().zip(rows);
                all.with_min_len(BATCH).try_for_each(|((index, episode), ((observed, rewards), (down, over)))| {
                    (*down, *over) = (false, false);
                    if episode.is_over() {
                        rewards.fill(0.0);
                        episode.begin(episode.number() + count as u64)?;
                    } else {
                        let plans = plans(episode, index, &actions);
                        let outcome = if is_difference {
                            differences(episode, &plans, rewards)
                        } else {
                            let outcome = episode.fly(&plans);
                            rewards.fill(outcome.reward as f32);
                            outcome
                        };
                        (*down, *over) = (outcome.is_down, outcome.is_over && !outcome.is_down);
                    }
                    observe(episode, observed);
                    PyResult::Ok(())
                })
            })
        })
    }

    /// Writes for each agent whether each sensor node to choose from is within the reach of one slot, [E, U, size].
    fn action_masks_into(&mut self, mut masks: PyReadwriteArray3<'_, bool>) -> PyResult<()> {
        let (count, uavs, size) = (self.episodes.len(), self.uavs(), self.episodes[0].action_size());
        expect("masks", masks.as_array().shape(), &[count, uavs, size], masks.is_c_contiguous())?;
        let agents = masks.as_slice_mut()?.chunks_mut(size);
        for (agent, mask) in agents.enumerate() {
            let episode = &mut self.episodes[agent / uavs];
            episode.uav = agent % uavs;
            mask.copy_from_slice(&episode.action_mask());
        }
        Ok(())
    }

    /// The state of the first environment: positions of all UAVs as fractions, the queues as fractions, the slot.
    fn state<'py>(&mut self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        let episode = &self.episodes[0];
        let limits = episode.field.limits;
        let position = |flight: &skysink_common::message::FlightReport| {
            let at = flight.position();
            [at.x / limits.width_m, at.y / limits.height_m].map(|fraction| fraction.clamp(0.0, 1.0) as f32)
        };
        let queues = episode.plant.field().believed_bits().iter().zip(&episode.field.buffers_bits);
        let slot = (episode.plant.slot() as f64 / limits.slots as f64) as f32;
        let numbers = episode.plant.flights().iter().flat_map(position);
        let numbers = numbers.chain(queues.map(|(&bits, buffer_bits)| bits as f32 / buffer_bits));
        PyArray1::from_iter(py, numbers.chain([slot]))
    }

    fn clone(&self) -> Self {
        Clone::clone(self)
    }

    fn save(&self) -> Vec<Vec<u8>> {
        self.episodes.iter().map(Episode::save).collect()
    }

    fn restore(&mut self, saved: Vec<Vec<u8>>) -> PyResult<()> {
        if saved.len() != self.episodes.len() {
            return Err(refused(format!("{} episodes: expected {}", saved.len(), self.episodes.len())));
        }
        self.episodes.iter_mut().zip(saved).try_for_each(|(episode, bytes)| episode.restore(&bytes))
    }
}
