//! `skysink run`: a mission with a process for every part of the ring.

use std::ffi::OsString;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use iceoryx2::prelude::ipc;
use skysink_common::node::{Role, Stop};
use skysink_common::pace::Pace;
use skysink_common::ring::Ring;
use skysink_common::ring_folder::RingFolder;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::topic::VIEWER_BUFFER;

use crate::error::Error;
use crate::launch::{Crew, Job};
use crate::record::RunFolder;
use crate::recorder::Recorder;
use crate::report::Progress;
use crate::summary::{Summary, Tally};

/// What to run and how.
#[derive(Debug)]
pub struct Run {
    /// The scenario.
    pub scenario: Scenario,
    /// How fast.
    pub pace: Pace,
    /// Folder, if not the default one.
    pub out: Option<PathBuf>,
    /// Whether a run in that folder may be replaced.
    pub force: bool,
    /// Whether the viewer takes part.
    pub viewer: bool,
    /// Port on which the viewer serves the recording live.
    pub live: Option<u16>,
    /// Roles that somebody else starts.
    pub external: Vec<Role>,
    /// How long a process waits for another [s].
    pub timeout_s: f64,
}

/// Flies the mission, and returns its folder and its figures. However it ends, the folder is whole up to the last slot
/// and nothing is left in shared memory.
///
/// # Errors
/// If the sensor list is refused, a process ends or does not answer, something cannot be written, or on a stop.
pub fn run(run: &Run, stop: &Stop) -> Result<(RunFolder, Summary), Error> {
    let list = SensorList::of(&run.scenario)?;
    check_shared_memory(run, &list)?;
    let folder = RunFolder::create(run.out.as_deref(), run.force, &run.scenario, &list)?;
    let meeting = RingFolder::create(run.pace, run.timeout_s, run.viewer)?;
    meeting.install()?;
    let progress = Progress::new(run.scenario.slots);
    let mut tally = Tally::new(&run.scenario, &list);
    let begin = Instant::now();
    let flown = fly(run, stop, &folder, &meeting, &progress, &mut tally);
    progress.finish();
    let wall = *flown.as_ref().unwrap_or(&begin.elapsed());
    let mut summary = tally.summary(Some(run.pace), wall);
    summary.complete &= flown.is_ok();
    folder.write_summary(&summary)?;
    flown?;
    Ok((folder, summary))
}

/// Starts the processes, records what they do, and ends them.
fn fly(
    run: &Run,
    stop: &Stop,
    folder: &RunFolder,
    meeting: &RingFolder,
    progress: &Progress,
    tally: &mut Tally,
) -> Result<Duration, Error> {
    let mut log = folder.slot_log()?;
    let ring = Ring::<ipc::Service>::create(meeting, &run.scenario)?;
    let mut recorder = Recorder::new(&ring, run.scenario.slot_s, stop)?;
    let (own, others): (Vec<Job>, Vec<Job>) =
        jobs(run, folder, meeting).into_iter().partition(|job| !run.external.contains(&job.role));
    let mut crew = Crew::start(own, progress.speaker())?;
    for job in others {
        let role = job.role.name();
        let arguments: Vec<_> = job.arguments.iter().map(|argument| argument.to_string_lossy()).collect();
        progress.say(&format!("waiting for {role}: {role} {}", arguments.join(" ")));
    }
    let mut patience = ring.patience(meeting, stop)?;
    let recorded = recorder.record(run.scenario.slots, &mut patience, &mut log, tally, |tally| {
        progress.show(tally);
        crew.check(tally.slots() + 1)
    });
    let ended = match recorded {
        Ok(wall) => {
            progress.show(tally);
            crew.finish(ring.timeout(), run.scenario.slots, || Ok(stop.check()?)).map(|()| wall)
        }
        Err(error) => Err(match crew.check(tally.slots() + 1) {
            Err(cause @ Error::WorkerEnded { .. }) if stop.requested().is_none() => cause,
            _ => error,
        }),
    };
    ring.remove_dead_nodes();
    ended
}

/// The processes of the run, whoever starts them.
fn jobs(run: &Run, folder: &RunFolder, meeting: &RingFolder) -> Vec<Job> {
    let common = |role| {
        let arguments: Vec<OsString> =
            vec!["--scenario".into(), folder.scenario().into(), "--ring".into(), meeting.path().into()];
        Job { role, arguments }
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
    let free = rustix::fs::statvfs(path).map_err(|error| Error::file(path)(error.into()))?;
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
