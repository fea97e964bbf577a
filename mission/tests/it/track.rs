//! Missions whose flight is fixed (`uav.track`): strategies choose only whom to serve.

use crate::support::scenario_of;
use skysink_common::message::Mode;
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::UAV;
use skysink_mission::Mission;
use skysink_planner::strategies::names;

/// Four SNs, of which one is served in a slot, along a flight to the east.
fn text(keys: &str) -> String {
    let waypoints: Vec<String> = (1..=40).map(|slot| format!("[{}, 50, 20]", 2 * slot)).collect();
    format!(
        "name = 'x'\nslots = 40\n[area]\nside_m = 100.0\n[sensors]\ncount = 4\nsampling_bps = 2000.0\n\
         initial_queue_mean_bits = 900.0\n[uav]\nstart_m = [0, 50]\nmax_speed_mps = 2.0\nwaypoints_m = [{}]\n\
         [link]\ncomm_radius_m = 60.0\nbandwidth_hz = 3e3\nresource_blocks = 1\n[planner]\nhorizon.iterations = 100\n\
         offline.steps = 2000\n{keys}",
        waypoints.join(", ")
    )
}

#[test]
fn every_strategy_flies_the_track_and_serves_from_it() {
    for keys in ["", "objective = 'collect'\n", "objective = 'age'\n", "knowledge = 'estimated'\nrates = 'learnt'\n"] {
        let mut delivered_bits = std::collections::BTreeSet::new();
        for strategy in names() {
            let scenario = scenario_of(&text(keys), strategy);
            let list = SensorList::of(&scenario).unwrap();
            let mut mission = Mission::new(&scenario, &list).unwrap();
            for (slot, record) in (1..).zip(&mut mission) {
                let flight = &record.flights()[UAV];
                assert_eq!((flight.x_m, flight.y_m, flight.z_m), (f64::from(2 * slot), 50.0, 20.0), "{strategy}{keys}");
                let at = flight.position().xy();
                let is_near = list.sensors().iter().any(|sensor| (sensor.position - at).norm() <= 60.0);
                let served = (flight.refused, flight.served);
                assert_eq!(served, (0, u32::from(is_near)), "{strategy}{keys}, slot {slot}");
                assert_ne!(flight.flown_mode(), Mode::Hold, "{strategy}{keys}, slot {slot}");
            }
            delivered_bits.insert(mission.header().totals.delivered_bits);
        }
        assert!(delivered_bits.len() > 1, "strategies serve others: {delivered_bits:?}");
    }
}

#[test]
fn a_service_is_of_a_sensor_node_that_uploads() {
    // Near an empty SN and a full one out of the first one's way: whoever is chosen, bits are delivered in each slot in
    // which somebody in range has some.
    for strategy in names() {
        let scenario = scenario_of(&text("").replace("sampling_bps = 2000.0", "sampling_bps = 0.0"), strategy);
        let list = SensorList::of(&scenario).unwrap();
        let mut mission = Mission::new(&scenario, &list).unwrap();
        let mut before = mission.header().totals;
        while let Some(record) = mission.next() {
            let totals = record.header.totals;
            let is_left =
                list.sensors().iter().zip(mission.plant().field().queues_bits()).any(|(sensor, &queue_bits)| {
                    let at = mission.plant().flight(UAV).position().xy();
                    queue_bits > 0 && (sensor.position - at).norm() < 60.0
                });
            assert!(totals.delivered_bits > before.delivered_bits || !is_left, "{strategy}");
            before = totals;
        }
    }
}
