//! Pilots who do what they want: the bridge gives way.

use skysink_kinematic_vehicle::autopilot::CopterMode;
use skysink_vehicle::autopilot::AutopilotKind;
use skysink_vehicle::table::State;

use crate::flight::{ClosedLoop, KINDS, arms, assert_left_alone, count, flight_over, hovering, plan};

#[test]
fn a_pilot_who_takes_over_between_two_heartbeats_is_never_overruled() {
    // In steps through a slot, and so through the second between two heartbeats.
    for autopilot in KINDS {
        for step in 0..24 {
            let mut flight = hovering(autopilot);
            flight.fly_slot(1, Some(plan(50.0, 62.0)));
            flight.advance(0.25 * f64::from(step));
            flight.bridge.await_plan();
            flight.bridge.begin(2, 0.0);
            let now_s = flight.now_s;
            flight.bridge.fly(&[plan(50.0, 66.0)], now_s);
            flight.copter.change_to(CopterMode::Loiter);
            flight.advance(2.5);
            assert_eq!(flight.copter.mode, CopterMode::Loiter, "{autopilot:?} after {step} quarters of a second");
            assert_left_alone(&mut flight, "between two heartbeats");
            assert_eq!(flight.copter.mode, CopterMode::Loiter, "{autopilot:?} after {step} quarters of a second");
        }
    }
}

#[test]
fn a_new_run_takes_no_vehicle_from_the_air_and_none_that_is_armed() {
    for is_in_air in [true, false] {
        let mut flight = flight_over(AutopilotKind::ArduPilot);
        flight.copter.take_off_by_hand(30.0);
        flight.copter.mode = CopterMode::Guided;
        if is_in_air {
            flight.copter.body.position_m.z = 30.0;
        } else {
            flight.copter.body.stand();
        }
        flight.advance(3.0);
        let refusal = flight.refusal.clone().map(|refusal| refusal.why.to_string()).unwrap_or_default();
        assert!(refusal.starts_with("it is armed (GUIDED), by somebody else"), "{refusal}");
        assert!(flight.orders.is_empty(), "{:?}", flight.orders);
    }
}

#[test]
fn only_a_gcs_failsafe_that_brings_the_vehicle_down_is_accepted() {
    for (autopilot, accepted) in [(AutopilotKind::ArduPilot, [1, 3, 4].as_slice()), (AutopilotKind::Px4, &[2, 3])] {
        for value in 0..=7_u8 {
            let mut flight = flight_over(autopilot);
            flight.gcs_failsafe = Some(f32::from(value));
            flight.advance(20.0);
            let is_accepted = accepted.contains(&value);
            assert_eq!((flight.copter.is_armed, flight.refusal.is_some()), (is_accepted, !is_accepted), "{value}");
            assert_eq!(count(&flight, "when the bridge is silent ("), usize::from(is_accepted), "{:?}", flight.said);
        }
    }
}

#[test]
fn a_vehicle_that_is_disarmed_while_its_motors_spool_up_is_not_armed_again() {
    for autopilot in KINDS {
        for after_s in [0.0, 0.3, 0.9, 1.5, 2.5] {
            let mut flight = flight_over(autopilot);
            flight.until(60.0, |flight| flight.copter.is_armed);
            flight.advance(after_s);
            if flight.copter.is_in_air() {
                continue; // it climbs
            }
            flight.copter.disarm();
            flight.advance(30.0);
            assert!(!flight.copter.is_armed, "{after_s} s after it was armed");
            assert!(!flight.bridge.has_begun());
            let refusal = flight.bridge.check_flyable().unwrap_err();
            let why = refusal.why.to_string();
            // The second if no heartbeat has shown it.
            let ends = ["it has disarmed", "it was not armed, or not ready to take off, 13 s after the command"];
            let expected = ends.map(|end| format!("its mission was over before it began: {end}: no slot was flown"));
            assert!(refusal.number == 1 && expected.contains(&why), "{why}");
        }
    }
}

#[test]
fn whoever_arms_while_the_bridge_waits_flies_it_with_heartbeats() {
    for autopilot in KINDS {
        let mut flight = flight_over(autopilot);
        flight.gcs_failsafe = None; // the bridge waits for it
        flight.advance(5.0);
        flight.copter.take_off_by_hand(15.0);
        flight.advance(30.0);
        assert_eq!(count(&flight, "is overridden: it is armed ("), 1, "{:?}", flight.said);
        assert!(flight.refusal.is_none() && flight.orders.is_empty(), "{:?}", flight.orders);
        assert_eq!((flight.state(), flight.copter.mode), (State::HandsOff, CopterMode::Loiter), "no failsafe acts");
        flight.copter.disarm();
        flight.until(10.0, |flight| flight.bridge.check_flyable().is_err());
    }
}

#[test]
fn a_run_that_is_stopped_leaves_a_vehicle_on_the_ground_there_and_sends_one_in_the_air_home() {
    for autopilot in KINDS {
        for tenths in 0..60 {
            let mut flight = flight_over(autopilot);
            flight.answer_delay_s = 0.1;
            flight.until(60.0, |flight| arms(flight) > 0);
            flight.advance(f64::from(tenths) / 10.0);
            flight.bridge.return_home("the run is stopped");
            flight.until(3.0, |flight| flight.bridge.is_homebound());
            flight.until(200.0, |flight| !flight.copter.is_armed);
            let what = format!("{autopilot:?}, {tenths}: {:?}", flight.said);
            assert!(flight.copter.body.position_m.z < 0.5 && count(&flight, "is overridden") == 0, "{what}");
        }
    }
}

/// Hold of PX4, and GUIDED of ArduPilot, which a pilot chooses, are not seen, as the page says; all others are, in each
/// phase.
#[test]
fn a_pilot_takes_each_phase_by_each_mode() {
    type IsThere = fn(&ClosedLoop) -> bool;
    let phases: [(&str, IsThere); 5] = [
        ("arming", |flight| flight.copter.is_armed),
        ("climb", |flight| flight.copter.body.position_m.z > 8.0),
        ("start", |flight| count(flight, "has taken off") > 0),
        ("slots", |flight| flight.bridge.has_begun()),
        ("return", |flight| flight.copter.mode == CopterMode::Return),
    ];
    for autopilot in KINDS {
        for (phase, is_there) in phases {
            for mode in [CopterMode::Loiter, CopterMode::Stabilize, CopterMode::Land, CopterMode::Return] {
                let mut flight = flight_over(autopilot);
                if phase == "return" {
                    flight.until(90.0, |flight| flight.bridge.has_begun());
                    flight.bridge.return_home("the mission is over");
                }
                flight.until(90.0, is_there);
                if flight.copter.mode == mode || phase == "return" && mode == CopterMode::Land {
                    continue; // a landing in a return is taken for its last part
                }
                flight.advance(1.1);
                let _ = flight.copter.change_to(mode);
                flight.advance(2.5);
                flight.orders.clear();
                flight.advance(60.0);
                let what = format!("{autopilot:?}, {phase}, {mode:?}: {:?}", flight.said);
                assert!(flight.orders.is_empty(), "{what}, {:?}", flight.orders);
                let landed = if autopilot == AutopilotKind::Px4 { CopterMode::Guided } else { mode };
                assert!(
                    flight.copter.mode == mode || !flight.copter.is_armed && flight.copter.mode == landed,
                    "{what}"
                );
                assert_eq!(count(&flight, "is overridden: "), 1, "{what}");
            }
        }
    }
}
