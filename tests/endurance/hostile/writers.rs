//! Second writers of the ring's topics, without the lock of a role.

use skysink_common::message::{
    Commit, FLAG_END, FlightReport, Mode, NodeAnswer, Plan, QueuesHeader, SlotHeader, Totals,
};

use super::audit::{audit, said, trace};
use super::intruder::{Intruder, send, send_list};
use super::rogue::{LONG_S, SHORT_S, open_folder, start_with_rogue};
use crate::support::{Place, output, until, wait};

const SECOND: &str = "another process is writing this topic already";

/// A plan that would be seen in the trace.
fn forged_plan() -> Plan {
    Plan::fly_to([50.0, 50.0, 20.0], Mode::Serve)
}

#[test]
fn second_writers_are_refused_on_every_topic_and_in_every_slot() {
    let place = Place::new();
    let (run, mut rogue) = start_with_rogue(&place.flight("smoke"), LONG_S);
    let intruder = Intruder::join(&rogue.folder);
    let plans = intruder.list_writer::<Plan, SlotHeader>("plan", 2);
    let flights = intruder.list_writer::<FlightReport, SlotHeader>("flight", 2);
    let queues = intruder.list_writer::<u32, QueuesHeader>("queues", 100);
    let commits = intruder.writer::<Commit, SlotHeader>("commit");
    let mut sent = 0;
    rogue.fly_to_end(|rogue, turn| {
        if turn.slot <= 5 {
            return; // everybody hears the real ones first
        }
        let head = SlotHeader { flags: FLAG_END, ..rogue.header(turn.slot) };
        let flight = FlightReport { served: 64, ..FlightReport::at([1.0, 1.0, 20.0], Mode::Serve) };
        let totals = Totals { delivered_bits: u64::MAX, ..Totals::default() };
        let forged = QueuesHeader { head, totals, delivered_bits: u64::MAX, lost_bits: 0 };
        for uavs in 0..=2 {
            send_list(&plans, head, &vec![forged_plan(); uavs]);
            send_list(&flights, head, &vec![flight; uavs]);
            send_list(&queues, forged, &vec![u32::MAX; 40 * uavs]);
            send(&commits, head, Commit { hash: 1 });
            sent += 3; // the recorder does not read its own commits
        }
    });
    let ended = run.wait_for_success();
    audit(&place);
    place.assert_trace_as_simulated("run");
    // In the last slot the real ones may have ended before the recorder reads the refused samples.
    let refused = place.summary("run")["refused_messages"].as_u64().unwrap();
    assert!((sent - 9..=sent).contains(&refused), "{refused} of {sent}");
    let lines = said(&ended.stderr, SECOND);
    for first in ["flight-sim: ", "field-sim: "] {
        let first = lines.iter().find(|line| line.starts_with(first)).expect("a line of each process that refused");
        assert!(first.ends_with(&format!("(6) refused: {SECOND}")), "{first}");
    }
    drop((plans, flights, queues, commits, intruder, rogue));
    place.assert_clean();
}

#[test]
fn forged_answers_are_refused() {
    let place = Place::new();
    let batteries = place.flight("smoke").set("sensors.energy.capacity_j", 5.0).set("sensors.energy.sleep_w", 0.1);
    let (run, mut rogue) = start_with_rogue(&batteries, LONG_S);
    let intruder = Intruder::join(&rogue.folder);
    let answers = intruder.list_writer::<NodeAnswer, SlotHeader>("answers", 100);
    let mut real = rogue.ring.answers.as_ref().unwrap().reader().unwrap();
    let mut seen = [false; 3];
    rogue.fly_to_end(|rogue, turn| {
        while let Some(sample) = real.next_sample().unwrap() {
            assert_eq!(sample.payload().len(), 40);
            sample.payload().iter().for_each(|node| seen[node.answer as usize] = true);
        }
        if turn.slot > 5 {
            for (count, answer) in [(40, 7), (40, 2), (39, 0), (0, 0)] {
                send_list(&answers, rogue.header(turn.slot), &vec![NodeAnswer { answer, known: answer }; count]);
            }
        }
    });
    run.wait_for_success();
    audit(&place);
    place.assert_trace_as_simulated("run");
    assert_eq!(seen, [true, false, true], "SNs live, and die");
    drop((answers, real, intruder, rogue));
    place.assert_clean();
}

#[test]
fn a_flooding_second_planner_does_not_disturb_the_first() {
    let place = Place::new();
    let long = place.flight("long").without_viewer();
    let mut run = long.start();
    let folder = open_folder(&run);
    run.until_slot(5);
    let intruder = Intruder::join(&folder);
    let plans = intruder.list_writer::<Plan, SlotHeader>("plan", 2);
    until("end of the run", || {
        let slot = run.slots() as u64;
        for i in 0..256 {
            let header = SlotHeader { mission: folder.terms().mission, slot: slot + i % 3, ..SlotHeader::default() };
            send_list(&plans, header, &[forged_plan()]);
        }
        run.has_ended().then_some(())
    });
    let ended = run.wait_for_success();
    place.assert_trace_as_simulated("run");
    assert!(place.summary("run")["refused_messages"].as_u64().unwrap() > 0, "{ended:?}");
    assert!(!said(&ended.stderr, SECOND).is_empty(), "{ended:?}");
    drop((plans, intruder));
    place.assert_clean();
}

#[test]
fn a_flood_before_the_planner_starts_does_not_stop_it() {
    let place = Place::new();
    let mut run = place.flight("smoke").without_viewer().external("planner").timeout(LONG_S).start();
    let intruder = Intruder::join(&open_folder(&run));
    let plans = intruder.list_writer::<Plan, SlotHeader>("plan", 2);
    let other = SlotHeader { mission: 1, slot: 1, ..SlotHeader::default() };
    let flood = || (0..100_000).for_each(|_| send_list(&plans, other, &[forged_plan()]));
    flood();
    let planner = run.worker_command("planner").spawn().unwrap();
    until("end of the run", || {
        flood();
        run.has_ended().then_some(())
    });
    wait(planner).assert_success();
    let ended = run.wait_for_success();
    place.assert_trace_as_simulated("run");
    assert!(place.summary("run")["refused_messages"].as_u64().unwrap() > 0, "{ended:?}");
    drop((plans, intruder));
    place.assert_clean();
}

#[test]
fn killed_processes_recover_while_one_publisher_slot_of_each_topic_is_occupied() {
    let place = Place::new();
    let long = place.flight("long");
    let (run, mut rogue) = start_with_rogue(&long, LONG_S);
    let intruder = Intruder::join(&rogue.folder);
    let silent = (
        intruder.list_writer::<Plan, SlotHeader>("plan", 2),
        intruder.list_writer::<FlightReport, SlotHeader>("flight", 2),
        intruder.list_writer::<u32, QueuesHeader>("queues", 100),
    );
    rogue.fly_to_end(|_, turn| {
        for role in ["flight-sim", "field-sim"].iter().filter(|_| turn.slot % 1000 == 500) {
            run.kill_and_await(role);
        }
    });
    run.wait_for_success();
    place.assert_trace_as_simulated("run");
    let summary = place.summary("run");
    assert_eq!((&summary["restarts"], &summary["refused_messages"]), (&6.into(), &0.into()));
    drop((silent, intruder, rogue));
    place.assert_clean();
}

#[test]
fn a_process_reports_that_all_publisher_slots_of_its_topic_are_occupied() {
    let place = Place::new();
    let run = place.flight("smoke").without_viewer().external("planner").timeout(SHORT_S).start();
    let folder = open_folder(&run);
    let intruders = [(); 2].map(|()| Intruder::join(&folder));
    let writers = intruders.each_ref().map(|intruder| intruder.list_writer::<Plan, SlotHeader>("plan", 2));
    let planner = output(run.worker_command("planner")).assert_code(1);
    assert!(
        planner
            .stderr
            .starts_with("planner: topic plan: cannot write (if all places are taken, end the other program): "),
        "{planner:?}"
    );
    assert_eq!(planner.stderr.lines().count(), 1, "{planner:?}");
    let ended = run.wait().assert_code(1);
    assert!(trace(&place).is_empty());
    assert!(ended.stderr.contains("planner"), "{ended:?}");
    drop((writers, intruders));
    place.assert_clean();
}
