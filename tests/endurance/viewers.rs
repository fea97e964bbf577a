//! Viewers that are killed, stopped or late: the reaction of the ring, and their recordings.

use std::collections::BTreeSet;
use std::ops::Range;
use std::path::Path;

use rustix::process::Signal;

use crate::support::flight::RunningFlight;
use crate::support::{EACH_SLOT, Place, assert_whole_from, output, recordings, rows, slots, until, verify, verify_all};
use crate::{events, longer};

/// Most slots that a killed viewer had not written in a run of 40 slots a second: a batch in the making and one on its
/// way to the file. A batch ends after 64 slots and a second, and may begin with the 64 that a reader has room for.
const UNWRITTEN: i64 = 2 * (64 + 64);

/// Checks that a later file of a recording begins with the slots that were missed before it; returns these.
fn missed_before(recording: &Path) -> Range<i64> {
    let [lane, log, count] =
        ["/state/uav", "/log/events", "/metrics/missed_slots"].map(|entity| rows(recording, entity));
    let (&begin, state) = lane.first_key_value().unwrap();
    let (&shown, count) = count.first_key_value().unwrap();
    assert!(log[&begin].contains("recording continued in a new file"), "{log:?}");
    assert_eq!(log[&begin].contains("missed by the viewer"), begin < shown, "{log:?}");
    assert_eq!(state.contains("gap"), begin < shown, "{lane:?}");
    assert!(count.contains(&format!(" {}.0,", shown - begin)), "from {begin}, shown {shown}: {count}");
    begin..shown
}

#[test]
fn a_killed_viewer_is_restarted_and_continues_its_recording_in_other_files() {
    let place = Place::new();
    let run = place.flight("long").pace("4x").start(); // 40 slots a second
    for file in ["mission.rrd", "mission-2.rrd"] {
        let before = run.slots();
        until("recording", || run.path(file).exists().then_some(()));
        run.until_slot(before + 300); // less than the ten seconds after which the library writes by itself
        run.kill_and_await("viewer");
    }
    until("third file", || run.path("mission-3.rrd").exists().then_some(()));
    run.until_slots_later(100);
    run.terminate();
    assert_eq!(recordings(&place.path("run")).len(), 3);
    let [first, second, third] =
        ["mission.rrd", "mission-2.rrd", "mission-3.rrd"].map(|file| place.path("run").join(file));
    for file in [&first, &second, &third] {
        verify(file);
    }
    let mut last = assert_whole_from(0, &first);
    for file in [second, third] {
        let missed = missed_before(&file);
        assert!(!missed.is_empty(), "{}: nobody waits for the viewer", file.display());
        // The killed viewer had shown all slots before these, the last of them perhaps without having noted it.
        assert!(last <= missed.start, "files overlap by {} slots", last + 1 - missed.start);
        let unwritten = missed.start - 1 - last;
        assert!(unwritten <= UNWRITTEN, "{unwritten} slots before {missed:?} were not written");
        last = assert_whole_from(missed.start, &file);
    }
    let flown = place.summary("run")["slots"].as_i64().unwrap();
    assert!((flown..=flown + 1).contains(&last), "recorded up to {last} of {flown} slots"); // one may be under way
    place.assert_clean();
}

#[test]
fn a_lock_step_ring_waits_for_a_restarted_viewer() {
    let place = Place::new();
    let run = longer(&place).start();
    run.until_slot(200);
    run.kill("viewer");
    run.wait_for_success();
    place.assert_trace_as_simulated("run");
    recordings(&place.path("run")).iter().for_each(|file| drop(verify(file)));
    let summary = place.summary("run");
    let is_kill = |event: &&serde_json::Value| event["event"] == "was killed by signal 9";
    let killed = summary["events"].as_array().unwrap().iter().find(is_kill).unwrap()["slot"].as_i64().unwrap();
    let [first, second] = ["run/mission.rrd", "run/mission-2.rrd"].map(|file| slots(&place.path(file), EACH_SLOT));
    assert!(first.intersection(&second).count() <= 1, "no more than the slot in which it was killed is there twice");
    let missed = missed_before(&place.path("run/mission-2.rrd"));
    assert!(missed.end - missed.start <= 70, "no more than what was under way to it: {missed:?}");
    let recorded: BTreeSet<_> = first.union(&second).copied().collect();
    // The slots that the viewer had not yet written are missing, and the few in transit.
    let missing: Vec<i64> = (0..=9000).filter(|slot| !recorded.contains(slot)).collect();
    assert!(missing.iter().all(|&slot| slot <= killed + 70), "killed in slot {killed}, missing {missing:?}");
    place.assert_clean();
}

#[test]
fn kills_before_the_start_of_the_viewer_do_not_change_the_recording() {
    let place = Place::new();
    let run = place.flight("long").set("slots", 300).external("viewer").timeout("20").start();
    for (role, journal) in [("flight-sim", "flights.journal"), ("planner", "plans.journal")] {
        until_waiting_for_the_viewer(&run, journal);
        run.kill_and_await(role);
    }
    output(run.worker_command("viewer").args(["--save", "run/mission.rrd"])).assert_success();
    run.wait_for_success();
    place.assert_trace_as_simulated("run");
    place.assert_clean();
}

/// Waits until the process with this journal has joined.
fn until_waiting_for_the_viewer(run: &RunningFlight, journal: &str) {
    until(journal, || run.folder().join(journal).exists().then_some(()));
}

#[test]
fn a_stopped_viewer_causes_no_other_restart() {
    let place = Place::new();
    let run = longer(&place).timeout("6").start();
    run.until_slot(100);
    run.signal_worker("viewer", Signal::STOP);
    run.wait_for_success();
    place.assert_trace_as_simulated("run");
    let events = events(&place);
    assert!(events.iter().any(|(_, event)| event == "was killed by signal 9"), "{events:?}");
    assert!(events.iter().all(|(process, _)| process == "viewer"), "{events:?}");
    place.assert_clean();
}

#[test]
fn a_viewer_killed_after_creating_its_file_leaves_a_complete_recording() {
    let place = Place::new();
    place.flight("smoke").out("recorded").options(&["--record"]).simulate();
    let undisturbed = verify(&place.path("recorded/mission.rrd"));
    for _ in 0..8 {
        let run = place.flight("smoke").force().start();
        let length = || std::fs::metadata(run.path("mission.rrd")).map_or(0, |file| file.len());
        let worker = run.worker("viewer");
        while length() == 0 {
            std::hint::spin_loop(); // to be no later than the first bytes
        }
        let _ = rustix::process::kill_process(worker, Signal::KILL);
        run.wait_for_success();
        place.assert_trace_as_simulated("run");
        verify_all(&place.path("run"), &undisturbed);
        let is_hidden = |file: std::fs::DirEntry| file.file_name().to_string_lossy().starts_with('.');
        assert!(!std::fs::read_dir(place.path("run")).unwrap().any(|file| is_hidden(file.unwrap())));
    }
    place.assert_clean();
}
