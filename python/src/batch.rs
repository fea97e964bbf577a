//! The core of the vectorised Gymnasium environment: many episodes in parallel.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use numpy::{PyArray1, PyArray2, PyArrayMethods as _};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::control::Actions;
use crate::episode::{Episode, Outcome};
use crate::errors::refused;
use crate::field::PyField;
use crate::observation::Observations;
use crate::rules::Rules;
use crate::scenario::PyScenario;

/// Episodes per task.
pub const BATCH: usize = 8;

/// Maximum number of environments of a vector.
pub const MAX_ENVIRONMENTS: usize = 100_000;

/// The thread pool of this process. A forked process needs its own.
pub fn pool() -> PyResult<Arc<ThreadPool>> {
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
pub fn check(scenarios: usize, count: usize) -> PyResult<()> {
    if !(1..=count).contains(&scenarios) {
        return Err(refused(format!("{scenarios} scenarios: expected 1 to {count}, the number of environments")));
    }
    Ok(())
}

/// The `episodes` with the first ones over other scenarios where `mask` is true. Environment i gets scenario i, modulo their
/// number.
pub fn begun_over(episodes: &[Episode], scenarios: &[Bound<'_, PyScenario>], mask: &[bool]) -> PyResult<Vec<Episode>> {
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

/// Observation, rewards, whether the UAVs are down, whether the missions are over, lost bits, delivered bits.
type Steps<'py> = (
    Bound<'py, PyDict>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<u64>>,
    Bound<'py, PyArray1<u64>>,
);

/// The environments without their spaces.
#[pyclass(name = "VectorCore", module = "skysink")]
#[derive(Clone)]
pub struct PyVectorCore {
    episodes: Vec<Episode>,
}

impl PyVectorCore {
    /// Calls `work` with every episode and its entry of `entries`, and observes the episodes.
    fn each<'py, T: Send>(
        &mut self,
        py: Python<'py>,
        entries: impl IndexedParallelIterator<Item = T>,
        work: impl Fn(&mut Episode, T) -> PyResult<()> + Sync,
    ) -> PyResult<Bound<'py, PyDict>> {
        let mut observed = Observations::of(&self.episodes);
        let (mut rows, kinds) = observed.rows();
        let all = self.episodes.par_iter_mut().zip(entries).zip(rows.par_chunks_mut(kinds)).with_min_len(BATCH);
        let fly = || {
            all.try_for_each(|((episode, entry), rows)| {
                work(episode, entry)?;
                episode.observe(rows);
                PyResult::Ok(())
            })
        };
        py.detach(|| pool()?.install(fly))?;
        observed.into_dict(py, &self.episodes[0], Some(self.episodes.len()))
    }
}

#[pymethods]
impl PyVectorCore {
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
        let rules = Rules::of(py, fields, &observation, nearest, action, reward, prepare, return_rule)?.of_vector();
        let first = Episode::first(scenarios[0].get(), &Arc::new(rules))?;
        let mut core = Self { episodes: vec![first; count] };
        core.replace(scenarios, vec![true; count])?;
        Ok(core)
    }

    /// Begins the first episodes over other scenarios, where `mask` is true. Environment i gets scenario i, modulo their
    /// number.
    fn replace(&mut self, scenarios: Vec<Bound<'_, PyScenario>>, mask: Vec<bool>) -> PyResult<()> {
        self.episodes = begun_over(&self.episodes, &scenarios, &mask)?;
        Ok(())
    }

    /// Names, shapes and least numbers of what is observed by one environment.
    #[getter]
    fn observed(&self) -> Vec<(&'static str, Vec<usize>, f64)> {
        self.episodes[0].boxes()
    }

    /// Number of coordinates of an action, or of sensor nodes to choose from.
    #[getter]
    fn action_size(&self) -> usize {
        self.episodes[0].action_size()
    }

    fn action_masks<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<bool>>> {
        let masks = || self.episodes.par_iter().with_min_len(BATCH).map(Episode::action_mask).collect::<Vec<_>>();
        let masks = py.detach(|| PyResult::Ok(pool()?.install(masks)))?;
        PyArray1::from_vec(py, masks.concat()).reshape([self.episodes.len(), self.action_size()])
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

    /// Begins the episodes with these numbers, where `mask` is true.
    fn reset<'py>(&mut self, py: Python<'py>, numbers: Vec<u64>, mask: Vec<bool>) -> PyResult<Bound<'py, PyDict>> {
        let count = self.episodes.len();
        if [numbers.len(), mask.len()] != [count; 2] {
            let [seeds, mask] = [numbers.len(), mask.len()];
            return Err(refused(format!("{seeds} seeds, reset_mask of {mask}: expected {count} of each")));
        }
        self.episodes.iter().zip(&numbers).try_for_each(|(episode, &number)| episode.check(number))?;
        self.each(
            py,
            numbers.into_par_iter().zip(mask),
            |episode, (number, is_reset)| {
                if is_reset { episode.begin(number) } else { Ok(()) }
            },
        )
    }

    /// Flies one slot of every episode. An episode that is over is replaced by the next one of its environment instead.
    fn step<'py>(&mut self, py: Python<'py>, actions: &Bound<'py, PyAny>) -> PyResult<Steps<'py>> {
        let count = self.episodes.len();
        let actions = Actions::many(&self.episodes[0], count, actions)?;
        let mut outcomes = vec![Outcome::default(); count];
        let entries = (0..count).into_par_iter().zip(&mut outcomes);
        let observation = self.each(py, entries, |episode, (index, outcome)| {
            if episode.is_over() {
                return episode.begin(episode.number() + count as u64);
            }
            let plan = episode.ruled(actions.plan(index, episode));
            *outcome = episode.fly(&[Some(plan)]);
            Ok(())
        })?;
        Ok((
            observation,
            PyArray1::from_iter(py, outcomes.iter().map(|outcome| outcome.reward)),
            PyArray1::from_iter(py, outcomes.iter().map(|outcome| outcome.is_down)),
            PyArray1::from_iter(py, outcomes.iter().map(|outcome| outcome.is_over && !outcome.is_down)),
            PyArray1::from_iter(py, outcomes.iter().map(|outcome| outcome.lost_bits)),
            PyArray1::from_iter(py, outcomes.iter().map(|outcome| outcome.delivered_bits)),
        ))
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
