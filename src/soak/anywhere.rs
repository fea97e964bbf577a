//! `skysink soak --anywhere`: short missions whose processes are killed at any instant, from the start of the first to
//! the end of the last, the launcher included, which is then resumed. Each must end with the trace of the undisturbed
//! mission and whole recordings, and leave nothing behind.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rustix::process::{Pid, Signal, kill_process};
use skysink_common::stop::Stop;
use skysink_mission::error::FileContext;
use skysink_mission::record::RunFolder;
use skysink_ring::folder::SHARED_MEMORY;

use crate::error::Error;
use crate::programs;
use crate::report::print;

/// How often a mission is looked at.
const POLL: Duration = Duration::from_millis(1);

/// Longest delay of a kill after its part of the mission is flown; and of one while it starts, which takes about as
/// long.
const MAX_DELAY: Duration = Duration::from_millis(10);
const MAX_START: Duration = Duration::from_millis(150);

/// A mission that takes longer hangs.
const MAX_MISSION: Duration = Duration::from_secs(120);

/// How long a process may live on after its launcher was killed.
#[cfg(feature = "viewer")]
const MAX_END: Duration = Duration::from_secs(10);

/// What is flown, and how often it is disturbed.
#[derive(Debug)]
pub struct Anywhere {
    /// Folder of the undisturbed mission; those that are disturbed are flown in it.
    pub alone: RunFolder,
    /// Missions.
    pub missions: u64,
    /// Kills in each, if it lasts long enough.
    pub kills: u32,
    /// Seed of the kills.
    pub seed: u64,
    /// Whether the viewer takes part.
    pub viewer: bool,
}

/// A kill: of any process, once so much of the trace is on record, and a little later.
#[derive(Debug, Clone, Copy)]
struct Kill {
    bytes: u64,
    delay: Duration,
}

impl Anywhere {
    /// Flies the missions, and prints what became of them.
    ///
    /// # Errors
    /// [`Error::Soak`] at the first that does not end as it should; its folder is left.
    pub fn fly(&self, stop: &Stop) -> Result<(), Error> {
        let folder = fs::canonicalize(self.alone.path()).at(self.alone.path())?;
        let place = tempfile::tempdir_in(&folder).at(&folder)?.keep();
        let expected = fs::read(self.alone.slots()).at(&self.alone.slots())?;
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        let mut killed = BTreeMap::<String, u64>::new();
        for mission in 1..=self.missions {
            stop.check()?;
            let out = place.join(format!("mission-{mission}"));
            let fault = |what: String| Error::Soak(format!("mission {mission}: {what} ({})", out.display()));
            self.fly_one(&place, &out, expected.len() as u64, &mut random, &mut killed).map_err(fault)?;
            judge(&place, &out, &expected).map_err(fault)?;
            fs::remove_dir_all(&out).at(&out)?;
        }
        fs::remove_dir_all(&place).at(&place)?;
        let kills: u64 = killed.values().sum();
        print(format_args!(
            "{} missions with {kills} kills: the same traces, whole recordings, nothing left",
            self.missions
        ))?;
        for (name, count) in killed {
            print(format_args!("  {name:<10} {count:>5} kills"))?;
        }
        Ok(())
    }

    /// Flies a mission to its end, however often its launcher is killed.
    fn fly_one(
        &self,
        place: &Path,
        out: &Path,
        bytes: u64,
        random: &mut ChaCha8Rng,
        killed: &mut BTreeMap<String, u64>,
    ) -> Result<(), String> {
        let mut kills: Vec<Kill> = (0..self.kills).map(|_| draw(bytes, random)).collect();
        kills.sort_by_key(|kill| std::cmp::Reverse(kill.bytes));
        let begin = Instant::now();
        loop {
            let mut launcher = self.launch(place, out).map_err(|error| error.to_string())?;
            let ended = disturb(&mut launcher, out, begin, &mut kills, random, killed)?;
            if ended.success() {
                return Ok(());
            }
            if ended.code().is_some() {
                let said = fs::read_to_string(place.join("messages")).unwrap_or_default();
                return Err(format!("{ended}: {}", said.lines().last().unwrap_or_default()));
            }
        }
    }

    /// Starts the mission, or resumes it as far as it is on record.
    fn launch(&self, place: &Path, out: &Path) -> std::io::Result<Child> {
        let (program, words) = programs::words("skysink")?;
        let mut command = Command::new(program);
        command.args(words).arg("run");
        let is_begun = fs::read_to_string(out.join("slots.csv")).is_ok_and(|trace| trace.lines().count() > 1);
        if is_begun {
            command.arg("--resume").arg(out);
        } else {
            let _ = fs::remove_dir_all(out); // it was killed before anything was flown
            command.arg(self.alone.scenario()).arg("--out").arg(out);
        }
        if !self.viewer {
            command.arg("--no-viewer");
        }
        let messages = fs::File::create(place.join("messages"))?;
        command.env("TMPDIR", place).stdin(Stdio::null()).stdout(Stdio::null()).stderr(messages).spawn()
    }
}

/// A third of the kills comes while the mission starts, a third in its last tenth or after it, a third between.
fn draw(bytes: u64, random: &mut ChaCha8Rng) -> Kill {
    let part = match random.random_range(0..3) {
        0 => 0.0,
        1 => random.random_range(0.0..0.9),
        _ => random.random_range(0.9..=1.0),
    };
    let most = if part == 0.0 { MAX_START } else { MAX_DELAY };
    Kill { bytes: (part * bytes as f64) as u64, delay: most.mul_f64(random.random::<f64>()) }
}

/// Kills processes of the mission until it ends or its launcher is killed.
fn disturb(
    launcher: &mut Child,
    out: &Path,
    begin: Instant,
    kills: &mut Vec<Kill>,
    random: &mut ChaCha8Rng,
    killed: &mut BTreeMap<String, u64>,
) -> Result<ExitStatus, String> {
    loop {
        if let Some(ended) = launcher.try_wait().map_err(|error| error.to_string())? {
            return Ok(ended);
        }
        if begin.elapsed() > MAX_MISSION {
            let _ = launcher.kill();
            let _ = launcher.wait();
            return Err(format!("it has not ended after {} s", MAX_MISSION.as_secs()));
        }
        std::thread::sleep(POLL);
        let flown = fs::metadata(out.join("slots.csv")).map_or(0, |file| file.len());
        let Some(kill) = kills.pop_if(|kill| kill.bytes <= flown) else { continue };
        std::thread::sleep(kill.delay);
        let mut processes = children(launcher.id());
        processes.push((launcher.id(), "skysink".to_owned()));
        let (id, name) = &processes[random.random_range(0..processes.len())];
        let pid = i32::try_from(*id).ok().and_then(Pid::from_raw);
        if launcher.try_wait().is_ok_and(|ended| ended.is_none())
            && pid.is_some_and(|pid| kill_process(pid, Signal::KILL).is_ok())
        {
            *killed.entry(name.clone()).or_default() += 1;
        }
    }
}

/// The processes that the launcher has started, by id and name.
fn children(launcher: u32) -> Vec<(u32, String)> {
    let tasks = fs::read_dir(format!("/proc/{launcher}/task")).into_iter().flatten().flatten();
    let ids = tasks.filter_map(|task| fs::read_to_string(task.path().join("children")).ok());
    let ids = ids.collect::<String>();
    let named =
        |id: &str| Some((id.parse().ok()?, fs::read_to_string(format!("/proc/{id}/comm")).ok()?.trim().to_owned()));
    ids.split_ascii_whitespace().filter_map(named).collect()
}

/// What is wrong with a mission that has ended.
fn judge(place: &Path, out: &Path, expected: &[u8]) -> Result<(), String> {
    let trace = fs::read(out.join("slots.csv")).map_err(|error| error.to_string())?;
    if trace != expected {
        return Err("its trace is not that of the undisturbed mission".to_owned());
    }
    #[cfg(feature = "viewer")]
    for path in files(out).filter(|path| path.extension().is_some_and(|extension| extension == "rrd")) {
        let begin = Instant::now(); // the viewer of a killed launcher ends soon
        while !skysink_viewer::has_footer(&path).unwrap_or(false) {
            if begin.elapsed() > MAX_END {
                return Err(format!("{} has no footer", path.display()));
            }
            std::thread::sleep(POLL);
        }
    }
    let home = place.join(format!("skysink-{}", rustix::process::getuid().as_raw()));
    let left: Vec<_> = files(&home).collect();
    let shared = |ring: &PathBuf| {
        let name = ring.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        files(Path::new(SHARED_MEMORY)).any(|file| file.to_string_lossy().contains(&format!("sky{name}_")))
    };
    if let Some(path) = left.first() {
        let memory = if left.iter().any(shared) { ", with shared memory" } else { "" };
        return Err(format!("{} is left behind{memory}", path.display()));
    }
    Ok(())
}

fn files(folder: &Path) -> impl Iterator<Item = PathBuf> {
    fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path())
}
