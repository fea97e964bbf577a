//! `skysink simulate` against missions that an independent implementation computed.

mod support;

use std::fs;
use std::path::Path;

use support::Place;

const FIXTURES: [&str; 4] = ["coincident-and-touching", "dense-paper", "link-limited", "sparse-trap"];

/// Flies a fixture and compares it slot by slot.
fn agrees(fixture: &str, strategy: &str, solver: &str, tolerance_m: f64) {
    let place = Place::new();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(fixture);
    let scenario =
        fs::read_to_string(folder.join("scenario.toml")).unwrap() + &format!("waypoint_solver = \"{solver}\"\n");
    fs::copy(folder.join("sensors.csv"), place.path("sensors.csv")).unwrap();
    place.write("scenario.toml", &scenario);
    place.run_well(&["simulate", "scenario.toml", "--strategy", strategy, "--out", "run"]);
    let (ours, theirs) =
        (place.read("run/slots.csv"), fs::read_to_string(folder.join(format!("expected_{strategy}.csv"))).unwrap());
    assert_eq!(ours.lines().count(), theirs.lines().count());
    for (ours, theirs) in ours.lines().zip(theirs.lines()).skip(1) {
        let (our, their): (Vec<_>, Vec<_>) = (ours.split(',').collect(), theirs.split(',').collect());
        assert_eq!((our[0], &our[4..8]), (their[0], &their[4..8]), "{fixture}/{strategy}/{solver}");
        for axis in 1..4 {
            let off_m = (our[axis].parse::<f64>().unwrap() - their[axis].parse::<f64>().unwrap()).abs();
            assert!(off_m <= tolerance_m, "{fixture}/{strategy}/{solver}: {ours} against {theirs}");
        }
    }
}

#[test]
fn uts_agrees_with_an_independent_implementation() {
    for fixture in FIXTURES {
        agrees(fixture, "uts", "geometric", 1e-6);
        agrees(fixture, "uts", "clarabel", 1e-3);
    }
}

#[test]
fn gfs_agrees_with_an_independent_implementation() {
    for fixture in FIXTURES {
        agrees(fixture, "gfs", "geometric", 1e-6);
    }
}

#[test]
fn a_resolved_scenario_flies_the_same_mission_again() {
    let place = Place::new();
    place.run_well(&["simulate", concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/smoke.toml"), "--out", "first"]);
    place.run_well(&["simulate", "first/scenario.toml", "--out", "second"]);
    for file in ["scenario.toml", "sensors.csv", "slots.csv"] {
        assert_eq!(place.read(&format!("first/{file}")), place.read(&format!("second/{file}")), "{file}");
    }
}
