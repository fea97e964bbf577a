//! Slots per second of the whole ring of processes, beside the floor: bare event hops between as many processes.
//!
//! The ring is `skysink run --pace max` over the letter's field (N = 200, gfs), timed by itself from the first slot to
//! the last. The floor passes a notification around three processes, as a slot does on its critical path (queues, plan,
//! flight), with no sample and no computation, waiting as the ring waits.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use iceoryx2::prelude::*;
use skysink_common::pace::Pace;
use skysink_common::ring_folder::RingFolder;

/// Processes on the critical path of a slot.
const HOPS: usize = 3;

/// Rounds of the floor, and slots of the ring.
const ROUNDS: u64 = 20_000;

/// Repetitions; the medians are compared.
const REPETITIONS: usize = 5;

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().collect();
    if let [_, flag, folder, place] = &arguments[..]
        && flag == "--hop"
    {
        return hop(Path::new(folder), place.parse()?).map(|_| ());
    }
    let (mut floor, mut bare, mut recorded) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..REPETITIONS {
        floor.push(floor_rounds_per_s()?);
        bare.push(ring_slots_per_s(&["--no-viewer"])?);
        if cfg!(feature = "viewer") {
            recorded.push(ring_slots_per_s(&[])?);
        }
    }
    let (floor, bare) = (median(floor), median(bare));
    println!("medians of {REPETITIONS} runs of {ROUNDS} slots, N = 200, gfs, pace max");
    println!("floor, {HOPS} bare event hops   {floor:8.0} rounds/s   {:6.1} µs", 1e6 / floor);
    println!(
        "ring, no viewer           {bare:8.0} slots/s    {:6.1} µs   {:.2} of the floor",
        1e6 / bare,
        bare / floor
    );
    if !recorded.is_empty() {
        let recorded = median(recorded);
        println!(
            "ring, recording           {recorded:8.0} slots/s    {:6.1} µs   {:.2} of no viewer",
            1e6 / recorded,
            recorded / bare
        );
    }
    Ok(())
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// One run of the whole ring.
fn ring_slots_per_s(options: &[&str]) -> Result<f64, Failure> {
    let place = tempfile::tempdir()?;
    let scenario = place.path().join("bench.toml");
    std::fs::write(&scenario, format!("name = \"bench\"\nslots = {ROUNDS}\n[uav]\nendurance_s = 1e6\n"))?;
    let out = place.path().join("run");
    let run = Command::new(env!("CARGO_BIN_EXE_skysink"))
        .args([Path::new("run"), &scenario, Path::new("--strategy"), Path::new("gfs"), Path::new("--out"), &out])
        .args(options)
        .stdout(Stdio::null())
        .status()?;
    if !run.success() {
        return Err(format!("skysink run: {run}").into());
    }
    let summary: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(out.join("summary.json"))?)?;
    summary["timing"]["slots_per_s"].as_f64().ok_or_else(|| "no timing".into())
}

/// One run of bare hops: this process is the first, the others are this program again.
fn floor_rounds_per_s() -> Result<f64, Failure> {
    let folder = RingFolder::create(Pace::Max, 30.0, false)?;
    let node = NodeBuilder::new().config(&folder.config()?).create::<ipc::Service>()?;
    let mut services = Vec::new();
    for place in 0..HOPS {
        services.push(node.service_builder(&name(place)?).event().create()?);
    }
    let mut others = Vec::new();
    for place in 1..HOPS {
        let program = std::env::current_exe()?;
        let place = place.to_string();
        others.push(Command::new(program).arg("--hop").arg(folder.path()).arg(place).stdin(Stdio::null()).spawn()?);
    }
    let elapsed = hop(folder.path(), 0)?;
    for mut other in others {
        other.wait()?;
    }
    Ok(ROUNDS as f64 / elapsed.as_secs_f64())
}

fn name(place: usize) -> Result<ServiceName, Failure> {
    Ok(format!("hop/{place}").as_str().try_into()?)
}

/// Waits for its own bell and rings the next, for all rounds. The first begins each round.
fn hop(folder: &Path, place: usize) -> Result<Duration, Failure> {
    let folder = RingFolder::open(folder)?;
    let node = NodeBuilder::new().config(&folder.config()?).create::<ipc::Service>()?;
    let own = node.service_builder(&name(place)?).event().open()?;
    let next = node.service_builder(&name((place + 1) % HOPS)?).event().open()?;
    let (listener, notifier) = (own.listener_builder().create()?, next.notifier_builder().create()?);
    let mut begin = Instant::now();
    for round in 0..=ROUNDS {
        if place == 0 {
            // Until somebody listens; in round 0 the others are still starting.
            while notifier.notify()? == 0 {
                std::thread::sleep(Duration::from_millis(1));
            }
        }
        while listener.timed_wait(|_| {}, Duration::from_millis(100))? == 0 {}
        if place != 0 {
            while notifier.notify()? == 0 {
                std::thread::sleep(Duration::from_millis(1));
            }
        }
        if round == 0 {
            begin = Instant::now();
        }
    }
    Ok(begin.elapsed())
}
