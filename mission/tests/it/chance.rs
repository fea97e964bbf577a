//! Missions in which links or arrivals are by chance: there `horizon` follows whichever strategy loses least in
//! simulations.

use std::path::Path;

use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_mission::Mission;
use skysink_planner::settings;
use skysink_planner::strategies::{best_of, horizon};

/// Twelve drawn sensor nodes in a small field, whose sight of the UAV at a free altitude is drawn.
const SMALL_FIELD: &str = "name = 'small-field-free-altitude'
slots = 80
slot_s = 1.0
[area]
side_m = 32.0
[sensors]
capacity_bits = 300000
sampling_bps = [2382.5186, 6565.8585]
initial_queue_mean_bits = 99000.0
[uav]
altitude_m = 50.0
max_speed_mps = 20.8
endurance_s = 1e6
start_m = [16.0, 16.0]
altitude = 'free'
min_altitude_m = 20.0
max_altitude_m = 120.0
max_climb_mps = 5.0
[link]
bandwidth_hz = 10950.0
comm_radius_m = 18.4
comm_s = 0.1
resource_blocks = 6
model = 'probabilistic-los'
environment = 'high-rise'
tx_power_w = 0.1
noise_dbm = -109.0
reference_gain_db = -60.0
los_exponent = 2.5
nlos_exponent = 3.5
nlos_extra_db = -20.0
snr_gap_db = 8.2
[planner]
knowledge = 'estimated'
";

const SENSORS: &str = "x_m,y_m,queue_bits,gain_db,sampling_bps
27.5,12.3,99000,-60,3819.6957
4.5,8.7,99000,-60,5308.833
10.8,5.8,99000,-60,2382.5186
17.5,9.8,99000,-60,4194.9436
26.1,11.8,99000,-60,2671.5867
0.0,6.6,99000,-60,5104.0665
18.9,9.5,99000,-60,5312.3373
6.9,22.2,99000,-60,6513.2596
12.7,17.0,99000,-60,6304.4172
15.9,20.4,99000,-60,4943.7237
16.7,16.7,99000,-60,6565.8585
14.0,25.5,99000,-60,5962.8916
";

fn scenario_of(text: &str, strategy: &'static str, seed: u64) -> Scenario {
    let overrides = Overrides { strategy: Some(strategy), seed: Some(seed), ..Overrides::default() };
    Scenario::parse(text, Path::new("test.toml"), overrides).and_then(settings::resolve).unwrap()
}

/// The bits that are lost with the seeds 1 to 4, of which as many are sampled by each strategy.
fn lost_bits(strategy: &'static str, planner: &str) -> f64 {
    let text = format!("{SMALL_FIELD}{planner}");
    let of_seed = |seed: u64| {
        let scenario = scenario_of(&text, strategy, seed);
        let list = SensorList::parse(SENSORS, Path::new("sensors.csv"), &scenario).unwrap();
        let last = Mission::new(&scenario, &list).unwrap().last().unwrap();
        last.header.totals.lost_bits as f64
    };
    (1..=4).map(of_seed).sum()
}

#[test]
fn where_sight_is_drawn_horizon_follows_what_loses_least_in_simulations() {
    let alone = lost_bits("horizon", "horizon = { iterations = 300, without = 'choice' }");
    let chosen = lost_bits("horizon", "horizon.iterations = 300");
    let best = lost_bits("best-of", "best-of.iterations = 300");
    assert!(chosen < 0.95 * alone, "{chosen} and {alone}");
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
    let text = format!("{SMALL_FIELD}best-of.window = 0");
    let overrides = Overrides { strategy: Some(best_of::STRATEGY.name), ..Overrides::default() };
    let refused = Scenario::parse(&text, Path::new("test.toml"), overrides).and_then(settings::resolve).unwrap_err();
    assert!(refused.to_string().ends_with("planner.best-of.window = 0: expected 1 to 1000000"), "{refused}");
    assert_ne!(best_of::STRATEGY, horizon::STRATEGY);
}
