//! What `skysink run` leaves to look at.
use crate::support;
use crate::support::{Place, end, lines, rows, slots, until};
use rustix::process::{Pid, Signal, kill_process};

const SMOKE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/smoke.toml");

#[test]
fn a_lock_step_recording_holds_every_slot() {
    let place = Place::new();
    place.run_well(&["run", SMOKE, "--out", "run"]);
    for entity in ["/world/uav", "/metrics/loss_rate", "/world/links"] {
        assert_eq!(slots(&place.path("run/mission.rrd"), entity), (0..=60).collect(), "{entity}");
    }
}

#[test]
fn one_slot_in_so_many_is_drawn_by_a_ring_and_by_one_process() {
    let place = Place::new();
    let every = ["--record-every", "25"];
    place.run_well(&[&["simulate", SMOKE, "--out", "alone"][..], &every].concat());
    place.run_well(&[&["run", SMOKE, "--out", "ring"][..], &every].concat());
    for run in ["alone", "ring"] {
        let drawn = slots(&place.path(&format!("{run}/mission.rrd")), "/metrics/loss_rate");
        assert_eq!(drawn, [0, 25, 50, 60].into(), "{run}");
    }
    for wrong in ["0", "-1", "x"] {
        let ended = place.run(&["simulate", SMOKE, "--record-every", wrong, "--out", "none"]);
        assert_eq!(ended.code, Some(2), "{ended:?}");
    }
}

/// What is recorded of the planned path.
const PATH: [&str; 4] = ["/world/path", "/world/path/stops", "/world/path_track", "/world/path_track/stops"];

/// The smoke test, so long and flown by a planner that looks ahead.
fn write_ahead(place: &Place, slots: u64) {
    let smoke = std::fs::read_to_string(SMOKE).unwrap().replace("slots = 60", &format!("slots = {slots}"));
    let smoke = smoke.replace("max_speed_mps", &format!("endurance_s = {slots}.0\nmax_speed_mps"));
    place.write("ahead.toml", &(smoke + "[planner]\nstrategy = \"horizon\"\nhorizon.iterations = 200\n"));
}

#[test]
fn the_planned_path_is_recorded_alike_by_a_ring_and_by_one_process() {
    let place = Place::new();
    write_ahead(&place, 60);
    place.run_well(&["simulate", "ahead.toml", "--record", "--out", "alone"]);
    place.run_well(&["run", "ahead.toml", "--out", "ring"]);
    for entity in PATH {
        let [alone, ring] = ["alone", "ring"].map(|run| rows(&place.path(&format!("{run}/mission.rrd")), entity));
        assert_eq!(alone.keys().next(), Some(&1), "{entity}");
        let drawn = alone.values().filter(|row| row.contains("PrimitiveArray<Float32>\n[\n  ")).count();
        assert!(drawn > 40, "{entity}: {drawn}");
        assert!(alone == ring, "{entity}");
    }
    place.run_well(&["run", "ahead.toml", "--strategy", "uts", "--out", "uts"]);
    assert_eq!(rows(&place.path("uts/mission.rrd"), "/world/path").len(), 0);
    assert_eq!(slots(&place.path("uts/mission.rrd"), "/world/uav_trail"), (0..=60).collect());
}

/// What is recorded of losses, coverage, and what the UAV believes.
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
fn losses_coverage_and_beliefs_are_recorded_alike_by_a_ring_and_by_one_process() {
    let place = Place::new();
    let sensors = "[sensors]\ncount = 60\nsampling_bps = [50.0, 350.0]\ninitial_queue_mean_bits = [0.0, 20000.0]\n";
    let planner = "[planner]\nstrategy = \"gfs\"\nknowledge = \"estimated\"\nrates = \"learnt\"\n";
    place.write("told.toml", &format!("name = \"told\"\nslots = 150\n[area]\nside_m = 300.0\n{sensors}{planner}"));
    place.run_well(&["simulate", "told.toml", "--record", "--out", "alone"]);
    place.run_well(&["run", "told.toml", "--out", "ring"]);
    for entity in ANSWERS {
        let [alone, ring] = ["alone", "ring"].map(|run| rows(&place.path(&format!("{run}/mission.rrd")), entity));
        assert!(alone.len() > 10, "{entity}: {}", alone.len());
        assert!(alone == ring, "{entity}");
    }
}

#[test]
fn the_planned_path_is_that_of_the_undisturbed_mission_whenever_the_planner_is_killed() {
    let place = Place::new();
    write_ahead(&place, 1_200);
    place.run_well(&["simulate", "ahead.toml", "--record", "--out", "alone"]);
    let run = place.skysink(&["run", "ahead.toml", "--out", "run"]).spawn().unwrap();
    for flown in [20, 80, 150, 220, 300] {
        until("slot", || (lines(&place.path("run/slots.csv")) > flown).then_some(()));
        let ring = place.rings().into_iter().next().expect("a ring under way");
        kill_process(place.worker("planner", &ring), Signal::KILL).unwrap();
    }
    let ended = end(run);
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert_eq!(place.summary("run")["restarts"], 5, "{ended:?}");
    assert_eq!(place.read("alone/slots.csv"), place.read("run/slots.csv"));
    for entity in PATH {
        let [alone, run] = ["alone", "run"].map(|run| rows(&place.path(&format!("{run}/mission.rrd")), entity));
        let others: Vec<_> = (0..=1_200).filter(|slot| alone.get(slot) != run.get(slot)).collect();
        assert!(others.is_empty(), "{entity} of {others:?}");
    }
    place.assert_clean();
}

/// Starts a run with a viewer, and stops the viewer in it.
fn with_a_stopped_viewer(place: &Place, slots: u64, pace: &str) -> (std::process::Child, Pid) {
    place.write("long.toml", &format!("name = \"long\"\nslots = {slots}\nslot_s = 0.01\n[link]\ncomm_s = 0.01\n"));
    let run = place.skysink(&["run", "long.toml", "--out", "run", "--pace", pace]).spawn().unwrap();
    until("slot", || (lines(&place.path("run/slots.csv")) > 20).then_some(()));
    let ring = place.rings().into_iter().next().expect("a ring under way");
    let viewer = place.worker("viewer", &ring);
    kill_process(viewer, Signal::STOP).unwrap();
    (run, viewer)
}

#[test]
fn in_lock_step_the_ring_waits_for_a_viewer_that_lags() {
    let place = Place::new();
    let (run, viewer) = with_a_stopped_viewer(&place, 20_000, "max");
    // The ring comes to rest: the same slot in two looks that are far apart.
    let mut last = 0;
    until("rest", || {
        std::thread::park_timeout(std::time::Duration::from_millis(300));
        let now = lines(&place.path("run/slots.csv"));
        (std::mem::replace(&mut last, now) == now).then_some(())
    });
    let stopped_at = last;
    kill_process(viewer, Signal::CONT).unwrap();
    let ended = end(run);
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert!(stopped_at < 20_001, "the run was over before the viewer was stopped");
    assert_eq!(slots(&place.path("run/mission.rrd"), "/metrics/loss_rate"), (0..=20_000).collect());
}

#[test]
fn a_paced_run_does_not_wait_for_the_viewer_and_marks_what_it_missed() {
    let place = Place::new();
    let (run, viewer) = with_a_stopped_viewer(&place, 3000, "4x");
    let stopped_at = lines(&place.path("run/slots.csv"));
    until("flight without the viewer", || (lines(&place.path("run/slots.csv")) > stopped_at + 300).then_some(()));
    kill_process(viewer, Signal::CONT).unwrap();
    let ended = end(run);
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert_eq!(place.summary("run")["timing"]["missed_deadlines"], place.summary("run")["held_slots"]);
    let recorded = slots(&place.path("run/mission.rrd"), "/metrics/loss_rate");
    let missed = 3001 - recorded.len();
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
    place.write("smoke.toml", include_str!("../../scenarios/smoke.toml"));
    let ended = place.run_well(&["run", "smoke.toml", "--out", "run"]);
    assert!(ended.stdout.contains("rerun run/mission.rrd"), "{ended:?}");
    let first = recording_id(&place, "run/mission.rrd");
    let begun: String = place.read("run/slots.csv").split_inclusive('\n').take(56).collect();
    std::fs::write(place.path("run/slots.csv"), begun).unwrap();
    let ended = place.run_well(&["run", "--resume", "run"]);
    assert!(ended.stdout.contains("rerun run/*.rrd"), "{ended:?}");
    assert_eq!(recording_id(&place, "run/mission-2.rrd"), first);
    assert_eq!(slots(&place.path("run/mission-2.rrd"), "/metrics/loss_rate"), (55..=60).collect());
    let log: String = rows(&place.path("run/mission-2.rrd"), "/log/events").into_values().collect();
    assert!(log.contains("recording continued in a new file") && !log.contains("missed"), "{log}");
    assert!(!log.contains("first loss"), "it is in the file before: {log}");
    place.run_well(&["run", "smoke.toml", "--out", "run", "--force"]);
    let files = support::recordings(&place.path("run"));
    assert_eq!(files, [place.path("run/mission.rrd")]);
    assert_ne!(recording_id(&place, "run/mission.rrd"), first, "another run");
}

#[test]
fn a_live_port_that_is_taken_ends_the_run_with_one_clear_line() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port();
    let place = Place::new();
    let ended = place.run(&["run", SMOKE, "--out", "run", &format!("--live={port}")]);
    assert_eq!(ended.code, Some(2), "{ended:?}");
    assert!(ended.stderr.contains(&format!("port {port}")), "{ended:?}");
    place.assert_clean();
}

#[test]
fn a_run_can_be_served_live() {
    let free = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let place = Place::new();
    let run =
        place.skysink(&["run", SMOKE, "--out", "run", "--pace", "20x", &format!("--live={free}")]).spawn().unwrap();
    until("server", || std::net::TcpStream::connect(("127.0.0.1", free)).ok());
    let ended = end(run);
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let recorded = slots(&place.path("run/mission.rrd"), "/metrics/loss_rate").len();
    assert!((50..=61).contains(&recorded), "{recorded} slots: a paced run does not wait for its viewer");
}

#[test]
fn a_live_viewer_says_its_address() {
    let place = Place::new();
    let ended = place.run_well(&["run", SMOKE, "--out", "run", "--live=0"]);
    let (_, address) = ended.stderr.split_once("viewer: live at rerun+http://127.0.0.1:").expect("an address");
    let port: u16 = address.split_once("/proxy").unwrap().0.parse().unwrap();
    assert!(port > 0 && address.contains(&format!("`rerun rerun+http://127.0.0.1:{port}/proxy`")), "{ended:?}");
}

#[test]
fn the_recording_says_how_much_was_lost_so_far() {
    let place = Place::new();
    place.run_well(&["run", SMOKE, "--out", "run"]);
    let status = rows(&place.path("run/mission.rrd"), "/status");
    let lost = place.summary("run")["lost_bits"].as_u64().unwrap();
    assert_eq!(status.len(), 61);
    assert!(status[&60].contains("slot 60: **η so far 0.0"), "{}", status[&60]);
    assert!(status[&60].contains(&format!("({lost} of ")), "{}", status[&60]);
}

#[test]
fn a_recording_that_cannot_be_created_ends_the_run_at_once() {
    let place = Place::new();
    std::fs::create_dir_all(place.path("run")).unwrap();
    let run = place.skysink(&["run", SMOKE, "--out", "run", "--force", "--external", "viewer"]).spawn().unwrap();
    let ring = until("ring", || place.rings().into_iter().find(|ring| place.ring_file(ring).exists()));
    let folder = place.ring_file(&ring).parent().unwrap().to_owned();
    until("services", || {
        std::fs::read_dir(folder.join("services")).is_ok_and(|files| files.count() >= 18).then_some(())
    });
    let arguments = ["--scenario", "run/scenario.toml", "--ring", folder.to_str().unwrap(), "--save", "nowhere/x.rrd"];
    let viewer = end(place.command(env!("CARGO_BIN_EXE_viewer"), &arguments).spawn().unwrap());
    assert_eq!(viewer.code, Some(2), "refused, so that a launcher would not start it again: {viewer:?}");
    assert!(viewer.stderr.starts_with("viewer: recording nowhere/x.rrd: "), "{viewer:?}");
    kill_process(Pid::from_raw(i32::try_from(run.id()).unwrap()).unwrap(), Signal::TERM).unwrap();
    assert_eq!(end(run).code, Some(143));
}
