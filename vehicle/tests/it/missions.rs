//! Missions, with lost messages, refusals and failures.

use nalgebra::Point3;
use proptest::prelude::*;
use skysink_common::message::{HoldReason, Mode, Plan};
use skysink_flight_sim::outside::REACHED_M;
use skysink_kinematic_vehicle::KinematicOptions;
use skysink_kinematic_vehicle::autopilot::CopterMode;
use skysink_vehicle::autopilot::AutopilotKind;
use skysink_vehicle::bridge::SlotEnds;
use skysink_vehicle::telemetry::{Fix, Order, Telemetry};

use crate::flight::{ClosedLoop, count, flight_over, options_of, plan, scenario};

#[test]
fn a_slot_reports_where_the_vehicle_is_and_what_it_serves_from_there() {
    let mut flight = ClosedLoop::new(&KinematicOptions::default(), 0.0);
    flight.until(60.0, |flight| flight.bridge.has_begun());
    let report = flight.fly_slot(1, Some(plan(50.0, 62.0)));
    assert_eq!((report.mode, report.served), (Mode::Serve as u32, 1));
    assert!((report.position() - Point3::new(50.0, 62.0, 20.0)).norm() < REACHED_M, "{report:?}");
    assert!((report.time_s - 6.0).abs() < 0.2, "{report:?}");

    let report = flight.fly_slot(2, None);
    assert_eq!((report.mode, report.hold), (Mode::Hold as u32, HoldReason::NoPlan as u32));
    assert!((report.y_m - 62.0).abs() < REACHED_M && report.served == 0, "it holds: {report:?}");

    for (x_m, y_m) in [(f64::NAN, 60.0), (50.0, 101.0), (50.0, 20.0)] {
        let report = flight.fly_slot(3, Some(plan(x_m, y_m)));
        assert_eq!((report.hold, report.refused), (HoldReason::Waypoint as u32, 1), "({x_m}, {y_m})");
        assert!((report.y_m - 62.0).abs() < REACHED_M, "outside, or out of reach: {report:?}");
    }
}

#[test]
fn a_vehicle_hears_the_sensor_nodes_within_the_range_of_their_beacons() {
    for (radius_m, heard) in
        [("", vec![]), ("link.model = 'probabilistic-los'\nlink.beacon_radius_m = 11.0\n", vec![0])]
    {
        let flight = ClosedLoop::over(&scenario(radius_m), &KinematicOptions::default(), 0.0);
        let links = flight.bridge.heard_links(0, &flight.reports);
        assert_eq!(links.iter().map(|link| link.sensor).collect::<Vec<_>>(), heard);
    }
}

#[test]
fn a_slot_that_began_before_the_bridge_noticed_is_that_much_longer() {
    let mut flight = ClosedLoop::new(&KinematicOptions::default(), 0.0);
    flight.until(60.0, |flight| flight.bridge.has_begun());
    flight.bridge.begin(1, 0.75);
    flight.advance(5.0);
    flight.bridge.end(1, &mut flight.reports, flight.now_s);
    assert!((flight.reports[0].time_s - 5.75).abs() < 0.2, "{:?}", flight.reports[0]);
}

#[test]
fn a_vehicle_that_was_never_heard_ends_its_slots_on_time() {
    let mut flight = ClosedLoop::new(&KinematicOptions::default(), 1.0);
    let report = flight.fly_slot(3, Some(plan(50.0, 62.0)));
    assert_eq!((report.time_s, report.mode), (18.0, Mode::Hold as u32));
}

#[test]
fn a_vehicle_on_the_ground_does_not_take_off_to_return() {
    let mut flight = ClosedLoop::new(&KinematicOptions::default(), 0.0);
    flight.advance(1.0);
    flight.bridge.return_home("the test is over");
    flight.step();
    assert!(flight.bridge.has_landed());
    flight.advance(10.0);
    assert!(!flight.copter.is_armed && flight.orders.is_empty(), "{:?}", flight.said);
}

#[test]
fn charging_is_refused_also_in_the_base() {
    let scenario = scenario("uav.battery.capacity_j = 4e5\nbase.radius_m = 5.0\n");
    let mut flight = ClosedLoop::over(&scenario, &KinematicOptions::default(), 0.0);
    flight.until(60.0, |flight| flight.bridge.has_begun());
    let report = flight.fly_slot(1, Some(Plan { mode: Mode::Charge as u32, ..plan(50.0, 50.0) }));
    let refused = (Mode::Hold as u32, HoldReason::Base as u32, 1);
    assert_eq!((report.mode, report.hold, report.refused), refused);
    assert_eq!(flight.bridge.ends.flown, 0);
}

#[test]
fn a_waypoint_is_not_reached_too_low() {
    let keys = "link.model = 'probabilistic-los'\nlink.environment = 'suburban'\nuav.altitude = 'free'\n\
                uav.min_altitude_m = 20.0\nuav.max_altitude_m = 90.0\nuav.max_climb_mps = 5.0\n";
    let scenario = scenario(keys);
    let mut flight = ClosedLoop::over(&scenario, &KinematicOptions::default(), 0.0);
    flight.until(60.0, |flight| flight.bridge.has_begun());
    let report = flight.fly_slot(1, Some(Plan { z_m: 45.0, ..plan(50.0, 50.0) })); // it climbs 15 m in a slot
    assert_eq!((report.mode, report.hold), (Mode::EnRoute as u32, HoldReason::None as u32), "{report:?}");
    let reached = flight.bridge.ends;
    assert!((reached.flown, reached.reached) == (1, 0) && reached.farthest_m > 8.0, "{reached:?}");
}

#[test]
fn the_share_of_waypoints_that_were_reached_is_said() {
    let ends = SlotEnds { flown: 4, reached: 3, farthest_m: 9.0, doubtful: 0 };
    assert_eq!(ends.said(), ["75.0 % of 4 slots ended within 2 m of the waypoint, the farthest 9.0 m from it"]);
    let none = SlotEnds { doubtful: 2, ..SlotEnds::default() };
    let doubtful =
        "in 2 slots with a waypoint the position was not known or not believed: they are not counted as flown";
    assert_eq!(none.said(), [doubtful]);
    assert_eq!(SlotEnds::default().said(), ["no slot was flown to a waypoint"]);
}

#[test]
fn a_missed_waypoint_is_pursued_in_the_next_slot() {
    let mut flight = ClosedLoop::new(&KinematicOptions { acceleration: 0.3, ..KinematicOptions::default() }, 0.0);
    flight.until(60.0, |flight| flight.bridge.has_begun());
    let report = flight.fly_slot(1, Some(plan(50.0, 66.0)));
    assert_eq!(report.mode, Mode::EnRoute as u32, "{report:?}");
    assert!(report.y_m > 51.0 && report.y_m < 64.0 && report.velocity_mps[1] > 0.5, "{report:?}");
    assert_eq!(report.served, u32::from((report.y_m - 60.0).abs() < 10.0), "in range of where it is: {report:?}");
}

#[test]
fn a_vehicle_whose_gcs_failsafe_is_unknown_does_not_take_off() {
    let mut flight = ClosedLoop::new(&KinematicOptions::default(), 0.0);
    flight.gcs_failsafe = None;
    flight.advance(58.0);
    assert!((52..=58).contains(&flight.questions), "one a second: {}", flight.questions);
    assert!(!flight.copter.is_armed, "{:?}", flight.said);
    assert!(flight.said.iter().any(|line| line.contains("to say what it does when the bridge is silent")));
}

#[test]
fn a_vehicle_whose_gcs_failsafe_does_not_act_in_flight_is_refused() {
    let refusal = |autopilot, condition: f32| {
        let mut flight = ClosedLoop::new(&options_of(autopilot), 0.0);
        flight.condition = Some(condition);
        flight.advance(2.5);
        flight.refusal.map(|refusal| refusal.why.to_string())
    };
    let except_hold = |value| {
        let why = "it stays in the air in Hold, in which it is flown: expected a value without bit 1";
        Some(format!("COM_DLL_EXCEPT = {value}: {why}"))
    };
    let values = [0.0, 1.0, 2.0, 4.0, 7.0].map(|value| refusal(AutopilotKind::Px4, value));
    assert_eq!(values, [None, None, except_hold(2), None, except_hold(7)]);
    // It is asked until it has told its switch, and for some seconds more.
    let mut late = ClosedLoop::new(&options_of(AutopilotKind::Px4), 0.0);
    let failsafe = late.gcs_failsafe.take();
    late.advance(10.0);
    late.gcs_failsafe = failsafe;
    late.advance(3.0);
    assert!(!late.copter.is_armed, "{:?}", late.said);
    late.condition = Some(2.0);
    late.advance(2.0);
    assert_eq!(late.refusal.map(|refusal| refusal.why.to_string()), except_hold(2));
    let why = "SYSID_MYGCS or MAV_GCS_SYSID = 250: expected 255, the system of the bridge, or ?own_system=250 behind the \
               address";
    let stations = [255.0, 250.0].map(|value| refusal(AutopilotKind::ArduPilot, value));
    assert_eq!(stations, [None, Some(why.to_owned())]);
}

#[test]
fn a_vehicle_too_far_from_its_start_does_not_take_off() {
    let scenario = scenario("");
    let refusal = |away_m: f64| {
        let mut flight = ClosedLoop::over(&scenario, &KinematicOptions::default(), 0.0);
        flight.start_m.x += away_m - 3.0; // home is 3 m beside
        flight.advance(2.5);
        flight.refusal.map(|refusal| refusal.why.to_string())
    };
    let far = |away_m: u32| Some(format!("it is {away_m} m from its start: expected at most 500 m"));
    assert_eq!([4.0, 499.4, 501.0, 900.0].map(refusal), [None, None, far(501), far(900)]);
}

#[test]
fn a_report_has_the_accuracy_and_the_energy_that_the_vehicle_tells() {
    let scenario = scenario("uav.battery.capacity_j = 4e5\nbase.radius_m = 5.0\n");
    let mut flight = ClosedLoop::over(&scenario, &KinematicOptions::default(), 0.0);
    flight.until(60.0, |flight| flight.bridge.has_begun());
    flight.hear(&Telemetry::Accuracy([0.5, 3.0]));
    let report = flight.fly_slot(1, None);
    assert_eq!(report.covariance_m2, [0.25, 0.0, 0.0, 0.25, 0.0, 9.0]);
    let told_j = 4e5 * flight.copter.battery;
    assert!((report.energy_j - told_j).abs() < 4e5 / 1200.0 && told_j < 4e5, "{report:?}"); // told every second
}

#[test]
fn a_position_far_from_the_field_is_ignored() {
    let mut flight = ClosedLoop::new(&KinematicOptions::default(), 0.0);
    flight.until(60.0, |flight| flight.bridge.has_begun());
    let before = flight.fly_slot(1, Some(plan(50.0, 62.0)));
    let Telemetry::Position(fix) = flight.fix() else { panic!("not a position") };
    let report = |flight: &mut ClosedLoop| {
        flight.bridge.end(2, &mut flight.reports, flight.now_s);
        flight.reports[0].position()
    };
    (0..3).for_each(|_| flight.hear(&Telemetry::Position(Fix { lat_deg: 0.0, lon_deg: 0.001, ..fix })));
    assert!((report(&mut flight) - before.position()).norm() < 0.5);
    flight.step();
    let lines = flight.said.iter().filter(|line| line.contains("is not believed to be at 0, 0.001"));
    assert_eq!(lines.count(), 1, "{:?}", flight.said);
}

#[test]
fn without_plans_the_vehicle_returns_and_lands() {
    let mut flight = ClosedLoop::new(&KinematicOptions::default(), 0.0);
    flight.until(60.0, |flight| flight.bridge.has_begun());
    let modes: Vec<u32> = (1..=20).map(|slot| flight.fly_slot(slot, None).mode).collect();
    let [hold, back, down] = [Mode::Hold, Mode::Return, Mode::Down].map(|mode| mode as u32);
    assert_eq!(modes[..5], [hold; 5]);
    assert!(modes[5] == back && modes[19] == down, "after 30 s: {modes:?}");
    assert!(flight.bridge.has_landed() && !flight.copter.is_armed);
}

#[test]
fn without_a_link_slots_report_the_last_position_as_holds() {
    let mut flight = ClosedLoop::new(&KinematicOptions::default(), 0.0);
    flight.until(60.0, |flight| flight.bridge.has_begun());
    let before = flight.fly_slot(1, Some(plan(50.0, 62.0)));
    flight.loss = 1.0;
    let report = flight.fly_slot(2, Some(plan(50.0, 68.0)));
    assert_eq!((report.mode, report.hold, report.served), (Mode::Hold as u32, HoldReason::Unknown as u32, 0));
    assert_eq!(report.refused, 0, "nothing was wrong with the plan");
    assert!((report.position() - before.position()).norm() < 0.5, "{report:?}");
    flight.advance(10.0);
    assert_eq!(flight.copter.mode, CopterMode::Return, "by its GCS failsafe");
    flight.loss = 0.0;
    let report = flight.fly_slot(3, Some(plan(50.0, 62.0)));
    assert_eq!(report.mode, Mode::Return as u32);
    assert!(flight.said.iter().any(|line| line.contains("is overridden")), "{:?}", flight.said);
}

#[test]
fn a_vehicle_is_homebound_once_it_says_so_and_has_landed_once_it_is_disarmed() {
    let mut flight = ClosedLoop::new(&KinematicOptions::default(), 0.0);
    assert!(!flight.bridge.is_homebound() && !flight.bridge.has_landed());
    flight.until(60.0, |flight| flight.bridge.has_begun());
    assert!(!flight.bridge.is_homebound() && !flight.bridge.has_landed());
    flight.lost = Order::Return.command(); // the order does not arrive
    flight.bridge.return_home("the test is over");
    flight.advance(3.0);
    assert!(!flight.bridge.is_homebound(), "nobody has confirmed it");
    flight.lost = None;
    flight.until(10.0, |flight| flight.bridge.is_homebound());
    assert!(flight.copter.mode == CopterMode::Return && !flight.bridge.has_landed());
    flight.until(120.0, |flight| flight.bridge.has_landed());
    assert!(!flight.copter.is_armed && flight.bridge.is_homebound());
}

#[test]
fn a_vehicle_that_refuses_another_speed_is_said_to_keep_its_own() {
    let mut flight = ClosedLoop::new(&KinematicOptions::default(), 0.0);
    flight.refused = Order::Speed(10.0).command();
    flight.until(60.0, |flight| flight.said.iter().any(|line| line.contains("has taken off")));
    flight.advance(0.1);
    assert!(flight.said.iter().any(|line| line == "keeps its own speed, not 10 m/s"), "{:?}", flight.said);
}

#[test]
fn lost_and_late_answers_refuse_no_waypoint_but_their_own() {
    for seed in 0..20 {
        let mut flight = ClosedLoop::new(&KinematicOptions { seed, ..KinematicOptions::default() }, 0.0);
        flight.until(60.0, |flight| flight.bridge.has_begun());
        flight.answer_loss = 0.5;
        flight.answer_delay_s = 2.5;
        let mut plan_of = |slot: u64, is_refused: bool| {
            let repositions = flight.orders.iter().find(|(_, order)| matches!(order, Order::Reposition { .. }));
            let command = repositions.and_then(|(_, order)| order.command());
            flight.refused = command.filter(|_| is_refused);
            let report = flight.fly_slot_of(3.0, slot, Some(plan(50.0, 60.0 + (slot % 4) as f64)));
            (report, flight.said.clone())
        };
        for slot in 1..=12 {
            let is_refused = slot % 2 == 1;
            let (report, said) = plan_of(slot, is_refused);
            assert!(is_refused || report.refused == 0, "seed {seed}, slot {slot}: {report:?}, {said:?}");
        }
        let (report, said) = plan_of(13, false);
        assert!((report.y_m - 61.0).abs() < REACHED_M, "seed {seed}: {report:?}, {said:?}");
        assert!(!said.iter().any(|line| line.contains("is overridden")), "seed {seed}: {said:?}");
    }
}

#[test]
fn a_mission_begins_once_the_vehicle_hovers_at_its_start() {
    // It takes off 3 m beside, and is there and slow at different times.
    for lag in [0.0, 0.3] {
        let mut flight = ClosedLoop::new(&KinematicOptions { lag, ..KinematicOptions::default() }, 0.0);
        flight.until(60.0, |flight| flight.bridge.has_begun());
        let away_m = flight.home_m() + flight.copter.body.position_m.xy() - flight.start_m;
        assert!(away_m.norm() < REACHED_M + 0.2, "{away_m:?}");
        assert!(flight.copter.body.velocity_mps.norm() < 1.2, "{:?}", flight.copter);
    }
}

#[test]
fn the_vehicle_returns_itself_when_the_bridge_is_dead() {
    let mut flight = ClosedLoop::new(&KinematicOptions::default(), 0.0);
    flight.until(60.0, |flight| flight.bridge.has_begun());
    flight.fly_slot(1, Some(plan(50.0, 62.0)));
    flight.is_bridge_alive = false;
    flight.advance(7.0);
    assert_eq!(flight.copter.mode, CopterMode::Return);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn a_mission_with_message_losses_ends_on_the_ground(
        seed in 0u64..1_000, loss in 0.0..0.3, lag in 0.0..0.3, kill in any::<bool>(),
        autopilot in prop::sample::select(vec![AutopilotKind::ArduPilot, AutopilotKind::Px4, AutopilotKind::Other]),
    ) {
        let options = KinematicOptions { seed, lag, ..options_of(autopilot) };
        let mut flight = ClosedLoop::new(&options, loss);
        flight.autopilot = autopilot;
        flight.until(400.0, |flight| flight.bridge.has_begun() || flight.bridge.check_flyable().is_err());
        prop_assume!(flight.bridge.has_begun()); // its only command to arm, or its answer, may be lost
        for slot in 1..=4 {
            let _ = flight.fly_slot(slot, Some(plan(50.0 + 3.0 * slot as f64, 60.0)));
        }
        flight.is_bridge_alive = !kill;
        flight.bridge.return_home("the test is over");
        flight.until(180.0, |flight| !flight.copter.is_armed);
        prop_assert!(flight.copter.body.position_m.norm() < 1.0, "at home: {:?}", flight.copter);
        if !kill {
            flight.until(60.0, |flight| flight.bridge.has_landed());
        }
    }

    #[test]
    fn a_vehicle_overridden_by_a_pilot_gets_no_more_orders(seed in 0u64..100, loss in 0.0..0.3) {
        let mut flight = ClosedLoop::new(&KinematicOptions { seed, ..KinematicOptions::default() }, loss);
        flight.until(400.0, |flight| flight.bridge.has_begun() || flight.bridge.check_flyable().is_err());
        prop_assume!(flight.bridge.has_begun());
        let _ = flight.copter.change_to(CopterMode::Stabilize);
        flight.until(40.0, |flight| flight.said.iter().any(|line| line.contains("is overridden")));
        let _ = flight.fly_slot(1, Some(plan(50.0, 62.0)));
        prop_assert_eq!(flight.copter.mode, CopterMode::Stabilize, "{:?}", flight.copter);
    }
}

#[test]
fn a_command_to_arm_that_is_refused_ends_the_start_with_a_line() {
    let options = KinematicOptions { refuse_arming: 1, ..KinematicOptions::default() };
    let mut flight = ClosedLoop::new(&options, 0.0);
    flight.until(30.0, |flight| flight.bridge.has_landed());
    assert_eq!(count(&flight, "is not flown: it refuses to be armed: MAVLink result 4"), 1, "{:?}", flight.said);
    let why = flight.bridge.check_flyable().unwrap_err().why.to_string();
    assert!(why.starts_with("its mission was over before it began: it refuses to be armed"), "{why}");
}

#[test]
fn the_own_checks_of_a_vehicle_are_waited_for() {
    let mut flight = ClosedLoop::new(&KinematicOptions { ready_after: 20.0, ..KinematicOptions::default() }, 0.0);
    flight.advance(19.0);
    assert!(flight.orders.is_empty(), "{:?}", flight.orders);
    assert!(count(&flight, "waiting for it to pass its own checks before arming") > 0, "{:?}", flight.said);
    flight.until(60.0, |flight| flight.bridge.has_begun());
}

#[test]
fn an_unknown_autopilot_needs_names_for_its_modes() {
    let mut named = flight_over(AutopilotKind::Other);
    named.until(90.0, |flight| flight.bridge.has_begun());
    let mut flight = flight_over(AutopilotKind::Other);
    let reports = flight.reports.clone();
    let frame = skysink_vehicle::frame::AreaFrame::at(crate::flight::HOME);
    let own = [skysink_vehicle::bridge::OwnSide { system: 255, ..Default::default() }];
    let first = skysink_vehicle::bridge::Beginning::First;
    flight.bridge = skysink_vehicle::bridge::Bridge::new(&scenario(""), &[], frame, &reports, first, &[], &own);
    flight.advance(3.0);
    let why = flight.refusal.unwrap().why.to_string();
    assert!(
        why.starts_with(
            "its autopilot is not known, and is in mode 4: expected ArduPilot or PX4, or ?modes=follow:N,return:N"
        ),
        "{why}"
    );
}
