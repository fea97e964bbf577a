//! What UAVs hear of links: the SNRs of the links that they are served by, scheduled or not.

use std::path::Path;

use skysink_common::checkpoint::Checkpoint;
use skysink_common::geometry::{Position, within};
use skysink_common::message::{Mode, Plan};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::Plans;
use skysink_mission::{Mission, Plant};

use crate::support::scenario_of;

/// Three UAVs over a map.
fn scenario(keys: &str) -> Scenario {
    let folder = env!("CARGO_MANIFEST_DIR");
    let text = format!(
        "name = 'x'\nseed = 3\nslots = 40\narea.side_m = 200.0\nsensors.count = 30\nuav.count = 3\n\
         link.model = 'map'\nlink.file = '{folder}/tests/it/links.csv'\nlink.rates = '{folder}/tests/it/rates.csv'\n\
         link.beacon_radius_m = 60.0\n{keys}"
    );
    scenario_of(&text, "gfs")
}

/// The rate of the highest step of the map's rates that an SNR reaches [bit/s].
fn rate_bps(snr_db: f32) -> f64 {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/it/rates.csv");
    let text = std::fs::read_to_string(path).unwrap();
    let steps = text.lines().skip(1).map(|row| row.split_once(',').unwrap());
    let reached = steps.filter(|(step_db, _)| step_db.parse::<f32>().unwrap() <= snr_db);
    reached.last().map_or(0.0, |(_, rate_bps)| rate_bps.parse().unwrap())
}

#[test]
fn the_snr_of_each_sn_in_the_beacon_radius_is_heard_and_carries_the_rate_of_its_link() {
    for keys in [
        "link.residual_db = 3.0\n",
        "link.residual_db = 3.0\nlink.residual_m = 40.0\n",
        "link.residual_db = 3.0\nlink.service = 'observed'\n",
    ] {
        let scenario = scenario(keys);
        let is_observed = keys.contains("observed");
        let list = SensorList::of(&scenario).unwrap();
        let plans: Vec<Plans> = Mission::new(&scenario, &list).unwrap().map(|record| record.plans().clone()).collect();
        let mut plant = Plant::new(&scenario, &list);
        let mut served = 0;
        for plans in plans {
            let before = plant.heard_links();
            plant.step(&plans);
            let heard = plant.heard_links();
            let links = if is_observed { &before } else { &heard };
            for (uav, flight) in (0..).zip(plant.flights()) {
                let at = flight.position().xy();
                let in_radius = list
                    .nodes()
                    .into_iter()
                    .zip(0..)
                    .filter(|(node, _)| within(&at, &Position::new(node.x_m, node.y_m), 60.0));
                let ids: Vec<u32> = in_radius.map(|(_, id)| id).collect();
                let own = heard.iter().filter(|link| link.uav == uav);
                assert_eq!(own.map(|link| link.sensor).collect::<Vec<_>>(), ids, "{keys}");
                for link in flight.served_links() {
                    // From far away a link that counts from there was not heard.
                    let known = links.iter().find(|heard| heard.uav == uav && heard.sensor == link.sensor);
                    let Some(known) = known else { continue };
                    assert_eq!(rate_bps(known.snr_db), link.rate_bps, "{keys}: {known:?}");
                    served += 1;
                }
            }
        }
        assert!(served > 50, "{served}");
    }
}

#[test]
fn what_is_heard_follows_from_the_checkpoint_and_nothing_is_by_a_uav_that_is_down() {
    let scenario = scenario("uav.battery.capacity_j = 1500.0\n");
    let list = SensorList::of(&scenario).unwrap();
    let mut plant = Plant::new(&scenario, &list);
    let hold = Plan::fly_to([100.0, 100.0, 20.0], Mode::Fly);
    let mut was_heard = false;
    while !plant.is_over() {
        plant.step(&[Some(hold); 3]);
        was_heard |= !plant.heard_links().is_empty();
        let mut bytes = Vec::new();
        let mut again = Plant::new(&scenario, &list);
        plant.save(&mut bytes);
        again.restore(&bytes).unwrap();
        assert_eq!(again.heard_links(), plant.heard_links());
    }
    assert!(was_heard && plant.flights().iter().all(|flight| flight.flown_mode() == Mode::Down));
    assert_eq!(plant.heard_links(), []);
}
