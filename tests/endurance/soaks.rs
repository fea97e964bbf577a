//! Long missions whose processes are killed at random in the first half and measured in the second. The trace is that
//! of the undisturbed mission, every bit is accounted for, and neither memory nor file descriptors grow.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;
use std::time::{Duration, Instant};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rustix::process::{Pid, Signal, kill_process};

use crate::support::flight::{RING, RunningFlight};
use crate::support::{Place, assert_balanced, family};

/// Time between two polls: in the first half for a due kill, in the second half to measure the processes.
const POLL_EVERY: Duration = Duration::from_millis(50);

/// By how many file descriptors a process may grow.
const DESCRIPTORS: usize = 2;

/// By how much the allocator of a process may grow [byte].
const MEMORY_BYTES: f64 = 4.0 * (1 << 20) as f64;

/// The row of the shared memory among the processes.
const SHARED_MEMORY: &str = "/dev/shm";

/// What a process holds at an instant of the second half.
#[derive(Debug)]
struct Sample {
    /// The part of the mission that is flown, from 0 to 1.
    flown: f64,
    memory_bytes: f64,
    descriptors: usize,
}

/// Kills and measurements by process.
#[derive(Debug, Default)]
struct Observations {
    kills: BTreeMap<&'static str, u64>,
    samples: BTreeMap<String, Vec<Sample>>,
}

impl Observations {
    /// Kills processes of a run in its first half, `kill_every` apart in the mean, and measures them in its second.
    /// `bytes` is the length of the whole trace.
    fn of(run: &mut RunningFlight, place: &Place, bytes: u64, kill_every: Duration) -> Self {
        let mut observations = Self::default();
        let mut random = ChaCha8Rng::seed_from_u64(1);
        run.until_slot(1);
        let mut kill_at = Instant::now();
        while !run.has_ended() {
            std::thread::sleep(POLL_EVERY);
            let flown = fs::metadata(run.path("slots.csv")).unwrap().len() as f64 / bytes as f64;
            if flown >= 0.5 {
                observations.measure(run.pid(), place, flown);
            } else if Instant::now() >= kill_at {
                kill_at += kill_every.mul_f64(-(1.0 - random.random::<f64>()).ln()); // Poisson
                let role = RING[random.random_range(0..RING.len())];
                if run.worker_now(role).is_some_and(|worker| kill_process(worker, Signal::KILL).is_ok()) {
                    *observations.kills.entry(role).or_default() += 1;
                }
            }
        }
        observations
    }

    /// Adds a sample of every process, of the launcher, and of the shared memory.
    fn measure(&mut self, launcher: Pid, place: &Place, flown: f64) {
        for (name, process) in family(launcher) {
            let folder = Path::new("/proc").join(process.as_raw_nonzero().to_string());
            let descriptors = fs::read_dir(folder.join("fd")).map_or(0, Iterator::count);
            if let Some(memory_bytes) = private_bytes(&folder) {
                self.samples.entry(name).or_default().push(Sample { flown, memory_bytes, descriptors });
            }
        }
        let files = place.shared_memory().into_iter().filter_map(|path| fs::metadata(path).ok());
        let memory_bytes = files.map(|file| file.blocks() * 512).sum::<u64>() as f64;
        let shared = self.samples.entry(SHARED_MEMORY.to_owned()).or_default();
        shared.push(Sample { flown, memory_bytes, descriptors: 0 });
    }

    /// Fails if a process leaks. Prints what it held.
    fn assert_no_leak(&self) {
        for (name, samples) in &self.samples {
            // Without the first quarter, in which a restarted process may still fill its buffers.
            let growth = slope(&samples[samples.len() / 4..]) / 2.0;
            // The fewest at the end against the most at the beginning: connections vary while a peer is restarted.
            let quarter = samples.len().div_ceil(4);
            let [most, _] = descriptors(&samples[..quarter]);
            let [last_most, least] = descriptors(&samples[samples.len() - quarter..]);
            let kib = |sample: Option<&Sample>| sample.map_or(0.0, |sample| sample.memory_bytes / 1024.0);
            println!(
                "{name:<10} {:>5} kills, {:.0} to {:.0} KiB, growth {:.1} KiB, {most} to {last_most} descriptors",
                self.kills.get(name.as_str()).unwrap_or(&0),
                kib(samples.first()),
                kib(samples.last()),
                growth / 1024.0,
            );
            assert!(growth <= MEMORY_BYTES, "memory of {name} has grown: {self:?}");
            assert!(least <= most + DESCRIPTORS, "descriptors of {name} have grown: {self:?}");
        }
    }
}

/// Private resident memory of a process [byte], without files and shared memory.
fn private_bytes(process: &Path) -> Option<f64> {
    let status = fs::read_to_string(process.join("status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("RssAnon:"))?;
    line.split_ascii_whitespace().next()?.parse::<f64>().ok().map(|kib| kib * 1024.0)
}

/// The highest and the lowest number of descriptors.
fn descriptors(samples: &[Sample]) -> [usize; 2] {
    let counts = || samples.iter().map(|sample| sample.descriptors);
    [counts().max().unwrap_or(0), counts().min().unwrap_or(0)]
}

/// Slope of the least-squares line through the memory over the flown part of the mission [byte].
fn slope(samples: &[Sample]) -> f64 {
    let mean = |of: fn(&Sample) -> f64| samples.iter().map(of).sum::<f64>() / samples.len() as f64;
    let x = mean(|sample| sample.flown);
    let y = mean(|sample| sample.memory_bytes);
    let covariance: f64 = samples.iter().map(|sample| (sample.flown - x) * (sample.memory_bytes - y)).sum();
    let variance: f64 = samples.iter().map(|sample| (sample.flown - x).powi(2)).sum();
    if variance > 0.0 { covariance / variance } else { 0.0 }
}

/// Flies the mission in the ring, and fails unless it is the undisturbed one and no process leaks.
fn soak(slots: u64, kill_every: Duration) {
    let place = Place::new();
    let flight = place.flight("long").strategy("gfs").set("slots", slots).without_viewer();
    flight.out("undisturbed").simulate();
    let bytes = fs::metadata(place.path("undisturbed/slots.csv")).unwrap().len();
    let mut run = flight.start();
    let observations = Observations::of(&mut run, &place, bytes, kill_every);
    run.wait_for_success();
    place.assert_same_trace("undisturbed", "run");
    assert_balanced(&place.summary("run"));
    observations.assert_no_leak();
    let measured: Vec<&str> = observations.samples.keys().map(String::as_str).collect();
    assert_eq!(measured, [SHARED_MEMORY, RING[0], RING[1], RING[2], "skysink"]);
    assert!(observations.kills.values().sum::<u64>() > 0, "{observations:?}");
    place.assert_clean();
}

#[test]
fn a_long_mission_under_kills_leaks_nothing() {
    soak(40_000, Duration::from_millis(500));
}

#[test]
#[ignore = "takes minutes in a release build, and longer in others"]
fn a_million_slots_under_kills_leak_nothing() {
    soak(1_000_000, Duration::from_millis(200));
}

#[test]
fn the_slope_of_a_line_is_exact() {
    let at = |x: f64| Sample { flown: x, memory_bytes: 3.0 - 0.5 * x, descriptors: 0 };
    let line: Vec<_> = (0..10).map(|x| at(f64::from(x))).collect();
    assert!((slope(&line) + 0.5).abs() < 1e-12);
    assert_eq!(slope(&line[..1]), 0.0);
}

#[test]
fn this_process_can_be_measured() {
    assert!(private_bytes(Path::new("/proc/self")).unwrap() > 65_536.0);
    assert_eq!(private_bytes(Path::new("/proc/none")), None);
}
