//! The vehicles of a fleet, of which some are silent, refused, at home, or others' by now.

use skysink_common::geodata::projection::Projection;
use skysink_common::geometry::Position;
use skysink_common::message::{HoldReason, Mode, Plan, SensorNode};
use skysink_kinematic_vehicle::autopilot::CopterMode;
use skysink_vehicle::autopilot::AutopilotKind;
use skysink_vehicle::bridge::{Bridge, start};
use skysink_vehicle::control::{Fate, Heartbeats, History, Phase};
use skysink_vehicle::frame::AreaFrame;
use skysink_vehicle::preflight::Beginning;
use skysink_vehicle::telemetry::{Fix, Order, Telemetry};

use crate::flight::{HOME, RESTARTED, scenario};
use crate::pilot::hovering;
use crate::restarts::restarted;

/// A bridge over the vehicles of a fleet of two, at (50, 50) and (60, 50).
fn fleet(beginning: Beginning, keys: &str) -> Bridge {
    let both = "uav.count = 2\nuav.coordination = 'partition'\nuav.starts_m = [[50.0, 50.0], [60.0, 50.0]]\n";
    let both = scenario(&format!("{both}{keys}"));
    Bridge::new(&both, &[SensorNode::default()], AreaFrame::at(HOME), &start(&both), beginning, &[255, 255])
}

/// Lets the vehicle number `uav` say where it is: at `at_m` [m], in this mode of ArduPilot.
fn speak(bridge: &mut Bridge, uav: usize, at_m: [f64; 3], mode: u32, is_armed: bool, now_s: f64) {
    said(at_m, mode, is_armed, now_s).iter().for_each(|telemetry| bridge.hear(uav, telemetry, now_s));
}

/// What it says: first its heartbeat.
fn said(at_m: [f64; 3], mode: u32, is_armed: bool, now_s: f64) -> [Telemetry; 5] {
    let place = Projection::at(HOME).unproject(&Position::new(at_m[0], at_m[1])).unwrap();
    let fix = Fix {
        lat_deg: place.lat_deg,
        lon_deg: place.lon_deg,
        above_home_m: at_m[2],
        above_sea_m: at_m[2] + 488.0,
        velocity_mps: [0.0; 3],
        heading_deg: f64::INFINITY,
        boot_s: now_s,
    };
    [
        Telemetry::Heartbeat { autopilot: AutopilotKind::ArduPilot, mode, is_armed, is_booting: false },
        Telemetry::Position(fix),
        Telemetry::Battery(Some(0.9)),
        Telemetry::InAir(at_m[2] > 1.0),
        Telemetry::Parameter { name: "FS_GCS_ENABLE".to_owned(), value: 1.0, is_integer: false },
    ]
}

/// GUIDED and LOITER.
const GUIDED: u32 = 4;
const LOITER: u32 = 5;

/// Polls the bridge ten times in a second from `now_s` [s] on, after what `speaks` lets its vehicles say. Returns the
/// orders.
fn run(bridge: &mut Bridge, seconds: f64, now_s: &mut f64, speaks: impl Fn(&mut Bridge, f64)) -> Vec<(usize, Order)> {
    let mut orders = Vec::new();
    for _ in 0..(seconds * 10.0) as u32 {
        *now_s += 0.1;
        speaks(bridge, *now_s);
        let _ = bridge.poll(*now_s, |uav, order| orders.push((uav, *order)), |_, _| {});
    }
    orders.retain(|(_, order)| order.command().is_some());
    orders
}

#[test]
fn a_vehicle_that_the_bridge_gives_up_in_the_air_gets_no_heartbeats() {
    let (mut bridge, mut now_s) = (fleet(RESTARTED, ""), 0.0);
    let both_fly = |bridge: &mut Bridge, now_s| {
        speak(bridge, 0, [50.0, 50.0, 20.0], GUIDED, true, now_s);
        speak(bridge, 1, [60.0, 50.0, 20.0], GUIDED, true, now_s);
    };
    run(&mut bridge, 7.0, &mut now_s, |bridge, now_s| speak(bridge, 0, [50.0, 50.0, 20.0], GUIDED, true, now_s));
    bridge.refuse(1, "two of them".to_owned(), now_s).unwrap();
    let orders = run(&mut bridge, 5.0, &mut now_s, both_fly);
    assert!(orders.iter().all(|(uav, _)| *uav == 0), "{orders:?}");
    let heartbeats = |bridge: &Bridge, now_s| [0, 1].map(|uav| bridge.control(uav).heartbeats(now_s));
    assert_eq!(heartbeats(&bridge, now_s), [Heartbeats::Due, Heartbeats::Withheld]);
    run(&mut bridge, 2.0, &mut now_s, |bridge, now_s| {
        both_fly(bridge, now_s);
        speak(bridge, 1, [60.0, 50.0, 20.0], LOITER, true, now_s + 0.01);
        speak(bridge, 1, [60.0, 50.0, 20.0], LOITER, true, now_s + 0.02);
    });
    assert_eq!(heartbeats(&bridge, now_s), [Heartbeats::Due; 2], "a pilot flies it");
    run(&mut bridge, 2.0, &mut now_s, both_fly);
    assert_eq!(heartbeats(&bridge, now_s), [Heartbeats::Due; 2], "also in the mode of the bridge");

    // So far away, it may be another vehicle; a slot away, it is not.
    for (away_m, of_it) in [(540.0, Heartbeats::Due), (600.0, Heartbeats::Withheld)] {
        let (mut bridge, mut now_s) = (fleet(RESTARTED, ""), 0.0);
        run(&mut bridge, 5.0, &mut now_s, |bridge, now_s| {
            speak(bridge, 1, [60.0, 50.0 + away_m, 20.0], GUIDED, true, now_s);
        });
        assert_eq!(bridge.control(1).heartbeats(now_s), of_it, "{away_m} m");
        let mut next = fleet(RESTARTED, "");
        next.go_on(bridge.histories(), 1, &start(&scenario("uav.count = 2\nuav.coordination = 'partition'\n")));
        run(&mut next, 5.0, &mut now_s, |bridge, now_s| speak(bridge, 1, [60.0, 50.0, 20.0], GUIDED, true, now_s));
        assert_eq!(next.control(1).heartbeats(now_s), of_it, "{away_m} m, under the next bridge");
    }
}

#[test]
fn no_return_follows_a_heartbeat_from_before_the_vehicle_was_chosen() {
    let mut bridge = fleet(Beginning::Resumed, "");
    let [heartbeat, others @ ..] = said([50.0, 50.0, 20.0], GUIDED, true, 1.0);
    (0..2).for_each(|_| bridge.hear_earlier(0, &heartbeat, 1.0));
    others.iter().for_each(|telemetry| bridge.hear(0, telemetry, 1.0));
    bridge.return_home("the run is stopped", 1.0);
    let is_sent_home = |bridge: &mut Bridge| {
        let mut orders = Vec::new();
        let _ = bridge.poll(1.0, |_, order| orders.push(*order), |_, _| {});
        orders.contains(&Order::Return)
    };
    assert!(!is_sent_home(&mut bridge), "its pilot may have chosen another mode since");
    bridge.hear(0, &heartbeat, 1.0);
    assert!(is_sent_home(&mut bridge));
}

#[test]
fn heartbeats_stop_where_a_resumed_run_does_not_hear_its_vehicle() {
    for beginning in [Beginning::Resumed, RESTARTED] {
        let (mut bridge, mut now_s) = (fleet(beginning, ""), 0.0);
        let of_both = |bridge: &Bridge, now_s| [0, 1].map(|uav| bridge.control(uav).heartbeats(now_s));
        run(&mut bridge, 1.0, &mut now_s, |bridge, now_s| speak(bridge, 0, [50.0, 50.0, 20.0], GUIDED, true, now_s));
        assert_eq!(of_both(&bridge, now_s), [Heartbeats::Due; 2]);
        run(&mut bridge, 14.0, &mut now_s, |_, _| {});
        assert_eq!(of_both(&bridge, now_s), [Heartbeats::Withheld; 2], "{beginning:?}");
        run(&mut bridge, 295.1, &mut now_s, |_, _| {});
        assert_eq!(of_both(&bridge, now_s), [Heartbeats::Withheld, Heartbeats::Due], "never heard, it is called");
        run(&mut bridge, 1.0, &mut now_s, |_, _| {});
        assert_eq!(of_both(&bridge, now_s), [Heartbeats::Withheld; 2]);
    }
    let mut flight = hovering(AutopilotKind::ArduPilot);
    flight.copter.change_to(CopterMode::Land);
    flight.until(100.0, |flight| flight.bridge.has_landed());
    assert_eq!(flight.bridge.control(0).heartbeats(flight.now_s), Heartbeats::Idle);
    flight.copter.take_off_by_hand(15.0);
    flight.advance(2.5);
    assert_eq!(flight.bridge.control(0).heartbeats(flight.now_s), Heartbeats::Due, "somebody flies it again");
}

#[test]
fn a_vehicle_that_must_not_fly_keeps_no_other_from_returning() {
    let (mut bridge, mut now_s) = (fleet(Beginning::Resumed, ""), 0.0);
    let speaks = |bridge: &mut Bridge, now_s| {
        speak(bridge, 1, [60.0, 50.0, 20.0], LOITER, true, now_s); // which is refused again and again
        speak(bridge, 0, [50.0, 50.0, 20.0], GUIDED, true, now_s);
    };
    run(&mut bridge, 3.0, &mut now_s, speaks);
    assert_eq!(bridge.poll(now_s, |_, _| {}, |_, _| {}).unwrap_err().number, 2);
    bridge.return_home("the bridge ends", now_s);
    let orders = run(&mut bridge, 2.0, &mut now_s, speaks);
    assert!(orders.contains(&(0, Order::Return)) && orders.iter().all(|(uav, _)| *uav == 0), "{orders:?}");
}

#[test]
fn a_vehicle_that_is_refused_while_its_order_to_arm_is_under_way_is_sent_home() {
    let on_ground = |is_armed: [bool; 2]| {
        move |bridge: &mut Bridge, now_s: f64| {
            speak(bridge, 0, [50.0, 50.0, 0.0], GUIDED, is_armed[0], now_s);
            speak(bridge, 1, [60.0, 50.0, 0.0], GUIDED, is_armed[1], now_s);
        }
    };
    // One that has refused the order stays on the ground.
    for (answer, phase) in [(None, Phase::Returning), (Some(4), Phase::Landed)] {
        let (mut bridge, mut now_s) = (fleet(Beginning::New, ""), 0.0);
        let orders = run(&mut bridge, 6.0, &mut now_s, on_ground([false; 2]));
        assert!([0, 1].iter().all(|uav| orders.contains(&(*uav, Order::Arm))), "{orders:?}");
        for (uav, result) in [(0, Some(0)), (1, answer)] {
            result.into_iter().for_each(|result| bridge.hear(uav, &Telemetry::Answer { command: 400, result }, now_s));
        }
        bridge.refuse(1, "two of them".to_owned(), now_s).unwrap();
        assert_eq!((bridge.control(1).phase(), bridge.control(1).history().was_armed), (phase, answer.is_none()));
        let orders = run(&mut bridge, 3.0, &mut now_s, on_ground([true, answer.is_none()]));
        assert_eq!(orders.contains(&(1, Order::Return)), answer.is_none(), "{orders:?}");
        assert!(orders.iter().all(|(uav, order)| *uav == 0 || *order == Order::Return), "{orders:?}");
        // Nor does the next bridge arm it.
        let mut next = fleet(Beginning::Restarted { in_mission: false }, "");
        next.go_on(bridge.histories(), 0, &start(&scenario("uav.count = 2\nuav.coordination = 'partition'\n")));
        let orders = run(&mut next, 8.0, &mut now_s, on_ground([false; 2]));
        assert!(!orders.contains(&(1, Order::Arm)), "{orders:?}");
    }
}

#[test]
fn a_vehicle_keeps_clear_of_where_a_silent_one_was_sent() {
    for (keys, is_refused) in [("uav.separation_m = 6.0\n", true), ("", false)] {
        let (mut bridge, mut now_s) = (fleet(RESTARTED, keys), 0.0);
        let first = |bridge: &mut Bridge, now_s| speak(bridge, 0, [50.0, 50.0, 20.0], GUIDED, true, now_s);
        let both = |bridge: &mut Bridge, now_s| {
            first(bridge, now_s);
            speak(bridge, 1, [60.0, 50.0, 20.0], GUIDED, true, now_s);
        };
        run(&mut bridge, 10.0, &mut now_s, both);
        let mut reports = start(&scenario("uav.count = 2\nuav.coordination = 'partition'\n"));
        // The link of the second is lost while it flies to (70, 50).
        for (slot, ends) in [(1, [[50.0, 50.0], [70.0, 50.0]]), (2, [[66.0, 51.0], [60.0, 50.0]])] {
            bridge.await_plan();
            bridge.fly(&ends.map(|[x_m, y_m]| Plan::fly_to([x_m, y_m, 20.0], Mode::Serve)), now_s);
            run(&mut bridge, 6.0, &mut now_s, first);
            bridge.end(slot, &mut reports, now_s);
            let hold = if slot == 2 && is_refused { HoldReason::Separation } else { HoldReason::None };
            assert_eq!(reports[0].hold, hold as u32, "slot {slot}, {keys:?}");
        }
    }
}

#[test]
fn a_vehicle_that_no_bridge_of_the_run_has_armed_is_left_alone() {
    let beginning = Beginning::Restarted { in_mission: false };
    let reports = start(&scenario("uav.count = 2\nuav.coordination = 'partition'\n"));
    for returns in [false, true] {
        let (mut bridge, mut now_s) = (fleet(beginning, ""), 0.0);
        bridge.go_on([History::default(); 2].into_iter(), 0, &reports);
        if returns {
            bridge.return_home("the run is stopped", now_s);
        }
        let orders = run(&mut bridge, 10.0, &mut now_s, |bridge, now_s| {
            speak(bridge, 0, [50.0, 50.0, 20.0], GUIDED, true, now_s);
        });
        assert_eq!((orders, bridge.control(0).phase()), (vec![], Phase::TakenOver));
    }
}

#[test]
fn a_vehicle_in_the_air_that_says_it_is_disarmed_is_not_taken_for_landed() {
    let (mut bridge, mut now_s) = (fleet(RESTARTED, ""), 0.0);
    run(&mut bridge, 0.3, &mut now_s, |bridge, now_s| speak(bridge, 0, [50.0, 50.0, 20.0], GUIDED, false, now_s));
    run(&mut bridge, 8.0, &mut now_s, |bridge, now_s| speak(bridge, 0, [50.0, 50.0, 20.0], GUIDED, true, now_s));
    assert_eq!(bridge.control(0).phase(), Phase::Flying);

    // One that stands without a position has landed.
    let mut before = hovering(AutopilotKind::ArduPilot);
    let now_s = before.now_s;
    before.bridge.return_home("its battery is low", now_s);
    before.fly_slot(1, None);
    before.until(150.0, |before| !before.copter.is_armed);
    let mut flight = restarted(&before, RESTARTED);
    flight.says_no_position = true;
    flight.advance(20.0);
    assert!(flight.bridge.has_landed(), "{:?}", flight.said);
}

#[test]
fn a_vehicle_that_is_home_keeps_no_other_from_taking_off() {
    let (mut bridge, mut now_s) = (fleet(Beginning::Restarted { in_mission: false }, ""), 0.0);
    let home = History { was_armed: true, has_seen_return: true, fate: Fate::Returns, ..History::default() };
    let reports = start(&scenario("uav.count = 2\nuav.coordination = 'partition'\n"));
    bridge.go_on([History::default(), home].into_iter(), 1, &reports); // the second is switched off
    let orders = run(&mut bridge, 8.0, &mut now_s, |bridge, now_s| {
        speak(bridge, 0, [50.0, 50.0, 0.0], GUIDED, false, now_s);
    });
    assert!(orders.contains(&(0, Order::Arm)), "{orders:?}");
}
