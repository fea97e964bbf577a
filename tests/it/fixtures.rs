//! `skysink simulate` against missions that an independent implementation computed.

use std::fs;
use std::path::Path;

use crate::support::Place;

const FIXTURES: [&str; 8] = [
    "coincident-and-touching",
    "dense-paper",
    "few-and-overflowing",
    "fractional-slot",
    "link-limited",
    "one-resource-block",
    "slower-than-its-radio",
    "sparse-trap",
];

/// Fails unless two traces serve the same SNs and move the same bits, in the columns that both have, and their
/// positions agree.
fn assert_same(what: &str, ours: &str, theirs: &str, tolerance_m: f64) {
    assert_eq!(ours.lines().count(), theirs.lines().count(), "{what}");
    for (ours, theirs) in ours.lines().zip(theirs.lines()).skip(1) {
        let [mut our, their] = [ours, theirs].map(|line| line.split(',').collect::<Vec<_>>());
        assert_eq!(our.remove(1), "0", "{what}: the only UAV");
        assert_eq!((our[0], &our[4..their.len()]), (their[0], &their[4..]), "{what}");
        for axis in 1..4 {
            let off_m = (our[axis].parse::<f64>().unwrap() - their[axis].parse::<f64>().unwrap()).abs();
            assert!(off_m <= tolerance_m, "{what}: {ours} against {theirs}");
        }
    }
}

/// Flies a fixture and compares it slot by slot.
fn agrees(fixture: &str, strategy: &str, solver: &str, tolerance_m: f64) {
    let place = Place::new();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/it/fixtures").join(fixture);
    let scenario = fs::read_to_string(folder.join("scenario.toml")).unwrap();
    fs::copy(folder.join("sensors.csv"), place.path("sensors.csv")).unwrap();
    place.write("scenario.toml", &(scenario + &format!("waypoint_solver = \"{solver}\"\n")));
    place.flight("scenario").strategy(strategy).simulate();
    let expected = fs::read_to_string(folder.join(format!("expected_{strategy}.csv"))).unwrap();
    assert_same(&format!("{fixture}/{strategy}/{solver}"), &place.trace("run"), &expected, tolerance_m);
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
    place.flight("smoke").out("first").simulate();
    place.flight("first/scenario").out("second").simulate();
    for file in ["scenario.toml", "sensors.csv", "slots.csv"] {
        assert_eq!(place.read(&format!("first/{file}")), place.read(&format!("second/{file}")), "{file}");
    }
}

/// A change here is value-breaking: published results of seeded missions would change.
#[test]
fn seeded_missions_stay_what_they_are() {
    for strategy in ["uts", "gfs", "rfs"] {
        let place = Place::new();
        place.flight("smoke").strategy(strategy).simulate();
        let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/golden/smoke-{strategy}.csv"));
        // Positions to 1e-9 m: the C library's functions may round differently on another machine.
        assert_same(strategy, &place.trace("run"), &fs::read_to_string(golden).unwrap(), 1e-9);
    }
}
