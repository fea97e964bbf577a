//! Pilots who do what they want, and vehicles that are not what they seem: the bridge gives way.

use rand::seq::IndexedRandom as _;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use skysink_common::message::Mode;
use skysink_kinematic_vehicle::KinematicOptions;
use skysink_kinematic_vehicle::autopilot::CopterMode;
use skysink_vehicle::autopilot::AutopilotKind;
use skysink_vehicle::control::Heartbeats;
use skysink_vehicle::telemetry::{Order, Telemetry};

use crate::flight::{ClosedLoop, plan};

pub const KINDS: [AutopilotKind; 2] = [AutopilotKind::ArduPilot, AutopilotKind::Px4];

/// A vehicle of this autopilot that says its mode once a second, whatever it is asked for.
pub fn flight_over(autopilot: AutopilotKind) -> ClosedLoop {
    let mut flight = ClosedLoop::new(&KinematicOptions::default(), 0.0);
    flight.is_a(autopilot);
    flight.is_deaf = true;
    flight
}

pub fn hovering(autopilot: AutopilotKind) -> ClosedLoop {
    let mut flight = flight_over(autopilot);
    flight.until(90.0, |flight| flight.bridge.has_begun());
    flight
}

pub fn count(flight: &ClosedLoop, words: &str) -> usize {
    flight.said.iter().filter(|line| line.contains(words)).count()
}

/// Flies on for some slots; no order comes, and the takeover is said once.
pub fn assert_left_alone(flight: &mut ClosedLoop, what: &str) {
    let since_s = flight.now_s;
    flight.advance(2.5); // two heartbeats
    for slot in 1..=6 {
        let report = flight.fly_slot(slot, Some(plan(50.0, 60.0 + slot as f64)));
        assert!([Mode::Return, Mode::Down].contains(&report.flown_mode()), "{what}: {report:?}");
    }
    let now_s = flight.now_s;
    flight.bridge.return_home("the mission is over", now_s);
    flight.advance(10.0);
    let late: Vec<_> = flight.orders.iter().filter(|(at_s, _)| *at_s > since_s).collect();
    assert!(late.is_empty(), "{what}: {late:?}");
    let ends = ["is taken over: ", "is left alone: ", "has disarmed: its mission is over"];
    assert_eq!(ends.map(|words| count(flight, words)).iter().sum::<usize>(), 1, "{what}: {:?}", flight.said);
}

#[test]
fn a_vehicle_that_somebody_else_arms_and_flies_while_the_bridge_tries_to_arm_is_left_alone() {
    for autopilot in KINDS {
        let mut flight = ClosedLoop::new(&KinematicOptions { refuse_arming: 50, ..KinematicOptions::default() }, 0.0);
        flight.is_a(autopilot);
        flight.is_deaf = true;
        let arms = |flight: &ClosedLoop| flight.orders.iter().filter(|(_, order)| *order == Order::Arm).count();
        flight.until(60.0, |flight| arms(flight) >= 3);
        flight.copter.take_off_by_hand(15.0);
        assert_left_alone(&mut flight, "flown by hand");
        assert_eq!(flight.copter.mode, CopterMode::Loiter);
    }
}

#[test]
fn a_vehicle_that_is_disarmed_while_its_motors_spool_up_is_not_armed_again() {
    for autopilot in KINDS {
        for after_s in [0.0, 0.3, 0.9, 1.5, 2.5] {
            let mut flight = flight_over(autopilot);
            flight.until(60.0, |flight| flight.copter.is_armed);
            flight.advance(after_s);
            flight.copter.disarm();
            assert_left_alone(&mut flight, "disarmed");
            assert!(!flight.copter.is_armed, "{after_s} s after it was armed");
            assert!(!flight.bridge.has_begun());
            let refusal = flight.bridge.check_flyable().unwrap_err();
            let expected = "its mission was over before it began: it has disarmed: no slot was flown";
            assert_eq!((refusal.number, &*refusal.why.to_string()), (1, expected));
        }
    }
}

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
            flight.bridge.fly(&[plan(50.0, 66.0)], now_s); // waits when the pilot acts
            flight.copter.change_to(CopterMode::Loiter);
            flight.advance(2.5);
            assert_eq!(flight.copter.mode, CopterMode::Loiter, "{autopilot:?} after {step} quarters of a second");
            assert_left_alone(&mut flight, "between two heartbeats");
            assert_eq!(flight.copter.mode, CopterMode::Loiter, "{autopilot:?} after {step} quarters of a second");
        }
    }
}

#[test]
fn a_pilot_whose_act_crosses_a_waypoint_keeps_a_vehicle_that_need_not_change_its_mode() {
    for autopilot in KINDS {
        let mut flight = flight_over(autopilot);
        flight.must_change_mode = false;
        flight.until(90.0, |flight| flight.bridge.has_begun());
        flight.fly_slot(1, Some(plan(50.0, 62.0)));
        flight.orders.clear();
        flight.crossing = Some(CopterMode::Loiter);
        flight.fly_slot(2, Some(plan(50.0, 66.0)));
        assert_eq!((flight.crossing, flight.copter.mode), (None, CopterMode::Loiter), "{autopilot:?}");
        assert_left_alone(&mut flight, "while a waypoint was under way");
        assert_eq!(flight.copter.mode, CopterMode::Loiter, "{autopilot:?}");
        assert!(!flight.orders.iter().any(|(_, order)| order.may_overrule(autopilot)), "{:?}", flight.orders);
    }
}

#[test]
fn a_vehicle_that_does_not_support_to_keep_its_mode_is_asked_once() {
    let mut flight = hovering(AutopilotKind::Px4);
    for (slot, y_m) in [(1, 62.0), (2, 66.0)] {
        let report = flight.fly_slot(slot, Some(plan(50.0, y_m)));
        assert_eq!(report.flown_mode(), Mode::Serve, "{:?}", flight.said);
    }
    let repositions = flight.orders.iter().filter_map(|(_, order)| match order {
        Order::Reposition { may_change_mode, .. } => Some(*may_change_mode),
        _ => None,
    });
    assert_eq!(repositions.collect::<Vec<_>>(), [false, true, true, true], "to its start, and two waypoints");
    assert_eq!(count(&flight, "refuses"), 0, "{:?}", flight.said);
}

/// A vehicle that says its mode four times in a second, and whether it is armed once, with late answers, just after it was armed.
fn just_armed(autopilot: AutopilotKind) -> ClosedLoop {
    let mut flight = flight_over(autopilot);
    flight.is_deaf = true;
    flight.mode_s = Some(0.24);
    flight.answer_delay_s = 0.9;
    flight.until(60.0, |flight| flight.copter.is_armed);
    flight.orders.clear();
    flight
}

#[test]
fn a_vehicle_that_is_taken_over_just_after_it_was_armed_is_not_on_the_ground_disarmed() {
    for autopilot in KINDS {
        let mut flight = just_armed(autopilot);
        flight.copter.change_to(CopterMode::Loiter);
        flight.advance(5.0);
        assert_eq!((count(&flight, "is taken over"), count(&flight, "disarmed")), (1, 0), "{:?}", flight.said);
        assert!(!flight.bridge.has_landed(), "{autopilot:?}: it waits for the landing");
        flight.copter.disarm();
        flight.until(10.0, |flight| flight.bridge.has_landed());
    }
}

#[test]
fn no_take_off_is_ordered_before_a_heartbeat_says_that_the_vehicle_is_still_armed() {
    for autopilot in KINDS {
        for step in 0..45 {
            let mut flight = just_armed(autopilot);
            flight.advance(0.06 * f64::from(step));
            let begun_s = flight.now_s;
            if flight.orders.iter().any(|(_, order)| matches!(order, Order::TakeOff(_))) {
                continue;
            }
            flight.copter.disarm();
            flight.advance(6.0);
            let late = flight.orders.iter().filter(|(at_s, _)| *at_s > begun_s + 0.02);
            let overruling: Vec<_> = late.filter(|(_, order)| order.may_overrule(autopilot)).collect();
            assert!(overruling.is_empty(), "{autopilot:?}, {step}: {overruling:?}");
        }
    }
}

#[test]
fn a_run_that_is_stopped_just_after_arming_does_not_leave_an_armed_vehicle() {
    for autopilot in KINDS {
        let mut flight = just_armed(autopilot);
        flight.bridge.return_home("the run is stopped", flight.now_s);
        assert!(!flight.bridge.has_landed(), "{autopilot:?}: it is armed");
        flight.until(10.0, |flight| flight.bridge.is_homebound());
        assert!(flight.orders.iter().any(|(_, order)| *order == Order::Return), "{:?}", flight.orders);
    }
}

#[test]
fn a_vehicle_whose_answer_is_lost_is_not_armed_again_after_its_pilot_has_disarmed_it() {
    for autopilot in KINDS {
        let mut flight = flight_over(autopilot);
        (flight.answer_loss, flight.is_deaf) = (1.0, false);
        flight.until(60.0, |flight| flight.copter.is_armed);
        flight.advance(0.2); // one heartbeat
        flight.orders.clear();
        flight.copter.disarm();
        flight.advance(12.0);
        let again = |order: &Order| matches!(order, Order::Arm | Order::TakeOff(_));
        assert!(!flight.orders.iter().any(|(_, order)| again(order)), "{autopilot:?}: {:?}", flight.orders);
        assert!(!flight.copter.is_armed && flight.bridge.has_landed(), "{:?}", flight.said);
    }
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
        flight.bridge.fly(&[plan(50.0, 66.0)], flight.now_s); // waits for a report
        flight.orders.clear();
        flight.thaw();
        assert_left_alone(&mut flight, "while the link was frozen");
        let overruling = flight.orders.iter().filter(|(_, order)| order.may_overrule(autopilot)).count();
        assert_eq!((flight.copter.mode, overruling), (CopterMode::Loiter, 0), "{autopilot:?}: {:?}", flight.orders);
    }
}

#[test]
fn a_run_that_is_stopped_while_an_order_to_arm_is_under_way_waits_for_its_effect() {
    for is_suspended in [false, true] {
        let mut flight = flight_over(AutopilotKind::ArduPilot);
        (flight.answer_loss, flight.refused) = (1.0, Some(400));
        flight.until(60.0, |flight| flight.orders.iter().any(|(_, order)| *order == Order::Arm));
        flight.advance(2.0); // it still says that it is disarmed
        if is_suspended {
            flight.bridge.doubt(flight.now_s);
        }
        flight.bridge.return_home("the run is stopped", flight.now_s);
        assert!(!flight.bridge.has_landed(), "the order may be on its way");
        flight.until(10.0, |flight| flight.bridge.has_landed());
    }
}

#[test]
fn a_pilot_who_stops_the_return_keeps_the_vehicle() {
    for autopilot in KINDS {
        let mut flight = hovering(autopilot);
        flight.fly_slot(1, Some(plan(50.0, 68.0)));
        let now_s = flight.now_s;
        flight.bridge.return_home("the mission is over", now_s);
        flight.advance(5.0);
        assert_eq!(flight.copter.mode, CopterMode::Return);
        flight.copter.change_to(CopterMode::Loiter);
        flight.advance(20.0);
        assert_eq!((flight.copter.mode, count(&flight, "is taken over")), (CopterMode::Loiter, 1), "{:?}", flight.said);
    }
}

#[test]
fn a_pilot_who_lands_while_the_return_is_refused_or_not_answered_keeps_the_vehicle() {
    for autopilot in KINDS {
        for is_refused in [true, false] {
            let mut flight = hovering(autopilot);
            flight.fly_slot(1, Some(plan(50.0, 68.0)));
            flight.refused = is_refused.then_some(20); // MAV_CMD_NAV_RETURN_TO_LAUNCH
            flight.answer_loss = 1.0;
            let now_s = flight.now_s;
            flight.bridge.return_home("the mission is over", now_s);
            flight.advance(if is_refused { 1.5 } else { 2.5 });
            flight.copter.change_to(CopterMode::Land);
            flight.advance(1.98); // two heartbeats
            assert_eq!(flight.copter.mode, CopterMode::Land, "{autopilot:?}, refused: {is_refused}");
            flight.refused = None;
            flight.orders.clear();
            flight.until(120.0, |flight| flight.bridge.has_landed());
            assert_eq!((flight.copter.mode, &*flight.orders), (CopterMode::Land, &[][..]), "{autopilot:?}");
        }
    }
}

#[test]
fn a_vehicle_is_armed_on_checks_of_that_moment() {
    let arms = |flight: &ClosedLoop| flight.orders.iter().filter(|(_, order)| *order == Order::Arm).count();
    let waiting = || {
        let mut flight = ClosedLoop::new(&KinematicOptions { refuse_arming: 5, ..KinematicOptions::default() }, 0.0);
        flight.until(60.0, |flight| arms(flight) >= 2);
        flight
    };
    let mut flight = waiting();
    flight.says_battery = Some(Telemetry::Battery(Some(0.05)));
    flight.advance(30.0);
    assert!(!flight.copter.is_armed, "{:?}", flight.said);
    let refusal = flight.bridge.check_flyable().unwrap_err().why.to_string();
    assert!(refusal.contains("its battery is at 5 %: at least 25 % is needed to take off"), "{refusal}");

    let mut flight = waiting();
    flight.says_no_position = true;
    flight.advance(30.0);
    assert!(!flight.copter.is_armed, "{:?}", flight.said);
    flight.says_no_position = false;
    flight.until(90.0, |flight| flight.bridge.has_begun());
    assert!((1..4).contains(&count(&flight, "waiting for it to know its position")), "{:?}", flight.said);
    assert_eq!(count(&flight, "refuses to be armed: MAVLink result 4"), 1, "{:?}", flight.said);

    // Nor is an order to arm that was not answered repeated.
    let unanswered = || {
        let mut flight = ClosedLoop::new(&KinematicOptions { refuse_arming: 1000, ..KinematicOptions::default() }, 0.0);
        flight.answer_loss = 1.0;
        flight.until(60.0, |flight| arms(flight) >= 2);
        flight
    };
    let mut flight = unanswered();
    assert!(flight.bridge.control(0).history().was_armed, "its order may be on its way");
    flight.says_no_position = true;
    flight.advance(4.0);
    flight.orders.clear();
    flight.advance(30.0);
    assert_eq!((arms(&flight), flight.bridge.control(0).missing()), (0, Some("to know its position")));
    assert!((2..6).contains(&count(&flight, "waiting for it to know its position")), "{:?}", flight.said);
    flight.says_no_position = false;
    flight.advance(10.0);
    assert!(arms(&flight) > 0);
    let mut flight = unanswered();
    flight.says_battery = Some(Telemetry::Battery(Some(0.05)));
    flight.advance(30.0);
    let refusal = flight.bridge.check_flyable().unwrap_err().why.to_string();
    assert!(refusal.contains("its battery is at 5 %"), "{refusal}");
}

#[test]
fn a_vehicle_that_does_not_fly_to_its_start_returns() {
    let mut flight = flight_over(AutopilotKind::ArduPilot);
    flight.refused = Some(192);
    flight.advance(500.0);
    assert!(flight.copter.is_in_air() && flight.copter.mode == CopterMode::Guided, "{:?}", flight.said);
    flight.until(300.0, |flight| flight.bridge.has_landed());
    assert_eq!(count(&flight, "returns: it does not reach its start within 600 s"), 1, "{:?}", flight.said);
}

#[test]
fn a_return_that_is_lost_is_ordered_again() {
    for autopilot in KINDS.into_iter().chain([AutopilotKind::Other]) {
        let mut flight = flight_over(autopilot);
        flight.until(60.0, |flight| flight.copter.body.position_m.z > 5.0);
        let now_s = flight.now_s;
        flight.loss = 1.0;
        flight.bridge.return_home("the test is over", now_s);
        flight.advance(0.6);
        flight.loss = 0.0;
        flight.until(120.0, |flight| flight.bridge.has_landed());
        assert!(!flight.copter.is_armed, "{autopilot:?}: {:?}", flight.said);
    }
}

#[test]
fn a_vehicle_that_is_not_heard_in_flight_is_left_to_its_dead_man_switch() {
    let mut flight = hovering(AutopilotKind::ArduPilot);
    flight.fly_slot(1, Some(plan(50.0, 62.0)));
    let is_left = |flight: &ClosedLoop| flight.bridge.control(0).heartbeats(flight.now_s) == Heartbeats::Withheld;
    flight.frozen = Some(Vec::new());
    flight.advance(8.0);
    assert!(!is_left(&flight));
    flight.advance(4.0);
    assert!(is_left(&flight), "and gets no heartbeats");
    flight.frozen = None;
    flight.advance(1.0);
    assert!(!is_left(&flight));
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
        flight.bridge.return_home("the test is over", flight.now_s);
        flight.until(120.0, |flight| flight.bridge.has_landed());
        assert!(!flight.copter.is_armed);
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
        let expected = if is_in_air { "it is in the air (GUIDED)" } else { "it is armed (GUIDED)" };
        let refusal = flight.refusal.clone().map(|refusal| refusal.why.to_string()).unwrap_or_default();
        assert!(refusal.starts_with(expected) || !is_in_air && refusal.starts_with("it is in the air"), "{refusal}");
        assert!(flight.orders.is_empty(), "{:?}", flight.orders);
    }
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
    let silent = Telemetry::Text(String::new());
    assert_eq!(after(Some(silent), 60.0), (false, false, 0), "it waits for the battery");
}

#[test]
fn only_a_dead_man_switch_that_brings_the_vehicle_down_is_accepted() {
    for (autopilot, accepted) in [(AutopilotKind::ArduPilot, [1, 3, 4].as_slice()), (AutopilotKind::Px4, &[2, 3])] {
        for value in 0..=7_u8 {
            let mut flight = flight_over(autopilot);
            flight.dead_man = Some(f32::from(value));
            flight.advance(20.0);
            let is_accepted = accepted.contains(&value);
            assert_eq!((flight.copter.is_armed, flight.refusal.is_some()), (is_accepted, !is_accepted), "{value}");
            assert_eq!(count(&flight, "when the bridge is silent ("), usize::from(is_accepted), "{:?}", flight.said);
        }
    }
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
fn a_bridge_that_was_suspended_says_so_and_sends_its_vehicle_home() {
    let mut flight = hovering(AutopilotKind::ArduPilot);
    flight.fly_slot(1, Some(plan(50.0, 62.0)));
    flight.is_bridge_alive = false;
    flight.advance(35.0);
    flight.is_bridge_alive = true;
    flight.bridge.note_suspension(35.0);
    flight.bridge.doubt(flight.now_s);
    flight.advance(1.0);
    let said = "returns: no plan has come for 41 s: the bridge itself was suspended for 35 s of them";
    assert_eq!(count(&flight, said), 1, "{:?}", flight.said);
}

#[test]
fn a_vehicle_taken_over_on_the_ground_ends_its_run_and_one_in_the_climb_once_it_has_landed() {
    for is_in_climb in [false, true] {
        let mut flight = ClosedLoop::new(&KinematicOptions { refuse_arming: 50, ..KinematicOptions::default() }, 0.0);
        if is_in_climb {
            flight = flight_over(AutopilotKind::ArduPilot);
            flight.until(60.0, |flight| flight.copter.body.position_m.z > 10.0);
        } else {
            flight.until(60.0, |flight| flight.orders.iter().any(|(_, order)| *order == Order::Arm));
        }
        flight.copter.change_to(CopterMode::Loiter);
        flight.advance(10.0);
        assert_eq!((flight.bridge.check_flyable().is_ok(), flight.bridge.has_begun()), (is_in_climb, false));
        flight.copter.disarm();
        flight.advance(10.0);
        let refusal = flight.bridge.check_flyable().unwrap_err().why.to_string();
        let expected =
            "it was taken over: its mode changed to LOITER without an order of the bridge: no slot was flown";
        assert!(refusal.ends_with(expected), "{refusal}");
    }
}

/// What a pilot does.
#[derive(Debug, Clone, Copy)]
enum Act {
    Change(CopterMode),
    Disarm,
    TakeOff,
}

/// 200 pilots act once or twice at random instants between the first heartbeat and the landing, on vehicles of both
/// kinds that say their mode once a second or five times, over links that lose messages or not. From two heartbeats after
/// an act the bridge gives no order; before that, none that undoes it.
#[test]
fn two_hundred_random_pilots_get_no_orders_after_they_act() {
    for seed in 0..200 {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let loss = *[0.0, 0.0, 0.1].choose(&mut random).unwrap();
        let options =
            KinematicOptions { seed, refuse_arming: random.random_range(0..3), ..KinematicOptions::default() };
        let mut flight = ClosedLoop::new(&options, loss);
        flight.is_a(KINDS[(seed % 2) as usize]);
        flight.is_deaf = random.random();
        flight.must_change_mode = seed % 4 == 1;
        let act_s: f64 = random.random_range(3.0..75.0);
        let act = *[
            Act::Change(CopterMode::Loiter),
            Act::Change(CopterMode::Loiter),
            Act::Change(CopterMode::Return),
            Act::Disarm,
            Act::TakeOff,
        ]
        .choose(&mut random)
        .unwrap();
        let mut slot = 0;
        while flight.now_s < act_s {
            fly_on(&mut flight, &mut slot, act_s);
        }
        let who = format!("pilot {seed}, {act:?} at {act_s:.2} s over {:?}", flight.autopilot);
        let before = (flight.copter.mode, flight.copter.is_armed);
        match act {
            Act::Change(mode) => {
                let _ = flight.copter.change_to(mode);
            }
            Act::Disarm if flight.copter.is_armed => flight.copter.disarm(),
            Act::TakeOff if !flight.copter.is_armed => flight.copter.take_off_by_hand(15.0),
            Act::Disarm | Act::TakeOff => {}
        }
        let after = (flight.copter.mode, flight.copter.is_armed);
        let is_noticed = flight.said.len();
        let acted_s = flight.now_s;
        let mut commanded = Vec::new();
        while flight.now_s < acted_s + 60.0 {
            let end_s = flight.now_s + 6.0;
            fly_on(&mut flight, &mut slot, end_s);
            commanded.extend(flight.orders.iter().filter(|(at_s, _)| *at_s > acted_s).copied());
            flight.orders.clear();
        }
        if before == after {
            continue; // nobody could see that
        }
        // Two reports in a row, the longest interval between which is that of a lossy link.
        let heartbeats_s = if loss > 0.0 { 6.0 } else { 2.1 };
        let late: Vec<_> = commanded.iter().filter(|(at_s, _)| *at_s > acted_s + heartbeats_s).collect();
        assert!(late.is_empty(), "{who}: {late:?}, {:?}", flight.said);
        let autopilot = flight.autopilot;
        let overruling: Vec<_> =
            commanded.iter().filter(|(at_s, order)| order.may_overrule(autopilot) && *at_s > acted_s + 0.02).collect();
        assert!(overruling.is_empty(), "{who}: {overruling:?}, {:?}", flight.said);
        let said = &flight.said[is_noticed..];
        let is_said = said.iter().any(|line| {
            ["is taken over", "its mission is over", "has landed"].iter().any(|words| line.contains(words))
        });
        assert!(is_said || flight.refusal.is_some() || flight.bridge.has_landed(), "{who}: {said:?}");
    }
}

/// Flies slots until `end_s` [s], and home in the tenth.
fn fly_on(flight: &mut ClosedLoop, slot: &mut u64, end_s: f64) {
    if flight.bridge.has_begun() && *slot < 8 {
        *slot += 1;
        flight.bridge.await_plan();
        flight.bridge.begin(*slot, 0.0);
        let now_s = flight.now_s;
        flight.bridge.fly(&[plan(50.0, 58.0 + *slot as f64)], now_s);
    } else if *slot == 8 {
        *slot += 1;
        let now_s = flight.now_s;
        flight.bridge.return_home("the mission is over", now_s);
    }
    let slot_end_s = (flight.now_s + 6.0).min(end_s);
    while flight.now_s < slot_end_s {
        flight.step();
    }
}

#[test]
fn one_odd_heartbeat_while_the_vehicle_is_armed_or_climbs_ends_nothing() {
    let mut flight = ClosedLoop::new(&KinematicOptions { refuse_arming: 4, ..KinematicOptions::default() }, 0.0);
    let arms = |flight: &ClosedLoop| flight.orders.iter().filter(|(_, order)| *order == Order::Arm).count();
    flight.until(60.0, |flight| arms(flight) >= 2);
    flight.advance(0.05);
    let (autopilot, mode) = (flight.autopilot, CopterMode::Guided as u32);
    flight.hear(&Telemetry::Heartbeat { autopilot, mode, is_armed: true, is_booting: false });
    flight.until(60.0, |flight| flight.copter.body.position_m.z > 5.0);
    flight.is_odd = true; // says that it is disarmed
    flight.until(2.0, |flight| !flight.is_odd);
    let now_s = flight.now_s;
    flight.bridge.return_home("the run is stopped", now_s);
    flight.until(120.0, |flight| flight.bridge.has_landed());
    assert!(!flight.copter.is_armed, "{:?}", flight.said);
    assert_eq!((count(&flight, "returns: the run is stopped"), count(&flight, "is taken over")), (1, 0));
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
fn a_suspended_bridge_believes_nothing_that_it_has_heard_before() {
    for is_suspended in [false, true] {
        let mut flight = hovering(AutopilotKind::ArduPilot);
        flight.fly_slot(1, Some(plan(50.0, 62.0)));
        flight.orders.clear();
        let now_s = flight.now_s;
        if is_suspended {
            flight.bridge.doubt(now_s);
        }
        flight.bridge.return_home("the run is stopped", now_s);
        flight.advance(1.0); // one heartbeat
        assert_eq!(flight.orders.is_empty(), is_suspended, "{:?}", flight.orders);
        flight.advance(1.0);
        assert!(flight.orders.iter().any(|(_, order)| *order == Order::Return));
    }
}
