//! Shared by the tests of the executables: a temporary folder for each, and time limits for waiting.
#![allow(dead_code, unused_imports)] // each test program uses its part

pub mod flight;
mod recordings;
pub mod scenarios;
#[cfg(feature = "mavlink")]
pub mod vehicles;

use std::borrow::BorrowMut;
use std::collections::BTreeMap;
use std::env;
use std::ffi::OsString;
use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use expect_test::ExpectFile;
use flight::FlightBuilder;
pub use recordings::*;
use rustix::process::{Pid, Signal, kill_process};
use skysink_ring::health::ProcessEvent;
use wait_timeout::ChildExt;

/// Maximum time that a test waits for an event, long enough for a busy machine.
pub const WATCHDOG: Duration = Duration::from_secs(300);

/// A temporary folder of a test, which also has the rings of its runs. Dropping it ends the processes that use it.
#[derive(Debug)]
pub struct Place {
    folder: tempfile::TempDir,
    /// The rings of all flights that the test has started and opened.
    started: Mutex<Vec<String>>,
}

impl Drop for Place {
    fn drop(&mut self) {
        until("end of all processes", || {
            let works_here =
                |process: &Path| fs::read_link(process.join("cwd")).is_ok_and(|cwd| cwd.starts_with(self.path("")));
            let left = processes(works_here);
            let _ = left.iter().try_for_each(|&process| kill_process(process, Signal::KILL));
            left.is_empty().then_some(())
        });
        self.shared_memory().iter().for_each(|path| drop(fs::remove_file(path)));
    }
}

/// Exit and output of a command.
#[derive(Debug)]
pub struct Output {
    pub code: Option<i32>,
    pub signal: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

impl Output {
    /// Fails unless it ended with this exit code.
    #[track_caller]
    pub fn assert_code(self, code: i32) -> Self {
        let said = &self.stderr[self.stderr.floor_char_boundary(self.stderr.len().saturating_sub(2000))..];
        assert_eq!(self.code, Some(code), "signal {:?}, {said}", self.signal);
        self
    }

    /// Fails unless its exit code is 0.
    #[track_caller]
    pub fn assert_success(self) -> Self {
        self.assert_code(0)
    }

    /// Fails unless standard error is one line that holds all of `says`.
    #[track_caller]
    pub fn assert_one_line(self, says: &[&str]) -> Self {
        assert_eq!(self.stderr.lines().count(), 1, "{self:?}");
        for word in says {
            assert!(self.stderr.contains(word), "{word:?} is missing in {self:?}");
        }
        self
    }

    /// Fails unless it was refused with one line that holds `says`.
    #[track_caller]
    pub fn assert_refused(self, says: &str) -> Self {
        self.assert_code(2).assert_one_line(&[says])
    }
}

impl Place {
    pub fn new() -> Self {
        let folder = tempfile::Builder::new().prefix("sky").tempdir_in("/tmp").unwrap();
        Self { folder, started: Mutex::default() }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path(name);
        fs::write(&path, text).unwrap();
        path
    }

    pub fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    /// A flight of a scenario: `name.toml` if the test has written it, otherwise one of [`scenarios`].
    pub fn flight(&self, name: &str) -> FlightBuilder<'_> {
        FlightBuilder::new(self, self.scenario(name))
    }

    /// The file of a scenario, relative to this place, which it is copied to unless the test has written it.
    pub fn scenario(&self, name: &str) -> String {
        let file = format!("{name}.toml");
        if !self.path(&file).exists() {
            self.write(&file, &scenarios::text(name));
        }
        file
    }

    /// `skysink` with these arguments, in this place.
    pub fn skysink(&self, arguments: &[&str]) -> Command {
        self.command(env!("CARGO_BIN_EXE_skysink"), arguments)
    }

    pub fn command(&self, program: &str, arguments: &[&str]) -> Command {
        let mut command = Command::new(program);
        command.args(arguments).current_dir(self.folder.path()).env("TMPDIR", self.folder.path());
        command.env_remove("RERUN").stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    /// The command of an external planner, which finds the ring by the environment variables.
    pub fn external_planner(&self) -> String {
        self.script("mine.sh", env!("CARGO_BIN_EXE_planner"))
    }

    /// The command of a vehicle, which finds the ring in the same way after `delay_s` [s].
    pub fn external_vehicle(&self, delay_s: u32) -> String {
        self.script(
            "vehicle.sh",
            &format!("sh -c 'sleep {delay_s}; exec {} \"$@\"' -", env!("CARGO_BIN_EXE_flight-sim")),
        )
    }

    /// A script that runs `program` in the ring of the environment variables.
    fn script(&self, name: &str, program: &str) -> String {
        let script = format!("#!/bin/sh\nexec {program} --scenario \"$SKYSINK_SCENARIO\" --ring \"$SKYSINK_RING\"\n");
        let path = self.write(name, &script);
        fs::set_permissions(&path, std::os::unix::fs::PermissionsExt::from_mode(0o755)).unwrap();
        path.display().to_string()
    }

    /// Runs `skysink`.
    pub fn run(&self, arguments: &[&str]) -> Output {
        output(self.skysink(arguments))
    }

    /// The same, which must succeed.
    #[track_caller]
    pub fn run_ok(&self, arguments: &[&str]) -> Output {
        let ended = self.run(arguments);
        assert_eq!(ended.code, Some(0), "{arguments:?}: {ended:?}");
        ended
    }

    /// Flies the rest of a run in a ring without a viewer, which must succeed.
    #[track_caller]
    pub fn resume(&self, run: &str) -> Output {
        self.run_ok(&["run", "--resume", run, "--no-viewer"])
    }

    /// The same as [`Place::run`], which must be refused with one line that holds `says`.
    #[track_caller]
    pub fn run_refused(&self, arguments: &[&str], says: &str) {
        self.run(arguments).assert_refused(says);
    }

    /// Runs the commands of a transcript, its lines `$ …`, by a shell in this place. Fails unless they print what
    /// follows them there: standard output and error, and in brackets an exit code other than 0. With `UPDATE_EXPECT=1`
    /// it is written anew.
    pub fn assert_transcript(&self, transcript: &ExpectFile) {
        let program = Path::new(env!("CARGO_BIN_EXE_skysink")).parent().unwrap();
        let path = path_with([&self.path(""), program]);
        let mut printed = String::new();
        for line in transcript.data().lines().filter(|line| line.starts_with("$ ")) {
            let mut command = self.command("sh", &["-c", &line[2..]]);
            let ended = output(command.env("PATH", &path).env("LC_ALL", "C").env_remove("COLUMNS"));
            printed += &format!("{line}\n{}{}", ended.stdout, ended.stderr);
            if ended.code != Some(0) {
                printed += &format!("[{}]\n", ended.code.expect("an exit"));
            }
        }
        transcript.assert_eq(&printed.replace(self.folder.path().to_str().unwrap(), "[place]"));
    }

    /// Writes each text of `refusals`, which empty lines divide, to `bad.toml`, and runs the commands with it. Fails
    /// unless all refuse it with the line at its end, and write nothing.
    pub fn assert_refusals(&self, refusals: &ExpectFile, commands: &[&str]) {
        let data = refusals.data();
        let said = data.trim_end().split("\n\n").map(|block| {
            let text: String = block.split_inclusive('\n').filter(|line| !line.starts_with("skysink: ")).collect();
            self.write("bad.toml", &text);
            let lines = commands.iter().map(|command| {
                let ended = self.run(&[command, "bad.toml", "--out", "out"][..if *command == "check" { 2 } else { 4 }]);
                ended.assert_code(2).assert_one_line(&[]).stderr
            });
            let lines: Vec<String> = lines.collect();
            assert!(lines.iter().all(|line| *line == lines[0]), "{commands:?}: {lines:?}");
            text + &lines[0]
        });
        refusals.assert_eq(&said.collect::<Vec<_>>().join("\n"));
        assert!(!self.path("out").exists());
    }

    /// The rings of this place, by the name of their folder.
    pub fn rings(&self) -> Vec<String> {
        let entries = fs::read_dir(self.rings_folder()).into_iter().flatten().flatten();
        entries.map(|entry| entry.file_name().into_string().unwrap()).filter(|name| !name.contains('.')).collect()
    }

    /// The file that makes the folder of this name a ring.
    pub fn ring_file(&self, ring: &str) -> PathBuf {
        self.rings_folder().join(ring).join("ring.toml")
    }

    /// The parent folder of the rings.
    pub fn rings_folder(&self) -> PathBuf {
        self.path(&format!("skysink-{}", rustix::process::getuid().as_raw()))
    }

    /// The worker of this role in the ring of this name.
    pub fn worker(&self, role: &str, ring: &str) -> Pid {
        let ring = self.ring_file(ring).parent().unwrap().to_owned();
        until(role, || process(role, ring.to_str().unwrap()))
    }

    /// The same, if it is there at this moment.
    pub fn worker_now(&self, role: &str, ring: &str) -> Option<Pid> {
        process(role, self.ring_file(ring).parent().unwrap().to_str().unwrap())
    }

    /// Fails if a run has left files of its ring.
    #[track_caller]
    pub fn assert_clean(&self) {
        let files = fs::read_dir(self.rings_folder()).into_iter().flatten().flatten().map(|entry| entry.path());
        let left: Vec<_> = files.chain(self.shared_memory()).collect();
        assert!(left.is_empty(), "left behind: {left:?}");
    }

    /// The files in shared memory of the rings that a test has looked into, and of those that are there.
    pub fn shared_memory(&self) -> Vec<PathBuf> {
        let rings = [&self.started.lock().unwrap()[..], &self.rings()].concat();
        let prefixes: Vec<_> = rings.into_iter().map(|ring| format!("/dev/shm/sky{ring}_")).collect();
        let paths = fs::read_dir("/dev/shm").unwrap().flatten().map(|entry| entry.path());
        paths.filter(|path| prefixes.iter().any(|prefix| path.to_string_lossy().starts_with(prefix))).collect()
    }

    /// The trace of a run.
    pub fn trace(&self, run: &str) -> String {
        self.read(&format!("{run}/slots.csv"))
    }

    /// Truncates the trace of a run to so many slots.
    pub fn cut_trace(&self, run: &str, slots: usize) {
        let begun: String = self.trace(run).split_inclusive('\n').take(slots + 1).collect();
        self.write(&format!("{run}/slots.csv"), &begun);
    }

    /// Fails unless the folder `run` alone, without the files that its scenario was made of, gives its trace again:
    /// flown anew, resumed after 20 slots, and replayed.
    #[track_caller]
    pub fn assert_repeatable(&self, run: &str) {
        self.run_ok(&["simulate", &format!("{run}/scenario.toml"), "--out", "again"]);
        self.assert_same_trace(run, "again");
        self.cut_trace("again", 20);
        self.resume("again");
        self.assert_same_trace(run, "again");
        self.run_ok(&["replay", run, "--out", "replayed"]);
    }

    /// Fails unless two runs have the same trace.
    #[track_caller]
    pub fn assert_same_trace(&self, one: &str, other: &str) {
        let [ours, theirs] = [one, other].map(|run| self.trace(run));
        let mut lines = ours.lines().zip(theirs.lines());
        let differing = lines.find(|(ours, theirs)| ours != theirs);
        let [strategy, seed] = ["strategy", "seed"].map(|key| self.summary(one)[key].to_string());
        let lengths = [ours.len(), theirs.len()];
        assert!(ours == theirs, "{one} and {other}, {strategy}, seed {seed}, bytes {lengths:?}: {differing:?}");
    }

    /// Fails unless a run has the trace that the scenario in its folder has in one process.
    #[track_caller]
    pub fn assert_trace_as_simulated(&self, run: &str) {
        let simulated = format!("{run}-simulated");
        self.flight(&format!("{run}/scenario")).out(&simulated).force().simulate();
        self.assert_same_trace(&simulated, run);
    }

    /// The figures of a run, without their check value.
    pub fn summary(&self, run: &str) -> serde_json::Value {
        let mut summary: serde_json::Value = serde_json::from_str(&self.read(&format!("{run}/summary.json"))).unwrap();
        summary.as_object_mut().unwrap().remove("check").unwrap();
        summary
    }

    /// The same without values that depend on the wall clock: times, and events of processes without a heartbeat.
    pub fn reproducible_summary(&self, run: &str) -> serde_json::Value {
        let without_digits = |text: &str| text.replace(|letter: char| letter.is_ascii_digit(), "");
        let silence =
            [ProcessEvent::Silent(0), ProcessEvent::Recovered(0)].map(|event| without_digits(&event.to_string()));
        let mut summary = self.summary(run);
        summary["timing"].take();
        let events = summary["events"].as_array_mut().unwrap();
        events.retain(|event| !silence.contains(&without_digits(event["event"].as_str().unwrap())));
        summary
    }
}

/// The PATH with these folders in front.
pub fn path_with<'a>(folders: impl IntoIterator<Item = &'a Path>) -> OsString {
    let rest = env::var_os("PATH").unwrap_or_default();
    env::join_paths(folders.into_iter().map(Path::to_owned).chain(env::split_paths(&rest))).unwrap()
}

/// Fails unless every bit is accounted for.
#[track_caller]
pub fn assert_balanced(summary: &serde_json::Value) {
    let bits = |key: &str| summary[key].as_u64().unwrap();
    assert_eq!(
        bits("initial_bits") + bits("sampled_bits"),
        bits("delivered_bits") + bits("lost_bits") + bits("queued_bits")
    );
}

/// The id of a child.
pub fn pid(child: &Child) -> Pid {
    Pid::from_raw(i32::try_from(child.id()).unwrap()).unwrap()
}

/// Sends a signal to a child, and waits for its exit.
pub fn signal_and_wait(signal: Signal, child: Child) -> Output {
    kill_process(pid(&child), signal).unwrap();
    wait(child)
}

/// Waits for the exit of a process that is no child of the test.
pub fn until_exited(process: Pid) {
    until("end", || (!fs::exists(format!("/proc/{}", process.as_raw_nonzero())).unwrap()).then_some(()));
}

/// Runs a command.
pub fn output(mut command: impl BorrowMut<Command>) -> Output {
    wait(command.borrow_mut().spawn().unwrap())
}

/// Waits for the exit of a child, and takes its output.
pub fn wait(mut child: Child) -> Output {
    let reader = |stream: Option<Box<dyn std::io::Read + Send>>| {
        std::thread::spawn(move || {
            let mut text = String::new();
            if let Some(mut stream) = stream {
                let _ = stream.read_to_string(&mut text);
            }
            text
        })
    };
    let stdout = reader(child.stdout.take().map(|stream| Box::new(stream) as _));
    let stderr = reader(child.stderr.take().map(|stream| Box::new(stream) as _));
    let status = child.wait_timeout(WATCHDOG).unwrap();
    if status.is_none() {
        let _ = child.kill();
    }
    let ended = Output {
        code: status.and_then(|status| status.code()),
        signal: status.and_then(|status| status.signal()),
        stdout: stdout.join().unwrap(),
        stderr: stderr.join().unwrap(),
    };
    assert!(status.is_some(), "did not end within {WATCHDOG:?}: {ended:?}");
    ended
}

/// Polls until there is a value.
pub fn until<T>(what: &str, mut poll: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(found) = poll() {
            return found;
        }
        assert!(start.elapsed() < WATCHDOG, "no {what} within {WATCHDOG:?}");
        std::thread::park_timeout(Duration::from_millis(5));
    }
}

/// The lines of a file that is being written.
pub fn lines(path: &Path) -> usize {
    fs::read_to_string(path).map_or(0, |text| text.lines().count())
}

/// The processes whose folder of `/proc` is one that is looked for.
fn processes(is_wanted: impl Fn(&Path) -> bool) -> Vec<Pid> {
    let folders = fs::read_dir("/proc").unwrap().flatten().map(|entry| entry.path());
    let ids =
        folders.filter(|folder| is_wanted(folder)).filter_map(|folder| folder.file_name()?.to_str()?.parse().ok());
    ids.filter_map(Pid::from_raw).collect()
}

/// A launcher and the processes that it has started, with their names.
pub fn family(launcher: Pid) -> Vec<(String, Pid)> {
    let tasks = fs::read_dir(format!("/proc/{}/task", launcher.as_raw_nonzero())).into_iter().flatten().flatten();
    let ids: String = tasks.filter_map(|task| fs::read_to_string(task.path().join("children")).ok()).collect();
    let children = ids.split_ascii_whitespace().filter_map(|id| {
        let name = fs::read_to_string(format!("/proc/{id}/comm")).ok()?;
        Some((name.trim().to_owned(), Pid::from_raw(id.parse().ok()?)?))
    });
    children.chain([("skysink".to_owned(), launcher)]).collect()
}

/// The process that runs `executable` with `argument` among its arguments.
fn process(executable: &str, argument: &str) -> Option<Pid> {
    let is_it = |folder: &Path| {
        let line = fs::read_to_string(folder.join("cmdline")).unwrap_or_default();
        let mut words = line.split('\0');
        let program = Path::new(words.next().unwrap_or_default()).file_name();
        program.is_some_and(|program| program == executable) && words.any(|word| word == argument)
    };
    processes(is_it).first().copied()
}

/// The rows of a CSV file, by column name.
pub fn csv_rows(text: &str) -> Vec<BTreeMap<String, String>> {
    let mut lines = text.lines().map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
    let header = lines.next().unwrap();
    lines.map(|line| header.iter().cloned().zip(line).collect()).collect()
}
