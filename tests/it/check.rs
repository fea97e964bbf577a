//! `skysink check`: what it prints, and flights that agree with it.

use expect_test::expect_file;

use crate::support::Place;

#[test]
fn check_prints_keys_figures_and_warnings() {
    Place::new().assert_transcript(&expect_file!["transcripts/check.txt"]);
}

/// `sh lake CORNERS KEYS` writes a scenario with a no-fly zone of so many corners, wrinkled by a metre, and these keys
/// in `[area]`.
const LAKE: &str = r#"
    awk -v count="$1" -v keys="$2" 'BEGIN {
        printf "name = \"lake\"\nslots = 5\nuav.start_m = [10, 10]\nsensors.count = 9\n[area]\nside_m = 1000\n%s\nno_fly = [{ polygon_m = [", keys
        for (index_ = 0; index_ < count; index_++) {
            angle = index_ / count * 6.283185307179586
            away_m = 200 + 60 * sin(5 * angle) + sin(397 * angle)
            printf "[%.3f, %.3f], ", 500 + away_m * cos(angle), 500 + away_m * sin(angle)
        }
        print "] }]"
    }'"#;

/// What is generated here is simplified, and said, or has too many corners.
#[test]
fn check_says_how_zones_of_many_corners_are_simplified() {
    let place = Place::new();
    place.write("lake", LAKE);
    place.assert_transcript(&expect_file!["transcripts/corners.txt"]);
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
