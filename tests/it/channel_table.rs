//! A channel of one's own, as a table of rates: the same in every process, after a resumption, and from the run folder.

use std::fs;

use expect_test::expect_file;

use crate::support::Place;

/// Rates that fall with the distance, at random by half, from 20 m.
fn table() -> String {
    let mut rows = String::from("distance_m,altitude_m,probability,rate_bps\n");
    for distance_m in [0, 4, 8] {
        for (probability, factor) in [(0.25, 1), (0.75, 3)] {
            rows += &format!("{distance_m},20,{probability},{}\n", factor * (60_000 - 5_000 * distance_m));
        }
    }
    rows
}

#[test]
fn ring_and_single_process_draw_the_same_rates() {
    let place = Place::new();
    let path = place.write("links.csv", &table());
    let flight = place.flight("smoke").set("link.model", "table").set("link.file", path.display()).force();
    for strategy in ["uts", "horizon"] {
        flight.strategy(strategy).set("slots", 40).without_viewer().run();
        place.assert_trace_as_simulated("run");
    }
    let delivered: u64 = place.summary("run")["delivered_bits"].as_u64().unwrap();
    assert!(delivered > 0 && delivered < 40 * 3 * 18_000, "{delivered}: at most 180 kbit/s for 0.1 s, 3 SNs a slot");
    fs::remove_file(&path).unwrap();
    place.assert_repeatable("run");
    let changed = place.read("run/channel.csv").replacen("60000", "60001", 1);
    fs::write(place.path("run/channel.csv"), changed).unwrap();
    place.run_refused(&["report", "run"], "channel.csv: it was modified after the start of the run");
    place.assert_clean();
}

#[test]
fn an_impossible_table_is_refused() {
    let place = Place::new();
    place.scenario("smoke");
    place.write("good.csv", &table());
    place.assert_transcript(&expect_file!["transcripts/channel-table.txt"]);
}
