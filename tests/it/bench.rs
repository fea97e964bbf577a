//! `skysink bench`: that it measures what it says, not how fast it is.

use crate::support::Place;
use serde_json::Value;
use skysink_planner::strategies::stateless;

/// Fails unless the value holds a time or a ratio that was measured.
fn assert_measured(value: &Value, what: &str) {
    assert!(value.as_f64().is_some_and(|number| number > 0.0), "{what}: {value}");
}

fn assert_spread(value: &Value, what: &str) {
    for key in ["p50_us", "p99_us", "p999_us", "max_us"] {
        assert_measured(&value[key], &format!("{what}.{key}"));
    }
}

/// Fails unless every row of the part has these distributions and numbers.
fn assert_rows(rows: &Value, count: usize, spreads: &[&str], numbers: &[&str]) {
    let rows = rows.as_array().unwrap();
    assert_eq!(rows.len(), count);
    for row in rows {
        assert_measured(&row["sensors"], "sensors");
        spreads.iter().for_each(|key| assert_spread(&row[key], key));
        numbers.iter().for_each(|key| assert_measured(&row[key], key));
    }
}

#[test]
fn a_quick_benchmark_measures_everything() {
    let place = Place::new();
    let ended = place.run_ok(&["bench", "--quick", "--json"]);
    let report: Value = serde_json::from_str(&ended.stdout).unwrap();
    assert_measured(&report["machine"]["cores"], "cores");
    for key in ["cpu", "rustc", "build"] {
        assert!(report["machine"][key].is_string(), "{key}: {report}");
    }
    assert!(report["machine"]["load_average"].is_number());
    assert_rows(&report["planner"], 2 * stateless().len(), &["plan"], &[]);
    assert_rows(&report["field"], 2, &["step", "copy"], &["step_over_copy"]);
    for key in ["slots_per_s", "all_slots_per_s", "per_core"] {
        assert_measured(&report["mission"][key], key);
    }
    let ratios = ["slots_per_s", "p50_over_floor", "p99_over_p50"];
    assert_rows(&report["ring"], 2 * 3 * 2, &["slot", "plan", "hops"], &ratios);
    assert_rows(&report["fleet"], 4, &["plan", "slot"], &["uavs", "plan_over_one", "slot_over_one"]);
    place.assert_clean();
}

#[test]
fn a_single_part_is_measured_and_printed_as_a_table() {
    let place = Place::new();
    let ended = place.run_ok(&["bench", "--quick", "--only", "field"]);
    assert!(ended.stdout.contains("\nfield\n") && !ended.stdout.contains("\nring\n"), "{ended:?}");
    for heading in ["sensors", "step p50", "p999", "copy p50", "step over copy", "load average"] {
        assert!(ended.stdout.contains(heading), "{heading}: {ended:?}");
    }
    let ended = place.run_ok(&["bench", "--quick", "--only", "field", "--json"]);
    let report: Value = serde_json::from_str(&ended.stdout).unwrap();
    assert!(report["field"].is_array() && report["ring"].is_null(), "{report}");
    assert_eq!(place.run(&["bench", "--only", "viewer"]).code, Some(2));
}
