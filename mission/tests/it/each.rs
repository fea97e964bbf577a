//! Fleets whose UAVs differ: equal tables are `count`, and random fleets keep to the limits of each.

use crate::random_fleets;
use crate::support::scenario_of;
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::SlotRecord;
use skysink_mission::Mission;
use skysink_planner::strategies::names;

/// The mission of a fleet with these keys.
fn text(seed: u64, uav: &str) -> String {
    format!(
        "name = 'fleet'\nseed = {seed}\nslots = 50\n[area]\nside_m = 250.0\n[sensors]\ncount = 60\n\
         sampling_bps = [100.0, 900.0]\n[planner]\nhorizon.iterations = 40\noffline.steps = 2000\nbest-of = {{ iterations = 100, window = 10 }}\n[base]\nradius_m = 9.0\n\
         charge_w = 200.0\n[uav]\nmax_speed_mps = 20.0\nseparation_m = 3.0\n{uav}"
    )
}

fn records(text: &str, strategy: &'static str) -> Vec<SlotRecord> {
    let scenario = scenario_of(text, strategy);
    let list = SensorList::of(&scenario).unwrap();
    Mission::new(&scenario, &list).unwrap().collect()
}

#[test]
fn tables_that_repeat_that_of_all_give_the_flights_of_as_many_equal_uavs() {
    let battery = "battery.capacity_j = 8000.0\n";
    for (seed, strategy) in (1..).zip(names()) {
        let coordination = ["partition", "sequential", "independent"][seed as usize % 3];
        let all = format!("coordination = '{coordination}'\n{battery}");
        let counted = records(&text(seed, &format!("{all}count = 3\n")), strategy);
        for each in [
            "[[uav.each]]\n[[uav.each]]\n[[uav.each]]\n",
            "[[uav.each]]\nmax_speed_mps = 20.0\nbattery.capacity_j = 8e3\ncount = 2\n[[uav.each]]\nresource_blocks = 4\n",
        ] {
            let listed = records(&text(seed, &format!("{all}{each}")), strategy);
            assert_eq!(listed.len(), counted.len());
            for (one, other) in listed.iter().zip(&counted) {
                let at = format!("{strategy}, {coordination}, slot {}", one.slot());
                assert!(one.flights() == other.flights() && one.header == other.header, "{at}");
            }
        }
    }
}

#[test]
fn random_fleets_keep_to_the_limits_of_each_uav() {
    random_fleets::check_all(0..30);
}
