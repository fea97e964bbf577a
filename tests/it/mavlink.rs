//! `skysink run --vehicle` with MAVLink addresses: the bridge flies a kinematic vehicle, which fails in many ways.

use std::net::UdpSocket;

use crate::support::vehicles::{SLOW, TestVehicle};
use crate::support::{Place, csv_rows};
use rustix::process::Signal;
use skysink_common::geodata::projection::Origin;
use skysink_kinematic_vehicle::KinematicOptions;
use skysink_kinematic_vehicle::autopilot::{Copter, CopterMode};

/// A heartbeat of a ground station of system 254 in MAVLink 2.
const STATION: [u8; 21] = [253, 9, 0, 0, 0, 254, 190, 0, 0, 0, 0, 0, 0, 0, 6, 8, 0, 4, 3, 23, 0];

/// Two vehicles, at the home of the kinematic ones and 10 m beside it.
const FLEET: &str = "uav.count=2 uav.starts_m=[[30.0,30.0],[40.0,30.0]]";

/// The modes of the trace, by slot.
fn modes(place: &Place) -> Vec<String> {
    csv_rows(&place.trace("run")).iter().map(|row| row["mode"].clone()).collect()
}

/// The slots that ended within 2 m of the waypoint [%], as the bridge says.
fn percent_reached(stderr: &str) -> f64 {
    let line = stderr.lines().find(|line| line.contains("of the waypoint")).unwrap_or_else(|| panic!("{stderr}"));
    line.split_once(": ").unwrap().1.split_once(' ').unwrap().0.parse().unwrap()
}

#[test]
fn a_vehicle_flies_a_run_that_every_command_reads() {
    let place = Place::new();
    let vehicle = TestVehicle::start(KinematicOptions { lag: 0.2, noise: 0.1, ..KinematicOptions::default() });
    let ended = vehicle.flight(&place).run();
    assert!(percent_reached(&ended.stderr) >= 95.0, "{ended:?}");
    vehicle.until_landed();
    assert!(ended.stderr.contains("vehicle 1: has landed"), "the run waits for that: {ended:?}");
    let summary = place.summary("run");
    assert_eq!((&summary["external"], &summary["complete"]), (&serde_json::json!(["flight-sim"]), &true.into()));
    let served = modes(&place).iter().filter(|mode| *mode == "serve").count();
    assert!(served >= 25, "{:?}", modes(&place));
    place.run_ok(&["report", "run", "--sensors"]);
    place.run_ok(&["replay", "run", "--no-viewer"]);
    #[cfg(feature = "lab")]
    place.run_ok(&["export", "run", "--format", "waypoints", "--out", "run.waypoints"]);
    place.assert_clean();
}

#[test]
fn lost_messages_gusts_and_delayed_arming_do_not_end_a_mission() {
    let place = Place::new();
    let vehicle = TestVehicle::start(KinematicOptions {
        lag: 0.3,
        noise: 0.2,
        wind: 3.0,
        loss: 0.2,
        ready_after: 120.0, // until then it complains, and one of the texts arrives; 6 s, as a run may begin late
        ..KinematicOptions::default()
    });
    // It is commanded to arm once in a run: where that is lost, its operator begins again.
    let mut lost = String::new();
    let ended = loop {
        let ended = vehicle.flight(&place).force().try_run();
        if ended.code == Some(0) {
            break ended;
        }
        assert!(ended.stderr.contains("vehicle 1: is not flown: it "), "{ended:?}");
        lost += &ended.stderr;
        assert!(lost.matches("is not flown").count() < 8, "{lost}");
    };
    assert!(percent_reached(&ended.stderr) >= 80.0, "{ended:?}");
    assert!((lost + &ended.stderr).contains("says: PreArm: Need Position Estimate"), "{ended:?}");
    vehicle.until_landed();
}

#[test]
fn a_failsafe_ends_the_orders_and_the_mission_is_recorded_to_its_end() {
    let place = Place::new();
    let vehicle = TestVehicle::start(KinematicOptions { failsafe_at: Some(90.0), ..KinematicOptions::default() });
    let ended = vehicle.flight(&place).run();
    assert!(
        ended.stderr.contains("vehicle 1: is overridden: it returns or lands by itself (RTL): a failsafe, or a pilot"),
        "{ended:?}"
    );
    let modes = modes(&place);
    let first = modes.iter().position(|mode| mode == "return").expect("it returns");
    let landed = modes.iter().position(|mode| mode == "down").expect("it lands");
    assert!(first > 5 && landed > first && modes[landed..].iter().all(|mode| mode == "down"), "{modes:?}");
    assert!(!modes[first..].iter().any(|mode| mode == "serve"), "{modes:?}");
    place.run_ok(&["report", "run", "--sensors"]);
}

#[test]
fn a_pilot_who_takes_over_ends_the_orders_and_the_run_says_how_to_end_it() {
    let place = Place::new();
    let vehicle = TestVehicle::start(KinematicOptions::default());
    let run = vehicle.flight(&place).set("slots", 12).start();
    run.until_slot(4);
    vehicle.change_to(CopterMode::Loiter);
    run.until_printed("vehicle 1: is overridden: its mode changed to LOITER");
    run.until_printed("vehicle 1: the run waits for its landing; Ctrl-C ends the run");
    assert_eq!(vehicle.copter().mode, CopterMode::Loiter);
    let ended = run.terminate();
    assert!(ended.stderr.contains(": all 12 slots are recorded") && !ended.stderr.contains("--resume"), "{ended:?}");
    assert_eq!(place.summary("run")["complete"], true);
    let modes = modes(&place);
    assert!(modes.len() == 12 && modes.last().unwrap() == "return", "{modes:?}");
}

#[test]
fn a_run_whose_vehicle_was_overridden_is_not_offered_to_be_resumed() {
    let place = Place::new();
    let vehicle = TestVehicle::start(KinematicOptions::default());
    let run = vehicle.flight(&place).start();
    run.until_slot(2);
    vehicle.change_to(CopterMode::Loiter);
    run.until_printed("vehicle 1: is overridden");
    let ended = run.terminate();
    assert!(ended.stderr.contains("; it is not resumed, as others fly a vehicle, or none flies any more"), "{ended:?}");
    assert!(!ended.stderr.contains("--resume"), "{ended:?}");
}

#[test]
fn what_a_pilot_took_over_or_landed_in_the_last_slot_is_left_alone_by_a_resumed_run() {
    for (is_landed, is_noticed) in [(false, true), (true, true), (false, false)] {
        let place = Place::new();
        let vehicle = TestVehicle::start(KinematicOptions::default());
        let run = vehicle.flight(&place).start();
        run.until_slot(2);
        vehicle.set_mute(!is_noticed);
        if is_landed {
            vehicle.act(|copter| copter.body.position_m.z = 0.0);
            vehicle.act(|copter| copter.disarm());
        } else {
            vehicle.change_to(CopterMode::Loiter);
        }
        if is_noticed {
            run.until_printed(if is_landed {
                "its mission is over: it has disarmed"
            } else {
                "vehicle 1: is overridden"
            });
        } else {
            run.until_printed("vehicle 1: is not heard any more"); // no earlier report of its mode is on its way
        }
        run.signal_launcher(Signal::TERM);
        vehicle.set_mute(false);
        run.wait().assert_code(143);
        let resumed = place.skysink(&["run", "--resume", "run", "--no-viewer", "--vehicle", &vehicle.address]);
        let refused = crate::support::output(resumed).assert_code(2);
        let says = "its vehicles have landed, or were flown by others: expected a new run";
        assert!(refused.stderr.contains(says), "{refused:?}");
        vehicle.until("the same state", |copter| copter.is_armed != is_landed && copter.mode != CopterMode::Return);
    }
}

#[test]
fn a_run_in_which_nothing_is_flown_fails_and_says_why() {
    let place = Place::new();
    let vehicle = TestVehicle::start(KinematicOptions::default());
    let run = vehicle.flight(&place).start();
    vehicle.until("arming", |copter| copter.is_armed);
    vehicle.act(|copter| copter.disarm());
    let ended = run.wait().assert_code(1);
    // At 20 times real time, a heartbeat may not have shown that it was armed.
    let says = "flight-sim: vehicle 1: its mission was over before it began: ";
    let is_said = |why| ended.stderr.contains(&format!("{says}{why}"));
    assert!(is_said("it has disarmed: no slot was flown") || is_said("it was not armed, or not ready"), "{ended:?}");
}

#[test]
fn a_run_that_is_stopped_in_the_climb_does_not_say_that_nothing_was_flown() {
    let place = Place::new();
    let vehicle = TestVehicle::start(KinematicOptions::default());
    let run = vehicle.flight(&place).start();
    vehicle.until("take-off", Copter::is_in_air);
    let ended = run.terminate();
    assert!(ended.stderr.contains("vehicle 1: returns: the run is stopped"), "{ended:?}");
    assert!(ended.stderr.contains(": no slot was flown") && !ended.stderr.contains("nothing was flown"), "{ended:?}");
    vehicle.until_landed();
}

#[test]
fn a_vehicle_that_is_not_there_is_named_by_its_address() {
    let place = Place::new();
    place.write("slow.toml", SLOW);
    let port = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let address = format!("udpin:127.0.0.1:{port}?system=3");
    let flight = place.flight("slow").without_viewer().pace("20x").timeout("4").vehicle(&address);
    let ended = flight.try_run().assert_code(1);
    assert!(ended.stderr.contains(&format!("vehicle 1: no vehicle was heard at {address} for ")), "{ended:?}");
}

#[test]
fn a_stopped_launcher_is_noticed_by_clock_and_the_vehicle_returns() {
    let place = Place::new();
    let vehicle = TestVehicle::start(KinematicOptions::default());
    let run = vehicle.flight(&place).start();
    run.until_slot(4);
    run.signal_launcher(Signal::STOP);
    vehicle.until("return", |copter| copter.mode == CopterMode::Return);
    vehicle.until_landed();
    run.signal_launcher(Signal::CONT);
    let ended = run.wait_for_success();
    assert!(ended.stderr.contains("vehicle 1: returns: no plan has come for "), "{ended:?}");
}

#[test]
fn orders_reach_the_vehicle_whoever_else_speaks_to_the_port() {
    let place = Place::new();
    let vehicle = TestVehicle::start(KinematicOptions::default());
    let run = vehicle.flight(&place).set("slots", 10).start();
    run.until_slot(2);
    let stranger = UdpSocket::bind("127.0.0.1:0").unwrap();
    stranger.set_nonblocking(true).unwrap();
    for slot in 3..=9 {
        run.until_slot(slot);
        for _ in 0..20 {
            stranger.send_to(&STATION, format!("127.0.0.1:{}", vehicle.port())).unwrap();
            stranger.send_to(b"no MAVLink", format!("127.0.0.1:{}", vehicle.port())).unwrap();
        }
    }
    let ended = run.wait_for_success();
    assert!(percent_reached(&ended.stderr) >= 95.0, "{ended:?}");
    assert_eq!(ended.stderr.matches("speaks as system 254, component 190").count(), 1, "{ended:?}");
    assert!(stranger.recv(&mut [0; 300]).is_err(), "it got what was meant for the vehicle");
}

#[test]
fn a_restarted_bridge_takes_over_the_vehicle_in_the_air() {
    let place = Place::new();
    // It returns after 3 s of wall time without a bridge.
    let vehicle = TestVehicle::start_at(5, KinematicOptions { silence: 15.0, ..KinematicOptions::default() });
    let run = vehicle.flight(&place).set("slots", 14).start();
    run.until_slot(2);
    for _ in 0..3 {
        run.until_slots_later(2);
        run.kill_and_await("mavlink");
    }
    let ended = run.wait_for_success();
    assert_eq!(ended.stderr.matches("has taken off").count(), 1, "{ended:?}");
    assert_eq!(ended.stderr.matches("is flown on as soon as it reports the mode").count(), 3, "{ended:?}");
    let modes = modes(&place);
    assert!(modes.len() == 14 && modes.iter().filter(|mode| *mode == "serve").count() >= 9, "{modes:?}");
    vehicle.until_landed();
}

#[test]
fn a_restarted_bridge_keeps_a_vehicle_with_a_failsafe_of_five_seconds() {
    let place = Place::new();
    // At twice real time, so that 2.5 s without heartbeats make it return.
    let vehicle = TestVehicle::start_at(2, KinematicOptions { silence: 5.0, ..KinematicOptions::default() });
    let run = vehicle.flight(&place).set("slots", 5).start();
    run.until_slot(1);
    for _ in 0..2 {
        run.until_slots_later(1);
        run.kill_and_await("mavlink");
    }
    let ended = run.wait_for_success();
    assert_eq!(ended.stderr.matches("is flown on as soon as it reports the mode").count(), 2, "{ended:?}");
    for line in ["is overridden", "GCS Failsafe"] {
        assert!(!ended.stderr.contains(line), "{ended:?}");
    }
}

#[test]
fn heartbeats_stop_for_a_vehicle_that_is_not_heard() {
    let place = Place::new();
    let vehicle = TestVehicle::start(KinematicOptions::default());
    let run = vehicle.flight(&place).start();
    run.until_slot(2);
    vehicle.set_mute(true);
    vehicle.until("return", |copter| copter.mode == CopterMode::Return);
    vehicle.until_landed();
    let ended = run.terminate();
    assert!(ended.stderr.contains("vehicle 1: is not heard any more, for 3 s"), "{ended:?}");
}

#[test]
fn a_vehicle_that_the_bridge_before_has_armed_is_not_armed_again() {
    let place = Place::new();
    let vehicle = TestVehicle::start(KinematicOptions::default());
    let run = vehicle.flight(&place).start();
    vehicle.until("arming", |copter| copter.is_armed);
    run.signal_worker("mavlink", Signal::STOP); // it does not see the pilot
    vehicle.act(Copter::disarm);
    vehicle.until("pilot", |copter| !copter.is_armed && !copter.is_in_air());
    run.signal_worker("mavlink", Signal::KILL);
    let ended = run.wait().assert_code(1);
    assert!(ended.stderr.contains("the bridge was restarted between its command to arm and its mission"), "{ended:?}");
    assert!(!vehicle.copter().is_armed);
}

#[test]
fn a_pilot_override_outlives_the_bridge() {
    let place = Place::new();
    let vehicle = TestVehicle::start(KinematicOptions::default());
    let run = vehicle.flight(&place).start();
    run.until_slot(2);
    vehicle.change_to(CopterMode::Loiter);
    run.until_printed("vehicle 1: is overridden: its mode changed to LOITER");
    run.until_slots_later(1);
    vehicle.act(|copter| copter.mode = CopterMode::Guided); // handed to another ground station
    run.kill_and_await("mavlink");
    run.until_slots_later(3);
    assert_eq!(vehicle.copter().mode, CopterMode::Guided);
    let ended = run.terminate();
    assert!(ended.stderr.contains("is left alone: it was flown by others before this bridge began"), "{ended:?}");
    assert!(modes(&place)[3..].iter().all(|mode| mode == "return"), "{:?}", modes(&place));
}

#[test]
fn a_bridge_that_is_killed_while_the_vehicle_returns_is_named() {
    let place = Place::new();
    let vehicle = TestVehicle::start_at(5, KinematicOptions { silence: 15.0, ..KinematicOptions::default() });
    let run = vehicle.flight(&place).set("slots", 3).start();
    run.until_printed("vehicle 1: returns: the mission is over");
    std::thread::sleep(std::time::Duration::from_secs(1)); // before that the bridge would be restarted
    run.signal_worker("mavlink", Signal::KILL);
    let ended = run.wait_for_success();
    assert!(ended.stderr.contains("ended with signal: 9 (SIGKILL) after the mission"), "{ended:?}");
    vehicle.until_landed();
}

#[test]
fn a_killed_planner_is_restarted_and_a_silent_one_makes_the_vehicle_return() {
    let place = Place::new();
    let vehicle = TestVehicle::start(KinematicOptions::default());
    let run = vehicle.flight(&place).start();
    run.until_slot(5);
    run.kill_and_await("planner");
    run.until_slots_later(3);
    assert_eq!(vehicle.copter().mode, CopterMode::Guided);
    run.signal_worker("planner", Signal::STOP);
    run.until_printed("vehicle 1: returns: no plan has come for ");
    vehicle.until_landed();
    run.signal_worker("planner", Signal::CONT);
    run.wait_for_success();
    let modes = modes(&place);
    assert!(modes.iter().any(|mode| mode == "hold") && modes.last().unwrap() == "down", "{modes:?}");
}

#[test]
fn the_vehicle_returns_when_the_launcher_is_killed_and_when_the_run_is_stopped() {
    for is_killed in [true, false] {
        let place = Place::new();
        let vehicle = TestVehicle::start(KinematicOptions::default());
        let run = vehicle.flight(&place).start();
        run.until_slot(5);
        if is_killed {
            run.kill_launcher();
        } else {
            let ended = run.terminate();
            assert!(ended.stderr.contains("vehicle 1: returns: the run is stopped"), "{ended:?}");
        }
        vehicle.until("return", |copter| copter.mode == CopterMode::Return);
        vehicle.until_landed();
    }
}

#[test]
fn a_stopped_run_is_resumed_where_the_vehicle_was() {
    let place = Place::new();
    let vehicle = TestVehicle::start(KinematicOptions::default());
    let run = vehicle.flight(&place).start();
    run.until_slot(6);
    let ended = run.terminate();
    assert!(ended.stderr.contains(&format!("--resume run --vehicle {}` continues it", vehicle.address)), "{ended:?}");
    vehicle.until_landed();
    let begun = place.trace("run");
    vehicle.change_to(CopterMode::Guided); // by its operator: it has landed in RTL
    let ended = place.run_ok(&["run", "--resume", "run", "--no-viewer", "--vehicle", &vehicle.address]);
    assert!(ended.stderr.contains("hovers at its start"), "{ended:?}");
    assert!(place.trace("run").starts_with(&begun));
    assert_eq!(modes(&place).len(), 30);
    place.run_ok(&["report", "run", "--sensors"]);
    vehicle.until_landed();
}

#[test]
fn one_bridge_flies_a_fleet() {
    let place = Place::new();
    let vehicle = TestVehicle::start(KinematicOptions { count: 2, lag: 0.2, ..KinematicOptions::default() });
    let ended = vehicle.flight(&place).settings(FLEET).set("slots", 15).run();
    assert!(percent_reached(&ended.stderr) >= 95.0, "{ended:?}");
    for number in 1..=2 {
        assert!(ended.stderr.contains(&format!("vehicle {number}: has landed")), "{ended:?}");
    }
    assert_eq!(modes(&place).len(), 30);
}

#[test]
fn the_vehicles_of_a_fleet_may_have_separate_addresses() {
    let place = Place::new();
    let [first, second] =
        [0.3, 0.0].map(|lag| TestVehicle::start(KinematicOptions { lag, ..KinematicOptions::default() }));
    let addresses = format!("{},{}", first.address, second.address);
    let ended = first.flight_of(&place, &addresses).settings(FLEET).set("slots", 8).run();
    assert!(ended.stderr.contains("vehicle 2: has landed"), "{ended:?}");
    first.until_landed();
    second.until_landed();
}

#[test]
fn a_vehicle_that_must_not_take_off_is_refused_in_one_line() {
    let refused = |options: KinematicOptions, says: &str| {
        let place = Place::new();
        let vehicle = TestVehicle::start(options);
        let ended = vehicle.flight(&place).try_run().assert_code(1);
        assert!(ended.stderr.contains(&format!("flight-sim: vehicle 1: {says}")), "{ended:?}");
        assert!(!vehicle.copter().is_armed);
    };
    let default = KinematicOptions::default;
    refused(
        KinematicOptions { gcs_failsafe: Some(0), ..default() },
        "FS_GCS_ENABLE = 0: when the bridge is silent, expected 1 (returns)",
    );
    refused(KinematicOptions { gcs_failsafe: Some(5), ..default() }, "FS_GCS_ENABLE = 5: when the bridge is silent");
    refused(KinematicOptions { count: 2, ..default() }, "2 vehicles at its address: system 1 (quadrotor, ");
    refused(
        KinematicOptions { battery: 20, ..default() },
        "its battery is at 20 %: at least 25 % is needed to take off",
    );
    refused(KinematicOptions { home: Origin { lat_deg: 47.4077, lon_deg: 8.5456 }, ..default() }, "it is 10");
}

#[test]
fn invalid_addresses_are_refused_in_one_line() {
    let place = Place::new();
    place.write("slow.toml", SLOW);
    let taken = UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = format!("udpin:{}", taken.local_addr().unwrap());
    let flight = place.flight("slow").without_viewer().pace("20x");
    let ended = flight.vehicle(&address).try_run().assert_code(1);
    assert!(
        ended.stderr.contains(&format!("vehicle {address}: cannot be opened: Address already in use")),
        "{ended:?}"
    );
    let near = flight.out("near").settings("uav.count=2 uav.starts_m=[[30.0,30.0],[33.0,30.0]]");
    let ended = near.vehicle("udpin:127.0.0.1:1").try_run().assert_code(2);
    assert!(
        ended.stderr.contains("uav.starts_m=[[30.0, 30.0], [33.0, 30.0]]: expected starts at least 5 m apart"),
        "{ended:?}"
    );
    assert!(!place.path("near").exists(), "a folder of a run that was refused");
    let flight = flight.out("none");
    let ended = flight.vehicle("udpin:14540").try_run().assert_code(2);
    assert!(ended.stderr.contains("expected udpin, udpout"), "{ended:?}");
    let ended = flight.vehicle("udp:127.0.0.1:14550").try_run().assert_code(2);
    assert!(ended.stderr.contains("expected udpin:127.0.0.1:14550 to listen there"), "{ended:?}");
    let ended = flight.vehicle("udpin:127.0.0.1:14550?system=1&system=2").try_run().assert_code(2);
    assert!(ended.stderr.contains("system=2: expected system once"), "{ended:?}");
    flight
        .vehicle("udpout:127.0.0.1:1,udpout:127.0.0.1:2")
        .try_run()
        .assert_refused("2 addresses for 1 UAVs: expected one, or one for each");
    assert!(!place.path("none").exists());
}
