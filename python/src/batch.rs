//! The core of the environments that fly many episodes in parallel: the Gymnasium vector, and the batch of several
//! agents.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use numpy::{
    PyArray1, PyArrayDyn, PyArrayMethods as _, PyReadwriteArray1, PyReadwriteArray2, PyReadwriteArray3,
    PyUntypedArrayMethods as _,
};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use skysink_common::message::FlightReport;

use crate::control::Actions;
use crate::episode::{Episode, NEVER, Outcome};
use crate::errors::refused;
use crate::field::PyField;
use crate::observation::Observations;
use crate::reward::differences;
use crate::rules::{Control, Kind, Reward, Rules};
use crate::scenario::PyScenario;

/// Episodes per task.
const BATCH: usize = 8;

/// Maximum number of environments of a vector.
const MAX_ENVIRONMENTS: usize = 100_000;

/// The thread pool of this process. A forked process needs its own.
fn pool() -> PyResult<Arc<ThreadPool>> {
    static POOL: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);
    let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    let process = std::process::id();
    match &*pool {
        Some((owner, threads)) if *owner == process => Ok(Arc::clone(threads)),
        _ => {
            let threads = Arc::new(ThreadPoolBuilder::new().build().map_err(refused)?);
            std::mem::forget(pool.replace((process, Arc::clone(&threads)))); // dropping it would wait for its threads
            Ok(threads)
        }
    }
}

/// Refuses more scenarios than environments, or none.
fn check(scenarios: usize, count: usize) -> PyResult<()> {
    if !(1..=count).contains(&scenarios) {
        return Err(refused(format!("{scenarios} scenarios: expected 1 to {count}, the number of environments")));
    }
    Ok(())
}

/// The `episodes` with the first ones over other scenarios where `mask` is true. Environment i gets scenario i, modulo
/// their number.
fn begun_over(episodes: &[Episode], scenarios: &[Bound<'_, PyScenario>], mask: &[bool]) -> PyResult<Vec<Episode>> {
    check(scenarios.len(), episodes.len())?;
    if mask.len() != episodes.len() {
        return Err(refused(format!("reset_mask of {}: expected {}", mask.len(), episodes.len())));
    }
    let over = |scenario: &Bound<'_, PyScenario>| episodes[0].over(scenario.get());
    let firsts = scenarios.iter().map(over).collect::<PyResult<Vec<Episode>>>()?;
    let mut episodes = episodes.to_vec();
    let mut begun: HashMap<(usize, u64), usize> = HashMap::new(); // episodes over the same field share it
    for index in (0..episodes.len()).filter(|&index| mask[index]) {
        let which = index % firsts.len();
        let number = firsts[which].number() + index as u64;
        let same = begun.get(&(which, firsts[which].seed_of(number)));
        let mut episode = same.map_or(&firsts[which], |&same| &episodes[same]).clone();
        episode.begin(number)?;
        begun.entry((which, episode.seed())).or_insert(index);
        episodes[index] = episode;
    }
    Ok(episodes)
}

/// Refuses an array of another shape, or one that is not C-contiguous.
fn expect(name: &str, shape: &[usize], expected: &[usize], is_contiguous: bool) -> PyResult<()> {
    if shape != expected || !is_contiguous {
        return Err(refused(format!("{name} of shape {shape:?}: expected {expected:?}, C-contiguous")));
    }
    Ok(())
}

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
#[pyclass(name = "BatchCore", module = "skysink")]
#[derive(Clone)]
pub struct PyBatchCore {
    episodes: Vec<Episode>,
    /// The actions of the last step, whose room the next one uses.
    actions: Actions,
}

/// Flies the next slot of `episode`, which is number `index` of `count`, and writes the rewards of its UAVs; if it is
/// over, the next one of its environment begins instead.
fn fly(
    (index, count): (usize, usize),
    episode: &mut Episode,
    actions: &Actions,
    rewards: &mut [f32],
) -> PyResult<Outcome> {
    if episode.is_over() {
        rewards.fill(0.0);
        episode.begin(episode.number() + count as u64)?;
        return Ok(Outcome::default());
    }
    let plans = actions.plans(index, episode);
    if episode.rules().reward == Reward::Difference {
        return Ok(differences(episode, &plans, rewards));
    }
    let outcome = episode.fly(&plans);
    rewards.fill(outcome.reward as f32);
    Ok(outcome)
}

impl PyBatchCore {
    fn uavs(&self) -> usize {
        self.episodes[0].plant.flights().len()
    }

    fn width(&self) -> usize {
        self.episodes[0].width()
    }

    /// Calls `work` with the actions, and every episode, its number and its entry of `entries`.
    fn each<T: Send>(
        &mut self,
        py: Python<'_>,
        entries: impl IndexedParallelIterator<Item = T>,
        work: impl Fn(&Actions, usize, &mut Episode, T) -> PyResult<()> + Sync,
    ) -> PyResult<()> {
        let Self { episodes, actions } = self;
        let all = episodes.par_iter_mut().zip(entries).enumerate().with_min_len(BATCH);
        py.detach(|| {
            pool()?.install(|| all.try_for_each(|(index, (episode, entry))| work(actions, index, episode, entry)))
        })
    }

    /// Refuses numbers of episodes that have no seed, and others than one for each.
    fn check_numbers(&self, numbers: &[u64], mask: &[bool]) -> PyResult<()> {
        let count = self.episodes.len();
        if [numbers.len(), mask.len()] != [count; 2] {
            let [seeds, mask] = [numbers.len(), mask.len()];
            return Err(refused(format!("{seeds} seeds, reset_mask of {mask}: expected {count} of each")));
        }
        self.episodes.iter().zip(numbers).try_for_each(|(episode, &number)| episode.check(number))
    }

    /// Refuses observations of another shape than [E, U, width].
    fn expect_observations(&self, observations: &PyReadwriteArray3<'_, f32>) -> PyResult<()> {
        let expected = [self.episodes.len(), self.uavs(), self.width()];
        expect("observations", observations.shape(), &expected, observations.is_c_contiguous())
    }
}

#[pymethods]
impl PyBatchCore {
    /// `agents`: whether the scenario may have several UAVs, whose actions and rewards then are arrays of one more
    /// dimension.
    #[new]
    #[expect(clippy::too_many_arguments, reason = "those of the environment")]
    fn new(
        py: Python<'_>,
        agents: bool,
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
        let kind = if agents { Kind::Agents } else { Kind::Vector };
        let rules = Rules::of(py, kind, fields, &observation, nearest, action, reward, prepare, return_rule)?;
        let first = Episode::first(scenarios[0].get(), &Arc::new(rules))?;
        if first.width() == 0 {
            return Err(refused(format!("observation = {observation:?}: expected more, or several UAVs")));
        }
        let episodes = begun_over(&vec![first; count], &scenarios, &vec![true; count])?;
        Ok(Self { episodes, actions: Actions::default() })
    }

    /// Begins the first episodes over other scenarios, where `mask` is true. Environment i gets scenario i, modulo
    /// their number.
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
    fn totals<'py>(&self, py: Python<'py>) -> (Bound<'py, PyArray1<u64>>, Bound<'py, PyArray1<u64>>) {
        let totals = || self.episodes.iter().map(|episode| episode.plant.header().totals);
        let lost_bits = PyArray1::from_iter(py, totals().map(|totals| totals.lost_bits));
        (lost_bits, PyArray1::from_iter(py, totals().map(|totals| totals.delivered_bits)))
    }

    /// Begins the episodes with these numbers, where `mask` is true; what all observe, by quantity.
    fn reset<'py>(&mut self, py: Python<'py>, numbers: Vec<u64>, mask: Vec<bool>) -> PyResult<Bound<'py, PyDict>> {
        self.check_numbers(&numbers, &mask)?;
        let mut observed = Observations::of(&self.episodes);
        let (mut rows, kinds) = observed.rows();
        let entries = numbers.into_par_iter().zip(mask).zip(rows.par_chunks_mut(kinds));
        self.each(py, entries, |_, _, episode, ((number, is_reset), rows)| {
            if is_reset {
                episode.begin(number)?;
            }
            episode.observe(rows);
            Ok(())
        })?;
        observed.into_dict(py, &self.episodes[0], Some(self.episodes.len()))
    }

    /// Begins the episodes with these numbers, where `mask` is true, and observes all, [E, U, width].
    fn reset_into(
        &mut self,
        py: Python<'_>,
        numbers: Vec<u64>,
        mask: Vec<bool>,
        mut observations: PyReadwriteArray3<'_, f32>,
    ) -> PyResult<()> {
        self.check_numbers(&numbers, &mask)?;
        self.expect_observations(&observations)?;
        let row = self.uavs() * self.width();
        let entries = numbers.into_par_iter().zip(mask).zip(observations.as_slice_mut()?.par_chunks_mut(row));
        self.each(py, entries, |_, _, episode, ((number, is_reset), observed)| {
            if is_reset {
                episode.begin(number)?;
            }
            episode.observe_flat(observed);
            Ok(())
        })
    }

    /// Flies one slot of every episode. An episode that is over is replaced by the next one of its environment instead.
    fn step<'py>(&mut self, py: Python<'py>, actions: &Bound<'py, PyAny>) -> PyResult<Steps<'py>> {
        let count = self.episodes.len();
        self.actions.read(&self.episodes, actions)?;
        let mut outcomes = vec![Outcome::default(); count];
        let mut observed = Observations::of(&self.episodes);
        let (mut rows, kinds) = observed.rows();
        let entries = outcomes.par_iter_mut().zip(rows.par_chunks_mut(kinds));
        self.each(py, entries, |actions, index, episode, (outcome, rows)| {
            *outcome = fly((index, count), episode, actions, &mut [])?;
            episode.observe(rows);
            Ok(())
        })?;
        Ok((
            observed.into_dict(py, &self.episodes[0], Some(count))?,
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
        let (count, uavs, width) = (self.episodes.len(), self.uavs(), self.width());
        self.expect_observations(&observations)?;
        expect("rewards", rewards.shape(), &[count, uavs], rewards.is_c_contiguous())?;
        expect("terminated", terminated.shape(), &[count], terminated.is_c_contiguous())?;
        expect("truncated", truncated.shape(), &[count], truncated.is_c_contiguous())?;
        self.actions.read(&self.episodes, actions)?;
        let ends = terminated.as_slice_mut()?.par_iter_mut().zip(truncated.as_slice_mut()?);
        let rows = observations.as_slice_mut()?.par_chunks_mut(uavs * width);
        let entries = rows.zip(rewards.as_slice_mut()?.par_chunks_mut(uavs)).zip(ends);
        self.each(py, entries, |actions, index, episode, ((observed, rewards), (down, over))| {
            let outcome = fly((index, count), episode, actions, rewards)?;
            (*down, *over) = (outcome.is_down, outcome.is_over && !outcome.is_down);
            episode.observe_flat(observed);
            Ok(())
        })
    }

    /// For each agent whether each sensor node to choose from is within the reach of one slot, [E, size] or [E, U,
    /// size].
    fn action_masks<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<bool>>> {
        let size = self.action_size();
        let mut masks = vec![false; self.episodes.len() * self.uavs() * size];
        let of_episodes = masks.par_chunks_mut(self.uavs() * size);
        self.each(py, of_episodes, |_, _, episode, masks| {
            for (uav, mask) in masks.chunks_mut(size).enumerate() {
                episode.uav = uav;
                mask.copy_from_slice(&episode.action_mask());
            }
            Ok(())
        })?;
        PyArray1::from_vec(py, masks).reshape(Actions::shape(&self.episodes, &[size]))
    }

    /// The actions that come closest to the plans of a built-in strategy, [E, size] or [E, U, size], or [E] or [E, U] of
    /// sensor nodes; 0 where the episode is over.
    fn expert<'py>(&mut self, py: Python<'py>, strategy: &str) -> PyResult<Bound<'py, PyAny>> {
        let is_choice = self.episodes[0].control() == Control::Sensor;
        let size = if is_choice { 1 } else { self.action_size() };
        let mut actions = vec![0.0; self.episodes.len() * self.uavs() * size];
        let of_episodes = actions.par_chunks_mut(self.uavs() * size);
        self.each(py, of_episodes, |_, _, episode, into| match episode.is_over() {
            true => Ok(()),
            false => episode.write_expert(strategy, &NEVER, into),
        })?;
        if is_choice {
            let choices = PyArray1::from_iter(py, actions.iter().map(|&choice| choice as i64));
            return Ok(choices.reshape(Actions::shape(&self.episodes, &[]))?.into_any());
        }
        Ok(PyArray1::from_vec(py, actions).reshape(Actions::shape(&self.episodes, &[size]))?.into_any())
    }

    /// The state of the first environment: positions of all UAVs as fractions, the queues as fractions, the slot.
    fn state<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        let episode = &self.episodes[0];
        let limits = episode.field.limits;
        let position = |flight: &FlightReport| {
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
