//! Recordings in several files, each written by a restarted viewer.

use crate::support;
use std::collections::BTreeSet;
use std::fs;
use std::io::BufReader;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use crate::chunks::{Chunks, recording};
use crate::support::{Found, Slot, files, letter, sensors, town};
use re_build_info::CrateVersion;
use re_log_encoding::rrd::EncodingOptions;
use re_log_encoding::{DecoderApp, Encoder};
use re_sdk::EntityPath;
use re_sdk::log::{Chunk, LogMsg};
use skysink_common::checkpoint::Checkpoint;
use skysink_common::estimate::Rates;
use skysink_common::message::PathPoint;
use skysink_common::scenario::Scenario;
use skysink_viewer::{Scene, Sinks, WallClock, complete, curves, events, has_footer, links, path, queues, uav};

const SENSORS: u32 = 30;

fn open(first: &Path, scenario: &Scenario, name: &str) -> Scene {
    let sinks = Sinks { save: Some(first.to_owned()), ..Sinks::default() };
    Scene::open(&sinks, scenario, &sensors(SENSORS), name, WallClock::Unmeasured, None).unwrap()
}

/// Slots with these numbers.
fn plain(numbers: impl IntoIterator<Item = u64>) -> impl Iterator<Item = Slot> {
    numbers.into_iter().map(|slot| Slot::new(slot, SENSORS as usize))
}

/// Records these slots into the next file.
fn write(first: &Path, scenario: &Scenario, name: &str, slots: impl IntoIterator<Item = Slot>) {
    let mut scene = open(first, scenario, name);
    slots.into_iter().for_each(|slot| scene.log_slot(&slot.view()).unwrap());
    scene.close().unwrap();
}

/// The same, and what is in the file.
fn record(first: &Path, scenario: &Scenario, name: &str, slots: impl IntoIterator<Item = Slot>) -> Found {
    write(first, scenario, name, slots);
    Found::read(files(first).last().unwrap())
}

/// Records these slots into the next file, from the state that the scene before it saved, and saves its own.
fn resume(first: &Path, scenario: &Scenario, name: &str, slots: RangeInclusive<u64>, state: &mut Vec<u8>) -> Found {
    let sinks = Sinks { save: Some(first.to_owned()), ..Sinks::default() };
    let rates = Some(Rates::Learnt);
    let mut scene = Scene::open(&sinks, scenario, &sensors(SENSORS), name, WallClock::Unmeasured, rates).unwrap();
    if !state.is_empty() {
        scene.restore(state).unwrap();
    }
    for slot in slots {
        let mut slot = Slot::new(slot, SENSORS as usize);
        slot.queues_bits[3] = 1_000; // it loses 100 bits in every slot
        scene.log_slot(&slot.view()).unwrap();
    }
    state.clear();
    scene.save(state);
    assert!(state.len() <= Scene::state_room(SENSORS as usize));
    scene.close().unwrap();
    Found::read(files(first).last().unwrap())
}

/// A path for a recording, alone in a folder.
fn place() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let first = folder.path().join("mission.rrd");
    (folder, first)
}

fn names(first: &Path) -> Vec<String> {
    files(first).iter().map(|path| path.file_name().unwrap().to_str().unwrap().to_owned()).collect()
}

#[test]
fn each_viewer_writes_the_next_file_of_one_recording() {
    for scenario in [letter(), town()] {
        let ((_folder, first), (_other, alone)) = (place(), place());
        let mut state = Vec::new();
        let parts = [(0..=2, "first name"), (3..=5, "second name"), (6..=8, "third name")]
            .map(|(slots, name)| resume(&first, &scenario, name, slots, &mut state));
        let whole = resume(&alone, &scenario, "first name", 0..=8, &mut Vec::new());
        assert!(whole.text(events::STATUS, "TextDocument:text", Some(8)).contains("1 of 30 SNs have lost data"));
        assert_eq!(names(&first), ["mission.rrd", "mission-2.rrd", "mission-3.rrd"]);
        assert_eq!(BTreeSet::from_iter(files(&first).iter().map(|file| recording(file))).len(), 1);
        assert_eq!(recording(&first), "first name");
        let is_static = |cell: &&support::Cell| cell.2.is_none();
        for part in &parts {
            assert_eq!(part.layout, whole.layout);
            let [found, expected] =
                [part, &whole].map(|found| found.cells.iter().filter(|(cell, _)| is_static(cell)).collect::<Vec<_>>());
            assert_eq!(found, expected, "each part can be shown alone");
        }
        // The path between the last slot of one file and the first of the next is unknown, and with it the speed; the
        // state lane restarts.
        let is_other = |cell: &support::Cell| {
            let labels = [uav::LABEL, uav::LABELS_ABOVE];
            let moves = [uav::TRAIL, uav::TRACK, uav::BODY, uav::PLAN, events::LANE];
            moves.into_iter().chain(labels).any(|entity| entity == &cell.0[1..]) && [3, 6].contains(&cell.2.unwrap())
        };
        let in_parts: Vec<_> = parts.iter().map(Found::shown).collect();
        for (cell, values) in whole.shown().into_iter().filter(|(cell, _)| !is_other(cell)) {
            let found: Vec<_> = in_parts.iter().filter_map(|part| part.get(cell).copied()).collect();
            assert_eq!(found, [values], "{cell:?}: once, and as in one piece");
        }
    }
}

#[test]
fn the_log_contains_start_and_first_loss_once() {
    let (_folder, first) = place();
    let parts = [0..=2, 3..=5].map(|slots| record(&first, &letter(), "x", plain(slots)).log());
    let [begin, rest] = parts;
    assert!(begin.contains("start of mission letter") && begin.contains("first loss, 1 bits"), "{begin}");
    assert!(rest.contains("recording continued in a new file") && rest.contains("end after slot 5 of 600"), "{rest}");
    assert!(!rest.contains("start of mission") && !rest.contains("first loss"), "{rest}");
}

#[test]
fn a_first_loss_in_the_first_slot_of_a_later_file_is_logged() {
    let (_folder, first) = place();
    write(&first, &letter(), "x", plain([0]));
    let mut slot = Slot::new(1, SENSORS as usize);
    slot.header.lost_bits = slot.header.totals.lost_bits;
    assert!(record(&first, &letter(), "x", [slot]).log().contains("first loss, 1 bits"));
}

#[test]
fn slots_between_two_files_are_marked_and_counted_in_the_later_one() {
    let (_folder, first) = place();
    write(&first, &letter(), "x", plain(0..=5));
    let mut scene = open(&first, &letter(), "x");
    scene.log_missed(6..=19).unwrap();
    for slot in [20, 21, 25] {
        if slot == 25 {
            scene.log_missed(22..=24).unwrap();
        }
        scene.log_slot(&Slot::new(slot, SENSORS as usize).view()).unwrap();
    }
    scene.close().unwrap();
    let found = Found::read(files(&first).last().unwrap());
    for line in ["recording continued", "slots 6 to 19 missed", "17 slots missed"] {
        assert!(found.log().contains(line), "{line}: {}", found.log());
    }
    let lane = |slot| found.text(events::LANE, "StateChange:state", Some(slot));
    assert!(lane(6).contains("gap") && lane(20).contains("serve") && lane(22).contains("gap"));
    let drawn = |slot| found.text(links::LINKS, "LineStrips3D:strips", Some(slot)).contains("Float32>");
    assert!(!drawn(6) && drawn(20), "no links of the earlier file are left in the gap");
    let missed: Vec<_> = found.curve(curves::MISSED).into_iter().collect();
    assert_eq!(missed, [(20, 14.0), (25, 17.0)], "a point where it changes");
}

#[test]
fn a_path_of_an_earlier_file_is_cleared() {
    let (_folder, first) = place();
    let leading = (0..=5).map(|slot| {
        let point = |x_m, y_m| PathPoint { x_m, y_m, z_m: 20.0, ..PathPoint::default() };
        let path = vec![point(slot as f64, 50.0), point(90.0, 9.0)];
        Slot { path, ..Slot::new(slot, SENSORS as usize) }
    });
    write(&first, &letter(), "x", leading);
    let found = record(&first, &letter(), "x", plain(6..=8));
    assert_eq!(found.slots_of(path::PATH), [6].into(), "empty from there on");
    assert!(!found.text(path::PATH, "LineStrips3D:strips", Some(6)).contains("Float32>"));
}

#[test]
fn a_truncated_file_is_kept_and_its_recording_continued() {
    let (_folder, first) = place();
    write(&first, &letter(), "the recording", plain(0..=2));
    let bytes = fs::read(&first).unwrap();
    let mut ids = Vec::new();
    for kept in (1..bytes.len()).step_by(bytes.len() / 8) {
        let _ = fs::remove_file(first.with_file_name("mission-2.rrd"));
        fs::write(&first, &bytes[..kept]).unwrap();
        open(&first, &letter(), "another").close().unwrap();
        assert!(fs::read(&first).unwrap() == bytes[..kept], "cut at {kept}");
        ids.push(recording(&first.with_file_name("mission-2.rrd")));
    }
    let (begun, rest) = ids.split_first().unwrap();
    assert_eq!(begun, "another", "of one byte nothing is known");
    assert!(rest.iter().all(|id| id == "the recording"), "{rest:?}");
}

#[test]
fn a_file_without_a_recording_of_this_application_is_not_changed() {
    let (folder, other) = place();
    let stream = re_sdk::RecordingStreamBuilder::new("other").enabled(true).save(&other).unwrap();
    stream.log_static("x", &re_sdk_types::archetypes::Points3D::new([[0.0; 3]])).unwrap();
    drop(stream);
    let first = folder.path().join("first.rrd");
    let zeros = [0; 1_000];
    for content in [&b"R"[..], b"RRF2", b"not a recording, but rather long", &zeros, &fs::read(&other).unwrap()] {
        fs::write(&first, content).unwrap();
        let found = record(&first, &letter(), "the recording", plain(0..=1));
        assert!(found.log().contains("start of mission"), "{}", found.log());
        assert_eq!(recording(&first.with_file_name("first-2.rrd")), "the recording");
        assert!(fs::read(&first).unwrap() == content);
        fs::remove_file(first.with_file_name("first-2.rrd")).unwrap();
    }
}

#[test]
fn a_file_truncated_in_a_batch_is_completed_to_the_previous_batch() {
    let (_folder, first) = place();
    let sinks = Sinks { save: Some(first.clone()), live: Some(0), ..Sinks::default() }; // batches in quick succession
    let mut scene = Scene::open(&sinks, &letter(), &sensors(SENSORS), "x", WallClock::Unmeasured, None).unwrap();
    let mut ends = BTreeSet::new();
    for slot in plain(0..=60) {
        scene.log_slot(&slot.view()).unwrap();
        std::thread::sleep(std::time::Duration::from_millis(10)); // batches are timed
        ends.insert(fs::metadata(&first).unwrap().len());
    }
    scene.close().unwrap();
    ends.remove(&0);
    assert!(ends.len() > 2, "{ends:?}");
    let whole = Found::read(&first);
    let entities: Vec<_> = [uav::UAV, curves::LOSS, queues::BARS].into();
    assert!(entities.iter().all(|entity| whole.slots_of(entity) == (0..=60).collect()));
    let bytes = fs::read(&first).unwrap();
    let begun = usize::try_from(*ends.first().unwrap()).unwrap();
    let mut written = Vec::new(); // slots that all entities have up to the ends of batches
    for end in ends {
        let end = usize::try_from(end).unwrap();
        fs::write(&first, &bytes[..end]).unwrap();
        let timed = Chunks::of(&first).timed;
        let slots_of =
            |of: &&str| timed.values().filter(|(entity, _)| entity == of).map(|(_, slots)| slots.len()).sum();
        written.push((end, entities.iter().map(slots_of).min().unwrap()));
    }
    let mut lengths = BTreeSet::new();
    for cut in (begun..bytes.len()).step_by((bytes.len() - begun) / 40) {
        fs::write(&first, &bytes[..cut]).unwrap();
        complete(&first).unwrap();
        assert!(has_footer(&first).unwrap());
        assert_eq!(recording(&first), "x");
        let found = Found::read(&first);
        let slots = found.slots_of(entities[0]);
        assert!(entities.iter().all(|entity| found.slots_of(entity) == slots), "cut at {cut}");
        assert_eq!(slots, (0..slots.len() as i64).collect());
        let (_, complete): &(_, usize) = written.iter().rfind(|(end, _)| *end <= cut).unwrap();
        assert!(slots.len() >= *complete, "cut at {cut}: {} of {complete} written slots", slots.len());
        lengths.insert(slots.len());
    }
    assert!(lengths.len() > 2, "{lengths:?}");
}

/// Whether a message names the recording.
fn is_name(message: &LogMsg) -> bool {
    let LogMsg::ArrowMsg(store, message) = message else { return false };
    store.is_recording() && *Chunk::from_arrow_msg(message).unwrap().entity_path() == EntityPath::properties()
}

#[test]
fn a_recording_of_an_earlier_version_keeps_all_slots() {
    let (_folder, first) = place();
    write(&first, &letter(), "x", plain(0..=60));
    let whole = Found::read(&first);
    let reader = BufReader::new(fs::File::open(&first).unwrap());
    let (names, rest): (Vec<_>, Vec<_>) = DecoderApp::decode_lazy(reader).map(Result::unwrap).partition(is_name);
    assert!(names.len() > 1, "each batch ends with the name");
    let is_drawn = |message: &LogMsg| matches!(message, LogMsg::ArrowMsg(store, _) if store.is_recording());
    let begin = rest.iter().position(is_drawn).unwrap();
    for at in [begin, begin + 5] {
        let mut messages = rest.clone();
        messages.insert(at, names[0].clone());
        let mut encoder =
            Encoder::new_eager(CrateVersion::LOCAL, EncodingOptions::PROTOBUF_COMPRESSED, Vec::new()).unwrap();
        for message in &messages {
            encoder.append(message).unwrap();
        }
        encoder.do_not_emit_footer();
        encoder.flush_blocking().unwrap();
        fs::write(&first, encoder.into_inner().unwrap()).unwrap();
        complete(&first).unwrap();
        assert!(has_footer(&first).unwrap());
        for entity in [uav::UAV, curves::LOSS, queues::BARS] {
            assert_eq!(Found::read(&first).slots_of(entity), whole.slots_of(entity), "{entity}");
        }
    }
}

#[test]
fn leftovers_of_a_viewer_killed_at_its_start_are_removed() {
    let (folder, first) = place();
    write(&first, &letter(), "x", plain(0..=1));
    let path = |name: &str| folder.path().join(name);
    for name in [".mission.rrd.a1.new", ".mission.rrd.b2.new", ".notes.md.a1.new"] {
        fs::write(path(name), "half").unwrap();
    }
    let begun = fs::File::open(path(".mission.rrd.b2.new")).unwrap();
    begun.lock().unwrap(); // by a viewer that is about to rename it
    complete(&first).unwrap();
    assert!(!path(".mission.rrd.a1.new").exists());
    assert!(path(".mission.rrd.b2.new").exists() && path(".notes.md.a1.new").exists());
}

#[test]
fn a_skipped_empty_file_is_completed() {
    let (folder, first) = place();
    fs::write(&first, "").unwrap();
    let dying = fs::File::open(&first).unwrap();
    dying.lock().unwrap(); // by a viewer whose launcher was killed, and which is killed, too
    write(&first, &letter(), "x", plain(0..=1));
    drop(dying);
    complete(&first).unwrap();
    let second = folder.path().join("mission-2.rrd");
    assert!(has_footer(&first).unwrap() && has_footer(&second).unwrap());
    assert_eq!(Found::read(&second).slots_of(uav::UAV).len(), 2);
}

#[test]
fn an_empty_file_is_reused() {
    let (_folder, first) = place();
    fs::write(&first, "").unwrap();
    write(&first, &letter(), "x", plain(0..=1));
    assert_eq!(names(&first), ["mission.rrd"]);
}

#[test]
fn a_live_viewer_continues_a_recording_in_the_next_file() {
    let (_folder, first) = place();
    write(&first, &letter(), "first name", plain(0..=8));
    let sinks = Sinks { save: Some(first.clone()), live: Some(0), ..Sinks::default() };
    let mut scene = Scene::open(&sinks, &letter(), &sensors(SENSORS), "x", WallClock::Unmeasured, None).unwrap();
    scene.log_slot(&Slot::new(9, SENSORS as usize).view()).unwrap();
    scene.close().unwrap();
    let second = first.with_file_name("mission-2.rrd");
    assert_eq!(recording(&second), "first name");
    assert_eq!(Found::read(&second).slots_of(uav::UAV), BTreeSet::from([9]));
}

#[test]
fn each_scenario_and_strategy_has_its_own_application_id() {
    let (_folder, first) = place();
    let application = |name: &str, strategy: &str| {
        let mut scenario = letter();
        name.clone_into(&mut scenario.name);
        strategy.clone_into(&mut scenario.planner.strategy);
        let _ = fs::remove_file(&first);
        write(&first, &scenario, "the recording", plain(0..=1));
        let mut messages = DecoderApp::decode_lazy(BufReader::new(fs::File::open(&first).unwrap()));
        messages.next().unwrap().unwrap().store_id().application_id().as_str().to_owned()
    };
    assert_eq!(application("letter", "uts"), "skysink-letter-uts");
    assert_eq!(application("letter", "gfs"), "skysink-letter-gfs");
    assert_eq!(application("a.b", "mine_2"), "skysink-a-b-mine-2");
}
