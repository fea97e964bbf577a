//! `skysink replay`: a finished run replayed in the ring, and the plans of another planner for it.

use std::fs;
use std::time::Duration;

use crate::support::flight::{RunningFlight, executable};
use crate::support::{Place, csv_rows, output, scenarios, until};
use serde_json::Value;
use skysink_common::message::FlightReport;
use skysink_common::slot_record::UAV;
use skysink_flight_sim::Flight;
use skysink_mission::Mission;
use skysink_mission::drive::SlotSink;
use skysink_mission::folder::Earlier;
use skysink_mission::origin::RunMode;
use skysink_mission::record::RunFolder;
use skysink_mission::tally::Tally;
use skysink_planner::Planner;

fn outcome(place: &Place, folder: &str) -> Value {
    serde_json::from_str(&place.read(&format!("{folder}/replay.json"))).unwrap()
}

/// These columns of a table, line by line.
fn columns(text: &str, names: &[&str]) -> Vec<Vec<String>> {
    csv_rows(text).iter().map(|row| names.iter().map(|&name| row[name].clone()).collect()).collect()
}

/// The common columns of `plans.csv` and `slots.csv`.
const DECISION: [&str; 8] = ["slot", "uav", "x_m", "y_m", "z_m", "scheduled", "mode", "refused"];

#[test]
#[cfg(feature = "viewer")]
fn a_replay_makes_the_recording_of_the_run() {
    let place = Place::new();
    place.flight("smoke").out("dark").simulate();
    place.flight("smoke").out("lit").options(&["--record"]).simulate();
    let ended = place.run_ok(&["replay", "dark"]);
    assert!(ended.stdout.contains("the recorded decision in 60 of 60 slots"), "{ended:?}");
    for entity in ["/world/uav", "/world/links", "/world/candidates", "/world/queues", "/metrics/loss_rate"] {
        let [lit, replay] =
            ["lit", "dark-replay"].map(|run| crate::support::rows(&place.path(&format!("{run}/mission.rrd")), entity));
        assert_eq!(replay.keys().copied().collect::<Vec<_>>(), lit.keys().copied().collect::<Vec<_>>(), "{entity}");
        assert!(lit == replay, "{entity}");
    }
    place.assert_clean();
}

#[test]
fn the_planner_of_the_run_repeats_its_recorded_decisions() {
    let place = Place::new();
    place.flight("smoke").without_viewer().run();
    let before = place.read("run/summary.json");
    place.run_ok(&["replay", "run", "--no-viewer", "--out", "again"]);
    let outcome = outcome(&place, "again");
    for (key, value) in [("slots", 60), ("same", 60), ("undecided", 0)] {
        assert_eq!(outcome[key], value, "{key}: {outcome}");
    }
    assert_eq!((&outcome["first_difference"], &outcome["mean_distance_m"]), (&Value::Null, &0.0.into()));
    assert_eq!(outcome["trace_hash"], place.summary("run")["trace_hash"]);
    let [plans, slots] = ["again/plans.csv", "run/slots.csv"].map(|file| columns(&place.read(file), &DECISION));
    assert_eq!(plans, slots);
    assert_eq!(place.read("run/summary.json"), before, "the run stays as it is");
    place.assert_clean();
}

/// What a strategy would have done in each slot of a mission of another, by plain calls.
fn asked(flown: &'static str, asked: &'static str) -> Vec<Vec<String>> {
    let (scenario, list) = scenarios::smoke_with_sensors(flown);
    let mut mission = Mission::new(&scenario, &list).unwrap();
    let nodes = list.nodes();
    let mut planner = Planner::new(&scenarios::smoke(asked), &nodes).unwrap();
    let mut lines = Vec::new();
    for slot in 1..=scenario.slots {
        let mut flight = Flight::new(&scenario, &nodes);
        let before = mission.plant().flight(UAV);
        let queues_bits = mission.plant().field().queues_bits();
        flight.restore(before);
        planner.observe(slot - 1, before, queues_bits);
        let plan = planner.step(slot, before.position(), queues_bits);
        let FlightReport { x_m, y_m, z_m, .. } = flight.step(slot, Some(&plan));
        lines.push([slot.to_string(), UAV.to_string(), x_m.to_string(), y_m.to_string(), z_m.to_string()].to_vec());
        assert!(mission.next().is_some());
    }
    lines
}

#[test]
fn another_strategy_plans_in_each_recorded_state_without_flying() {
    let place = Place::new();
    place.flight("smoke").simulate();
    place.run_ok(&["replay", "run", "--no-viewer", "--strategy", "gfs"]);
    let outcome = outcome(&place, "run-replay");
    assert_eq!((&outcome["strategy"], &outcome["planner"]), (&"uts".into(), &"gfs".into()));
    assert_eq!(outcome["trace_hash"], place.summary("run")["trace_hash"], "the recorded flight goes on");
    let plans = place.read("run-replay/plans.csv");
    assert_eq!(columns(&plans, &DECISION[..5]), asked("uts", "gfs"));
    let same = columns(&plans, &["same"]).concat();
    let is_same = |flag: &&String| flag.as_str() == "true";
    assert_eq!(outcome["same"], same.iter().filter(is_same).count());
    assert_eq!(outcome["first_difference"], same.iter().position(|flag| flag == "false").unwrap() + 1);
    assert!(outcome["mean_distance_m"].as_f64().unwrap() > 1.0, "{outcome}");
    place.assert_clean();
}

#[test]
fn an_external_planner_is_evaluated_and_its_own_run_replayed_by_its_recorded_decisions() {
    let place = Place::new();
    let command = place.external_planner();
    place.flight("smoke").without_viewer().planner(&command).options(&["--label", "mine"]).run();
    place.run_ok(&["replay", "run", "--no-viewer", "--out", "recorded"]);
    let recorded = outcome(&place, "recorded");
    assert_eq!((&recorded["strategy"], &recorded["planner"]), (&"mine".into(), &"mine".into()));
    assert_eq!((&recorded["same"], &recorded["slots"]), (&60.into(), &60.into()));
    let arguments = ["replay", "run", "--no-viewer", "--out", "asked", "--planner", &command, "--label", "new"];
    place.run_ok(&arguments);
    let asked = outcome(&place, "asked");
    assert_eq!((&asked["planner"], &asked["same"]), (&"new".into(), &60.into()));
    place.assert_clean();
}

#[test]
fn late_slots_are_held_again_and_counted_as_undecided() {
    let place = Place::new();
    let (scenario, list) = scenarios::smoke_with_sensors("uts");
    let run_mode = RunMode { pace: Some("10x".parse().unwrap()), ..RunMode::default() };
    let folder = RunFolder::create(Some(&place.path("run")), Earlier::Kept, &scenario, &list, &run_mode).unwrap();
    let mut log = folder.slot_log().unwrap();
    let mut mission = Mission::new(&scenario, &list).unwrap();
    let mut tally = Tally::new(&scenario, &list, &run_mode);
    tally.start(&mission.header());
    for slot in 1..=scenario.slots {
        let plan = mission.plan();
        let record = mission.fly((slot % 7 != 3).then_some(&plan));
        log.add(record).unwrap();
        tally.add(record).unwrap();
    }
    folder.write_summary(&tally.summary(Duration::ZERO, log.hash())).unwrap();
    drop((folder, log));
    place.run_ok(&["replay", "run", "--no-viewer"]);
    let outcome = outcome(&place, "run-replay");
    assert_eq!((&outcome["undecided"], &outcome["same"]), (&9.into(), &51.into()), "{outcome}");
    assert_eq!(outcome["trace_hash"], place.summary("run")["trace_hash"]);
    place.assert_clean();
}

#[test]
fn a_replay_survives_kills_of_its_processes() {
    let place = Place::new();
    place.flight("long").simulate();
    let replay = place.skysink(&["replay", "run", "--no-viewer", "--pace", "300x"]);
    let replay = RunningFlight::start(&place, replay, "run-replay");
    let flights = replay.folder().join("flights.journal");
    let size = || fs::metadata(&flights).map_or(0, |file| file.len());
    until("flight", || (size() > 12_000).then_some(())); // three places of 4096 bytes
    ["flight-sim", "planner", "field-sim"].iter().for_each(|role| replay.kill(role));
    let ended = replay.wait_for_success();
    assert!(ended.stderr.contains("flight-sim was restarted"), "{ended:?}");
    let outcome = outcome(&place, "run-replay");
    assert_eq!((&outcome["same"], &outcome["trace_hash"]), (&3000.into(), &place.summary("run")["trace_hash"]));
    place.assert_clean();
}

#[test]
fn unfinished_runs_are_refused_without_files() {
    let place = Place::new();
    place.flight("smoke").simulate();
    let trace = place.trace("run");
    let cut: String = trace.split_inclusive('\n').take(31).collect();
    for (damaged, says) in [(trace.replacen("\n7,", "\n8,", 1), "line 8"), (cut, "30 slots")] {
        place.write("run/slots.csv", &damaged);
        let ended = place.run(&["replay", "run", "--no-viewer"]);
        ended.assert_code(2).assert_one_line(&["run/slots.csv", says]);
    }
    assert!(!place.path("run-replay").exists());
}

#[test]
fn a_replay_is_replaced_only_with_force() {
    let place = Place::new();
    place.flight("smoke").simulate();
    place.run_ok(&["replay", "run", "--no-viewer"]);
    place.run_refused(&["replay", "run", "--no-viewer", "--strategy", "gfs"], "run-replay: it exists");
    assert_eq!(outcome(&place, "run-replay")["planner"], "uts");
    place.run_ok(&["replay", "run", "--no-viewer", "--strategy", "gfs", "--force"]);
    assert_eq!(outcome(&place, "run-replay")["planner"], "gfs");
    place.run_refused(&["replay", "run", "--no-viewer", "--out", "run", "--force"], "it is inside the run folder");
    assert!(place.path("run/slots.csv").exists());
}

#[test]
fn a_killed_replay_does_not_block_the_next() {
    let place = Place::new();
    place.flight("smoke").simulate();
    fs::create_dir(place.path("run-replay")).unwrap();
    place.write("run-replay/lock", "");
    place.write("run-replay/.plans.csv.a1b2c3.new", "slot,x_m\n");
    let victim = place.write("victim", "mine");
    std::os::unix::fs::symlink(victim, place.path("run-replay/.plans.csv.new")).unwrap();
    place.run_ok(&["replay", "run", "--no-viewer", "--force"]);
    let mut left: Vec<_> =
        fs::read_dir(place.path("run-replay")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    left.sort();
    assert_eq!(left, ["lock", "plans.csv", "replay.json", "scenario.toml", "sensors.csv"]);
    assert_eq!(place.read("victim"), "mine");
}

#[test]
fn a_replay_is_kept_until_its_replacement_is_complete() {
    let place = Place::new();
    place.flight("smoke").simulate();
    place.run_ok(&["replay", "run", "--no-viewer"]);
    let files = || ["plans.csv", "replay.json", "scenario.toml"].map(|name| place.read(&format!("run-replay/{name}")));
    let before = files();
    let ended = place.run(&["replay", "run", "--no-viewer", "--force", "--planner", "false"]);
    assert_eq!(ended.code, Some(1), "{ended:?}");
    assert_eq!(files(), before);
    let left = fs::read_dir(place.path("run-replay")).unwrap().map(|entry| entry.unwrap().file_name());
    assert_eq!(left.filter(|name| name.as_encoded_bytes().starts_with(b".")).count(), 0);
    place.run_ok(&["replay", "run", "--no-viewer", "--force", "--strategy", "gfs"]);
    assert_ne!(files(), before);
}

#[test]
fn only_replay_folders_are_replaced_by_a_replay() {
    let place = Place::new();
    place.flight("smoke").simulate();
    fs::create_dir(place.path("own")).unwrap();
    place.write("own/scenario.toml", "# mine");
    for (arguments, message) in [
        (["--out", "own", "--force"], "it contains own/scenario.toml: expected a separate folder"),
        (["--out", "run/replay", "--force"], "it is inside the run folder, which must not change"),
    ] {
        place.run_refused(&[&["replay", "run", "--no-viewer"][..], &arguments].concat(), message);
    }
    assert_eq!(place.read("own/scenario.toml"), "# mine");
    let mut inside = place.skysink(&["replay", ".", "--no-viewer"]);
    output(inside.current_dir(place.path("run"))).assert_success();
    assert!(place.path("run-replay/replay.json").exists());
}

#[test]
fn a_folder_has_one_replay_at_a_time() {
    let place = Place::new();
    place.flight("smoke").simulate();
    place.run_ok(&["replay", "run", "--no-viewer"]);
    let lock = fs::File::open(place.path("run-replay/lock")).unwrap();
    lock.try_lock().unwrap();
    let ended = place.run(&["replay", "run", "--no-viewer", "--force"]);
    ended.assert_refused("run-replay: another replay is writing it");
    assert_eq!(outcome(&place, "run-replay")["planner"], "uts", "it stays as it was");
    drop(lock);
    place.run_ok(&["replay", "run", "--no-viewer", "--force"]);
}

#[test]
fn only_flight_sim_follows_the_pace_of_a_replay() {
    let place = Place::new();
    let help = |program: &str| output(place.command(program, &["--help"])).stdout;
    let [flight_sim, planner] = ["flight-sim", "planner"].map(|role| help(executable(role)));
    assert!(flight_sim.contains("--replay <RUN>") && flight_sim.contains("--pace <PACE>"), "{flight_sim}");
    assert!(planner.contains("--replay <RUN>") && !planner.contains("--pace"), "{planner}");
    let replay = place.run_ok(&["replay", "--help"]).stdout;
    assert!(replay.contains("Maximum speed of the slots") && !replay.contains("--resume"), "{replay}");
}
