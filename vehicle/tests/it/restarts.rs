//! Bridges after another: a bridge that was restarted in a run, and a run that was stopped and is resumed.

use skysink_common::message::Mode;
use skysink_kinematic_vehicle::KinematicOptions;
use skysink_kinematic_vehicle::autopilot::CopterMode;
use skysink_vehicle::autopilot::AutopilotKind;
use skysink_vehicle::bridge::Beginning;
use skysink_vehicle::control::Heartbeats;
use skysink_vehicle::saved::SavedVehicles;
use skysink_vehicle::table::State;
use skysink_vehicle::telemetry::Order;

use crate::flight::{
    BEFORE_SLOT, ClosedLoop, KINDS, RESTARTED, arms, assert_left_alone, count, flight_over, hovering, options_of, plan,
    take_offs,
};

#[test]
fn a_restarted_bridge_flies_on_in_the_mode_that_follows_and_in_no_other() {
    for autopilot in KINDS {
        for mode in
            [CopterMode::Guided, CopterMode::Stabilize, CopterMode::Loiter, CopterMode::Return, CopterMode::Land]
        {
            let mut flight = hovering(autopilot);
            flight.fly_slot(1, Some(plan(50.0, 62.0)));
            flight.restart(RESTARTED);
            let _ = flight.copter.change_to(mode);
            flight.orders.clear();
            let report = flight.fly_slot(2, Some(plan(50.0, 66.0)));
            if mode == CopterMode::Guided {
                assert_eq!(report.flown_mode(), Mode::Serve, "{autopilot:?}: {:?}", flight.said);
                let next = flight.fly_slot(3, Some(plan(50.0, 62.0)));
                assert_eq!(next.flown_mode(), Mode::Serve, "{:?}", flight.said);
            } else {
                assert!(flight.orders.is_empty(), "{mode:?}: {:?}", flight.orders);
                assert_left_alone(&mut flight, "restarted");
            }
        }
    }
}

#[test]
fn a_bridge_that_is_restarted_between_arming_and_the_flight_leaves_the_vehicle_to_its_gcs_failsafe() {
    for autopilot in KINDS {
        for tenths in (0..120).step_by(3) {
            let mut flight = flight_over(autopilot);
            flight.until(60.0, |flight| arms(flight) > 0);
            flight.advance(f64::from(tenths) / 10.0);
            let (State::Arm { .. } | State::Climb) = flight.state() else { continue };
            flight.restart(BEFORE_SLOT);
            flight.orders.clear();
            let heartbeats = flight.bridge.control(0).heartbeats(flight.now_s);
            assert_eq!(heartbeats, Heartbeats::Withheld);
            flight.until(300.0, |flight| flight.bridge.has_landed());
            let what = format!("{autopilot:?}, {tenths}: {:?}", flight.said);
            assert!(flight.orders.is_empty() && !flight.copter.is_armed, "{what}, {:?}", flight.orders);
            let line =
                "is left to its GCS failsafe: the bridge was restarted between its command to arm and its mission";
            assert_eq!(count(&flight, line), 1, "{what}");
        }
    }
}

#[test]
fn a_bridge_that_is_restarted_in_a_return_leaves_the_vehicle_to_it_and_to_its_pilot() {
    for autopilot in KINDS {
        for mode in [None, Some(CopterMode::Loiter), Some(CopterMode::Guided)] {
            let mut flight = hovering(autopilot);
            flight.fly_slot(1, Some(plan(50.0, 68.0)));
            flight.bridge.return_home("its battery is low");
            flight.until(10.0, |flight| flight.state() == State::Home { was_seen: true });
            flight.restart(RESTARTED);
            if let Some(mode) = mode {
                let _ = flight.copter.change_to(mode);
            }
            flight.orders.clear();
            flight.advance(60.0);
            let what = format!("{autopilot:?}, {mode:?}: {:?}", flight.said);
            assert!(flight.orders.is_empty(), "{what}, {:?}", flight.orders);
            // Hovering in the mode that follows, it has no pilot that anybody knows of: its failsafe brings it home.
            let is_pilot_s = mode == Some(CopterMode::Loiter);
            assert_eq!(flight.copter.is_armed, is_pilot_s, "{what}");
            let heartbeats = if is_pilot_s { Heartbeats::Due } else { Heartbeats::Idle };
            assert_eq!(flight.bridge.control(0).heartbeats(flight.now_s), heartbeats, "{what}");
        }
    }
}

#[test]
fn who_has_control_keeps_it_under_the_next_bridge() {
    for autopilot in KINDS {
        let mut flight = hovering(autopilot);
        flight.fly_slot(1, Some(plan(50.0, 62.0)));
        let _ = flight.copter.change_to(CopterMode::Loiter);
        flight.advance(2.5);
        assert_eq!(flight.fly_slot(2, Some(plan(50.0, 66.0))).flown_mode(), Mode::Return);
        flight.restart(RESTARTED);
        flight.said.clear();
        let _ = flight.copter.change_to(CopterMode::Guided); // handed to another ground station
        assert_left_alone(&mut flight, "restarted");
        assert_eq!(flight.bridge.control(0).heartbeats(flight.now_s), Heartbeats::Due);
    }
}

/// Its GCS failsafe would act over its pilot.
#[test]
fn who_has_control_gets_heartbeats_in_a_run_that_is_resumed_and_after_a_silence() {
    for autopilot in KINDS {
        let mut flight = hovering(autopilot);
        flight.fly_slot(1, Some(plan(50.0, 62.0)));
        let _ = flight.copter.change_to(CopterMode::Loiter);
        flight.advance(2.5);
        flight.restart(Beginning::First);
        flight.advance(20.0);
        let heartbeats = |flight: &ClosedLoop| flight.bridge.control(0).heartbeats(flight.now_s);
        assert_eq!((flight.state(), heartbeats(&flight)), (State::HandsOff, Heartbeats::Due), "{:?}", flight.said);
        // A vehicle that was left in the air, which the next run may fly on, and its pilot has it before that.
        let mut flight = hovering(autopilot);
        flight.fly_slot(1, Some(plan(50.0, 62.0)));
        flight.bridge.return_home("the run is stopped");
        flight.until(10.0, |flight| matches!(flight.state(), State::Home { .. }));
        flight.restart(RESTARTED);
        flight.until(10.0, |flight| heartbeats(flight) == Heartbeats::Withheld);
        let _ = flight.copter.change_to(CopterMode::Stabilize);
        flight.until(10.0, |flight| (flight.state(), heartbeats(flight)) == (State::HandsOff, Heartbeats::Due));
    }
}

/// Its failsafe acts once; somebody ends it, and nobody flies.
#[test]
fn a_silent_vehicle_that_hovers_is_said_to_have_nobody() {
    for autopilot in KINDS {
        let mut flight = hovering(autopilot);
        flight.bridge.return_home("the mission is over");
        flight.until(10.0, |flight| matches!(flight.state(), State::Home { .. }));
        flight.restart(RESTARTED);
        flight.advance(5.0);
        let _ = flight.copter.change_to(CopterMode::Guided);
        flight.advance(90.0);
        let said = count(&flight, "nobody is known to fly it");
        assert_eq!(said > 0, flight.copter.is_in_air(), "{autopilot:?}: {:?}", flight.said);
    }
}

/// An autopilot that has lost its home, or another vehicle, under a bridge that was restarted.
#[test]
fn a_home_that_is_far_from_the_saved_one_stops_the_waypoints() {
    let mut flight = hovering(AutopilotKind::Px4);
    flight.fly_slot(1, Some(plan(50.0, 62.0)));
    flight.restart(RESTARTED);
    flight.drift_m = -40.0;
    flight.orders.clear();
    let flown = flight.bridge.ends.flown;
    let report = flight.fly_slot(2, Some(plan(50.0, 66.0)));
    assert_eq!((report.flown_mode(), flight.bridge.ends.flown), (Mode::Hold, flown), "it hovers where it is");
    let is_waypoint = |(_, order): &(f64, Order)| matches!(order, Order::Reposition { .. });
    assert!(!flight.orders.iter().any(is_waypoint), "{:?}", flight.orders);
    let line = "reports an altitude of its home that is 40 m from the one at its take-off: it gets no waypoints";
    assert_eq!(count(&flight, line), 1, "{:?}", flight.said);
    flight.drift_m = -5.0;
    flight.advance(10.0);
    flight.fly_slot(3, Some(plan(50.0, 62.0)));
    assert!(flight.orders.iter().any(is_waypoint), "{:?}", flight.said);
}

/// A run on another host, of which only the trace is there: its vehicle was returning, or hovers unheard.
#[test]
fn a_vehicle_of_which_only_a_return_is_known_gets_no_heartbeats_before_a_pilot_shows() {
    for mode in [CopterMode::Guided, CopterMode::Loiter] {
        let mut flight = hovering(AutopilotKind::ArduPilot);
        flight.bridge.return_home("the run is stopped");
        flight.fly_slot(1, None);
        assert_eq!(flight.reports[0].flown_mode(), Mode::Return);
        flight.restart_with(Beginning::First, &[]);
        let _ = flight.copter.change_to(mode);
        flight.orders.clear();
        flight.advance(3.0);
        let is_a_pilots = mode == CopterMode::Loiter;
        let expected = if is_a_pilots { Heartbeats::Due } else { Heartbeats::Withheld };
        assert_eq!(flight.bridge.control(0).heartbeats(flight.now_s), expected, "{:?}", flight.said);
        assert!(flight.orders.is_empty(), "{:?}", flight.orders);
    }
}

#[test]
fn a_bridge_after_one_that_saved_nothing_flies_nobody_in_the_air() {
    let mut flight = flight_over(AutopilotKind::ArduPilot);
    flight.restart_with(BEFORE_SLOT, &[]);
    flight.copter.take_off_by_hand(20.0);
    flight.copter.body.position_m.z = 20.0;
    let _ = flight.copter.change_to(CopterMode::Guided); // by another ground station
    flight.advance(20.0);
    assert!(flight.orders.is_empty(), "{:?}, {:?}", flight.orders, flight.said);
}

#[test]
fn what_cannot_be_read_is_not_armed() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("vehicles.json"), "[").unwrap();
    let saved = SavedVehicles::of(folder.path(), 1, true);
    let mut flight = flight_over(AutopilotKind::ArduPilot);
    flight.restart_with(BEFORE_SLOT, saved.vehicles());
    flight.advance(60.0);
    assert!(flight.orders.is_empty() && !flight.copter.is_armed, "{:?}", flight.said);
}

#[test]
fn a_run_is_resumed_from_a_saved_flight_in_the_air_or_from_the_ground() {
    for autopilot in KINDS {
        // Both processes were killed: the flight was saved, and the vehicle hovers.
        let mut flight = hovering(autopilot);
        flight.fly_slot(1, Some(plan(50.0, 62.0)));
        flight.restart(Beginning::First);
        flight.said.clear();
        flight.until(30.0, |flight| flight.bridge.has_begun());
        assert_eq!((arms(&flight), count(&flight, "is in the air: flying on")), (1, 1), "{:?}", flight.said);
        assert_eq!(flight.fly_slot(2, Some(plan(50.0, 66.0))).flown_mode(), Mode::Serve);
        // It was sent home, and has landed; its operator puts it into the mode that follows.
        flight.bridge.return_home("the run is stopped");
        flight.until(120.0, |flight| flight.bridge.is_homebound());
        let saved = flight.saved();
        flight.until(120.0, |flight| !flight.copter.is_armed);
        flight.restart_with(Beginning::First, &saved);
        flight.advance(10.0);
        if autopilot == AutopilotKind::ArduPilot {
            assert_eq!((arms(&flight), flight.copter.mode), (1, CopterMode::Return), "it waits for the mode");
            let _ = flight.copter.change_to(CopterMode::Guided);
        }
        flight.until(90.0, |flight| flight.bridge.has_begun());
        assert_eq!(arms(&flight), 2);
    }
}

#[test]
fn a_run_is_not_resumed_while_its_vehicle_returns_or_is_flown() {
    for autopilot in KINDS {
        for mode in [CopterMode::Return, CopterMode::Loiter, CopterMode::Guided] {
            let mut flight = hovering(autopilot);
            flight.fly_slot(1, Some(plan(50.0, 62.0)));
            flight.bridge.return_home("the run is stopped");
            flight.until(10.0, |flight| flight.state() == State::Home { was_seen: true });
            flight.restart(Beginning::First);
            let _ = flight.copter.change_to(mode);
            flight.orders.clear();
            flight.until(10.0, |flight| flight.refusal.is_some());
            let why = flight.refusal.as_ref().unwrap().why.to_string();
            assert!(
                why.ends_with("an earlier run: expected it on the ground, disarmed; try again when it has landed"),
                "{why}"
            );
            assert!(flight.orders.is_empty(), "{:?}", flight.orders);
        }
    }
}

#[test]
fn a_vehicle_whose_mission_was_over_stays_down_and_its_slots_go_on() {
    let mut flight = hovering(AutopilotKind::ArduPilot);
    flight.fly_slot(1, Some(plan(50.0, 62.0)));
    let _ = flight.copter.change_to(CopterMode::Land);
    flight.until(90.0, |flight| flight.bridge.has_landed());
    for beginning in [Beginning::First, RESTARTED] {
        flight.restart(beginning);
        flight.orders.clear();
        let _ = flight.copter.change_to(CopterMode::Guided);
        flight.advance(60.0);
        assert!(flight.orders.is_empty() && !flight.copter.is_armed, "{:?}", flight.said);
        assert!(flight.bridge.check_flyable().is_ok() && flight.bridge.has_begun() && flight.bridge.has_landed());
        assert_eq!(flight.fly_slot(2, Some(plan(50.0, 62.0))).flown_mode(), Mode::Down);
    }
}

#[test]
fn a_bridge_that_is_killed_at_any_instant_is_followed_by_one_that_overrules_nobody() {
    for autopilot in KINDS {
        for instant in 0..90 {
            let options = KinematicOptions { silence: 30.0, ..options_of(autopilot) };
            let mut flight = ClosedLoop::new(&options, 0.0);
            flight.is_deaf = true;
            flight.advance(f64::from(instant) * 0.5);
            let was = flight.state();
            let arms_before = arms(&flight);
            let has_begun = flight.bridge.has_begun();
            flight.is_bridge_alive = false;
            flight.advance(2.0); // nobody looks
            let _ = flight.copter.change_to(CopterMode::Loiter);
            flight.advance(1.0);
            flight.restart(if has_begun { RESTARTED } else { BEFORE_SLOT });
            flight.orders.clear();
            flight.advance(30.0);
            let what = format!("{autopilot:?}, {instant}, {was:?}: {:?}", flight.said);
            assert!(
                flight.orders.is_empty() && flight.copter.mode == CopterMode::Loiter,
                "{what}: {:?}",
                flight.orders
            );
            assert!(arms_before <= 1 && arms(&flight) + take_offs(&flight) == 0, "{what}");
        }
    }
}

/// As the process does: without what is saved nobody is armed.
#[test]
fn a_command_to_arm_that_could_not_be_saved_ends_the_start() {
    let mut flight: ClosedLoop = flight_over(AutopilotKind::ArduPilot);
    flight.lost = Order::Arm.command(); // it is not sent
    flight.until(60.0, |flight| arms(flight) == 1);
    let said = flight.bridge.forget_arming(0, "its state cannot be saved");
    flight.advance(60.0);
    assert_eq!((arms(&flight), &*said), (1, &["is not armed: its state cannot be saved".to_owned()][..]));
    assert!(flight.bridge.check_flyable().is_err());
}
