//! Viewers that are killed, again and again, while they record and while they take over.

mod chunks;
mod support;

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use chunks::{Chunks, recording};
use skysink_viewer::{Existing, Scene, Sinks, Timing, uav};
use support::{Slot, letter, sensors};

const WATCHDOG: Duration = Duration::from_secs(120);
const SENSORS: u32 = 200;
const FILE: &str = "SKYSINK_TEST_RECORDING";

fn open(path: &Path) -> Scene {
    let sinks = Sinks { save: Some(path.to_owned()), existing: Existing::Continue, live: None };
    Scene::open(&sinks, &letter(), &sensors(SENSORS), "killed", Timing::Unmeasured).unwrap()
}

/// Records for ever, from where the one before ended, with a gap in between.
#[test]
#[ignore = "ends only if it is killed; the other tests start it"]
fn a_viewer_to_be_killed() {
    let Ok(path) = std::env::var(FILE) else { return };
    let mut scene = open(Path::new(&path));
    let first = scene.continued_after().map_or(0, |slot| slot + 5);
    if first > 0 {
        scene.log_missed(0..=first - 1).unwrap();
    }
    for slot in first.. {
        scene.log_slot(&Slot::new(slot, SENSORS as usize).view()).unwrap();
        std::thread::sleep(Duration::from_millis(2));
    }
}

struct Killed(Child);

impl Killed {
    fn start(path: &Path) -> Self {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args(["--exact", "a_viewer_to_be_killed", "--ignored"]).env(FILE, path);
        Self(command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap())
    }

    /// Kills it as soon as `moment` is there.
    fn at(mut self, moment: impl Fn() -> bool) {
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

/// The newest slot of anything.
fn newest_of(chunks: &Chunks) -> Option<i64> {
    chunks.timed.values().filter(|(entity, _)| *entity != "/log/events").flat_map(|(_, slots)| slots).copied().max()
}

fn newest(path: &Path) -> Option<i64> {
    newest_of(&if path.exists() { Chunks::of(path) } else { Chunks::default() })
}

/// Which file it is, and how long.
fn state(path: &Path) -> (u64, u64) {
    fs::metadata(path).map_or((0, 0), |file| (file.ino(), file.len()))
}

#[test]
fn nothing_written_is_lost_however_often_a_viewer_is_killed() {
    let folder = tempfile::tempdir().unwrap();
    let (path, draft): (_, PathBuf) = (folder.path().join("mission.rrd"), folder.path().join(".mission.rrd.part"));
    let mut known = Chunks::default();
    for round in 0..8 {
        let (before, rest) = (state(&path), state(&draft));
        let viewer = Killed::start(&path);
        let first = std::cell::Cell::new(None);
        match round % 4 {
            // While it records, well after the first slots were written, so that they are there in all their parts.
            0 => viewer.at(|| {
                let now = newest(&path);
                if first.get().is_none() && now > newest_of(&known) {
                    first.set(now);
                }
                first.get().is_some_and(|first| now > Some(first + 50))
            }),
            // While it records, as soon as a slot of anything was written.
            2 => viewer.at(|| newest(&path) > newest_of(&known)),
            // At the very beginning of the take-over.
            1 => viewer.at(|| state(&draft) != rest),
            // Somewhere within it.
            _ => viewer.at(|| state(&draft).1 > before.1 / 2 || state(&path).0 != before.0),
        }
        let now = Chunks::of(&path);
        for (id, chunk) in &known.timed {
            assert_eq!(now.timed.get(id), Some(chunk), "round {round}");
        }
        known = now;
    }
    let mut scene = open(&path);
    let after = scene.continued_after().unwrap();
    scene.log_slot(&Slot::new(after + 1, SENSORS as usize).view()).unwrap();
    scene.close().unwrap();
    assert_eq!(recording(&path), "killed");
    let found = Chunks::of(&path);
    assert!(known.timed.iter().all(|(id, chunk)| found.timed.get(id) == Some(chunk)));
    let slots = found.slots_of(&format!("/{}", uav::UAV));
    assert!(slots.contains(&i64::try_from(after).unwrap()) && slots.len() > 100, "{} slots", slots.len());
    assert!(!draft.exists());
}
