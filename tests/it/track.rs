//! A flight that is fixed by a track (`uav.track`).

use expect_test::expect_file;

use crate::support::Place;

/// A round of 40 slots about the middle of the area of `smoke.toml`.
pub fn track() -> String {
    let mut rows = String::from("t_s,x_m,y_m\n");
    for (time_s, x_m, y_m) in [(0, 30, 30), (10, 50, 30), (25, 50, 55), (40, 10, 55)] {
        rows += &format!("{time_s},{x_m},{y_m}\n");
    }
    rows
}

#[test]
fn a_track_that_cannot_be_flown_is_refused() {
    let place = Place::new();
    place.scenario("smoke");
    place.write("track.csv", &track());
    place.assert_transcript(&expect_file!["transcripts/track.txt"]);
}
