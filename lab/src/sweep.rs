//! `skysink sweep`: simulates many missions in parallel. A sweep can be interrupted, resumed and split into shards; the
//! results have the same bytes.

pub mod definition;
pub mod estimate;
pub mod folder;
pub mod journal;
pub mod manifest;
pub mod merge;
pub mod plan;
pub mod results;
mod saved;
pub mod settings;
pub mod shard;
mod unflown;

use std::collections::BTreeSet;
use std::io;
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use rayon::ThreadPoolBuilder;
use rayon::prelude::*;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::Mission;
use skysink_mission::error::FileContext;
use skysink_planner::strategies::look_ahead;

use crate::error::LabError;
use crate::progress::{LabProgress, OnProgress, Workload};
use definition::MissionKey;
use folder::SweepRecord;
use journal::{MissionRow, SweepJournal};
use plan::Sweep;
use shard::Shard;
use skysink_mission::bounds::bounds;
use skysink_mission::meter::MissionMeter;

/// Simulates the missing missions of a shard on at most `threads` threads, 0 for one per core, writes the results into
/// the folder `out`, and returns the journal. Calling it again resumes an interrupted sweep.
///
/// # Errors
/// If the folder contains other files, a mission is refused, a file cannot be written, or on a stop.
pub fn sweep(
    sweep: &Sweep,
    out: &Path,
    shard: Shard,
    threads: usize,
    stop: &Stop,
    on_progress: OnProgress,
) -> Result<SweepJournal, LabError> {
    let record = SweepRecord::open(sweep, out, shard)?;
    let mut missing: Vec<_> = record.missing().collect();
    move_first_of_each_strategy_to_front(&mut missing);
    let pool =
        ThreadPoolBuilder::new().num_threads(threads.min(missing.len().max(1))).build().map_err(io::Error::other);
    let pool = pool.at(Path::new("threads"))?;
    let of = sweep.definition.missions(shard).count() as u64;
    let report = |work: &Workload| {
        let left = work.left(pool.current_num_threads());
        let done = of - work.missing() as u64;
        on_progress(LabProgress { done, of, loss_rate: None, left });
    };
    let work = Workload::new(missing.iter().map(|mission| mission.strategy));
    report(&work);
    let record = Mutex::new((record, work));
    pool.install(|| {
        let fly_one = |mission: MissionKey| -> Result<(), LabError> {
            stop.check()?;
            let begin = Instant::now();
            let row = fly_scenario(&sweep.scenario(mission)?, mission, stop)?;
            let (record, work) = &mut *record.lock().unwrap_or_else(PoisonError::into_inner);
            record.add(&row)?;
            work.add(mission.strategy, begin.elapsed());
            report(work);
            Ok(())
        };
        missing.into_iter().par_bridge().try_for_each(fly_one)
    })?;
    let (record, _) = record.into_inner().unwrap_or_else(PoisonError::into_inner);
    record.finish(stop)
}

/// Moves the first mission of each strategy to the front, so that the remaining time can be estimated early.
fn move_first_of_each_strategy_to_front(missions: &mut [MissionKey]) {
    let mut seen = BTreeSet::new();
    for index in 0..missions.len() {
        if seen.insert(missions[index].strategy) {
            missions[seen.len() - 1..=index].rotate_right(1);
        }
    }
}

/// Simulates the mission `key` of a sweep, with a strategy of the registry, over its scenario or another one, such as
/// one with arrivals in memory.
///
/// # Errors
/// If the mission is refused, or on a stop.
pub fn fly_scenario(scenario: &Scenario, key: MissionKey, stop: &Stop) -> Result<MissionRow, LabError> {
    let list = SensorList::of(scenario)?;
    let mut mission = Mission::until(scenario, &list, stop)?;
    let mut meter = MissionMeter::new(scenario, &list);
    mission.drive(&mut [&mut meter], stop)?.unless_stopped()?;
    let is_bounded = scenario.planner.strategy == look_ahead::OFFLINE.name;
    let bounds = is_bounded.then(|| bounds(scenario, &list, mission.header().totals.lost_bits));
    Ok(MissionRow { key, values: meter.values(mission.plant(), None, bounds) })
}
