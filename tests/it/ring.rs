//! The ring as processes: an orderly end in every case. That they fly as one process does is in `agreement.rs`.

use std::fs;

use crate::support::flight::{RING, executable};
use crate::support::scenarios::{self, SMOKE};
use crate::support::{self, Place, assert_balanced, assert_whole_from, output, until_exited, wait};
use rustix::process::Signal;

/// Fails unless the trace in `run` has complete lines of the slots 1, 2, 3, ...; returns their number.
fn assert_whole(place: &Place) -> usize {
    let trace = place.trace("run");
    assert!(trace.ends_with('\n'), "a line is cut");
    for (slot, line) in trace.lines().enumerate().skip(1) {
        assert_eq!(line.split(',').next().unwrap(), slot.to_string());
        assert_eq!(line.split(',').count(), 11);
    }
    trace.lines().count() - 1
}

/// Fails unless `run` has a trace of complete lines and the figures of an unfinished mission; returns its slots.
fn assert_cut(place: &Place) -> usize {
    let slots = assert_whole(place);
    let summary = place.summary("run");
    assert_eq!((&summary["complete"], &summary["slots"]), (&false.into(), &slots.into()));
    slots
}

#[test]
fn equal_weights_do_not_change_the_flight() {
    let place = Place::new();
    for strategy in
        ["uts", "uts-wide", "exact", "gfs", "max-weight", "drift-plus-penalty", "whittle", "horizon", "offline"]
    {
        let [without, equal, other] = [None, Some([7, 7]), Some([7, 70])].map(|weights| {
            let list = scenarios::list(|id| weights.map(|[even, odd]| if id % 2 == 0 { even } else { odd }));
            place.write("list.csv", &list);
            let flight = place.flight("listed").strategy(strategy).set("planner.horizon.iterations", 200);
            flight.set("planner.offline.steps", 20_000).force().simulate();
            (place.trace("run"), place.summary("run")["weighted_loss_rate"].as_f64())
        });
        assert_eq!(without, equal, "{strategy}");
        assert_eq!(equal.1, None);
        assert!(other.1.is_some() && other.0 != equal.0, "{strategy} does not value weights");
    }
}

#[test]
fn the_papers_mission_is_built_in() {
    let place = Place::new();
    place.run_ok(&["run", "--no-viewer", "--out", "built-in"]);
    place.flight("letter").out("file").simulate();
    place.assert_same_trace("built-in", "file");
    assert_eq!(place.trace("built-in").lines().count(), 601);
}

#[test]
fn killing_a_worker_that_is_not_restarted_ends_the_run_with_its_name() {
    for role in RING.into_iter().chain(cfg!(feature = "viewer").then_some("viewer")) {
        let place = Place::new();
        let run = place.flight("long").pace("20x").options(&["--restart", "never"]).start();
        run.until_slot(if role == "viewer" { 500 } else { 20 }); // 2.5 s, which it has recorded
        run.kill(role);
        let ended = run.wait().assert_code(1);
        assert!(ended.stderr.contains(&format!("{role} ended with signal 9")), "{role}: {ended:?}");
        assert!(!ended.stderr.contains("has not sent"), "its death was noticed, not its silence: {ended:?}");
        assert_cut(&place);
        if cfg!(feature = "viewer") {
            let last = assert_whole_from(0, &place.path("run/mission.rrd"));
            assert!(role != "viewer" || last > 100, "all but the last second: {last}");
        }
        place.assert_clean();
    }
}

#[test]
fn killing_a_worker_at_full_speed_ends_the_run() {
    for role in RING {
        let place = Place::new();
        let run = place.flight("endless").options(&["--restart", "never"]).start();
        run.until_slot(20);
        run.kill(role);
        let ended = run.wait().assert_code(1);
        assert!(ended.stderr.contains(&format!("{role} ended with signal 9")), "{role}: {ended:?}");
        let slots = assert_whole(&place);
        if cfg!(feature = "viewer") {
            let last = assert_whole_from(0, &place.path("run/mission.rrd"));
            assert!(last >= slots as i64, "{role}: {slots} flown, {last} recorded"); // lock-step waits for the viewer
        }
        place.assert_clean();
    }
}

#[test]
fn signals_end_a_run_cleanly() {
    // Under `nohup` a hang-up is ignored, also by what the tests start.
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:")).unwrap().trim();
    let is_ignored = u64::from_str_radix(ignored, 16).unwrap() & 1 == 1; // SIGHUP is the first
    let signals = [(Signal::INT, 130), (Signal::TERM, 143), (Signal::HUP, 129)];
    for (signal, code) in signals.into_iter().filter(|(signal, _)| !is_ignored || *signal != Signal::HUP) {
        let place = Place::new();
        let run = place.flight("long").pace("20x").start();
        run.until_slot(20);
        run.signal_launcher(signal);
        let ended = run.wait().assert_code(code);
        let slots = assert_cut(&place);
        let remedy = format!("recorded up to slot {slots}; `skysink run --resume run` continues it");
        assert!(ended.stderr.contains(&remedy), "{ended:?}");
        place.assert_clean();
    }
}

#[test]
fn killing_the_launcher_ends_the_workers_and_the_next_run_cleans_up() {
    let place = Place::new();
    // The mission and the timeout last longer than the test would wait: only the launcher's death can end the workers.
    let run = place.flight("long").pace("1x").timeout("3600").start();
    run.until_slot(5);
    let workers = RING.map(|role| run.worker(role));
    run.kill_launcher();
    workers.into_iter().for_each(until_exited);
    assert_whole(&place);
    place.flight("smoke").without_viewer().out("next").run();
    place.assert_clean();
}

#[test]
fn a_failing_test_leaves_no_process_and_no_shared_memory() {
    let place = Place::new();
    let run = place.flight("long").without_viewer().pace("1x").timeout("3600").start();
    run.until_slot(1);
    let workers = RING.map(|role| run.worker(role));
    run.signal_worker("planner", Signal::STOP); // it cannot notice the death of the launcher
    run.kill_launcher();
    let shared = place.shared_memory();
    assert!(!shared.is_empty());
    drop(place);
    workers.into_iter().for_each(until_exited);
    assert!(shared.iter().all(|path| !path.exists()), "{shared:?}");
}

#[test]
fn two_simultaneous_runs_do_not_interfere() {
    let place = Place::new();
    let seeds = [4, 5];
    let flights = seeds.map(|seed| place.flight("smoke").seed(seed).without_viewer());
    let both = [0, 1].map(|i| flights[i].out(&format!("ring-{i}")).launcher().spawn().unwrap());
    for (i, run) in both.into_iter().enumerate() {
        wait(run).assert_success();
        place.assert_trace_as_simulated(&format!("ring-{i}"));
    }
    place.assert_clean();
}

#[test]
fn two_simultaneous_equal_runs_use_two_folders() {
    let place = Place::new();
    let both = [(); 2].map(|()| place.skysink(&["run", SMOKE, "--no-viewer"]).spawn().unwrap());
    for run in both {
        wait(run).assert_success();
    }
    place.assert_same_trace("runs/smoke-uts-1", "runs/smoke-uts-1-2");
}

#[test]
fn a_paced_run_without_missed_deadlines_flies_the_same_mission() {
    let place = Place::new();
    let smoke = place.flight("smoke").pace("40x").without_viewer();
    let estimated = smoke.settings("planner.knowledge=estimated planner.rates=learnt");
    for (out, flight) in [("known", &smoke), ("estimated", &estimated)] {
        let begin = std::time::Instant::now();
        flight.out(out).run();
        assert!(begin.elapsed().as_secs_f64() >= 60.0 / 40.0, "faster than its clock: {:?}", begin.elapsed());
        let summary = place.summary(out);
        assert_eq!(summary["timing"]["missed_deadlines"], summary["held_slots"]);
        if summary["held_slots"] == 0 {
            place.assert_trace_as_simulated(out);
        }
    }
}

#[test]
fn a_suspended_planner_causes_holds_and_every_miss_is_counted() {
    let place = Place::new();
    let run = place.flight("long").pace("20x").start();
    run.until_slot(20);
    run.signal_worker("planner", Signal::STOP);
    let held = || place.trace("run").lines().filter(|line| line.contains(",hold,")).count();
    support::until("held slots", || (held() > 20).then_some(()));
    run.signal_worker("planner", Signal::CONT);
    let resumed = || place.trace("run").lines().rev().take(5).all(|line| !line.contains(",hold,")).then_some(());
    support::until("flight after the planner is back", resumed);
    run.terminate();
    assert_whole(&place);
    let summary = place.summary("run");
    assert_eq!(summary["held_slots"], held());
    assert_eq!(summary["timing"]["missed_deadlines"], held());
    assert_balanced(&summary);
    for line in place.trace("run").lines().filter(|line| line.contains(",hold,")) {
        let columns: Vec<_> = line.split(',').collect();
        assert_eq!((columns[5], columns[6]), ("", "0"), "a held slot serves nobody: {line}");
    }
}

#[test]
fn a_role_can_be_filled_by_a_manually_started_process() {
    for role in RING {
        let place = Place::new();
        let run = place.flight("smoke").without_viewer().external(role).start();

        place.write("other.toml", "name = \"other\"\n");
        let other = output(run.worker_command_with(role, "other.toml")).assert_code(2);
        assert!(other.stderr.contains("scenario is") && other.stderr.contains("scenario.toml"), "{other:?}");

        output(run.worker_command(role)).assert_success();
        let program = executable(role);
        let folder = run.folder().display().to_string();
        let ended = run.wait_for_success();
        let scenario = place.path("run/scenario.toml").display().to_string();
        let hint = format!("waiting up to 600 s for {role}: {program} --scenario {scenario} --ring {folder}\n");
        assert!(ended.stderr.contains(&hint), "{ended:?}");
        place.assert_trace_as_simulated("run");
        place.assert_clean();
    }
}

#[test]
fn skysink_alone_contains_the_programs_of_the_ring() {
    let place = Place::new();
    let built = env!("CARGO_BIN_EXE_skysink");
    if fs::hard_link(built, place.path("skysink")).is_err() {
        let copied = output(place.command("cp", &[built, "skysink"]));
        assert_eq!(copied.code, Some(0), "{copied:?}");
    }
    let alone = place.path("skysink").display().to_string();
    let scenario = place.scenario("smoke");
    let ended = output(place.command(&alone, &["run", &scenario, "--no-viewer", "--out", "run"]));
    assert_eq!(ended.code, Some(0), "{ended:?}");
    place.assert_trace_as_simulated("run");
    let help = output(place.command(&alone, &["planner", "--help"]));
    assert!(help.stdout.contains("Usage: planner "), "{help:?}");
    place.assert_clean();
}
