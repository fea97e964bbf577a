//! Vehicles that say what is not so, nothing at all, or that they refuse: what the bridge believes of that, and does.

use skysink_common::message::Mode;
use skysink_kinematic_vehicle::KinematicOptions;
use skysink_kinematic_vehicle::autopilot::CopterMode;
use skysink_vehicle::autopilot::AutopilotKind;
use skysink_vehicle::control::Heartbeats;
use skysink_vehicle::table::State;
use skysink_vehicle::telemetry::{Order, Telemetry};

use crate::flight::{
    ClosedLoop, KINDS, assert_left_alone, count, flight_over, hovering, may_overrule, plan, take_offs,
};

#[test]
fn a_vehicle_in_the_air_that_says_it_is_disarmed_is_not_taken_for_landed() {
    let mut flight = flight_over(AutopilotKind::ArduPilot);
    flight.heartbeat_s = 0.2;
    flight.until(90.0, |flight| flight.copter.body.position_m.z > 8.0);
    for _ in 0..2 {
        flight.is_odd = true;
        flight.until(5.0, |flight| !flight.is_odd);
    }
    flight.bridge.return_home("the run is stopped");
    flight.until(90.0, |flight| !flight.copter.is_armed);
    assert_eq!(flight.orders.last().map(|(_, order)| order), Some(&Order::Return), "{:?}", flight.said);
}

#[test]
fn late_copies_of_a_heartbeat_from_before_take_off_end_no_mission() {
    for autopilot in KINDS {
        let mut flight = flight_over(autopilot);
        flight.until(60.0, |flight| take_offs(flight) > 0);
        let mode = flight.copter.mode_number();
        for _ in 0..3 {
            flight.hear(&Telemetry::Heartbeat { autopilot, mode, is_armed: false, is_critical: false });
            flight.hear(&Telemetry::InAir(false));
            flight.advance(0.02);
        }
        flight.until(60.0, |flight| flight.bridge.has_begun());
    }
}

/// What it says of the ground stops while it climbs.
#[test]
fn a_vehicle_that_has_stopped_to_say_whether_it_is_on_the_ground_is_judged_by_its_altitude() {
    for autopilot in KINDS {
        let mut flight = flight_over(autopilot);
        flight.until(60.0, |flight| take_offs(flight) > 0);
        flight.hear(&Telemetry::InAir(false));
        flight.is_silent_of_ground = true;
        flight.until(90.0, |flight| flight.bridge.has_begun());
    }
}

/// Nothing about it is known any more: what it said of the ground last is the best that there is.
#[test]
fn what_a_vehicle_says_of_the_ground_counts_for_long_only_without_an_altitude() {
    for says_where in [true, false] {
        let mut flight = hovering(AutopilotKind::ArduPilot);
        flight.drift_m = -19.8; // its barometer
        flight.is_silent_of_ground = true;
        flight.says_no_position = !says_where;
        flight.advance(11.0);
        assert_eq!(flight.bridge.control(0).vehicle.is_high(), !says_where, "{:?}", flight.said);
    }
}

#[test]
fn a_vehicle_whose_failsafe_acts_is_not_armed() {
    let mut flight = flight_over(AutopilotKind::Px4);
    flight.is_critical = true;
    flight.advance(30.0);
    assert!(count(&flight, "waiting for it to report no failsafe") > 0, "{:?}", flight.said);
    assert!(flight.orders.is_empty(), "{:?}", flight.orders);
    flight.is_critical = false;
    flight.until(90.0, |flight| flight.bridge.has_begun());
}

/// Its reports do not agree, and it must not take off: what it is waited for is not what it is refused for.
#[test]
fn a_refused_vehicle_that_is_not_believed_says_why_it_must_not_take_off() {
    let mut flight = flight_over(AutopilotKind::ArduPilot);
    flight.gcs_failsafe = Some(0.0);
    for _ in 0..40 {
        flight.hear(&flight.heartbeat(true));
        flight.hear(&flight.heartbeat(false));
        flight.advance(0.1);
    }
    assert_eq!(count(&flight, "must not take off: FS_GCS_ENABLE = 0"), 1, "{:?}", flight.said);
    assert_eq!(count(&flight, "waiting for it FS_GCS"), 0, "{:?}", flight.said);
}

/// An autopilot reports the mode after a landing before it says that it has landed, and has disarmed.
#[test]
fn the_mode_after_a_landing_is_not_taken_for_a_stopped_return() {
    let mut flight = hovering(AutopilotKind::Px4);
    flight.bridge.return_home("the mission is over");
    flight.until(90.0, |flight| flight.copter.body.position_m.z < 0.05);
    assert_eq!(flight.state(), State::Home { was_seen: true });
    flight.hear(&Telemetry::InAir(true));
    for _ in 0..3 {
        flight.hear(&Telemetry::Mode(3 << 24 | 4 << 16));
    }
    flight.until(90.0, |flight| flight.bridge.has_landed());
    assert_eq!(count(&flight, "has landed"), 1, "{:?}", flight.said);
}

/// A pilot flies it out of the range of its reports: the failsafe that acts without heartbeats would act over him.
#[test]
fn a_vehicle_that_its_pilot_flies_gets_heartbeats_however_long_it_is_silent() {
    let mut flight = hovering(AutopilotKind::ArduPilot);
    let _ = flight.copter.change_to(CopterMode::Loiter);
    flight.until(10.0, |flight| flight.state() == State::HandsOff);
    let later_s = flight.now_s + 60.0;
    let _ = flight.bridge.poll(later_s, |_, _| {}, |_, _| {});
    assert_eq!(flight.bridge.control(0).heartbeats(later_s), Heartbeats::Due);
}

#[test]
fn a_vehicle_that_is_silent_after_take_off_is_not_taken_for_one_on_the_ground() {
    let mut flight = flight_over(AutopilotKind::ArduPilot);
    flight.until(60.0, |flight| take_offs(flight) > 0);
    flight.is_bridge_alive = false; // it hears nothing
    for _ in 0..130 {
        flight.advance(1.0);
        let now_s = flight.now_s;
        let _ = flight.bridge.poll(now_s, |_, _| {}, |_, _| {});
    }
    assert!(count(&flight, "stays on the ground") == 0 && !flight.bridge.has_landed(), "{:?}", flight.said);
    flight.is_bridge_alive = true;
    flight.until(120.0, |flight| flight.bridge.has_landed());
    assert_eq!(count(&flight, "its mission is over: it has disarmed"), 1, "its GCS failsafe: {:?}", flight.said);
}

#[test]
fn a_vehicle_that_refuses_to_return_is_left_to_its_gcs_failsafe() {
    let mut flight = hovering(AutopilotKind::ArduPilot);
    flight.refused = Order::Return.command();
    flight.bridge.return_home("the mission is over");
    flight.advance(29.0);
    let heartbeats = |flight: &ClosedLoop| flight.bridge.control(0).heartbeats(flight.now_s);
    assert_eq!(heartbeats(&flight), Heartbeats::Due);
    assert_eq!(count(&flight, "refuses to return: MAVLink result 4; it is asked again"), 2, "{:?}", flight.said);
    flight.advance(2.5);
    assert_eq!(heartbeats(&flight), Heartbeats::Withheld, "{:?}", flight.said);
    flight.until(20.0, |flight| flight.copter.mode == CopterMode::Return); // by its GCS failsafe
    flight.advance(2.5);
    assert_eq!(heartbeats(&flight), Heartbeats::Withheld, "nobody flies it");
    flight.copter.change_to(CopterMode::Loiter);
    flight.advance(2.5);
    assert_eq!(heartbeats(&flight), Heartbeats::Due, "a pilot does: {:?}", flight.said);
}

#[test]
fn a_vehicle_that_refuses_to_take_off_ends_its_mission_on_the_ground() {
    let mut flight = flight_over(AutopilotKind::ArduPilot);
    flight.refused = Some(22);
    flight.until(60.0, |flight| take_offs(flight) > 0);
    for _ in 0..125 {
        flight.advance(1.0);
        flight.copter.boot_s -= 1.0; // so that it does not disarm by itself
    }
    assert!(flight.bridge.has_landed(), "{:?}", flight.said);
    assert_eq!(count(&flight, "refuses to take off: MAVLink result 4; it is asked again"), 4, "{:?}", flight.said);
    assert_eq!(count(&flight, "stays on the ground: it does not take off within two minutes"), 1, "{:?}", flight.said);
    assert_eq!(flight.bridge.control(0).heartbeats(flight.now_s), Heartbeats::Withheld, "its motors run");
    flight.refused = None;
    let orders = flight.orders.len();
    flight.advance(60.0);
    assert_eq!((flight.orders.len(), flight.copter.body.position_m.z), (orders, 0.0));
}

/// At five heartbeats a second; with one, nobody sees it.
#[test]
fn a_vehicle_that_was_turned_off_and_armed_again_on_the_ground_is_not_taken_off() {
    for off_s in [0.8, 1.0, 1.4] {
        for is_believed in [false, true] {
            let mut flight = flight_over(AutopilotKind::ArduPilot);
            (flight.is_deaf, flight.refused) = (false, Some(22));
            flight.until(60.0, |flight| match is_believed {
                true => take_offs(flight) > 0,
                false => flight.bridge.control(0).vehicle.says_armed(),
            });
            flight.copter.disarm();
            flight.advance(off_s);
            flight.copter.is_armed = true; // by a pilot, or another ground station
            flight.refused = None;
            let ordered = take_offs(&flight);
            flight.advance(20.0);
            let what = format!("{off_s} s, {is_believed}: {:?}", flight.said);
            assert_eq!((take_offs(&flight), flight.state()), (ordered, State::Done), "{what}");
            assert_eq!(count(&flight, "its mission is over: it has disarmed"), 1, "{what}");
        }
    }
}

#[test]
fn a_vehicle_that_takes_a_second_to_arm_is_not_overridden() {
    for autopilot in KINDS {
        let mut flight = flight_over(autopilot);
        flight.until(60.0, |flight| flight.copter.is_armed);
        flight.copter.is_armed = false; // its answer is that it does
        flight.advance(1.2);
        flight.copter.is_armed = true;
        flight.until(60.0, |flight| flight.bridge.has_begun());
    }
}

#[test]
fn a_vehicle_that_jumps_gets_no_waypoints_until_its_position_is_plausible() {
    let mut flight = hovering(AutopilotKind::ArduPilot);
    let before = flight.fly_slot(1, Some(plan(50.0, 62.0)));
    flight.jump_m = 50_000.0;
    flight.advance(0.2);
    let orders = flight.orders.len();
    let report = flight.fly_slot(2, Some(plan(50.0, 66.0)));
    assert_eq!((report.flown_mode(), flight.orders.len()), (Mode::Hold, orders), "{:?}", flight.orders.last());
    assert!((report.position() - before.position()).norm() < 0.5, "{report:?}");
    assert_eq!(count(&flight, "50.0 km from where it was: it gets no waypoints meanwhile"), 1, "{:?}", flight.said);
    flight.jump_m = 0.0;
    let report = flight.fly_slot(3, Some(plan(50.0, 66.0)));
    assert_eq!((report.flown_mode(), count(&flight, "is believed again")), (Mode::Serve, 1), "{:?}", flight.said);
    flight.fly_slot(4, Some(plan(50.0, 62.0)));
    let ends = flight.bridge.ends;
    assert_eq!((ends.flown, ends.reached, ends.doubtful), (2, 2, 2), "slots 2 and 3 apart: {ends:?}");
}

#[test]
fn a_vehicle_that_does_not_know_where_it_is_gets_no_waypoints() {
    let mut flight = hovering(AutopilotKind::ArduPilot);
    flight.fly_slot(1, Some(plan(50.0, 62.0)));
    flight.says_no_position = true;
    flight.advance(2.5);
    let orders = flight.orders.len();
    let report = flight.fly_slot(2, Some(plan(50.0, 66.0)));
    assert_eq!((report.flown_mode(), flight.orders.len()), (Mode::Hold, orders), "{:?}", flight.orders.last());
    assert_eq!(count(&flight, "does not say where it is any more"), 1, "{:?}", flight.said);
    flight.says_no_position = false;
    assert_eq!(flight.fly_slot(3, Some(plan(50.0, 66.0))).flown_mode(), Mode::Serve);
}

#[test]
fn a_lost_vehicle_and_its_return_are_said_once_each() {
    let mut flight = hovering(AutopilotKind::ArduPilot);
    flight.loss = 1.0;
    flight.advance(4.5);
    flight.loss = 0.0;
    flight.advance(3.0);
    assert_eq!(
        (count(&flight, "is not heard any more"), count(&flight, "is heard again")),
        (1, 1),
        "{:?}",
        flight.said
    );
    let report = flight.fly_slot(1, Some(plan(50.0, 62.0)));
    assert_eq!(report.flown_mode(), Mode::Serve);
}

#[test]
fn one_odd_heartbeat_holds_orders_back_and_ends_nothing() {
    for autopilot in KINDS {
        let mut flight = hovering(autopilot);
        flight.fly_slot(1, Some(plan(50.0, 62.0)));
        flight.is_odd = true; // says that it is disarmed
        flight.until(2.0, |flight| !flight.is_odd);
        let report = flight.fly_slot(2, Some(plan(50.0, 66.0)));
        assert_eq!(report.flown_mode(), Mode::Serve, "{autopilot:?}: {:?}", flight.said);
        flight.bridge.return_home("the test is over");
        flight.until(120.0, |flight| flight.bridge.has_landed());
        assert!(!flight.copter.is_armed);
    }
}

#[test]
fn a_suspended_bridge_believes_nothing_that_it_has_heard_before() {
    for is_suspended in [false, true] {
        let mut flight = hovering(AutopilotKind::ArduPilot);
        flight.fly_slot(1, Some(plan(50.0, 62.0)));
        flight.orders.clear();
        let now_s = flight.now_s;
        if is_suspended {
            flight.bridge.doubt(now_s);
        }
        flight.bridge.return_home("the run is stopped");
        flight.advance(1.0); // one heartbeat
        assert_eq!(flight.orders.is_empty(), is_suspended, "{:?}", flight.orders);
        flight.advance(1.0);
        assert!(flight.orders.iter().any(|(_, order)| *order == Order::Return));
    }
}

#[test]
fn a_bridge_that_was_suspended_says_so_and_sends_its_vehicle_home() {
    let mut flight = ClosedLoop::new(&KinematicOptions { silence: 100.0, ..KinematicOptions::default() }, 0.0);
    flight.until(90.0, |flight| flight.bridge.has_begun());
    flight.fly_slot(1, Some(plan(50.0, 62.0)));
    flight.is_bridge_alive = false;
    flight.advance(35.0);
    flight.is_bridge_alive = true;
    flight.bridge.note_suspension(35.0);
    flight.bridge.doubt(flight.now_s);
    flight.advance(3.0);
    let said = "returns: no plan has come for 41 s: the bridge itself was suspended for 35 s of them";
    assert_eq!(count(&flight, said), 1, "{:?}", flight.said);
}

#[test]
fn a_run_that_stands_still_sends_its_vehicle_home() {
    let mut flight = hovering(AutopilotKind::ArduPilot);
    flight.fly_slot(1, Some(plan(50.0, 62.0)));
    flight.bridge.await_plan(); // of a slot that never begins
    flight.advance(23.0);
    assert_eq!(flight.copter.mode, CopterMode::Guided);
    flight.advance(4.0);
    assert_eq!((flight.copter.mode, count(&flight, "returns: no plan has come for 30 s")), (CopterMode::Return, 1));
}

#[test]
fn a_low_battery_in_flight_ends_the_mission_at_home() {
    let mut flight = hovering(AutopilotKind::ArduPilot);
    flight.fly_slot(1, Some(plan(50.0, 62.0)));
    flight.says_battery = Some(Telemetry::Battery(Some(0.03)));
    flight.advance(6.0);
    assert_eq!(count(&flight, "returns: its battery is at 3 %, below 15 %"), 1, "{:?}", flight.said);
    flight.until(120.0, |flight| flight.bridge.has_landed());
}

#[test]
fn a_vehicle_takes_off_with_a_charged_battery_or_if_it_says_that_it_measures_none() {
    let after = |says: Option<Telemetry>, seconds: f64| {
        let mut flight = flight_over(AutopilotKind::ArduPilot);
        flight.says_battery = says;
        flight.advance(seconds);
        (flight.copter.is_armed, flight.refusal.is_some(), count(&flight, "does not measure its battery"))
    };
    assert_eq!(after(Some(Telemetry::Battery(Some(0.05))), 20.0), (false, true, 0));
    assert_eq!(after(Some(Telemetry::Battery(None)), 20.0), (true, false, 1));
    let silent = Telemetry::Text { text: String::new(), line: 0 };
    assert_eq!(after(Some(silent), 60.0), (false, false, 0), "it waits for the battery");
}

#[test]
fn a_vehicle_that_is_not_heard_in_flight_is_left_to_its_gcs_failsafe() {
    let mut flight = hovering(AutopilotKind::ArduPilot);
    flight.fly_slot(1, Some(plan(50.0, 62.0)));
    let is_left = |flight: &ClosedLoop| flight.bridge.control(0).heartbeats(flight.now_s) == Heartbeats::Withheld;
    flight.frozen = Some(Vec::new());
    flight.advance(8.0);
    assert!(!is_left(&flight));
    flight.advance(4.0);
    assert!(is_left(&flight), "and gets no heartbeats");
    flight.frozen = None;
    flight.advance(2.5); // two reports
    assert!(!is_left(&flight));
}

#[test]
fn what_has_waited_in_a_frozen_link_overrules_no_pilot() {
    for autopilot in KINDS {
        let mut flight = hovering(autopilot);
        flight.fly_slot(1, Some(plan(50.0, 62.0)));
        flight.frozen = Some(Vec::new());
        flight.advance(3.0);
        flight.copter.change_to(CopterMode::Loiter);
        flight.advance(3.0);
        flight.bridge.await_plan();
        flight.bridge.begin(2, 0.0);
        flight.bridge.fly(&[plan(50.0, 66.0)], flight.now_s); // waits for the link
        flight.orders.clear();
        flight.thaw();
        assert_left_alone(&mut flight, "while the link was frozen");
        let overruling = flight.orders.iter().filter(|(_, order)| may_overrule(order)).count();
        assert_eq!((flight.copter.mode, overruling), (CopterMode::Loiter, 0), "{autopilot:?}: {:?}", flight.orders);
    }
}

#[test]
fn a_return_that_is_lost_is_ordered_again() {
    for autopilot in KINDS {
        let mut flight = flight_over(autopilot);
        flight.until(60.0, |flight| flight.copter.body.position_m.z > 5.0);
        flight.lost = Order::Return.command();
        flight.bridge.return_home("the test is over");
        flight.advance(1.5);
        flight.lost = None;
        flight.until(120.0, |flight| flight.bridge.has_landed());
        assert!(!flight.copter.is_armed, "{autopilot:?}: {:?}", flight.said);
    }
}

#[test]
fn a_pilot_who_stops_the_return_keeps_the_vehicle() {
    for autopilot in KINDS {
        let mut flight = hovering(autopilot);
        flight.fly_slot(1, Some(plan(50.0, 68.0)));
        flight.bridge.return_home("the mission is over");
        flight.advance(5.0);
        assert_eq!(flight.copter.mode, CopterMode::Return);
        flight.copter.change_to(CopterMode::Loiter);
        flight.advance(20.0);
        assert_eq!((flight.copter.mode, count(&flight, "is overridden")), (CopterMode::Loiter, 1), "{:?}", flight.said);
    }
}
