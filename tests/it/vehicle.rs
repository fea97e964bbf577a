//! A flight-sim that is not Skysink's, such as a bridge to a vehicle: its positions are recorded as it reports them,
//! and every command reads them back.

use std::fs;
use std::thread;

use iceoryx2::prelude::ipc;
use skysink::worker::silence_iceoryx2;
use skysink_common::message::Plan;
use skysink_common::scenario::Overrides;
use skysink_common::slot_record::UAV;
use skysink_common::stop::Stop;
use skysink_flight_sim::Flight;
use skysink_ring::error::NodeError;
use skysink_ring::folder::RingFolder;
use skysink_ring::role::Role;
use skysink_ring::topics::{Ring, is_release};

use crate::support::flight::RunningFlight;
use crate::support::{Place, scenarios, until};

/// Flies the plans of a ring as a vehicle in wind: it comes to rest elsewhere, at times outside the area.
fn fly_in_wind(run: &RunningFlight) -> Result<(), NodeError> {
    silence_iceoryx2();
    run.until_topics();
    let folder = until("terms of the ring", || RingFolder::open(&run.folder()).ok());
    let scenario = scenarios::read(&run.path("scenario.toml"), Overrides::default());
    let stop = Stop::default();
    let open = || Ring::<ipc::Service>::join(&folder, &scenario, Role::FlightSim, &stop).ok();
    let (ring, mut wait) = until("topics", open);
    let flights = ring.flight.list_writer(1)?;
    let mut plans = ring.plan.reader()?;
    let mut sensors = ring.sensors.reader()?;
    let mut flight = Flight::new(&scenario, sensors.wait_for_next(&mut wait, 0)?.payload());
    flights.send_list(ring.header(0, 0), &[flight.start()])?;
    for slot in 1..=scenario.slots {
        let Some(planned) = plans.wait_for_slot(&mut wait, slot)? else { continue };
        let plan = planned[UAV];
        let gust_m = 0.37 * (slot % 5) as f64;
        let x_m = if slot % 6 == 0 { -0.25 } else { plan.x_m + gust_m };
        let reported = flight.repeat(slot, &Plan { x_m, y_m: plan.y_m - gust_m, z_m: 20.0 + gust_m, ..plan });
        drop(planned);
        flights.send_list(ring.header(slot, 0), &[reported])?;
    }
    ring.wait_for_commit(&mut wait, is_release, || Ok(()))
}

/// A complete run of a vehicle in wind, in `run`.
fn flown(place: &Place) {
    let run = place.flight("smoke").without_viewer().external("flight-sim").start();
    thread::scope(|scope| {
        let vehicle = scope.spawn(|| fly_in_wind(&run));
        vehicle.join().unwrap().unwrap();
    });
    run.wait_for_success();
}

#[test]
fn a_run_of_a_foreign_vehicle_is_named_as_such_and_read_by_every_command() {
    let place = Place::new();
    flown(&place);
    let summary = place.summary("run");
    assert_eq!((&summary["external"], &summary["complete"]), (&serde_json::json!(["flight-sim"]), &true.into()));
    assert!(place.read("run/run.toml").contains("external = [\"flight-sim\"]"));
    let outside = place.trace("run").lines().filter(|line| line.contains(",-0.25,")).count();
    assert_eq!(outside, 10, "one slot in six");

    place.run_ok(&["report", "run", "--sensors"]);
    place.run_ok(&["export", "run", "--format", "csv", "--out", "run.csv", "--origin", "47,8"]);
    place.run_ok(&["replay", "run", "--no-viewer"]);
    let outcome: serde_json::Value = serde_json::from_str(&place.read("run-replay/replay.json")).unwrap();
    assert_eq!(outcome["trace_hash"], summary["trace_hash"]);
    place.run_ok(&["replay", "run", "--no-viewer", "--strategy", "gfs", "--out", "gfs"]);
    #[cfg(feature = "lab")]
    {
        place.flight("smoke").out("simulated").simulate();
        place.run_ok(&["compare", "run", "simulated"]);
        let other = place.summary("simulated");
        assert_eq!(other["external"], serde_json::json!([]));
    }

    let trace = place.trace("run");
    fs::write(place.path("run/slots.csv"), trace.replacen(",-0.25,", ",-0.5,", 1)).unwrap();
    place.run_refused(&["report", "run", "--sensors"], "slots.csv");
    place.assert_clean();
}

#[test]
fn a_run_of_a_foreign_vehicle_is_resumed_by_skysinks() {
    let place = Place::new();
    let run = place.flight("long").without_viewer().external("flight-sim").start();
    thread::scope(|scope| {
        let vehicle = scope.spawn(|| fly_in_wind(&run));
        run.until_slot(100);
        run.signal_launcher(rustix::process::Signal::TERM);
        assert!(vehicle.join().unwrap().is_err(), "the launcher has ended");
    });
    run.wait().assert_code(143);
    let begun = place.trace("run");
    place.resume("run");
    assert!(place.trace("run").starts_with(&begun));
    assert_eq!(place.summary("run")["external"], serde_json::json!(["flight-sim"]));
    place.run_ok(&["report", "run", "--sensors"]);
    place.assert_clean();
}

#[test]
fn a_role_that_becomes_external_when_a_run_is_resumed_is_named() {
    let place = Place::new();
    let run = place.flight("long").without_viewer().start();
    run.until_slot(100);
    run.terminate();
    assert!(!place.read("run/run.toml").contains("external"));
    let mut command = place.skysink(&["run", "--resume", "run", "--no-viewer", "--external", "flight-sim"]);
    command.env("TMPDIR", place.path(""));
    let resumed = RunningFlight::start(&place, command, "run");
    let vehicle = resumed.worker_command("flight-sim").spawn().unwrap();
    resumed.wait_for_success();
    crate::support::wait(vehicle).assert_success();
    assert!(place.read("run/run.toml").contains("external = [\"flight-sim\"]"));
    place.assert_trace_as_simulated("run");
    place.run_ok(&["report", "run", "--sensors"]);
    place.assert_clean();
}
