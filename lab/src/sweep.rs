//! `skysink sweep` and `skysink merge`: many missions, in parallel, resumable, with the same bytes however it was done.

pub mod journal;
pub mod plan;
pub(crate) mod results;
pub(crate) mod statistics;

use std::collections::BTreeSet;
use std::fs::{self, File, TryLockError};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use rayon::ThreadPoolBuilder;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use skysink_common::error::InputError;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::error::FileContext;
use skysink_mission::record::{is_unfinished, write_whole};
use skysink_mission::summary::Tally;
use skysink_mission::{Mission, MissionError};
use skysink_planner::strategies::offline;

use crate::error::LabError;
use crate::metrics::MissionSums;
use crate::optimize::loss_bounds;
use crate::progress::{LabProgress, OnProgress, SweepNumber, Workload};
use journal::{MissionRow, MissionRows, SweepJournal};
use plan::{Definition, MissionKey, Shard, Sweep};

/// The journal in the folder of a sweep.
const JOURNAL: &str = "journal.csv";

/// What says there which sweep it is.
const MANIFEST: &str = "sweep.json";

/// What `sweep.json` holds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Manifest {
    shard: Shard,
    #[serde(flatten)]
    definition: Definition,
}

/// Makes the folder of a sweep, or opens it if it holds this very sweep, and locks it against other processes. The
/// system releases the lock when the file is dropped or the process ends.
fn lock_folder(path: &Path, manifest: &Manifest) -> Result<File, LabError> {
    let refuse = |message| InputError::new("sweep folder", path, message);
    if path.exists() && !path.is_dir() {
        return Err(refuse("it is a file: choose another --out").into());
    }
    fs::create_dir_all(path).at(path)?;
    holds(path, manifest)?; // before a lock file is made
    let lock_path = path.join("lock");
    let lock = File::options().write(true).create(true).truncate(false).open(&lock_path).at(&lock_path)?;
    lock.try_lock().map_err(|error| match error {
        TryLockError::WouldBlock => {
            MissionError::from(refuse("another process is flying this sweep: end it, or choose another --out"))
        }
        TryLockError::Error(source) => MissionError::File { path: lock_path, source },
    })?;
    if !holds(path, manifest)? {
        let text = serde_json::to_string_pretty(manifest).expect("plain values") + "\n";
        write_whole(&path.join(MANIFEST), text.as_bytes())?;
    }
    Ok(lock)
}

/// Whether the folder holds the sweep; an error if it holds something else.
fn holds(path: &Path, manifest: &Manifest) -> Result<bool, LabError> {
    let refuse = |message| InputError::new("sweep folder", path, message);
    let file = path.join(MANIFEST);
    match fs::read(&file) {
        Ok(text) => {
            let held: Manifest = serde_json::from_slice(&text)
                .map_err(|_| refuse("its sweep.json is of no sweep: choose another --out"))?;
            if held != *manifest {
                return Err(refuse("its sweep.json is of another sweep: choose another --out").into());
            }
            Ok(true)
        }
        Err(error) if error.kind() == ErrorKind::NotFound => {
            // Without sweep.json nothing was flown: a process was killed at most while it wrote that.
            let is_foreign = |entry: fs::DirEntry| entry.file_name() != "lock" && !is_unfinished(&entry.file_name());
            if fs::read_dir(path).at(path)?.flatten().any(is_foreign) {
                return Err(refuse("it holds other files: choose another --out").into());
            }
            Ok(false)
        }
        Err(source) => Err(MissionError::File { path: file, source }.into()),
    }
}

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
    let _lock = lock_folder(out, &Manifest { shard, definition: sweep.definition.clone() })?;
    let (journal, mut rows) = SweepJournal::open(&out.join(JOURNAL), &sweep.definition)?;
    let missions = sweep.missions(shard);
    let missing: Vec<MissionKey> = missions.iter().copied().filter(|mission| !rows.contains_key(mission)).collect();
    let pool = ThreadPoolBuilder::new().num_threads(threads).build().map_err(io::Error::other);
    let pool = pool.at(Path::new("threads"))?;
    let report = |work: &Workload| {
        let done = (missions.len() - work.missing()) as u64;
        let left = work.left(pool.current_num_threads());
        on_progress(LabProgress { done, of: missions.len() as u64, loss_rate: None, left, sweep: SweepNumber::ONLY });
    };
    let work = Workload::new(missing.iter().map(|mission| mission.strategy));
    report(&work);
    let record = Mutex::new((journal, work));
    let new_rows = pool.install(|| {
        let fly_one = |mission: MissionKey| -> Result<MissionRow, LabError> {
            stop.check()?;
            let begin = Instant::now();
            let row = fly(&sweep.scenario(mission)?, mission, stop)?;
            let (journal, work) = &mut *record.lock().unwrap_or_else(PoisonError::into_inner);
            journal.add(&row)?;
            work.add(mission.strategy, begin.elapsed());
            report(work);
            Ok(row)
        };
        strategies_first(missing).into_iter().par_bridge().map(fly_one).collect::<Result<Vec<_>, _>>()
    })?;
    rows.extend(new_rows.into_iter().map(|row| (row.key, row)));
    results::write(out, &sweep.definition, &rows)?;
    Ok(rows)
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
        let refuse = |message: String| InputError::new("shard", path, message);
        if path.is_file() {
            return Err(refuse("it is a file: expected the folder of a sweep".to_owned()).into());
        }
        let text = fs::read(path.join(MANIFEST));
        let text = text.map_err(|error| refuse(format!("{MANIFEST}: {error}: expected the folder of a sweep")))?;
        if !folders.insert(fs::canonicalize(path).at(path)?) {
            return Err(refuse("it is named twice: expected each shard once".to_owned()).into());
        }
        let manifest: Manifest = serde_json::from_slice(&text)
            .map_err(|error| refuse(format!("{MANIFEST}: {error}: expected that of a sweep, fly the shard again")))?;
        let journal = path.join(JOURNAL);
        if !journal.is_file() {
            return Err(refuse(format!("it has no {JOURNAL}: fly the shard first")).into());
        }
        let rows = journal::read(&journal, &manifest.definition)?;
        let (definition, all) = merged.get_or_insert_with(|| (manifest.definition.clone(), MissionRows::new()));
        if *definition != manifest.definition {
            return Err(refuse("it is of another sweep than the first".to_owned()).into());
        }
        all.extend(rows);
    }
    let (definition, rows) = merged.expect("the command line wants at least one shard");
    let expected = definition.points.len() * definition.strategies.len() * definition.seeds.len();
    if rows.len() != expected {
        let message = format!("{} of {expected} missions are there: fly the other shards first", rows.len());
        return Err(InputError::new("shard", &shards[0], message).into());
    }
    let _lock = lock_folder(out, &Manifest { shard: Shard::WHOLE, definition: definition.clone() })?;
    let (mut journal, there) = SweepJournal::open(&out.join(JOURNAL), &definition)?;
    for row in rows.values().filter(|row| !there.contains_key(&row.key)) {
        journal.add(row)?;
    }
    results::write(out, &definition, &rows)?;
    Ok(rows)
}

/// Flies one mission.
fn fly(scenario: &Scenario, key: MissionKey, stop: &Stop) -> Result<MissionRow, LabError> {
    let list = SensorList::of(scenario)?;
    let mut mission = Mission::new(scenario, &list)?;
    mission.set_stop(stop);
    let mut tally = Tally::new(scenario, &list);
    let mut sums = MissionSums::new(scenario, &list);
    tally.start(&mission.header());
    while let Some(flown) = mission.next() {
        tally.add(Some(&flown.plan), &flown.flight, &flown.header);
        sums.add(&flown.flight, mission.field().queues_bits(), mission.field().delivered_bits());
    }
    stop.check()?;
    let summary = tally.summary(None, Duration::ZERO, 0);
    let is_bounded = scenario.planner.strategy == offline::STRATEGY.name;
    let bounds = is_bounded.then(|| loss_bounds(scenario, &list, summary.totals.lost_bits));
    Ok(MissionRow { key, values: sums.values(&summary, mission.field().delivered_bits(), bounds) })
}
