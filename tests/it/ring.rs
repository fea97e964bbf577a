//! The ring as processes: the same trace as in one process, and an end in order whatever happens.

use crate::support;
use std::fs;
use std::process::{Child, Command};

use crate::support::{Place, assert_no_shared_memory, end, lines, until};
use rustix::process::{Pid, Signal, kill_process};

const SMOKE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/smoke.toml");

/// A scenario whose run lasts long enough to be disturbed.
const LONG: &str = "name = \"long\"\nslots = 5000\nslot_s = 0.1\n";

/// What a planner that does not see the queues adds to a scenario.
const BELIEVES: &str = "\n[planner]\nhorizon.iterations = 200\nknowledge = \"estimated\"\nrates = \"learnt\"\n";

/// Starts `skysink run` in the place, and waits until it has flown some slots. Returns its ring's name, too.
fn under_way(place: &Place, arguments: &[&str]) -> (Child, String) {
    place.write("long.toml", LONG);
    let mut all = vec!["run", "long.toml", "--out", "run"];
    all.extend(arguments);
    if !cfg!(feature = "viewer") && !arguments.contains(&"--no-viewer") {
        all.push("--no-viewer");
    }
    let child = place.skysink(&all).spawn().unwrap();
    until("slot", || (lines(&place.path("run/slots.csv")) > 20).then_some(()));
    let ring = place.rings().into_iter().next().expect("a ring under way");
    (child, ring)
}

fn pid(child: &Child) -> Pid {
    Pid::from_raw(i32::try_from(child.id()).unwrap()).unwrap()
}

/// Fails unless the trace in `run` holds whole lines of the slots 1, 2, 3, ...; returns how many.
fn assert_whole(place: &Place) -> usize {
    let trace = place.read("run/slots.csv");
    assert!(trace.ends_with('\n'), "a line is cut");
    for (slot, line) in trace.lines().enumerate().skip(1) {
        assert_eq!(line.split(',').next().unwrap(), slot.to_string());
        assert_eq!(line.split(',').count(), 10);
    }
    trace.lines().count() - 1
}

#[test]
fn processes_and_one_process_leave_the_same_trace() {
    let place = Place::new();
    for strategy in ["uts", "gfs", "rfs"] {
        for seed in ["1", "2", "3"] {
            let choice = ["--strategy", strategy, "--seed", seed, "--force", "--out"];
            place.run_well(&[&["simulate", SMOKE][..], &choice, &["alone"]].concat());
            let viewers: &[&[&str]] =
                if cfg!(feature = "viewer") { &[&[], &["--no-viewer"]] } else { &[&["--no-viewer"]] };
            for viewer in viewers {
                place.run_well(&[&["run", SMOKE][..], &choice, &["ring"], viewer].concat());
                for file in ["slots.csv", "scenario.toml", "sensors.csv"] {
                    let [alone, ring] = ["alone", "ring"].map(|run| place.read(&format!("{run}/{file}")));
                    assert_eq!(alone, ring, "{strategy}, seed {seed}, {viewer:?}: {file}");
                }
                let [mut alone, mut ring] = ["alone", "ring"].map(|run| place.summary(run));
                alone["timing"] = serde_json::Value::Null;
                ring["timing"] = serde_json::Value::Null;
                assert_eq!(alone, ring);
            }
        }
    }
    place.assert_clean();
}

#[test]
fn processes_and_one_process_fly_the_same_in_three_dimensions() {
    let place = Place::new();
    let scenario = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/plos-high-rise.toml")).unwrap();
    place.write("plos.toml", &scenario.replace("slots = 300", "slots = 40"));
    for strategy in ["uts", "gfs", "rfs", "uts-wide", "exact"] {
        let choice = ["--strategy", strategy, "--force", "--out"];
        place.run_well(&[&["simulate", "plos.toml"][..], &choice, &["alone"]].concat());
        place.run_well(&[&["run", "plos.toml", "--no-viewer"][..], &choice, &["ring"]].concat());
        let [alone, ring] = ["alone", "ring"].map(|run| place.read(&format!("{run}/slots.csv")));
        assert_eq!(alone, ring, "{strategy}");
        let altitudes: std::collections::BTreeSet<_> =
            alone.lines().skip(1).filter_map(|line| line.split(',').nth(3)).collect();
        assert!(altitudes.len() > 1, "{strategy} does not use its altitude: {altitudes:?}");
    }
}

#[test]
fn processes_and_one_process_believe_the_same() {
    let place = Place::new();
    let smoke = fs::read_to_string(SMOKE).unwrap().replace("[sensors]", "[sensors]\nsampling_bps = [50.0, 800.0]");
    place.write("known.toml", &smoke);
    place.write("believed.toml", &(smoke + BELIEVES));
    for strategy in ["uts", "horizon"] {
        let choice = ["--strategy", strategy, "--force", "--out"];
        place.run_well(&[&["simulate", "known.toml"][..], &choice, &["known"]].concat());
        place.run_well(&[&["simulate", "believed.toml"][..], &choice, &["alone"]].concat());
        place.run_well(&[&["run", "believed.toml", "--no-viewer"][..], &choice, &["ring"]].concat());
        assert_eq!(place.read("alone/slots.csv"), place.read("ring/slots.csv"), "{strategy}");
        assert_ne!(place.read("alone/slots.csv"), place.read("known/slots.csv"), "{strategy} sees the queues");
    }
    place.assert_clean();
}

#[test]
fn processes_that_poll_leave_the_same_trace() {
    let place = Place::new();
    place.run_well(&["simulate", SMOKE, "--out", "alone"]);
    for wait in ["adaptive", "event", "poll"] {
        place.run_well(&["run", SMOKE, "--no-viewer", "--wait", wait, "--out", wait]);
        assert_eq!(place.read("alone/slots.csv"), place.read(&format!("{wait}/slots.csv")), "{wait}");
    }
    let ended = place.run(&["run", SMOKE, "--no-viewer", "--wait", "spin"]);
    assert_eq!(ended.code, Some(2), "{ended:?}");
    assert!(
        ended.stderr.contains("invalid value 'spin' for '--wait") && ended.stderr.contains("adaptive, event, poll"),
        "{ended:?}"
    );
    place.assert_clean();
}

#[test]
fn the_letters_mission_is_built_in() {
    let place = Place::new();
    place.run_well(&["run", "--no-viewer", "--out", "built-in"]);
    place.run_well(&["simulate", concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/letter.toml"), "--out", "file"]);
    assert_eq!(place.read("built-in/slots.csv"), place.read("file/slots.csv"));
    assert_eq!(place.read("built-in/slots.csv").lines().count(), 601);
}

#[test]
fn killing_a_worker_that_is_not_to_be_started_again_ends_the_run_with_its_name() {
    for role in ["field-sim", "flight-sim", "planner", "viewer"] {
        if role == "viewer" && !cfg!(feature = "viewer") {
            continue;
        }
        let place = Place::new();
        let (run, ring) = under_way(&place, &["--pace", "20x", "--restart", "never"]);
        if role == "viewer" {
            until("recording", || (lines(&place.path("run/slots.csv")) > 500).then_some(())); // 2.5 s
        }
        kill_process(place.worker(role, &ring), Signal::KILL).unwrap();
        let killed = std::time::Instant::now();
        let ended = end(run);
        assert_eq!(ended.code, Some(1), "{role}: {ended:?}");
        assert!(ended.stderr.contains(&format!("{role} ended with signal 9")), "{role}: {ended:?}");
        assert!(killed.elapsed().as_secs() < 5, "{role}: {:?}", killed.elapsed());
        let slots = assert_whole(&place);
        let summary = place.summary("run");
        assert_eq!((&summary["complete"], &summary["slots"]), (&false.into(), &slots.into()), "{role}");
        if cfg!(feature = "viewer") {
            let recorded = support::slots(&place.path("run/mission.rrd"), "/metrics/loss_rate");
            if role == "viewer" {
                assert!(recorded.len() > 100, "all but the last second: {recorded:?}");
                assert_eq!(recorded, (0..recorded.len() as i64).collect());
            } else {
                // The ring may have turned once more before it was stopped.
                assert!(recorded.is_superset(&(0..=slots as i64).collect()), "{role}: {slots} flown, {recorded:?}");
            }
        }
        place.assert_clean();
        assert_no_shared_memory(&ring);
    }
}

#[test]
fn a_worker_killed_at_full_speed_ends_the_run_too() {
    for role in ["field-sim", "flight-sim", "planner"] {
        let place = Place::new();
        place.write("endless.toml", "name = \"endless\"\nslots = 100000000\nslot_s = 1e-6\n[link]\ncomm_s = 1e-6\n");
        let run = place
            .skysink(&["run", "endless.toml", "--out", "run", "--no-viewer", "--restart", "never"])
            .spawn()
            .unwrap();
        until("slot", || (lines(&place.path("run/slots.csv")) > 20).then_some(()));
        let ring = place.rings().remove(0);
        kill_process(place.worker(role, &ring), Signal::KILL).unwrap();
        let ended = end(run);
        assert_eq!(ended.code, Some(1), "{role}: {ended:?}");
        assert!(ended.stderr.contains(&format!("{role} ended with signal 9")), "{role}: {ended:?}");
        assert_whole(&place);
        place.assert_clean();
        assert_no_shared_memory(&ring);
    }
}

#[test]
fn signals_end_a_run_in_order() {
    for (signal, code) in [(Signal::INT, 130), (Signal::TERM, 143)] {
        let place = Place::new();
        let (run, ring) = under_way(&place, &["--pace", "20x"]);
        kill_process(pid(&run), signal).unwrap();
        let ended = end(run);
        assert_eq!(ended.code, Some(code), "{ended:?}");
        let slots = assert_whole(&place);
        let summary = place.summary("run");
        assert_eq!((&summary["complete"], &summary["slots"]), (&false.into(), &slots.into()));
        let remedy = format!("recorded up to slot {slots}; `skysink run --resume run` continues it");
        assert!(ended.stderr.contains(&remedy), "{ended:?}");
        place.assert_clean();
        assert_no_shared_memory(&ring);
    }
}

#[test]
fn killing_the_launcher_ends_the_workers_and_the_next_run_clears_up() {
    let place = Place::new();
    let (run, ring) = under_way(&place, &["--pace", "20x"]);
    let roles = ["field-sim", "flight-sim", "planner"];
    let workers = roles.map(|role| place.worker(role, &ring));
    kill_process(pid(&run), Signal::KILL).unwrap();
    let killed = std::time::Instant::now();
    assert_eq!(end(run).signal, Some(9));
    for worker in workers {
        let gone = || (!fs::exists(format!("/proc/{}", worker.as_raw_nonzero())).unwrap()).then_some(());
        until("end of the worker", gone);
    }
    assert!(killed.elapsed().as_secs() < 5, "{:?}", killed.elapsed());
    assert_whole(&place);
    place.run_well(&["run", SMOKE, "--no-viewer"]);
    place.assert_clean();
    assert_no_shared_memory(&ring);
}

#[test]
fn two_runs_at_the_same_time_do_not_meet() {
    let place = Place::new();
    let seeds = ["4", "5"];
    for seed in seeds {
        place.run_well(&["simulate", SMOKE, "--seed", seed, "--out", &format!("alone-{seed}")]);
    }
    let both = seeds.map(|seed| place.skysink(&["run", SMOKE, "--no-viewer", "--seed", seed]).spawn().unwrap());
    for (run, seed) in both.into_iter().zip(seeds) {
        let ended = end(run);
        assert_eq!(ended.code, Some(0), "{ended:?}");
        let trace = place.read(&format!("runs/smoke-uts-{seed}/slots.csv"));
        assert_eq!(trace, place.read(&format!("alone-{seed}/slots.csv")));
    }
    place.assert_clean();
}

#[test]
fn the_same_run_twice_at_the_same_time_takes_two_folders() {
    let place = Place::new();
    let both = [(); 2].map(|()| place.skysink(&["run", SMOKE, "--no-viewer"]).spawn().unwrap());
    for run in both {
        let ended = end(run);
        assert_eq!(ended.code, Some(0), "{ended:?}");
    }
    assert_eq!(place.read("runs/smoke-uts-1/slots.csv"), place.read("runs/smoke-uts-1-2/slots.csv"));
}

#[test]
fn a_paced_run_that_keeps_its_deadlines_flies_the_same_mission() {
    let place = Place::new();
    let believed = place.write("believed.toml", &(fs::read_to_string(SMOKE).unwrap() + BELIEVES));
    for scenario in [SMOKE, believed.to_str().unwrap()] {
        place.run_well(&["simulate", scenario, "--force", "--out", "alone"]);
        let begin = std::time::Instant::now();
        place.run_well(&["run", scenario, "--pace", "20x", "--no-viewer", "--force", "--out", "paced"]);
        assert!(begin.elapsed().as_secs_f64() >= 60.0 / 20.0, "faster than its clock: {:?}", begin.elapsed());
        let summary = place.summary("paced");
        assert_eq!(summary["timing"]["missed_deadlines"], summary["held_slots"]);
        if summary["held_slots"] == 0 {
            assert_eq!(place.read("alone/slots.csv"), place.read("paced/slots.csv"), "{scenario}");
        }
    }
}

#[test]
fn a_planner_that_stops_makes_the_uav_hold_and_every_miss_is_counted() {
    let place = Place::new();
    let (run, ring) = under_way(&place, &["--pace", "20x"]);
    let planner = place.worker("planner", &ring);
    kill_process(planner, Signal::STOP).unwrap();
    let held = || place.read("run/slots.csv").lines().filter(|line| line.contains(",hold,")).count();
    until("held slots", || (held() > 20).then_some(()));
    kill_process(planner, Signal::CONT).unwrap();
    let resumed =
        || place.read("run/slots.csv").lines().rev().take(5).all(|line| !line.contains(",hold,")).then_some(());
    until("flight after the planner is back", resumed);
    kill_process(pid(&run), Signal::TERM).unwrap();
    assert_eq!(end(run).code, Some(143));
    assert_whole(&place);
    let summary = place.summary("run");
    assert_eq!(summary["held_slots"], held());
    assert_eq!(summary["timing"]["missed_deadlines"], held());
    let bits = |key: &str| summary[key].as_u64().unwrap();
    assert_eq!(
        bits("initial_bits") + bits("sampled_bits"),
        bits("delivered_bits") + bits("lost_bits") + bits("queued_bits")
    );
    for line in place.read("run/slots.csv").lines().filter(|line| line.contains(",hold,")) {
        let columns: Vec<_> = line.split(',').collect();
        assert_eq!((columns[4], columns[5]), ("", "0"), "a held slot serves nobody: {line}");
    }
}

#[test]
fn a_role_can_be_left_to_a_process_started_by_hand() {
    for (role, executable) in [
        ("planner", env!("CARGO_BIN_EXE_planner")),
        ("field-sim", env!("CARGO_BIN_EXE_field-sim")),
        ("flight-sim", env!("CARGO_BIN_EXE_flight-sim")),
    ] {
        let place = Place::new();
        place.run_well(&["simulate", SMOKE, "--out", "alone"]);
        let run = place.skysink(&["run", SMOKE, "--no-viewer", "--out", "run", "--external", role]).spawn().unwrap();
        let ring = until("ring", || place.rings().into_iter().find(|ring| place.ring_file(ring).exists()));
        until("scenario", || place.path("run/scenario.toml").exists().then_some(()));
        let folder = place.ring_file(&ring).parent().unwrap().to_owned();
        let by_hand = |scenario: &str| -> Command {
            place.command(executable, &["--scenario", scenario, "--ring", folder.to_str().unwrap()])
        };
        let services = folder.join("services");
        until("services", || fs::read_dir(&services).is_ok_and(|entries| entries.count() >= 18).then_some(()));

        place.write("other.toml", "name = \"other\"\n");
        let other = end(by_hand("other.toml").spawn().unwrap());
        assert_eq!(other.code, Some(2), "{other:?}");
        assert!(other.stderr.contains("scenario is") && other.stderr.contains("scenario.toml"), "{other:?}");

        let worker = end(by_hand("run/scenario.toml").spawn().unwrap());
        assert_eq!(worker.code, Some(0), "{role}: {worker:?}");
        let ended = end(run);
        assert_eq!(ended.code, Some(0), "{role}: {ended:?}");
        let folder = folder.display();
        let scenario = place.path("run/scenario.toml").display().to_string();
        let hint = format!("waiting up to 600 s for {role}: {executable} --scenario {scenario} --ring {folder}\n");
        assert!(ended.stderr.contains(&hint), "{ended:?}");
        assert_eq!(place.read("alone/slots.csv"), place.read("run/slots.csv"), "{role}");
        place.assert_clean();
    }
}

#[test]
fn a_process_that_does_not_come_is_named_in_the_time_out() {
    let place = Place::new();
    let ended = place.run(&["run", SMOKE, "--no-viewer", "--external", "planner", "--timeout", "1", "--out", "run"]);
    assert_eq!(ended.code, Some(1), "{ended:?}");
    assert!(ended.stderr.contains("planner"), "{ended:?}");
    assert_eq!(place.summary("run")["complete"], false);
    place.assert_clean();
}

#[test]
fn a_worker_without_a_ring_says_what_it_needs() {
    let place = Place::new();
    let ended =
        end(place.command(env!("CARGO_BIN_EXE_planner"), &["--scenario", SMOKE, "--ring", "nowhere"]).spawn().unwrap());
    assert_eq!(ended.code, Some(2), "{ended:?}");
    assert!(ended.stderr.contains("nowhere") && ended.stderr.contains("skysink run prints"), "{ended:?}");
}
