//! Unfinished runs are resumed with the same bytes, or refused.

use std::fs;

use crate::longer;
use crate::support::flight::RING;
use crate::support::{Place, until_exited};

#[test]
fn a_run_whose_launcher_was_killed_is_resumed_with_the_same_bytes() {
    let place = Place::new();
    let run = longer(&place).without_viewer().start();
    let workers = RING.map(|role| run.worker(role));
    run.until_slot(300);
    run.kill_launcher();
    workers.into_iter().for_each(until_exited);
    // The slot of a truncated line is flown again.
    let trace = place.trace("run");
    place.write("run/slots.csv", &trace[..trace.len() - 7]);
    let before = trace.lines().count() as u64 - 2;
    place.resume("run");
    place.assert_trace_as_simulated("run");
    let [simulated, mut resumed] = ["run-simulated", "run"].map(|run| place.reproducible_summary(run));
    assert_eq!(resumed["resumed_after"].take(), before);
    assert_eq!(simulated, resumed);
    // A complete run does not change.
    let summary = place.read("run/summary.json");
    let again = place.resume("run");
    assert!(again.stderr.is_empty(), "{again:?}");
    assert_eq!(place.read("run/summary.json"), summary);
    place.assert_same_trace("run-simulated", "run");
    place.assert_clean();
}

#[test]
fn a_run_may_be_resumed_from_any_slot_again_and_again() {
    let place = Place::new();
    for slots in [0, 1, 2, 30, 59] {
        let run = format!("cut-after-{slots}");
        place.flight("smoke").out(&run).simulate();
        place.cut_trace(&run, slots);
        fs::remove_file(place.path(&run).join("summary.json")).unwrap();
        let viewer: &[&str] = if cfg!(feature = "viewer") && slots == 30 { &[] } else { &["--no-viewer"] };
        place.run_ok(&[&["run", "--resume", &run][..], viewer].concat());
        place.assert_trace_as_simulated(&run);
    }
    place.assert_clean();
}

#[test]
fn runs_that_cannot_be_resumed_are_refused() {
    let place = Place::new();
    longer(&place).strategy("gfs").simulate();
    let trace = place.trace("run");
    let refused = |parts: &[&str]| {
        place.run(&["run", "--resume", "run", "--no-viewer"]).assert_code(2).assert_one_line(parts);
    };
    let damage = |from: &str, to: &str| {
        assert!(trace.contains(from), "{from}");
        place.write("run/slots.csv", &trace.replacen(from, to, 1));
    };
    damage("\n3,", "\n4,");
    refused(&["slots.csv: line 4: `4,", "`: slot 4: expected slot 3 of 9000"]);
    damage(",serve,0\n", ",serve,zero\n");
    refused(&["slots.csv: line 3: `2,", ",serve...`: expected a slot as skysink run writes it"]);
    let third = trace.lines().nth(2).unwrap();
    let mut columns: Vec<_> = third.split(',').collect();
    columns[8] = "1"; // bits queued
    damage(third, &columns.join(","));
    refused(&["slots.csv: line 3: `2,", "`: it differs from the simulation of the scenario"]);
    damage("slot,uav,x_m", "slot,x_m");
    refused(&[
        "slots.csv: line 1: `slot,x_m,",
        "`: expected slot,uav,x_m",
        "flown again by skysink simulate RUN/scenario.toml",
    ]);
    place.write("run/slots.csv", &trace);
    fs::remove_file(place.path("run/slots.csv")).unwrap();
    refused(&["slots.csv is missing"]);
    assert_eq!(place.run(&["run", "--resume", "nowhere"]).code, Some(2));
    place.assert_clean();
}

#[test]
fn a_running_run_is_not_resumed_or_replaced() {
    let place = Place::new();
    let run = longer(&place).without_viewer().pace("4x").start();
    run.until_slot(5);
    for arguments in [&["run", "--resume", "run"][..], &["run", "long.toml", "--out", "run", "--force"]] {
        let ended = place.run(&[arguments, &["--no-viewer"]].concat()).assert_code(2);
        assert!(ended.stderr.contains("slots.csv: a run is writing it"), "{ended:?}");
    }
    run.terminate();
}
