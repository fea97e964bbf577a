//! Paced runs: no process waits, late slots are counted, and every bit is accounted for.

use std::collections::BTreeMap;
use std::fs;
use std::thread::available_parallelism;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rustix::process::Signal;

use crate::anywhere::{Kill, fly_killed};
use crate::support::flight::RING;
use crate::support::{Place, assert_balanced};

#[test]
fn every_bit_is_accounted_for_after_kills_in_a_paced_run() {
    let place = Place::new();
    let run = place.flight("paced").without_viewer().pace("20x").start();
    for (kills, role) in (1..).zip(RING) {
        run.until_slot(35 * kills);
        run.kill(role);
    }
    run.wait_for_success();
    let summary = place.summary("run");
    assert_eq!((&summary["slots"], &summary["restarts"]), (&160.into(), &3.into()));
    assert_eq!(summary["timing"]["missed_deadlines"], summary["held_slots"]);
    let held = place.trace("run").lines().filter(|line| line.contains(",hold,")).count();
    assert_eq!(summary["held_slots"], held);
    assert_balanced(&summary);
    place.assert_clean();
}

#[test]
fn a_paced_run_reports_its_latencies() {
    let place = Place::new();
    let ended = place.flight("paced").without_viewer().pace("50x").run();
    let latency = &place.summary("run")["timing"]["latency"];
    for hop in ["queues_to_plan", "to_flight", "flight_to_queues", "slot", "jitter"] {
        let us = ["p50_us", "p99_us", "p999_us", "max_us"].map(|key| latency[hop][key].as_f64().unwrap());
        assert!(us[0] > 0.0 && us.is_sorted(), "{hop}: {us:?}");
    }
    for row in ["queues to plan", "slot start to next plan", "jitter of the slot start"] {
        assert!(ended.stdout.contains(row), "{row}: {ended:?}");
    }
}

#[test]
fn a_resumed_run_keeps_its_pace() {
    let place = Place::new();
    let run = place.flight("paced").without_viewer().pace("40x").start();
    run.until_slot(20);
    run.signal_launcher(Signal::INT);
    let ended = run.wait().assert_code(130);
    assert!(ended.stderr.contains("`skysink run --resume run` continues it"), "{ended:?}");
    place.resume("run");
    assert_eq!(place.summary("run")["timing"]["pace"], "40x");
}

/// Flies paced missions of one to three UAVs, with a battery or none, some with plans that are late, in which any
/// process is killed at any time, and which are resumed when that was the launcher. Each accounts for every bit, and
/// can be flown again slot by slot. Returns the slots that were held without a plan, and the kills.
fn fly_paced(missions: u64, seed: u64) -> (u64, u64) {
    let place = Place::new();
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut held = 0;
    let mut killed = BTreeMap::new();
    for mission in 0..missions {
        let uavs = random.random_range(1..=3);
        let battery =
            if random.random() { "base.charge_w=500 uav.must_land=true uav.battery.capacity_j=9000" } else { "" };
        let strategy = ["uts", "edf", "tour", "horizon"][random.random_range(0..4)];
        let iterations = [5, 20_000][random.random_range(0..2)]; // the second takes longer than a slot
        let pace = ["20x", "50x", "200x"][random.random_range(0..3)];
        let flight = place.flight("paced").strategy(strategy).seed(mission).pace(pace).settings(battery);
        let flight = flight.set("uav.count", uavs).set("planner.horizon.iterations", iterations).without_viewer();
        let kills = (0..random.random_range(0..6)).map(|_| Kill::draw(9000 * uavs, &mut random)).collect();
        let context = format!("mission {mission} of seed {seed}: {flight:?}, kills {kills:?}");
        println!("{context}"); // shown if the test fails
        fly_killed(&place, &flight, kills, &mut random, &mut killed);
        let summary = place.summary("run");
        assert_eq!(summary["slots"], 160, "{context}");
        let lines = place.trace("run").lines().filter(|line| line.contains(",hold,")).count();
        assert_eq!(summary["held_slots"], lines, "{context}");
        assert_balanced(&summary);
        place.run_ok(&["replay", "run", "--strategy", "edf", "--no-viewer", "--out", "again", "--force"]);
        let replayed: serde_json::Value = serde_json::from_str(&place.read("again/replay.json")).unwrap();
        assert_eq!(replayed["trace_hash"], summary["trace_hash"], "{context}");
        held += lines as u64;
        place.assert_clean();
        fs::remove_dir_all(place.path("run")).unwrap();
    }
    println!("{missions} missions, {held} slots without a plan, kills: {killed:?}");
    (held, killed.values().sum())
}

#[test]
fn paced_fleets_account_for_every_bit_under_kills_and_late_plans() {
    let (held, kills) = fly_paced(8, 1);
    assert!(held > 0 && kills >= 8, "{held} slots without a plan, {kills} kills");
}

#[test]
#[ignore = "takes an hour"]
fn a_thousand_paced_fleets_account_for_every_bit() {
    let threads = available_parallelism().unwrap().get() as u64;
    std::thread::scope(|scope| {
        (0..threads).for_each(|thread| drop(scope.spawn(move || fly_paced(1000 / threads, 100 + thread))));
    });
}
