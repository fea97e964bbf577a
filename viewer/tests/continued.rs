//! Recordings that a viewer goes on with after the one before it ended, was killed, or left something else.

mod chunks;
mod support;

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use chunks::{Chunks, leave_out, recording};
use skysink_common::scenario::Scenario;
use skysink_viewer::{Existing, Level, Scene, SceneError, Sinks, Timing, curves, events, links, path, uav};
use support::{Found, Slot, letter, sensors, town};

const SENSORS: u32 = 20;

fn open(path: &Path, scenario: &Scenario, name: &str) -> Result<Scene, SceneError> {
    let sinks = Sinks { save: Some(path.to_owned()), existing: Existing::Continue, live: None };
    Scene::open(&sinks, scenario, &sensors(SENSORS), name, Timing::Unmeasured)
}

/// Goes on with a recording and shows these slots; returns the slot after which it went on.
fn go_on(path: &Path, scenario: &Scenario, slots: impl IntoIterator<Item = u64>) -> Option<u64> {
    let mut scene = open(path, scenario, "another name").unwrap();
    let after = scene.continued_after();
    log(&mut scene, slots);
    scene.close().unwrap();
    after
}

fn log(scene: &mut Scene, slots: impl IntoIterator<Item = u64>) {
    for slot in slots {
        scene.log_slot(&Slot::new(slot, SENSORS as usize).view()).unwrap();
    }
}

/// A place for a recording, alone in a folder.
fn place() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mission.rrd");
    (folder, path)
}

/// Slots 0 to 8, written in three parts.
fn in_parts(path: &Path, scenario: &Scenario) {
    let mut scene = open(path, scenario, "first name").unwrap();
    log(&mut scene, 0..=2);
    scene.close().unwrap();
    assert_eq!(go_on(path, scenario, 3..=5), Some(2));
    assert_eq!(go_on(path, scenario, 6..=8), Some(5));
}

/// Nothing that stays and, outside the log, nothing that has a slot is there twice; only the file itself is left.
fn assert_tidy(path: &Path, found: &Found) {
    for (cell, values) in found.cells.iter().chain(&found.layout) {
        assert!(values.len() == 1 || cell.0 == "/log/events", "twice: {cell:?}");
    }
    let left: Vec<_> = fs::read_dir(path.parent().unwrap()).unwrap().map(|entry| entry.unwrap().path()).collect();
    assert_eq!(left, [path]);
}

#[test]
fn a_recording_in_parts_is_that_of_one_piece() {
    for scenario in [letter(), town()] {
        let ((_folder, path), (_other, whole)) = (place(), place());
        in_parts(&path, &scenario);
        go_on(&whole, &scenario, 0..=8);
        let (found, expected) = (Found::read(&path), Found::read(&whole));
        assert_tidy(&path, &found);
        assert_eq!(found.layout.keys().collect::<Vec<_>>(), expected.layout.keys().collect::<Vec<_>>());
        let (shown, expected_shown) = (found.shown(), expected.shown());
        let only_there: Vec<_> =
            expected_shown.iter().filter(|(cell, values)| shown.get(*cell) != Some(values)).collect();
        // The way from the last slot of one part to the first of the next is not known.
        let is_way =
            |(entity, ..): &support::Cell| [uav::TRAIL, uav::TRACK, uav::BODY, uav::PLAN].contains(&&entity[1..]);
        assert!(only_there.iter().all(|(cell, _)| is_way(cell) && [3, 6].contains(&cell.2.unwrap())), "{only_there:?}");
        assert_eq!(found.log().matches("start of mission").count(), 1);
        assert_eq!(found.log().matches("first loss").count(), 1);
        assert!(found.log().contains("recording continued after slot 5: the viewer was restarted"), "{}", found.log());
        let lane = found.slots_of(events::LANE);
        assert_eq!(lane, BTreeSet::from([1]), "the state did not change");
        assert_eq!(recording(&path), "first name");
    }
}

#[test]
fn a_recording_cut_anywhere_keeps_every_whole_message() {
    let (_folder, path) = place();
    in_parts(&path, &letter());
    let (bytes, whole) = (fs::read(&path).unwrap(), Chunks::of(&path));
    let every_slot: Vec<_> = whole.entities().filter(|entity| whole.slots_of(entity).len() == 9).collect();
    let mut afters = BTreeSet::new();
    for kept in (0..bytes.len()).step_by(bytes.len() / 50) {
        fs::write(&path, &bytes[..kept]).unwrap();
        let before = Chunks::of(&path);
        let after = go_on(&path, &letter(), []);
        recording(&path);
        let now = Chunks::of(&path);
        assert!(before.timed.iter().all(|(id, chunk)| now.timed[id] == *chunk), "cut at {kept}");
        let is_old = |(id, (entity, _)): &(_, &(String, _))| before.timed.contains_key(id) || entity == "/log/events";
        assert!(now.timed.iter().all(|(id, chunk)| is_old(&(*id, chunk))), "cut at {kept}");
        assert_eq!((now.stay, now.layout), (whole.stay, whole.layout), "cut at {kept}");
        let has = |slot: i64| every_slot.iter().all(|entity| before.slots_of(entity).contains(&slot));
        let expected = (0..=8).filter(|&slot| has(slot)).max().map(|slot| u64::try_from(slot).unwrap());
        assert_eq!(after, expected, "cut at {kept}");
        afters.insert(after);
    }
    assert_eq!(afters, BTreeSet::from([None, Some(2), Some(5), Some(8)]), "the cuts cover every part");
}

#[test]
fn a_slot_is_whole_only_if_everything_of_it_was_written() {
    for scenario in [letter(), town()] {
        let (_folder, path) = place();
        in_parts(&path, &scenario);
        let (bytes, whole) = (fs::read(&path).unwrap(), Chunks::of(&path));
        for entity in whole.entities().filter(|entity| whole.slots_of(entity).len() == 9) {
            fs::write(&path, &bytes).unwrap();
            leave_out(&path, &entity, 8);
            assert_eq!(go_on(&path, &scenario, []), Some(5), "without the end of {entity}");
        }
    }
}

#[test]
fn a_gap_begins_after_the_last_whole_slot_and_ends_with_the_next() {
    let (_folder, path) = place();
    in_parts(&path, &letter());
    // All of slots 6 to 8 but the last of the curves: they were written in part.
    leave_out(&path, "/metrics/missed_slots", 8);

    let mut scene = open(&path, &letter(), "x").unwrap();
    assert_eq!(scene.continued_after(), Some(5));
    scene.log_missed(0..=19).unwrap(); // as somebody would say who knows nothing of the slots before
    assert_eq!(scene.missed_slots(), 14);
    log(&mut scene, 20..=21);
    scene.close().unwrap();
    let found = Found::read(&path);
    assert!(found.log().contains("slots 6 to 19 missed") && found.log().contains("14 slots missed"), "{}", found.log());
    let drawn = |slot| found.text(links::LINKS, "LineStrips3D:strips", Some(slot)).contains("Float32>");
    assert!(drawn(8) && !drawn(9), "what is known of a slot in the gap stays for that slot alone");
    let lane = |slot| found.text(events::LANE, "StateChange:state", Some(slot));
    assert!(lane(6).contains("gap") && lane(9).contains("gap") && lane(20).contains("serve"));
    let missed = found.curve(curves::MISSED);
    assert_eq!((missed[&5], missed.contains_key(&8), missed[&20], missed[&21]), (0.0, false, 14.0, 14.0));

    let mut scene = open(&path, &letter(), "x").unwrap();
    assert_eq!((scene.continued_after(), scene.missed_slots()), (Some(21), 14));
    scene.log_missed(22..=22).unwrap();
    log(&mut scene, [23]);
    scene.close().unwrap();
    assert_eq!(Found::read(&path).curve(curves::MISSED)[&23], 15.0);
}

/// Shows these slots, each with a path if `leads` says so.
fn log_with_path(scene: &mut Scene, slots: impl IntoIterator<Item = u64>, leads: impl Fn(u64) -> bool) {
    for slot in slots {
        let mut shown = Slot::new(slot, SENSORS as usize);
        if leads(slot) {
            shown.path = vec![[slot as f64, 50.0, 20.0].into(), [90.0, 9.0, 20.0].into()];
        }
        scene.log_slot(&shown.view()).unwrap();
    }
}

#[test]
fn a_path_is_not_left_over_from_the_process_before() {
    let (_folder, path) = place();
    let mut scene = open(&path, &letter(), "x").unwrap();
    log_with_path(&mut scene, 0..=5, |slot| slot >= 3);
    scene.close().unwrap();
    assert_eq!(go_on(&path, &letter(), 6..=8), Some(5), "the slots before the first path have none");
    let found = Found::read(&path);
    assert_tidy(&path, &found);
    let drawn = |slot| found.text(path::PATH, "LineStrips3D:strips", Some(slot)).contains("Float32>");
    assert_eq!(found.slots_of(path::PATH), (3..=8).collect());
    assert!(drawn(5) && !drawn(6) && !drawn(8));
}

#[test]
fn once_there_are_paths_a_slot_without_one_of_its_own_is_not_whole() {
    for entity in [path::PATH, path::STOPS, path::TRACK, path::TRACK_STOPS] {
        let (_folder, path) = place();
        for slots in [0..=5, 6..=8] {
            let mut scene = open(&path, &letter(), "x").unwrap();
            log_with_path(&mut scene, slots, |slot| slot == 3);
            scene.close().unwrap();
        }
        leave_out(&path, &format!("/{entity}"), 8);
        assert_eq!(go_on(&path, &letter(), []), Some(5), "without the end of {entity}");
    }
}

#[test]
fn a_slot_that_is_whole_is_not_written_again() {
    let (_folder, path) = place();
    in_parts(&path, &letter());
    go_on(&path, &letter(), 4..=10);
    let found = Found::read(&path);
    assert_tidy(&path, &found);
    assert_eq!(found.slots_of(uav::UAV), (0..=10).collect());
    assert!(found.log().contains("end after slot 10 of 600"));
}

#[test]
fn a_file_without_a_recording_of_this_program_is_replaced() {
    let (_folder, path) = place();
    let other = rerun::RecordingStreamBuilder::new("other").enabled(true).save(&path).unwrap();
    other.log_static("x", &rerun::Points3D::new([[0.0; 3]])).unwrap();
    drop(other);
    let other = fs::read(&path).unwrap();
    let zeros = [0; 1_000];
    for content in [&b""[..], b"R", b"RRF2", b"not a recording, but rather long", &zeros, &other] {
        fs::write(&path, content).unwrap();
        assert_eq!(go_on(&path, &letter(), 0..=1), None);
        let found = Found::read(&path);
        assert_tidy(&path, &found);
        assert_eq!(recording(&path), "another name");
        assert!(found.log().contains("held no recording") && found.log().contains("start of mission"));
    }
}

#[test]
fn what_follows_the_last_message_does_no_harm() {
    let (_folder, path) = place();
    in_parts(&path, &letter());
    let (whole, expected) = (fs::read(&path).unwrap(), Found::read(&path));
    let footer = whole.len() - 5_000;
    for (kept, tail) in [(whole.len(), 0), (whole.len(), 7), (footer, 0), (footer, 0xff), (whole.len() / 2, 0)] {
        let mut spoilt = whole[..kept].to_vec();
        spoilt.extend(std::iter::repeat_n(tail, 9_999));
        fs::write(&path, spoilt).unwrap();
        go_on(&path, &letter(), []);
        let found = Found::read(&path);
        let shown = expected.shown();
        assert!(found.shown().iter().all(|(cell, values)| shown[cell] == *values));
        assert!(kept < footer || found.shown() == shown, "{kept} bytes and {tail}");
        recording(&path);
    }
}

#[test]
fn a_live_viewer_does_not_keep_a_recording_from_being_continued() {
    let (_folder, path) = place();
    in_parts(&path, &letter());
    let sinks = Sinks { save: Some(path.clone()), existing: Existing::Continue, live: Some(0) };
    let mut scene = Scene::open(&sinks, &letter(), &sensors(SENSORS), "x", Timing::Unmeasured).unwrap();
    assert_eq!(scene.continued_after(), Some(8));
    log(&mut scene, [9]);
    scene.close().unwrap();
    assert_eq!(recording(&path), "first name");
    assert_eq!(Found::read(&path).slots_of(uav::UAV), (0..=9).collect());
}

#[test]
fn a_recording_that_cannot_be_taken_over_stays_as_it_is() {
    let (folder, path) = place();
    in_parts(&path, &letter());
    let whole = fs::read(&path).unwrap();
    fs::create_dir(folder.path().join(".mission.rrd.part")).unwrap();
    let refusal = open(&path, &letter(), "x").err().unwrap().to_string();
    assert!(refusal.contains("mission.rrd: ") && !refusal.contains('\n'), "{refusal}");
    assert!(fs::read(&path).unwrap() == whole);
}

#[test]
fn the_rest_of_a_take_over_is_overwritten_and_a_link_stays_one() {
    let (folder, path) = place();
    in_parts(&path, &letter());
    let whole = fs::read(&path).unwrap();
    let link = folder.path().join("link.rrd");
    std::os::unix::fs::symlink(&path, &link).unwrap();
    for rest in [&b""[..], b"RRF2", &whole[..whole.len() / 3], &whole] {
        fs::write(folder.path().join(".mission.rrd.part"), rest).unwrap();
        assert_eq!(go_on(&link, &letter(), []), Some(8));
        assert!(link.is_symlink() && !folder.path().join(".mission.rrd.part").exists());
        assert_eq!(Found::read(&path).slots_of(uav::UAV), (0..=8).collect());
    }
}

#[test]
fn an_event_of_any_slot_leaves_the_others_where_they_are() {
    let (_folder, path) = place();
    let mut scene = open(&path, &letter(), "x").unwrap();
    for slot in 0..=3 {
        scene.log_event(500 - slot, Level::Error, "late").unwrap();
        log(&mut scene, [slot]);
    }
    scene.close().unwrap();
    let found = Found::read(&path);
    assert_eq!(found.slots_of(uav::UAV), (0..=3).collect());
    assert_eq!(found.text(events::LOG, "TextLog:text", Some(498)).matches("late").count(), 1);
}
