//! `skysink library`: instances are copied, flown by any planner, and verified. `library/tests` checks the library
//! itself.

use expect_test::expect_file;

use crate::support::Place;

#[test]
fn an_instance_is_flown_by_any_planner_and_verified() {
    let place = Place::new();
    place.run_ok(&["library", "copy", "sks-small-5a"]);
    place.flight("sks-small-5a").strategy("gfs").out("ring").without_viewer().run();
    let flown = place.run_ok(&["library", "fly", "sks-small-5a", "gfs", "--out", "flown"]).stdout;
    place.assert_same_trace("ring", "flown");
    let verified = place.run_ok(&["library", "verify", "ring"]).stdout;
    assert!(flown.starts_with(&verified) && flown.contains("Run folder:      flown"), "{flown} {verified}");
    let json = place.run_ok(&["library", "verify", "ring", "--json"]).stdout;
    let verdict: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(verdict["value"], place.summary("ring")["loss_rate"]);
    assert_eq!((verdict["best"].as_f64(), verdict["bound"].as_f64()), (Some(0.102616), Some(0.102616)));
    place.assert_clean();
}

#[test]
fn what_is_no_flight_of_an_instance_is_refused() {
    let place = Place::new();
    place.write("other.toml", "name = 'sks-small-5a'\nslots = 30\n[area]\nside_m = 60.0\n[sensors]\ncount = 5\n");
    place.flight("other").out("other").simulate();
    place.write("mine.csv", "# instance: sks-small-5a\nslot,x_m,y_m,scheduled\n1,25,35,\n2,59,35,\n");
    place.write("double.csv", "# instance: sks-small-5a\nslot,x_m,y_m,schedule\n1,25,35,\n");
    place.write("none.csv", "slot,x_m,y_m,scheduled\n1,25,35,\n");
    place.assert_transcript(&expect_file!["transcripts/library.txt"]);
}
