//! The largest fields.

use crate::support::Place;

#[test]
fn check_accepts_a_million_sensor_nodes() {
    let place = Place::new();
    place.write("a.toml", "name = \"a\"\n[area]\nside_m = 10000.0\n[sensors]\ncount = 1000000\n");
    let ended = place.run_ok(&["check", "a.toml"]);
    assert!(ended.stdout.contains("at least 250000 (N / n)\n"), "{}", ended.stderr);
}
