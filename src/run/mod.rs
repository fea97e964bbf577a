//! `skysink run`: a mission with a process for every part of the ring.

pub mod heartbeat;
pub mod limits;
pub mod link;
pub mod options;
pub mod outside;
pub mod recorder;
pub mod restart;
pub mod resume;
pub mod supervise;

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use iceoryx2::prelude::ipc;
use skysink_common::pace::Pace;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::origin::RunMode;
use skysink_mission::record::RunFolder;
use skysink_mission::summary::{Summary, Tally};
use skysink_ring::cleanup::Janitor;
use skysink_ring::folder::{RingFolder, clear_abandoned};
use skysink_ring::role::Role;
use skysink_ring::topics::Ring;
use skysink_ring::wait::Stopwatch;

use crate::error::Error;
use crate::report::TerminalProgress;
use crate::simulate::NewFolder;
use link::Link;
use options::{Launch, RunOptions};
use recorder::{Recorder, SlotSink};
use restart::{Rule, WORKERS};
use resume::resume;
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
    let (folder, resumed) = match &run.resume {
        None => (run.folder.create(scenario, &list, &options.manner(None))?, None),
        Some(path) => {
            let folder = RunFolder::reopen(path)?;
            options.check_resumed(&folder)?;
            let mut tally = Tally::new(scenario, &list);
            let resumed = resume(&folder, scenario, &list, &mut tally, stop)?;
            (folder, Some((resumed, tally)))
        }
    };
    let manner = options.manner(Some(folder.run_mode()));
    let pace = manner.pace.unwrap_or_default();
    let (resumed, tally) =
        resumed.map_or_else(|| (None, Tally::new(scenario, &list)), |(resumed, tally)| (Some(resumed), tally));
    let mut tally = tally.with_latency(pace, scenario.slot_s);
    if let Some(planner) = &manner.external_planner {
        tally = tally.with_planner(planner);
    }
    if tally.last_slot() == scenario.slots {
        let hash = resumed.map_or(0, |resumed| resumed.log.hash());
        let summary = tally.summary(Some(pace), Duration::ZERO, hash);
        if !folder.is_complete() {
            folder.write_json("summary.json", &summary)?; // only that was missing
        }
        tidy(&folder.recording());
        return Ok((folder, summary));
    }
    let ring_folder = make_ring(scenario, options, &manner, pace)?;
    let mut log = match resumed {
        None => folder.slot_log()?,
        Some(resumed) => {
            folder.remove_sensor_results()?; // they were of the slots so far
            resumed.hand_over(&ring_folder)?
        }
    };
    let begin = Instant::now();
    let launch = Launch::of(&folder);
    let flown = fly(&Flown { scenario, options, launch: &launch }, &ring_folder, table, stop, &mut log, &mut tally);
    let wall = *flown.as_ref().unwrap_or(&begin.elapsed());
    let mut summary = tally.summary(Some(pace), wall, log.hash());
    summary.complete &= flown.is_ok();
    let written = folder.write_json("summary.json", &summary);
    if let Err(cause) = flown {
        return Err(cause.ended_early(&folder, summary.slots, &options.resume_by())); // not what it led to
    }
    written?;
    Ok((folder, summary))
}

/// How long a sample is waited for unless the user says otherwise [s].
const SAMPLE_TIMEOUT_S: f64 = 30.0;

/// Makes the ring of a mission that is flown in this manner, and its domain that of this process. Its slots follow each
/// other at most at `pace`.
///
/// # Errors
/// If what the ring is told is refused, or the folder cannot be made.
pub(crate) fn make_ring(
    scenario: &Scenario,
    options: &RunOptions,
    manner: &RunMode,
    pace: Pace,
) -> Result<RingFolder, Error> {
    let timeout_s = options.timeout_s(SAMPLE_TIMEOUT_S, pace, scenario.slot_s);
    let told = resume::told(scenario, manner)?;
    let viewer = !options.no_viewer;
    let mut ring = RingFolder::create(manner.pace.unwrap_or_default(), options.wait, timeout_s, viewer, told)?;
    if options.link.is_some() {
        ring.link(link::terms(scenario)?)?;
    }
    ring.set_global_config()?;
    Ok(ring)
}

/// How long the processes of a killed launcher may take to notice.
const ORPHANS_END: Duration = Duration::from_secs(2);

/// Removes what a killed launcher has left of its ring, and ends the files of viewers that were killed. Where that
/// fails they can be opened all the same.
fn tidy(recording: &Path) {
    clear_abandoned(ORPHANS_END);
    #[cfg(feature = "viewer")]
    let _ = skysink_viewer::complete(recording);
    #[cfg(not(feature = "viewer"))]
    let _ = recording;
}

/// Tidies up when it is dropped.
struct Tidied<'a>(&'a Path);

impl Drop for Tidied<'_> {
    fn drop(&mut self) {
        tidy(self.0);
    }
}

/// What a ring of processes flies, and how.
pub struct Flown<'a> {
    /// The scenario.
    pub scenario: &'a Scenario,
    /// How the processes work together.
    pub options: &'a RunOptions,
    /// What they are started with.
    pub launch: &'a Launch,
}

/// Starts the processes, records what they do, ends them, and tidies up behind them. Returns how long they flew.
///
/// # Errors
/// As [`run`].
pub fn fly(
    mission: &Flown,
    ring_folder: &RingFolder,
    table: &ProcessTable,
    stop: &Stop,
    log: &mut dyn SlotSink,
    tally: &mut Tally,
) -> Result<Duration, Error> {
    let Flown { scenario, options, launch } = mission;
    ring_folder.write_record_path(launch.scenario.parent().unwrap_or(Path::new(".")))?;
    let _tidied = Tidied(&launch.recording); // after all processes have ended
    let progress = TerminalProgress::of_slots();
    let (ring, wait) = Ring::<ipc::Service>::join(ring_folder, scenario, Role::Launcher, stop)?;
    let _janitor = Janitor::start(ring_folder);
    let _ = table.shared_prefix.set(ring_folder.prefix());
    let outside_timeout = Duration::from_secs_f64(options.timeout_s(600.0, ring.terms.pace, scenario.slot_s));
    let mut recorder = Recorder::new(&ring, wait)?.with_outside(&options.external, outside_timeout);
    let mut processes = Vec::new();
    for role in WORKERS.into_iter().filter(|role| *role != Role::Viewer || !options.no_viewer) {
        let invocation = options.invocation(role, launch, ring_folder)?;
        if options.external.contains(&role) {
            let command = match &options.link {
                Some(config) if role != Role::Viewer => joining(role, launch, ring_folder, config),
                _ => in_words(&invocation.program, &invocation.arguments),
            };
            let seconds = outside_timeout.as_secs_f64();
            progress.say(&format!("waiting up to {seconds} s for {}: {command}", role.name()));
        } else {
            processes.push(Process::new(role, invocation, Rule::policy(&options.restart, role)));
        }
    }
    let here: Vec<_> = WORKERS.into_iter().filter(|role| !options.external.contains(role)).collect();
    let here = [&here[..], &[Role::Launcher]].concat();
    let link = options.link.as_ref().map(|config| Link::start(ring_folder, config, &here, &progress)).transpose()?;
    let external = &options.external;
    let workers = Workers::start(&ring, ring_folder, table, &progress, processes, external, scenario.slots)?;
    let mut workers = workers.with_link(link);
    let recorded = recorder.record(scenario.slots, log, tally, &mut |tally, overdue| workers.supervise(tally, overdue));
    let ended = match recorded {
        Ok(wall) => finish(&mut recorder, &mut workers, tally, log.hash(), ring.terms.timeout()).map(|()| wall),
        Err(error) => Err(match workers.supervise(tally, None) {
            Err(cause @ Error::WorkerEnded { .. }) if stop.requested().is_none() => cause,
            _ => error,
        }),
    };
    drop(workers);
    ring.remove_dead_nodes();
    // Processes that the launcher has not started end by themselves, and clean up where the ring still is.
    let released = Instant::now();
    while ended.is_ok() && !ring.is_alone() && released.elapsed() < END_TIMEOUT {
        std::thread::sleep(REAP);
    }
    ended
}

/// What a person enters to start a program with these arguments.
fn in_words(program: &Path, arguments: &[OsString]) -> String {
    let words = std::iter::once(program.as_os_str()).chain(arguments.iter().map(OsString::as_os_str));
    let words: Vec<_> = words.map(|word| word.to_string_lossy().into_owned()).collect();
    shlex::try_join(words.iter().map(String::as_str)).unwrap_or_else(|_| words.join(" "))
}

/// What a person enters on another host to start the process of `role` there.
fn joining(role: Role, launch: &Launch, ring: &RingFolder, config: &Path) -> String {
    let file = ring.path().join("ring.toml");
    let scenario = std::path::absolute(&launch.scenario).unwrap_or_else(|_| launch.scenario.clone());
    let options = [("--ring", file), ("--scenario", scenario), ("--link", config.to_owned())];
    let mut arguments = vec!["join".into(), role.name().into()];
    arguments.extend(options.into_iter().flat_map(|(name, file)| [name.into(), file.into_os_string()]));
    in_words(Path::new("skysink"), &arguments) + " (on another host, with copies of these files)"
}

/// How long a process may take to end by itself once it is released.
pub(crate) const END_TIMEOUT: Duration = Duration::from_secs(2);

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
    let mut viewer = workers.supervise(tally, None)?;
    let mut waited = Stopwatch::start(Instant::now());
    while !workers.have_ended(|role| role == Role::Viewer) {
        recorder.pause(REAP)?;
        let current = workers.supervise(tally, None)?;
        if current != viewer {
            viewer = current;
            waited = Stopwatch::start(Instant::now());
        }
        if waited.advance(Instant::now()) > timeout {
            return Err(Error::ViewerStays { seconds: timeout.as_secs_f64(), slot });
        }
    }
    workers.release();
    recorder.release(slot, hash)?;
    let released = Instant::now();
    while (workers.hears_others() || !workers.have_ended(|_| true)) && released.elapsed() < END_TIMEOUT {
        recorder.pause(REAP)?;
        workers.supervise(tally, None)?;
    }
    Ok(())
}
