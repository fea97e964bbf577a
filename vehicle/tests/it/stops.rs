//! Stops, and bridges that begin after them: whom the bridge believes, and leaves alone.

use skysink_common::message::SensorNode;
use skysink_kinematic_vehicle::KinematicOptions;
use skysink_kinematic_vehicle::autopilot::CopterMode;
use skysink_vehicle::autopilot::AutopilotKind;
use skysink_vehicle::bridge::Bridge;
use skysink_vehicle::control::{Fate, Heartbeats, History, Phase};
use skysink_vehicle::frame::AreaFrame;
use skysink_vehicle::preflight::Beginning;
use skysink_vehicle::saved::SavedVehicles;
use skysink_vehicle::telemetry::{Order, Telemetry};

use crate::flight::{ClosedLoop, HOME, RESTARTED, plan, scenario};
use crate::pilot::{KINDS, count, flight_over, hovering};
use crate::restarts::restarted;

const BEFORE_SLOT: Beginning = Beginning::Restarted { in_mission: false };

/// A bridge that begins so, with a vehicle on the ground that begins to speak after a second.
fn begun_late(beginning: Beginning, history: Option<History>) -> ClosedLoop {
    let options = KinematicOptions::default();
    let reports = ClosedLoop::new(&options, 0.0).reports;
    let mut flight = ClosedLoop::after(&scenario(""), &options, 0.0, reports.clone(), beginning);
    if beginning == BEFORE_SLOT {
        flight.bridge.go_on(history.into_iter(), 0, &reports);
    }
    flight
}

#[test]
fn a_vehicle_that_is_first_heard_after_the_stop_is_not_armed() {
    for autopilot in [AutopilotKind::ArduPilot, AutopilotKind::Px4, AutopilotKind::Other] {
        for beginning in [Beginning::Resumed, BEFORE_SLOT] {
            let mut flight = begun_late(beginning, Some(History { was_down: true, ..History::default() }));
            flight.is_a(autopilot);
            flight.condition = Some(if autopilot == AutopilotKind::Px4 { 0.0 } else { 255.0 });
            flight.copter.boot_s = 100.0;
            flight.bridge.return_home("the run is stopped", 0.0);
            flight.advance(11.0);
            assert!(flight.orders.is_empty(), "{autopilot:?}, {beginning:?}: {:?}, {:?}", flight.orders, flight.said);
        }
    }
}

#[test]
fn a_vehicle_that_has_come_home_meanwhile_has_landed() {
    for beginning in [RESTARTED, BEFORE_SLOT] {
        let mut before = hovering(AutopilotKind::ArduPilot);
        let now_s = before.now_s;
        before.bridge.return_home("its battery is low", now_s);
        before.fly_slot(1, None);
        before.until(150.0, |before| !before.copter.is_armed);
        let mut flight = restarted(&before, beginning);
        for _ in 0..1000 {
            flight.step();
            assert!(flight.bridge.taken_over().is_empty(), "{beginning:?}: {:?}", flight.said);
        }
        assert_eq!(count(&flight, "is taken over"), 0, "{:?}", flight.said);
        assert!(flight.bridge.has_landed(), "{beginning:?}: {:?}", flight.said);
    }
}

#[test]
fn a_bridge_after_one_that_saved_nothing_flies_nobody_in_the_air() {
    let saved = SavedVehicles::of(tempfile::tempdir().unwrap().path(), true, 1);
    let mut flight = begun_late(BEFORE_SLOT, saved.vehicles().first().map(|vehicle| vehicle.history));
    flight.copter.take_off_by_hand(20.0);
    flight.copter.body.position_m.z = 20.0;
    flight.copter.mode = CopterMode::Guided; // by another ground station
    flight.advance(20.0);
    assert!(flight.orders.is_empty(), "{:?}, {:?}", flight.orders, flight.said);
}

#[test]
fn an_unknown_autopilot_may_be_sent_home_in_its_climb() {
    for is_refused_for_long in [true, false] {
        let mut flight = flight_over(AutopilotKind::Other);
        flight.until(60.0, |flight| flight.copter.body.position_m.z > 5.0);
        flight.refused = Order::Return.command();
        let now_s = flight.now_s;
        flight.bridge.return_home("its battery is low", now_s);
        flight.advance(if is_refused_for_long { 40.0 } else { 2.5 });
        flight.refused = None;
        if is_refused_for_long {
            assert_eq!(flight.copter.mode, CopterMode::Guided);
            assert_eq!(flight.bridge.control(0).heartbeats(flight.now_s), Heartbeats::Withheld, "{:?}", flight.said);
        } else {
            flight.advance(20.0);
            assert_eq!(flight.copter.mode, CopterMode::Return);
            assert_eq!(count(&flight, "is taken over"), 0, "{:?}", flight.said);
        }
    }
}

#[test]
fn the_only_vehicle_is_not_sent_home_if_it_may_be_another() {
    let mut before = hovering(AutopilotKind::ArduPilot);
    before.fly_slot(1, Some(plan(50.0, 62.0)));
    let mut flight = restarted(&before, RESTARTED);
    flight.dead_man = None; // the bridge waits for it
    flight.advance(5.0);
    let now_s = flight.now_s;
    flight.bridge.refuse(0, "system 1 is heard from two".to_owned(), now_s).unwrap_err();
    flight.bridge.return_home("the bridge ends, with the error that follows", now_s);
    flight.advance(2.5);
    assert!(flight.orders.is_empty(), "{:?}", flight.orders);
    assert_eq!(flight.bridge.control(0).heartbeats(flight.now_s), Heartbeats::Withheld);
    let fates: Vec<_> = flight.bridge.fates().collect();
    assert_eq!((fates, flight.bridge.taken_over()), (vec![Fate::Open], vec![]), "it may be flown by the next run");
}

#[test]
fn a_vehicle_left_by_an_earlier_bridge_that_does_not_say_where_it_is_gets_no_heartbeats_in_the_end() {
    let reports = ClosedLoop::new(&KinematicOptions::default(), 0.0).reports;
    let mut bridge =
        Bridge::new(&scenario(""), &[SensorNode::default()], AreaFrame::at(HOME), &reports, RESTARTED, &[255]);
    let mut heartbeats = Vec::new();
    for tenth in 1..1600 {
        let now_s = f64::from(tenth) / 10.0;
        let autopilot = AutopilotKind::ArduPilot;
        let heartbeat = Telemetry::Heartbeat { autopilot, mode: 4, is_armed: true, is_booting: false };
        bridge.hear(0, &heartbeat, now_s);
        bridge.poll(now_s, |_, _| {}, |_, _| {}).unwrap();
        heartbeats.push(bridge.control(0).heartbeats(now_s));
    }
    assert_eq!((heartbeats[1000], heartbeats[1590]), (Heartbeats::Due, Heartbeats::Withheld));
}

#[test]
fn a_pilot_of_an_unknown_autopilot_that_does_not_return_gets_no_further_order_to() {
    for is_refused in [true, false] {
        let mut flight = hovering(AutopilotKind::Other);
        flight.fly_slot(1, Some(plan(50.0, 68.0)));
        flight.answer_loss = if is_refused { 0.0 } else { 1.0 };
        flight.refused = Order::Return.command();
        let now_s = flight.now_s;
        flight.bridge.return_home("the mission is over", now_s);
        flight.advance(2.5);
        flight.copter.change_to(CopterMode::Loiter);
        flight.advance(2.5);
        flight.orders.clear();
        flight.refused = None;
        flight.advance(8.0);
        assert!(flight.orders.is_empty(), "refused {is_refused}: {:?}, {:?}", flight.orders, flight.said);
        assert_eq!(flight.copter.mode, CopterMode::Loiter);
    }
}

#[test]
fn an_unknown_autopilot_left_without_a_position_gets_no_heartbeats_in_the_end() {
    let mut before = hovering(AutopilotKind::Other);
    before.fly_slot(1, Some(plan(50.0, 62.0)));
    let mut flight = restarted(&before, RESTARTED);
    flight.says_no_position = true;
    flight.advance(160.0);
    assert_eq!(flight.bridge.control(0).heartbeats(flight.now_s), Heartbeats::Withheld, "{:?}", flight.said);
}

#[test]
fn a_vehicle_that_has_touched_down_on_its_return_as_the_bridge_is_restarted_is_not_taken_over() {
    let mut before = hovering(AutopilotKind::ArduPilot);
    let now_s = before.now_s;
    before.bridge.return_home("its battery is low", now_s);
    before.fly_slot(1, None);
    before.until(150.0, |before| !before.copter.is_armed);
    (before.copter.is_armed, before.copter.boot_s) = (true, 5.0); // for some seconds yet
    let mut flight = restarted(&before, RESTARTED);
    flight.heartbeat_s = 0.2;
    flight.hear(&Telemetry::InAir(false));
    flight.advance(1.5);
    flight.copter.is_armed = false;
    flight.until(20.0, |flight| flight.bridge.has_landed());
    assert!(count(&flight, "is taken over") == 0 && flight.orders.is_empty(), "{:?}", flight.said);
    assert_eq!(flight.bridge.fates().collect::<Vec<_>>(), [Fate::Ended]);
}

#[test]
fn a_vehicle_that_returns_and_does_not_say_where_it_is_as_the_bridge_is_restarted_is_not_taken_over() {
    for autopilot in [AutopilotKind::ArduPilot, AutopilotKind::Px4, AutopilotKind::Other] {
        let mut before = hovering(autopilot);
        before.fly_slot(1, Some(plan(50.0, 90.0)));
        let now_s = before.now_s;
        before.bridge.return_home("its battery is low", now_s);
        before.advance(3.6);
        let mut flight = restarted(&before, RESTARTED);
        (flight.is_deaf, flight.says_no_position) = (true, true);
        flight.until(3.0, |flight| flight.bridge.control(0).vehicle.autopilot.is_some());
        flight.copter.change_to(CopterMode::Land); // the last part of its return
        flight.advance(160.0);
        assert_eq!(count(&flight, "is taken over"), 0, "{autopilot:?}: {:?}", flight.said);
        assert_ne!(flight.bridge.control(0).heartbeats(flight.now_s), Heartbeats::Due, "{autopilot:?}");
    }
}

/// Its modes of take-off and of hovering are not known; the order to return is refused, or lost.
#[test]
fn an_unknown_autopilot_whose_mode_changes_itself_in_its_climb_is_not_taken_for_one_that_returns() {
    let mut flight = flight_over(AutopilotKind::Other);
    flight.until(60.0, |flight| flight.take_offs > 0);
    flight.copter.mode = CopterMode::Loiter; // that of its take-off
    flight.until(60.0, |flight| flight.copter.body.position_m.z > 5.0);
    flight.refused = Order::Return.command();
    flight.answer_loss = 1.0;
    let now_s = flight.now_s;
    flight.bridge.return_home("its battery is low", now_s);
    flight.until(3.0, |flight| flight.orders.iter().any(|(_, order)| *order == Order::Return));
    flight.advance(0.2);
    flight.copter.mode = CopterMode::Guided; // it hovers
    flight.advance(2.5);
    assert!(!flight.bridge.is_homebound(), "{:?}", flight.said);
    flight.orders.clear();
    flight.advance(30.0);
    assert!(flight.orders.is_empty(), "it may be a pilot: {:?}", flight.orders);
    assert_eq!(flight.bridge.control(0).heartbeats(flight.now_s), Heartbeats::Withheld, "{:?}", flight.said);
}

#[test]
fn a_vehicle_whose_run_is_stopped_between_arming_and_take_off_is_not_taken_over() {
    for (autopilot, is_deaf) in KINDS.into_iter().flat_map(|autopilot| [(autopilot, false), (autopilot, true)]) {
        for tenths in 0..30 {
            let mut flight = flight_over(autopilot);
            flight.is_deaf = is_deaf;
            flight.answer_delay_s = 0.1;
            flight.until(60.0, |flight| flight.copter.is_armed);
            flight.advance(f64::from(tenths) / 10.0);
            let now_s = flight.now_s;
            flight.bridge.return_home("the run is stopped", now_s);
            flight.advance(2.5);
            assert_eq!(count(&flight, "is taken over"), 0, "{autopilot:?}, {tenths}: {:?}", flight.said);
        }
    }
}

#[test]
fn a_restarted_bridge_of_a_resumed_run_waits_for_the_landing_as_the_one_before_did() {
    for autopilot in KINDS {
        let mut before = hovering(autopilot);
        before.fly_slot(1, Some(plan(50.0, 62.0)));
        let now_s = before.now_s;
        before.bridge.return_home("the run is stopped", now_s);
        before.until(2.5, |before| before.bridge.is_homebound());
        let mut resumed = restarted(&before, Beginning::Resumed);
        resumed.is_a(autopilot);
        resumed.advance(3.0);
        assert_eq!(resumed.bridge.control(0).missing(), Some("to land"));
        let mut flight = restarted(&resumed, BEFORE_SLOT);
        flight.is_a(autopilot);
        flight.until(200.0, |flight| flight.bridge.has_begun());
        assert_eq!(count(&flight, "is taken over"), 0, "{autopilot:?}: {:?}", flight.said);
    }
}

#[test]
fn a_vehicle_that_is_checked_and_was_not_ordered_to_arm_is_not_told_to_return() {
    for autopilot in KINDS {
        let mut flight = flight_over(autopilot);
        flight.until(60.0, |flight| flight.bridge.control(0).phase() == Phase::Arming);
        assert!(!flight.orders.iter().any(|(_, order)| *order == Order::Arm), "{autopilot:?}");
        let now_s = flight.now_s;
        flight.bridge.return_home("the run is stopped", now_s);
        flight.advance(2.5);
        let order = flight.orders.iter().find(|(_, order)| matches!(order, Order::Arm | Order::Return));
        assert_eq!(
            (order, flight.bridge.control(0).phase()),
            (None, Phase::Landed),
            "{autopilot:?}: {:?}",
            flight.said
        );
    }
}

#[test]
fn a_mission_that_had_ended_before_a_restart_had_begun_if_slots_were_flown() {
    for (beginning, is_begun) in [(RESTARTED, true), (BEFORE_SLOT, false)] {
        for fate in [Fate::Returns, Fate::Ended, Fate::Left, Fate::Abandoned] {
            let options = KinematicOptions::default();
            let reports = ClosedLoop::new(&options, 0.0).reports;
            let mut flight = ClosedLoop::after(&scenario(""), &options, 0.0, reports.clone(), beginning);
            let history = History { was_armed: true, fate, ..History::default() };
            flight.bridge.go_on(std::iter::once(history), 1, &reports);
            assert_eq!(flight.bridge.control(0).has_begun(), is_begun, "{beginning:?}, {fate:?}");
        }
    }
}

#[test]
fn a_vehicle_that_disarms_as_the_run_stops_is_off_and_one_that_says_so_once_is_not() {
    for autopilot in KINDS {
        for (is_off, is_odd) in [(true, false), (false, true), (false, false)] {
            let mut flight = hovering(autopilot);
            flight.fly_slot(1, Some(plan(50.0, 62.0)));
            flight.advance(0.1); // after a heartbeat
            if is_off {
                flight.copter.disarm();
                flight.advance(0.2);
            } else if is_odd {
                flight.is_odd = true;
                flight.until(5.0, |flight| !flight.is_odd);
            }
            let now_s = flight.now_s;
            flight.bridge.return_home("the run is stopped", now_s);
            flight.advance(2.5);
            assert!(flight.bridge.are_off().eq([is_off]), "{autopilot:?}, odd {is_odd}: {:?}", flight.said);
        }
    }
}

/// Reports of the mode come more often than heartbeats, and do not say whether it is armed.
#[test]
fn a_vehicle_that_disarms_between_two_heartbeats_as_the_run_stops_is_off_and_one_that_lands_is_not() {
    for autopilot in KINDS {
        for (is_off, is_late) in [(true, false), (true, true), (false, false)] {
            let mut flight = hovering(autopilot);
            flight.fly_slot(1, Some(plan(50.0, 62.0)));
            flight.mode_s = Some(0.2);
            flight.until(2.0, |flight| flight.steps.is_multiple_of(50)); // of its heartbeats
            flight.advance(0.1);
            let mode = flight.mode();
            if is_off {
                flight.copter.disarm();
            }
            flight.advance(0.1);
            let now_s = flight.now_s;
            flight.bridge.return_home("the run is stopped", now_s);
            flight.advance(0.1);
            if is_late {
                flight.hear(&Telemetry::Heartbeat { autopilot, mode, is_armed: true, is_booting: false }); // of before
            }
            flight.until(2.5, |flight| flight.bridge.is_homebound());
            assert!(flight.bridge.are_off().eq([is_off]), "{autopilot:?}: {:?}", flight.said);
            flight.until(150.0, |flight| flight.bridge.has_landed()); // as in the time of a fast simulation
            assert!(flight.bridge.are_off().eq([is_off]), "{autopilot:?}: {:?}", flight.said);
        }
    }
}
