//! Arrivals at random, in bursts and of a file: counted in the results, and in a sweep.

use std::fs;

use expect_test::expect_file;

use crate::support::{Place, csv_rows};

/// The settings of each model; that of a file reads [`bursts`] from `bursts.csv`.
pub const MODELS: [&str; 4] = [
    "sensors.arrivals.model=poisson",
    "sensors.arrivals.model=poisson sensors.arrivals.packet_bits=700",
    "sensors.arrivals.model=on-off sensors.arrivals.on_s=3",
    "sensors.arrivals.model=trace sensors.arrivals.file=bursts.csv",
];

/// Arrivals of a file: 900 bit of one SN in three, in each slot.
pub fn bursts() -> String {
    let mut rows = String::from("slot,sensor,bits\n");
    for slot in 1..=60 {
        (0..40).filter(|sensor| sensor % 3 == slot % 3).for_each(|sensor| rows += &format!("{slot},{sensor},900\n"));
    }
    rows
}

#[test]
fn the_loss_rate_refers_to_the_sampled_bits() {
    let place = Place::new();
    place.write("bursts.csv", &bursts());
    for (model, sampled_bits) in MODELS.iter().zip([None, None, None, Some(60 * 40 / 3 * 900)]) {
        place.flight("smoke").settings(model).force().simulate();
        let summary = place.summary("run");
        let [lost, sampled] = ["lost_bits", "sampled_bits"].map(|key| summary[key].as_f64().unwrap());
        assert!((summary["loss_rate"].as_f64().unwrap() - lost / sampled).abs() < 1e-12);
        assert!(sampled_bits.is_none_or(|bits| (bits as f64 - sampled).abs() <= 900.0 * 14.0), "{sampled}");
        place.run_ok(&["report", "run", "--sensors"]);
        let rows = csv_rows(&place.read("run/sensors_out.csv"));
        let sum = |key: &str| rows.iter().map(|row| row[key].parse::<f64>().unwrap()).sum::<f64>();
        assert_eq!((sum("sampled_bits"), sum("lost_bits")), (sampled, lost));
    }
}

#[test]
fn a_sweep_folder_contains_its_arrivals_file() {
    let place = Place::new();
    let scenario = place.scenario("smoke");
    let scenario = place.read(&scenario);
    place.write("bursts.csv", "slot,sensor,bits\n1,0,30000\n2,0,9000\n");
    place.write("base.toml", &(scenario + "\n[sensors.arrivals]\nmodel = 'trace'\nfile = 'bursts.csv'\n"));
    place.write(
        "sweep.toml",
        "scenario = 'base.toml'\nstrategies = ['uts']\nseeds = [1, 2]\n[axes]\nslots = [20, 30]\n",
    );
    place.run_ok(&["sweep", "sweep.toml", "--out", "flown"]);
    let results = place.read("flown/results.csv");
    fs::remove_file(place.path("bursts.csv")).unwrap();
    place.run_ok(&["sweep", "flown", "--out", "again"]);
    assert_eq!(place.read("again/results.csv"), results);
    // 30 000 and 9 000 bit into 30 000: what SN 0 loses depends on its first queue.
    assert!(csv_rows(&results).iter().all(|row| row["loss_rate"].parse::<f64>().unwrap() > 0.1), "{results}");
}

#[test]
fn impossible_arrivals_are_refused() {
    let place = Place::new();
    place.scenario("smoke");
    place.assert_transcript(&expect_file!["transcripts/arrivals.txt"]);
}
