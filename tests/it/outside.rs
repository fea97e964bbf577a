//! Planners that are not Skysink's: started by hand or by a command, supervised, named when they are missing, and
//! booked under their own name.

use std::fs::{self, File};
use std::os::unix::fs::PermissionsExt;
use std::process::{Child, Command};

use crate::support::{Ended, Place, end, lines, until};
use rustix::process::{Pid, Signal, kill_process};

const LONG: &str = "name = \"long\"\nslots = 6000\nslot_s = 0.1\n[uav]\nendurance_s = 1e6\n";
const SMOKE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/smoke.toml");

fn flown(place: &Place) -> usize {
    lines(&place.path("run/slots.csv")).saturating_sub(1)
}

/// `skysink` with these arguments; what it says goes to the file `said`.
fn begin(place: &Place, arguments: &[&str]) -> Child {
    let said = File::create(place.path("said")).unwrap();
    place.skysink(arguments).stderr(said).spawn().unwrap()
}

fn signal(child: &Child, signal: Signal) {
    kill_process(Pid::from_raw(i32::try_from(child.id()).unwrap()).unwrap(), signal).unwrap();
}

/// The planner of a run, started by hand.
fn by_hand(place: &Place) -> Command {
    let ring = until("ring", || place.rings().into_iter().find(|ring| place.ring_file(ring).exists()));
    let folder = place.ring_file(&ring).parent().unwrap().to_owned();
    let services = folder.join("services");
    until("services", || fs::read_dir(&services).is_ok_and(|entries| entries.count() >= 18).then_some(()));
    let arguments = ["--scenario", "run/scenario.toml", "--ring", folder.to_str().unwrap()];
    place.command(env!("CARGO_BIN_EXE_planner"), &arguments)
}

#[test]
fn a_command_is_started_as_the_planner_and_started_again_when_it_dies() {
    let place = Place::new();
    place.write("long.toml", LONG);
    place.run_well(&["simulate", "long.toml", "--out", "alone"]);
    let arguments =
        ["run", "long.toml", "--no-viewer", "--out", "run", "--planner", &place.outside_planner(), "--label", "mine"];
    let run = begin(&place, &arguments);
    let ring = until("ring", || place.rings().into_iter().find(|ring| place.ring_file(ring).exists()));
    until("flight", || (flown(&place) > 200).then_some(()));
    kill_process(place.worker("planner", &ring), Signal::KILL).unwrap();
    let ended = end(run);
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert!(ended.stdout.starts_with("long · mine · seed 1: 6000 slots"), "{ended:?}");
    assert_eq!(place.read("alone/slots.csv"), place.read("run/slots.csv"));
    let summary = place.summary("run");
    assert_eq!((&summary["strategy"], &summary["restarts"]), (&"mine".into(), &1.into()));
    place.assert_clean();
}

/// A command whose process is a shell that waits for the planner, beside another child that holds its output open.
fn forking_command(place: &Place) -> String {
    let path = place.write("fork.sh", &format!("#!/bin/sh\nsleep 1000 &\n{}\n:\n", place.outside_planner()));
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    path.display().to_string()
}

#[test]
fn what_a_command_has_started_ends_with_it() {
    let place = Place::new();
    place.write("long.toml", LONG);
    place.run_well(&["simulate", "long.toml", "--out", "alone"]);
    let command = forking_command(&place);
    let run = begin(&place, &["run", "long.toml", "--no-viewer", "--out", "run", "--planner", &command]);
    until("flight", || (flown(&place) > 100).then_some(()));
    let children = || fs::read_to_string(format!("/proc/{0}/task/{0}/children", run.id())).unwrap_or_default();
    let is_shell =
        |id: &str| fs::read_to_string(format!("/proc/{id}/cmdline")).is_ok_and(|line| line.contains("fork.sh"));
    let shell = until("shell", || children().split_ascii_whitespace().find(|id| is_shell(id)).map(str::to_owned));
    kill_process(Pid::from_raw(shell.parse().unwrap()).unwrap(), Signal::KILL).unwrap();
    assert_eq!(end(run).code, Some(0), "{}", place.read("said"));
    assert_eq!(place.read("alone/slots.csv"), place.read("run/slots.csv"));
    assert_eq!(place.summary("run")["restarts"], 1);
    place.assert_clean();
}

#[test]
fn a_command_that_has_started_others_ends_with_the_run() {
    let place = Place::new();
    place.write("long.toml", LONG);
    let command = forking_command(&place);
    let run = begin(&place, &["run", "long.toml", "--no-viewer", "--out", "run", "--planner", &command]);
    let ring = until("ring", || place.rings().into_iter().find(|ring| place.ring_file(ring).exists()));
    until("flight", || (flown(&place) > 100).then_some(()));
    let planner = place.worker("planner", &ring);
    signal(&run, Signal::TERM);
    assert_eq!(end(run).code, Some(143));
    until("its end", || (!fs::exists(format!("/proc/{}", planner.as_raw_nonzero())).unwrap()).then_some(()));
    place.assert_clean();
}

#[test]
fn a_command_that_ends_again_and_again_ends_the_run_soon() {
    let place = Place::new();
    let ended = place.run(&["run", SMOKE, "--no-viewer", "--out", "run", "--planner", "false"]);
    assert_eq!(ended.code, Some(1), "{ended:?}");
    let last = ended.stderr.lines().last().unwrap();
    assert!(last.contains("planner ended with exit code 1, 8 times in a row in slot 1"), "{ended:?}");
    place.assert_clean();
}

#[test]
fn what_contradicts_itself_is_refused_before_anything_is_written() {
    let place = Place::new();
    for (arguments, expected) in [
        (&["--planner", "no-such-command x"][..], "no-such-command"),
        (&["--planner", "'"], "--planner"),
        (&["--planner", "true", "--external", "planner"], "--external planner and --planner"),
        (&["--external", "viewer"], "--external viewer and --no-viewer"),
        (&["--label", "mine"], "--label"),
        (&["--planner", "true", "--label", "../mine"], "--label"),
    ] {
        let ended = place.run(&[&["run", SMOKE, "--no-viewer", "--out", "run"], arguments].concat());
        assert_eq!(ended.code, Some(2), "{ended:?}");
        assert!(ended.stderr.contains(expected), "{ended:?}");
        assert!(!place.path("run").exists());
    }
}

#[test]
fn a_planner_that_goes_is_named_at_once_and_may_come_back() {
    let place = Place::new();
    place.write("long.toml", LONG);
    place.run_well(&["simulate", "long.toml", "--out", "alone"]);
    let run = begin(&place, &["run", "long.toml", "--no-viewer", "--out", "run", "--external", "planner"]);
    let said = |what: &str| until(what, || place.read("said").contains(what).then_some(()));
    said("waiting up to 600 s for planner: /");
    let planner = by_hand(&place).spawn().unwrap();
    until("flight", || (flown(&place) > 100).then_some(()));
    said("planner has joined");
    signal(&planner, Signal::KILL);
    assert_eq!(end(planner).signal, Some(9));
    said("planner has gone: the run waits for it to be started again");
    assert_eq!(end(by_hand(&place).spawn().unwrap()).code, Some(0));
    assert_eq!(end(run).code, Some(0));
    assert_eq!(place.read("alone/slots.csv"), place.read("run/slots.csv"));
    let events = place.summary("run")["events"].as_array().unwrap().len();
    assert_eq!(events, 3, "joined, gone, joined: {}", place.read("said"));
    place.assert_clean();
}

#[test]
fn a_time_out_names_the_process_at_the_beginning_of_the_chain_and_no_other() {
    for (role, topic) in [("planner", "plan(1)"), ("flight-sim", "flight(0)"), ("field-sim", "queues(0)")] {
        let place = Place::new();
        let ended = place.run(&["run", SMOKE, "--no-viewer", "--external", role, "--timeout", "2", "--out", "run"]);
        assert_eq!(ended.code, Some(1), "{ended:?}");
        let lines: Vec<_> = ended.stderr.lines().collect();
        assert_eq!(lines.len(), 2, "{ended:?}");
        assert!(lines[0].starts_with(&format!("waiting up to 2 s for {role}: ")), "{ended:?}");
        assert!(lines[1].starts_with(&format!("skysink: {role} has not sent {topic} for 2 s")), "{ended:?}");
        place.assert_clean();
    }
}

#[test]
fn the_mission_of_an_outside_planner_is_booked_and_resumed_as_such() {
    let place = Place::new();
    place.write("long.toml", LONG);
    place.run_well(&["simulate", "long.toml", "--out", "alone"]);
    let command = place.outside_planner();
    let run = begin(&place, &["run", "long.toml", "--no-viewer", "--out", "run", "--planner", &command]);
    until("flight", || (flown(&place) > 100).then_some(()));
    signal(&run, Signal::TERM);
    assert_eq!(end(run).code, Some(143));
    let hint = format!("`skysink run --resume run --planner {command}` continues it");
    assert!(place.read("said").contains(&hint), "{}", place.read("said"));
    assert_eq!(place.summary("run")["strategy"], "external");

    let refused = |arguments: &[&str], expected: &str| {
        let ended: Ended = place.run(&[&["run", "--no-viewer", "--resume"], arguments].concat());
        assert_eq!(ended.code, Some(2), "{ended:?}");
        assert_eq!(ended.stderr.lines().count(), 1, "{ended:?}");
        assert!(ended.stderr.contains(expected), "{ended:?}");
    };
    refused(&["run"], "flown by an external planner, external: expected --external planner, or --planner");
    refused(&["run", "--planner", &command, "--label", "other"], "its planner is named external");
    let ended = place.run_well(&["run", "--no-viewer", "--resume", "run", "--planner", &command]);
    assert!(ended.stdout.starts_with("long · external · seed 1"), "{ended:?}");
    assert_eq!(place.read("alone/slots.csv"), place.read("run/slots.csv"));

    fs::write(place.path("alone/slots.csv"), place.read("alone/slots.csv").lines().next().unwrap()).unwrap();
    refused(&["alone", "--planner", &command], "flown by the scenario's strategy");
    place.assert_clean();
}
