//! Flights whose plans are not flown as they were decided: every command says so, on standard error.

use std::collections::BTreeMap;

use serde_json::Value;

use crate::support::{Output, Place, csv_rows};

/// Ends of slots so far beside their waypoints that sensor nodes are out of range.
const ASTRAY: &str = "uav.position_error_m=3.0";

/// The line of a flight.
const LINE: &str = "a UAV holds without a plan in time, and where its waypoint is out of reach, outside the area or \
                    behind a zone; a sensor node out of range is not served (docs/src/metrics.md#refusals)\n";

/// The figures of the line about a flight, which must be there: slots held, slots, requests refused.
fn figures(ended: &Output) -> [u64; 3] {
    let line = ended.stderr.lines().find(|line| line.contains("slots held, ")).unwrap_or_else(|| panic!("{ended:?}"));
    assert!(line.starts_with("skysink: warning: ") && ended.stderr.contains(LINE), "{ended:?}");
    let words: Vec<&str> = line.split([' ', ':']).filter(|word| !word.is_empty()).collect();
    let number = |at: usize| words[at].parse().unwrap_or_else(|_| panic!("{line}"));
    let held = words.iter().position(|&word| word == "held,").unwrap() - 4;
    [number(held), number(held + 2), number(held + 5)]
}

fn assert_silent(ended: &Output) {
    assert!(!ended.stderr.contains("slots held"), "{ended:?}");
}

/// A place with the smoke scenario.
fn place() -> Place {
    let place = Place::new();
    place.scenario("smoke");
    place
}

#[test]
fn simulate_and_report_name_the_counts_of_the_summary() {
    let place = place();
    let options = ["simulate", "smoke.toml", "--strategy", "gfs", "--set", ASTRAY, "--out", "run"];
    let simulated = figures(&place.run_ok(&options));
    let summary = place.summary("run");
    let of = |key: &str| summary[key].as_u64().unwrap();
    assert_eq!(simulated, [of("held_slots"), 60, of("refused")]);
    assert!(simulated[2] > 5, "{simulated:?}");
    assert_eq!(figures(&place.run_ok(&["report", "run"])), simulated);
    let with_json = place.run_ok(&["report", "run", "--json"]);
    assert_eq!(figures(&with_json), simulated);
    assert!(serde_json::from_str::<Value>(&with_json.stdout).is_ok());
}

#[test]
fn a_flight_that_is_flown_as_planned_has_no_line() {
    let place = place();
    for strategy in ["gfs", "uts", "horizon"] {
        assert_silent(&place.run_ok(&["simulate", "smoke.toml", "--strategy", strategy, "--out", strategy]));
    }
    assert_silent(&place.run_ok(&["compare", "smoke.toml", "gfs", "uts", "--seeds", "3", "--no-record"]));
    assert_silent(&place.run_ok(&["optimize", "smoke.toml", "--steps", "1000", "--out", "best"]));
}

#[test]
fn a_run_in_the_ring_has_the_line_of_its_simulation() {
    let place = place();
    let flight = place.flight("smoke").strategy("gfs").settings(ASTRAY).without_viewer();
    let run = figures(&flight.out("ring").run());
    assert_eq!(run, figures(&flight.out("alone").simulate()));
}

#[test]
fn compare_names_the_strategies() {
    let place = place();
    let options = ["compare", "smoke.toml", "gfs", "uts", "--seeds", "3", "--no-record", "--set", ASTRAY, "--out", "c"];
    let compared = place.run_ok(&options);
    figures(&compared);
    for strategy in ["gfs", "uts"] {
        assert!(compared.stderr.contains(&format!("{strategy}: 0 of 60 slots held, ")), "{compared:?}");
    }
    assert!(compared.stderr.contains("the worst of 3 such flights of 3"), "{compared:?}");
    let standings: Value = serde_json::from_str(&place.read("c/comparison.json")).unwrap();
    let has = |metric: &str| standings.as_array().unwrap().iter().any(|standing| standing["metric"] == metric);
    assert!(has("held_slots") && has("refused"));
}

#[test]
fn compared_runs_are_named() {
    let place = place();
    for (set, run) in [(ASTRAY, "astray"), ("seed=1", "good")] {
        place.run_ok(&["simulate", "smoke.toml", "--strategy", "gfs", "--set", set, "--out", run]);
    }
    let compared = place.run_ok(&["compare", "good", "astray", "--no-record", "--out", "c"]);
    assert!(compared.stderr.contains("warning: astray: 0 of 60 slots held, "), "{compared:?}");
}

#[test]
fn sweep_and_merge_name_the_points_and_write_the_metrics() {
    let place = place();
    let text =
        "scenario = 'smoke.toml'\nstrategies = ['gfs']\nseeds = 2\n[axes]\n'uav.position_error_m' = [0.0, 3.0]\n";
    place.write("sweep.toml", text);
    let swept = place.run_ok(&["sweep", "sweep.toml", "--out", "flown"]);
    assert!(swept.stderr.contains("warning: gfs at uav.position_error_m = 3: 0 of 60 slots held, "), "{swept:?}");
    assert!(!swept.stderr.contains("position_error_m = 0"), "{swept:?}");
    let rows = csv_rows(&place.read("flown/results.csv"));
    let cell = |row: &BTreeMap<String, String>, key: &str| row[key].parse::<u64>().unwrap();
    assert!(rows.iter().all(|row| cell(row, "held_slots") == 0));
    let refused: Vec<u64> = rows.iter().map(|row| cell(row, "refused")).collect();
    assert!(refused[..2] == [0, 0] && refused[2..].iter().all(|&refused| refused > 0), "{refused:?}");
    let shards = ["1/2", "2/2"].map(|shard| {
        let out = format!("shard-{}", &shard[..1]);
        place.run_ok(&["sweep", "sweep.toml", "--out", &out, "--shard", shard]);
        out
    });
    let merged = place.run_ok(&["merge", &shards[0], &shards[1], "--out", "merged"]);
    let line = |ended: &Output| ended.stderr.lines().find(|line| line.contains("slots held")).map(str::to_owned);
    assert_eq!(line(&merged), line(&swept));
    assert_eq!(place.read("merged/results.csv"), place.read("flown/results.csv"));
    let plot = ["plot", "flown", "--x", "uav.position_error_m", "--y", "refused"];
    assert!(place.run_ok(&plot).stdout.contains("requests refused"));
}

#[test]
fn optimize_names_every_strategy_that_it_flies() {
    let place = place();
    let found = place.run_ok(&["optimize", "smoke.toml", "--steps", "1000", "--set", ASTRAY, "--out", "best"]);
    figures(&found);
    assert!(found.stderr.contains(" more: a UAV holds"), "{found:?}");
}
