//! `skysink sweep` and `skysink merge`: many missions, in parallel, resumable, with the same bytes however it was done.

pub mod folder;
pub mod journal;
pub mod plan;
pub mod results;
pub(crate) mod statistics;

use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use rayon::ThreadPoolBuilder;
use rayon::prelude::*;
use skysink_common::error::InputError;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::Mission;
use skysink_mission::error::FileContext;
use skysink_planner::strategies::offline;

use crate::error::LabError;
use crate::metrics::MissionMeter;
use crate::optimize::loss_bounds;
use crate::progress::{LabProgress, OnProgress, SweepNumber, Workload};
use folder::{FlownSweep, Manifest, SweepRecord};
use journal::{MissionRow, MissionRows};
use plan::{Definition, MissionKey, Shard, Sweep};

/// Flies what is missing of a shard of the sweep, on `threads` threads (0: one per core), and writes the results into
/// `out`. Returns all rows. Interrupted, it resumes when it is called again.
///
/// # Errors
/// If the folder holds something else, a mission is refused, something cannot be written, or on a stop.
pub fn sweep(
    sweep: &Sweep,
    out: &Path,
    shard: Shard,
    threads: usize,
    stop: &Stop,
    on_progress: OnProgress,
) -> Result<MissionRows, LabError> {
    let record = SweepRecord::open(sweep, out, shard)?;
    let missing = record.missing();
    let pool = ThreadPoolBuilder::new().num_threads(threads).build().map_err(io::Error::other);
    let pool = pool.at(Path::new("threads"))?;
    let of = sweep.missions(shard).len() as u64;
    let report = |work: &Workload| {
        let left = work.left(pool.current_num_threads());
        let done = of - work.missing() as u64;
        on_progress(LabProgress { done, of, loss_rate: None, left, sweep: SweepNumber::ONLY });
    };
    let work = Workload::new(missing.iter().map(|mission| mission.strategy));
    report(&work);
    let record = Mutex::new((record, work));
    pool.install(|| {
        let fly_one = |mission: MissionKey| -> Result<(), LabError> {
            stop.check()?;
            let begin = Instant::now();
            let row = fly(sweep, mission, stop)?;
            let (record, work) = &mut *record.lock().unwrap_or_else(PoisonError::into_inner);
            record.add(row)?;
            work.add(mission.strategy, begin.elapsed());
            report(work);
            Ok(())
        };
        strategies_first(missing).into_iter().par_bridge().try_for_each(fly_one)
    })?;
    let (record, _) = record.into_inner().unwrap_or_else(PoisonError::into_inner);
    record.finish()
}

/// The same missions, the first of each strategy before all others: what the rest takes is then soon known.
fn strategies_first(missions: Vec<MissionKey>) -> Vec<MissionKey> {
    let mut seen = BTreeSet::new();
    let (mut firsts, others): (Vec<_>, Vec<_>) =
        missions.into_iter().partition(|mission| seen.insert(mission.strategy));
    firsts.extend(others);
    firsts
}

/// Joins the shards of a sweep into `out`, which then is as if the sweep had been flown at once.
///
/// # Errors
/// If the shards are not of one sweep, or not all missions are there.
///
/// # Panics
/// Without a shard.
pub fn merge(shards: &[PathBuf], out: &Path) -> Result<MissionRows, LabError> {
    let mut merged: Option<(Definition, MissionRows)> = None;
    let mut folders = BTreeSet::new();
    for path in shards {
        let refuse = |message: &str| InputError::new("shard", path, message);
        let flown = FlownSweep::read("shard", path)?;
        if !folders.insert(fs::canonicalize(path).at(path)?) {
            return Err(refuse("it is named twice: expected each shard once").into());
        }
        let (definition, all) = merged.get_or_insert_with(|| (flown.definition.clone(), MissionRows::new()));
        if *definition != flown.definition {
            return Err(refuse("it is of another sweep than the first").into());
        }
        all.extend(flown.rows);
    }
    let (definition, rows) = merged.expect("the command line wants at least one shard");
    let expected = definition.points.len() * definition.strategies.len() * definition.seeds.len();
    if rows.len() != expected {
        let message = format!("{} of {expected} missions are there: fly the other shards first", rows.len());
        return Err(InputError::new("shard", &shards[0], message).into());
    }
    let mut record = SweepRecord::of(Manifest { shard: Shard::WHOLE, definition }, out, Vec::new())?;
    rows.into_values().try_for_each(|row| record.add(row))?;
    record.finish()
}

/// Flies a mission of the sweep whose strategy is of the registry.
///
/// # Errors
/// If the mission is refused, or on a stop.
///
/// # Panics
/// If the mission is not of this sweep.
pub fn fly(sweep: &Sweep, key: MissionKey, stop: &Stop) -> Result<MissionRow, LabError> {
    let scenario = sweep.scenario(key)?;
    let list = SensorList::of(&scenario)?;
    let mut mission = Mission::new(&scenario, &list)?;
    mission.set_stop(stop);
    let mut meter = MissionMeter::new(&scenario, &list, &mission.header());
    while let Some(flown) = mission.next() {
        meter.add(Some(&flown.plan), &flown.flight, &flown.header, mission.field());
    }
    stop.check()?;
    let is_bounded = scenario.planner.strategy == offline::STRATEGY.name;
    let bounds = is_bounded.then(|| loss_bounds(&scenario, &list, mission.header().totals.lost_bits));
    Ok(MissionRow { key, values: meter.values(mission.field(), None, bounds) })
}
