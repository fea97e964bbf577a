//! Missions in one process: slots per second of a sweep on one thread and on all cores.

use std::path::Path;
use std::time::Instant;

use serde::Serialize;
use skysink_common::scenario::Overrides;
use skysink_common::stop::Stop;
use skysink_lab::sweep;
use skysink_lab::sweep::plan::Sweep;
use skysink_lab::sweep::settings::{SweepBase, SweepSettings};
use skysink_lab::sweep::shard::Shard;
use skysink_planner::strategies::uts;

use crate::error::BenchError;
use crate::setting::{BenchEffort, cores, letter_text, median_by, temporary_folder};

/// Slots of a mission, as in the paper.
const SLOTS: u64 = 600;

/// Slots per second of a sweep over the paper's mission by `uts`, N = 200.
#[derive(Debug, Serialize)]
pub struct MissionSpeeds {
    /// On one thread.
    pub slots_per_s: f64,
    /// On all cores.
    pub all_slots_per_s: f64,
    /// Speed on all cores over that on one, per core.
    pub per_core: f64,
}

/// Flies missions, on one thread and on all cores in turns.
pub fn measure(effort: BenchEffort, stop: &Stop) -> Result<MissionSpeeds, BenchError> {
    let cores = cores();
    let mut one = Vec::new();
    let mut all = Vec::new();
    for _ in 0..effort.choose(5, 1) {
        one.push(swept(1, effort, stop)?);
        all.push(swept(cores, effort, stop)?);
    }
    let [one, all] = [one, all].map(|speeds| median_by(speeds, |&speed| speed));
    Ok(MissionSpeeds { slots_per_s: one, all_slots_per_s: all, per_core: all / one / cores as f64 })
}

/// Slots per second of a sweep on so many threads.
fn swept(threads: usize, effort: BenchEffort, stop: &Stop) -> Result<f64, BenchError> {
    let folder = temporary_folder()?;
    let table = letter_text(200, SLOTS).parse().expect("valid TOML");
    let base = SweepBase { path: "bench.toml".into(), table, held: Overrides::default() };
    let strategies = vec![uts::STRATEGY.name.to_owned()];
    let seeds = (1..=effort.choose(500, 8) * threads as u64).collect();
    let settings =
        SweepSettings { base, axes: toml::Table::new(), strategies, seeds, external: Vec::new(), models: Vec::new() };
    let plan = Sweep::new(Path::new("bench"), settings)?;
    let begin = Instant::now();
    let journal = sweep::sweep(&plan, &folder.path().join("sweep"), Shard::WHOLE, threads, stop, &|_| ())?;
    Ok((journal.count() as u64 * SLOTS) as f64 / begin.elapsed().as_secs_f64())
}
