//! The core of the vectorised Gymnasium environment: many episodes in parallel.

use std::sync::{Arc, Mutex, PoisonError};

use numpy::{PyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::episode::{Episode, Observations, Outcome};
use crate::errors::refused;
use crate::field::PyField;
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

/// Observation, rewards, whether the episodes are over, lost bits, delivered bits.
type Steps<'py> = (
    Bound<'py, PyDict>,
    Bound<'py, PyArray1<f64>>,
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
        let sensors = self.episodes[0].field.count();
        let mut observed = Observations::new(self.episodes.len(), sensors);
        let Observations { uav, queues, slot, .. } = &mut observed;
        let rows = uav.par_chunks_mut(3).zip(queues.par_chunks_mut(sensors)).zip(slot);
        let all = self.episodes.par_iter_mut().zip(entries).zip(rows).with_min_len(BATCH);
        let fly = || {
            all.try_for_each(|((episode, entry), ((uav, queues), slot))| {
                work(episode, entry)?;
                episode.observe(uav, queues, slot);
                PyResult::Ok(())
            })
        };
        py.detach(|| pool()?.install(fly))?;
        observed.into_dict(py, &self.episodes, Some(self.episodes.len()))
    }
}

#[pymethods]
impl PyVectorCore {
    #[new]
    #[pyo3(signature = (scenario, count, fields = None, positions = false))]
    fn new(scenario: &Bound<'_, PyScenario>, count: usize, fields: Option<u64>, positions: bool) -> PyResult<Self> {
        if !(1..=MAX_ENVIRONMENTS).contains(&count) {
            return Err(refused(format!("num_envs = {count}: expected 1 to {MAX_ENVIRONMENTS}")));
        }
        let mut episodes = vec![Episode::first(scenario.get(), fields, positions)?; count];
        for (episode, number) in episodes.iter_mut().zip(0..) {
            episode.begin(episode.number() + number)?;
        }
        Ok(Self { episodes })
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
        self.episodes[0].check(&numbers)?;
        self.each(
            py,
            numbers.into_par_iter().zip(mask),
            |episode, (number, is_reset)| {
                if is_reset { episode.begin(number) } else { Ok(()) }
            },
        )
    }

    /// Flies one slot of every episode. An episode that is over is replaced by the next one of its environment instead.
    fn step<'py>(&mut self, py: Python<'py>, actions: PyReadonlyArray2<'py, f32>) -> PyResult<Steps<'py>> {
        let count = self.episodes.len();
        let axes = self.episodes[0].axes();
        let actions = actions.as_array();
        if actions.dim() != (count, axes) || actions.iter().any(|component| !component.is_finite()) {
            return Err(refused(format!("actions of shape {:?}: expected ({count}, {axes}), finite", actions.dim())));
        }
        let components: Vec<f32> = actions.iter().copied().collect(); // the caller may change the array
        let mut outcomes = vec![Outcome::default(); count];
        let entries = components.par_chunks(axes).zip(&mut outcomes);
        let observation = self.each(py, entries, |episode, (action, outcome)| {
            if episode.plant.is_over() {
                return episode.begin(episode.number() + count as u64);
            }
            let plan = episode.plan(action);
            *outcome = episode.fly(&plan);
            Ok(())
        })?;
        Ok((
            observation,
            PyArray1::from_iter(py, outcomes.iter().map(|outcome| outcome.reward)),
            PyArray1::from_iter(py, outcomes.iter().map(|outcome| outcome.is_over)),
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
