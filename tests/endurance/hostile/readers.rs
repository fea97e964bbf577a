//! Readers that never take their samples.

use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::ipc;
use skysink_common::message::{Commit, FlightReport, Plan, SlotHeader};

use super::audit::audit;
use super::intruder::Intruder;
use super::rogue::{LONG_S, Rogue, SHORT_S, start_with_rogue};
use crate::support::{Output, Place};

fn full(topic: &str) -> String {
    format!("topic {topic}: a reader has not taken its samples for 3.3 s: is one stopped, or the viewer too slow?")
}

/// Flies the smoke test; in slot 20 `intrude` makes a reader that takes nothing.
fn fly_with_deaf_reader<R>(place: &Place, options: &[&str], intrude: impl Fn(&Intruder) -> R) -> Output {
    let (run, mut rogue) = start_with_rogue(&place.flight("smoke").options(options), SHORT_S);
    let intruder = Intruder::join(&rogue.folder);
    let mut deaf = None;
    let mut fly = |rogue: &mut Rogue| -> Result<(), skysink_ring::error::NodeError> {
        while let Some(turn) = rogue.try_next()? {
            if turn.slot == 20 {
                deaf = Some(intrude(&intruder));
            }
            rogue.try_send(rogue.header(turn.slot), turn.good)?;
        }
        Ok(())
    };
    let flown = fly(&mut rogue);
    let ended = run.wait();
    assert_eq!(flown.is_ok(), ended.code == Some(0), "{flown:?}, {ended:?}");
    ended
}

/// Fails unless the run has ended early, with a complete folder.
fn assert_ended_early(place: &Place, ended: &Output) {
    assert_eq!(ended.code, Some(1), "{ended:?}");
    let flown = audit(place).len();
    assert!((19..60).contains(&flown), "{flown} slots");
    assert_eq!(place.summary("run")["complete"], false);
    place.assert_clean();
}

fn deaf_to_flights(intruder: &Intruder) -> Subscriber<ipc::Service, [FlightReport], SlotHeader> {
    intruder.reader("flight")
}

#[test]
fn a_blocked_reader_ends_a_lock_step_run_without_restarts_by_its_timeout() {
    let place = Place::new();
    let ended = fly_with_deaf_reader(&place, &["--restart", "never"], deaf_to_flights);
    assert!(ended.stderr.contains(&full("flight")), "{ended:?}");
    assert_ended_early(&place, &ended);
}

#[test]
fn a_blocked_reader_costs_a_restart_of_the_writer_that_waits_for_it() {
    let place = Place::new();
    let ended = fly_with_deaf_reader(&place, &[], deaf_to_flights);
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert!(ended.stderr.contains("flight-sim was restarted (restart 1)"), "{ended:?}");
    place.assert_trace_as_simulated("run");
    place.assert_clean();
}

#[test]
fn a_reader_that_blocks_the_launcher_ends_the_run_by_its_timeout() {
    let place = Place::new();
    let ended = fly_with_deaf_reader(&place, &[], |intruder| intruder.reader::<Commit, SlotHeader>("commit"));
    assert!(ended.stderr.contains(&format!("skysink: {}", full("commit"))), "{ended:?}");
    assert_ended_early(&place, &ended);
}

#[test]
fn a_paced_run_does_not_wait_for_a_blocked_reader() {
    let place = Place::new();
    let (run, mut rogue) = start_with_rogue(&place.flight("smoke").pace("20x"), LONG_S);
    let intruder = Intruder::join(&rogue.folder);
    let deaf = (deaf_to_flights(&intruder), intruder.reader::<[Plan], SlotHeader>("plan"));
    rogue.fly_to_end(|_, _| {});
    run.wait_for_success();
    assert_eq!(audit(&place).len(), 60);
    drop((deaf, intruder, rogue));
    place.assert_clean();
}

#[test]
fn a_blocked_observer_is_not_waited_for() {
    let place = Place::new();
    let ended = fly_with_deaf_reader(&place, &["--restart", "never"], |intruder| {
        (intruder.observer::<[FlightReport], SlotHeader>("flight"), intruder.observer::<Commit, SlotHeader>("commit"))
    });
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert_eq!(place.summary("run")["restarts"], 0);
    place.assert_trace_as_simulated("run");
    place.assert_clean();
}
