//! The core of the vectorised Gymnasium environment: many episodes in parallel.

use std::sync::{Arc, Mutex, PoisonError};

use numpy::ndarray::{Array1, Array2, Array3};
use numpy::{IntoPyArray, PyReadonlyArray2};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyTuple};
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use skysink_common::checkpoint::Checkpoint;

use crate::environment::first_episode;
use crate::episode::{Episode, Outcome};
use crate::errors::{of_checkpoint, refused};
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

/// The observations of all episodes.
struct Observed {
    uav: Array2<f32>,
    queues: Array2<f32>,
    slot: Array2<f32>,
}

/// The environments without their spaces.
#[pyclass(name = "VectorCore", module = "skysink")]
pub struct PyVectorCore {
    episodes: Vec<Episode>,
    positions: bool,
}

impl PyVectorCore {
    /// Calls `work` with every episode and its entry of `entries`, then observes the episode.
    fn each<T: Send>(
        &mut self,
        entries: impl IndexedParallelIterator<Item = T>,
        work: impl Fn(&mut Episode, T) -> PyResult<()> + Sync,
    ) -> PyResult<Observed> {
        let count = self.episodes.len();
        let sensors = self.episodes[0].field.count();
        let mut observed = Observed {
            uav: Array2::zeros((count, 3)),
            queues: Array2::zeros((count, sensors)),
            slot: Array2::zeros((count, 1)),
        };
        let slices = [&mut observed.uav, &mut observed.queues, &mut observed.slot];
        let [uav, queues, slot] = slices.map(|array| array.as_slice_mut().expect("the array is contiguous"));
        let rows = uav.par_chunks_mut(3).zip(queues.par_chunks_mut(sensors)).zip(slot.par_iter_mut());
        let all = self.episodes.par_iter_mut().zip(entries).zip(rows).with_min_len(BATCH);
        let fly = || {
            all.try_for_each(|((episode, entry), ((uav, queues), slot))| {
                work(episode, entry)?;
                episode.observe(uav, queues, slot);
                PyResult::Ok(())
            })
        };
        pool()?.install(fly)?;
        Ok(observed)
    }

    fn observation<'py>(&self, py: Python<'py>, observed: Observed) -> PyResult<Bound<'py, PyDict>> {
        let observation = PyDict::new(py);
        observation.set_item(intern!(py, "uav"), observed.uav.into_pyarray(py))?;
        observation.set_item(intern!(py, "queues"), observed.queues.into_pyarray(py))?;
        observation.set_item(intern!(py, "slot"), observed.slot.into_pyarray(py))?;
        if self.positions {
            let sensors = self.episodes[0].field.count();
            let mut positions = Array3::zeros((self.episodes.len(), sensors, 2));
            let rows = positions.as_slice_mut().expect("the array is contiguous").chunks_exact_mut(2 * sensors);
            rows.zip(&self.episodes).for_each(|(row, episode)| episode.observe_positions(row));
            observation.set_item(intern!(py, "positions"), positions.into_pyarray(py))?;
        }
        Ok(observation)
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
        let mut episodes = vec![first_episode(scenario, fields)?; count];
        for (episode, number) in episodes.iter_mut().zip(0..) {
            episode.begin(episode.number() + number)?;
        }
        Ok(Self { episodes, positions })
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
        PyField(Arc::clone(&self.episodes[0].field))
    }

    /// Begins the episodes with these numbers, where `mask` is true or `None`.
    fn reset<'py>(
        &mut self,
        py: Python<'py>,
        numbers: Vec<u64>,
        mask: Option<Vec<bool>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let mask = mask.unwrap_or_else(|| vec![true; self.episodes.len()]);
        if [numbers.len(), mask.len()] != [self.episodes.len(); 2] {
            let [seeds, mask, count] = [numbers.len(), mask.len(), self.episodes.len()];
            return Err(refused(format!("{seeds} seeds, reset_mask of {mask}: expected {count} of each")));
        }
        self.episodes[0].check(&numbers)?;
        let observed = py.detach(|| {
            self.each(
                numbers.into_par_iter().zip(mask),
                |episode, (number, is_reset)| {
                    if is_reset { episode.begin(number) } else { Ok(()) }
                },
            )
        })?;
        self.observation(py, observed)
    }

    /// Flies one slot of every episode. An episode that is over is replaced by the next one of its environment instead.
    fn step<'py>(&mut self, py: Python<'py>, actions: PyReadonlyArray2<'py, f32>) -> PyResult<Bound<'py, PyTuple>> {
        let count = self.episodes.len();
        let axes = self.episodes[0].axes();
        let actions = actions.as_array().to_owned(); // the caller may change the array
        if actions.dim() != (count, axes) || actions.iter().any(|component| !component.is_finite()) {
            return Err(refused(format!("actions of shape {:?}: expected ({count}, {axes}), finite", actions.dim())));
        }
        let actions = actions.as_standard_layout();
        let actions = actions.as_slice().expect("in the standard layout");
        let still = Outcome { reward: 0.0, delivered_bits: 0, lost_bits: 0, is_over: false };
        let mut outcomes = vec![still; count];
        let observed = py.detach(|| {
            self.each(actions.par_chunks(axes).zip(&mut outcomes), |episode, (action, outcome)| {
                if episode.plant.is_over() {
                    return episode.begin(episode.number() + count as u64);
                }
                let mut components = [0.0; 3];
                components.iter_mut().zip(action).for_each(|(component, &value)| *component = value.into());
                let plan = episode.plan(&components[..axes]);
                *outcome = episode.fly(&plan);
                Ok(())
            })
        })?;
        let rewards: Array1<f64> = outcomes.iter().map(|outcome| outcome.reward).collect();
        let truncated: Array1<bool> = outcomes.iter().map(|outcome| outcome.is_over).collect();
        let lost_bits: Array1<u64> = outcomes.iter().map(|outcome| outcome.lost_bits).collect();
        let delivered_bits: Array1<u64> = outcomes.iter().map(|outcome| outcome.delivered_bits).collect();
        let all_true = Array1::from_elem(count, true);
        let information = PyDict::new(py);
        for (name, values) in [("lost_bits", lost_bits), ("delivered_bits", delivered_bits)] {
            information.set_item(name, values.into_pyarray(py))?;
            information.set_item(format!("_{name}"), all_true.clone().into_pyarray(py))?;
        }
        let terminated = Array1::from_elem(count, false);
        let observation = self.observation(py, observed)?;
        PyTuple::new(
            py,
            [
                observation.into_any(),
                rewards.into_pyarray(py).into_any(),
                terminated.into_pyarray(py).into_any(),
                truncated.into_pyarray(py).into_any(),
                information.into_any(),
            ],
        )
    }

    fn clone(&self) -> Self {
        Self { episodes: self.episodes.clone(), positions: self.positions }
    }

    fn save<'py>(&self, py: Python<'py>) -> Vec<Bound<'py, PyBytes>> {
        let saved = |episode: &Episode| {
            let mut bytes = Vec::new();
            episode.save(&mut bytes);
            PyBytes::new(py, &bytes)
        };
        self.episodes.iter().map(saved).collect()
    }

    fn restore(&mut self, saved: Vec<Vec<u8>>) -> PyResult<()> {
        if saved.len() != self.episodes.len() {
            return Err(refused(format!("{} episodes: expected {}", saved.len(), self.episodes.len())));
        }
        let mut pairs = self.episodes.iter_mut().zip(saved);
        pairs.try_for_each(|(episode, bytes)| episode.restore(&bytes).map_err(of_checkpoint))
    }
}
