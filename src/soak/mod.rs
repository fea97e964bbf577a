//! `skysink soak`: flies a long mission in the ring and kills its processes at random in the first half. The trace must
//! equal that of the undisturbed mission, and no process may leak memory or file descriptors.

pub mod anywhere;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rustix::process::{Signal, kill_process};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;

use crate::error::Error;
use crate::report::{self, print, with_numbers_right};
use crate::run::process::ProcessTable;
use crate::run::{self, Run};
use skysink_mission::mission::Mission;
use skysink_mission::record::RunFolder;
use skysink_mission::summary::Summary;
use skysink_mission::trace::TraceHash;

/// Time between two polls: in the first half for a due kill, in the second half to measure the processes.
const POLL_EVERY: Duration = Duration::from_millis(50);

/// Tolerance for the number of open file descriptors of a process.
const FD_SLACK: u64 = 2;

/// Tolerance for the growth of memory by the allocator [MiB].
const MEMORY_SLACK_MIB: f64 = 4.0;

/// The row of the shared memory among the processes.
const SHARED_MEMORY: &str = "/dev/shm";

/// A measurement of a process in the second half.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Sample {
    slot: u64,
    memory_bytes: u64,
    descriptors: u64,
}

/// Kills and measurements by process.
#[derive(Debug, Default)]
struct Observations {
    kills: BTreeMap<&'static str, u64>,
    samples: BTreeMap<&'static str, Vec<Sample>>,
}

/// Flies the mission with `kill_every` as the mean time between two kills, and prints the result.
///
/// # Errors
/// Those of the run. [`Error::Soak`] if the trace differs from that of the undisturbed mission, or a process leaks
/// memory or file descriptors.
pub fn soak(run: &Run, kill_every: Duration, stop: &Stop) -> Result<(), Error> {
    let begin = Instant::now();
    let expected = undisturbed_hash(run, stop)?;
    let seconds = begin.elapsed().as_secs_f64();
    print(format_args!("undisturbed, in one process: {} slots in {seconds:.1} s", run.scenario.slots))?;
    let over = AtomicBool::new(false);
    let table = ProcessTable::default();
    let (observations, flown) = std::thread::scope(|scope| {
        let watcher = scope.spawn(|| disturb(&run.scenario, kill_every, &table, &over));
        let flown = run::run(run, stop, &table);
        over.store(true, Ordering::Relaxed);
        (watcher.join().unwrap_or_default(), flown)
    });
    let (folder, summary) = flown?;
    evaluate(&observations, &folder, &summary, expected)
}

/// The hash of the trace of the mission, simulated in this process.
fn undisturbed_hash(run: &Run, stop: &Stop) -> Result<u64, Error> {
    let list = SensorList::of(&run.scenario)?;
    run.options.check(&list)?;
    let mut mission = Mission::new(&run.scenario, &list)?;
    let mut trace = TraceHash::default();
    for flown in &mut mission {
        trace.write(&flown.flight, &flown.header)?;
        trace.add();
        stop.check()?;
    }
    Ok(trace.value())
}

/// Kills processes and measures them until the run is over.
fn disturb(scenario: &Scenario, kill_every: Duration, table: &ProcessTable, over: &AtomicBool) -> Observations {
    let mut observations = Observations::default();
    let mut random = ChaCha8Rng::seed_from_u64(scenario.seed);
    let mut kill_at = Instant::now();
    while !over.load(Ordering::Relaxed) {
        std::thread::sleep(POLL_EVERY);
        let slot = table.slot.load(Ordering::Relaxed);
        if slot >= scenario.slots / 2 {
            if slot < scenario.slots {
                measure(table, slot, &mut observations);
            }
            continue;
        }
        if Instant::now() < kill_at {
            continue;
        }
        kill_at += kill_every.mul_f64(-(1.0 - random.random::<f64>()).ln()); // Poisson
        let ids = table.ids();
        let running: Vec<_> = ids.iter().collect();
        if slot > 0 && !running.is_empty() {
            let (name, pid) = running[random.random_range(0..running.len())];
            if kill_process(*pid, Signal::KILL).is_ok() {
                *observations.kills.entry(name).or_default() += 1;
            }
        }
    }
    observations
}

/// Adds a measurement of every process, of the launcher, and of the shared memory.
fn measure(table: &ProcessTable, slot: u64, observations: &mut Observations) {
    let ids = table.ids().clone();
    let pids = ids.iter().map(|(name, pid)| (*name, pid.as_raw_nonzero().to_string()));
    let mut add = |name, memory_bytes, descriptors| {
        observations.samples.entry(name).or_default().push(Sample { slot, memory_bytes, descriptors });
    };
    for (name, pid) in pids.chain([("skysink", "self".to_owned())]) {
        let process = PathBuf::from("/proc").join(pid);
        if let (Some(memory_bytes), Some(descriptors)) = (private_bytes(&process), entries(&process.join("fd"))) {
            add(name, memory_bytes, descriptors);
        }
    }
    if let Some(prefix) = table.shared_prefix.get() {
        add(SHARED_MEMORY, shared_bytes(prefix), 0);
    }
}

/// Private resident memory of a process [byte], without files and shared memory.
fn private_bytes(process: &Path) -> Option<u64> {
    let status = fs::read_to_string(process.join("status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("RssAnon:"))?;
    line.split_ascii_whitespace().next()?.parse::<u64>().ok().map(|kib| kib * 1024)
}

/// Number of entries of a folder.
fn entries(folder: &Path) -> Option<u64> {
    fs::read_dir(folder).ok().map(|entries| entries.count() as u64)
}

/// Allocated shared memory in files with this prefix [byte].
fn shared_bytes(prefix: &str) -> u64 {
    use std::os::unix::fs::MetadataExt;
    let ours = |entry: &fs::DirEntry| entry.file_name().to_string_lossy().starts_with(prefix);
    let files = fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten().filter(ours);
    files.filter_map(|file| file.metadata().ok()).map(|file| file.blocks() * 512).sum()
}

/// Slope of the least-squares line through the points.
fn slope(points: &[(f64, f64)]) -> f64 {
    let count = points.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / count;
    let x = mean(|point| point.0);
    let y = mean(|point| point.1);
    let covariance: f64 = points.iter().map(|point| (point.0 - x) * (point.1 - y)).sum();
    let variance: f64 = points.iter().map(|point| (point.0 - x).powi(2)).sum();
    if variance > 0.0 { covariance / variance } else { 0.0 }
}

/// Prints the table; fails if the trace differs, the ledger does not balance, or a process leaks.
fn evaluate(observations: &Observations, folder: &RunFolder, summary: &Summary, expected: u64) -> Result<(), Error> {
    const MIB: f64 = (1u64 << 20) as f64;
    let speed = summary.timing.slots_per_s;
    let kills: u64 = observations.kills.values().sum();
    let Summary { slots, restarts, totals, trace_hash, .. } = summary;
    print(format_args!("in the ring: {slots} slots, {speed:.0} slots/s, {kills} kills, {restarts} restarts"))?;
    let unaccounted = (totals.initial_bits + totals.sampled_bits)
        .abs_diff(totals.delivered_bits + totals.lost_bits + totals.queued_bits);
    let mut faults = Vec::new();
    if *trace_hash != format!("{expected:016x}") {
        faults.push("the trace differs from that of the undisturbed mission".to_owned());
    }
    if unaccounted != 0 {
        faults.push(format!("{unaccounted} bits are unaccounted for"));
    }
    let mut table = report::table();
    table.set_header(["process", "kills", "memory [MiB]", "slope [MiB/10⁶ slots]", "descriptors"]);
    for (name, samples) in &observations.samples {
        let (Some(first), Some(last)) = (samples.first(), samples.last()) else { continue };
        // Skips the first quarter, in which a restarted process may still fill its buffers.
        let settled = samples[samples.len() / 4..].iter();
        let points: Vec<_> = settled.map(|sample| (sample.slot as f64, sample.memory_bytes as f64 / MIB)).collect();
        let slope = slope(&points) * 1e6;
        if slope * (*slots as f64 / 2e6) > MEMORY_SLACK_MIB {
            faults.push(format!("memory of {name} has grown"));
        }
        // Compares the minimum at the end with the maximum at the beginning: the number of connections varies while a
        // peer is restarted.
        let quarter = samples.len().div_ceil(4);
        let descriptors = |samples: &[Sample]| samples.iter().map(|sample| sample.descriptors).collect::<Vec<_>>();
        let most = descriptors(&samples[..quarter]).into_iter().max();
        let least = descriptors(&samples[samples.len() - quarter..]).into_iter().min();
        if least > most.map(|most| most + FD_SLACK) {
            faults.push(format!("number of file descriptors of {name} has grown"));
        }
        table.add_row([
            (*name).to_owned(),
            observations.kills.get(name).map_or_else(String::new, u64::to_string),
            format!("{:.2} → {:.2}", first.memory_bytes as f64 / MIB, last.memory_bytes as f64 / MIB),
            format!("{slope:.3}"),
            format!("{} → {}", first.descriptors, last.descriptors),
        ]);
    }
    print(with_numbers_right(table))?;
    print(format_args!("bits unaccounted: {unaccounted}"))?;
    print(format_args!("trace: {trace_hash} (undisturbed {expected:016x})"))?;
    print(format_args!("run folder: {}", folder.path().display()))?;
    faults.into_iter().next().map_or(Ok(()), |fault| Err(Error::Soak(fault)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slope_of_a_line_is_exact() {
        let line: Vec<_> = (0..10).map(|x| (f64::from(x), 3.0 - 0.5 * f64::from(x))).collect();
        assert!((slope(&line) + 0.5).abs() < 1e-12);
        assert_eq!(slope(&[(1.0, 2.0)]), 0.0);
        assert!(slope(&[]).abs() < 1e-12 || slope(&[]).is_nan());
    }

    #[test]
    fn this_process_can_be_measured() {
        let own = Path::new("/proc/self");
        assert!(private_bytes(own).unwrap() > 1 << 16);
        assert!(entries(&own.join("fd")).unwrap() >= 3);
        assert_eq!(private_bytes(Path::new("/proc/none")), None);
    }
}
