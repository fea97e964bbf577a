//! Paced runs: no process waits, late slots are counted, and every bit is accounted for.

use rustix::process::Signal;

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
