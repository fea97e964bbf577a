//! A mission in a ring of processes: creates the ring, starts the processes, records, and ends.

use std::ffi::OsString;
use std::path::Path;
use std::time::{Duration, Instant};

use iceoryx2::prelude::ipc;
use skysink_common::pace::Pace;
use skysink_common::scenario::Scenario;
use skysink_common::stop::Stop;
use skysink_common::terminal::shell_word;
use skysink_mission::origin::RunMode;
use skysink_mission::tally::Tally;
use skysink_ring::cleanup::Janitor;
use skysink_ring::folder::RingFolder;
use skysink_ring::home::clear_abandoned;
use skysink_ring::role::Role;
use skysink_ring::terms::Terms;
use skysink_ring::topics::Ring;
use skysink_ring::wait::Stopwatch;

use crate::error::Error;
use crate::report::TerminalProgress;
use crate::run::commands::VehicleOption;
use crate::run::link;
use crate::run::options::{Launch, RunOptions};
use crate::run::process::{Invocation, POLL_EVERY, Process};
use crate::run::recorder::{ExternalTimeout, Recorder, RingTrace};
use crate::run::restart::{Rule, WORKERS};
use crate::run::resume::estimated_rates;
use crate::run::supervise::{Supervision, Worker, Workers};

/// Default timeout for a message [s].
const MESSAGE_TIMEOUT_S: f64 = 30.0;

/// Default timeout for a message from an external process [s].
const EXTERNAL_TIMEOUT_S: f64 = 600.0;

/// Creates the ring folder of a mission and joins its iceoryx2 domain. `pace` limits the speed of the slots.
pub fn make_ring(
    scenario: &Scenario,
    options: &RunOptions,
    run_mode: &RunMode,
    pace: Pace,
) -> Result<RingFolder, Error> {
    let timeout_s = options.timeout_s(MESSAGE_TIMEOUT_S, pace, scenario.slot_s);
    let ring = RingFolder::create(Terms {
        pace: run_mode.pace.unwrap_or_default(),
        wait: options.wait,
        timeout_s,
        viewer: !options.no_viewer,
        belief: estimated_rates(scenario, run_mode)?,
        link: options.link.as_ref().map(|_| link::terms(scenario)).transpose()?,
        ..Terms::of(scenario)
    })?;
    ring.set_global_config()?;
    Ok(ring)
}

/// Time that the processes of a killed launcher may take to end.
const ORPHAN_TIMEOUT: Duration = Duration::from_secs(2);

/// Removes the rings of killed launchers, and completes recordings of killed viewers. Recordings that cannot be
/// completed are still readable.
pub fn clean_up(recording: &Path) {
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

/// A mission in a ring of processes.
pub struct RingMission<'a> {
    pub scenario: &'a Scenario,
    pub options: &'a RunOptions,
    pub launch: &'a Launch,
    pub ring: &'a RingFolder,
    pub stop: &'a Stop,
}

impl RingMission<'_> {
    /// Starts the processes, records the mission, stops the processes, and cleans up. Returns the wall time of the
    /// mission.
    ///
    /// # Errors
    /// If a process ends and is not restarted or does not answer, a file cannot be written, or on a stop.
    pub fn record(&self, log: &mut dyn RingTrace, tally: &mut Tally) -> Result<Duration, Error> {
        let Self { scenario, options, launch, .. } = self;
        self.ring.write_record_path(launch.scenario.parent().unwrap_or(Path::new(".")))?;
        let _guard = CleanUpGuard(&launch.recording); // dropped after all processes have ended
        let progress = TerminalProgress::of_slots();
        let (ring, wait) = Ring::<ipc::Service>::join(self.ring, scenario, Role::Launcher, self.stop)?;
        let _janitor = Janitor::start(self.ring);
        // Programs of the user may begin late, and a vehicle has to get ready and to take off.
        let vehicle = options.vehicle.iter().map(|_| Role::FlightSim);
        let roles = options.external.iter().copied().chain(vehicle).collect();
        let speaks = matches!(options.vehicle, Some(VehicleOption::Mavlink(_)));
        let external = ExternalTimeout { roles, timeout: self.external_timeout(), speaks };
        let mut recorder = Recorder::new(&ring, wait, external)?;
        self.announce_external(&progress)?;
        let mut workers = Workers::start(Supervision {
            ring: &ring,
            folder: self.ring,
            progress: &progress,
            workers: self.workers()?,
            external: &options.external,
            link: self.link()?,
            last_slot: scenario.slots,
        })?;
        let recorded = recorder.record(scenario, log, tally, &mut |tally, sample| workers.supervise(tally, sample));
        let ended = match recorded {
            Ok(wall) => self.wait_for_end(&mut recorder, &mut workers, tally, log.hash()).map(|()| wall),
            Err(error) => Err(match workers.supervise(tally, None) {
                Err(cause @ Error::WorkerEnded { .. }) if self.stop.requested().is_none() => cause,
                _ => error,
            }),
        };
        drop(workers);
        ring.remove_dead_nodes();
        if ended.is_ok() {
            wait_until_alone(&ring);
        }
        ended
    }

    /// The roles of the run's processes.
    fn roles(&self) -> impl Iterator<Item = Role> {
        WORKERS.into_iter().filter(|role| *role != Role::Viewer || !self.options.no_viewer)
    }

    /// The processes that this launcher starts.
    fn workers(&self) -> Result<Vec<Worker>, Error> {
        let Self { options, launch, ring, .. } = self;
        let ours = self.roles().filter(|role| !options.external.contains(role));
        ours.map(|role| {
            let invocation = options.invocation(role, launch, ring)?;
            Ok(Worker::new(role, invocation, Rule::policy(&options.restart, role)))
        })
        .collect()
    }

    /// How long a process that the user starts, or a vehicle, is waited for.
    fn external_timeout(&self) -> Duration {
        let Self { scenario, options, ring, .. } = self;
        Duration::from_secs_f64(options.timeout_s(EXTERNAL_TIMEOUT_S, ring.terms().pace, scenario.slot_s))
    }

    /// Prints the commands of the processes that the user starts.
    fn announce_external(&self, progress: &TerminalProgress) -> Result<(), Error> {
        let Self { options, launch, ring, .. } = self;
        let timeout_s = self.external_timeout().as_secs_f64();
        for role in self.roles().filter(|role| options.external.contains(role)) {
            let Invocation { program, arguments, .. } = options.invocation(role, launch, ring)?;
            let command = match &options.link {
                Some(config) if role != Role::Viewer => join_command(role, launch, ring, config),
                _ => shell_command(&program, &arguments),
            };
            progress.say(&format!("waiting up to {timeout_s} s for {}: {command}", role.name()));
        }
        Ok(())
    }

    /// The link to other hosts, if the run has one.
    fn link(&self) -> Result<Option<Process>, Error> {
        let Some(config) = &self.options.link else { return Ok(None) };
        let local = WORKERS.into_iter().filter(|role| !self.options.external.contains(role));
        let local: Vec<_> = local.chain([Role::Launcher]).collect();
        link::process(self.ring, config, &local).map(Some)
    }

    /// Waits until all processes have ended. The viewer ends first, while the others can still serve a restarted
    /// viewer. A vehicle ends when it has landed.
    fn wait_for_end(
        &self,
        recorder: &mut Recorder<ipc::Service>,
        workers: &mut Workers<ipc::Service>,
        tally: &mut Tally,
        hash: u64,
    ) -> Result<(), Error> {
        let slot = tally.sums.last_slot();
        let timeout = self.ring.terms().timeout();
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
        let landing = match &self.options.vehicle {
            Some(VehicleOption::Mavlink(_)) => Duration::MAX, // the bridge ends by itself, or by Ctrl-C
            Some(VehicleOption::Command(_)) => self.external_timeout(),
            None => END_TIMEOUT,
        };
        loop {
            let elapsed = released.elapsed();
            let are_ending = workers.is_external_alive() || !workers.have_ended(|_| true);
            let is_landing = !workers.have_ended(|role| role == Role::FlightSim);
            if !(are_ending && elapsed < END_TIMEOUT || is_landing && elapsed < landing) {
                return Ok(());
            }
            recorder.pause(POLL_EVERY)?;
            workers.supervise(tally, None)?;
        }
    }
}

/// Waits for external processes: they end by themselves and clean up their shared memory, for which the ring must still
/// exist.
fn wait_until_alone(ring: &Ring<ipc::Service>) {
    let released = Instant::now();
    while !ring.is_alone() && released.elapsed() < END_TIMEOUT {
        std::thread::sleep(POLL_EVERY);
    }
}

/// The shell command that starts a program with these arguments.
fn shell_command(program: &Path, arguments: &[OsString]) -> String {
    let words = std::iter::once(program.as_os_str()).chain(arguments.iter().map(OsString::as_os_str));
    words.map(shell_word).collect::<Vec<_>>().join(" ")
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
pub const END_TIMEOUT: Duration = Duration::from_secs(2);
