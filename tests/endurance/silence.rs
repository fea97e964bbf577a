//! Processes that are stopped: reported, waited for, and replaced when they stay silent.

use std::thread::sleep;
use std::time::Duration;

use rustix::process::{Signal, kill_process};

use crate::support::Place;
use crate::support::flight::RING;
use crate::{events, longer};

#[test]
fn a_silent_process_is_reported_and_recovers() {
    let place = Place::new();
    let run = longer(&place).without_viewer().start();
    run.until_slot(100);
    run.signal_worker("planner", Signal::STOP);
    sleep(Duration::from_millis(1500)); // what is tested is that time passes
    run.signal_worker("planner", Signal::CONT);
    run.wait_for_success();
    place.assert_trace_as_simulated("run");
    let (processes, reports): (Vec<_>, Vec<_>) = events(&place).into_iter().unzip();
    assert_eq!(processes, ["planner"; 2]);
    let silence_s = reports.iter().map(|report| report.split(' ').find_map(|word| word.parse::<f64>().ok()).unwrap());
    let [reported_s, total_s] = silence_s.collect::<Vec<_>>()[..] else { panic!("{reports:?}") };
    assert!(reported_s >= 1.0 && total_s > reported_s, "{reports:?}");
    assert!(
        reports[0].starts_with("has sent no heartbeat for ") && reports[1].starts_with("recovered after "),
        "{reports:?}"
    );
}

#[test]
fn a_permanently_silent_process_is_replaced() {
    let place = Place::new();
    let run = longer(&place).without_viewer().timeout("6").start();
    run.until_slot(100);
    run.signal_worker("flight-sim", Signal::STOP);
    run.wait_for_success();
    place.assert_trace_as_simulated("run");
    assert_eq!(place.summary("run")["restarts"], 1);
    place.assert_clean();
}

#[test]
fn only_the_suspended_process_of_a_paced_run_is_named_and_replaced() {
    for role in RING {
        let place = Place::new();
        let run = place.flight("paced").without_viewer().pace("10x").timeout("3").start();
        run.until_slot(10);
        run.signal_worker(role, Signal::STOP);
        run.wait_for_success();
        let events = events(&place);
        assert!(events.iter().all(|(process, _)| process == role), "{role}: {events:?}");
        let has = |what: &str| events.iter().any(|(_, event)| event.starts_with(what));
        assert!(has("has sent no heartbeat for 1.") && has("was killed by signal 9"), "{role}: {events:?}");
        // Plans and flights are awaited from the begin of a slot.
        assert_eq!(has("has sent no sample for 1."), role != "field-sim", "{role}: {events:?}");
        assert_eq!(place.summary("run")["restarts"], 1, "{role}: {events:?}");
        place.assert_clean();
    }
}

#[test]
fn slots_held_up_to_the_end_are_all_reported() {
    let place = Place::new();
    let run = place.flight("paced").without_viewer().pace("20x").start();
    run.until_slot(60);
    run.signal_worker("planner", Signal::STOP); // for less than its timeout
    run.wait_for_success();
    let trace = place.trace("run");
    let held = trace.lines().rev().take_while(|line| line.contains(",hold,")).count();
    assert!(held > 60, "{held}");
    let named = events(&place).into_iter().rfind(|(_, event)| event.contains("slots in a row"));
    let last = format!("has sent no plan in time for {held} slots in a row: the UAV held");
    assert_eq!(named, Some(("planner".to_owned(), last)));
    place.assert_clean();
}

#[test]
fn a_suspended_machine_continues_to_a_complete_mission() {
    let place = Place::new();
    let run = longer(&place).without_viewer().timeout("6").start();
    run.until_slot(100);
    let processes: Vec<_> = RING.into_iter().map(|role| run.worker(role)).chain([run.pid()]).collect();
    for signal in [Signal::STOP, Signal::CONT] {
        processes.iter().for_each(|&process| kill_process(process, signal).unwrap());
        sleep(Duration::from_secs(7)); // longer than the timeout
    }
    run.wait_for_success();
    place.assert_trace_as_simulated("run");
    assert_eq!(place.summary("run")["restarts"], 0);
    place.assert_clean();
}

#[test]
fn a_planner_that_computes_for_long_is_not_silent() {
    let place = Place::new();
    let flight = place.flight("small").without_viewer().strategy("horizon").timeout("120");
    let flight =
        flight.settings("sensors.count=200 area.side_m=800 uav.max_speed_mps=5 planner.horizon.iterations=12000");
    let ended = flight.run();
    let plan_us = place.summary("run")["timing"]["plan_max_us"].as_f64();
    assert!(plan_us > Some(1.2e6), "{plan_us:?}: it has to take longer than a process may be silent");
    // On a busy machine a second may pass between two polls of the stop request, but not most of the plan.
    let silences =
        ended.stderr.lines().filter_map(|line| line.split_once("planner recovered after ")?.1.split_once(' '));
    let longest_s = silences.map(|(seconds, _)| seconds.parse::<f64>().unwrap()).fold(0.0, f64::max);
    assert!(longest_s * 1e6 < plan_us.unwrap() / 2.0 && !ended.stderr.contains("killed"), "{ended:?}");
}
