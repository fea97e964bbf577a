//! A vehicle over MAVLink whose bridge, planner or launcher is killed at ten instants of a mission, from the checks
//! before take-off to the last slots.

use std::thread;
use std::time::Duration;

use rustix::process::Signal;
use skysink_kinematic_vehicle::KinematicOptions;
use skysink_kinematic_vehicle::autopilot::CopterMode;

use crate::support::vehicles::TestVehicle;
use crate::support::{Output, Place, csv_rows};

/// Missions at a time.
const AT_A_TIME: u64 = 2;

/// Calls `check` with the numbers of ten instants.
fn fly_ten(check: impl Fn(u64) + Sync) {
    for first in (0..10).step_by(AT_A_TIME as usize) {
        thread::scope(|scope| {
            for instant in first..first + AT_A_TIME {
                let check = &check;
                scope.spawn(move || check(instant));
            }
        });
    }
}

/// A vehicle at 5 times real time, which returns after 3 s of wall time without a bridge.
fn vehicle() -> TestVehicle {
    TestVehicle::start_at(5, KinematicOptions { lag: 0.2, silence: 15.0, ..KinematicOptions::default() })
}

/// Waits for the instant: 0.2 s after the start of the run, and then each 1.2 s.
fn wait_for(instant: u64) {
    thread::sleep(Duration::from_millis(200 + 1_200 * instant));
}

/// Kills the process of a role at an instant of a mission, and waits until that has ended, with the vehicle on the
/// ground. Returns the modes of its slots, too.
fn kill_and_complete(role: &str, instant: u64) -> (Output, Vec<String>) {
    let place = Place::new();
    let vehicle = vehicle();
    let run = vehicle.flight(&place).set("slots", 8).start();
    run.until_topics();
    let process = run.worker(role);
    wait_for(instant);
    let _ = rustix::process::kill_process(process, Signal::KILL);
    let ended = run.wait();
    vehicle.until("ground", |copter| !copter.is_armed && !copter.is_in_air());
    let has_trace = std::path::Path::new(&place.path("run/slots.csv")).exists();
    let rows = if has_trace { csv_rows(&place.trace("run")) } else { Vec::new() };
    let modes = rows.iter().map(|row| row["mode"].clone()).collect();
    place.assert_clean();
    (ended, modes)
}

#[test]
fn a_bridge_killed_at_ten_instants_flies_on() {
    fly_ten(|instant| {
        let (ended, modes) = kill_and_complete("mavlink", instant);
        if ended.stderr.contains("the bridge was restarted between its command to arm and its mission") {
            // The next bridge judges nothing: the vehicle comes home by its GCS failsafe, and is not armed twice.
            assert!(!ended.stderr.contains("has taken off") && modes.is_empty(), "{instant}: {ended:?}");
            ended.assert_code(1);
            return;
        }
        let ended = ended.assert_success();
        assert_eq!(ended.stderr.matches("was restarted").count(), 1, "{instant}: {ended:?}");
        assert!(ended.stderr.matches("has taken off").count() <= 1, "{instant}: {ended:?}");
        assert!(modes.len() == 8 && modes.iter().filter(|mode| *mode == "serve").count() >= 6, "{instant}: {modes:?}");
        assert!(!modes.iter().any(|mode| mode == "return" || mode == "down"), "{instant}: {modes:?}");
    });
}

#[test]
fn a_planner_killed_at_ten_instants_misses_one_slot_each() {
    fly_ten(|instant| {
        let (ended, modes) = kill_and_complete("planner", instant);
        ended.assert_success();
        let flown = modes.iter().filter(|mode| ["serve", "fly", "en-route"].contains(&mode.as_str())).count();
        assert!(modes.len() == 8 && flown >= 7, "{instant}: {modes:?}");
    });
}

#[test]
fn the_vehicle_lands_after_a_kill_of_the_launcher_in_any_phase() {
    fly_ten(|instant| {
        let place = Place::new();
        let vehicle = vehicle();
        let run = vehicle.flight(&place).set("slots", 8).start();
        run.until_topics();
        wait_for(instant);
        let was_in_air = vehicle.copter().is_in_air();
        run.kill_launcher();
        if was_in_air {
            vehicle.until("return", |copter| copter.mode == CopterMode::Return);
        }
        vehicle.until("ground", |copter| !copter.is_armed && !copter.is_in_air());
        thread::sleep(Duration::from_secs(3)); // 15 s of the vehicle
        assert!(!vehicle.copter().is_armed && !vehicle.copter().is_in_air(), "{instant}: it takes off no more");
    });
}
