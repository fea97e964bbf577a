//! The ring of processes beside its lower bound: the same messages passed around as many processes, and the plan.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use serde::Serialize;
use skysink_common::pace::Pace;
use skysink_common::stop::Stop;
use skysink_ring::wait::Waiting;

use super::hop::HopRounds;
use super::{Effort, counts, letter_text, median, median_spread};
use crate::error::Error;
use crate::programs;
use skysink_mission::error::FileContext;
use skysink_mission::latency::Spread;

/// Slots per second of a paced ring.
const PACED_HZ: f64 = 200.0;

/// Sensor nodes up to which a ring keeps up with that.
const PACED_MOST: u32 = 10_000;

/// A ring beside its lower bound.
#[derive(Debug, Serialize)]
pub struct RingRow {
    /// Sensor nodes.
    pub sensors: u32,
    /// How the processes wait for each other.
    pub wait: Waiting,
    /// How fast it runs.
    pub pace: Pace,
    /// Slots per second.
    pub slots_per_s: f64,
    /// A slot, from queues to queues; where it is paced from its beginning to the plan of the next.
    pub slot: Spread,
    /// The plan, which is part of it.
    pub plan: Spread,
    /// Three bare hops with the same payloads.
    pub hops: Spread,
    /// Its lower bound: medians of hops and plan together [µs].
    pub floor_us: f64,
    /// Median of the slot over that.
    pub p50_over_floor: f64,
    /// 99th percentile of the slot over its median.
    pub p99_over_p50: f64,
}

/// Measures rings and lower bounds alternately.
///
/// # Errors
/// If an executable is missing or fails, or on a stop.
pub fn measure(effort: Effort, stop: &Stop) -> Result<Vec<RingRow>, Error> {
    let mut rows = Vec::new();
    for pace in [Pace::Max, Pace::Factor(PACED_HZ)] {
        for sensors in counts(effort).iter().copied().filter(|&sensors| pace == Pace::Max || sensors <= PACED_MOST) {
            for &wait in Waiting::ALL {
                rows.push(row(sensors, wait, pace, effort, stop)?);
            }
        }
    }
    Ok(rows)
}

fn row(sensors: u32, wait: Waiting, pace: Pace, effort: Effort, stop: &Stop) -> Result<RingRow, Error> {
    let slots = match (pace, sensors) {
        (Pace::Factor(_), _) => effort.choose(600, 20),
        (Pace::Max, ..100_000) => effort.choose(6_000, 100),
        (Pace::Max, _) => effort.choose(500, 10),
    };
    let period = pace.period(1.0).unwrap_or(Duration::ZERO);
    let bound = HopRounds { wait, sensors, rounds: slots, period };
    let mut hops = Vec::new();
    let mut slot = Vec::new();
    let mut plan = Vec::new();
    let mut slots_per_s = Vec::new();
    for _ in 0..effort.choose(5, 1) {
        hops.push(bound.time(stop)?);
        let timing = fly(sensors, slots, wait, pace, stop)?;
        let number = |key: &str| timing[key].as_f64().unwrap_or(0.0);
        let max_us = number("plan_max_us");
        plan.push(Spread { p50_us: number("plan_p50_us"), p99_us: number("plan_p99_us"), p999_us: max_us, max_us });
        slot.push(serde_json::from_value(timing["latency"]["slot"].clone()).map_err(unread)?);
        slots_per_s.push(number("slots_per_s"));
    }
    let [hops, slot, plan] = [hops, slot, plan].map(|spreads| median_spread(&spreads));
    let floor_us = hops.p50_us + plan.p50_us;
    Ok(RingRow {
        sensors,
        wait,
        pace,
        slots_per_s: median(slots_per_s),
        slot,
        plan,
        hops,
        floor_us,
        p50_over_floor: slot.p50_us / floor_us,
        p99_over_p50: slot.p99_us / slot.p50_us,
    })
}

/// One run of the whole ring, by `skysink run`; returns `timing` of its summary.
fn fly(sensors: u32, slots: u64, wait: Waiting, pace: Pace, stop: &Stop) -> Result<serde_json::Value, Error> {
    stop.check()?;
    let place = tempfile::tempdir().at(Path::new("folder for temporary files"))?;
    let (scenario, out) = (place.path().join("bench.toml"), place.path().join("run"));
    fs::write(&scenario, letter_text(sensors, slots)).at(&scenario)?;
    let (program, words) = programs::command_of("skysink").at(Path::new("skysink"))?;
    let run = Command::new(&program)
        .args(words)
        .arg("run")
        .arg(&scenario)
        .args(["--no-viewer", "--wait", &wait.to_string(), "--pace", &pace.to_string(), "--out"])
        .arg(&out)
        .stdin(Stdio::null())
        .output()
        .at(&program)?;
    if !run.status.success() {
        let said = String::from_utf8_lossy(&run.stderr).trim().to_owned();
        return Err(Error::Bench(format!("skysink run: {}: {said}", run.status)));
    }
    let summary = out.join("summary.json");
    let text = fs::read_to_string(&summary).at(&summary)?;
    let mut summary: serde_json::Value = serde_json::from_str(&text).map_err(unread)?;
    Ok(summary["timing"].take())
}

fn unread(error: serde_json::Error) -> Error {
    Error::Bench(format!("skysink run: summary.json: {error}"))
}
