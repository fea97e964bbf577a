//! `skysink run`: flies a mission as a ring of processes.

pub mod external;
pub mod heartbeat;
pub mod limits;
pub mod link;
pub mod options;
pub mod process;
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
use process::{POLL_EVERY, Process, ProcessTable};
use recorder::{Recorder, SlotSink};
use restart::{Rule, WORKERS};
use resume::resume;
use supervise::Workers;

/// A run: its scenario, folder and options.
#[derive(Debug)]
pub struct Run {
    /// The scenario.
    pub scenario: Scenario,
    /// The folder of a new run.
    pub folder: NewFolder,
    /// The folder of an interrupted run to resume.
    pub resume: Option<PathBuf>,
    /// The options of the processes.
    pub options: RunOptions,
}

/// Flies the mission and returns its folder and summary. However the run ends, the folder is complete up to the last
/// slot and shared memory is cleaned up. `table` publishes the processes to other threads.
///
/// # Errors
/// If this build has no viewer, the sensor list is refused, a process ends and is not restarted or does not answer, a
/// file cannot be written, or on a stop.
pub fn run(run: &Run, stop: &Stop, table: &ProcessTable) -> Result<(RunFolder, Summary), Error> {
    let Run { scenario, options, .. } = run;
    let list = SensorList::of(scenario)?;
    options.check(&list)?;
    let (folder, resumed) = match &run.resume {
        None => (run.folder.create(scenario, &list, &options.run_mode(None))?, None),
        Some(path) => {
            let folder = RunFolder::reopen(path)?;
            options.check_resumed(&folder)?;
            let mut tally = Tally::new(scenario, &list);
            let resumed = resume(&folder, scenario, &list, &mut tally, stop)?;
            (folder, Some((resumed, tally)))
        }
    };
    let run_mode = options.run_mode(Some(folder.run_mode()));
    let pace = run_mode.pace.unwrap_or_default();
    let (resumed, tally) =
        resumed.map_or_else(|| (None, Tally::new(scenario, &list)), |(resumed, tally)| (Some(resumed), tally));
    let mut tally = tally.with_latency(pace, scenario.slot_s);
    if let Some(planner) = &run_mode.external_planner {
        tally = tally.with_planner(planner);
    }
    if tally.last_slot() == scenario.slots {
        let hash = resumed.map_or(0, |resumed| resumed.log.hash());
        let summary = tally.summary(Some(pace), Duration::ZERO, hash);
        if !folder.is_complete() {
            folder.write_json("summary.json", &summary)?; // the only missing file
        }
        clean_up(&folder.recording());
        return Ok((folder, summary));
    }
    let ring_folder = make_ring(scenario, options, &run_mode, pace)?;
    let mut log = match resumed {
        None => folder.slot_log()?,
        Some(resumed) => {
            folder.remove_sensor_results()?; // they covered the slots so far
            resumed.save_checkpoints(&ring_folder)?
        }
    };
    let begin = Instant::now();
    let launch = Launch::of(&folder);
    let flown =
        fly(&RingMission { scenario, options, launch: &launch }, &ring_folder, table, stop, &mut log, &mut tally);
    let wall = *flown.as_ref().unwrap_or(&begin.elapsed());
    let mut summary = tally.summary(Some(pace), wall, log.hash());
    summary.complete &= flown.is_ok();
    let written = folder.write_json("summary.json", &summary);
    if let Err(cause) = flown {
        return Err(cause.ended_early(&folder, summary.slots, &options.resume_options())); // the first error
    }
    written?;
    Ok((folder, summary))
}

/// Default timeout for a message [s].
const MESSAGE_TIMEOUT_S: f64 = 30.0;

/// Default timeout for a message from an external process [s].
const EXTERNAL_TIMEOUT_S: f64 = 600.0;

/// Creates the ring folder of a mission and joins its iceoryx2 domain. `pace` limits the speed of the slots.
///
/// # Errors
/// If the scenario is refused, or the folder cannot be created.
pub(crate) fn make_ring(
    scenario: &Scenario,
    options: &RunOptions,
    run_mode: &RunMode,
    pace: Pace,
) -> Result<RingFolder, Error> {
    let timeout_s = options.timeout_s(MESSAGE_TIMEOUT_S, pace, scenario.slot_s);
    let rates = resume::estimated_rates(scenario, run_mode)?;
    let viewer = !options.no_viewer;
    let mut ring = RingFolder::create(run_mode.pace.unwrap_or_default(), options.wait, timeout_s, viewer, rates)?;
    if options.link.is_some() {
        ring.link(link::terms(scenario)?)?;
    }
    ring.set_global_config()?;
    Ok(ring)
}

/// Time that the processes of a killed launcher may take to end.
const ORPHAN_TIMEOUT: Duration = Duration::from_secs(2);

/// Removes the rings of killed launchers, and completes recordings of killed viewers. Recordings that cannot be
/// completed are still readable.
fn clean_up(recording: &Path) {
    clear_abandoned(ORPHAN_TIMEOUT);
    #[cfg(feature = "viewer")]
    let _ = skysink_viewer::complete(recording);
    #[cfg(not(feature = "viewer"))]
    let _ = recording;
}

/// Calls [`clean_up`] when it is dropped.
struct CleanUpGuard<'a>(&'a Path);

impl Drop for CleanUpGuard<'_> {
    fn drop(&mut self) {
        clean_up(self.0);
    }
}

/// The mission of a ring of processes.
pub struct RingMission<'a> {
    /// The scenario.
    pub scenario: &'a Scenario,
    /// The options of the processes.
    pub options: &'a RunOptions,
    /// Their inputs and outputs.
    pub launch: &'a Launch,
}

/// Starts the processes, records the mission, stops the processes, and cleans up. Returns the wall time of the mission.
///
/// # Errors
/// As [`run`].
pub fn fly(
    mission: &RingMission,
    ring_folder: &RingFolder,
    table: &ProcessTable,
    stop: &Stop,
    log: &mut dyn SlotSink,
    tally: &mut Tally,
) -> Result<Duration, Error> {
    let RingMission { scenario, options, launch } = mission;
    ring_folder.write_record_path(launch.scenario.parent().unwrap_or(Path::new(".")))?;
    let _guard = CleanUpGuard(&launch.recording); // dropped after all processes have ended
    let progress = TerminalProgress::of_slots();
    let (ring, wait) = Ring::<ipc::Service>::join(ring_folder, scenario, Role::Launcher, stop)?;
    let _janitor = Janitor::start(ring_folder);
    let _ = table.shared_prefix.set(ring_folder.prefix());
    let external_timeout_s = options.timeout_s(EXTERNAL_TIMEOUT_S, ring.terms.pace, scenario.slot_s);
    let external_timeout = Duration::from_secs_f64(external_timeout_s);
    let mut recorder = Recorder::new(&ring, wait)?.with_external(&options.external, external_timeout);
    let mut processes = Vec::new();
    for role in WORKERS.into_iter().filter(|role| *role != Role::Viewer || !options.no_viewer) {
        let invocation = options.invocation(role, launch, ring_folder)?;
        if options.external.contains(&role) {
            let command = match &options.link {
                Some(config) if role != Role::Viewer => join_command(role, launch, ring_folder, config),
                _ => shell_command(&invocation.program, &invocation.arguments),
            };
            let seconds = external_timeout.as_secs_f64();
            progress.say(&format!("waiting up to {seconds} s for {}: {command}", role.name()));
        } else {
            processes.push(Process::new(role, invocation, Rule::policy(&options.restart, role)));
        }
    }
    let local = WORKERS.into_iter().filter(|role| !options.external.contains(role));
    let local: Vec<_> = local.chain([Role::Launcher]).collect();
    let link = options.link.as_ref().map(|config| Link::start(ring_folder, config, &local, &progress)).transpose()?;
    let external = &options.external;
    let workers = Workers::start(&ring, ring_folder, table, &progress, processes, external, scenario.slots)?;
    let mut workers = workers.with_link(link);
    let recorded = recorder.record(scenario.slots, log, tally, &mut |tally, overdue| workers.supervise(tally, overdue));
    let ended = match recorded {
        Ok(wall) => wait_for_end(&mut recorder, &mut workers, tally, log.hash(), ring.terms.timeout()).map(|()| wall),
        Err(error) => Err(match workers.supervise(tally, None) {
            Err(cause @ Error::WorkerEnded { .. }) if stop.requested().is_none() => cause,
            _ => error,
        }),
    };
    drop(workers);
    ring.remove_dead_nodes();
    // External processes end by themselves and clean up their shared memory, for which the ring must still exist.
    let released = Instant::now();
    while ended.is_ok() && !ring.is_alone() && released.elapsed() < END_TIMEOUT {
        std::thread::sleep(POLL_EVERY);
    }
    ended
}

/// The shell command that starts a program with these arguments.
fn shell_command(program: &Path, arguments: &[OsString]) -> String {
    let words = std::iter::once(program.as_os_str()).chain(arguments.iter().map(OsString::as_os_str));
    let words: Vec<_> = words.map(|word| word.to_string_lossy().into_owned()).collect();
    shlex::try_join(words.iter().map(String::as_str)).unwrap_or_else(|_| words.join(" "))
}

/// The shell command that starts the process of `role` on another host.
fn join_command(role: Role, launch: &Launch, ring: &RingFolder, config: &Path) -> String {
    let file = ring.path().join("ring.toml");
    let scenario = std::path::absolute(&launch.scenario).unwrap_or_else(|_| launch.scenario.clone());
    let options = [("--ring", file), ("--scenario", scenario), ("--link", config.to_owned())];
    let mut arguments = vec!["join".into(), role.name().into()];
    arguments.extend(options.into_iter().flat_map(|(name, file)| [name.into(), file.into_os_string()]));
    shell_command(Path::new("skysink"), &arguments) + " (on another host, with copies of these files)"
}

/// Time that a process may take to end after the final commit.
pub(crate) const END_TIMEOUT: Duration = Duration::from_secs(2);

/// Waits until all processes have ended. The viewer ends first, while the others can still serve a restarted viewer.
fn wait_for_end(
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
        recorder.pause(POLL_EVERY)?;
        let current = workers.supervise(tally, None)?;
        if current != viewer {
            viewer = current;
            waited = Stopwatch::start(Instant::now());
        }
        if waited.advance(Instant::now()) > timeout {
            return Err(Error::ViewerTimeout { seconds: timeout.as_secs_f64(), slot });
        }
    }
    workers.release();
    recorder.release(slot, hash)?;
    let released = Instant::now();
    while (workers.is_external_alive() || !workers.have_ended(|_| true)) && released.elapsed() < END_TIMEOUT {
        recorder.pause(POLL_EVERY)?;
        workers.supervise(tally, None)?;
    }
    Ok(())
}
