//! Vehicles that are turned off and armed again, by somebody else than the bridge, and what only looks like that.

use skysink_vehicle::control::Phase;
use skysink_vehicle::telemetry::Telemetry;

use crate::pilot::{KINDS, count, flight_over};

#[test]
fn a_vehicle_that_was_turned_off_and_armed_again_on_the_ground_is_not_taken_off() {
    for autopilot in KINDS {
        for (is_refused, off_s) in [(true, 0.8), (true, 1.4), (false, 0.8), (false, 1.0), (false, 1.4)] {
            let mut flight = flight_over(autopilot);
            flight.is_deaf = false; // 5 heartbeats a second
            flight.refused = Some(22).filter(|_| is_refused);
            flight.until(60.0, |flight| flight.take_offs > 0);
            flight.says_on_ground_until_s = flight.now_s + if is_refused { 0.0 } else { 1.0 }; // its motors spool up
            flight.advance(if is_refused { 1.0 } else { 0.2 });
            flight.copter.disarm();
            flight.advance(off_s);
            flight.copter.is_armed = true; // by a pilot, or another ground station
            flight.copter.boot_s -= 5.0;
            flight.refused = None;
            let take_offs = flight.take_offs;
            flight.advance(10.0);
            let what = format!("{autopilot:?}, refused {is_refused}, off for {off_s} s: {:?}", flight.said);
            assert_eq!(flight.take_offs, take_offs, "{what}");
            assert_eq!(count(&flight, "is taken over: somebody else has armed it"), 1, "{what}");
        }
    }
}

#[test]
fn a_vehicle_that_takes_a_second_to_arm_is_not_taken_over() {
    for autopilot in KINDS {
        for is_deaf in [false, true] {
            let mut flight = flight_over(autopilot);
            flight.is_deaf = is_deaf;
            flight.until(60.0, |flight| flight.copter.is_armed);
            flight.copter.is_armed = false; // its answer is that it does
            flight.advance(1.2);
            flight.copter.is_armed = true;
            flight.until(60.0, |flight| flight.bridge.has_begun());
        }
    }
}

#[test]
fn a_vehicle_that_was_turned_off_and_armed_again_before_it_was_believed_to_be_armed_is_not_taken_off() {
    for autopilot in KINDS {
        let mut flight = flight_over(autopilot);
        flight.is_deaf = false;
        flight.until(60.0, |flight| flight.bridge.control(0).vehicle.may_be_armed());
        assert_eq!(flight.bridge.control(0).phase(), Phase::Arming);
        flight.copter.disarm();
        flight.advance(1.4);
        flight.copter.is_armed = true; // by a pilot
        flight.copter.boot_s -= 5.0;
        flight.advance(10.0);
        assert_eq!(flight.take_offs, 0, "{autopilot:?}: {:?}", flight.said);
    }
}

/// The bridge hears that it is armed before the answer, which is late or lost.
#[test]
fn a_vehicle_whose_answer_is_late_and_that_was_turned_off_and_armed_again_is_not_taken_off() {
    for (autopilot, heartbeat_s) in KINDS.into_iter().flat_map(|autopilot| [(autopilot, 0.2), (autopilot, 1.0)]) {
        for (answer_loss, answer_delay_s) in [(1.0, 0.0), (0.0, 0.5)] {
            for off_s in [0.8, 1.4, 2.0, 2.8].into_iter().filter(|off_s| *off_s >= 2.0 * heartbeat_s) {
                let mut flight = flight_over(autopilot);
                (flight.answer_loss, flight.answer_delay_s) = (answer_loss, answer_delay_s);
                (flight.is_deaf, flight.heartbeat_s) = (heartbeat_s == 1.0, heartbeat_s);
                flight.until(60.0, |flight| flight.bridge.control(0).vehicle.may_be_armed());
                flight.advance(0.1);
                flight.copter.disarm();
                flight.advance(off_s);
                flight.copter.is_armed = true; // by a pilot
                flight.copter.boot_s -= 5.0;
                flight.advance(10.0);
                let what =
                    format!("{autopilot:?}, {heartbeat_s} s, {answer_loss}, {answer_delay_s}, off for {off_s} s");
                assert_eq!(flight.take_offs, 0, "{what}: {:?}", flight.said);
            }
        }
    }
}

#[test]
fn a_vehicle_that_was_turned_off_on_the_ground_and_is_armed_again_after_the_stop_gets_no_order() {
    for autopilot in KINDS {
        for is_take_off in [false, true] {
            let mut flight = flight_over(autopilot);
            flight.is_deaf = false;
            flight.refused = Some(22);
            flight.until(60.0, |flight| match is_take_off {
                true => flight.take_offs > 0,
                false => flight.bridge.control(0).vehicle.may_be_armed(),
            });
            flight.copter.disarm();
            flight.advance(0.8);
            let now_s = flight.now_s;
            flight.bridge.return_home("the run is stopped", now_s);
            flight.advance(0.3);
            flight.copter.is_armed = true; // by a pilot
            flight.orders.clear();
            flight.advance(3.0);
            assert!(flight.orders.is_empty(), "{autopilot:?}, {is_take_off}: {:?}, {:?}", flight.orders, flight.said);
            assert_eq!(flight.bridge.taken_over(), [1], "{autopilot:?}, {is_take_off}: {:?}", flight.said);
        }
    }
}

#[test]
fn late_copies_in_the_spool_up_are_no_takeover() {
    for autopilot in KINDS {
        let mut flight = flight_over(autopilot);
        flight.until(60.0, |flight| flight.take_offs > 0);
        flight.says_on_ground_until_s = flight.now_s + 1.5;
        flight.advance(0.1);
        let mode = flight.mode();
        for _ in 0..2 {
            flight.hear(&Telemetry::Heartbeat { autopilot, mode, is_armed: false, is_booting: false });
            flight.advance(0.34);
        }
        flight.until(60.0, |flight| flight.bridge.has_begun());
    }
}
