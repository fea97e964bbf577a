//! `skysink fleet`: the least fleet by strategy and by the bound.

use expect_test::expect_file;

use crate::support::Place;

const WIDE: &str = "name = 'wide'\nslots = 200\n[area]\nside_m = 500.0\n[sensors]\ncount = 60\nsampling_bps = 300.0\n\
                    [planner]\nhorizon.iterations = 30\n";

fn rows(text: &str) -> Vec<Vec<&str>> {
    text.lines().map(|line| line.split(',').collect()).collect()
}

#[test]
fn the_least_fleet_is_the_smallest_without_loss() {
    let place = Place::new();
    place.write("wide.toml", WIDE);
    let fleet = ["fleet", "wide.toml", "--strategies", "tour,mes", "--seeds", "2", "--most", "5"];
    let more = ["--over", "area.side_m=200,500", "--out", "fleets"];
    let printed = place.run_ok(&[&fleet[..], &more].concat()).stdout;
    assert!(printed.contains("at least, by the bound") && printed.contains("fleets/fleet.svg"), "{printed}");
    let table = place.read("fleets/fleet.csv");
    let rows = rows(&table);
    assert_eq!((rows[0].join(","), rows.len()), ("area.side_m,strategy,seed,uavs".to_owned(), 1 + 2 * 3 * 2));
    let mut verified = 0;
    for (at, row) in rows.iter().enumerate().skip(1) {
        let [side_m, strategy, seed, uavs] = row[..] else { panic!("{row:?}") };
        let uavs = uavs.parse::<u32>().unwrap_or(6);
        let bound = rows.iter().find(|other| other[..3] == [side_m, "bound", seed]).unwrap()[3];
        assert!(bound.parse::<u32>().unwrap() <= uavs, "row {at}: {row:?}");
        if strategy == "bound" || uavs > 5 {
            continue;
        }
        for fewer in [uavs, uavs - 1] {
            let count = fewer.to_string();
            if fewer > 0 {
                let flight = place.flight("wide").strategy(strategy).set("uav.count", count).set("area.side_m", side_m);
                flight.set("seed", seed).out("flown").force().simulate();
                let lost_bits = place.summary("flown")["lost_bits"].as_u64().unwrap();
                verified += 1;
                assert_eq!(lost_bits == 0, fewer == uavs, "{row:?} with {fewer}: {lost_bits}");
            }
        }
    }
    assert!(verified >= 8, "{verified}");
    let again = place.run_ok(&[&fleet[..], &["--json"]].concat()).stdout;
    let json: serde_json::Value = serde_json::from_str(&again).unwrap();
    let uavs = |strategy: usize| json[strategy]["uavs"]["1"].as_u64();
    assert_eq!((json[0]["strategy"].as_str(), uavs(0)), (Some("bound"), Some(2)));
    assert_eq!(uavs(1).unwrap().to_string(), rows.iter().find(|row| row[..3] == ["500", "tour", "1"]).unwrap()[3]);
    // Any loss is allowed.
    let one = place.run_ok(&[&fleet[..], &["--loss", "1", "--json"]].concat()).stdout;
    assert!(!one.contains("\"1\": 2") && one.contains("\"1\": 1"), "{one}");
}

/// A slow and a fast kind.
const KINDS: &str = "[[uav.each]]\nmax_speed_mps = 10.0\n[[uav.each]]\nmax_speed_mps = 30.0\nresource_blocks = 6\n";

#[test]
fn the_cheapest_fleet_of_several_kinds_is_found_by_their_prices() {
    let place = Place::new();
    place.write("wide.toml", &format!("{WIDE}{KINDS}"));
    let fleet = ["fleet", "wide.toml", "--strategies", "tour", "--seeds", "2", "--most", "4", "--json"];
    let found = |prices: &str| -> serde_json::Value {
        serde_json::from_str(&place.run_ok(&[&fleet[..], &["--prices", prices]].concat()).stdout).unwrap()
    };
    let [dear, cheap] = ["1,100", "100,1"].map(found);
    let price = |fleets: &serde_json::Value, row: usize, seed: &str| {
        let fleet = &fleets[row]["cheapest"][seed];
        (fleet["price"].as_f64().unwrap_or(f64::INFINITY), fleet["uavs"].to_string())
    };
    for seed in ["1", "2"] {
        let [bound, flown] = [0, 1].map(|row| price(&dear, row, seed));
        assert!(bound.0 <= flown.0, "{bound:?} {flown:?}");
        let (price, uavs) = price(&cheap, 1, seed);
        assert!(price < 100.0 && uavs.starts_with("[0,"), "{price} {uavs}: fast ones alone");
    }
    // As many of the fast kind as are needed of equal ones.
    let text = format!("{WIDE}[uav]\nmax_speed_mps = 30.0\n[link]\nresource_blocks = 6\n");
    place.write("equal.toml", &text);
    let equal = place.run_ok(&["fleet", "equal.toml", "--strategies", "tour", "--seeds", "2", "--most", "4", "--json"]);
    let equal: serde_json::Value = serde_json::from_str(&equal.stdout).unwrap();
    assert_eq!(equal[1]["uavs"], cheap[1]["uavs"]);
    let printed = place.run_ok(&["fleet", "wide.toml", "--strategies", "tour", "--seeds", "2", "--prices", "100,1"]);
    assert!(printed.stdout.contains("UAVs of each kind"), "{}", printed.stdout);
    place.run_refused(&["fleet", "wide.toml"], "uav.each: expected --prices with 2 prices, one for each table");
    place.run_refused(&["fleet", "wide.toml", "--prices", "1"], "uav.each: expected --prices with 2 prices");
    place.run_refused(&["fleet", "equal.toml", "--prices", "1"], "--prices: expected tables [[uav.each]]");
}

#[test]
fn invalid_fleet_questions_are_refused() {
    let place = Place::new();
    place.write("wide.toml", WIDE);
    place.assert_transcript(&expect_file!["transcripts/fleet.txt"]);
}
