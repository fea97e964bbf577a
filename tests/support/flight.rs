//! Builds the flights of the tests, and controls a ring that is running.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};

use rustix::process::{Pid, Signal, kill_process};
use skysink_ring::folder::RingFolder;
use skysink_ring::topics::services;

use super::{Output, Place, lines, output, pid, until, wait};

/// The processes of a ring that the launcher starts, without the viewer.
pub const RING: [&str; 3] = ["field-sim", "flight-sim", "planner"];

/// A scenario and options. Each method returns another builder, so that flights which differ little share the rest.
#[derive(Debug, Clone)]
pub struct FlightBuilder<'a> {
    place: &'a Place,
    scenario: String,
    out: String,
    options: Vec<String>,
    has_viewer: bool,
}

impl<'a> FlightBuilder<'a> {
    /// A flight of the scenario file into `run`.
    pub(super) fn new(place: &'a Place, scenario: String) -> Self {
        let has_viewer = cfg!(feature = "viewer");
        Self { place, scenario, out: "run".to_owned(), options: Vec::new(), has_viewer }
    }

    /// With more options.
    #[must_use]
    pub fn options(&self, options: &[&str]) -> Self {
        let mut flight = self.clone();
        flight.options.extend(options.iter().map(|&option| option.to_owned()));
        flight
    }

    /// Into this folder.
    #[must_use]
    pub fn out(&self, out: &str) -> Self {
        Self { out: out.to_owned(), ..self.clone() }
    }

    /// With another value of a key of the scenario.
    #[must_use]
    pub fn set(&self, key: &str, value: impl std::fmt::Display) -> Self {
        self.options(&["--set", &format!("{key}={value}")])
    }

    /// The same for several keys: `key=value`, with a space between two.
    #[must_use]
    pub fn settings(&self, settings: &str) -> Self {
        settings.split_ascii_whitespace().fold(self.clone(), |flight, setting| flight.options(&["--set", setting]))
    }

    /// By another strategy than the scenario's.
    #[must_use]
    pub fn strategy(&self, strategy: &str) -> Self {
        self.options(&["--strategy", strategy])
    }

    /// Over another field and channel than the scenario's.
    #[must_use]
    pub fn seed(&self, seed: u64) -> Self {
        self.options(&["--seed", &seed.to_string()])
    }

    /// Paced.
    #[must_use]
    pub fn pace(&self, pace: &str) -> Self {
        self.options(&["--pace", pace])
    }

    /// With processes that wait for each other no longer than this [s].
    #[must_use]
    pub fn timeout(&self, timeout_s: &str) -> Self {
        self.options(&["--timeout", timeout_s])
    }

    /// With a role that the test takes.
    #[must_use]
    pub fn external(&self, role: &str) -> Self {
        self.options(&["--external", role])
    }

    /// With a command as its planner.
    #[must_use]
    pub fn planner(&self, command: &str) -> Self {
        self.options(&["--planner", command])
    }

    /// With vehicles instead of flight-sim: MAVLink addresses or a command.
    #[must_use]
    pub fn vehicle(&self, vehicle: &str) -> Self {
        self.options(&["--vehicle", vehicle])
    }

    /// In a ring without the viewer, which otherwise records; programs that are built without it have none.
    #[must_use]
    pub fn without_viewer(&self) -> Self {
        Self { has_viewer: false, ..self.clone() }
    }

    /// Over the flight that is in the folder.
    #[must_use]
    pub fn force(&self) -> Self {
        self.options(&["--force"])
    }

    /// Flies in one process, which must succeed.
    #[track_caller]
    pub fn simulate(&self) -> Output {
        self.place.run_ok(&self.arguments("simulate"))
    }

    /// Flies in a ring, which must succeed.
    #[track_caller]
    pub fn run(&self) -> Output {
        self.try_run().assert_success()
    }

    /// Flies in a ring.
    pub fn try_run(&self) -> Output {
        output(self.launcher())
    }

    /// Starts a flight in a ring, and waits until the ring is there.
    pub fn start(&self) -> RunningFlight<'a> {
        RunningFlight::start(self.place, self.launcher(), &self.out)
    }

    /// `skysink run`, not yet started.
    pub fn launcher(&self) -> Command {
        let mut command = self.place.skysink(&self.arguments("run"));
        if !self.has_viewer {
            command.arg("--no-viewer");
        }
        command
    }

    fn arguments(&self, command: &'a str) -> Vec<&str> {
        let words = [command, &self.scenario, "--out", &self.out];
        words.into_iter().chain(self.options.iter().map(String::as_str)).collect()
    }
}

/// A launcher and its ring.
#[derive(Debug)]
pub struct RunningFlight<'a> {
    place: &'a Place,
    child: Child,
    ring: String,
    out: String,
    /// File of the standard error of the launcher and its workers.
    stderr: PathBuf,
}

impl<'a> RunningFlight<'a> {
    /// Starts a command that flies into the folder `out`, and waits until its ring is there.
    pub fn start(place: &'a Place, mut command: Command, out: &str) -> Self {
        let before = place.rings();
        // A file, because a pipe that nobody reads may fill up, and the test may want to read it before the end.
        let file = tempfile::Builder::new().prefix("stderr").tempfile_in(place.path("")).unwrap();
        let (file, stderr) = file.keep().unwrap();
        let child = command.stderr(file).spawn().unwrap();
        let mut flight = Self { place, child, ring: String::new(), out: out.to_owned(), stderr };
        flight.ring = until("ring", || {
            assert!(!flight.has_ended(), "ended before its ring was there: {}", flight.stderr());
            place.rings().into_iter().find(|ring| !before.contains(ring) && place.ring_file(ring).exists())
        });
        place.started.lock().unwrap().push(flight.ring.clone());
        flight
    }

    /// The folder of its ring.
    pub fn folder(&self) -> PathBuf {
        self.place.ring_file(&self.ring).parent().unwrap().to_owned()
    }

    /// The process id of the launcher.
    pub fn pid(&self) -> Pid {
        pid(&self.child)
    }

    /// Whether the launcher has ended.
    pub fn has_ended(&mut self) -> bool {
        self.child.try_wait().unwrap().is_some()
    }

    /// Its standard error so far.
    pub fn stderr(&self) -> String {
        fs::read_to_string(&self.stderr).unwrap()
    }

    /// Waits until its standard error contains `text`.
    pub fn until_printed(&self, text: &str) {
        until(text, || self.stderr().contains(text).then_some(()));
    }

    /// Number of recorded slots.
    pub fn slots(&self) -> usize {
        lines(&self.trace()).saturating_sub(1)
    }

    /// Waits until so many slots are recorded.
    pub fn until_slot(&self, slot: usize) {
        until("slot", || (self.slots() >= slot).then_some(()));
    }

    /// Waits until so many more slots are recorded.
    pub fn until_slots_later(&self, slots: usize) {
        self.until_slot(self.slots() + slots);
    }

    /// The process of a role.
    pub fn worker(&self, role: &str) -> Pid {
        self.place.worker(role, &self.ring)
    }

    /// The same, if it is running.
    pub fn worker_now(&self, role: &str) -> Option<Pid> {
        self.place.worker_now(role, &self.ring)
    }

    /// Waits until the process of a role is another one.
    pub fn until_restarted(&self, role: &str, before: Pid) {
        until("restart", || self.worker_now(role).filter(|&now| now != before));
    }

    /// Sends a signal to the process of a role, and returns its id.
    pub fn signal_worker(&self, role: &str, signal: Signal) -> Pid {
        let worker = self.worker(role);
        kill_process(worker, signal).unwrap();
        worker
    }

    /// Kills the process of a role.
    pub fn kill(&self, role: &str) {
        self.signal_worker(role, Signal::KILL);
    }

    /// Kills the process of a role, and waits until it is there again.
    pub fn kill_and_await(&self, role: &str) {
        let killed = self.signal_worker(role, Signal::KILL);
        self.until_restarted(role, killed);
    }

    /// The command of a role that joins this ring, whose topics are there.
    pub fn worker_command(&self, role: &str) -> Command {
        self.worker_command_with(role, Path::new(&self.out).join("scenario.toml").to_str().unwrap())
    }

    /// The same with another scenario.
    pub fn worker_command_with(&self, role: &str, scenario: &str) -> Command {
        self.until_topics();
        let folder = self.folder();
        self.place.command(executable(role), &["--scenario", scenario, "--ring", folder.to_str().unwrap()])
    }

    /// Waits until the topics of its ring are there, and the scenario that it flies.
    pub fn until_topics(&self) {
        until("scenario", || self.path("scenario.toml").exists().then_some(()));
        let folder = until("terms of the ring", || RingFolder::open(&self.folder()).ok());
        let count = 2 * services(&folder.terms()).len(); // samples and notifications
        let services = self.folder().join("services");
        until("services", || fs::read_dir(&services).is_ok_and(|files| files.count() >= count).then_some(()));
    }

    /// Sends a signal to the launcher.
    pub fn signal_launcher(&self, signal: Signal) {
        kill_process(self.pid(), signal).unwrap();
    }

    /// Waits for its exit.
    pub fn wait(self) -> Output {
        let output = wait(self.child);
        Output { stderr: fs::read_to_string(self.stderr).unwrap(), ..output }
    }

    /// Waits for its exit, which must be a success.
    #[track_caller]
    pub fn wait_for_success(self) -> Output {
        self.wait().assert_success()
    }

    /// Stops the launcher by SIGTERM, which must end the run in order.
    #[track_caller]
    pub fn terminate(self) -> Output {
        self.signal_launcher(Signal::TERM);
        self.wait().assert_code(143)
    }

    /// Kills the launcher.
    #[track_caller]
    pub fn kill_launcher(self) {
        self.signal_launcher(Signal::KILL);
        assert_eq!(self.wait().signal, Some(9));
    }

    /// A file of its run folder.
    pub fn path(&self, file: &str) -> PathBuf {
        self.place.path(&self.out).join(file)
    }

    fn trace(&self) -> PathBuf {
        self.path("slots.csv")
    }
}

/// The executable of a role.
pub fn executable(role: &str) -> &'static str {
    match role {
        "field-sim" => env!("CARGO_BIN_EXE_field-sim"),
        "flight-sim" => env!("CARGO_BIN_EXE_flight-sim"),
        "planner" => env!("CARGO_BIN_EXE_planner"),
        #[cfg(feature = "viewer")]
        "viewer" => env!("CARGO_BIN_EXE_viewer"),
        _ => panic!("{role} is no role"),
    }
}
