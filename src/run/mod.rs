//! `skysink run`: a mission with a process for every part of the ring.

pub mod launch;
pub mod recorder;
pub mod restart;
pub mod resume;
pub mod watch;

use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::time::{Duration, Instant};

use iceoryx2::prelude::ipc;
use skysink_common::pace::Pace;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_ring::cleanup::Janitor;
use skysink_ring::folder::RingFolder;
use skysink_ring::role::Role;
use skysink_ring::topics::{Ring, VIEWER_BUFFER};
use skysink_ring::wait::Waiting;

use crate::error::Error;
use crate::report::RunProgress;
use launch::{Crew, Job, REAP, Roster, whole};
use recorder::Recorder;
use restart::Rule;
use resume::{PlansBy, Resumed, resume};
use skysink_mission::error::FileContext;
use skysink_mission::record::{RunFolder, SlotLog};
use skysink_mission::summary::{Event, Summary, Tally};
use watch::{Alarm, Watch};

/// What to run and how.
#[derive(Debug)]
pub struct Run {
    /// The scenario.
    pub scenario: Scenario,
    /// How fast.
    pub pace: Pace,
    /// How its processes wait for each other.
    pub wait: Waiting,
    /// Where the run is put on record.
    pub place: RunPlace,
    /// Whether the viewer takes part.
    pub viewer: bool,
    /// Port on which the viewer serves the recording live.
    pub live: Option<u16>,
    /// Roles that somebody else starts.
    pub external: Vec<Role>,
    /// What is done about processes that end too early.
    pub restart: Vec<Rule>,
    /// How long a process waits for another [s].
    pub timeout_s: f64,
}

/// The folder of a run.
#[derive(Debug)]
pub enum RunPlace {
    /// A new one.
    New {
        /// If not the default one.
        out: Option<PathBuf>,
        /// Whether a run in that folder may be replaced.
        force: bool,
    },
    /// That of a run that has ended early, which goes on.
    Resume(PathBuf),
}

/// A run that is set up: what it flies, and where it is put on record.
struct Setup<'a> {
    run: &'a Run,
    folder: &'a RunFolder,
    meeting: &'a RingFolder,
    progress: &'a RunProgress,
    stop: &'a Stop,
}

/// A run under way, for who wants to disturb it.
#[derive(Debug)]
pub struct Inside {
    /// The processes that live.
    pub roster: Roster,
    /// The slot under way, a tenth of a second ago at most.
    pub slot: Arc<AtomicU64>,
    /// Beginning of the names of its shared memory.
    pub shared_prefix: String,
}

/// What has become of the processes of a run.
#[derive(Default)]
struct Fates {
    events: Vec<Event>,
    restarts: u64,
}

/// Flies the mission, and returns its folder and its figures. However it ends, the folder is whole up to the last slot
/// and nothing is left in shared memory.
///
/// # Errors
/// If the sensor list is refused, a process ends for good or does not answer, something cannot be written, or on a stop.
pub fn run(run: &Run, stop: &Stop) -> Result<(RunFolder, Summary), Error> {
    run_with(run, stop, |_| {})
}

/// The same; `started` is told of the processes.
///
/// # Errors
/// As [`run`].
pub fn run_with(run: &Run, stop: &Stop, started: impl FnOnce(Inside)) -> Result<(RunFolder, Summary), Error> {
    let list = SensorList::of(&run.scenario)?;
    check_shared_memory(run, &list)?;
    let mut tally = Tally::new(&run.scenario, &list).with_latency(run.pace, run.scenario.slot_s);
    let (folder, resumed) = match &run.place {
        RunPlace::New { out, force } => (RunFolder::create(out.as_deref(), *force, &run.scenario, &list)?, None),
        RunPlace::Resume(path) => {
            let folder = RunFolder::reopen(path)?;
            let outside = run.external.contains(&Role::Planner);
            let plans_by = if outside { PlansBy::Outside } else { PlansBy::Planner };
            let resumed = resume(&folder, &run.scenario, &list, plans_by, &mut tally)?;
            (folder, Some(resumed))
        }
    };
    if tally.last_slot() == run.scenario.slots {
        let hash = resumed.map_or(0, |resumed| resumed.log.hash());
        let summary = tally.summary(Some(run.pace), Duration::ZERO, hash); // only that was missing
        folder.write_summary(&summary)?;
        return Ok((folder, summary));
    }
    let meeting = RingFolder::create(run.pace, run.wait, run.timeout_s, run.viewer)?;
    meeting.install()?;
    let mut log = prepare(&folder, &meeting, resumed)?;
    let progress = RunProgress::new(run.scenario.slots);
    let setup = Setup { run, folder: &folder, meeting: &meeting, progress: &progress, stop };
    let (mut fates, begin) = (Fates::default(), Instant::now());
    let flown = fly(&setup, &mut log, &mut tally, &mut fates, started);
    progress.finish();
    let wall = *flown.as_ref().unwrap_or(&begin.elapsed());
    let mut summary = tally.summary(Some(run.pace), wall, log.hash());
    summary.complete &= flown.is_ok();
    (summary.events, summary.restarts) = (fates.events, fates.restarts);
    let written = folder.write_summary(&summary);
    flown?; // what ended the run is said, not what it led to
    written?;
    Ok((folder, summary))
}

/// The trace to write, from the beginning or from where it ended.
fn prepare(folder: &RunFolder, meeting: &RingFolder, resumed: Option<Resumed>) -> Result<SlotLog, Error> {
    match resumed {
        None => Ok(folder.slot_log()?),
        Some(mut resumed) => {
            resumed.log.resume()?;
            resumed.save(meeting)?;
            Ok(resumed.log)
        }
    }
}

/// Starts the processes, records what they do, and ends them.
fn fly(
    setup: &Setup,
    log: &mut SlotLog,
    tally: &mut Tally,
    fates: &mut Fates,
    started: impl FnOnce(Inside),
) -> Result<Duration, Error> {
    let Setup { run, meeting, progress, stop, .. } = *setup;
    let (ring, wait) = Ring::<ipc::Service>::join(meeting, &run.scenario, Role::Launcher, stop)?;
    let _janitor = Janitor::of(meeting);
    let alarm = Alarm::on_child();
    let mut recorder = Recorder::new(&ring, wait, run.scenario.slot_s, alarm)?;
    let (own, others): (Vec<Job>, Vec<Job>) =
        jobs(setup).into_iter().partition(|job| !run.external.contains(&job.role));
    let crew = Crew::start(own, meeting.path(), ring.terms.timeout() / 2, Arc::new(progress.speaker()))?;
    let slot = Arc::new(AtomicU64::new(0));
    started(Inside { roster: crew.roster(), slot: Arc::clone(&slot), shared_prefix: meeting.prefix() });
    for job in others {
        let role = job.role.name();
        let arguments: Vec<_> = job.arguments.iter().map(|argument| argument.to_string_lossy()).collect();
        progress.say(&format!("waiting for {role}: {role} {}", arguments.join(" ")));
    }
    let mut watch = Watch::new(&ring, crew, progress, run.scenario.slots, slot)?;
    let slots = run.scenario.slots;
    let recorded = recorder.record(slots, log, tally, &mut |tally| watch.supervise(tally));
    let ended = match recorded {
        Ok(wall) => finish(&mut recorder, &mut watch, tally, log.hash()).map(|()| wall),
        Err(error) => Err(match watch.supervise(tally) {
            Err(cause @ Error::WorkerEnded { .. }) if stop.requested().is_none() => cause,
            _ => error,
        }),
    };
    (fates.events, fates.restarts) = (std::mem::take(&mut watch.events), watch.restarts);
    drop(watch);
    ring.remove_dead_nodes();
    ended
}

/// How long a process may take to end by itself once it is released.
const FAREWELL: Duration = Duration::from_secs(2);

/// Waits until all processes have ended, the viewer first: the others are there for it, and for one that is started again.
fn finish(
    recorder: &mut Recorder<ipc::Service>,
    watch: &mut Watch<ipc::Service>,
    tally: &Tally,
    hash: u64,
) -> Result<(), Error> {
    let slot = tally.last_slot();
    let mut viewer = watch.supervise(tally)?;
    let timeout = recorder.timeout();
    let mut deadline = Instant::now() + timeout;
    while !watch.crew().has_ended(Role::Viewer) {
        recorder.pause(REAP)?;
        let current = watch.supervise(tally)?;
        if current != viewer {
            viewer = current;
            deadline = Instant::now() + timeout;
        }
        if Instant::now() > deadline {
            let role = Role::Viewer.name();
            let status = format!("nothing: it did not end within {} s after the mission", timeout.as_secs_f64());
            return Err(Error::WorkerEnded { role, status, slot, whole: whole(slot + 1) });
        }
    }
    watch.release();
    recorder.release(slot, hash)?;
    let released = Instant::now();
    while !watch.crew().have_ended() && released.elapsed() < FAREWELL {
        recorder.pause(REAP)?;
        watch.supervise(tally)?;
    }
    Ok(())
}

/// The processes of the run, whoever starts them.
fn jobs(setup: &Setup) -> Vec<Job> {
    let Setup { run, folder, meeting, .. } = *setup;
    let common = |role| {
        let arguments: Vec<OsString> =
            vec!["--scenario".into(), folder.scenario().into(), "--ring".into(), meeting.path().into()];
        Job { role, arguments, restart: Rule::policy(&run.restart, role) }
    };
    let mut jobs: Vec<Job> = [Role::FieldSim, Role::FlightSim, Role::Planner].into_iter().map(common).collect();
    if run.viewer {
        let mut job = common(Role::Viewer);
        job.arguments.extend(["--save".into(), folder.recording().into()]);
        job.arguments.extend(run.live.map(|port| OsString::from(format!("--live={port}"))));
        jobs.push(job);
    }
    jobs
}

/// Fails early where the shared memory would not do: writing beyond its end kills a process.
fn check_shared_memory(run: &Run, list: &SensorList) -> Result<(), Error> {
    const MIB: u64 = 1 << 20;
    let path = std::path::Path::new("/dev/shm");
    let free = rustix::fs::statvfs(path).map_err(std::io::Error::from).at(path)?;
    let free_bytes = free.f_bavail * free.f_frsize;
    let samples = if run.viewer { VIEWER_BUFFER as u64 + 8 } else { 8 };
    let bytes_per_sensor = samples * 4 + 3 * 40; // queues in flight, the sensor list
    let needed_bytes = 8 * MIB + bytes_per_sensor * list.sensors().len() as u64;
    if free_bytes >= needed_bytes {
        return Ok(());
    }
    let remedy = "make it larger (docker: --shm-size), or pass --no-viewer, which needs less";
    Err(Error::SharedMemory { free_mib: free_bytes / MIB, needed_mib: needed_bytes.div_ceil(MIB), remedy })
}
