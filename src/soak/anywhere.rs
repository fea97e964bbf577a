//! `skysink soak --anywhere`: flies short missions and kills any process, including the launcher, at any time. A
//! mission whose launcher was killed is resumed. Each must end with the trace of the undisturbed mission and complete
//! recordings, and leave no files or shared memory behind.

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

/// Time between two polls of a mission.
const POLL: Duration = Duration::from_millis(1);

/// Maximum delay of a kill after its trigger.
const MAX_DELAY: Duration = Duration::from_millis(10);

/// Maximum delay of a kill during start-up, about as long as the start-up.
const MAX_START: Duration = Duration::from_millis(150);

/// A mission that takes longer is considered hung.
const MAX_MISSION: Duration = Duration::from_secs(120);

/// Time that a viewer may take to end after its launcher was killed.
#[cfg(feature = "viewer")]
const MAX_END: Duration = Duration::from_secs(10);

/// The missions and their kills.
#[derive(Debug)]
pub struct KillAnywhere {
    /// Folder of the undisturbed mission. The other missions are flown in subfolders.
    pub undisturbed: RunFolder,
    /// Number of missions.
    pub missions: u64,
    /// Maximum number of kills per mission.
    pub kills: u32,
    /// Seed of the kills.
    pub seed: u64,
    /// Whether the viewer runs.
    pub viewer: bool,
}

/// The kill of a random process, `delay` after the trace has reached a length of `bytes`.
#[derive(Debug, Clone, Copy)]
struct Kill {
    bytes: u64,
    delay: Duration,
}

impl KillAnywhere {
    /// Flies the missions and prints the number of kills.
    ///
    /// # Errors
    /// [`Error::Soak`] for the first mission that fails; its folder is kept.
    pub fn fly(&self, stop: &Stop) -> Result<(), Error> {
        let folder = fs::canonicalize(self.undisturbed.path()).at(self.undisturbed.path())?;
        let place = tempfile::tempdir_in(&folder).at(&folder)?.keep();
        let expected = fs::read(self.undisturbed.slots()).at(&self.undisturbed.slots())?;
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        let mut killed = BTreeMap::<String, u64>::new();
        for mission in 1..=self.missions {
            stop.check()?;
            let out = place.join(format!("mission-{mission}"));
            let fault = |what: String| Error::Soak(format!("mission {mission}: {what} ({})", out.display()));
            self.fly_one(&place, &out, expected.len() as u64, &mut random, &mut killed).map_err(fault)?;
            check_mission(&place, &out, &expected).map_err(fault)?;
            fs::remove_dir_all(&out).at(&out)?;
        }
        fs::remove_dir_all(&place).at(&place)?;
        let kills: u64 = killed.values().sum();
        print(format_args!(
            "{} missions with {kills} kills: equal traces, complete recordings, nothing left behind",
            self.missions
        ))?;
        for (name, count) in killed {
            print(format_args!("  {name:<10} {count:>5} kills"))?;
        }
        Ok(())
    }

    /// Flies a mission to its end; resumes it each time its launcher is killed.
    fn fly_one(
        &self,
        place: &Path,
        out: &Path,
        bytes: u64,
        random: &mut ChaCha8Rng,
        killed: &mut BTreeMap<String, u64>,
    ) -> Result<(), String> {
        let mut kills: Vec<Kill> = (0..self.kills).map(|_| draw_kill(bytes, random)).collect();
        kills.sort_by_key(|kill| std::cmp::Reverse(kill.bytes));
        let begin = Instant::now();
        loop {
            let mut launcher = self.launch(place, out).map_err(|error| error.to_string())?;
            let ended = disturb(&mut launcher, out, begin, &mut kills, random, killed)?;
            if ended.success() {
                return Ok(());
            }
            if ended.code().is_some() {
                let messages = fs::read_to_string(place.join("messages")).unwrap_or_default();
                return Err(format!("{ended}: {}", messages.lines().last().unwrap_or_default()));
            }
        }
    }

    /// Starts the mission, or resumes it if some slots are recorded.
    fn launch(&self, place: &Path, out: &Path) -> std::io::Result<Child> {
        let (program, words) = programs::command_of("skysink")?;
        let mut command = Command::new(program);
        command.args(words).arg("run");
        let is_begun = fs::read_to_string(out.join("slots.csv")).is_ok_and(|trace| trace.lines().count() > 1);
        if is_begun {
            command.arg("--resume").arg(out);
        } else {
            let _ = fs::remove_dir_all(out); // left by a launcher that was killed before slot 1
            command.arg(self.undisturbed.scenario()).arg("--out").arg(out);
        }
        if !self.viewer {
            command.arg("--no-viewer");
        }
        let messages = fs::File::create(place.join("messages"))?;
        command.env("TMPDIR", place).stdin(Stdio::null()).stdout(Stdio::null()).stderr(messages).spawn()
    }
}

/// Draws a kill: with equal probability during start-up, in the first nine tenths, or in the last tenth of the mission.
fn draw_kill(bytes: u64, random: &mut ChaCha8Rng) -> Kill {
    let fraction = match random.random_range(0..3) {
        0 => 0.0,
        1 => random.random_range(0.0..0.9),
        _ => random.random_range(0.9..=1.0),
    };
    let max_delay = if fraction == 0.0 { MAX_START } else { MAX_DELAY };
    Kill { bytes: (fraction * bytes as f64) as u64, delay: max_delay.mul_f64(random.random::<f64>()) }
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

/// The ids and names of the processes that the launcher has started.
fn children(launcher: u32) -> Vec<(u32, String)> {
    let tasks = fs::read_dir(format!("/proc/{launcher}/task")).into_iter().flatten().flatten();
    let ids = tasks.filter_map(|task| fs::read_to_string(task.path().join("children")).ok());
    let ids = ids.collect::<String>();
    let named =
        |id: &str| Some((id.parse().ok()?, fs::read_to_string(format!("/proc/{id}/comm")).ok()?.trim().to_owned()));
    ids.split_ascii_whitespace().filter_map(named).collect()
}

/// Checks a mission that has ended: its trace, its recordings, and that nothing is left behind.
fn check_mission(place: &Path, out: &Path, expected: &[u8]) -> Result<(), String> {
    let trace = fs::read(out.join("slots.csv")).map_err(|error| error.to_string())?;
    if trace != expected {
        return Err("its trace differs from that of the undisturbed mission".to_owned());
    }
    #[cfg(feature = "viewer")]
    for path in files(out).filter(|path| path.extension().is_some_and(|extension| extension == "rrd")) {
        let begin = Instant::now(); // the viewer of a killed launcher may take a moment to end
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
