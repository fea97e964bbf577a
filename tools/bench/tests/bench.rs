//! That the benchmark measures what it says, not how fast it is.

use std::fs;
use std::process::Command;

use serde_json::Value;
use skysink_planner::strategies::stateless;

/// Maximum time of a benchmark [s].
const WATCHDOG_S: &str = "600";

/// Runs the benchmark; returns its exit code and output. Fails if it leaves a ring behind, or is too slow.
fn bench(arguments: &[&str]) -> (Option<i32>, String) {
    let folder = tempfile::Builder::new().prefix("sky").tempdir_in("/tmp").unwrap();
    let mut command = Command::new("timeout");
    command.args([WATCHDOG_S, env!("CARGO_BIN_EXE_skysink-bench")]).args(arguments);
    let ended = command.current_dir(&folder).env("TMPDIR", folder.path()).output().unwrap();
    let kinds = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path());
    let left: Vec<_> = kinds.flat_map(|path| fs::read_dir(path).unwrap()).collect();
    assert!(left.is_empty(), "left behind: {left:?}");
    assert!(ended.status.code() == Some(0) || !ended.stderr.is_empty(), "{ended:?}");
    (ended.status.code(), String::from_utf8(ended.stdout).unwrap())
}

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
    let (code, output) = bench(&["--quick", "--json"]);
    assert_eq!(code, Some(0));
    let report: Value = serde_json::from_str(&output).unwrap();
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
}

#[test]
fn a_single_part_is_measured_and_printed_as_a_table() {
    let (code, output) = bench(&["--quick", "--only", "field"]);
    assert!(code == Some(0) && output.contains("\nfield\n") && !output.contains("\nring\n"), "{output}");
    for heading in ["sensors", "step p50", "p999", "copy p50", "step over copy", "load average"] {
        assert!(output.contains(heading), "{heading}: {output}");
    }
    let (_, output) = bench(&["--quick", "--only", "field", "--json"]);
    let report: Value = serde_json::from_str(&output).unwrap();
    assert!(report["field"].is_array() && report["ring"].is_null(), "{report}");
}

#[test]
fn an_unknown_part_is_refused_and_the_help_fits_into_80_columns() {
    assert_eq!(bench(&["--only", "viewer"]).0, Some(2));
    for help in ["-h", "--help"] {
        let (code, output) = bench(&[help]);
        assert!(code == Some(0) && output.contains("Usage: skysink-bench "), "{output}");
        assert!(output.lines().all(|line| line.chars().count() <= 80), "{output}");
    }
}
