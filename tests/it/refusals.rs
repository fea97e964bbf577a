//! Refusals of the command line: invalid scenarios, sensor lists and files, each in one line.

use crate::support::Place;
use crate::support::scenarios::SMOKE;

/// Simulates a scenario with this text, which must be refused with one line that holds all of `says`, and leave
/// nothing.
fn refused(scenario: &str, says: &[&str]) {
    let place = Place::new();
    place.write("bad.toml", scenario);
    for command in
        [&["check", "bad.toml"][..], &["simulate", "bad.toml", "--out", "run"], &["run", "bad.toml", "--out", "run"]]
    {
        let ended = place.run(command);
        assert_eq!(ended.code, Some(2), "{command:?}: {ended:?}");
        ended.assert_one_line(says);
    }
    assert!(!place.path("run").exists(), "half a run is left");
}

#[test]
fn a_missing_scenario_is_refused() {
    let place = Place::new();
    for command in [["check", "no.toml"], ["simulate", "no.toml"], ["run", "no.toml"]] {
        let ended = place.run(&command);
        ended.assert_code(2).assert_one_line(&["no.toml", "No such file"]);
    }
}

#[test]
fn an_unknown_key_is_refused() {
    refused("name = \"x\"\n[uav]\nspeed = 3.0\n", &["bad.toml", "uav.speed = 3.0", "expected one of", "max_speed_mps"]);
}

#[test]
fn a_value_of_another_type_is_refused() {
    refused("name = \"x\"\nslots = \"many\"\n", &["bad.toml", "slots = \"many\"", "expected a whole number"]);
}

#[test]
fn nan_is_refused() {
    refused(
        "name = \"x\"\n[uav]\naltitude_m = nan\n",
        &["bad.toml", "uav.altitude_m = nan", "expected a finite number"],
    );
}

#[test]
fn a_negative_value_is_refused() {
    refused("name = \"x\"\n[link]\nbandwidth_hz = -5e6\n", &["bad.toml", "link.bandwidth_hz = -5000000", "above 0"]);
    refused("name = \"x\"\n[sensors]\ncount = -1\n", &["bad.toml", "count = -1", "expected"]);
}

#[test]
fn a_field_without_sensor_nodes_is_refused() {
    refused("name = \"x\"\n[sensors]\ncount = 0\n", &["bad.toml", "sensors.count = 0", "expected 1 to"]);
}

#[test]
fn a_uav_without_resource_blocks_is_refused() {
    refused("name = \"x\"\n[link]\nresource_blocks = 0\n", &["bad.toml", "link.resource_blocks = 0", "1 to 64"]);
}

#[test]
fn a_flight_beyond_the_endurance_is_refused() {
    refused("name = \"x\"\nslots = 601\n", &["bad.toml", "uav.endurance_s = 600", "601 s"]);
}

#[test]
fn an_invalid_level_is_refused() {
    refused("name = \"x\"\n[link]\nnoise_dbm = 12\n", &["link.noise_dbm = 12", "expected a finite level below 0 dBm"]);
}

#[test]
fn count_and_file_together_are_refused() {
    refused("name = \"x\"\n[sensors]\ncount = 3\nfile = \"s.csv\"\n", &["sensors.count", "not both"]);
}

#[test]
fn learnt_rates_without_estimated_queues_are_refused() {
    let says = ["planner.rates = \"learnt\"", "expected \"known\", or planner.knowledge = \"estimated\""];
    refused("name = \"x\"\n[planner]\nrates = \"learnt\"\n", &says);
    refused("name = \"x\"\n[planner]\nknowledge = \"all\"\n", &["planner.knowledge = \"all\"", "oracle", "estimated"]);
}

#[test]
fn an_invalid_range_is_refused() {
    refused(
        "name = \"x\"\n[sensors]\nsampling_bps = [2.0, 1.0]\n",
        &["sensors.sampling_bps = [2.0, 1.0]", "lower first"],
    );
    refused(
        "name = \"x\"\n[sensors]\nsampling_bps = [1.0]\n",
        &["sensors.sampling_bps = [1.0]", "expected a number or [lowest, highest]"],
    );
}

#[test]
fn a_name_invalid_for_a_folder_is_refused() {
    refused("name = \"../x\"\n", &["name = \"../x\"", "folder"]);
}

/// Simulates a sensor list with this text, which must be refused with one line that holds all of `says`.
fn list_refused(list: &str, says: &[&str]) {
    let place = Place::new();
    place.write("listed.toml", "name = \"x\"\n[sensors]\nfile = \"sensors.csv\"\n");
    place.write("sensors.csv", list);
    let ended = place.run(&["simulate", "listed.toml", "--out", "run"]);
    ended.assert_code(2).assert_one_line(says);
    assert!(!place.path("run").exists());
}

#[test]
fn a_sensor_node_outside_the_area_is_refused() {
    list_refused("x_m,y_m\n1,2\n3,100.5\n", &["sensors.csv", "line 3", "y_m = 100.5", "0 to 100"]);
}

#[test]
fn a_bad_row_is_refused_by_its_line() {
    list_refused("x_m,y_m\n1,2\n3,four\n", &["sensors.csv", "line 3", "y_m = four"]);
    list_refused("x_m,y_m\n1,2\n3\n", &["sensors.csv", "line 3", "1 fields", "expected 2"]);
    list_refused("x_m,y_m,queue_bits\n1,2,30001\n", &["line 2", "queue_bits = 30001", "buffer"]);
    list_refused("x_m,y_m\nNaN,2\n", &["line 2", "x_m = NaN"]);
}

#[test]
fn a_list_with_another_header_or_without_rows_is_refused() {
    list_refused(
        "x_m,z_m\n1,2\n",
        &[
            "line 1",
            "z_m",
            "x_m,y_m,lat_deg,lon_deg,queue_bits,gain_db,sampling_bps,capacity_bits,weight,ground_m,name",
        ],
    );
    list_refused("x_m,queue_bits\n1,2\n", &["line 1", "expected x_m,y_m"]);
    list_refused("x_m,y_m\n", &["expected at least one sensor node"]);
}

#[test]
fn a_missing_list_is_refused() {
    refused("name = \"x\"\n[sensors]\nfile = \"none.csv\"\n", &["none.csv", "No such file"]);
}

#[test]
fn an_irregular_file_is_refused_at_once() {
    let place = Place::new();
    let pipe = place.path("pipe");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    for path in [pipe.to_str().unwrap(), "/dev/zero", "."] {
        let ended = place.run(&["check", path]);
        ended.assert_code(2).assert_one_line(&[path, "expected a regular file"]);
    }
    refused(
        "name = \"x\"\n[sensors]\nfile = \"/dev/zero\"\n",
        &["/dev/zero", "expected a regular file", "sensors.file"],
    );
}

#[test]
fn a_refused_value_is_shortened_and_its_control_characters_are_escaped() {
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
    place.write("sensors.csv", "x_m,y_m\n1,\x1b[31m\x07red\n");
    place.write("red.toml", "name = \"x\"\n[sensors]\nfile = \"sensors.csv\"\n");
    let ended = place.run(&["check", "red.toml"]);
    ended.assert_one_line(&["line 2: y_m = \\u001b[31m\\u0007red: expected a position"]);
}

#[test]
fn a_refusal_suggests_the_closest_name() {
    refused("name = \"x\"\nslotz = 3\n", &["slotz = 3", "did you mean `slots`?"]);
    refused("name = \"x\"\n[area]\nsid_m = 3\n", &["area.sid_m = 3", "did you mean `side_m`?"]);
    refused("name = \"x\"\n[link]\nmodel = \"freespace\"\n", &["link.model", "did you mean `free-space`?"]);
    refused("name = \"x\"\n[planner]\nstrategy = \"utz\"\n", &["planner.strategy = \"utz\"", "did you mean `uts`?"]);
    refused("name = \"x\"\n[uav]\nenergy_price = 3\n", &["uav.energy_price = 3: expected one of"]);
    let not_modelled = "it is not modelled, see \"Gusts\" in \"What Skysink does not model\" of the documentation";
    refused("name = \"x\"\n[uav]\ngusts = 3\n", &["uav.gusts = 3", not_modelled]);
    refused("name = \"x\"\ngusts_mps = 3\n", &["gusts_mps = 3", "see \"Gusts\" in"]);
    refused("scenario = \"a.toml\"\nstrategies = [\"uts\"]\n", &["it is a sweep", "skysink sweep"]);
    refused("name = \"x\"\n[[area]]\nside_m = 3\n", &["area = [{", "expected a table, [area]"]);
    refused("seed = 1\n", &["missing `name`"]);
    refused("name = \"x\"\nseed = 99999999999999999999\n", &["line 2", "below 2^63"]);
    refused("name = \"x\"\n[uav]\nstart_m = [1, 2, 3]\n", &["uav.start_m = [1, 2, 3]", "two numbers"]);
    let place = Place::new();
    let ended = place.run(&["check", concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/meuse/meuse.toml")]);
    ended.assert_one_line(&["sensors.csv", "sensors.file", "SOURCE.md says how to get it"]);
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
