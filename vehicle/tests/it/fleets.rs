//! The vehicles of a fleet, of which some are silent, refused, at home, or others' by now.

use skysink_common::geodata::projection::Projection;
use skysink_common::geometry::Position;
use skysink_common::message::{HoldReason, Mode, Plan, SensorNode};
use skysink_vehicle::autopilot::AutopilotKind;
use skysink_vehicle::bridge::{Beginning, Bridge, start};
use skysink_vehicle::control::Heartbeats;
use skysink_vehicle::frame::AreaFrame;
use skysink_vehicle::saved::SavedVehicle;
use skysink_vehicle::table::State;
use skysink_vehicle::telemetry::{Fix, Order, Telemetry};

use crate::flight::{HOME, RESTARTED, own, scenario};

const FLEET: &str = "uav.count = 2\nuav.coordination = 'partition'\nuav.starts_m = [[50.0, 50.0], [60.0, 50.0]]\n";

const FLIES: State = State::Fly { has_begun: true };
const CHECK: State = State::Check { may_fly_on: false };

/// A bridge over the vehicles of a fleet, at (50, 50), (60, 50) and (70, 50), in these states of before.
fn fleet<const N: usize>(beginning: Beginning, states: [State; N], keys: &str) -> Bridge {
    let third = FLEET.replace("count = 2", "count = 3").replace("[60.0, 50.0]", "[60.0, 50.0], [70.0, 50.0]");
    let all = scenario(&format!("{}{keys}", if N == 3 { &third } else { FLEET }));
    let was_down = beginning != Beginning::First;
    let saved =
        states.map(|state| SavedVehicle { chosen: None, state, home_m: Some(488.0), was_down, was_flown: true });
    let saved = if states == [CHECK; N] { &[][..] } else { &saved };
    Bridge::new(&all, &[SensorNode::default()], AreaFrame::at(HOME), &start(&all), beginning, saved, &own(N))
}

/// Lets the vehicle number `uav` say where it is: at `at_m` [m], in this mode of ArduPilot.
fn speak(bridge: &mut Bridge, uav: usize, at_m: [f64; 3], mode: u32, is_armed: bool, now_s: f64) {
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
    let parameter = |name: &str, value| Telemetry::Parameter { name: name.to_owned(), value, is_integer: false };
    [
        Telemetry::Heartbeat { autopilot: AutopilotKind::ArduPilot, mode, is_armed, is_critical: false },
        Telemetry::Position(fix),
        Telemetry::Battery(Some(0.9)),
        Telemetry::InAir(at_m[2] > 1.0),
        parameter("FS_GCS_ENABLE", 1.0),
        parameter("MAV_GCS_SYSID", 255.0),
    ]
    .iter()
    .for_each(|telemetry| bridge.hear(uav, telemetry, now_s));
}

/// STABILIZE, GUIDED, LOITER and RTL.
const STABILIZE: u32 = 0;
const GUIDED: u32 = 4;
const LOITER: u32 = 5;
const RETURN: u32 = 6;

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

/// Both vehicles, at their starts: at these altitudes [m], in these modes.
fn both(z_m: [f64; 2], modes: [u32; 2], are_armed: [bool; 2]) -> impl Fn(&mut Bridge, f64) {
    move |bridge, now_s| {
        speak(bridge, 0, [50.0, 50.0, z_m[0]], modes[0], are_armed[0], now_s);
        speak(bridge, 1, [60.0, 50.0, z_m[1]], modes[1], are_armed[1], now_s);
    }
}

#[test]
fn the_vehicles_of_a_fleet_are_armed_once_all_are_checked() {
    let mut bridge = fleet(Beginning::First, [CHECK; 2], "");
    let mut now_s = 0.0;
    let orders = run(&mut bridge, 30.0, &mut now_s, both([0.0; 2], [GUIDED, STABILIZE], [false; 2]));
    assert_eq!(orders, [], "the second is in another mode");
    let orders = run(&mut bridge, 3.0, &mut now_s, both([0.0; 2], [GUIDED; 2], [false; 2]));
    assert_eq!(orders, [(0, Order::Arm), (1, Order::Arm)]);
}

#[test]
fn heartbeats_stop_where_a_vehicle_that_may_be_in_the_air_is_not_heard() {
    for (beginning, states) in [(RESTARTED, [FLIES; 2]), (Beginning::First, [FLIES; 2])] {
        let mut bridge = fleet(beginning, states, "");
        let mut now_s = 0.0;
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
}

#[test]
fn a_vehicle_that_others_fly_keeps_no_other_from_flying_on() {
    let mut bridge = fleet(RESTARTED, [FLIES; 2], "");
    let mut now_s = 0.0;
    run(&mut bridge, 3.0, &mut now_s, both([20.0; 2], [GUIDED, LOITER], [true; 2]));
    assert_eq!([0, 1].map(|uav| bridge.control(uav).state()), [FLIES, State::HandsOff]);
    assert_eq!(bridge.overridden().collect::<Vec<_>>(), [2]);
    bridge.return_home("the bridge ends");
    let orders = run(&mut bridge, 2.0, &mut now_s, both([20.0; 2], [GUIDED, LOITER], [true; 2]));
    assert_eq!(orders, [(0, Order::Return)]);
}

#[test]
fn a_vehicle_that_is_refused_before_it_is_armed_keeps_no_other_from_flying() {
    // Before any is armed, the run ends; afterwards it flies without it.
    let mut bridge = fleet(Beginning::First, [CHECK; 2], "");
    let mut now_s = 0.0;
    assert_eq!(bridge.refuse(1, "two of them".to_owned()).unwrap_err().number, 2);
    let mut flown = fleet(RESTARTED, [FLIES, CHECK], "");
    flown.refuse(1, "two of them".to_owned()).unwrap();
    assert_eq!([0, 1].map(|uav| flown.control(uav).state()), [FLIES, State::Done]);
    run(&mut bridge, 6.0, &mut now_s, |bridge, now_s| speak(bridge, 0, [50.0, 50.0, 20.0], LOITER, true, now_s));
    assert_eq!(bridge.poll(now_s, |_, _| {}, |_, _| {}), Ok(()), "it was said once, with the refusal");
    // One that the run before may have left in the air gets no heartbeats.
    let mut resumed = fleet(Beginning::First, [State::HandsOff, FLIES], "");
    resumed.refuse(1, "two of them".to_owned()).unwrap();
    assert_eq!(resumed.control(1).state(), State::Silent);
    assert_eq!(resumed.control(1).heartbeats(1.0), Heartbeats::Withheld);
}

#[test]
fn a_vehicle_does_not_wait_for_ever_for_another() {
    does_not_wait_for_ever(fleet(Beginning::First, [FLIES, CHECK], ""));
    does_not_wait_for_ever(fleet(Beginning::First, [FLIES, CHECK, State::HandsOff], ""));
}

fn does_not_wait_for_ever(mut bridge: Bridge) {
    let mut now_s = 0.0;
    let first = |bridge: &mut Bridge, now_s| speak(bridge, 0, [50.0, 50.0, 20.0], GUIDED, true, now_s);
    run(&mut bridge, 149.0, &mut now_s, first);
    assert!(!bridge.has_begun() && bridge.control(0).state() == FLIES);
    let mut refused = None;
    for _ in 0..30 {
        now_s += 0.1;
        first(&mut bridge, now_s);
        refused = refused.or(bridge.poll(now_s, |_, _| {}, |_, _| {}).err());
    }
    let refused = refused.unwrap();
    let expected = "it is not ready 150 s after another: no slot is flown";
    assert_eq!((refused.number, &*refused.why.to_string()), (2, expected));
    // What has taken off comes home.
    bridge.return_home("the bridge ends");
    let orders = run(&mut bridge, 2.0, &mut now_s, first);
    assert_eq!(orders, [(0, Order::Return)]);
}

#[test]
fn a_vehicle_keeps_clear_of_where_a_silent_one_was_sent() {
    for (keys, is_refused) in [("uav.separation_m = 6.0\n", true), ("", false)] {
        let mut bridge = fleet(RESTARTED, [FLIES; 2], keys);
        let mut now_s = 0.0;
        let first = |bridge: &mut Bridge, now_s| speak(bridge, 0, [50.0, 50.0, 20.0], GUIDED, true, now_s);
        run(&mut bridge, 10.0, &mut now_s, both([20.0; 2], [GUIDED; 2], [true; 2]));
        let mut reports = start(&scenario(FLEET));
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
fn a_vehicle_that_is_home_keeps_no_other_from_taking_off() {
    let mut bridge = fleet(Beginning::First, [CHECK, State::Done], "");
    let mut now_s = 0.0;
    let orders = run(&mut bridge, 4.0, &mut now_s, |bridge, now_s| {
        speak(bridge, 0, [50.0, 50.0, 0.0], GUIDED, false, now_s); // the second is switched off
    });
    assert_eq!(orders, [(0, Order::Arm)]);
}

#[test]
fn a_resumed_fleet_waits_for_a_vehicle_that_was_not_heard() {
    let mut bridge = fleet(Beginning::First, [FLIES; 2], "");
    let mut now_s = 0.0;
    let first = |bridge: &mut Bridge, now_s| speak(bridge, 0, [50.0, 50.0, 0.0], GUIDED, false, now_s);
    let orders = run(&mut bridge, 20.0, &mut now_s, first);
    assert_eq!(orders, [], "the second is switched off");
    let orders = run(&mut bridge, 5.0, &mut now_s, both([0.0; 2], [GUIDED; 2], [false; 2]));
    assert_eq!(orders, [(0, Order::Arm), (1, Order::Arm)]);
}

#[test]
fn a_vehicle_that_is_changed_before_take_off_is_checked_anew() {
    let mut bridge = fleet(Beginning::First, [CHECK; 2], "");
    let mut now_s = 0.0;
    let questions = |bridge: &mut Bridge, now_s: f64| {
        let mut asked = 0;
        let _ = bridge.poll(now_s, |_, order| asked += usize::from(matches!(order, Order::Parameter(_))), |_, _| {});
        asked
    };
    run(&mut bridge, 5.0, &mut now_s, both([0.0; 2], [GUIDED, STABILIZE], [false; 2]));
    assert_eq!(questions(&mut bridge, now_s + 0.05), 0, "all is known");
    run(&mut bridge, 4.0, &mut now_s, |_, _| {}); // its battery is changed
    let heartbeat =
        Telemetry::Heartbeat { autopilot: AutopilotKind::ArduPilot, mode: GUIDED, is_armed: false, is_critical: false };
    (0..4).for_each(|tenth| bridge.hear(0, &heartbeat, now_s + 0.4 + f64::from(tenth) / 10.0));
    assert!(questions(&mut bridge, now_s + 0.8) > 0, "it is asked again");
}

/// A run was killed while its second vehicle returned, and is resumed before that has landed.
#[test]
fn a_vehicle_that_is_found_armed_gets_no_heartbeats_while_another_flies_on() {
    let mut bridge = fleet(Beginning::First, [FLIES, State::Home { was_seen: true }], "");
    let mut now_s = 0.0;
    let orders = run(&mut bridge, 12.0, &mut now_s, both([20.0; 2], [GUIDED, RETURN], [true; 2]));
    assert_eq!(bridge.control(0).state(), FLIES);
    assert!(orders.iter().all(|(uav, order)| *uav == 0 && *order != Order::Arm), "{orders:?}");
    assert_eq!(bridge.control(1).state(), State::HandsOff);
    assert_eq!(bridge.control(1).heartbeats(now_s), Heartbeats::Withheld);
    assert_eq!(bridge.control(0).heartbeats(now_s), Heartbeats::Due);
}

/// The same of a vehicle that the checks would refuse: what is armed is no vehicle to check, and its failsafe acts
/// under the bridge after this one, too.
#[test]
fn a_vehicle_that_is_found_armed_is_not_refused_by_its_battery() {
    let mut bridge = fleet(Beginning::First, [FLIES, State::Home { was_seen: true }], "");
    let mut now_s = 0.0;
    let speaks = both([20.0; 2], [GUIDED, RETURN], [true; 2]);
    run(&mut bridge, 12.0, &mut now_s, |bridge, now_s| {
        speaks(bridge, now_s);
        bridge.hear(1, &Telemetry::Battery(Some(0.1)), now_s);
    });
    assert_eq!(
        (bridge.control(1).state(), bridge.control(1).heartbeats(now_s)),
        (State::HandsOff, Heartbeats::Withheld)
    );
    let saved = [0, 1].map(|uav| bridge.control(uav).saved(None));
    let restarted = Beginning::Restarted { in_mission: true };
    let all = start(&scenario(FLEET));
    let mut next =
        Bridge::new(&scenario(FLEET), &[SensorNode::default()], AreaFrame::at(HOME), &all, restarted, &saved, &own(2));
    let mut now_s = 0.0;
    run(&mut next, 3.0, &mut now_s, both([20.0; 2], [GUIDED, RETURN], [true; 2]));
    assert_eq!([0, 1].map(|uav| next.control(uav).heartbeats(now_s)), [Heartbeats::Due, Heartbeats::Withheld]);
}

/// A run is resumed whose vehicle hovers at its start.
#[test]
fn a_vehicle_that_is_at_its_start_at_once_is_still_told_its_speed() {
    let mut bridge = fleet(Beginning::First, [FLIES; 2], "");
    let mut now_s = 0.0;
    let orders = run(&mut bridge, 3.0, &mut now_s, both([20.0; 2], [GUIDED; 2], [true; 2]));
    assert!(bridge.has_begun());
    for uav in 0..2 {
        let is_speed = |(of, order): &&(usize, Order)| *of == uav && matches!(order, Order::Speed(_));
        assert!(orders.iter().filter(is_speed).count() > 1, "until it is answered: {orders:?}");
    }
}
