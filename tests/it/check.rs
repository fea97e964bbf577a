//! `skysink check`: what it prints, and flights that agree with it.

use expect_test::expect_file;

use crate::support::Place;

#[test]
fn check_prints_keys_figures_and_warnings() {
    Place::new().assert_transcript(&expect_file!["transcripts/check.txt"]);
}

#[test]
fn flights_agree_with_the_figures_and_warnings_of_check() {
    let place = Place::new();
    let flown = |strategy: &str, key: &str, value: &str| {
        place.flight("short").strategy(strategy).set(key, value).force().simulate();
        place.summary("run")
    };
    assert_eq!(flown("tour", "slots", "600")["loss_rate"], 0.0, "tour loses nothing");
    assert_eq!(flown("rfs", "slots", "150")["loss_rate"], 0.0, "no buffer overflows");
    for strategy in ["tour", "exact", "uts-wide", "edf"] {
        let loss_rate = flown(strategy, "sensors.sampling_bps", "700")["loss_rate"].as_f64().unwrap();
        assert!(loss_rate > 0.1, "{strategy}: {loss_rate} at 117 % of the maximum load");
    }
    assert_eq!(flown("uts", "link.bandwidth_hz", "1e-3")["delivered_bits"], 0);
    for (speed_mps, is_mostly) in [("8", true), ("10", true), ("20", false)] {
        let transit = flown("uts", "uav.max_speed_mps", speed_mps)["transit_slots"].as_u64().unwrap();
        assert_eq!(transit > 300, is_mostly, "{transit} of 600 slots in transit at {speed_mps} m/s");
    }
}
