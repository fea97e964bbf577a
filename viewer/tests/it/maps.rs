//! Recorded maps: losses, coverage, and estimated queues.

use std::path::Path;

use crate::support::{Found, Slot, files, letter, sensors};
use skysink_common::checkpoint::Checkpoint;
use skysink_common::estimate::Rates;
use skysink_viewer::{Scene, Sinks, WallClock, belief, events, legend, maps, queues};

/// Sensor nodes with buffers of 1 000 bits that sample 100 bits per slot.
const SENSORS: u32 = 3;

/// Records slots 0 to `last` of the letter's mission, each changed by `change` before.
fn record(last: u64, estimated: Option<Rates>, change: impl Fn(&mut Slot)) -> Found {
    record_slots(0..=last, estimated, change)
}

fn record_slots(slots: impl Iterator<Item = u64>, estimated: Option<Rates>, change: impl Fn(&mut Slot)) -> Found {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mission.rrd");
    let mut scene = open(&path, SENSORS, estimated);
    for slot in slots {
        let mut slot = Slot::new(slot, SENSORS as usize);
        slot.header.totals.lost_bits = 0;
        change(&mut slot);
        scene.log_slot(&slot.view()).unwrap();
    }
    scene.close().unwrap();
    Found::read(&path)
}

fn open(path: &Path, count: u32, estimated: Option<Rates>) -> Scene {
    let sinks = Sinks { save: Some(path.to_owned()), ..Sinks::default() };
    Scene::open(&sinks, &letter(), &sensors(count), "maps", WallClock::Unmeasured, estimated).unwrap()
}

/// The steps that a map shows from a slot on, by sensor node; empty if nothing was logged.
fn steps(found: &Found, map: &str, slot: i64) -> Vec<u16> {
    numbers(&found.text(&format!("{map}/{}", maps::SHOWN), "Points2D:class_ids", Some(slot)))
}

fn numbers(text: &str) -> Vec<u16> {
    text.lines().filter_map(|line| line.trim_matches([' ', ',']).parse().ok()).collect()
}

#[test]
fn an_sn_that_loses_data_is_marked_in_the_slot_and_for_the_rest_of_the_mission() {
    // SN 1 is full from slot 1 on: 50 bits are lost in slot 1, 100 in each of slots 2 to 4; it is emptied in slot 4.
    let queues_bits = |slot: u64| [0, [950, 1_000, 1_000, 1_000, 0, 100][slot as usize], 500];
    let found = record(5, None, |slot| {
        slot.queues_bits = queues_bits(slot.slot).to_vec();
        slot.header.totals.lost_bits = [0, 50, 150, 250, 350, 350][slot.slot as usize];
    });
    let levels = |slot| numbers(&found.shown_in(queues::BARS, "Boxes3D:class_ids", slot));
    assert_eq!([0, 1, 4, 5].map(levels), [vec![0, 19, 10], vec![0, 21, 10], vec![0, 21, 10], vec![0, 2, 10]]);
    assert_eq!(found.slots_of_component(queues::LOST, "Points3D:positions"), [0, 1].into(), "none, then one");
    let status = |slot| found.text(events::STATUS, "TextDocument:text", Some(slot));
    assert!(
        status(0).contains("**0 of 3 SNs have lost data**, 0 lose some now, next full: SN 1 in 0 s"),
        "{}",
        status(0)
    );
    assert!(
        status(1).contains("**1 of 3 SNs have lost data**, 1 lose some now, next full: SN 2 in 5 s"),
        "{}",
        status(1)
    );
    assert!(
        status(5).contains("**1 of 3 SNs have lost data**, 0 lose some now, next full: SN 2 in 5 s"),
        "{}",
        status(5)
    );
}

#[test]
fn the_loss_map_shows_the_loss_of_each_sn() {
    let found = record(21, None, |slot| slot.queues_bits = vec![0, 1_000, 950]);
    assert_eq!(steps(&found, maps::LOSS, 0), [0, 0, 0]);
    assert_eq!(steps(&found, maps::LOSS, 1), [0, 1, 1]); // 100 and 50 bits, up to 1 kbit
    assert_eq!(steps(&found, maps::LOSS, 2), [0u16; 0], "nothing new");
    assert_eq!(steps(&found, maps::LOSS, 11), [0, 2, 1]); // 1 100 and 550 bits
    assert_eq!(steps(&found, maps::LOSS, 21), [0, 3, 2]); // 2 100 and 1 050 bits
    let names = found.text(&format!("{}/legend/names", maps::LOSS), "Points2D:labels", None);
    for name in ["nothing lost", "0 to 1 kbit", "1 to 2 kbit", "over 50 kbit"] {
        assert!(names.contains(name), "{name}: {names}");
    }
}

#[test]
fn the_overflow_map_shows_the_time_of_each_sn() {
    // 10 s to fill an empty buffer: steps end at 0, 0.2, 0.5, 1, 2, 5, 10 s.
    let found = record(1, None, |slot| slot.queues_bits = vec![1_000, 790, [0, 960][slot.slot as usize]]);
    assert_eq!(steps(&found, maps::OVERFLOW, 0), [0, 5, 6]); // full, 2.1 s, 10 s
    assert_eq!(steps(&found, maps::OVERFLOW, 1), [8, 5, 2]); // loses data, 2.1 s, 0.4 s
}

#[test]
fn a_loss_in_a_missed_slot_is_attributed_to_no_sn() {
    let found = record_slots([0, 1, 5].into_iter(), None, |slot| {
        slot.queues_bits = vec![1_000, 0, 0];
        slot.header.totals.lost_bits = 100 * slot.slot;
    });
    let status = found.text(events::STATUS, "TextDocument:text", Some(5));
    assert!(
        status.contains("**1 of 3 SNs have lost data** (400 bits in slots that the viewer did not see)"),
        "{status}"
    );
}

#[test]
fn coverage_is_an_image_that_is_drawn_every_tenth_slot() {
    let found = record(23, None, |_| {});
    let shown = format!("{}/{}", maps::COVERAGE, maps::SHOWN);
    assert_eq!(found.slots_of_component(&shown, "SegmentationImage:buffer"), [0, 10, 20].into());
    // The UAV flies east from (0, 50) by 1 m a slot; cells of 2.5 m, 40 in a row, row 20 is at y = 48.75 m. The steps
    // end at 0, 10, 20, 50, 100, 200, 500 s; 8 is never.
    let pixels = &found.bytes(&shown, "SegmentationImage:buffer", 20)[20 * 40..];
    assert_eq!(pixels[8], 0, "x = 21.25 m is in range of x = 20 m");
    assert_eq!(pixels[2], 1, "x = 6.25 m was so until slot 16");
    assert_eq!(pixels[0], 1, "x = 1.25 m until slot 11");
    assert_eq!(pixels[15], 8, "x = 38.75 m never");
}

#[test]
fn the_estimate_is_logged_only_if_queues_are_estimated() {
    let oracle = record(3, None, |_| {});
    for entity in [belief::BELIEVED, belief::TRUE, belief::ERROR] {
        assert!(oracle.cells.keys().all(|(name, ..)| !name.starts_with(&format!("/{entity}"))), "{entity}");
    }
    let page = |found: &Found| found.text(legend::PAGE, "TextDocument:text", None);
    assert!(!page(&oracle).contains("Belief and truth"));
    // The letter's queues begin with 10 000 bits in the mean, which fills these buffers: the error is what is free.
    let found =
        record(2, Some(Rates::Known), |slot| slot.queues_bits = vec![400, [400, 500, 0][slot.slot as usize], 990]);
    assert!(page(&found).contains("Belief and truth"));
    assert!(found.layout.values().flatten().any(|value| value.contains("Belief and truth")));
    assert_eq!(steps(&found, belief::BELIEVED, 0), [6, 6, 6], "all full");
    assert_eq!(steps(&found, belief::TRUE, 0), [2, 2, 5]);
    assert_eq!(steps(&found, belief::ERROR, 0), [8, 8, 4], "60 %, 60 % and 1 % too high");
    assert_eq!(found.curve(belief::LARGEST_ERROR)[&0], 0.6);
    assert!((found.curve(belief::MEAN_ERROR)[&0] - 1.21 / 3.0).abs() < 1e-12);
    // Slot t serves SN t: from then on it is known to the bit.
    assert_eq!(steps(&found, belief::ERROR, 1), [8, 4, 4]);
    assert_eq!(steps(&found, belief::BELIEVED, 1), [6, 3, 6]);
    assert!((found.curve(belief::MEAN_ERROR)[&1] - 0.61 / 3.0).abs() < 1e-12);
}

#[test]
fn no_estimate_is_drawn_without_the_first_slot() {
    let found = record_slots(5..=6, Some(Rates::Learnt), |_| {});
    assert!(found.slots_of(belief::MEAN_ERROR).is_empty());
    assert!(steps(&found, belief::BELIEVED, 5).is_empty());
}

/// The recording of the second of two viewers: the first shows `slots[0]`; the second restores its state and shows
/// `slots[1]`.
fn record_again(count: u32, slots: [std::ops::RangeInclusive<u64>; 2]) -> Found {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mission.rrd");
    let mut state = Vec::new();
    for slots in slots {
        let mut scene = open(&path, count, Some(Rates::Known));
        if !state.is_empty() {
            scene.restore(&state).unwrap();
        }
        for slot in slots {
            scene.log_slot(&Slot::new(slot, count as usize).view()).unwrap();
        }
        state.clear();
        scene.save(&mut state);
        scene.close().unwrap();
    }
    Found::read(files(&path).last().unwrap())
}

#[test]
fn a_restarted_viewer_draws_every_map_in_its_first_slot() {
    let found = record_again(2_001, [0..=3, 4..=12]);
    for map in [belief::BELIEVED, belief::TRUE, belief::ERROR, maps::LOSS, maps::OVERFLOW] {
        let drawn = found.slots_of_component(&format!("{map}/{}", maps::SHOWN), "Points2D:class_ids");
        assert_eq!(drawn.first(), Some(&4), "{map}");
        assert!(drawn.is_subset(&[4, 10].into()), "{map}: {drawn:?}");
    }
}

#[test]
fn a_restarted_viewer_without_saved_state_draws_no_estimate() {
    let found = record_again(SENSORS, [5..=6, 7..=8]);
    assert!(found.slots_of(belief::MEAN_ERROR).is_empty());
    assert!(steps(&found, belief::BELIEVED, 7).is_empty());
}

#[test]
fn large_fields_are_drawn_on_maps_every_tenth_slot() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mission.rrd");
    let mut scene = open(&path, 2_001, None);
    for slot in 0..=12 {
        let mut slot = Slot::new(slot, 2_001);
        slot.queues_bits[0] = u32::try_from(slot.slot * 80).unwrap();
        scene.log_slot(&slot.view()).unwrap();
    }
    scene.close().unwrap();
    let found = Found::read(&path);
    let shown = format!("{}/{}", maps::OVERFLOW, maps::SHOWN);
    assert_eq!(found.slots_of_component(&shown, "Points2D:class_ids"), [0, 10].into());
    assert_eq!(found.slots_of(maps::UAV).len(), 13);
    assert!(found.slots_of(queues::LOST).is_empty());
}
