//! What vehicles of another design, and a real PX4, have shown: H1 to H3, M1 to M9 and P1 to P10, each as it was found.

use skysink_common::message::Mode;
use skysink_kinematic_vehicle::KinematicOptions;
use skysink_kinematic_vehicle::autopilot::CopterMode;
use skysink_vehicle::autopilot::{Altitude, AutopilotKind};
use skysink_vehicle::control::Heartbeats;
use skysink_vehicle::table::State;
use skysink_vehicle::telemetry::{Order, Telemetry};

use crate::flight::{
    BEFORE_SLOT, ClosedLoop, HOME_M, KINDS, arms, assert_left_alone, count, flight_over, hovering, may_overrule,
    options_of, plan, take_offs,
};

/// A vehicle that is found in this mode, with all checks but that of the mode passed.
fn found_in(autopilot: AutopilotKind, mode: CopterMode) -> ClosedLoop {
    let mut flight = ClosedLoop::new(&KinematicOptions { mode, ..options_of(autopilot) }, 0.0);
    flight.advance(10.0);
    flight
}

/// H1: a pilot who goes back, in the climb, to the mode in which the vehicle was found.
#[test]
fn a_pilot_who_goes_back_to_the_found_mode_in_the_climb_keeps_the_vehicle() {
    for autopilot in KINDS {
        for instant in 0..20 {
            let mut flight = found_in(autopilot, CopterMode::Loiter);
            flight.copter.change_to(CopterMode::Guided);
            flight.until(30.0, |flight| flight.arrived.iter().any(|(_, order)| matches!(order, Order::TakeOff(_))));
            flight.advance(0.35 * f64::from(instant));
            flight.copter.change_to(CopterMode::Loiter);
            assert_left_alone(&mut flight, "back in the found mode");
            assert_eq!(flight.copter.mode, CopterMode::Loiter, "{autopilot:?}, {instant}: {:?}", flight.said);
        }
    }
}

/// H2: a pilot who flips back on the ground, 0.15 to 1.7 s after the mode that follows; at 1, 4 and 10 heartbeats a
/// second.
#[test]
fn a_pilot_who_flips_back_on_the_ground_is_not_taken_off() {
    for (autopilot, heartbeat_s) in [1.0, 0.24, 0.1].into_iter().flat_map(|period_s| KINDS.map(|kind| (kind, period_s)))
    {
        for instant in 0..20 {
            let mut flight = found_in(autopilot, CopterMode::Stabilize);
            (flight.is_deaf, flight.heartbeat_s, flight.delay_s) = (true, heartbeat_s, 0.1);
            if autopilot == AutopilotKind::Px4 && heartbeat_s < 1.0 {
                continue; // it has one in a second
            }
            flight.copter.change_to(CopterMode::Guided);
            flight.advance(0.15 + 0.08 * f64::from(instant));
            let was_in_air = flight.copter.is_in_air();
            flight.copter.change_to(CopterMode::Stabilize);
            flight.advance(60.0);
            let what = format!("{autopilot:?}, {heartbeat_s} s, {instant}: {:?} {:?}", flight.orders, flight.said);
            assert_eq!((flight.copter.is_in_air(), flight.copter.mode), (was_in_air, CopterMode::Stabilize), "{what}");
            assert!(arms(&flight) <= 1 && take_offs(&flight) <= 1, "{what}");
        }
    }
}

/// H3: the bridge is killed before take-off, and the pilot takes the vehicle back.
#[test]
fn a_bridge_that_is_restarted_before_take_off_waits_for_the_mode() {
    for autopilot in KINDS {
        let mut flight = flight_over(autopilot);
        flight.gcs_failsafe = None; // the bridge waits for it, in the mode that follows
        flight.advance(10.0);
        flight.copter.change_to(CopterMode::Loiter);
        flight.restart(BEFORE_SLOT);
        flight.gcs_failsafe = Some(if autopilot == AutopilotKind::Px4 { 2.0 } else { 1.0 });
        flight.advance(60.0);
        assert!(flight.orders.is_empty() && !flight.copter.is_armed, "{:?}", flight.orders);
        flight.copter.change_to(CopterMode::Guided);
        flight.until(60.0, |flight| flight.bridge.has_begun());
    }
}

/// M1: heartbeats and modes stop, positions go on.
#[test]
fn a_vehicle_that_says_where_it_is_and_not_its_mode_gets_no_waypoints() {
    for autopilot in KINDS {
        let mut flight = hovering(autopilot);
        flight.fly_slot(1, Some(plan(50.0, 62.0)));
        flight.says_no_mode = true;
        flight.advance(3.5);
        assert_eq!(count(&flight, "does not say its mode any more, for 3 s"), 1, "{:?}", flight.said);
        flight.copter.change_to(CopterMode::Loiter); // unseen
        flight.orders.clear();
        flight.fly_slot(2, Some(plan(50.0, 66.0)));
        assert!(flight.orders.is_empty(), "{:?}", flight.orders);
        assert_eq!(flight.bridge.control(0).heartbeats(flight.now_s), Heartbeats::Due);
        flight.advance(1.0);
        assert_eq!(flight.bridge.control(0).heartbeats(flight.now_s), Heartbeats::Withheld, "after 10 s");
        flight.says_no_mode = false;
        flight.advance(2.5);
        assert_eq!([count(&flight, "is heard again"), count(&flight, "is overridden")], [1, 1], "{:?}", flight.said);
    }
}

/// M2: it lands and stays armed.
#[test]
fn a_vehicle_that_lands_and_stays_armed_is_said_to() {
    let mut flight = hovering(AutopilotKind::ArduPilot);
    flight.stays_armed = true;
    flight.bridge.return_home("the mission is over");
    flight.until(120.0, |flight| !flight.copter.is_in_air());
    flight.advance(25.0);
    assert!(count(&flight, "stands on the ground, armed") > 0 && !flight.bridge.has_landed(), "{:?}", flight.said);
    flight.stays_armed = false;
    flight.until(10.0, |flight| flight.bridge.has_landed());
}

/// M3 and M4: it hovers beside its start, or does not follow; each is said every ten seconds, with the distance.
#[test]
fn a_vehicle_that_does_not_follow_is_said_not_to() {
    for autopilot in KINDS {
        let mut flight = flight_over(autopilot);
        flight.ignores_waypoints = true;
        flight.until(60.0, |flight| {
            count(flight, "is on its way to its start, 3.0 m away: expected to hover within 2 m") > 0
        });
        flight.until(700.0, |flight| flight.bridge.has_landed());
        assert_eq!(count(&flight, "returns: it does not reach its start within ten minutes"), 1, "{:?}", flight.said);

        let mut flight = hovering(autopilot);
        flight.ignores_waypoints = true;
        flight.fly_slot(1, Some(plan(50.0, 56.0)));
        flight.fly_slot(2, Some(plan(50.0, 56.0)));
        assert_eq!(count(&flight, "does not follow: it stands 6.0 m from its waypoint"), 1, "{:?}", flight.said);
    }
}

/// M5: a take-off without an answer is not repeated once it climbs.
#[test]
fn a_take_off_is_not_repeated_once_it_climbs() {
    for autopilot in KINDS {
        let mut flight = flight_over(autopilot);
        flight.answer_loss = 1.0;
        flight.until(90.0, |flight| flight.bridge.has_begun());
        assert_eq!((arms(&flight), take_offs(&flight)), (1, 1), "{autopilot:?}: {:?}", flight.orders);
    }
}

/// M6: a command to arm that was lost explains nobody who arms later.
#[test]
fn who_arms_long_after_a_lost_command_is_somebody_else() {
    for autopilot in KINDS {
        let mut flight = flight_over(autopilot);
        flight.lost = Order::Arm.command();
        flight.until(60.0, |flight| arms(flight) > 0);
        flight.advance(14.0);
        assert_eq!(
            count(&flight, "is not flown: it was not armed, or not ready to take off, 13 s after the command"),
            1,
            "{:?}",
            flight.said
        );
        flight.copter.is_armed = true; // by its pilot, in the mode that follows
        flight.advance(60.0);
        assert_eq!((take_offs(&flight), flight.state()), (0, State::Done), "{:?}", flight.said);
    }
}

/// M9 and P9: a vehicle in another mode is not armed, and its mode is named.
#[test]
fn a_vehicle_in_another_mode_is_waited_for_by_name() {
    for (autopilot, mode, is, wanted) in [
        (AutopilotKind::Px4, CopterMode::Stabilize, "STABILIZED", "HOLD"),
        (AutopilotKind::Px4, CopterMode::Loiter, "POSCTL", "HOLD"),
        (AutopilotKind::Px4, CopterMode::Land, "LAND", "HOLD"),
        (AutopilotKind::ArduPilot, CopterMode::Stabilize, "STABILIZE", "GUIDED"),
        (AutopilotKind::ArduPilot, CopterMode::Return, "RTL", "GUIDED"),
    ] {
        let mut flight = found_in(autopilot, mode);
        flight.advance(60.0);
        assert!(flight.orders.is_empty() && !flight.copter.is_armed, "{:?}", flight.orders);
        let line = format!("waiting for it to be put into {wanted} by its operator: it is in {is}");
        assert!((2..=4).contains(&count(&flight, &line)), "less and less often: {:?}", flight.said);
        flight.copter.change_to(CopterMode::Guided);
        flight.until(30.0, |flight| flight.copter.is_armed);
    }
}

/// P1: a failsafe of PX4 holds for five seconds; waypoints would end it.
#[test]
fn a_failsafe_of_the_vehicle_wins() {
    let mut flight =
        ClosedLoop::new(&KinematicOptions { failsafe_at: Some(30.0), ..options_of(AutopilotKind::Px4) }, 0.0);
    flight.until(60.0, |flight| flight.bridge.has_begun());
    let mut slot = 0;
    while !flight.copter.is_critical() {
        slot += 1;
        flight.fly_slot_of(1.0, slot, Some(plan(50.0, 58.0 + (slot % 4) as f64)));
    }
    flight.advance(1.5); // a heartbeat
    flight.orders.clear();
    for later in 1..=4 {
        flight.fly_slot_of(1.0, slot + later, Some(plan(50.0, 66.0)));
    }
    assert!(flight.orders.is_empty(), "{:?}", flight.orders);
    flight.until(3.0, |flight| flight.copter.mode == CopterMode::Return);
    assert_eq!(
        count(&flight, "says that a failsafe of it acts: it gets no waypoints meanwhile"),
        1,
        "{:?}",
        flight.said
    );
    flight.until(120.0, |flight| flight.bridge.has_landed());
    let line = "is overridden: it returns or lands by itself (RETURN): a failsafe, or a pilot";
    assert_eq!((count(&flight, line), flight.orders.len()), (1, 0), "{:?}", flight.said);
}

/// The same where the failsafe ends, as of a link that is there again: the flight goes on.
#[test]
fn a_flight_goes_on_after_a_failsafe_that_has_ended() {
    for autopilot in KINDS {
        let mut flight = hovering(autopilot);
        let mode = flight.copter.mode_number();
        let says = |is_critical| Telemetry::Heartbeat { autopilot, mode, is_armed: true, is_critical };
        flight.says_no_mode = true;
        (0..2).for_each(|_| flight.hear(&says(true)));
        flight.orders.clear();
        let report = flight.fly_slot_of(2.5, 1, Some(plan(50.0, 62.0)));
        assert!(flight.orders.is_empty() && report.flown_mode() == Mode::EnRoute, "{:?}, {report:?}", flight.orders);
        (0..2).for_each(|_| flight.hear(&says(false)));
        flight.says_no_mode = false;
        assert_eq!(flight.fly_slot(2, Some(plan(50.0, 62.0))).flown_mode(), Mode::Serve, "{:?}", flight.said);
    }
}

/// P2: a pilot's act within 0.5 s of a waypoint, with 0.1 s of delay in each direction.
#[test]
fn a_pilot_around_a_waypoint_is_never_overruled() {
    for autopilot in KINDS {
        for instant in 0..=20 {
            let mut flight = hovering(autopilot);
            flight.fly_slot(1, Some(plan(50.0, 62.0)));
            flight.delay_s = 0.1;
            let before_s = 0.05 * f64::from(instant);
            flight.advance(0.5);
            flight.bridge.await_plan();
            flight.bridge.begin(2, 0.0);
            if before_s < 0.5 {
                flight.advance(0.5 - before_s);
                flight.bridge.fly(&[plan(50.0, 66.0)], flight.now_s);
                flight.advance(before_s);
                flight.copter.change_to(CopterMode::Loiter);
            } else {
                flight.copter.change_to(CopterMode::Loiter);
                flight.advance(before_s - 0.5);
                flight.bridge.fly(&[plan(50.0, 66.0)], flight.now_s);
            }
            assert_left_alone(&mut flight, "around a waypoint");
            assert_eq!(flight.copter.mode, CopterMode::Loiter, "{autopilot:?}, {before_s}");
        }
        let mut flight = hovering(autopilot);
        flight.crossing = Some(CopterMode::Loiter);
        flight.fly_slot(1, Some(plan(50.0, 66.0)));
        assert_eq!((flight.crossing, flight.copter.mode), (None, CopterMode::Loiter), "{autopilot:?}");
    }
}

/// P3: PX4 forgets its speed when it enters Hold: each waypoint has it.
#[test]
fn the_speed_of_px4_comes_with_each_waypoint() {
    let mut flight = ClosedLoop::new(&KinematicOptions { speed: 3.0, ..options_of(AutopilotKind::Px4) }, 0.0);
    flight.until(90.0, |flight| flight.bridge.has_begun());
    flight.fly_slot_of(2.5, 1, Some(plan(50.0, 68.0)));
    assert!(flight.copter.body.velocity_mps.norm() > 4.0, "not 3 m/s, that of Hold: {:?}", flight.copter);
    let speeds = flight.orders.iter().filter_map(|(_, order)| match order {
        Order::Reposition { speed_mps, .. } => Some(*speed_mps),
        _ => None,
    });
    assert_eq!(speeds.collect::<Vec<_>>(), [Some(10.0); 2]);
}

/// P4: at the disarm PX4 goes back to Hold, before the heartbeat that says that it is disarmed.
#[test]
fn a_landing_after_a_return_is_no_pilot_override() {
    for autopilot in KINDS {
        let mut flight = hovering(autopilot);
        flight.bridge.return_home("the mission is over");
        flight.until(120.0, |flight| flight.bridge.has_landed());
        assert_eq!([count(&flight, "is overridden"), count(&flight, "has landed")], [0, 1], "{:?}", flight.said);
    }
}

/// P5: a pilot disarms it while the answer to the command to arm is lost.
#[test]
fn a_vehicle_that_its_pilot_disarms_is_not_armed_again() {
    for autopilot in KINDS {
        for (heartbeat_s, after_s) in [(0.2, 0.3), (0.2, 1.0), (1.0, 1.2), (1.0, 2.0)] {
            let mut flight = flight_over(autopilot);
            (flight.answer_loss, flight.heartbeat_s) = (1.0, heartbeat_s);
            flight.until(60.0, |flight| flight.copter.is_armed);
            flight.advance(after_s);
            if flight.copter.is_in_air() {
                continue;
            }
            flight.copter.disarm();
            flight.advance(30.0);
            assert!(!flight.copter.is_armed && arms(&flight) == 1, "{autopilot:?}: {:?}", flight.orders);
            assert!(flight.bridge.has_landed(), "{:?}", flight.said);
        }
    }
}

/// P6: PX4 corrects the altitude of its home in flight.
#[test]
fn altitudes_are_those_above_the_home_of_the_arming() {
    let mut flight = flight_over(AutopilotKind::Px4);
    flight.until(60.0, |flight| flight.copter.is_armed);
    flight.drift_m = 1.8;
    flight.until(60.0, |flight| flight.bridge.has_begun());
    let report = flight.fly_slot(1, Some(plan(50.0, 62.0)));
    assert!((report.z_m - 20.0).abs() < 0.2, "{report:?}");
    let altitudes_m = flight.orders.iter().filter_map(|(_, order)| match order {
        Order::TakeOff(Altitude::AboveSea(z_m)) => Some(*z_m),
        Order::Reposition { to, .. } => match to.altitude {
            Altitude::AboveSea(z_m) => Some(z_m),
            Altitude::AboveHome(_) => None,
        },
        _ => None,
    });
    let altitudes_m: Vec<f64> = altitudes_m.collect();
    assert!(
        altitudes_m.len() == 3 && altitudes_m.iter().all(|z_m| (z_m - HOME_M - 20.0).abs() < 1e-9),
        "{altitudes_m:?}"
    );
    // So does the next bridge.
    flight.restart(crate::flight::RESTARTED);
    flight.advance(3.0);
    let report = flight.fly_slot(2, Some(plan(50.0, 66.0)));
    assert!((report.z_m - 20.0).abs() < 0.2 && report.flown_mode() == Mode::Serve, "{report:?}");
    // Somebody sets another home, far below.
    flight.drift_m = 38.0;
    flight.advance(10.0);
    let report = flight.fly_slot(3, Some(plan(50.0, 62.0)));
    assert!((report.z_m - 20.0).abs() < 0.2 && report.flown_mode() == Mode::Serve, "{report:?}");
}

/// P7: a waypoint waits for no report.
#[test]
fn a_waypoint_is_sent_with_its_plan() {
    for autopilot in KINDS {
        let mut flight = hovering(autopilot);
        flight.advance(0.5); // between two heartbeats
        flight.orders.clear();
        let now_s = flight.now_s;
        flight.fly_slot_of(0.04, 1, Some(plan(50.0, 62.0)));
        let first = flight
            .orders
            .first()
            .map(|(at_s, order)| (*at_s - now_s < 0.03, matches!(order, Order::Reposition { .. })));
        assert_eq!(first, Some((true, true)), "{autopilot:?}: {:?}", flight.orders);
    }
}

/// P10: what it says comes in parts, and ends with a tab.
#[test]
fn texts_in_parts_are_one_line() {
    let mut flight = hovering(AutopilotKind::Px4);
    for text in ["Failsafe activated: GCS connection loss, triggering", " Return\t"] {
        flight.hear(&Telemetry::Text { text: text.to_owned(), line: 3 });
    }
    flight.advance(0.1);
    assert_eq!(
        count(&flight, "says: Failsafe activated: GCS connection loss, triggering Return"),
        1,
        "{:?}",
        flight.said
    );
}

/// A vehicle that hears nothing is said after ten seconds, and given up after sixty.
#[test]
fn a_vehicle_that_hears_nothing_is_given_up() {
    for autopilot in KINDS {
        let mut flight = flight_over(autopilot);
        flight.gcs_failsafe = None;
        flight.advance(14.0);
        let line = "it is heard and answers nothing: a link in one direction, a wrong address, or an autopilot that wants signed";
        assert_eq!(count(&flight, line), 1, "{:?}", flight.said);
        flight.until(60.0, |flight| flight.refusal.is_some());
        assert!((60.0..64.0).contains(&flight.now_s), "{}", flight.now_s);
        let why = flight.refusal.unwrap().why.to_string();
        assert!(
            why.starts_with("waited 60 s for it to say what it does when the bridge is silent") && why.contains(line),
            "{why}"
        );
        assert!(flight.said.len() < 8, "less and less often: {:?}", flight.said);
    }
}

/// What could overrule a pilot is sent in the moment in which a report comes in that shows the mode that follows.
#[test]
fn orders_that_could_overrule_follow_a_report_at_once() {
    for autopilot in KINDS {
        let mut flight = hovering(autopilot);
        flight.advance(0.3); // after a heartbeat, and before CURRENT_MODE
        flight.orders.clear();
        flight.bridge.return_home("the mission is over");
        flight.advance(0.1);
        assert!(!flight.orders.iter().any(|(_, order)| may_overrule(order)), "{autopilot:?}: {:?}", flight.orders);
        flight.advance(0.8);
        assert!(flight.orders.iter().any(|(_, order)| *order == Order::Return), "{autopilot:?}: {:?}", flight.orders);
    }
}
