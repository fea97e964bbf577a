//! The program: requests and answers.

use std::io::Write as _;
use std::process::{Command, Stdio};

use serde_json::{Value, json};

/// Sends the requests; returns the answers, and what it says if it refuses one.
fn ask(requests: &[Value]) -> Result<Vec<Value>, String> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_skysink-cetsp"));
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    let mut input = child.stdin.take().unwrap();
    requests.iter().for_each(|request| writeln!(input, "{request}").unwrap());
    drop(input);
    let ended = child.wait_with_output().unwrap();
    let [output, errors] = [ended.stdout, ended.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
    match ended.status.code() {
        Some(0) => Ok(output.lines().map(|line| serde_json::from_str(line).unwrap()).collect()),
        code => Err(format!("{code:?}: {errors}")),
    }
}

/// Four disks at the corners of a square of 50 m, with changed keys.
fn square(changes: Value) -> Value {
    let mut request = json!({
        "centres_m": [[0.0, 0.0], [50.0, 0.0], [50.0, 50.0], [0.0, 50.0]], "radius_m": 10.0, "start_m": null,
        "is_closed": true, "round": {"steps": 300}, "bound": {"steps": 300},
    });
    request.as_object_mut().unwrap().extend(changes.as_object().unwrap().clone());
    request
}

#[test]
fn each_request_is_answered_and_equal_ones_equally() {
    let from_start = json!({"start_m": [25.0, 25.0], "is_closed": false, "bound": null, "round": {"seconds": 0.05}});
    let answers = ask(&[square(json!({})), square(json!({"seed": 0})), square(from_start)]).unwrap();
    assert_eq!((answers.len(), &answers[0]), (3, &answers[1]));
    // On the diagonals: 4 (a − √2 r).
    let expected_m = 4.0 * (50.0 - 10.0 * 2f64.sqrt());
    for key in ["length_m", "bound_m"] {
        assert!((answers[0][key].as_f64().unwrap() / expected_m - 1.0).abs() < 1e-5, "{key}: {}", answers[0]);
    }
    assert_eq!(answers[0]["points_m"].as_array().unwrap().len(), 4);
    assert_eq!(answers[2]["points_m"][0], json!([25.0, 25.0]));
    assert_eq!(answers[2]["order"].as_array().unwrap().len(), 4);
    assert!(answers[2]["bound_m"].is_null(), "{}", answers[2]);
}

#[test]
fn other_seeds_search_otherwise() {
    let at = |index: u32| [f64::from(index * 37 % 101), f64::from(index * 53 % 97)];
    let centres: Vec<_> = (0..60).map(at).collect();
    let search = |seed| {
        square(json!({"centres_m": centres, "radius_m": 3.0, "round": {"steps": 50}, "bound": null, "seed": seed}))
    };
    let answers = ask(&[search(1), search(1), search(2)]).unwrap();
    assert_eq!(answers[0], answers[1]);
    assert_ne!(answers[0]["length_m"], answers[2]["length_m"]);
}

#[test]
fn invalid_requests_are_refused() {
    for (changes, says) in [
        (json!({"radius_m": -1.0}), "radius_m = -1: expected 0 to 1000000000"),
        (json!({"start_m": [1e10, 0.0]}), "position [10000000000, 0]: expected metres"),
        (json!({"round": {"seconds": -1.0}}), "seconds = -1: expected 0 to 1000000"),
        (json!({"radius": 1.0}), "unknown field `radius`"),
    ] {
        let refusal = ask(&[square(changes)]).unwrap_err();
        assert!(refusal.starts_with("Some(2): skysink-cetsp: ") && refusal.contains(says), "{refusal}");
    }
}
