//! Viewers that are killed repeatedly while they record and while they create a file.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::chunks::{Chunks, recording};
use crate::support::{Slot, files, letter, sensors};
use skysink_viewer::{Scene, Sinks, WallClock, complete, has_footer};

const WATCHDOG: Duration = Duration::from_secs(120);
const SENSORS: u32 = 200;
const FILE: &str = "SKYSINK_TEST_RECORDING";
const FIRST_SLOT: &str = "SKYSINK_TEST_FIRST_SLOT";

fn open(path: &Path, name: &str) -> Scene {
    let sinks = Sinks { save: Some(path.to_owned()), ..Sinks::default() };
    Scene::open(&sinks, &letter(), &sensors(SENSORS), name, WallClock::Unmeasured, None).unwrap()
}

/// Records until it is killed.
#[test]
#[ignore = "ends only if it is killed; the other test starts it"]
fn a_viewer_to_be_killed() {
    let Ok(path) = std::env::var(FILE) else { return };
    let first: u64 = std::env::var(FIRST_SLOT).unwrap().parse().unwrap();
    let mut scene = open(Path::new(&path), &format!("from {first}"));
    for slot in first.. {
        scene.log_slot(&Slot::new(slot, SENSORS as usize).view()).unwrap();
        std::thread::sleep(Duration::from_millis(2));
    }
}

struct Killed(Child);

impl Killed {
    fn start(path: &Path, first: u64) -> Self {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args(["--exact", "kills::a_viewer_to_be_killed", "--ignored"]);
        command.env(FILE, path).env(FIRST_SLOT, first.to_string());
        Self(command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap())
    }

    /// Kills it as soon as `moment` is reached.
    fn at(mut self, mut moment: impl FnMut() -> bool) {
        let start = Instant::now();
        while !moment() {
            assert!(start.elapsed() < WATCHDOG && self.0.try_wait().unwrap().is_none(), "not to be killed yet");
            std::thread::yield_now();
        }
    }
}

impl Drop for Killed {
    fn drop(&mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }
}

#[test]
fn nothing_written_is_lost_when_viewers_are_killed() {
    let folder = tempfile::tempdir().unwrap();
    let first = folder.path().join("mission.rrd");
    let mut written: Vec<(PathBuf, Vec<u8>)> = Vec::new();
    for round in 0..4 {
        let viewer = Killed::start(&first, 10_000 * round);
        let last = || files(&first).into_iter().nth(written.len());
        let newest = || last().and_then(|path| Chunks::of(&path).newest());
        match round {
            // While it records, well after the first slots were written.
            0 => viewer.at(|| newest() > Some(10_000 * round as i64 + 20)),
            // As soon as its file is there, or holds the beginning of a recording.
            1 => viewer.at(|| last().is_some()),
            2 => viewer.at(|| last().is_some_and(|path| fs::metadata(path).unwrap().len() > 12)),
            // As soon as a slot of anything was written.
            _ => viewer.at(|| newest().is_some()),
        }
        for (path, bytes) in &written {
            assert!(fs::read(path).unwrap() == *bytes, "round {round}: {}", path.display());
        }
        written = files(&first).into_iter().map(|path| (path.clone(), fs::read(path).unwrap())).collect();
        written.retain(|(_, bytes)| !bytes.is_empty()); // the next viewer writes the file that is still empty
    }
    open(&first, "the last").close().unwrap();
    let files = files(&first);
    assert_eq!(recording(files.last().unwrap()), "from 0");
    let ids: Vec<_> = files.iter().filter_map(|path| Chunks::of(path).recording_id).collect();
    assert!(ids.len() > 2 && ids.iter().all(|id| id == "from 0"), "{ids:?}");

    let timed: Vec<_> = files.iter().map(|path| Chunks::of(path).timed).collect();
    complete(&first).unwrap();
    for (path, timed) in files.iter().zip(timed) {
        assert_eq!(Chunks::of(path).timed, timed, "{}: nothing is lost", path.display());
        assert!(has_footer(path).unwrap(), "{}", path.display());
        if !Chunks::of(path).timed.is_empty() {
            assert_eq!(recording(path), "from 0", "a footer that knows all chunks");
        }
    }
    let bytes: Vec<_> = files.iter().map(|path| fs::read(path).unwrap()).collect();
    complete(&first).unwrap();
    assert!(
        files.iter().zip(bytes).all(|(path, bytes)| fs::read(path).unwrap() == bytes),
        "what is whole is left alone"
    );
}

#[test]
fn a_file_that_is_being_written_is_not_changed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mission.rrd");
    let viewer = Killed::start(&path, 0);
    viewer.at(|| {
        let bytes = fs::read(&path).unwrap_or_default();
        let is_begun = bytes.len() > 1000;
        if is_begun {
            complete(&path).unwrap();
            assert!(!has_footer(&path).unwrap() && fs::read(&path).unwrap().starts_with(&bytes));
        }
        is_begun
    });
}
