//! Bridges after another: a bridge that was restarted in a run, and a run that was stopped and is resumed.

use skysink_common::message::{Mode, Plan, SensorNode};
use skysink_kinematic_vehicle::KinematicOptions;
use skysink_kinematic_vehicle::autopilot::CopterMode;
use skysink_vehicle::autopilot::AutopilotKind;
use skysink_vehicle::bridge::{Bridge, start};
use skysink_vehicle::control::{Fate, Heartbeats, History, Phase};
use skysink_vehicle::frame::AreaFrame;
use skysink_vehicle::preflight::Beginning;
use skysink_vehicle::telemetry::{Order, Telemetry};

use crate::flight::{ClosedLoop, HOME, RESTARTED, plan, scenario};
use crate::pilot::{assert_left_alone, count, flight_over, hovering};

#[test]
fn a_vehicle_that_was_down_when_the_run_was_stopped_stays_down() {
    let mut before = hovering(AutopilotKind::ArduPilot);
    before.fly_slot(1, Some(plan(50.0, 62.0)));
    before.reports[0].mode = Mode::Down as u32;
    for beginning in [Beginning::Resumed, RESTARTED] {
        let reports = before.reports.clone();
        let mut flight = ClosedLoop::after(&scenario(""), &KinematicOptions::default(), 0.0, reports, beginning);
        let history = History { was_armed: true, fate: Fate::Left, ..History::default() }; // it was taken over before it landed
        flight.bridge.go_on(std::iter::once(history), 1, &before.reports);
        flight.advance(60.0);
        assert!(flight.orders.is_empty() && !flight.copter.is_armed, "{:?}", flight.said);
        assert_eq!(count(&flight, "was down before, and stays down"), 1);
        // The slots go on, as without a stop, and nobody waits for it.
        assert!(flight.bridge.check_flyable().is_ok() && flight.bridge.has_begun() && flight.bridge.has_landed());
        assert_eq!(flight.fly_slot(2, Some(plan(50.0, 62.0))).flown_mode(), Mode::Down);
    }
}

/// A restarted bridge over the vehicle of `before`, with what that bridge has saved.
pub fn restarted(before: &ClosedLoop, beginning: Beginning) -> ClosedLoop {
    let reports = before.reports.clone();
    let mut flight = ClosedLoop::after(&scenario(""), &KinematicOptions::default(), 0.0, reports, beginning);
    if beginning != Beginning::Resumed {
        let slot = u64::from(before.reports[0].time_s > 0.0);
        flight.bridge.go_on(before.bridge.histories(), slot, &before.reports);
    }
    (flight.copter, flight.start_m) = (before.copter.clone(), before.start_m);
    flight.autopilot = before.autopilot;
    flight
}

#[test]
fn what_a_bridge_before_has_armed_is_not_armed_again() {
    let mut before = flight_over(AutopilotKind::ArduPilot);
    before.until(60.0, |before| before.copter.is_armed);
    before.copter.disarm(); // while there is no bridge
    let mut flight = restarted(&before, Beginning::Restarted { in_mission: false });
    flight.advance(60.0);
    assert!(flight.orders.is_empty() && !flight.copter.is_armed, "{:?}", flight.said);
    let why = flight.bridge.check_flyable().unwrap_err().why.to_string();
    assert!(why.contains("it is on the ground, after it was armed"), "{why}");
}

#[test]
fn a_vehicle_that_takes_off_by_an_order_of_the_bridge_before_is_left_to_its_dead_man_switch() {
    let mut before = flight_over(AutopilotKind::ArduPilot);
    before.until(60.0, |before| before.take_offs > 0);
    let mut flight = restarted(&before, Beginning::Restarted { in_mission: false });
    flight.heartbeat_s = 0.2; // it is heard before it is in the air
    flight.advance(20.0);
    assert!(
        flight.orders.is_empty() && count(&flight, "is left to its dead-man switch: it is armed on the ground") == 1,
        "{:?}",
        flight.said
    );
    assert_eq!(flight.bridge.control(0).heartbeats(flight.now_s), Heartbeats::Withheld);
}

#[test]
fn a_vehicle_that_was_sent_home_or_taken_over_before_a_run_was_stopped_is_not_flown_again() {
    let mut before = hovering(AutopilotKind::ArduPilot);
    before.copter.change_to(CopterMode::Loiter);
    before.advance(2.5);
    assert_eq!(before.fly_slot(1, Some(plan(50.0, 62.0))).flown_mode(), Mode::Return);
    before.copter.change_to(CopterMode::Land);
    before.until(120.0, |before| !before.copter.is_armed);
    let mut flight = restarted(&before, Beginning::Resumed);
    flight.advance(60.0);
    assert!(flight.orders.is_empty() && !flight.copter.is_armed, "{:?}", flight.said);
    assert!(flight.bridge.check_flyable().is_ok() && flight.bridge.has_begun() && flight.bridge.has_landed());
}

#[test]
fn a_restarted_bridge_sends_home_what_must_not_fly_on_and_lets_a_climb_end() {
    let mut before = hovering(AutopilotKind::ArduPilot);
    before.fly_slot(1, Some(plan(50.0, 62.0)));
    let mut flight = restarted(&before, RESTARTED);
    flight.says_battery = Some(Telemetry::Battery(Some(0.05)));
    flight.until(150.0, |flight| flight.bridge.has_landed());
    assert_eq!((flight.copter.is_armed, count(&flight, "is taken over")), (false, 0), "{:?}", flight.said);

    let mut before = flight_over(AutopilotKind::ArduPilot);
    before.until(60.0, |before| before.copter.body.position_m.z > 3.0);
    let mut flight = restarted(&before, Beginning::Restarted { in_mission: false });
    flight.until(60.0, |flight| flight.orders.iter().any(|(_, order)| matches!(order, Order::Reposition { .. })));
    assert!(flight.copter.body.position_m.z > 18.0, "{:?}", flight.copter);
    flight.until(60.0, |flight| flight.bridge.has_begun());
}

#[test]
fn a_return_that_has_no_effect_is_ordered_again_after_a_restart_though_one_was_seen_before_the_flight() {
    let mut before = hovering(AutopilotKind::ArduPilot);
    before.fly_slot(1, Some(plan(50.0, 62.0)));
    let mut flight = restarted(&before, Beginning::Resumed);
    flight.copter.change_to(CopterMode::Return); // by the end of the run before
    flight.until(200.0, |flight| !flight.copter.is_armed);
    flight.until(200.0, |flight| flight.bridge.has_begun());
    flight.fly_slot(2, Some(plan(50.0, 66.0)));
    flight.refused = Order::Return.command();
    let now_s = flight.now_s;
    flight.bridge.return_home("its battery is low", now_s);
    flight.fly_slot(3, None);
    assert_eq!(flight.copter.mode, CopterMode::Guided);
    let mut next = restarted(&flight, RESTARTED);
    next.until(200.0, |next| next.bridge.has_landed());
    assert!(!next.copter.is_armed && count(&next, "is taken over") == 0, "{:?}", next.said);
}

#[test]
fn what_a_bridge_has_seen_before_it_flew_is_known_to_the_next_one() {
    const BEFORE_SLOT: Beginning = Beginning::Restarted { in_mission: false };
    let mut flown = hovering(AutopilotKind::ArduPilot);
    flown.fly_slot(1, Some(plan(50.0, 62.0)));
    // On the ground, disarmed: whoever arms it is somebody else.
    let reports = flown.reports.clone();
    let mut before = ClosedLoop::after(&scenario(""), &KinematicOptions::default(), 0.0, reports, Beginning::Resumed);
    before.dead_man = None; // waits for it
    before.advance(30.0);
    let mut next = restarted(&before, BEFORE_SLOT);
    next.copter.take_off_by_hand(15.0);
    next.copter.mode = CopterMode::Guided;
    next.advance(20.0);
    assert!(
        next.orders.is_empty() && count(&next, "is taken over: somebody else has armed it") == 1,
        "{:?}",
        next.said
    );
    // On its way home: whoever stops that is somebody else.
    let mut before = restarted(&flown, Beginning::Resumed);
    before.copter.change_to(CopterMode::Return);
    before.advance(3.0);
    let mut next = restarted(&before, BEFORE_SLOT);
    next.copter.mode = CopterMode::Guided;
    next.advance(20.0);
    let end = "is taken over: its return was stopped without an order of the bridge";
    assert!(next.orders.is_empty() && count(&next, end) == 1, "{:?}", next.said);
}

#[test]
fn an_order_to_arm_that_was_not_sent_is_forgotten_unless_another_has_no_answer_yet() {
    let is_remembered = |orders: usize| {
        let mut flight = ClosedLoop::new(&KinematicOptions { refuse_arming: 50, ..KinematicOptions::default() }, 0.0);
        flight.answer_loss = 1.0;
        let arms = |flight: &ClosedLoop| flight.orders.iter().filter(|(_, order)| *order == Order::Arm).count();
        flight.until(60.0, |flight| arms(flight) == orders);
        flight.bridge.forget_arming(0); // the last one
        flight.bridge.histories().next().unwrap().was_armed
    };
    assert_eq!([1, 2].map(is_remembered), [false, true]);
}

#[test]
fn a_vehicle_in_the_air_that_says_it_is_disarmed_before_its_first_position_is_flown_on() {
    let mut before = hovering(AutopilotKind::ArduPilot);
    before.fly_slot(1, Some(plan(50.0, 62.0)));
    let mut flight = restarted(&before, RESTARTED);
    flight.heartbeat_s = 0.2;
    flight.says_no_position = true;
    for _ in 0..2 {
        flight.is_odd = true;
        flight.until(5.0, |flight| !flight.is_odd);
    }
    flight.says_no_position = false;
    flight.until(30.0, |flight| flight.bridge.control(0).phase() == Phase::Flying);
}

#[test]
fn a_landed_vehicle_that_knows_no_position_ends_its_mission_under_the_next_bridge() {
    let mut before = hovering(AutopilotKind::ArduPilot);
    before.fly_slot(1, Some(plan(50.0, 62.0)));
    let mut flight = restarted(&before, RESTARTED);
    flight.copter.change_to(CopterMode::Land);
    flight.is_bridge_alive = false;
    flight.until(90.0, |flight| !flight.copter.is_armed);
    flight.is_bridge_alive = true;
    flight.says_no_position = true;
    flight.advance(20.0);
    assert!(flight.bridge.has_landed() && flight.orders.is_empty(), "{:?}", flight.said);
}

#[test]
fn a_vehicle_does_not_wait_for_ever_for_another_that_is_not_heard() {
    let both = scenario("uav.count = 2\nuav.coordination = 'partition'\n");
    let mut flight = hovering(AutopilotKind::ArduPilot);
    let frame = AreaFrame::at(HOME);
    let bridge_after =
        |beginning| Bridge::new(&both, &[SensorNode::default()], frame, &start(&both), beginning, &[255, 255]);
    // Before its mission it ends the run.
    let mut new = hovering(AutopilotKind::ArduPilot);
    new.bridge = bridge_after(Beginning::Resumed);
    new.until(240.0, |new| new.refusal.is_some());
    let refusal = new.refusal.unwrap();
    assert_eq!(
        (refusal.number, &*refusal.why.to_string()),
        (2, "it is not ready 150 s after another: no slot is flown")
    );
    // So does one that must not be flown, unless another is in flight.
    assert_eq!(bridge_after(Beginning::New).refuse(1, "two of them".to_owned(), 0.0).unwrap_err().number, 2);
    // In the middle it goes on without the other.
    flight.bridge = bridge_after(RESTARTED);
    flight.advance(120.0);
    assert!(!flight.bridge.has_begun() && flight.copter.mode == CopterMode::Guided, "{:?}", flight.said);
    flight.until(60.0, |flight| flight.bridge.has_begun());
    assert_eq!((flight.copter.mode, count(&flight, "the mission goes on without it")), (CopterMode::Guided, 1));
    // That may still be in the air, and is waited for as long as any is heard.
    flight.bridge.return_home("the mission is over", flight.now_s);
    flight.until(120.0, |flight| !flight.bridge.is_heard());
    assert!(!flight.copter.is_armed && !flight.bridge.has_landed() && !flight.bridge.is_homebound());
    let now_s = flight.now_s;
    flight.bridge.refuse(1, "two of them".to_owned(), now_s).unwrap();
    assert_eq!(flight.bridge.control(1).phase(), Phase::TakenOver, "it may be in the air");
}

#[test]
fn a_vehicle_in_the_air_is_adopted_after_the_checks_of_a_take_off() {
    let adopted = |beginning: Beginning, battery: f64, dead_man: f32, away_m: f64| {
        let mut before = hovering(AutopilotKind::ArduPilot);
        before.fly_slot(1, Some(plan(50.0, 62.0)));
        let mut flight = restarted(&before, beginning);
        flight.jump_m = away_m;
        flight.copter.battery = battery;
        flight.dead_man = Some(dead_man);
        flight.advance(8.0);
        let is_refused = flight.refusal.is_some();
        let is_adopted = count(&flight, "is in the air: flying on") == 1;
        let returns = flight.orders.iter().all(|(_, order)| *order == Order::Return);
        assert!(is_adopted || returns, "{:?}", flight.orders);
        let ends = ["is left to its dead-man switch", "returns: "].map(|words| count(&flight, words) == 1);
        (is_adopted, is_refused, ends)
    };
    for (battery, dead_man, away_m) in [(0.04, 1.0, 0.0), (0.5, 0.0, 0.0), (0.5, 1.0, 30_000.0)] {
        let refused = adopted(Beginning::Resumed, battery, dead_man, away_m);
        assert_eq!(refused, (false, true, [false; 2]), "{battery} {dead_man} {away_m}");
        // After a restart it is sent home, unless it is so far away that it may be another, which its dead-man switch has
        // to bring home.
        let is_far = away_m > 0.0;
        let ended = adopted(RESTARTED, battery, dead_man, away_m);
        assert_eq!(ended, (false, false, [is_far, !is_far]), "{battery} {dead_man} {away_m}");
    }
    for beginning in [Beginning::Resumed, RESTARTED] {
        assert_eq!(adopted(beginning, 0.5, 1.0, 0.0), (true, false, [false; 2]), "half empty, as after half a mission");
    }
}

#[test]
fn a_vehicle_that_somebody_else_arms_before_a_resumed_run_has_checked_it_is_left_alone() {
    for beginning in [Beginning::New, Beginning::Resumed, Beginning::Restarted { in_mission: false }] {
        let reports = ClosedLoop::new(&KinematicOptions::default(), 0.0).reports;
        let mut flight = ClosedLoop::after(&scenario(""), &KinematicOptions::default(), 0.0, reports, beginning);
        flight.dead_man = None; // the bridge waits for it
        flight.advance(5.0);
        flight.copter.take_off_by_hand(15.0);
        flight.copter.mode = CopterMode::Guided;
        flight.dead_man = Some(1.0);
        assert_left_alone(&mut flight, "armed before the checks were over");
    }
}

#[test]
fn a_takeover_outlives_the_bridge() {
    let mut before = hovering(AutopilotKind::ArduPilot);
    before.fly_slot(1, Some(plan(50.0, 62.0)));
    before.copter.change_to(CopterMode::Loiter);
    before.advance(2.5);
    assert_eq!(before.fly_slot(2, Some(plan(50.0, 66.0))).flown_mode(), Mode::Return);
    let mut flight = restarted(&before, RESTARTED);
    flight.copter.mode = CopterMode::Guided; // handed to another ground station
    assert_left_alone(&mut flight, "restarted");
    assert_eq!(flight.bridge.control(0).heartbeats(flight.now_s), Heartbeats::Due);
}

#[test]
fn a_run_that_ends_while_a_restarted_bridge_checks_sends_the_vehicle_home() {
    let mut before = hovering(AutopilotKind::ArduPilot);
    before.fly_slot(1, Some(plan(50.0, 62.0)));
    for heard_s in [0.0, 3.0] {
        let mut flight = restarted(&before, RESTARTED);
        flight.dead_man = None; // the bridge waits for it
        flight.advance(heard_s);
        let now_s = flight.now_s;
        flight.bridge.return_home("the run is stopped", now_s);
        flight.until(120.0, |flight| flight.bridge.has_landed());
        assert!(!flight.copter.is_armed, "{:?}", flight.said);
    }
}

#[test]
fn a_planned_return_ends_no_mission() {
    for beginning in [RESTARTED, Beginning::Resumed] {
        let mut before = hovering(AutopilotKind::ArduPilot);
        let returns = Plan { mode: Mode::Return as u32, ..plan(50.0, 62.0) };
        assert_eq!(before.fly_slot(1, Some(returns)).flown_mode(), Mode::Transit);
        let mut flight = restarted(&before, beginning);
        flight.advance(20.0);
        assert_eq!(flight.fly_slot(2, Some(plan(50.0, 66.0))).flown_mode(), Mode::Serve, "{:?}", flight.said);
    }
}

#[test]
fn a_return_goes_on_under_the_next_bridge_unless_others_fly_the_vehicle() {
    let going_home = |is_accepted: bool| {
        let mut before = hovering(AutopilotKind::ArduPilot);
        before.refused = (!is_accepted).then_some(20);
        let now_s = before.now_s;
        before.bridge.return_home("its battery is low", now_s);
        assert_eq!(before.fly_slot(1, None).flown_mode(), Mode::Return);
        before
    };
    for is_accepted in [false, true] {
        let before = going_home(is_accepted);
        assert_eq!(before.copter.mode == CopterMode::Return, is_accepted);
        let mut flight = restarted(&before, RESTARTED);
        assert!(flight.bridge.has_begun(), "the slots go on");
        assert_eq!(flight.fly_slot(2, Some(plan(50.0, 66.0))).flown_mode(), Mode::Return);
        flight.until(150.0, |flight| flight.bridge.has_landed());
        let returns = flight.orders.iter().filter(|(_, order)| *order == Order::Return).count();
        assert_eq!((returns, flight.orders.len()), if is_accepted { (0, 0) } else { (1, 1) }, "{:?}", flight.orders);
        assert!(!flight.copter.is_armed && flight.bridge.taken_over().is_empty(), "{:?}", flight.said);
    }
    for mode in [CopterMode::Loiter, CopterMode::Guided] {
        let mut flight = restarted(&going_home(true), RESTARTED);
        flight.copter.mode = mode;
        assert_left_alone(&mut flight, "somebody has stopped the return");
    }
    // Before slot 1 of a run that is resumed, too: it has landed, and its mission is over, whatever its battery has.
    let mut before = going_home(true);
    before.until(150.0, |before| !before.copter.is_armed && before.bridge.control(0).phase() == Phase::Returning);
    let mut flight = restarted(&before, Beginning::Restarted { in_mission: false });
    flight.copter.battery = 0.05;
    flight.advance(20.0);
    assert!(flight.bridge.has_landed() && flight.bridge.check_flyable().is_ok() && flight.orders.is_empty());
}

#[test]
fn a_vehicle_that_a_resumed_run_leaves_alone_is_left_alone_by_its_next_bridge() {
    let mut before = hovering(AutopilotKind::ArduPilot);
    before.copter.change_to(CopterMode::Loiter);
    before.advance(2.5);
    before.fly_slot(1, None);
    before.copter.mode = CopterMode::Guided; // handed to another ground station
    let resumed = restarted(&before, Beginning::Resumed);
    assert!(resumed.bridge.taken_over().is_empty(), "by the run before");
    for beginning in [RESTARTED, Beginning::Restarted { in_mission: false }] {
        let mut flight = restarted(&resumed, beginning);
        assert_left_alone(&mut flight, "restarted");
        assert_eq!(flight.bridge.control(0).heartbeats(flight.now_s), Heartbeats::Withheld);
    }
}

#[test]
fn a_vehicle_in_the_air_that_does_not_pass_the_checks_returns() {
    let mut before = hovering(AutopilotKind::ArduPilot);
    before.fly_slot(1, Some(plan(50.0, 62.0)));
    let mut flight = restarted(&before, RESTARTED);
    flight.dead_man = None;
    flight.advance(140.0);
    assert_eq!((flight.copter.mode, flight.orders.len()), (CopterMode::Guided, 0));
    flight.until(150.0, |flight| flight.bridge.has_landed());
    assert_eq!(count(&flight, "returns: the bridge has waited 150 s for it to say what it does when"), 1);

    let mut flight = restarted(&before, RESTARTED);
    flight.says_no_position = true;
    flight.advance(160.0);
    assert_eq!(flight.bridge.control(0).heartbeats(flight.now_s), Heartbeats::Withheld, "{:?}", flight.said);
    assert_eq!(
        count(&flight, "is left to its dead-man switch: the bridge has waited 150 s for it to know its position"),
        1
    );
}

#[test]
fn a_vehicle_that_has_landed_under_the_bridge_before_is_not_flown_by_the_next() {
    let mut before = hovering(AutopilotKind::ArduPilot);
    before.copter.change_to(CopterMode::Loiter);
    before.advance(2.5);
    before.copter.change_to(CopterMode::Land);
    before.until(120.0, |before| before.bridge.has_landed());
    before.copter.take_off_by_hand(15.0); // by another ground station
    before.copter.mode = CopterMode::Guided;
    for beginning in [RESTARTED, Beginning::Restarted { in_mission: false }] {
        let mut flight = restarted(&restarted(&before, beginning), beginning);
        flight.advance(20.0);
        assert!(flight.orders.is_empty() && flight.bridge.has_landed(), "{:?}", flight.said);
        let heartbeats = |flight: &ClosedLoop| flight.bridge.control(0).heartbeats(flight.now_s);
        assert_eq!(heartbeats(&flight), Heartbeats::Withheld, "nobody is known to fly it");
        assert_eq!(flight.bridge.has_begun(), beginning == RESTARTED, "slots need somebody who flies");
        flight.copter.change_to(CopterMode::Loiter);
        flight.advance(2.5);
        assert_eq!(heartbeats(&flight), Heartbeats::Due);
    }
}

#[test]
fn what_is_known_of_a_vehicle_outlives_several_bridges() {
    let mut before = flight_over(AutopilotKind::ArduPilot);
    before.until(60.0, |before| before.copter.is_armed);
    before.copter.disarm(); // while there is no bridge
    let beginning = Beginning::Restarted { in_mission: false };
    let mut flight = restarted(&restarted(&before, beginning), beginning);
    flight.advance(60.0);
    assert!(flight.orders.is_empty() && !flight.copter.is_armed, "{:?}", flight.said);

    let mut before = hovering(AutopilotKind::ArduPilot);
    let now_s = before.now_s;
    before.bridge.return_home("its battery is low", now_s);
    before.until(10.0, |before| before.copter.mode == CopterMode::Return);
    before.fly_slot(1, None);
    before.copter.mode = CopterMode::Guided; // somebody has stopped the return
    let mut flight = restarted(&restarted(&before, RESTARTED), RESTARTED);
    flight.frozen = Some(Vec::new()); // it is heard late
    flight.advance(40.0);
    flight.frozen = None;
    flight.advance(20.0);
    assert!(flight.orders.is_empty(), "{:?}", flight.orders);
}

#[test]
fn a_resumed_run_takes_no_vehicle_whose_return_somebody_has_stopped() {
    let mut before = hovering(AutopilotKind::ArduPilot);
    before.fly_slot(1, Some(plan(50.0, 62.0)));
    let mut flight = restarted(&before, Beginning::Resumed);
    flight.copter.change_to(CopterMode::Return);
    flight.advance(3.0);
    flight.copter.mode = CopterMode::Guided;
    flight.advance(20.0);
    assert!(flight.orders.is_empty(), "{:?}", flight.orders);
}

#[test]
fn a_vehicle_of_an_unknown_autopilot_is_left_to_its_dead_man_switch_by_a_restarted_bridge() {
    let mut before = hovering(AutopilotKind::Other);
    before.fly_slot(1, Some(plan(50.0, 62.0)));
    let mut flight = restarted(&before, RESTARTED);
    flight.advance(20.0);
    assert_eq!(flight.bridge.control(0).heartbeats(flight.now_s), Heartbeats::Withheld, "{:?}", flight.said);
    assert!(flight.orders.is_empty());
}
