//! A flight-sim that is not Skysink's, such as a bridge to a vehicle: its positions are recorded as it reports them,
//! and every command reads them back.

use std::fs;
use std::thread;

use iceoryx2::prelude::ipc;
use skysink::worker::silence_iceoryx2;
use skysink_common::message::Mode;
use skysink_common::scenario::Overrides;
use skysink_common::slot_record::UAV;
use skysink_common::stop::Stop;
use skysink_flight_sim::{Flight, ReportedFlight};
use skysink_mission::figures::Summary;
use skysink_mission::record::RunFolder;
use skysink_ring::error::NodeError;
use skysink_ring::folder::RingFolder;
use skysink_ring::role::Role;
use skysink_ring::topics::{Ring, is_release};

use crate::support::flight::RunningFlight;
use crate::support::{Place, scenarios, until};

/// Flies the plans of a ring as a vehicle in wind: it comes to rest elsewhere, at times outside the area. It always
/// says that it serves, also in one slot in seven, in which it does not. Its links have `1 / slower` of the capacity.
fn fly_in_wind(run: &RunningFlight, slower: u64) -> Result<(), NodeError> {
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
        let flown = ReportedFlight {
            position: [x_m, plan.y_m - gust_m, 20.0 + gust_m].into(),
            mode: Mode::from_repr(plan.mode).unwrap_or_default(),
            served: plan.scheduled().to_vec(),
            refused: 0,
            energy_j: f64::INFINITY,
        };
        let mut reported = flight.repeat(slot, &flown);
        drop(planned);
        reported.mode = Mode::Serve as u32;
        reported.served *= u32::from(slot % 7 > 0);
        reported.links.iter_mut().for_each(|link| link.capacity_bits /= slower);
        flights.send_list(ring.header(slot, 0), &[reported])?;
    }
    ring.wait_for_commit(&mut wait, is_release, || Ok(()))
}

/// A complete run of a vehicle in wind with slower links, in `run`.
fn flown(place: &Place, slower: u64) {
    let run = place.flight("smoke").without_viewer().external("flight-sim").start();
    thread::scope(|scope| {
        let vehicle = scope.spawn(|| fly_in_wind(&run, slower));
        vehicle.join().unwrap().unwrap();
    });
    run.wait_for_success();
}

#[test]
fn a_run_of_an_external_vehicle_is_labelled_and_read_by_every_command() {
    let place = Place::new();
    flown(&place, 1);
    let summary = place.summary("run");
    assert_eq!((&summary["external"], &summary["complete"]), (&serde_json::json!(["flight-sim"]), &true.into()));
    assert!(place.read("run/run.toml").contains("external = [\"flight-sim\"]"));
    let outside = place.trace("run").lines().filter(|line| line.contains(",-0.25,")).count();
    assert_eq!(outside, 10, "one slot in six");
    let idle = place.trace("run").lines().filter(|line| line.contains(",,") && line.contains(",fly,")).count();
    assert_eq!(idle, 8, "one slot in seven");

    place.run_ok(&["report", "run", "--sensors"]);
    place.run_ok(&["export", "run", "--format", "csv", "--out", "run.csv", "--origin", "47,8", "--north", "true"]);
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
fn the_results_of_a_vehicle_with_another_channel_follow_its_trace() {
    let place = Place::new();
    flown(&place, 1000);
    let summary = place.summary("run");
    assert!(summary["delivered_bits"].as_u64() > Some(0), "{summary}");
    let reported =
        || -> serde_json::Value { serde_json::from_str(&place.run_ok(&["report", "run", "--json"]).stdout).unwrap() };
    assert_eq!(reported(), summary);
    place.run_refused(&["report", "run", "--sensors"], "the external flight-sim had another channel");

    let folder = RunFolder::reopen(&place.path("run")).unwrap();
    let written = folder.summary().unwrap();
    let forged =
        Summary { loss_rate: 0.5, held_slots: 7, mean_served: 9.0, delivered_bits: 1, lost_bits: 2, ..written };
    folder.write_summary(&forged).unwrap(); // with a valid check value
    drop(folder);
    assert_eq!(reported(), summary);
    let text = place.read("run/summary.json");
    place.write("run/summary.json", &text.replacen("\"restarts\": 0", "\"restarts\": 1", 1));
    place.run_refused(&["report", "run"], "summary.json: it was modified");
    place.write("run/summary.json", &text);

    let trace = place.trace("run");
    let line = trace.lines().nth(30).unwrap();
    let columns: Vec<&str> = line.split(',').collect();
    let more = |column: usize| (columns[column].parse::<u64>().unwrap() + 1).to_string();
    for (changed, says) in [
        ([&columns[..6], &[&more(6)], &columns[7..]].concat(), "line 31: "), // a bit that was not sampled
        ([&columns[..4], &["0,9"], &columns[6..]].concat(), "slots of hash"),
    ] {
        place.write("run/slots.csv", &trace.replacen(line, &changed.join(","), 1));
        place.run_refused(&["report", "run"], says);
    }
    place.assert_clean();
}

#[test]
fn a_run_of_an_external_vehicle_is_resumed_by_flight_sim() {
    let place = Place::new();
    let run = place.flight("long").without_viewer().external("flight-sim").start();
    thread::scope(|scope| {
        let vehicle = scope.spawn(|| fly_in_wind(&run, 1));
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

#[test]
fn a_vehicle_command_is_started_restarted_and_named() {
    let place = Place::new();
    let command = &place.external_vehicle(0);
    let run = place.flight("long").without_viewer().vehicle(command).start();
    run.until_slot(200);
    run.kill("flight-sim");
    run.wait_for_success();
    place.assert_trace_as_simulated("run");
    let summary = place.summary("run");
    assert_eq!((&summary["external"], &summary["restarts"]), (&serde_json::json!(["flight-sim"]), &1.into()));
    assert!(place.read("run/run.toml").contains("external = [\"flight-sim\"]"));
    place.run_ok(&["report", "run", "--sensors"]);
    place.run_ok(&["replay", "run", "--no-viewer"]);
    place.assert_clean();
}

#[test]
fn a_run_of_a_vehicle_command_prints_its_resume_command() {
    let place = Place::new();
    let command = &place.external_vehicle(0);
    let run = place.flight("long").without_viewer().vehicle(command).start();
    run.until_slot(100);
    let ended = run.terminate();
    let hint = format!("`skysink run --resume run --vehicle {command}` continues it");
    assert!(ended.stderr.contains(&hint), "{ended:?}");
    place.run_ok(&["run", "--no-viewer", "--resume", "run", "--vehicle", command]);
    place.assert_trace_as_simulated("run");
    place.assert_clean();
}

/// A vehicle needs longer to get ready than a process of Skysink may take: it is neither killed nor given up.
#[test]
fn a_slow_vehicle_is_waited_for() {
    let place = Place::new();
    let flight = place.flight("smoke").without_viewer().vehicle(&place.external_vehicle(5));
    flight.timeout("60").run();
    assert_eq!(place.summary("run")["restarts"], 0);
    let ended = flight.out("short").timeout("1").try_run().assert_code(1);
    assert!(ended.stderr.contains("flight-sim has not sent flight(0) for 1 s"), "{ended:?}");
    place.assert_clean();
}
