//! Processes are killed, stopped and started again, and the mission's result stays what it is.

use crate::support;
use std::fs;
use std::process::Child;

use crate::support::{Ended, Place, assert_no_shared_memory, end, lines, until};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rustix::process::{Pid, Signal, kill_process};

/// A mission in lock-step that lasts long enough to be disturbed.
const LONG: &str = "name = \"long\"\nslots = 9000\nslot_s = 0.1\n[uav]\nendurance_s = 1e6\n";

/// The same by the clock: 40 slots a second.
const PACED: &str = "name = \"paced\"\nslots = 160\nslot_s = 0.5\n";

const RING: [&str; 3] = ["field-sim", "flight-sim", "planner"];

/// Starts `skysink run` of `long.toml` into `run`, and waits until its ring is there.
fn begin(place: &Place, arguments: &[&str]) -> (Child, String) {
    let child = place.skysink(&[&["run", "long.toml", "--out", "run"][..], arguments].concat()).spawn().unwrap();
    let ring = until("ring", || place.rings().into_iter().find(|ring| place.ring_file(ring).exists()));
    (child, ring)
}

fn flown(place: &Place) -> usize {
    lines(&place.path("run/slots.csv")).saturating_sub(1)
}

fn events(place: &Place) -> Vec<(String, String)> {
    let summary = place.summary("run");
    let events = summary["events"].as_array().unwrap().iter();
    events.map(|event| ["process", "event"].map(|key| event[key].as_str().unwrap().to_owned()).into()).collect()
}

fn well(ended: &Ended, what: &str) {
    let said = &ended.stderr[ended.stderr.len().saturating_sub(600)..];
    assert_eq!(ended.code, Some(0), "{what}: ...{said}");
}

fn pid(child: &Child) -> Pid {
    Pid::from_raw(i32::try_from(child.id()).unwrap()).unwrap()
}

/// Kills workers at random instants while the run lasts; returns how many. Between two rounds of kills it lets the ring
/// turn, however long a restart takes on this machine.
fn kill_at_random(place: &Place, run: &mut Child, ring: &str, random: &mut ChaCha8Rng) -> u64 {
    let mut kills = 0;
    let pause = |random: &mut ChaCha8Rng| {
        std::thread::sleep(std::time::Duration::from_micros(random.random_range(0..60_000)));
    };
    while run.try_wait().unwrap().is_none() {
        pause(random);
        // Several at once, the same one twice, one that is just starting.
        for _ in 0..random.random_range(1..=4) {
            let role = RING[random.random_range(0..RING.len())];
            if let Some(worker) = place.worker_now(role, ring) {
                kills += u64::from(kill_process(worker, Signal::KILL).is_ok());
            }
            pause(random);
        }
        let before = flown(place);
        until("flight", || (flown(place) > before || run.try_wait().unwrap().is_some()).then_some(()));
    }
    kills
}

#[test]
fn kills_at_any_instant_change_nothing() {
    let place = Place::new();
    place.write("long.toml", LONG);
    let mut kills = 0;
    for (seed, strategy) in (1..=6).zip(["uts", "gfs", "rfs"].into_iter().cycle()) {
        let choice = ["--strategy", strategy, "--force"];
        place.run_well(&[&["simulate", "long.toml", "--out", "alone"][..], &choice].concat());
        let (mut run, ring) = begin(&place, &[&choice[..], &["--no-viewer"]].concat());
        kills += kill_at_random(&place, &mut run, &ring, &mut ChaCha8Rng::seed_from_u64(seed));
        well(&end(run), &format!("seed {seed}"));
        assert_eq!(place.read("alone/slots.csv"), place.read("run/slots.csv"), "seed {seed}, {strategy}");
        let [alone, ring_summary] = ["alone", "run"].map(|run| place.summary(run));
        for key in ["trace_hash", "lost_bits", "delivered_bits", "queued_bits", "eta_letter", "mean_served", "complete"]
        {
            assert_eq!(alone[key], ring_summary[key], "seed {seed}: {key}");
        }
        assert_no_shared_memory(&ring);
    }
    assert!(kills >= 100, "{kills} kills"); // usually some hundred
    place.assert_clean();
}

#[test]
fn a_planner_that_remembers_comes_back_as_it_was() {
    let place = Place::new();
    let few = "[sensors]\ncount = 30\nsampling_bps = [50.0, 900.0]\n[area]\nside_m = 300.0\n[planner]\n\
               horizon.iterations = 200\n";
    let (known, learnt) = ("knowledge = \"estimated\"\n", "knowledge = \"estimated\"\nrates = \"learnt\"\n");
    let cases =
        [("horizon", ""), ("max-age-first", ""), ("tour", ""), ("uts", known), ("exact", learnt), ("horizon", learnt)];
    for (strategy, knowledge) in cases {
        place.write("long.toml", &(LONG.replace("9000", "3000") + few + knowledge));
        let choice = ["--strategy", strategy, "--force"];
        place.run_well(&[&["simulate", "long.toml", "--out", "alone"][..], &choice].concat());
        let (run, ring) = begin(&place, &[&choice[..], &["--no-viewer"]].concat());
        for kill in 1..=4 {
            until("flight", || (flown(&place) > 300 * kill).then_some(()));
            for role in &RING[kill % 3..] {
                kill_process(place.worker(role, &ring), Signal::KILL).unwrap();
            }
        }
        let case = format!("{strategy} {knowledge}");
        well(&end(run), &case);
        assert_eq!(place.read("alone/slots.csv"), place.read("run/slots.csv"), "{case}");
        // And after its launcher.
        let begun: String = place.read("alone/slots.csv").split_inclusive('\n').take(401).collect();
        fs::write(place.path("run/slots.csv"), begun).unwrap();
        place.run_well(&["run", "--resume", "run", "--no-viewer"]);
        assert_eq!(place.read("alone/slots.csv"), place.read("run/slots.csv"), "{case}, resumed");
    }
    place.assert_clean();
}

#[test]
fn killed_processes_come_back_where_everybody_polls() {
    let place = Place::new();
    place.write("long.toml", LONG);
    place.run_well(&["simulate", "long.toml", "--out", "alone"]);
    let (run, ring) = begin(&place, &["--wait", "poll", "--no-viewer"]);
    for role in RING {
        let before = flown(&place);
        until("flight", || (flown(&place) > before + 20).then_some(()));
        kill_process(place.worker(role, &ring), Signal::KILL).unwrap();
    }
    well(&end(run), "run");
    assert_eq!(place.read("alone/slots.csv"), place.read("run/slots.csv"));
    assert_eq!(place.summary("run")["restarts"], 3);
    assert_no_shared_memory(&ring);
    place.assert_clean();
}

#[test]
fn every_restart_is_on_record() {
    let place = Place::new();
    place.write("long.toml", LONG);
    let (run, ring) = begin(&place, &["--pace", "1000x", "--no-viewer"]);
    for role in RING {
        let worker = place.worker(role, &ring);
        let before = flown(&place);
        until("flight", || (flown(&place) > before + 20).then_some(()));
        kill_process(worker, Signal::KILL).unwrap();
        let again = until("restart", || place.worker_now(role, &ring).filter(|&pid| pid != worker));
        assert_ne!(worker, again);
        let before = flown(&place);
        until("flight after the restart", || (flown(&place) > before + 20).then_some(()));
    }
    let ended = end(run);
    well(&ended, "run");
    let summary = place.summary("run");
    assert_eq!(summary["restarts"], 3);
    let expected: Vec<_> = RING
        .iter()
        .flat_map(|role| [("was ended by signal 9", role), ("was started again (restart 1)", role)])
        .map(|(event, role)| ((*role).to_owned(), event.to_owned()))
        .collect();
    assert_eq!(events(&place), expected);
    for (process, event) in expected {
        assert!(ended.stderr.contains(&format!("{process} {event}")), "{ended:?}");
    }
    assert_eq!(summary["slots"], 9000);
    place.assert_clean();
}

/// Checks that a later file of a recording begins with the slots that were missed before it; returns how many.
#[cfg(feature = "viewer")]
fn missed_before(recording: &std::path::Path) -> i64 {
    let rows = |entity| support::rows(recording, entity);
    let [lane, log, count] = ["/state/uav", "/log/events", "/metrics/missed_slots"].map(rows);
    let (begin, state) = lane.first_key_value().unwrap();
    let (shown, count) = count.first_key_value().unwrap();
    assert!(log[begin].contains("recording continued in a new file"), "{log:?}");
    assert_eq!(log[begin].contains("missed by the viewer"), begin < shown, "{log:?}");
    assert_eq!(state.contains("gap"), begin < shown, "{lane:?}");
    assert!(count.contains(&format!("{}.0,", shown - begin)), "from {begin}, shown {shown}: {count}");
    shown - begin
}

#[cfg(feature = "viewer")]
#[test]
fn a_killed_viewer_comes_back_and_its_recording_is_continued_in_other_files() {
    let place = Place::new();
    place.write("long.toml", &LONG.replace("9000", "1500"));
    place.run_well(&["simulate", "long.toml", "--out", "alone"]);
    let (run, ring) = begin(&place, &["--pace", "4x"]); // 40 slots a second
    let mut ends = Vec::new();
    for kill in 1..=2 {
        let viewer = place.worker("viewer", &ring);
        until("a recorded second", || (flown(&place) > 160 * kill).then_some(()));
        kill_process(viewer, Signal::KILL).unwrap();
        ends.push(flown(&place) as i64);
        until("restart", || place.worker_now("viewer", &ring).filter(|&pid| pid != viewer));
    }
    until("the end of the second gap", || (flown(&place) > 520).then_some(()));
    kill_process(pid(&run), Signal::TERM).unwrap();
    assert_eq!(end(run).code, Some(143));
    let files = support::recordings(&place.path("run"));
    assert_eq!(files.len(), 3, "{files:?}");
    let recorded = support::slots_of_all(&files, "/metrics/loss_rate");
    let last = place.summary("run")["slots"].as_i64().unwrap();
    assert!(recorded.iter().all(|slot| (0..=last + 1).contains(slot)), "{recorded:?}");
    for end in ends {
        // At most the last flush, a second, and the slots until it was back.
        let missing =
            (end - 80..=end + 200).filter(|slot| *slot >= 0 && *slot <= last && !recorded.contains(slot)).count();
        assert!(missing < 200, "{missing} slots around {end}: {recorded:?}");
        assert!((0..end - 80).all(|slot| recorded.contains(&slot) || slot > 0 && missing > 0), "{end}: {recorded:?}");
    }
    for name in ["run/mission-2.rrd", "run/mission-3.rrd"] {
        assert!(missed_before(&place.path(name)) > 0, "{name}: nobody waits for the viewer");
    }
    place.assert_clean();
}

#[cfg(feature = "viewer")]
#[test]
fn in_lock_step_the_ring_waits_for_a_viewer_that_comes_back() {
    let place = Place::new();
    place.write("long.toml", LONG);
    place.run_well(&["simulate", "long.toml", "--out", "alone"]);
    let (run, ring) = begin(&place, &[]);
    until("flight", || (flown(&place) > 200).then_some(()));
    kill_process(place.worker("viewer", &ring), Signal::KILL).unwrap();
    well(&end(run), "run");
    assert_eq!(place.read("alone/slots.csv"), place.read("run/slots.csv"));
    let summary = place.summary("run");
    let killed = summary["events"][0]["slot"].as_i64().unwrap();
    let [first, second] =
        ["run/mission.rrd", "run/mission-2.rrd"].map(|file| support::slots(&place.path(file), "/metrics/loss_rate"));
    assert!(first.intersection(&second).count() <= 1, "no more than the slot in which it was killed is there twice");
    assert!(missed_before(&place.path("run/mission-2.rrd")) <= 70, "no more than what was under way to it");
    let recorded: std::collections::BTreeSet<_> = first.union(&second).copied().collect();
    // What the viewer had not yet written is gone, and the few slots that were under way.
    let missing: Vec<i64> = (0..=9000).filter(|slot| !recorded.contains(slot)).collect();
    assert!(missing.iter().all(|&slot| slot <= killed + 70), "killed in slot {killed}, missing {missing:?}");
    place.assert_clean();
}

#[test]
fn a_run_whose_launcher_was_killed_is_resumed_with_the_same_bytes() {
    let place = Place::new();
    place.write("long.toml", LONG);
    place.run_well(&["simulate", "long.toml", "--out", "alone"]);
    let (run, ring) = begin(&place, &["--no-viewer"]);
    let workers = RING.map(|role| place.worker(role, &ring));
    until("flight", || (flown(&place) > 300).then_some(()));
    kill_process(pid(&run), Signal::KILL).unwrap();
    assert_eq!(end(run).signal, Some(9));
    for worker in workers {
        let gone = || (!fs::exists(format!("/proc/{}", worker.as_raw_nonzero())).unwrap()).then_some(());
        until("end of the worker", gone);
    }
    // A line that was cut is flown again.
    let trace = place.read("run/slots.csv");
    fs::write(place.path("run/slots.csv"), &trace[..trace.len() - 7]).unwrap();
    let before = trace.lines().count() as u64 - 2;
    place.run_well(&["run", "--resume", "run", "--no-viewer"]);
    assert_eq!(place.read("alone/slots.csv"), place.read("run/slots.csv"));
    let [mut alone, mut resumed] = ["alone", "run"].map(|run| place.summary(run));
    assert_eq!(resumed["resumed_after"], before);
    for summary in [&mut alone, &mut resumed] {
        summary["timing"] = serde_json::Value::Null;
        summary["resumed_after"] = serde_json::Value::Null;
    }
    assert_eq!(alone, resumed);
    // Nothing is left to fly, and nothing changes.
    let summary = place.read("run/summary.json");
    let again = place.run_well(&["run", "--resume", "run", "--no-viewer"]);
    assert!(again.stderr.is_empty(), "{again:?}");
    assert_eq!(place.read("run/summary.json"), summary);
    assert_eq!(place.read("alone/slots.csv"), place.read("run/slots.csv"));
    place.assert_clean();
    assert_no_shared_memory(&ring);
}

#[test]
fn a_run_may_be_resumed_from_any_slot_again_and_again() {
    let place = Place::new();
    place.write("smoke.toml", include_str!("../../scenarios/smoke.toml"));
    place.run_well(&["simulate", "smoke.toml", "--out", "alone"]);
    let whole = place.read("alone/slots.csv");
    for slots in [0, 1, 2, 30, 59] {
        place.run_well(&["simulate", "smoke.toml", "--out", "run", "--force"]);
        let begun: String = whole.split_inclusive('\n').take(slots + 1).collect();
        fs::write(place.path("run/slots.csv"), begun).unwrap();
        fs::remove_file(place.path("run/summary.json")).unwrap();
        let viewer: &[&str] = if cfg!(feature = "viewer") && slots == 30 { &[] } else { &["--no-viewer"] };
        place.run_well(&[&["run", "--resume", "run"][..], viewer].concat());
        assert_eq!(place.read("run/slots.csv"), whole, "after {slots} slots");
    }
    place.assert_clean();
}

#[test]
fn what_cannot_be_resumed_is_refused() {
    let place = Place::new();
    place.write("long.toml", LONG);
    place.run_well(&["simulate", "long.toml", "--out", "run", "--strategy", "gfs"]);
    let trace = place.read("run/slots.csv");
    let refused = |parts: &[&str]| {
        let ended = place.run(&["run", "--resume", "run", "--no-viewer"]);
        assert_eq!(ended.code, Some(2), "{parts:?}: {ended:?}");
        assert_eq!(ended.stderr.lines().count(), 1, "{parts:?}: {ended:?}");
        parts.iter().for_each(|part| assert!(ended.stderr.contains(part), "{part}: {ended:?}"));
    };
    let damage = |from: &str, to: &str| {
        assert!(trace.contains(from), "{from}");
        fs::write(place.path("run/slots.csv"), trace.replacen(from, to, 1)).unwrap();
    };
    damage("\n3,", "\n4,");
    refused(&["slots.csv: line 4: `4,", "`: slot 4: expected slot 3 of 9000"]);
    damage(",serve,0\n", ",serve,zero\n");
    refused(&["slots.csv: line 3: `2,", ",serve,z...`: expected a slot as skysink run writes it"]);
    let third = trace.lines().nth(2).unwrap();
    let mut columns: Vec<_> = third.split(',').collect();
    columns[7] = "1"; // bits queued
    damage(third, &columns.join(","));
    refused(&["slots.csv: line 3: `2,", "`: the mission does not lead to this line"]);
    damage("slot,x_m", "slot,x");
    refused(&["slots.csv: line 1: `slot,x,", "`: expected slot,x_m,y_m"]);
    fs::write(place.path("run/slots.csv"), &trace).unwrap();
    fs::remove_file(place.path("run/slots.csv")).unwrap();
    refused(&["slots.csv is missing"]);
    assert_eq!(place.run(&["run", "--resume", "nowhere"]).code, Some(2));
    place.assert_clean();
}

#[test]
fn a_run_under_way_is_neither_resumed_nor_replaced() {
    let place = Place::new();
    place.write("long.toml", LONG);
    let (run, _) = begin(&place, &["--pace", "4x", "--no-viewer"]);
    until("flight", || (flown(&place) > 5).then_some(()));
    for arguments in [&["run", "--resume", "run"][..], &["run", "long.toml", "--out", "run", "--force"]] {
        let ended = place.run(&[arguments, &["--no-viewer"]].concat());
        assert_eq!(ended.code, Some(2), "{ended:?}");
        assert!(ended.stderr.contains("slots.csv: a run is writing it"), "{ended:?}");
    }
    kill_process(pid(&run), Signal::TERM).unwrap();
    assert_eq!(end(run).code, Some(143));
}

#[test]
fn a_silent_process_is_reported_and_welcomed_back() {
    let place = Place::new();
    place.write("long.toml", LONG);
    place.run_well(&["simulate", "long.toml", "--out", "alone"]);
    let (run, ring) = begin(&place, &["--no-viewer"]);
    until("flight", || (flown(&place) > 100).then_some(()));
    let planner = place.worker("planner", &ring);
    kill_process(planner, Signal::STOP).unwrap();
    std::thread::sleep(std::time::Duration::from_millis(1500)); // what is tested is that time passes
    kill_process(planner, Signal::CONT).unwrap();
    well(&end(run), "run");
    assert_eq!(place.read("alone/slots.csv"), place.read("run/slots.csv"));
    let events = events(&place);
    let said: Vec<_> =
        events.iter().map(|(process, event)| (process.as_str(), event.split(' ').nth(1).unwrap())).collect();
    assert_eq!(said, [("planner", "given"), ("planner", "back")], "{events:?}");
}

#[test]
fn a_process_that_stays_silent_is_replaced() {
    let place = Place::new();
    place.write("long.toml", LONG);
    place.run_well(&["simulate", "long.toml", "--out", "alone"]);
    let (run, ring) = begin(&place, &["--no-viewer", "--timeout", "6"]);
    until("flight", || (flown(&place) > 100).then_some(()));
    kill_process(place.worker("flight-sim", &ring), Signal::STOP).unwrap();
    well(&end(run), "run");
    assert_eq!(place.read("alone/slots.csv"), place.read("run/slots.csv"));
    assert_eq!(place.summary("run")["restarts"], 1);
    place.assert_clean();
}

#[test]
fn by_the_clock_every_process_may_die_and_no_bit_is_lost() {
    let place = Place::new();
    place.write("long.toml", PACED);
    let (run, ring) = begin(&place, &["--pace", "20x", "--no-viewer"]);
    for (kills, role) in (1..).zip(RING) {
        until("flight", || (flown(&place) > 35 * kills).then_some(()));
        kill_process(place.worker(role, &ring), Signal::KILL).unwrap();
    }
    well(&end(run), "run");
    let summary = place.summary("run");
    assert_eq!((&summary["slots"], &summary["restarts"]), (&160.into(), &3.into()));
    assert_eq!(summary["timing"]["missed_deadlines"], summary["held_slots"]);
    let held = place.read("run/slots.csv").lines().filter(|line| line.contains(",hold,")).count();
    assert_eq!(summary["held_slots"], held);
    let bits = |key: &str| summary[key].as_u64().unwrap();
    assert_eq!(
        bits("initial_bits") + bits("sampled_bits"),
        bits("delivered_bits") + bits("lost_bits") + bits("queued_bits")
    );
    place.assert_clean();
}

#[test]
fn a_paced_run_reports_how_long_its_hops_take() {
    let place = Place::new();
    place.write("long.toml", PACED);
    let (run, _) = begin(&place, &["--pace", "50x", "--no-viewer"]);
    let ended = end(run);
    well(&ended, "run");
    let latency = &place.summary("run")["timing"]["latency"];
    for hop in ["queues_to_plan", "to_flight", "flight_to_queues", "slot", "jitter"] {
        let us = ["p50_us", "p99_us", "p999_us", "max_us"].map(|key| latency[hop][key].as_f64().unwrap());
        assert!(us[0] > 0.0 && us.is_sorted(), "{hop}: {us:?}");
        assert!(us[3] < 120e6, "{hop}: {us:?}");
    }
    for row in ["queues to plan", "slot start to next plan", "jitter of the slot start"] {
        assert!(ended.stdout.contains(row), "{row}: {ended:?}");
    }
}

#[test]
fn a_process_started_by_hand_may_die_and_be_started_by_hand_again() {
    let place = Place::new();
    place.write("long.toml", LONG);
    place.run_well(&["simulate", "long.toml", "--out", "alone"]);
    let (run, ring) = begin(&place, &["--no-viewer", "--external", "planner"]);
    until("scenario", || place.path("run/scenario.toml").exists().then_some(()));
    let folder = place.ring_file(&ring).parent().unwrap().to_owned();
    until("services", || fs::read_dir(folder.join("services")).is_ok_and(|files| files.count() >= 18).then_some(()));
    let arguments = ["--scenario", "run/scenario.toml", "--ring", folder.to_str().unwrap()];
    for kill in 1..=3 {
        let by_hand = place.command(env!("CARGO_BIN_EXE_planner"), &arguments).spawn().unwrap();
        let before = flown(&place);
        until("flight", || (flown(&place) > before + 50).then_some(()));
        kill_process(pid(&by_hand), Signal::KILL).unwrap();
        assert_eq!(end(by_hand).signal, Some(9), "kill {kill}");
    }
    well(&end(place.command(env!("CARGO_BIN_EXE_planner"), &arguments).spawn().unwrap()), "planner");
    well(&end(run), "run");
    assert_eq!(place.read("alone/slots.csv"), place.read("run/slots.csv"));
    place.assert_clean();
}

#[test]
fn a_soak_finds_nothing() {
    let place = Place::new();
    let ended = place.run(&["soak", "--slots", "40000", "--kill-every", "0.5", "--strategy", "gfs", "--out", "run"]);
    well(&ended, "soak");
    assert!(ended.stdout.contains("bits unaccounted: 0"), "{ended:?}");
    for row in ["field-sim", "flight-sim", "planner", "skysink", "/dev/shm"] {
        assert!(ended.stdout.contains(row), "{row}: {ended:?}");
    }
    place.assert_clean();
}

#[test]
fn a_soak_of_kills_at_any_instant_finds_nothing() {
    let place = Place::new();
    let viewer: &[&str] = if cfg!(feature = "viewer") { &["--viewer"] } else { &[] };
    let soak = ["soak", "--anywhere", "--missions", "6", "--kills", "12", "--out", "alone"];
    let ended = place.run(&[&soak, viewer].concat());
    well(&ended, "soak");
    let (_, kills) = ended.stdout.split_once("6 missions with ").expect("the outcome");
    let kills: u32 = kills.split_once(" kills").unwrap().0.parse().unwrap();
    assert!(kills >= 24, "{kills} kills"); // of 72, some of which come when the mission is over
    assert!(ended.stdout.contains("equal traces, complete recordings, nothing left behind"), "{ended:?}");
    place.assert_clean();
}

#[cfg(feature = "viewer")]
#[test]
fn flight_sim_and_planner_may_die_before_the_viewer_is_there() {
    let place = Place::new();
    place.write("long.toml", &LONG.replace("9000", "300"));
    place.run_well(&["simulate", "long.toml", "--out", "alone"]);
    let (run, ring) = begin(&place, &["--external", "viewer", "--timeout", "20"]);
    let folder = place.ring_file(&ring).parent().unwrap().to_owned();
    for (role, journal) in [("flight-sim", "flights.journal"), ("planner", "plans.journal")] {
        let worker = place.worker(role, &ring);
        until(journal, || folder.join(journal).exists().then_some(())); // it has joined, and waits for the viewer
        kill_process(worker, Signal::KILL).unwrap();
        until("restart", || place.worker_now(role, &ring).filter(|&pid| pid != worker));
    }
    let arguments =
        ["--scenario", "run/scenario.toml", "--ring", folder.to_str().unwrap(), "--save", "run/mission.rrd"];
    well(&end(place.command(env!("CARGO_BIN_EXE_viewer"), &arguments).spawn().unwrap()), "viewer");
    well(&end(run), "run");
    assert_eq!(place.read("alone/slots.csv"), place.read("run/slots.csv"));
    place.assert_clean();
}

#[cfg(feature = "viewer")]
#[test]
fn a_stopped_viewer_costs_nobody_else_a_restart() {
    let place = Place::new();
    place.write("long.toml", LONG);
    place.run_well(&["simulate", "long.toml", "--out", "alone"]);
    let (run, ring) = begin(&place, &["--timeout", "6"]);
    until("flight", || (flown(&place) > 100).then_some(()));
    kill_process(place.worker("viewer", &ring), Signal::STOP).unwrap();
    well(&end(run), "run");
    assert_eq!(place.read("alone/slots.csv"), place.read("run/slots.csv"));
    let events = events(&place);
    assert!(events.iter().any(|(_, event)| event == "was ended by signal 9"), "{events:?}");
    assert!(events.iter().all(|(process, _)| process == "viewer"), "{events:?}");
    place.assert_clean();
}

#[test]
fn a_machine_that_sleeps_wakes_up_to_a_whole_mission() {
    let place = Place::new();
    place.write("long.toml", LONG);
    place.run_well(&["simulate", "long.toml", "--out", "alone"]);
    let (run, ring) = begin(&place, &["--no-viewer", "--timeout", "6"]);
    until("flight", || (flown(&place) > 100).then_some(()));
    let processes: Vec<_> = RING.map(|role| place.worker(role, &ring)).into_iter().chain([pid(&run)]).collect();
    for signal in [Signal::STOP, Signal::CONT] {
        processes.iter().for_each(|&process| kill_process(process, signal).unwrap());
        std::thread::sleep(std::time::Duration::from_secs(7)); // longer than the time-out
    }
    well(&end(run), "run");
    assert_eq!(place.read("alone/slots.csv"), place.read("run/slots.csv"));
    assert_eq!(place.summary("run")["restarts"], 0);
    place.assert_clean();
}

#[test]
fn a_resumed_run_keeps_its_pace() {
    let place = Place::new();
    place.write("long.toml", PACED);
    let (run, _) = begin(&place, &["--pace", "40x", "--no-viewer"]);
    until("flight", || (flown(&place) > 20).then_some(()));
    kill_process(pid(&run), Signal::INT).unwrap();
    let ended = end(run);
    assert_eq!(ended.code, Some(130), "{ended:?}");
    assert!(ended.stderr.contains("`skysink run --resume run` continues it"), "{ended:?}");
    place.run_well(&["run", "--resume", "run", "--no-viewer"]);
    assert_eq!(place.summary("run")["timing"]["pace"], "40x");
}
