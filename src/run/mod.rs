//! `skysink run`: a mission with a process for every part of the ring.

pub mod heartbeat;
pub mod recorder;
pub mod restart;
pub mod resume;
pub mod supervise;

use std::ffi::OsString;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser as _};
use iceoryx2::prelude::ipc;
use skysink_common::pace::Pace;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::error::FileContext;
use skysink_mission::record::{RunFolder, SlotLog};
use skysink_mission::summary::{Summary, Tally};
use skysink_ring::cleanup::Janitor;
use skysink_ring::folder::RingFolder;
use skysink_ring::role::Role;
use skysink_ring::topics::{Ring, VIEWER_BUFFER};
use skysink_ring::wait::Waiting;

use crate::error::Error;
use crate::report::TerminalProgress;
use crate::simulate::NewFolder;
use recorder::Recorder;
use restart::{Rule, WORKERS, worker};
use resume::{PlansBy, resume};
use supervise::{Process, ProcessTable, REAP, Workers};

/// What to run, where and how.
#[derive(Debug)]
pub struct Run {
    /// The scenario.
    pub scenario: Scenario,
    /// Where a new run is put on record.
    pub folder: NewFolder,
    /// The folder of a run that has ended early, if it is to be resumed.
    pub resume: Option<PathBuf>,
    /// How.
    pub options: RunOptions,
}

/// How the processes of a run work together.
#[derive(Debug, Default, Args)]
pub struct RunOptions {
    /// max, realtime, or a factor such as 10x.
    #[arg(long, default_value = "max", value_name = "PACE")]
    pub pace: Pace,
    /// How the processes wait for each other: event, asleep until they are woken; or poll, which is quicker and keeps
    /// every core busy.
    #[arg(long, default_value = "event", value_name = "HOW", value_parser = PossibleValuesParser::new(Waiting::NAMES)
        .map(|name| name.parse::<Waiting>().expect("one of the possible values")))]
    pub wait: Waiting,
    /// Serve the recording live on 127.0.0.1, on port 9876 if none is given.
    #[arg(long, value_name = "PORT", num_args = 0..=1, require_equals = true, default_missing_value = "9876")]
    pub live: Option<u16>,
    /// Leave the recording out.
    #[arg(long, conflicts_with = "live")]
    pub no_viewer: bool,
    /// Leave this process to somebody else and wait for it (repeatable).
    #[arg(long, value_name = "ROLE", value_parser = PossibleValuesParser::new(WORKERS.map(Role::name))
        .map(|name| worker(&name).expect("one of the possible values")))]
    pub external: Vec<Role>,
    /// What is done when a process ends too early: never, or on-failure; planner=never for one of them (repeatable)
    /// [default: on-failure, at most 50 times in 10 s].
    #[arg(long, value_name = "POLICY")]
    pub restart: Vec<Rule>,
    /// How long a process waits for another [s; default 30, with --external 600].
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub timeout: Option<f64>,
}

/// Reads a time [s] above 0 from an argument.
///
/// # Errors
/// If it is none.
pub fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if seconds > 0.0 && seconds <= 1e6 => Ok(seconds),
        _ => Err("expected seconds, above 0, at most 1000000".to_owned()),
    }
}

/// Flies the mission, and returns its folder and its figures. However it ends, the folder is whole up to the last slot
/// and nothing is left in shared memory. `table` tells other threads of its processes.
///
/// # Errors
/// If this build has no viewer, the sensor list is refused, a process ends for good or does not answer, something
/// cannot be written, or on a stop.
pub fn run(run: &Run, stop: &Stop, table: &ProcessTable) -> Result<(RunFolder, Summary), Error> {
    let Run { scenario, options, .. } = run;
    let list = SensorList::of(scenario)?;
    options.check(&list)?;
    let mut tally = Tally::new(scenario, &list).with_latency(options.pace, scenario.slot_s);
    let (folder, resumed) = match &run.resume {
        None => (run.folder.create(scenario, &list)?, None),
        Some(path) => {
            let folder = RunFolder::reopen(path)?;
            let is_outside = options.external.contains(&Role::Planner);
            let plans_by = if is_outside { PlansBy::Outside } else { PlansBy::Planner };
            let resumed = resume(&folder, scenario, &list, plans_by, &mut tally)?;
            (folder, Some(resumed))
        }
    };
    if tally.last_slot() == scenario.slots {
        let hash = resumed.map_or(0, |resumed| resumed.log.hash());
        let summary = tally.summary(Some(options.pace), Duration::ZERO, hash);
        if !folder.is_complete() {
            folder.write_json("summary.json", &summary)?; // only that was missing
        }
        return Ok((folder, summary));
    }
    let timeout_s = options.timeout.unwrap_or(if options.external.is_empty() { 30.0 } else { 600.0 });
    let ring_folder = RingFolder::create(options.pace, options.wait, timeout_s, !options.no_viewer)?;
    ring_folder.install()?;
    let mut log = match resumed {
        None => folder.slot_log()?,
        Some(resumed) => resumed.hand_over(&ring_folder)?,
    };
    let begin = Instant::now();
    let flown = fly(run, &folder, &ring_folder, table, stop, &mut log, &mut tally);
    let wall = *flown.as_ref().unwrap_or(&begin.elapsed());
    let mut summary = tally.summary(Some(options.pace), wall, log.hash());
    summary.complete &= flown.is_ok();
    let written = folder.write_json("summary.json", &summary);
    if let Err(cause) = flown {
        let left = match summary.slots {
            0 => "nothing was flown".to_owned(),
            slots => format!(
                "the run folder is whole up to slot {slots}, and `skysink run --resume {}` flies the rest",
                folder.path().display()
            ),
        };
        return Err(Error::EndedEarly { cause: Box::new(cause), left }); // not what it led to
    }
    written?;
    Ok((folder, summary))
}

/// Starts the processes, records what they do, and ends them.
fn fly(
    run: &Run,
    folder: &RunFolder,
    ring_folder: &RingFolder,
    table: &ProcessTable,
    stop: &Stop,
    log: &mut SlotLog,
    tally: &mut Tally,
) -> Result<Duration, Error> {
    let Run { scenario, options, .. } = run;
    let progress = TerminalProgress::of_slots();
    let (ring, wait) = Ring::<ipc::Service>::join(ring_folder, scenario, Role::Launcher, stop)?;
    let _janitor = Janitor::of(ring_folder);
    let _ = table.shared_prefix.set(ring_folder.prefix());
    let mut recorder = Recorder::new(&ring, wait)?;
    let mut processes = Vec::new();
    for role in WORKERS.into_iter().filter(|role| *role != Role::Viewer || !options.no_viewer) {
        let mut arguments: Vec<OsString> =
            vec!["--scenario".into(), folder.scenario().into(), "--ring".into(), ring_folder.path().into()];
        if role == Role::Viewer {
            arguments.extend(["--save".into(), folder.recording().into()]);
            arguments.extend(options.live.map(|port| format!("--live={port}").into()));
        }
        if options.external.contains(&role) {
            let arguments = arguments.join(" ".as_ref());
            let name = role.name();
            progress.say(&format!("waiting for {name}: {name} {}", arguments.to_string_lossy()));
        } else {
            processes.push(Process::new(role, arguments, Rule::policy(&options.restart, role))?);
        }
    }
    let mut workers = Workers::start(&ring, ring_folder, table, &progress, processes, scenario.slots)?;
    let recorded = recorder.record(scenario.slots, log, tally, &mut |tally| workers.supervise(tally));
    let ended = match recorded {
        Ok(wall) => finish(&mut recorder, &mut workers, tally, log.hash(), ring.terms.timeout()).map(|()| wall),
        Err(error) => Err(match workers.supervise(tally) {
            Err(cause @ Error::WorkerEnded { .. }) if stop.requested().is_none() => cause,
            _ => error,
        }),
    };
    drop(workers);
    ring.remove_dead_nodes();
    ended
}

/// How long a process may take to end by itself once it is released.
const END_TIMEOUT: Duration = Duration::from_secs(2);

/// Waits until all processes have ended, the viewer first: the others are there for it, and for one that is started
/// again.
fn finish(
    recorder: &mut Recorder<ipc::Service>,
    workers: &mut Workers<ipc::Service>,
    tally: &mut Tally,
    hash: u64,
    timeout: Duration,
) -> Result<(), Error> {
    let slot = tally.last_slot();
    let mut viewer = workers.supervise(tally)?;
    let mut deadline = Instant::now() + timeout;
    while !workers.have_ended(|role| role == Role::Viewer) {
        recorder.pause(REAP)?;
        let current = workers.supervise(tally)?;
        if current != viewer {
            viewer = current;
            deadline = Instant::now() + timeout;
        }
        if Instant::now() > deadline {
            return Err(Error::ViewerStays { seconds: timeout.as_secs_f64(), slot });
        }
    }
    workers.release();
    recorder.release(slot, hash)?;
    let released = Instant::now();
    while !workers.have_ended(|_| true) && released.elapsed() < END_TIMEOUT {
        recorder.pause(REAP)?;
        workers.supervise(tally)?;
    }
    Ok(())
}

impl RunOptions {
    /// Fails early where this build has no viewer, or the shared memory would not do: writing beyond its end kills a
    /// process.
    ///
    /// # Errors
    /// [`Error::NoViewer`] or [`Error::SharedMemory`].
    pub fn check(&self, list: &SensorList) -> Result<(), Error> {
        const MIB: u64 = 1 << 20;
        if !self.no_viewer && !cfg!(feature = "viewer") {
            return Err(Error::NoViewer);
        }
        let path = std::path::Path::new("/dev/shm");
        let free = rustix::fs::statvfs(path).map_err(std::io::Error::from).at(path)?;
        let free_bytes = free.f_bavail * free.f_frsize;
        let samples = if self.no_viewer { 8 } else { VIEWER_BUFFER as u64 + 8 };
        let bytes_per_sensor = samples * 4 + 3 * 40; // queues in flight, the sensor list
        let needed_bytes = 8 * MIB + bytes_per_sensor * list.sensors().len() as u64;
        if free_bytes >= needed_bytes {
            return Ok(());
        }
        Err(Error::SharedMemory { free_mib: free_bytes / MIB, needed_mib: needed_bytes.div_ceil(MIB) })
    }
}
