//! Refusals of the command line: invalid scenarios, sensor lists and files, each in one line.

use expect_test::expect_file;

use crate::support::Place;
use crate::support::scenarios::SMOKE;

#[test]
fn invalid_scenarios_are_refused() {
    Place::new().assert_refusals(&expect_file!["transcripts/scenarios.txt"], &["check", "simulate", "run"]);
}

#[test]
fn invalid_sensor_lists_and_files_are_refused() {
    let place = Place::new();
    place.write("listed.toml", "name = \"x\"\n[sensors]\nfile = \"sensors.csv\"\n");
    place.assert_transcript(&expect_file!["transcripts/sensor-lists.txt"]);
}

#[test]
fn a_missing_data_set_is_refused_with_its_source() {
    let ended = Place::new().run(&["check", concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/meuse/meuse.toml")]);
    ended.assert_one_line(&["sensors.csv", "sensors.file", "SOURCE.md says how to get it"]);
}

#[test]
fn a_refused_value_is_shortened() {
    let place = Place::new();
    let long = "x".repeat(100_000);
    for text in [
        format!("name = \"{long}\"\n"),
        format!("name = \"x\"\n[link]\nmodel = \"{long}\"\n"),
        format!("name = \"x\"\n{long} = 3\n"),
        format!("{long}\n"),
        format!("name = \"x\"\n[planner]\nstrategy = \"{long}\"\n"),
        format!("name = \"x\"\n[planner]\nknowledge = \"{long}\"\n"),
    ] {
        place.write("long.toml", &text);
        let said = place.run(&["check", "long.toml"]).assert_code(2).assert_one_line(&["expected"]).stderr;
        assert!(said.len() < 1_000, "{} bytes: {:?}", said.len(), &said[..200]);
    }
}

#[test]
fn messages_are_escaped_and_limited_in_length() {
    let place = Place::new();
    let folder = "run\u{1b}]0;title\u{7}\u{202e}";
    let is_shown = |character: char| character == '\n' || !character.is_control() && character != '\u{202e}';
    place.run_ok(&["simulate", SMOKE, "--out", folder]);
    for (arguments, escaped) in [
        (&["report", folder][..], "run\\u001b]0;title\\u0007\\u202e"),
        (&["report", folder, "--json"], "\"smoke\""),
        (&["report", "\u{1b}c"], "\\u001bc"),
        (&["compare", folder, "a\u{9b}1m"], "a\\u009b1m"),
        (&["check", SMOKE, "--seed", "\u{1b}[2J"], "\\u001b[2J"),
        (&["simulate", SMOKE, "--strategy", "\u{202e}uts"], "\\u202euts"),
        (&["check", SMOKE, "--set", "a\u{7}=1"], "a\\u0007"),
        (&["check", SMOKE, "--\u{7}"], "--\\u0007"),
        (&["\u{1b}[31m"], "\\u001b[31m"),
    ] {
        let ended = place.run(arguments);
        let said = ended.stdout.clone() + &ended.stderr;
        assert!(said.chars().all(is_shown) && said.contains(escaped), "{arguments:?}: {said:?}");
    }
    let long = "x".repeat(100_000);
    let long_set = format!("{long}=1");
    for arguments in [
        &["check", SMOKE, "--seed", &long][..],
        &["simulate", SMOKE, "--strategy", &long],
        &["check", SMOKE, "--set", &long_set],
        &["check", &long],
        &["run", &long],
        &[&long],
    ] {
        let ended = place.run(arguments);
        assert!(ended.code == Some(2) && ended.stderr.len() < 3000, "{:.500}", ended.stderr);
    }
}
