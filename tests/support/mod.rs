//! What the tests of the executables share: a place of their own, and no waiting for ever.
#![allow(dead_code)] // each test program uses its part

pub mod flight;
pub mod scenarios;

use std::borrow::BorrowMut;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use flight::FlightBuilder;
use rustix::process::{Pid, Signal, kill_process};
use wait_timeout::ChildExt;

/// The longest that a test waits for anything, on a machine that is busy with others, too.
pub const WATCHDOG: Duration = Duration::from_secs(300);

/// A folder of its own, which is also where the runs of the test meet.
#[derive(Debug)]
pub struct Place {
    folder: tempfile::TempDir,
}

/// How a command ended.
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

    /// Fails unless it ended well.
    #[track_caller]
    pub fn assert_success(self) -> Self {
        self.assert_code(0)
    }

    /// Fails unless it has said one line, which holds all of `says`.
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
        Self { folder: tempfile::Builder::new().prefix("sky").tempdir_in("/tmp").unwrap() }
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

    /// A command that finds the ring as the planner of somebody else does.
    pub fn outside_planner(&self) -> String {
        let planner = env!("CARGO_BIN_EXE_planner");
        let script = format!("#!/bin/sh\nexec {planner} --scenario \"$SKYSINK_SCENARIO\" --ring \"$SKYSINK_RING\"\n");
        let path = self.write("mine.sh", &script);
        std::fs::set_permissions(&path, std::os::unix::fs::PermissionsExt::from_mode(0o755)).unwrap();
        path.display().to_string()
    }

    /// Runs `skysink` to its end.
    pub fn run(&self, arguments: &[&str]) -> Output {
        output(self.skysink(arguments))
    }

    /// The same, which must end well.
    #[track_caller]
    pub fn run_ok(&self, arguments: &[&str]) -> Output {
        let ended = self.run(arguments);
        assert_eq!(ended.code, Some(0), "{arguments:?}: {ended:?}");
        ended
    }

    /// Flies the rest of a run in a ring without a viewer, which must end well.
    #[track_caller]
    pub fn resume(&self, run: &str) -> Output {
        self.run_ok(&["run", "--resume", run, "--no-viewer"])
    }

    /// The same as [`Place::run`], which must be refused with one line that holds `says`.
    #[track_caller]
    pub fn run_refused(&self, arguments: &[&str], says: &str) {
        self.run(arguments).assert_refused(says);
    }

    /// The rings of this place, by the name of their folder.
    pub fn rings(&self) -> Vec<String> {
        let user = format!("skysink-{}", rustix::process::getuid().as_raw());
        let entries = fs::read_dir(self.path(&user)).into_iter().flatten().flatten();
        entries.map(|entry| entry.file_name().into_string().unwrap()).filter(|name| !name.ends_with(".lock")).collect()
    }

    /// The file that makes the folder of this name a ring.
    pub fn ring_file(&self, ring: &str) -> PathBuf {
        self.path(&format!("skysink-{}", rustix::process::getuid().as_raw())).join(ring).join("ring.toml")
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

    /// Fails if a run has left anything where its ring was.
    pub fn assert_clean(&self) {
        let user = self.path(&format!("skysink-{}", rustix::process::getuid().as_raw()));
        let left: Vec<_> = fs::read_dir(user).into_iter().flatten().flatten().map(|entry| entry.path()).collect();
        assert!(left.is_empty(), "left behind: {left:?}");
    }

    /// The trace of a run.
    pub fn trace(&self, run: &str) -> String {
        self.read(&format!("{run}/slots.csv"))
    }

    /// Leaves of a run's trace so many slots.
    pub fn cut_trace(&self, run: &str, slots: usize) {
        let begun: String = self.trace(run).split_inclusive('\n').take(slots + 1).collect();
        self.write(&format!("{run}/slots.csv"), &begun);
    }

    /// Fails unless two runs have the same trace.
    #[track_caller]
    pub fn assert_same_trace(&self, one: &str, other: &str) {
        let [ours, theirs] = [one, other].map(|run| self.trace(run));
        let mut lines = ours.lines().zip(theirs.lines());
        let differing = lines.find(|(ours, theirs)| ours != theirs);
        assert!(ours == theirs, "{one} and {other}, of {} and {} bytes: {differing:?}", ours.len(), theirs.len());
    }

    /// The figures of a run.
    pub fn summary(&self, run: &str) -> serde_json::Value {
        serde_json::from_str(&self.read(&format!("{run}/summary.json"))).unwrap()
    }
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

/// Fails if the ring of this name has left anything in shared memory.
pub fn assert_no_shared_memory(ring: &str) {
    let left: Vec<_> = fs::read_dir("/dev/shm")
        .unwrap()
        .flatten()
        .map(|entry| entry.file_name().into_string().unwrap())
        .filter(|name| name.starts_with(&format!("sky{ring}_")))
        .collect();
    assert!(left.is_empty(), "left behind: {left:?}");
}

/// The id of a child.
pub fn pid(child: &Child) -> Pid {
    Pid::from_raw(i32::try_from(child.id()).unwrap()).unwrap()
}

/// Sends a signal to a child, and waits for its end.
pub fn signal_and_wait(signal: Signal, child: Child) -> Output {
    kill_process(pid(&child), signal).unwrap();
    wait(child)
}

/// Waits for the end of a process that is no child of the test.
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

/// Waits until `look` finds something.
pub fn until<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(found) = look() {
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

/// The process that runs `executable` with `argument` among its arguments.
fn process(executable: &str, argument: &str) -> Option<Pid> {
    for entry in fs::read_dir("/proc").unwrap().flatten() {
        let Some(pid) = entry.file_name().to_str().and_then(|name| name.parse::<i32>().ok()) else { continue };
        let Ok(line) = fs::read(entry.path().join("cmdline")) else { continue };
        let words: Vec<_> = line.split(|&byte| byte == 0).map(String::from_utf8_lossy).collect();
        let program = Path::new(words[0].as_ref()).file_name().map(|name| name.to_string_lossy().into_owned());
        if program.as_deref() == Some(executable) && words.iter().any(|word| word == argument) {
            return Pid::from_raw(pid);
        }
    }
    None
}

/// The slots in which a recording holds the entity.
pub fn slots(recording: &Path, entity: &str) -> BTreeSet<i64> {
    rows(recording, entity).into_keys().collect()
}

/// The files of a run's recording, in no order.
pub fn recordings(run: &Path) -> Vec<PathBuf> {
    let paths = fs::read_dir(run).unwrap().map(|entry| entry.unwrap().path());
    paths.filter(|path| path.extension().is_some_and(|extension| extension == "rrd")).collect()
}

/// The slots in which any of these files holds the entity.
pub fn slots_of_all(recordings: &[PathBuf], entity: &str) -> BTreeSet<i64> {
    recordings.iter().flat_map(|recording| slots(recording, entity)).collect()
}

/// What a recording holds of the entity in each slot, written out.
pub fn rows(recording: &Path, entity: &str) -> BTreeMap<i64, String> {
    let mut config = re_chunk_store::ChunkStoreConfig::DEFAULT;
    config.enable_changelog = false;
    let stores = re_chunk_store::ChunkStore::from_rrd_reader(&config, &mut File::open(recording).unwrap()).unwrap();
    let timeline = re_sdk::TimelineName::try_new("slot").unwrap();
    let mut rows = BTreeMap::<_, String>::new();
    for (_, store) in stores.into_iter().filter(|(id, _)| id.is_recording()) {
        for chunk in
            store.iter_physical_chunks().filter(|chunk| chunk.entity_path() == &re_sdk::EntityPath::from(entity))
        {
            let Some(times) = chunk.timelines().get(&timeline) else { continue };
            for (row, &slot) in times.times_raw().iter().enumerate() {
                let values = rows.entry(slot).or_default();
                for component in chunk.components_identifiers() {
                    let column = chunk.components().get_array(component).unwrap();
                    values.push_str(&format!("{component}: {:?}\n", column.value(row)));
                }
            }
        }
    }
    rows
}
