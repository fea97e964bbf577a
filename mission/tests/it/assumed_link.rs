//! Plans by a wrong law of the link: what is flown, and its bound, are those of the true one.

use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::SlotRecord;
use skysink_mission::Mission;
use skysink_planner::bound::mission_bound;

use crate::support::scenario_of;

fn scenario(strategy: &'static str, keys: &str) -> Scenario {
    let text = format!("name = 'x'\nseed = 3\nslots = 60\nlink.bandwidth_hz = 5e3\narea.side_m = 200.0\n{keys}");
    scenario_of(&text, strategy)
}

/// The services of each slot: sensor node, rate and what the link can carry.
fn services(scenario: &Scenario) -> Vec<Vec<(u32, f64, u64)>> {
    let mission = Mission::new(scenario, &SensorList::of(scenario).unwrap()).unwrap();
    let of_slot = |record: SlotRecord| {
        let links = record.flights().iter().flat_map(|flight| flight.served_links());
        links.map(|link| (link.sensor, link.rate_bps, link.capacity_bits)).collect()
    };
    mission.map(of_slot).collect()
}

#[test]
fn a_wrong_law_of_the_link_changes_plans_but_no_rate() {
    const WRONG: &str = "planner.link.snr_offset_db = -25.0\n";
    let [known, wrong] = ["", WRONG].map(|keys| services(&scenario("gfs", keys)));
    assert_eq!(known, wrong, "it compares no rates");
    let [known, wrong] = ["", WRONG].map(|keys| services(&scenario("uts", keys)));
    assert_ne!(known, wrong);
    let bound = |keys: &str| {
        let scenario = scenario("uts", keys);
        let list = SensorList::of(&scenario).unwrap();
        mission_bound(&scenario, &list.sensors_of(&scenario), &list.queues_bits(), u64::MAX).loss_bits
    };
    assert_eq!(bound(""), bound(WRONG));
}
