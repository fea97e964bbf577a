//! A flight that is fixed by a track (`uav.track`): the same in every process, after a resumption, and in a replay.

use std::fs;

use expect_test::expect_file;

use crate::support::Place;

/// A round of 40 slots about the middle of the area of `smoke.toml`.
fn track() -> String {
    let mut rows = String::from("t_s,x_m,y_m\n");
    for (time_s, x_m, y_m) in [(0, 30, 30), (10, 50, 30), (25, 50, 55), (40, 10, 55)] {
        rows += &format!("{time_s},{x_m},{y_m}\n");
    }
    rows
}

#[test]
fn ring_and_single_process_fly_the_track() {
    let place = Place::new();
    let path = place.write("track.csv", &track());
    let flight = place.flight("smoke").set("uav.track", path.display()).set("slots", 40).force();
    for strategy in ["gfs", "horizon"] {
        flight.strategy(strategy).without_viewer().run();
        place.assert_trace_as_simulated("run");
    }
    assert!(place.summary("run")["refused"].as_u64() == Some(0) && place.summary("run")["delivered_bits"] != 0);
    fs::remove_file(&path).unwrap();
    place.assert_repeatable("run");
    place.assert_clean();
}

#[test]
fn a_track_that_cannot_be_flown_is_refused() {
    let place = Place::new();
    place.scenario("smoke");
    place.write("track.csv", &track());
    place.assert_transcript(&expect_file!["transcripts/track.txt"]);
}
