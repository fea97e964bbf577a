//! `skysink sweep` and `skysink merge`: many missions, in parallel, resumable, with the same bytes however it was done.

pub mod error;
pub mod journal;
pub mod plan;
pub mod results;
pub mod statistics;

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use rayon::ThreadPoolBuilder;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use skysink_common::scenario::{Scenario, Strategy};
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;

use crate::error::LabError;
use crate::metrics::Metrics;
use crate::optimize::loss_bound;
use crate::progress::MissionProgress;
pub use error::SweepError;
use journal::{Journal, Row};
use plan::{Definition, Flight, Sweep};
use skysink_mission::mission::Mission;
use skysink_mission::record::write_whole;
use skysink_mission::summary::Tally;

/// What `sweep.json` holds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Manifest {
    /// Which shard this is, and of how many.
    shard: (usize, usize),
    #[serde(flatten)]
    definition: Definition,
}

/// The folder of a sweep, held against other processes. The system lets go of it when the process ends, however it does.
struct Folder {
    path: PathBuf,
    _lock: File,
}

impl Folder {
    /// Makes the folder, or opens it if it holds this very sweep.
    fn open(path: &Path, manifest: &Manifest) -> Result<Self, LabError> {
        fs::create_dir_all(path).map_err(LabError::file(path))?;
        let file = path.join("sweep.json");
        let other = |what: String| LabError::from(SweepError::Other { path: path.to_owned(), what });
        let held = match fs::read_to_string(&file) {
            Ok(text) => Some(serde_json::from_str::<Manifest>(&text).map_err(|_| other("no sweep".to_owned()))?),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => None,
            Err(error) => return Err(LabError::file(&file)(error)),
        };
        let entries = || fs::read_dir(path).map(|entries| entries.flatten().any(|entry| entry.file_name() != "lock"));
        match held {
            Some(held) if held != *manifest => Err(other("another sweep".to_owned()))?,
            None if entries().map_err(LabError::file(path))? => Err(other("other files".to_owned()))?,
            _ => {}
        }
        let lock_path = path.join("lock");
        let lock = File::options().write(true).create(true).truncate(false).open(&lock_path);
        let lock = lock.map_err(LabError::file(&lock_path))?;
        lock.try_lock().map_err(|_| SweepError::Busy(path.to_owned()))?;
        let text = serde_json::to_string_pretty(manifest).expect("plain values") + "\n";
        write_whole(&file, text.as_bytes())?;
        Ok(Self { path: path.to_owned(), _lock: lock })
    }
}

/// Flies what is missing of a shard of the sweep, on `threads` threads (0: one per core), and writes the results into
/// `out`. Returns all rows. Interrupted, it goes on where it was when it is called again.
///
/// # Errors
/// If the folder holds something else, a mission is refused, something cannot be written, or on a stop.
pub fn sweep(
    sweep: &Sweep,
    out: &Path,
    shard: (usize, usize),
    threads: usize,
    stop: &Stop,
) -> Result<BTreeMap<Flight, Row>, LabError> {
    let folder = Folder::open(out, &Manifest { shard, definition: sweep.definition.clone() })?;
    let (journal, mut rows) = Journal::open(&folder.path.join("journal.csv"))?;
    let flights = sweep.flights(shard);
    let missing: Vec<Flight> = flights.iter().copied().filter(|flight| !rows.contains_key(flight)).collect();
    let progress = MissionProgress::new(flights.len(), flights.len() - missing.len());
    let journal = Mutex::new(journal);
    let pool = ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|error| LabError::file(Path::new("threads"))(std::io::Error::other(error)))?;
    let flown = pool.install(|| {
        let fly_one = |&flight: &Flight| -> Result<Row, LabError> {
            stop.check()?;
            let row = fly(&sweep.scenario(flight)?, flight)?;
            journal.lock().unwrap_or_else(std::sync::PoisonError::into_inner).add(&row)?;
            progress.advance();
            Ok(row)
        };
        missing.par_iter().with_max_len(1).map(fly_one).collect::<Result<Vec<_>, _>>()
    });
    progress.finish();
    rows.extend(flown?.into_iter().map(|row| (row.flight(), row)));
    results::write(&folder.path, &sweep.definition, &rows)?;
    Ok(rows)
}

/// Joins the shards of a sweep into `out`, which then is as if the sweep had been flown at once.
///
/// # Errors
/// If the shards are not of one sweep, or not all missions are there.
pub fn merge(shards: &[PathBuf], out: &Path) -> Result<BTreeMap<Flight, Row>, LabError> {
    let mut merged: Option<(Definition, BTreeMap<Flight, Row>)> = None;
    for path in shards {
        let refuse = |message: String| LabError::from(SweepError::Shard { path: path.clone(), message });
        let text =
            fs::read_to_string(path.join("sweep.json")).map_err(|error| refuse(format!("sweep.json: {error}")))?;
        let manifest: Manifest =
            serde_json::from_str(&text).map_err(|_| refuse("sweep.json is of no sweep".to_owned()))?;
        let rows = journal::read(&path.join("journal.csv"))?;
        let (definition, all) = merged.get_or_insert_with(|| (manifest.definition.clone(), BTreeMap::new()));
        if *definition != manifest.definition {
            return Err(refuse("it is of another sweep than the first".to_owned()));
        }
        all.extend(rows);
    }
    let (definition, rows) = merged.expect("the command line wants at least one shard");
    let expected = definition.points.len() * definition.strategies.len() * definition.seeds.len();
    if rows.len() != expected {
        let message = format!("{} of {expected} missions are there: fly the other shards first", rows.len());
        return Err(SweepError::Shard { path: shards[0].clone(), message }.into());
    }
    let folder = Folder::open(out, &Manifest { shard: (1, 1), definition: definition.clone() })?;
    let (mut journal, there) = Journal::open(&folder.path.join("journal.csv"))?;
    for row in rows.values().filter(|row| !there.contains_key(&row.flight())) {
        journal.add(row)?;
    }
    results::write(&folder.path, &definition, &rows)?;
    Ok(rows)
}

/// Flies one mission.
fn fly(scenario: &Scenario, flight: Flight) -> Result<Row, LabError> {
    let list = SensorList::of(scenario)?;
    let mut mission = Mission::new(scenario, &list);
    let (mut tally, mut metrics) = (Tally::new(scenario, &list), Metrics::new(scenario, list.sensors().len()));
    tally.start(&mission.header());
    for turn in &mut mission {
        tally.add(Some(&turn.plan), &turn.flight, &turn.header);
        metrics.add(&turn.flight);
    }
    let summary = tally.summary(None, std::time::Duration::ZERO, 0);
    let figures = metrics.figures(mission.delivered_bits());
    // What nobody has to lose nobody has to bound.
    let bound = || if summary.lost_bits == 0 { 0.0 } else { loss_bound(scenario, &list) };
    let loss_bound = (scenario.planner.strategy == Strategy::Offline).then(bound);
    Ok(Row {
        point: flight.point,
        strategy: flight.strategy,
        seed: flight.seed,
        loss_rate: summary.loss_rate,
        eta_letter: summary.eta_letter,
        delivered_bits: summary.delivered_bits,
        bits_per_waypoint: summary.bits_per_waypoint,
        mean_served: summary.mean_served,
        flown_m: figures.flown_m,
        energy_j: figures.energy_j,
        aoi_mean_s: figures.aoi_mean_s,
        aoi_p99_s: figures.aoi_p99_s,
        jain: figures.jain,
        loss_bound,
        plan_p50_us: summary.timing.plan_p50_us,
        plan_p99_us: summary.timing.plan_p99_us,
    })
}
