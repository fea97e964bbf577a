//! Planners that send no plans any more, in paced runs, in which no process waits for them.

use skysink_common::message::{Mode, Plan, SlotHeader};

use super::audit::audit;
use super::intruder::{Intruder, send_list};
use super::rogue::{LONG_S, open_folder, start_with_rogue};
use crate::events;
use crate::support::{Place, until};

/// Fails unless the planner has an event that starts so and one that ends so.
fn assert_event(place: &Place, start: &str, end: &str) {
    let is_it =
        |(process, event): &(String, String)| process == "planner" && event.starts_with(start) && event.ends_with(end);
    let events = events(place);
    assert!(events.iter().any(is_it), "{start} ... {end}: {events:?}");
}

#[test]
fn an_external_planner_that_hangs_in_a_paced_run_is_reported_and_recovers() {
    let place = Place::new();
    let (run, mut rogue) = start_with_rogue(&place.flight("smoke").pace("10x"), LONG_S);
    for _ in 0..10 {
        let turn = rogue.next().unwrap();
        rogue.send(rogue.header(turn.slot), turn.good);
    }
    run.until_printed("planner has sent no sample for 1.");
    run.until_printed("slots in a row: the UAV held");
    rogue.fly_to_end(|_, _| {});
    run.wait_for_success();
    drop(rogue);
    audit(&place);
    assert_event(&place, "has sent no sample for 1.", " s");
    assert_event(&place, "has sent no plan in time for ", " slots in a row: the UAV held");
    assert_event(&place, "recovered after ", " s");
    let summary = place.summary("run");
    assert_eq!(summary["timing"]["missed_deadlines"], summary["held_slots"]);
    assert!(summary["held_slots"].as_u64() >= Some(10), "{summary}");
    place.assert_clean();
}

#[test]
fn a_planner_command_that_hangs_in_a_paced_run_is_killed_and_started_again() {
    let place = Place::new();
    // The command itself never plans, and sends no heartbeat; the test sends the plans of the first slots for it.
    let flight = place.flight("smoke").without_viewer().planner("sleep 1000").pace("10x").timeout("3");
    let run = flight.start();
    let folder = open_folder(&run);
    let intruder = Intruder::join(&folder);
    let plans = intruder.list_writer::<Plan, SlotHeader>("plan", 1);
    for slot in 1..=5 {
        let header = SlotHeader { mission: folder.terms().mission, slot: slot as u64, ..SlotHeader::default() };
        // Again and again: before the first slot, its readers may not be there yet.
        until("slot", || {
            send_list(&plans, header, &[Plan::fly_to([30.0, 30.0, 20.0], Mode::Serve)]);
            (run.slots() >= slot).then_some(())
        });
    }
    run.until_printed("planner has sent no sample for 1.");
    run.until_printed("planner was restarted (restart 1)");
    run.wait_for_success();
    drop((plans, intruder));
    audit(&place);
    assert_event(&place, "has sent no sample for 2.", " s"); // three quarters of the timeout
    assert_event(&place, "was killed by signal 9", "");
    place.assert_clean();
}
