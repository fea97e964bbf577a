//! Episodes that are flown in parallel.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use pyo3::prelude::*;
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::control;
use crate::episode::{Episode, Outcome};
use crate::errors::refused;
use crate::reward::differences;
use crate::rules::Reward;

/// Episodes per task.
const BATCH: usize = 8;

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

/// Calls `work` with the number of every episode, the episode, and its entry of `entries`; with several in parallel.
pub fn each<T: Send>(
    episodes: &mut [Episode],
    entries: impl IntoIterator<Item = T>,
    work: impl Fn(usize, &mut Episode, T) -> PyResult<()> + Sync,
) -> PyResult<()> {
    let all: Vec<(usize, (&mut Episode, T))> = episodes.iter_mut().zip(entries).enumerate().collect();
    let task = |(index, (episode, entry)): (usize, (&mut Episode, T))| work(index, episode, entry);
    match all.len() {
        1 => all.into_iter().try_for_each(task),
        _ => pool()?.install(|| all.into_par_iter().with_min_len(BATCH).try_for_each(task)),
    }
}

/// Refuses more scenarios than environments, or none.
pub fn check(scenarios: usize, count: usize) -> PyResult<()> {
    if !(1..=count).contains(&scenarios) {
        return Err(refused(format!("{scenarios} scenarios: expected 1 to {count}, the number of environments")));
    }
    Ok(())
}

/// Refuses an array of another shape, or one that is not C-contiguous.
pub fn expect(name: &str, shape: &[usize], expected: &[usize], is_contiguous: bool) -> PyResult<()> {
    if shape != expected || !is_contiguous {
        return Err(refused(format!("{name} of shape {shape:?}: expected {expected:?}, C-contiguous")));
    }
    Ok(())
}

/// Begins the first episodes over other scenarios, of which these are the first ones, where `mask` is true. Environment
/// i gets scenario i, modulo their number.
pub fn begin_over(episodes: &mut [Episode], firsts: &[Episode], mask: &[bool]) -> PyResult<()> {
    let mut begun: HashMap<(usize, u64), usize> = HashMap::new(); // episodes over the same field share it
    for index in (0..episodes.len()).filter(|&index| mask[index]) {
        let which = index % firsts.len();
        let number = firsts[which].number + index as u64;
        let same = begun.get(&(which, firsts[which].course.seed(number)));
        let mut episode = same.map_or(&firsts[which], |&same| &episodes[same]).clone();
        if episode.number != number {
            episode.begin(number)?;
        }
        begun.entry((which, episode.seed())).or_insert(index);
        episodes[index] = episode;
    }
    Ok(())
}

/// Flies the next slot of `episode`, which is number `index` of `count`, and writes the rewards of its UAVs; if it is
/// over, the next one of its environment begins instead.
pub fn fly(
    index: usize,
    count: usize,
    episode: &mut Episode,
    actions: &[f32],
    rewards: &mut [f32],
) -> PyResult<Outcome> {
    if episode.is_over() {
        rewards.fill(0.0);
        episode.begin(episode.number + count as u64)?;
        return Ok(Outcome::default());
    }
    let plans = control::plans(actions, index, episode);
    if episode.rules().reward == Reward::Difference {
        return Ok(differences(episode, &plans, rewards));
    }
    let outcome = episode.fly(&plans);
    rewards.fill(outcome.reward as f32);
    Ok(outcome)
}
