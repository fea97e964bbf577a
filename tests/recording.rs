//! What `skysink run` leaves to look at.
#![cfg(feature = "viewer")]

mod support;

use rustix::process::{Pid, Signal, kill_process};
use support::{Place, end, lines, slots, until};

const SMOKE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/smoke.toml");

#[test]
fn a_lock_step_recording_holds_every_slot() {
    let place = Place::new();
    place.run_well(&["run", SMOKE, "--out", "run"]);
    for entity in ["/world/uav", "/metrics/loss_rate", "/world/links"] {
        assert_eq!(slots(&place.path("run/mission.rrd"), entity), (0..=60).collect(), "{entity}");
    }
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

#[test]
fn a_live_port_that_is_taken_ends_the_run_with_one_clear_line() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port();
    let place = Place::new();
    let ended = place.run(&["run", SMOKE, "--out", "run", &format!("--live={port}")]);
    assert_eq!(ended.code, Some(1), "{ended:?}");
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
    assert_eq!(slots(&place.path("run/mission.rrd"), "/metrics/loss_rate").len(), 61);
}
