//! Objectives of ages (decision D36): closed forms, optima by enumeration, and the same cost in plan and flight.

use std::collections::HashMap;

use crate::support::scenario_of;
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::{SlotRecord, uploads};
use skysink_common::stop::Stop;
use skysink_mission::drive::Observer;
use skysink_mission::service_gaps::{GapSums, ServiceGaps};
use skysink_mission::{Mission, MissionError, Plant};

/// Counts the gaps between services.
struct Meter(ServiceGaps);

impl Observer for Meter {
    fn slot(&mut self, record: &SlotRecord, _: &Plant) -> Result<(), MissionError> {
        uploads(record.flights()).for_each(|link| self.0.serve(link.sensor as usize, record.slot()));
        Ok(())
    }
}

/// The lost bits of a mission of SNs of equal weights, and the gaps between their services.
fn flown(text: &str, strategy: &'static str) -> (u64, GapSums) {
    let scenario = scenario_of(text, strategy);
    let list = SensorList::of(&scenario).unwrap();
    let limit = scenario.sensors.deadline_s.unwrap() as u64;
    let mut meter = Meter(ServiceGaps::new(vec![1.0; list.sensors().len()], limit));
    let mut mission = Mission::new(&scenario, &list).unwrap();
    mission.drive(&mut [&mut meter], &Stop::default()).unwrap();
    (mission.header().totals.lost_bits, meter.0.sums(scenario.slots))
}

/// The gaps alone.
fn gaps(text: &str, strategy: &'static str) -> GapSums {
    flown(text, strategy).1
}

/// A field in which all SNs are in range of every point.
fn in_range(sensors: usize, blocks: usize, slots: u64, objective: &str) -> String {
    format!(
        "name = 'ages'\nslots = {slots}\narea.side_m = 6.0\nsensors.count = {sensors}\nsensors.sampling_bps = [0.0, 500.0]\n\
         sensors.deadline_s = 4.0\nlink.resource_blocks = {blocks}\nplanner.objective = {objective}\n\
         planner.horizon.iterations = 300\nplanner.offline.steps = 20000\n"
    )
}

#[test]
fn sensor_nodes_in_range_are_served_in_turns() {
    for (sensors, blocks) in [(12, 3), (8, 4), (5, 1)] {
        let cycle = (sensors / blocks) as u64;
        let slots = 60u64;
        // The first round ends with ages 1 … k − 1; each round after it has as many ages of each kind.
        let one = |sensor: u64| {
            let first = sensor + 1;
            (1..=slots).map(|slot| if slot < first { slot } else { (slot - first) % cycle }).sum::<u64>()
        };
        let least = (0..cycle).map(one).sum::<u64>() * blocks as u64;
        for strategy in ["horizon", "offline", "max-age-first"] {
            for objective in ["'age'", "'peak-age'"] {
                let found = gaps(&in_range(sensors, blocks, slots, objective), strategy);
                assert_eq!(found.ages, least as f64, "{strategy}, {objective}, {sensors}, {blocks}");
                assert_eq!(found.highest, cycle - 1, "{strategy}, {objective}");
            }
        }
    }
}

/// The least cost of `slots` slots with one service each, from these ages, by `cost` of an age in a slot.
fn least(ages: &[u64], slots: u64, cost: &dyn Fn(u64) -> u64, known: &mut HashMap<(Vec<u64>, u64), u64>) -> u64 {
    if slots == 0 {
        return 0;
    }
    let key = (ages.to_vec(), slots);
    if let Some(found) = known.get(&key) {
        return *found;
    }
    let served = |sensor: usize| {
        let next: Vec<u64> =
            ages.iter().enumerate().map(|(index, age)| if index == sensor { 0 } else { age + 1 }).collect();
        next.iter().map(|age| cost(*age)).sum::<u64>() + least(&next, slots - 1, cost, known)
    };
    let found = (0..ages.len()).map(served).collect::<Vec<_>>().into_iter().min().unwrap_or(0);
    known.insert(key, found);
    found
}

#[test]
fn plans_of_ages_are_optimal_in_small_fields() {
    for sensors in 2..=4 {
        for slots in [5, 8, 11] {
            let ages = least(&vec![0; sensors], slots, &|age| age, &mut HashMap::new());
            let late = least(&vec![0; sensors], slots, &|age| u64::from(age > 4), &mut HashMap::new());
            for strategy in ["horizon", "offline"] {
                let found = gaps(&in_range(sensors, 1, slots, "'age'"), strategy).ages;
                assert_eq!(found, ages as f64, "{strategy}: {sensors} SNs, {slots} slots");
                let found = gaps(&in_range(sensors, 1, slots, "'deadline'"), strategy).late;
                assert_eq!(found, late as f64, "{strategy}: {sensors} SNs, {slots} slots, deadline");
            }
        }
    }
}

/// A field that takes flights, flown for each objective: that of its own costs least.
#[test]
fn each_objective_costs_least_by_its_own_plans() {
    let cost = |objective: &str| {
        let text = format!(
            "name = 'ages'\nslots = 200\narea.side_m = 300.0\nsensors.count = 40\nsensors.sampling_bps = [50.0, 900.0]\n\
             sensors.deadline_s = 40.0\nplanner.objective = {objective}\nplanner.horizon.iterations = 400\n"
        );
        let (lost_bits, gaps) = flown(&text, "horizon");
        (lost_bits, gaps.ages, gaps.late)
    };
    let [loss, age, deadline] = ["'loss'", "'age'", "'deadline'"].map(cost);
    assert!(loss.0 < age.0 && loss.0 < deadline.0, "{loss:?} {age:?} {deadline:?}");
    assert!(age.1 < loss.1 && age.1 < deadline.1, "{loss:?} {age:?} {deadline:?}");
    assert!(deadline.2 < loss.2 && deadline.2 <= age.2, "{loss:?} {age:?} {deadline:?}");
    // A sum in which one cost hardly counts is the other.
    let sum = cost("{ loss = 1.0, age = 1e-9 }");
    assert!(sum.0 < age.0, "{sum:?} {age:?}");
}

/// Sensor nodes that sample nothing have ages, too: for UAVs that count each other's visits, and where queues are
/// estimated.
#[test]
fn ages_count_where_nothing_is_sampled() {
    for keys in [
        "uav.count = 2\nuav.coordination = 'sequential'\nplanner.objective = 'age'\n",
        "uav.count = 2\nuav.coordination = 'sequential'\nplanner.objective = { loss = 1e-9, age = 1.0 }\n",
        "planner.knowledge = 'estimated'\nplanner.objective = { loss = 1.0, age = 10.0 }\n",
    ] {
        let text = format!(
            "name = 'ages'\nslots = 100\narea.side_m = 250.0\nsensors.count = 40\nsensors.sampling_bps = 0.0\n\
             sensors.deadline_s = 40.0\nlink.bandwidth_hz = 5e3\nplanner.horizon.iterations = 300\n{keys}"
        );
        let [horizon, tour] = ["horizon", "tour"].map(|strategy| gaps(&text, strategy).ages);
        assert!(horizon < 1.02 * tour, "{keys}: {horizon} against {tour}");
    }
}

#[test]
fn limits_of_whole_slots_are_whole() {
    for (slot_s, deadline_s, slots) in [(0.1, 0.3, 3), (0.1, 0.6, 6), (0.1, 0.7, 7), (0.1, 0.69, 6), (1.0, 0.5, 0)] {
        let text =
            format!("name = 'a'\nslot_s = {slot_s:?}\nlink.comm_s = 0.01\nsensors.deadline_s = {deadline_s:?}\n");
        assert_eq!(scenario_of(&text, "gfs").deadline_slots(), Some(slots), "{deadline_s} s");
    }
}
