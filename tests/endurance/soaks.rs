//! `skysink soak`, which kills processes itself.

use crate::support::Place;

#[test]
fn a_soak_finds_nothing() {
    let place = Place::new();
    let soak = ["soak", "--slots", "40000", "--kill-every", "0.5", "--strategy", "gfs", "--out", "run"];
    let ended = place.run(&soak).assert_success();
    assert!(ended.stdout.contains("bits unaccounted: 0"), "{ended:?}");
    for row in ["field-sim", "flight-sim", "planner", "skysink", "/dev/shm"] {
        assert!(ended.stdout.contains(row), "{row}: {ended:?}");
    }
    place.assert_clean();
}

#[test]
fn a_soak_of_kills_at_any_instant_finds_nothing() {
    let place = Place::new();
    let viewer: &[&str] = if cfg!(feature = "viewer") { &["--viewer"] } else { &[] };
    let soak = ["soak", "--anywhere", "--missions", "6", "--kills", "12", "--out", "alone"];
    let ended = place.run(&[&soak, viewer].concat()).assert_success();
    let (_, kills) = ended.stdout.split_once("6 missions with ").expect("the outcome");
    let kills: u32 = kills.split_once(" kills").unwrap().0.parse().unwrap();
    assert!(kills >= 24, "{kills} kills"); // of 72, some of which come when the mission is over
    assert!(ended.stdout.contains("equal traces, complete recordings, nothing left behind"), "{ended:?}");
    place.assert_clean();
}
