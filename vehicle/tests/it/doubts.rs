//! Vehicles that say what is not so, nothing at all, or that they refuse: what the bridge believes of that, and does.

use skysink_kinematic_vehicle::KinematicOptions;
use skysink_kinematic_vehicle::autopilot::CopterMode;
use skysink_vehicle::autopilot::AutopilotKind;
use skysink_vehicle::control::Heartbeats;
use skysink_vehicle::telemetry::{Order, Telemetry};

use crate::flight::{ClosedLoop, plan};
use crate::pilot::{KINDS, count, flight_over, hovering};

#[test]
fn a_vehicle_in_the_air_that_says_it_is_disarmed_is_not_taken_for_landed() {
    let mut flight = flight_over(AutopilotKind::ArduPilot);
    flight.heartbeat_s = 0.2;
    flight.until(90.0, |flight| flight.copter.body.position_m.z > 8.0);
    for _ in 0..2 {
        flight.is_odd = true;
        flight.until(5.0, |flight| !flight.is_odd);
    }
    let now_s = flight.now_s;
    flight.bridge.return_home("the run is stopped", now_s);
    flight.until(90.0, |flight| !flight.copter.is_armed);
    assert_eq!(flight.orders.last().map(|(_, order)| order), Some(&Order::Return), "{:?}", flight.said);
}

#[test]
fn late_copies_of_a_heartbeat_from_before_take_off_end_no_mission() {
    for autopilot in KINDS {
        let mut flight = flight_over(autopilot);
        flight.until(60.0, |flight| flight.take_offs > 0);
        let mode = flight.mode();
        for _ in 0..3 {
            flight.hear(&Telemetry::Heartbeat { autopilot, mode, is_armed: false, is_booting: false });
            flight.hear(&Telemetry::InAir(false));
            flight.advance(0.02);
        }
        flight.until(60.0, |flight| flight.bridge.has_begun());
    }
}

#[test]
fn a_landing_with_which_the_mode_changes_is_no_takeover() {
    let mut flight = hovering(AutopilotKind::Px4);
    flight.heartbeat_s = 0.2;
    let now_s = flight.now_s;
    flight.bridge.return_home("the mission is over", now_s);
    flight.until(120.0, |flight| !flight.copter.is_armed);
    flight.copter.mode = CopterMode::Guided; // Hold, as before the return
    flight.until(10.0, |flight| flight.bridge.has_landed());
    assert_eq!([count(&flight, "is taken over"), count(&flight, "has landed")], [0, 1], "{:?}", flight.said);
}

#[test]
fn a_vehicle_that_is_silent_after_take_off_is_not_taken_for_one_on_the_ground() {
    let mut flight = flight_over(AutopilotKind::ArduPilot);
    flight.until(60.0, |flight| flight.take_offs > 0);
    flight.is_bridge_alive = false; // it hears nothing
    for _ in 0..130 {
        flight.advance(1.0);
        let now_s = flight.now_s;
        let _ = flight.bridge.poll(now_s, |_, _| {}, |_, _| {});
    }
    assert!(count(&flight, "stays on the ground") == 0 && !flight.bridge.has_landed(), "{:?}", flight.said);
    flight.is_bridge_alive = true;
    flight.until(120.0, |flight| flight.bridge.has_landed());
    assert_eq!(count(&flight, "has landed"), 1, "its dead-man switch has brought it home: {:?}", flight.said);
}

#[test]
fn a_vehicle_that_refuses_to_return_is_left_to_its_dead_man_switch() {
    let mut flight = hovering(AutopilotKind::ArduPilot);
    flight.refused = Order::Return.command();
    let now_s = flight.now_s;
    flight.bridge.return_home("the mission is over", now_s);
    flight.advance(29.0);
    let heartbeats = |flight: &ClosedLoop| flight.bridge.control(0).heartbeats(flight.now_s);
    assert_eq!(heartbeats(&flight), Heartbeats::Due);
    assert_eq!(count(&flight, "refuses to return: MAVLink result 4; it is asked again"), 1, "{:?}", flight.said);
    flight.advance(2.0);
    assert_eq!(heartbeats(&flight), Heartbeats::Withheld);
    flight.copter.change_to(CopterMode::Return); // by its dead-man switch
    flight.advance(2.5);
    assert_eq!(heartbeats(&flight), Heartbeats::Due);
}

#[test]
fn a_vehicle_that_refuses_to_take_off_ends_its_mission_on_the_ground() {
    let mut flight = flight_over(AutopilotKind::ArduPilot);
    flight.refused = Some(22);
    flight.until(60.0, |flight| flight.take_offs > 0);
    for _ in 0..125 {
        flight.advance(1.0);
        flight.copter.boot_s -= 1.0; // so that it does not disarm by itself
    }
    assert!(flight.bridge.has_landed(), "{:?}", flight.said);
    assert_eq!(count(&flight, "refuses to take off: MAVLink result 4; it is asked again"), 1, "{:?}", flight.said);
    assert_eq!(count(&flight, "stays on the ground: it does not take off within 120 s"), 1, "{:?}", flight.said);
    assert_eq!(flight.bridge.control(0).heartbeats(flight.now_s), Heartbeats::Withheld, "its motors run");
    flight.refused = None;
    let orders = flight.orders.len();
    flight.advance(60.0);
    assert_eq!((flight.orders.len(), flight.copter.body.position_m.z), (orders, 0.0));
}

#[test]
fn an_order_to_arm_that_is_refused_is_repeated_after_some_time() {
    let mut flight = ClosedLoop::new(&KinematicOptions { refuse_arming: 4, ..KinematicOptions::default() }, 0.0);
    flight.until(60.0, |flight| flight.copter.is_armed);
    let orders: Vec<f64> =
        flight.orders.iter().filter(|(_, order)| *order == Order::Arm).map(|(at_s, _)| *at_s).collect();
    let apart_s = orders.windows(2).map(|pair| pair[1] - pair[0]);
    assert!(orders.len() == 5 && apart_s.clone().all(|apart_s| apart_s > 0.9), "{orders:?}");
}

#[test]
fn a_px4_that_refuses_a_waypoint_for_another_reason_is_not_asked_to_change_its_mode() {
    let mut flight = flight_over(AutopilotKind::Px4);
    flight.must_change_mode = false;
    flight.until(90.0, |flight| flight.bridge.has_begun());
    let given = flight.orders.len();
    let to_start = flight.orders.iter().find(|(_, order)| matches!(order, Order::Reposition { .. }));
    flight.refused = to_start.and_then(|(_, order)| order.command());
    assert_eq!(flight.fly_slot(1, Some(plan(50.0, 62.0))).refused, 1, "{:?}", flight.said);
    let changes_mode = |order: &Order| matches!(order, Order::Reposition { may_change_mode: true, .. });
    assert!(!flight.orders[given..].iter().any(|(_, order)| changes_mode(order)), "{:?}", flight.orders);
}
