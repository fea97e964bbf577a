//! Arrivals at random, in bursts and of a file: the same in every process, after a resumption, and from the run folder.

use std::fs;

use expect_test::expect_file;

use crate::support::flight::FlightBuilder;
use crate::support::{Place, assert_balanced, csv_rows};

/// The flight with arrivals of a file: 900 bit of one SN in three, in each slot.
fn traced<'a>(place: &Place, flight: &FlightBuilder<'a>) -> FlightBuilder<'a> {
    let mut rows = String::from("slot,sensor,bits\n");
    for slot in 1..=60 {
        (0..40).filter(|sensor| sensor % 3 == slot % 3).for_each(|sensor| rows += &format!("{slot},{sensor},900\n"));
    }
    let path = place.write("bursts.csv", &rows);
    flight.set("sensors.arrivals.model", "trace").set("sensors.arrivals.file", path.display())
}

/// The flight under each model.
fn modelled<'a>(place: &Place, flight: &FlightBuilder<'a>) -> Vec<FlightBuilder<'a>> {
    let poisson = flight.set("sensors.arrivals.model", "poisson");
    let packets = poisson.set("sensors.arrivals.packet_bits", 700);
    let bursts = flight.set("sensors.arrivals.model", "on-off").set("sensors.arrivals.on_s", 3);
    vec![poisson, packets, bursts, traced(place, flight)]
}

#[test]
fn ring_and_single_process_have_the_same_arrivals() {
    let place = Place::new();
    let flight = place.flight("smoke").set("sensors.sampling_bps", "[100.0, 500.0]").force();
    flight.out("constant").simulate();
    let learnt = flight.set("planner.knowledge", "estimated").set("planner.rates", "learnt");
    let learnt = learnt.set("planner.horizon.iterations", 200).set("slots", 40);
    let models = [modelled(&place, &flight), modelled(&place, &learnt.strategy("horizon"))].concat();
    for (index, model) in models.iter().enumerate() {
        let model = if index == 1 { model.clone() } else { model.without_viewer() };
        model.run();
        place.assert_trace_as_simulated("run");
        assert_balanced(&place.summary("run"));
        assert_ne!(place.trace("run"), place.trace("constant"), "model {index}");
    }
    place.assert_clean();
}

#[test]
fn the_loss_rate_refers_to_the_sampled_bits() {
    let place = Place::new();
    let flight = place.flight("smoke").force();
    for (model, sampled_bits) in modelled(&place, &flight).iter().zip([None, None, None, Some(60 * 40 / 3 * 900)]) {
        model.simulate();
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
fn a_run_folder_can_be_repeated_without_its_arrivals_file() {
    let place = Place::new();
    let flight = traced(&place, &place.flight("smoke").force());
    flight.out("flown").simulate();
    fs::remove_file(place.path("bursts.csv")).unwrap();
    place.run_ok(&["simulate", "flown/scenario.toml", "--out", "again"]);
    place.assert_same_trace("flown", "again");
    place.cut_trace("again", 20);
    place.resume("again");
    place.assert_same_trace("flown", "again");
    place.run_ok(&["replay", "flown", "--out", "replayed"]);
    place.run_ok(&["report", "flown"]);
    let rows = place.read("flown/arrivals.csv").replacen("900", "901", 1);
    fs::write(place.path("flown/arrivals.csv"), rows).unwrap();
    place.run_refused(&["report", "flown"], "arrivals.csv: it was modified after the start of the run");
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
