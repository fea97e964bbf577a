//! The ring of processes against its lower bound: the same messages passed around as many processes, and the plan.

use std::process::{Command, Stdio};

use serde::Serialize;
use skysink::run::executables;
use skysink_common::pace::Pace;
use skysink_common::stop::Stop;
use skysink_mission::error::FileContext;
use skysink_mission::figures::Summary;
use skysink_mission::latency::Spread;
use skysink_mission::summary::RunTiming;
use skysink_ring::wait::Waiting;

use crate::error::BenchError;
use crate::hop::{self, RingCase};
use crate::setting::{BenchEffort, letter_keys, median_by, temporary_folder};

/// A ring against its lower bound.
#[derive(Debug, Serialize)]
pub struct RingRow {
    /// What it flies.
    #[serde(flatten)]
    pub case: RingCase,
    /// Slots per second.
    pub slots_per_s: f64,
    /// A slot, from queues to queues; in a paced ring from its beginning to the plan of the next.
    pub slot: Spread,
    /// The plan, which is part of it.
    pub plan: Spread,
    /// Three bare hops with the same payloads.
    pub hops: Spread,
    /// Median of the slot over its lower bound, the medians of hops and plan together.
    pub p50_over_floor: f64,
    /// 99th percentile of the slot over its median.
    pub p99_over_p50: f64,
}

/// Measures rings and lower bounds in turns.
pub fn measure(effort: BenchEffort, stop: &Stop) -> Result<Vec<RingRow>, BenchError> {
    let mut rows = Vec::new();
    // With 10^6 SNs a ring does not keep up with 200 slots a second.
    for (pace, counts) in [(Pace::Max, effort.counts()), (Pace::Factor(200.0), BenchEffort::Quick.counts())] {
        for &sensors in counts {
            for &wait in Waiting::ALL {
                let slots = match (pace, sensors) {
                    (Pace::Factor(_), _) => effort.choose(600, 20),
                    (Pace::Max, ..100_000) => effort.choose(6_000, 100),
                    (Pace::Max, _) => effort.choose(500, 10),
                };
                rows.push(row(RingCase { sensors, wait, pace, slots, uavs: 1 }, effort, stop)?);
            }
        }
    }
    Ok(rows)
}

fn row(case: RingCase, effort: BenchEffort, stop: &Stop) -> Result<RingRow, BenchError> {
    let mut hops = Vec::new();
    let mut runs = Vec::new();
    for _ in 0..effort.choose(5, 1) {
        hops.push(hop::time(case, stop)?);
        let timing = run_ring(case, stop)?;
        let latency = timing.latency.expect("a run without a link measures them");
        runs.push((timing, latency.slot));
    }
    let hops = median_by(hops, |hops| hops.p50_us);
    let (timing, slot) = median_by(runs, |(_, slot)| slot.p50_us);
    let plan = Spread {
        p50_us: timing.plan_p50_us,
        p99_us: timing.plan_p99_us,
        p999_us: timing.plan_p999_us,
        max_us: timing.plan_max_us,
    };
    Ok(RingRow {
        case,
        slots_per_s: timing.slots_per_s,
        slot,
        plan,
        hops,
        p50_over_floor: slot.p50_us / (hops.p50_us + plan.p50_us),
        p99_over_p50: slot.p99_us / slot.p50_us,
    })
}

/// One run of the whole ring by `skysink run`.
pub fn run_ring(case: RingCase, stop: &Stop) -> Result<RunTiming, BenchError> {
    stop.check()?;
    let folder = temporary_folder()?;
    let (program, words) = executables::command_of("skysink").at("skysink".as_ref())?;
    let mut command = Command::new(&program);
    command.args(words).args(["run", "--no-viewer", "--json"]);
    command.args(["--wait", &case.wait.to_string(), "--pace", &case.pace.to_string()]);
    command.args(letter_keys(case.sensors, case.slots).iter().flat_map(|key| ["--set", key]));
    if case.uavs > 1 {
        command.args(["--set", &format!("uav.count={}", case.uavs), "--set", "uav.coordination=sequential"]);
    }
    let run = command.arg("--out").arg(folder.path().join("run")).stdin(Stdio::null()).output().at(&program)?;
    if !run.status.success() {
        stop.check()?; // Ctrl-C at a terminal stops the run, too
        let message = String::from_utf8_lossy(&run.stderr).trim().to_owned();
        return Err(BenchError::Run { status: run.status, message });
    }
    let summary: Summary = serde_json::from_slice(&run.stdout).expect("the summary of this version");
    Ok(summary.timing)
}
