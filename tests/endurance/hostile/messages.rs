//! Plans of another slot or run, and floods of plans.

use skysink_common::message::{Plan, SlotHeader};
use skysink_ring::folder::RingFolder;

use super::audit::{audit, said, trace};
use super::intruder::{Intruder, send_list};
use super::rogue::{LONG_S, Rogue, SHORT_S, Turn, start_with_rogue};
use crate::support::{Output, Place, output, until};

const OLD: &str = "its writer has already sent that slot or a later one";
const FAR: &str = "its slot is too far ahead";
const MISSION: &str = "it belongs to another run";
const UAVS: &str = "expected an element for each UAV";
const SECOND: &str = "another process is writing this topic already";

/// A plan that would be seen in the trace.
fn nobody(turn: &Turn) -> Plan {
    Plan { served: 0, ..turn.good }
}

/// Flies the smoke test with good plans; before each, `disturb` may send other samples, and returns how many of them
/// have to be refused. The trace must be that of a run without them.
fn fly_disturbed(place: &Place, mut disturb: impl FnMut(&Rogue, &Turn) -> u64) -> Output {
    let (run, mut rogue) = start_with_rogue(&place.flight("smoke"), LONG_S);
    let mut refused = 0;
    rogue.fly_to_end(|rogue, turn| refused += disturb(rogue, turn));
    let ended = run.wait_for_success();
    audit(place);
    place.assert_trace_as_simulated("run");
    let summary = place.summary("run");
    assert_eq!((&summary["refused_messages"], &summary["refused"]), (&refused.into(), &0.into()));
    place.assert_clean();
    ended
}

/// The powers of ten up to `count`: the refusals that are reported.
fn said_so_far(count: u64) -> Vec<String> {
    let powers = (0..=count.ilog10()).map(|power| 10u64.pow(power));
    powers.map(|power| if power == 1 { String::new() } else { format!(" ({power} so far)") }).collect()
}

fn assert_said(ended: &Output, refusal: &str, count: u64) {
    let lines = said(&ended.stderr, refusal);
    let powers = said_so_far(count);
    assert_eq!(lines.len(), powers.len(), "{count} times {refusal}: {ended:?}");
    for (line, so_far) in lines.iter().zip(powers) {
        assert!(
            line.starts_with("flight-sim: plan(") && line.ends_with(&format!("refused: {refusal}{so_far}")),
            "{line}"
        );
    }
}

#[test]
fn plans_of_distant_slots_are_refused_from_the_first_slot_on() {
    let place = Place::new();
    let ended = fly_disturbed(&place, |rogue, turn| {
        for slot in [turn.slot + 3, turn.slot + 1000, u64::MAX / 2, u64::MAX] {
            rogue.send(rogue.header(slot), nobody(turn));
        }
        4
    });
    assert_said(&ended, FAR, 240);
}

#[test]
fn plans_of_past_slots_are_refused() {
    let place = Place::new();
    let ended = fly_disturbed(&place, |rogue, turn| {
        let old = (0..turn.slot).rev().filter(|_| turn.slot > 1);
        old.map(|slot| rogue.send(rogue.header(slot), nobody(turn))).count() as u64
    });
    assert_said(&ended, OLD, (2..=60).sum());
}

#[test]
fn the_first_plan_of_a_slot_is_used() {
    let place = Place::new();
    let mut last: Option<SlotHeader> = None;
    let ended = fly_disturbed(&place, |rogue, turn| {
        let again = last.replace(rogue.header(turn.slot));
        again.into_iter().map(|header| rogue.send(header, nobody(turn))).count() as u64
    });
    assert_said(&ended, OLD, 59);
}

#[test]
fn plans_for_no_uav_or_for_two_are_refused() {
    let place = Place::new();
    let ended = fly_disturbed(&place, |rogue, turn| {
        for count in [0, 2] {
            rogue.send_list(rogue.header(turn.slot), &vec![nobody(turn); count]);
        }
        2
    });
    assert_said(&ended, UAVS, 120);
}

#[test]
fn plans_of_another_mission_are_refused() {
    let place = Place::new();
    let ended = fly_disturbed(&place, |rogue, turn| {
        for mission in [0, u64::MAX, rogue.ring.terms.mission ^ 1] {
            rogue.send(SlotHeader { mission, ..rogue.header(turn.slot) }, nobody(turn));
        }
        3
    });
    assert_said(&ended, MISSION, 180);
}

#[test]
fn a_flood_of_ten_thousand_plans_is_counted_in_full_and_reported_five_times() {
    let place = Place::new();
    let ended = fly_disturbed(&place, |rogue, turn| {
        let flood = if turn.slot == 30 { 10_000 } else { 0 };
        for _ in 0..flood {
            rogue.send(rogue.header(turn.slot - 1), nobody(turn));
        }
        flood
    });
    assert_said(&ended, OLD, 10_000);
}

#[test]
fn header_restart_counts_flags_and_times_do_not_change_the_trace() {
    let place = Place::new();
    let (run, mut rogue) = start_with_rogue(&place.flight("smoke"), LONG_S);
    while let Some(turn) = rogue.next() {
        let flags = (turn.slot % 4) as u32;
        let header = SlotHeader { epoch: u32::MAX, flags, sent_ns: u64::MAX, ..rogue.header(turn.slot) };
        rogue.send(header, turn.good);
    }
    run.wait_for_success();
    place.assert_trace_as_simulated("run");
    assert_eq!(place.summary("run")["refused_messages"], 0);
}

#[test]
fn a_mission_of_another_ring_of_the_same_user_is_another_mission() {
    let place = Place::new();
    let smoke = place.flight("smoke").without_viewer();
    let other = smoke.seed(2).external("planner").out("other").start();
    other.until_topics();
    let terms = RingFolder::open(&other.folder()).unwrap().terms();

    let run = smoke.external("planner").start();
    let mut rogue = Rogue::join(&run);
    assert_ne!(rogue.ring.terms.mission, terms.mission);
    rogue.fly_to_end(|rogue, turn| {
        rogue.send(SlotHeader { mission: terms.mission, ..rogue.header(turn.slot) }, nobody(turn));
    });
    let ended = run.wait_for_success();
    place.assert_trace_as_simulated("run");
    assert_eq!(place.summary("run")["refused_messages"], 60);
    assert_said(&ended, MISSION, 60);

    output(other.worker_command("planner")).assert_success();
    other.wait_for_success();
    assert_eq!(place.summary("other")["refused_messages"], 0, "the other ring has heard of nothing");
    place.assert_clean();
}

#[test]
fn a_skipped_slot_ends_a_lock_step_run_by_its_timeout() {
    let place = Place::new();
    let (run, mut rogue) = start_with_rogue(&place.flight("smoke"), SHORT_S);
    while let Some(turn) = rogue.next() {
        let skipped = u64::from(turn.slot == 20);
        rogue.send(rogue.header(turn.slot + skipped), turn.good);
        if skipped > 0 {
            rogue.send(rogue.header(turn.slot), turn.good); // now it is too late
            break;
        }
    }
    let ended = run.wait().assert_code(1);
    assert!(ended.stderr.contains("skysink: planner has not sent plan("), "{ended:?}");
    assert_eq!(said(&ended.stderr, OLD).len(), 1, "{ended:?}");
    assert_eq!(audit(&place).len(), 19);
    assert_eq!(place.summary("run")["complete"], false);
    drop(rogue);
    place.assert_clean();
}

#[test]
fn a_skipped_slot_of_a_paced_run_is_a_hold() {
    let place = Place::new();
    let (run, mut rogue) = start_with_rogue(&place.flight("smoke").set("slots", 12).pace("5x"), LONG_S);
    while let Some(turn) = rogue.next() {
        if turn.slot != 6 {
            rogue.send(rogue.header(turn.slot), turn.good);
        }
    }
    run.wait_for_success();
    let lines = audit(&place);
    assert_eq!((lines.len(), lines[5].mode.as_str(), lines[5].refused), (12, "hold", 0));
    let held = lines.iter().filter(|line| line.mode == "hold").count();
    assert_eq!(place.summary("run")["timing"]["missed_deadlines"], held);
}

#[test]
fn an_intruder_that_writes_before_the_planner_is_named_when_the_run_times_out() {
    let place = Place::new();
    let (run, mut rogue) = start_with_rogue(&place.flight("smoke"), SHORT_S);
    let turn = rogue.next().unwrap();
    let intruder = Intruder::join(&rogue.folder).list_writer("plan", 1);
    send_list(&intruder, rogue.header(1), &[turn.good]);
    until("flight of slot 1", || (!trace(&place).is_empty()).then_some(()));
    rogue.send(rogue.header(1), turn.good);
    let turn = rogue.next().unwrap();
    rogue.send(rogue.header(2), turn.good);
    let ended = run.wait().assert_code(1);
    assert!(!said(&ended.stderr, SECOND).is_empty(), "{ended:?}");
    assert!(ended.stderr.contains("skysink: planner has not sent plan("), "{ended:?}");
    assert_eq!(audit(&place).len(), 1);
}
