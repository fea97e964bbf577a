//! Missions in one process: slots per second on one core, and how a sweep scales over all.

use std::path::Path;
use std::time::{Duration, Instant};

use serde::Serialize;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_planner::settings;
use skysink_planner::strategies::uts;

use super::{Effort, letter_text, machine, median};
use crate::error::Error;
use skysink_lab::sweep;
use skysink_lab::sweep::plan::{Shard, Sweep, SweepBase};
use skysink_mission::error::FileContext;
use skysink_mission::mission::Mission;

/// Slots of a mission, as the letter's.
const SLOTS: u64 = 600;

/// What was measured of missions.
#[derive(Debug, Serialize)]
pub struct MissionSpeeds {
    /// Slots per second of the letter's missions on one core, `uts`, N = 200, set-up included.
    pub slots_per_s: f64,
    /// Slots per second of a sweep of them, on one thread.
    pub sweep_slots_per_s: f64,
    /// The same on all cores.
    pub sweep_all_slots_per_s: f64,
    /// Cores.
    pub cores: usize,
    /// Speed on all cores over that on one, per core.
    pub per_core: f64,
}

/// Flies missions.
///
/// # Errors
/// If a mission is refused, something cannot be written, or on a stop.
pub fn measure(effort: Effort, stop: &Stop) -> Result<MissionSpeeds, Error> {
    let place = tempfile::tempdir().at(Path::new("folder for temporary files"))?;
    let slots_per_s = alone(effort.choose(Duration::from_secs(3), Duration::from_millis(100)), stop)?;
    let (mut one, mut all, cores) = (Vec::new(), Vec::new(), machine::cores());
    let missions = effort.choose(500, 8);
    for round in 0..effort.choose(5, 1) {
        for (threads, speeds) in [(1, &mut one), (cores, &mut all)] {
            let out = place.path().join(format!("{round}-{threads}-{}", speeds.len()));
            let plan = Sweep::new(
                Path::new("bench"),
                SweepBase { path: "bench.toml".into(), table: letter_text(200, SLOTS).parse().expect("valid TOML") },
                toml::Table::new(),
                vec![uts::STRATEGY.name.to_owned()],
                (1..=missions * threads as u64).collect(),
                Vec::new(),
            )?;
            let begin = Instant::now();
            let journal = sweep::sweep(&plan, &out, Shard::WHOLE, threads, stop, &|_| ())?;
            speeds.push((journal.count() as u64 * SLOTS) as f64 / begin.elapsed().as_secs_f64());
        }
    }
    let (one, all) = (median(one), median(all));
    Ok(MissionSpeeds {
        slots_per_s,
        sweep_slots_per_s: one,
        sweep_all_slots_per_s: all,
        cores,
        per_core: all / one / cores as f64,
    })
}

/// Slots per second of one mission after the other.
fn alone(budget: Duration, stop: &Stop) -> Result<f64, Error> {
    let (begin, mut slots, mut seed) = (Instant::now(), 0u64, 0);
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
