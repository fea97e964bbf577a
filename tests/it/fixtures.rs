//! `skysink simulate` against missions that an independent implementation computed.

use std::collections::HashMap;
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

/// Fails unless a trace serves the same SNs and moves the same bits as another one, in the columns of that, and their
/// positions agree.
fn assert_same(what: &str, ours: &str, theirs: &str, tolerance_m: f64) {
    assert_eq!(ours.lines().count(), theirs.lines().count(), "{what}");
    let fields = |line| str::split(line, ',').collect::<Vec<_>>();
    let names = [ours, theirs].map(|text| fields(text.lines().next().unwrap()));
    for (ours, theirs) in ours.lines().zip(theirs.lines()).skip(1) {
        let our: HashMap<&str, &str> = names[0].iter().copied().zip(fields(ours)).collect();
        for (name, their) in names[1].iter().zip(fields(theirs)) {
            let is_same = if ["x_m", "y_m", "z_m"].contains(name) {
                let off_m = our[name].parse::<f64>().unwrap() - their.parse::<f64>().unwrap();
                off_m.abs() <= tolerance_m
            } else {
                our[name] == their
            };
            assert!(is_same, "{what}, {name}: {ours} against {theirs}");
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

/// A change here is value-breaking: published results of seeded missions would change.
#[test]
fn seeded_missions_are_stable() {
    for strategy in ["uts", "gfs", "rfs"] {
        let place = Place::new();
        place.flight("smoke").strategy(strategy).simulate();
        let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/golden/smoke-{strategy}.csv"));
        // Positions to 1e-9 m: the C library's functions may round differently on another machine.
        assert_same(strategy, &place.trace("run"), &fs::read_to_string(golden).unwrap(), 1e-9);
    }
}
