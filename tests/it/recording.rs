//! The recordings of `skysink run`.
use crate::support;
use crate::support::flight::{FlightBuilder, RunningFlight};
use crate::support::scenarios::SMOKE;
use crate::support::{Place, rows, slots, until, wait};
use rustix::process::Signal;

#[test]
fn a_lock_step_recording_contains_every_slot_and_the_cumulative_loss() {
    let place = Place::new();
    place.flight("smoke").run();
    let recording = place.path("run/mission.rrd");
    for entity in ["/world/uav", "/metrics/loss_rate", "/world/links"] {
        assert_eq!(slots(&recording, entity), (0..=60).collect(), "{entity}");
    }
    let status = rows(&recording, "/status");
    let lost = place.summary("run")["lost_bits"].as_u64().unwrap();
    assert_eq!(status.len(), 61);
    assert!(status[&60].contains("slot 60 at 01:00: **η so far 0.0"), "{}", status[&60]);
    assert!(status[&60].contains(&format!("({lost} of ")), "{}", status[&60]);
}

#[test]
fn record_every_draws_the_same_slots_in_ring_and_single_process() {
    let place = Place::new();
    let flight = place.flight("smoke").options(&["--record-every", "25"]);
    flight.out("alone").simulate();
    flight.out("ring").run();
    for run in ["alone", "ring"] {
        let drawn = slots(&place.path(&format!("{run}/mission.rrd")), "/metrics/loss_rate");
        assert_eq!(drawn, [0, 25, 50, 60].into(), "{run}");
    }
    for wrong in ["0", "-1", "x"] {
        let ended = place.run(&["simulate", SMOKE, "--record-every", wrong, "--out", "none"]);
        assert_eq!(ended.code, Some(2), "{ended:?}");
    }
}

/// The entities of the planned path.
const PATH: [&str; 4] = ["/world/path", "/world/path/stops", "/world/path_track", "/world/path_track/stops"];

/// `smoke`, flown by a planner that looks ahead.
fn ahead(place: &Place) -> FlightBuilder<'_> {
    place.flight("smoke").strategy("horizon").set("planner.horizon.iterations", 200)
}

#[test]
fn ring_and_single_process_record_the_same_planned_path() {
    let place = Place::new();
    let flight = ahead(&place);
    flight.out("alone").options(&["--record"]).simulate();
    flight.out("ring").run();
    for entity in PATH {
        let [alone, ring] = ["alone", "ring"].map(|run| rows(&place.path(&format!("{run}/mission.rrd")), entity));
        assert_eq!(alone.keys().next(), Some(&1), "{entity}");
        let drawn = alone.values().filter(|row| row.contains("PrimitiveArray<Float32>\n[\n  ")).count();
        assert!(drawn > 40, "{entity}: {drawn}");
        assert!(alone == ring, "{entity}");
    }
    place.flight("smoke").out("uts").run();
    assert_eq!(rows(&place.path("uts/mission.rrd"), "/world/path").len(), 0);
    assert_eq!(slots(&place.path("uts/mission.rrd"), "/world/uav_trail"), (0..=60).collect());
}

/// The entities of losses, coverage and the UAV's estimate.
const ANSWERS: [&str; 7] = [
    "/status",
    "/world/lost",
    "/maps/loss/shown",
    "/maps/overflow/shown",
    "/maps/coverage/shown",
    "/belief/error/shown",
    "/metrics/belief/mean_error",
];

#[test]
fn ring_and_single_process_record_the_same_losses_coverage_and_beliefs() {
    let place = Place::new();
    let sensors = "[sensors]\ncount = 60\nsampling_bps = [50.0, 350.0]\ninitial_queue_mean_bits = [0.0, 20000.0]\n";
    let planner = "[planner]\nstrategy = \"gfs\"\nknowledge = \"estimated\"\nrates = \"learnt\"\n";
    place.write("told.toml", &format!("name = \"told\"\nslots = 150\n[area]\nside_m = 300.0\n{sensors}{planner}"));
    place.flight("told").options(&["--record"]).out("alone").simulate();
    place.flight("told").out("ring").run();
    for entity in ANSWERS {
        let [alone, ring] = ["alone", "ring"].map(|run| rows(&place.path(&format!("{run}/mission.rrd")), entity));
        assert!(alone.len() > 10, "{entity}: {}", alone.len());
        assert!(alone == ring, "{entity}");
    }
}

#[test]
fn ring_and_single_process_record_the_same_heard_links_and_batteries() {
    let place = Place::new();
    let energy = "{ capacity_j = 3.0, sleep_w = 0.05, wake = \"scheduled\", listen_w = 0.1, tx_w = 1.0 }";
    let sensors = format!("[sensors]\ncount = 30\nsampling_bps = [50.0, 350.0]\nenergy = {energy}\n");
    let link = "[link]\nmodel = \"probabilistic-los\"\nbeacon_radius_m = 25.0\n";
    place.write("weak.toml", &format!("name = \"weak\"\nslots = 70\n{sensors}{link}"));
    place.flight("weak").options(&["--record"]).out("alone").simulate();
    place.flight("weak").out("ring").run();
    for entity in ["/world/heard", "/world/energy", "/world/dead", "/metrics/alive"] {
        let [alone, ring] = ["alone", "ring"].map(|run| rows(&place.path(&format!("{run}/mission.rrd")), entity));
        assert!(alone.len() > 5, "{entity}: {}", alone.len());
        assert!(alone == ring, "{entity}");
    }
}

#[test]
fn kills_of_the_planner_do_not_change_the_planned_path() {
    let place = Place::new();
    let flight = ahead(&place).set("slots", 400);
    flight.out("alone").options(&["--record"]).simulate();
    let run = flight.start();
    for slot in [20, 80, 150, 220, 300] {
        run.until_slot(slot);
        run.kill("planner");
    }
    let ended = run.wait_for_success();
    assert_eq!(place.summary("run")["restarts"], 5, "{ended:?}");
    place.assert_same_trace("alone", "run");
    for entity in PATH {
        let [alone, run] = ["alone", "run"].map(|run| rows(&place.path(&format!("{run}/mission.rrd")), entity));
        let others: Vec<_> = (0..=400).filter(|slot| alone.get(slot) != run.get(slot)).collect();
        assert!(others.is_empty(), "{entity} of {others:?}");
    }
    place.assert_clean();
}

/// Starts a run, and stops the viewer in it.
fn with_a_stopped_viewer(flight: FlightBuilder) -> RunningFlight {
    let run = flight.start();
    run.until_slot(20);
    run.signal_worker("viewer", Signal::STOP);
    run
}

#[test]
fn a_lock_step_ring_waits_for_a_slow_viewer() {
    let place = Place::new();
    let run = with_a_stopped_viewer(place.flight("fine"));
    // The ring has stopped: the same slot in two polls that are far apart.
    let mut stopped_at = 0;
    until("rest", || {
        std::thread::park_timeout(std::time::Duration::from_millis(300));
        let now = run.slots();
        (std::mem::replace(&mut stopped_at, now) == now).then_some(())
    });
    run.signal_worker("viewer", Signal::CONT);
    run.wait_for_success();
    assert!(stopped_at < 3_000, "the run was over before the viewer was stopped");
    assert_eq!(slots(&place.path("run/mission.rrd"), "/metrics/loss_rate"), (0..=3_000).collect());
}

#[test]
fn a_paced_run_does_not_wait_for_the_viewer_and_marks_missed_slots() {
    let place = Place::new();
    let run = with_a_stopped_viewer(place.flight("fine").set("slots", 900).pace("4x"));
    run.until_slots_later(300);
    run.signal_worker("viewer", Signal::CONT);
    let ended = run.wait_for_success();
    assert_eq!(place.summary("run")["timing"]["missed_deadlines"], place.summary("run")["held_slots"]);
    let recorded = slots(&place.path("run/mission.rrd"), "/metrics/loss_rate");
    let missed = 901 - recorded.len();
    assert!(missed > 100, "missed {missed}");
    assert!(ended.stderr.contains(&format!("viewer: missed {missed} slots")), "{missed}: {ended:?}");
}

/// Id of the recording in a file.
fn recording_id(place: &Place, file: &str) -> String {
    let mut reader = std::fs::File::open(place.path(file)).unwrap();
    let stores =
        re_chunk_store::ChunkStore::from_rrd_reader(&re_chunk_store::ChunkStoreConfig::DEFAULT, &mut reader).unwrap();
    stores.into_keys().find(|store| store.is_recording()).unwrap().recording_id().to_string()
}

#[test]
fn a_resumed_run_continues_the_recording_in_the_next_file_and_force_replaces_both() {
    let place = Place::new();
    let ended = place.flight("smoke").run();
    assert!(ended.stdout.contains("rerun run/mission.rrd"), "{ended:?}");
    let first = recording_id(&place, "run/mission.rrd");
    place.cut_trace("run", 55);
    let ended = place.run_ok(&["run", "--resume", "run"]);
    assert!(ended.stdout.contains("rerun run/*.rrd"), "{ended:?}");
    assert_eq!(recording_id(&place, "run/mission-2.rrd"), first);
    assert_eq!(slots(&place.path("run/mission-2.rrd"), "/metrics/loss_rate"), (55..=60).collect());
    let log: String = rows(&place.path("run/mission-2.rrd"), "/log/events").into_values().collect();
    assert!(log.contains("recording continued in a new file") && !log.contains("missed"), "{log}");
    assert!(!log.contains("first loss"), "it is in the file before: {log}");
    place.flight("smoke").force().run();
    let files = support::recordings(&place.path("run"));
    assert_eq!(files, [place.path("run/mission.rrd")]);
    assert_ne!(recording_id(&place, "run/mission.rrd"), first, "another run");
}

#[test]
fn a_live_port_in_use_ends_the_run_with_one_line() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port();
    let place = Place::new();
    let ended = place.flight("smoke").options(&[&format!("--live={port}")]).try_run().assert_code(2);
    assert!(ended.stderr.contains(&format!("port {port}")), "{ended:?}");
    place.assert_clean();
}

#[test]
fn a_run_can_be_served_live() {
    let free = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let place = Place::new();
    let run = place.flight("smoke").pace("60x").options(&[&format!("--live={free}")]).start();
    until("server", || std::net::TcpStream::connect(("127.0.0.1", free)).ok());
    run.wait_for_success();
    let recorded = slots(&place.path("run/mission.rrd"), "/metrics/loss_rate").len();
    assert!((50..=61).contains(&recorded), "{recorded} slots: a paced run does not wait for its viewer");
}

#[test]
fn a_live_viewer_prints_its_address() {
    let place = Place::new();
    let ended = place.flight("smoke").options(&["--live=0"]).run();
    let (_, address) = ended.stderr.split_once("viewer: live at rerun+http://127.0.0.1:").expect("an address");
    let port: u16 = address.split_once("/proxy").unwrap().0.parse().unwrap();
    assert!(port > 0 && address.contains(&format!("`rerun rerun+http://127.0.0.1:{port}/proxy`")), "{ended:?}");
}

#[test]
fn a_recording_that_cannot_be_created_ends_the_run_at_once() {
    let place = Place::new();
    let run = place.flight("smoke").external("viewer").start();
    let viewer = run.worker_command("viewer").args(["--save", "nowhere/x.rrd"]).spawn().unwrap();
    let viewer = wait(viewer).assert_code(2); // refused, so that a launcher would not start it again
    assert!(viewer.stderr.starts_with("viewer: recording nowhere/x.rrd: "), "{viewer:?}");
    run.terminate();
}
