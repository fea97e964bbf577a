//! Missions in one process: slots per second on one core, and how a sweep scales over all.

use std::path::Path;
use std::time::{Duration, Instant};

use serde::Serialize;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_lab::sweep;
use skysink_lab::sweep::plan::{Shard, Sweep, SweepBase};
use skysink_mission::mission::Mission;
use skysink_planner::settings;
use skysink_planner::strategies::uts;

use super::{Effort, letter_text, machine, median_by, temporary_folder};
use crate::error::Error;

/// Slots of a mission, as in the paper.
const SLOTS: u64 = 600;

/// What was measured of missions.
#[derive(Debug, Serialize)]
pub struct MissionSpeeds {
    /// Slots per second of the paper's mission on one core, `uts`, N = 200, set-up included.
    pub slots_per_s: f64,
    /// Slots per second of a sweep of them, on one thread.
    pub sweep_slots_per_s: f64,
    /// The same on all cores.
    pub sweep_all_slots_per_s: f64,
    /// Speed on all cores over that on one, per core.
    pub per_core: f64,
}

/// Flies missions.
pub(super) fn measure(effort: Effort, stop: &Stop) -> Result<MissionSpeeds, Error> {
    let slots_per_s = alone(effort.choose(Duration::from_secs(3), Duration::from_millis(100)), stop)?;
    let cores = machine::cores();
    let mut one = Vec::new();
    let mut all = Vec::new();
    for _ in 0..effort.choose(5, 1) {
        one.push(swept(1, effort, stop)?);
        all.push(swept(cores, effort, stop)?);
    }
    let [one, all] = [one, all].map(|speeds| median_by(speeds, |&speed| speed));
    let per_core = all / one / cores as f64;
    Ok(MissionSpeeds { slots_per_s, sweep_slots_per_s: one, sweep_all_slots_per_s: all, per_core })
}

/// Slots per second of a sweep on so many threads.
fn swept(threads: usize, effort: Effort, stop: &Stop) -> Result<f64, Error> {
    let folder = temporary_folder()?;
    let base = SweepBase { path: "bench.toml".into(), table: letter_text(200, SLOTS).parse().expect("valid TOML") };
    let strategies = vec![uts::STRATEGY.name.to_owned()];
    let seeds = (1..=effort.choose(500, 8) * threads as u64).collect();
    let plan = Sweep::new(Path::new("bench"), base, toml::Table::new(), strategies, seeds, Vec::new())?;
    let begin = Instant::now();
    let journal = sweep::sweep(&plan, &folder.path().join("sweep"), Shard::WHOLE, threads, stop, &|_| ())?;
    Ok((journal.count() as u64 * SLOTS) as f64 / begin.elapsed().as_secs_f64())
}

/// Slots per second of one mission after the other.
fn alone(budget: Duration, stop: &Stop) -> Result<f64, Error> {
    let begin = Instant::now();
    let mut slots = 0u64;
    let mut seed = 0;
    while begin.elapsed() < budget {
        stop.check()?;
        seed += 1;
        let scenario =
            Scenario::letter(Overrides { seed: Some(seed), ..Overrides::default() }).and_then(settings::resolve)?;
        let mut mission = Mission::new(&scenario, &SensorList::of(&scenario)?)?;
        for flown in &mut mission {
            std::hint::black_box(&flown);
            slots += 1;
        }
    }
    Ok(slots as f64 / begin.elapsed().as_secs_f64())
}
