//! Missions in which links or arrivals are by chance: there `horizon` follows whichever strategy loses least in
//! simulations.

use std::path::Path;

use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_mission::Mission;
use skysink_planner::settings;
use skysink_planner::strategies::{best_of, horizon};

/// Twelve sensor nodes among high-rises, most of them in a corner, whose buffers fill in 45 slots.
const FILLING_UP: &str = "name = 'filling-up'
slots = 60
area.side_m = 316.0
[sensors]
capacity_bits = 1000000
sampling_bps = 22471.9101
[uav]
max_speed_mps = 61.0
start_m = [0.0, 0.0]
altitude = 'free'
min_altitude_m = 20.0
max_altitude_m = 120.0
max_climb_mps = 5.0
[link]
bandwidth_hz = 158850.0
comm_radius_m = 20.3
comm_s = 0.1
resource_blocks = 2
model = 'probabilistic-los'
environment = 'high-rise'
tx_power_w = 0.1
noise_dbm = -109.0
reference_gain_db = -60.0
los_exponent = 2.5
nlos_exponent = 3.5
nlos_extra_db = -20.0
snr_gap_db = 8.2
";

const SENSORS: &str = "x_m,y_m,queue_bits,gain_db
296.9,316.0,470420,-60
30.1,0.0,578600,-60
13.5,11.1,916118,-60
12.1,47.2,492911,-60
14.6,64.0,186513,-60
273.6,253.8,185178,-60
57.8,32.4,1000000,-60
50.8,1.9,1000000,-60
73.2,3.3,1000000,-60
50.4,29.3,636405,-60
316.0,288.7,852069,-60
16.4,13.3,1000000,-60
";

fn scenario_of(text: &str, strategy: &'static str, seed: u64) -> Scenario {
    let overrides = Overrides { strategy: Some(strategy), seed: Some(seed), ..Overrides::default() };
    Scenario::parse(text, Path::new("test.toml"), overrides).and_then(settings::resolve).unwrap()
}

/// The bits that are lost with the seeds 1 to 4, of which as many are sampled by each strategy.
fn lost_bits(strategy: &'static str, planner: &str) -> f64 {
    let text = format!("{FILLING_UP}[planner]\n{planner}");
    let of_seed = |seed: u64| {
        let scenario = scenario_of(&text, strategy, seed);
        let list = SensorList::parse(SENSORS, Path::new("sensors.csv"), &scenario).unwrap();
        let last = Mission::new(&scenario, &list).unwrap().last().unwrap();
        last.header.totals.lost_bits as f64
    };
    (1..=4).map(of_seed).sum()
}

#[test]
fn where_sight_is_drawn_horizon_loses_no_more_than_a_strategy_of_one_slot() {
    let greedy = lost_bits("gfs", "");
    let chosen = lost_bits("horizon", "horizon.iterations = 300");
    let alone = lost_bits("horizon", "horizon = { iterations = 300, without = 'choice' }");
    let best = lost_bits("best-of", "best-of.iterations = 300");
    assert!(chosen < 1.03 * greedy, "{chosen} and {greedy}");
    assert!(alone > 1.1 * greedy, "{alone} and {greedy}: nothing to choose");
    assert_eq!(best, chosen, "the same comparison");
}

#[test]
fn where_all_is_known_horizon_compares_nothing() {
    let text = |planner: &str| format!("name = 'x'\nslots = 40\n[sensors]\ncount = 30\n[planner]\n{planner}");
    let flown = |strategy: &'static str, planner: &str| {
        let scenario = scenario_of(&text(planner), strategy, 1);
        let list = SensorList::of(&scenario).unwrap();
        let ends = |record: skysink_common::slot_record::SlotRecord| record.flights()[0].position();
        Mission::new(&scenario, &list).unwrap().map(ends).collect::<Vec<_>>()
    };
    let alone = flown("horizon", "horizon = { iterations = 300, without = 'choice' }");
    assert_eq!(flown("horizon", "horizon.iterations = 300"), alone);
}

#[test]
fn keys_of_a_comparison_are_checked() {
    let text = format!("{FILLING_UP}[planner]\nbest-of.window = 0");
    let overrides = Overrides { strategy: Some(best_of::STRATEGY.name), ..Overrides::default() };
    let refused = Scenario::parse(&text, Path::new("test.toml"), overrides).and_then(settings::resolve).unwrap_err();
    assert!(refused.to_string().ends_with("planner.best-of.window = 0: expected 1 to 1000000"), "{refused}");
    assert_ne!(best_of::STRATEGY, horizon::STRATEGY);
}
