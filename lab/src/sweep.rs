//! `skysink sweep` and `skysink merge`: many missions, in parallel, resumable, with the same bytes however it was done.

pub mod estimate;
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
use folder::{JOURNAL, Manifest, SweepRecord};
use journal::{JournalLines, MissionRow, SweepJournal};
use plan::{Definition, MissionKey, Shard, Sweep};

/// Flies what is missing of a shard of the sweep, on `threads` threads (0: one per core), and writes the results into
/// `out`. Returns their journal. Interrupted, it resumes when it is called again.
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
) -> Result<SweepJournal, LabError> {
    let record = SweepRecord::open(sweep, out, shard)?;
    let mut missing: Vec<_> = record.missing().collect();
    first_of_each_strategy_first(&mut missing);
    let pool = ThreadPoolBuilder::new().num_threads(threads).build().map_err(io::Error::other);
    let pool = pool.at(Path::new("threads"))?;
    let of = sweep.definition.missions(shard).count() as u64;
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
            record.add(&row)?;
            work.add(mission.strategy, begin.elapsed());
            report(work);
            Ok(())
        };
        missing.into_iter().par_bridge().try_for_each(fly_one)
    })?;
    let (record, _) = record.into_inner().unwrap_or_else(PoisonError::into_inner);
    record.finish()
}

/// Puts the first mission of each strategy before all others: what the rest takes is then soon known.
fn first_of_each_strategy_first(missions: &mut [MissionKey]) {
    let mut seen = BTreeSet::new();
    for index in 0..missions.len() {
        if seen.insert(missions[index].strategy) {
            missions[seen.len() - 1..=index].rotate_right(1);
        }
    }
}

/// Whether shards are joined that are not all missions of a sweep.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Completeness {
    /// Every mission has to be there.
    Whole,
    /// Those that are there are joined.
    Partial,
}

/// Joins the shards of a sweep into `out`, which then is as if the sweep had been flown at once.
///
/// # Errors
/// If the shards are not of one sweep, or missions are missing that have to be there.
///
/// # Panics
/// Without a shard.
pub fn merge(shards: &[PathBuf], out: &Path, completeness: Completeness) -> Result<SweepJournal, LabError> {
    let mut folders = BTreeSet::new();
    let mut all: Option<Joined> = None;
    for path in shards {
        let refuse = |message: &str| InputError::new("shard", path, message);
        let Manifest { definition, shard: Shard(_, n) } = folder::manifest("shard", path)?;
        if !folders.insert(fs::canonicalize(path).at(path)?) {
            return Err(refuse("it is named twice: expected each shard once").into());
        }
        let joined = all.get_or_insert_with(|| Joined::of(definition.clone()));
        if joined.definition != definition {
            return Err(refuse("it is of another sweep than the first").into());
        }
        joined.shards = joined.shards.max(n);
        for row in JournalLines::open(&path.join(JOURNAL), &definition)? {
            joined.is_there[definition.index(row?.key).expect("lines of other missions are refused")] = true;
        }
    }
    let joined = all.expect("the command line wants at least one shard");
    if let (Completeness::Whole, Some(message)) = (completeness, joined.missing()) {
        return Err(InputError::new("shard", &shards[0], message).into());
    }
    let definition = joined.definition;
    let manifest = Manifest { shard: Shard::WHOLE, definition: definition.clone() };
    let mut record = SweepRecord::of(manifest, out)?;
    for path in shards {
        JournalLines::open(&path.join(JOURNAL), &definition)?.try_for_each(|row| record.add(&row?))?;
    }
    record.write()
}

/// Which missions of a sweep its shards have.
struct Joined {
    definition: Definition,
    /// Shards that the sweep was cut into, as far as those that are joined say.
    shards: usize,
    /// By the order of the results.
    is_there: Vec<bool>,
}

impl Joined {
    fn of(definition: Definition) -> Self {
        let is_there = vec![false; definition.fields() * definition.strategies.len()];
        Self { definition, shards: 1, is_there }
    }

    /// What to do about missions that are missing; nothing if none is.
    fn missing(&self) -> Option<String> {
        let count = self.is_there.iter().filter(|&&is_there| is_there).count();
        let expected = self.is_there.len();
        let is_missing = |key: MissionKey| self.definition.index(key).is_none_or(|index| !self.is_there[index]);
        let n = self.shards;
        let missing = ranges((1..=n).filter(|&k| self.definition.missions(Shard(k, n)).any(is_missing)));
        let remedy = format!("fly shards {missing} of {n}, as by --array={missing} and --shard auto/{n}");
        (count < expected).then(|| format!("{count} of {expected} missions are there: {remedy}, or pass --partial"))
    }
}

/// Ascending numbers as a list of ranges, such as `1,3-5`.
fn ranges(numbers: impl Iterator<Item = usize>) -> String {
    let mut ranges: Vec<[usize; 2]> = Vec::new();
    for number in numbers {
        match ranges.last_mut() {
            Some([_, last]) if *last + 1 == number => *last = number,
            _ => ranges.push([number; 2]),
        }
    }
    let text = |&[first, last]: &[usize; 2]| if first == last { first.to_string() } else { format!("{first}-{last}") };
    ranges.iter().map(text).collect::<Vec<_>>().join(",")
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_are_ranges() {
        for (numbers, text) in [(&[][..], ""), (&[4], "4"), (&[1, 3, 4, 5, 9, 10], "1,3-5,9-10")] {
            assert_eq!(ranges(numbers.iter().copied()), text);
        }
    }
}
