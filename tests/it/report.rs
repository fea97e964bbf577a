//! `skysink report`: the figures of a run, and of each sensor node.

use crate::support::{Place, csv_rows};
use serde_json::Value;

/// The column `name` of a table.
fn column<T: std::str::FromStr>(text: &str, name: &str) -> Vec<T> {
    csv_rows(text).iter().map(|row| row[name].parse().ok().expect(name)).collect()
}

#[test]
fn the_table_of_a_run_is_printed_again() {
    let place = Place::new();
    let flown = place.flight("small").simulate();
    let again = place.run_ok(&["report", "run"]);
    assert_eq!(again.stdout, flown.stdout);
    let json: Value = serde_json::from_str(&place.run_ok(&["report", "run", "--json"]).stdout).unwrap();
    assert_eq!(json, place.summary("run"));
    for command in ["simulate", "run"] {
        let out = format!("{command}-json");
        let ended = place.run_ok(&[command, "small.toml", "--out", &out, "--json"]);
        let json: Value = serde_json::from_str(&ended.stdout).unwrap();
        assert_eq!(json, place.summary(&out), "{ended:?}");
    }
}

#[test]
fn lost_and_delivered_bits_sum_to_the_totals() {
    let place = Place::new();
    place.flight("small").simulate();
    place.run_ok(&["report", "run", "--sensors"]);
    let sensors = place.read("run/sensors_out.csv");
    let summary = place.summary("run");
    for name in ["sampled_bits", "delivered_bits", "lost_bits", "queued_bits"] {
        assert_eq!(column::<u64>(&sensors, name).iter().sum::<u64>(), summary[name].as_u64().unwrap(), "{name}");
    }
    let trace = place.trace("run");
    let mut served = vec![Vec::new(); 60];
    for (line, slot) in trace.lines().skip(1).zip(1u64..) {
        let ids = line.split(',').nth(5).unwrap().split_ascii_whitespace();
        ids.for_each(|id| served[id.parse::<usize>().unwrap()].push(slot));
    }
    let counts: Vec<u64> = served.iter().map(|slots| slots.len() as u64).collect();
    assert_eq!(column::<u64>(&sensors, "served_slots"), counts);
    let ages = column::<f64>(&sensors, "mean_age_s");
    let gaps = column::<f64>(&sensors, "longest_gap_s");
    for (id, slots) in served.iter().enumerate() {
        let age = |slot: u64| slot - slots.iter().copied().filter(|served| *served <= slot).max().unwrap_or(0);
        let mean = (1..=250).map(age).sum::<u64>() as f64 / 250.0; // slots of 1 s
        assert!((ages[id] - mean).abs() < 1e-9, "sensor node {id}: {} s instead of {mean} s", ages[id]);
        let ends: Vec<u64> = [0].into_iter().chain(slots.iter().copied()).chain([250]).collect();
        let longest = ends.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap();
        assert_eq!(gaps[id], longest as f64, "sensor node {id}");
    }
}

#[test]
fn the_figures_of_a_modified_trace_are_not_printed() {
    let place = Place::new();
    place.flight("small").simulate();
    let trace = place.trace("run");
    let line = trace.lines().nth(100).unwrap();
    let queued = line.split(',').nth(8).unwrap();
    for (changed, says) in [
        (trace.replacen(line, &line.replace(queued, "1"), 1), "line 101: "),
        (trace.split_inclusive('\n').take(201).collect(), "200 slots of hash"),
        (trace.replacen(line, "100,x", 1), "line 101: `100,x`: expected a slot"),
    ] {
        place.write("run/slots.csv", &changed);
        for arguments in [&["report", "run"][..], &["report", "run", "--json"]] {
            let ended = place.run(arguments);
            assert_eq!((ended.code, ended.stdout.as_str()), (Some(2), ""), "{ended:?}");
            assert!(ended.stderr.contains("run/slots.csv: ") && ended.stderr.contains(says), "{says}: {ended:?}");
        }
    }
    place.write("run/slots.csv", &trace);
    place.run_ok(&["report", "run"]);
}

#[test]
fn missing_and_modified_runs_are_refused_without_files() {
    let place = Place::new();
    place.flight("small").simulate();
    let trace = place.trace("run");
    place.write("run/slots.csv", &trace.replacen("\n7,", "\n8,", 1));
    for (folder, says) in [("nowhere", "nowhere"), ("run", "run/slots.csv: line 8")] {
        place.run_refused(&["report", folder, "--sensors", "--json"], says);
    }
    assert!(!place.path("run/sensors_out.csv").exists());
    std::fs::remove_file(place.path("run/summary.json")).unwrap();
    place.run_refused(&["report", "run"], "summary.json");
}
