//! The command line: what it refuses, what it prints, what it leaves.

use crate::support;
use crate::support::{Ended, Place, end};

const SMOKE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/smoke.toml");

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
        assert_one_line(&ended, says);
    }
    assert!(!place.path("run").exists(), "half a run is left");
}

fn assert_one_line(ended: &Ended, says: &[&str]) {
    assert_eq!(ended.stderr.lines().count(), 1, "{ended:?}");
    for word in says {
        assert!(ended.stderr.contains(word), "{word:?} is missing in {:?}", ended.stderr);
    }
}

#[test]
fn a_missing_scenario_is_refused() {
    let place = Place::new();
    for command in [["check", "no.toml"], ["simulate", "no.toml"], ["run", "no.toml"]] {
        let ended = place.run(&command);
        assert_eq!(ended.code, Some(2), "{ended:?}");
        assert_one_line(&ended, &["no.toml", "No such file"]);
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
fn a_level_that_is_none_is_refused() {
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
fn a_range_that_is_none_is_refused() {
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
fn a_name_that_is_no_folder_is_refused() {
    refused("name = \"../x\"\n", &["name = \"../x\"", "folder"]);
}

/// Simulates a sensor list with this text, which must be refused with one line that holds all of `says`.
fn list_refused(list: &str, says: &[&str]) {
    let place = Place::new();
    place.write("listed.toml", "name = \"x\"\n[sensors]\nfile = \"sensors.csv\"\n");
    place.write("sensors.csv", list);
    let ended = place.run(&["simulate", "listed.toml", "--out", "run"]);
    assert_eq!(ended.code, Some(2), "{ended:?}");
    assert_one_line(&ended, says);
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
    list_refused("x_m,z_m\n1,2\n", &["line 1", "z_m", "x_m,y_m,lat_deg,lon_deg,queue_bits,gain_db,sampling_bps"]);
    list_refused("x_m,queue_bits\n1,2\n", &["line 1", "expected x_m,y_m"]);
    list_refused("x_m,y_m\n", &["expected at least one sensor node"]);
}

#[test]
fn a_missing_list_is_refused() {
    refused("name = \"x\"\n[sensors]\nfile = \"none.csv\"\n", &["none.csv", "No such file"]);
}

#[test]
fn an_output_folder_that_exists_is_refused_without_force() {
    let place = Place::new();
    place.run_well(&["simulate", SMOKE, "--out", "run"]);
    let before = place.read("run/slots.csv");
    place.write("run/notes.txt", "mine");
    for command in ["simulate", "run"] {
        let ended = place.run(&[command, SMOKE, "--out", "run", "--seed", "9"]);
        assert_eq!(ended.code, Some(2), "{ended:?}");
        assert_one_line(&ended, &["run", "exists", "--force"]);
    }
    assert_eq!(place.read("run/slots.csv"), before);
    place.run_well(&["simulate", SMOKE, "--out", "run", "--seed", "9", "--force"]);
    assert_ne!(place.read("run/slots.csv"), before);
    assert_eq!(place.read("run/notes.txt"), "mine", "what is not of a run stays");
}

#[test]
fn default_folders_are_numbered() {
    let place = Place::new();
    for folder in ["runs/smoke-uts-1", "runs/smoke-uts-1-2", "runs/smoke-uts-1-3"] {
        place.run_well(&["simulate", SMOKE]);
        assert!(place.path(folder).join("summary.json").is_file(), "{folder}");
    }
    place.run_well(&["simulate", SMOKE, "--strategy", "gfs", "--seed", "7"]);
    assert!(place.path("runs/smoke-gfs-7/slots.csv").is_file());
}

#[test]
fn check_prints_every_default_and_its_output_is_a_scenario() {
    let place = Place::new();
    place.write("short.toml", "name = \"short\"\n");
    let printed = place.run_well(&["check", "short.toml"]).stdout;
    for line in [
        "side_m = 100.0",
        "count = 200",
        "sampling_bps = 100.0",
        "start_m = [50.0, 50.0]",
        "noise_dbm = -100.0",
        "strategy = \"uts\"",
        "knowledge = \"oracle\"",
        "rates = \"known\"",
    ] {
        assert!(printed.contains(line), "{line} is missing in {printed}");
    }
    place.write("whole.toml", &printed);
    let again = place.run_well(&["check", "whole.toml"]).stdout;
    assert_eq!(again.replace("whole.toml", "short.toml"), printed);
}

#[test]
fn any_key_can_be_set_from_the_command_line() {
    let place = Place::new();
    place.write("a.toml", "name = \"a\"\nslots = 30\n");
    place.write("b.toml", "name = \"b\"\nslots = 40\n[link]\nbandwidth_hz = 5e3\n[planner]\nstrategy = \"gfs\"\n");
    let set = ["--set", "name=b", "--set", "slots = 40", "--set", "link.bandwidth_hz=5e3"];
    let strategy = ["--set", "planner.strategy=\"gfs\""];
    place.run_well(&[&["simulate", "a.toml", "--out", "set"], &set[..], &strategy].concat());
    place.run_well(&["simulate", "b.toml", "--out", "written"]);
    for file in ["scenario.toml", "slots.csv"] {
        assert_eq!(place.read(&format!("set/{file}")), place.read(&format!("written/{file}")), "{file}");
    }
}

#[test]
fn a_summary_holds_what_outside_programs_rely_on() {
    let place = Place::new();
    place.run_well(&["simulate", SMOKE, "--out", "run"]);
    let summary = place.summary("run");
    for key in [
        "strategy",
        "seed",
        "slots",
        "sensors",
        "loss_rate",
        "eta_letter",
        "sampled_bits",
        "delivered_bits",
        "lost_bits",
        "queued_bits",
        "initial_bits",
        "bits_per_waypoint",
        "mean_served",
        "held_slots",
        "refused",
        "complete",
        "version",
    ] {
        assert!(!summary[key].is_null(), "{key}");
    }
    let bits = |key: &str| summary[key].as_u64().unwrap();
    assert_eq!(
        bits("initial_bits") + bits("sampled_bits"),
        bits("delivered_bits") + bits("lost_bits") + bits("queued_bits")
    );
    assert_eq!(summary["complete"], true);
}

#[test]
fn every_slot_of_a_trace_balances() {
    let place = Place::new();
    for strategy in ["uts", "gfs", "rfs"] {
        place.run_well(&["simulate", SMOKE, "--out", strategy, "--strategy", strategy]);
        let (summary, trace) = (place.summary(strategy), place.read(&format!("{strategy}/slots.csv")));
        let mut queued_bits = summary["initial_bits"].as_u64().unwrap();
        let sampled_bits = summary["sampled_bits"].as_u64().unwrap() / summary["slots"].as_u64().unwrap();
        for line in trace.lines().skip(1) {
            let bits = |column: usize| line.split(',').nth(column).unwrap().parse::<u64>().unwrap();
            assert_eq!(queued_bits + sampled_bits, bits(5) + bits(6) + bits(7), "{strategy}: {line}");
            queued_bits = bits(7);
        }
    }
}

#[test]
fn wrong_usage_is_refused() {
    let place = Place::new();
    for arguments in [
        &["fly"][..],
        &["run", "--pace", "fast"],
        &["run", "--strategy", "best"],
        &["run", "--seed", "-1"],
        &["simulate"],
    ] {
        assert_eq!(place.run(arguments).code, Some(2), "{arguments:?}");
    }
}

#[test]
fn a_reader_of_the_first_line_ends_a_command_quietly() {
    let place = Place::new();
    place.write("short.toml", "name = \"short\"\n");
    let commands = [&["check", "short.toml"][..], &["simulate", SMOKE, "--out", "run"], &["--help"]];
    for arguments in commands {
        let mut child = place.skysink(arguments).spawn().unwrap();
        drop(child.stdout.take());
        let ended = end(child);
        assert_eq!((ended.code, ended.stderr.as_str()), (Some(0), ""), "{arguments:?}: {ended:?}");
    }
    assert_eq!(place.summary("run")["complete"], true);
}

#[test]
fn help_lists_the_strategies_of_the_registry() {
    let place = Place::new();
    let help = place.run_well(&["simulate", "--help"]).stdout;
    for strategy in &skysink_planner::strategies::STRATEGIES {
        assert!(help.contains(&format!("- {}:", strategy.name)), "{}: {help}", strategy.name);
    }
}

#[test]
fn completions_and_man_pages_name_every_command() {
    let place = Place::new();
    let help = place.run_well(&["--help"]).stdout;
    let listed = help.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    let commands: Vec<&str> = listed.filter_map(|line| line.strip_prefix("  ")?.split(' ').next()).collect();
    assert!(commands.contains(&"simulate") && commands.len() >= 6, "{commands:?}");
    for shell in ["bash", "zsh", "fish"] {
        let completions = place.run_well(&["completions", shell]).stdout;
        for command in &commands {
            assert!(completions.contains(command), "{shell}: {command}");
        }
        assert!(completions.contains("drift-plus-penalty"), "{shell}: strategies");
    }
    place.run_well(&["man", "pages"]);
    for command in commands.iter().filter(|command| **command != "help" && !command.is_empty()) {
        let page = place.read(&format!("pages/skysink-{command}.1"));
        assert!(page.contains(".SH OPTIONS"), "{command}");
    }
}

#[test]
fn help_shows_examples_and_no_colour_when_piped() {
    let place = Place::new();
    for arguments in [&["--help"][..], &["run", "--help"], &["simulate", "--help"]] {
        let help = place.run_well(arguments).stdout;
        assert!(help.contains("Examples:"), "{help}");
        assert!(!help.contains('\u{1b}'), "{help:?}");
    }
    let run = place.run_well(&["run", SMOKE, "--no-viewer"]);
    assert!(!run.stderr.contains('\u{1b}') && !run.stdout.contains('\u{1b}'), "{run:?}");
}

#[cfg(feature = "viewer")]
#[test]
fn a_simulation_can_be_recorded_and_equal_simulations_leave_equal_recordings() {
    let place = Place::new();
    for folder in ["one", "two"] {
        place.run_well(&["simulate", SMOKE, "--record", "--out", folder]);
    }
    let sizes = ["one", "two"].map(|folder| std::fs::metadata(place.path(folder).join("mission.rrd")).unwrap().len());
    assert!(sizes[0] > 10_000, "{sizes:?}");
}

#[test]
fn a_full_standard_output_is_said_and_a_closed_one_is_not() {
    let place = Place::new();
    for arguments in
        [&["check", SMOKE][..], &["--help"], &["run", "--help"], &["simulate", SMOKE, "--out", "run", "--force"]]
    {
        let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
        let ended = end(place.skysink(arguments).stdout(full).spawn().unwrap());
        assert_eq!(ended.code, Some(1), "{arguments:?}: {ended:?}");
        assert_one_line(&ended, &["standard output", "No space left"]);
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let ended = end(place.skysink(arguments).stdout(writer).spawn().unwrap());
        assert_eq!((ended.code, &ended.stderr[..]), (Some(0), ""), "{arguments:?}");
        let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
        let ended = end(place.skysink(&[arguments, &["no-such-file"]].concat()).stderr(full).spawn().unwrap());
        assert!(ended.code == Some(2) || ended.code == Some(0), "{arguments:?}: {ended:?}");
    }
}

#[test]
fn what_is_no_file_is_refused_at_once() {
    let place = Place::new();
    let pipe = place.path("pipe");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    for path in [pipe.to_str().unwrap(), "/dev/zero", "."] {
        let ended = place.run(&["check", path]);
        assert_eq!(ended.code, Some(2), "{ended:?}");
        assert_one_line(&ended, &[path, "expected a regular file"]);
    }
    refused(
        "name = \"x\"\n[sensors]\nfile = \"/dev/zero\"\n",
        &["/dev/zero", "expected a regular file", "sensors.file"],
    );
}

#[test]
fn a_second_signal_ends_a_command_at_once() {
    let place = Place::new();
    place.write("slow.toml", "name = \"slow\"\n[planner]\nstrategy = \"horizon\"\nhorizon.iterations = 1000000000\n[area]\nside_m = 1000.0\n");
    let child = place.skysink(&["simulate", "slow.toml", "--out", "run"]).spawn().unwrap();
    support::until("folder", || place.path("run/run.toml").exists().then_some(()));
    let pid = rustix::process::Pid::from_raw(i32::try_from(child.id()).unwrap()).unwrap();
    for _ in 0..2 {
        std::thread::sleep(std::time::Duration::from_millis(300)); // two signals, not one
        let _ = rustix::process::kill_process(pid, rustix::process::Signal::INT);
    }
    assert_eq!(end(child).code, Some(130));
}

#[test]
fn a_refused_value_is_cut_and_obeyed_by_no_terminal() {
    let place = Place::new();
    let long = "x".repeat(2_000_000);
    for text in [
        format!("name = \"{long}\"\n"),
        format!("name = \"x\"\n[link]\nmodel = \"{long}\"\n"),
        format!("name = \"x\"\n{long} = 3\n"),
        format!("{long}\n"),
        format!("name = \"x\"\n[planner]\nstrategy = \"{long}\"\n"),
        format!("name = \"x\"\n[planner]\nknowledge = \"{long}\"\n"),
    ] {
        place.write("long.toml", &text);
        let ended = place.run(&["check", "long.toml"]);
        assert_eq!(ended.code, Some(2), "{:?}", &ended.stderr[..200]);
        assert_one_line(&ended, &["expected"]);
        assert!(ended.stderr.len() < 1_000, "{} bytes: {:?}", ended.stderr.len(), &ended.stderr[..200]);
    }
    place.write("sensors.csv", "x_m,y_m\n1,\x1b[31m\x07red\n");
    place.write("red.toml", "name = \"x\"\n[sensors]\nfile = \"sensors.csv\"\n");
    let ended = place.run(&["check", "red.toml"]);
    assert_one_line(&ended, &["line 2: y_m = \\u{1b}[31m\\u{7}red: expected a position"]);
}

#[test]
fn a_refusal_says_what_was_probably_meant() {
    refused("name = \"x\"\nslotz = 3\n", &["slotz = 3", "did you mean `slots`?"]);
    refused("name = \"x\"\n[area]\nsid_m = 3\n", &["area.sid_m = 3", "did you mean `side_m`?"]);
    refused("name = \"x\"\n[link]\nmodel = \"freespace\"\n", &["link.model", "did you mean `free-space`?"]);
    refused("name = \"x\"\n[planner]\nstrategy = \"utz\"\n", &["planner.strategy = \"utz\"", "did you mean `uts`?"]);
    refused("scenario = \"a.toml\"\nstrategies = [\"uts\"]\n", &["it is a sweep", "skysink sweep"]);
    refused("name = \"x\"\n[[area]]\nside_m = 3\n", &["area = [{", "expected a table, [area]"]);
    refused("seed = 1\n", &["missing `name`"]);
    refused("name = \"x\"\nseed = 99999999999999999999\n", &["line 2", "below 2^63"]);
    refused("name = \"x\"\n[uav]\nstart_m = [1, 2, 3]\n", &["uav.start_m = [1, 2, 3]", "two numbers"]);
    let place = Place::new();
    let ended = place.run(&["check", concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/meuse/meuse.toml")]);
    assert_one_line(&ended, &["sensors.csv", "sensors.file", "SOURCE.md says how to get it"]);
}

#[test]
fn too_low_limits_are_named_before_the_start_and_a_quote_in_a_path_is_none() {
    let place = Place::new();
    let limited = format!("ulimit -n 64; exec {} run {SMOKE} --no-viewer --out run", env!("CARGO_BIN_EXE_skysink"));
    let ended = end(place.command("sh", &["-c", &limited]).spawn().unwrap());
    assert_eq!(ended.code, Some(1), "{ended:?}");
    assert_one_line(&ended, &["open files: at most 64: expected 256: raise ulimit -n"]);
    assert!(!place.path("run").exists());
    for name in ["a'b", "a\"b", "a\\b"] {
        let folder = place.path(name);
        std::fs::create_dir(&folder).unwrap();
        let ended = end(place
            .skysink(&["run", SMOKE, "--no-viewer", "--out", "run", "--force"])
            .env("TMPDIR", &folder)
            .spawn()
            .unwrap());
        assert_eq!(ended.code, Some(0), "{name}: {ended:?}");
    }
}

#[test]
fn a_simulation_that_is_interrupted_says_how_to_go_on() {
    let place = Place::new();
    place.write("long.toml", "name = \"long\"\nslots = 2000000\n[uav]\nendurance_s = 1e7\n");
    let child = place.skysink(&["simulate", "long.toml", "--out", "run"]).spawn().unwrap();
    support::until("flight", || (support::lines(&place.path("run/slots.csv")) > 100).then_some(()));
    let pid = rustix::process::Pid::from_raw(i32::try_from(child.id()).unwrap()).unwrap();
    for _ in 0..2 {
        let _ = rustix::process::kill_process(pid, rustix::process::Signal::INT); // two at once, as `timeout` sends them
    }
    let ended = end(child);
    assert_eq!(ended.code, Some(130), "{ended:?}");
    assert_one_line(&ended, &["stopped by signal 2", "recorded up to slot", "`skysink run --resume run` continues it"]);
}
