//! Sensor nodes with batteries (decision D33): who is visited, what is lost, and what a plant saves.

use crate::support::scenario_of;
use skysink_common::checkpoint::Checkpoint;
use skysink_common::geometry::Position;
use skysink_common::message::{Mode, Plan};
use skysink_common::nodes::Charges;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::uploads;
use skysink_common::stop::Stop;
use skysink_mission::drive::{Observer, SlotSink};
use skysink_mission::origin::RunMode;
use skysink_mission::sensor_results::SensorTally;
use skysink_mission::tally::Tally;
use skysink_mission::{Mission, Plant};
use skysink_planner::bound::mission_bound;
use skysink_planner::strategies::STRATEGIES;
use std::collections::HashSet;
use std::time::Duration;

/// A field of 40 SNs with these keys, of which most die within the mission.
fn field(seed: u64, keys: &str) -> String {
    format!(
        "name = 'energy'\nseed = {seed}\nslots = 120\narea.side_m = 250.0\nsensors.count = 40\n\
         sensors.sampling_bps = [100.0, 900.0]\nplanner.horizon.iterations = 100\nplanner.offline.steps = 2000\nplanner.sca.iterations = 2\n\
         sensors.energy.capacity_j = 2.0\nsensors.energy.sleep_w = 0.01\nsensors.energy.harvest_w = 0.005\n\
         sensors.energy.sample_j_per_bit = 7e-5\nsensors.energy.tx_w = 20.0\n{keys}"
    )
}

/// The batteries after the last slot.
fn charges(plant: &Plant) -> &Charges {
    plant.field().features().find::<Charges>().unwrap()
}

/// The SNs without energy after the last slot.
fn dead(plant: &Plant) -> HashSet<u32> {
    (0..).zip(charges(plant).charges_nj()).filter(|(_, nj)| **nj == 0).map(|(id, _)| id).collect()
}

fn sensors(scenario: &Scenario) -> SensorList {
    SensorList::of(scenario).unwrap()
}

#[test]
fn no_strategy_schedules_a_sensor_node_that_is_known_to_be_dead() {
    for strategy in STRATEGIES {
        for (keys, most) in [
            ("", 0),
            ("planner.knowledge = 'estimated'\n", 1),
            ("uav.count = 2\n", 0),
            ("planner.objective = { loss = 1.0, age = 0.1 }\n", 0),
            ("planner.objective = 'collect'\n", 0),
        ] {
            let scenario = scenario_of(&field(3, keys), strategy.name);
            let mut mission = Mission::new(&scenario, &sensors(&scenario)).unwrap();
            let mut visits = std::collections::HashMap::<u32, u32>::new();
            let mut before = dead(mission.plant());
            while let Some(record) = mission.next() {
                let scheduled = record.plans().iter().flatten().flat_map(|plan| plan.scheduled().to_vec());
                scheduled.filter(|id| before.contains(id)).for_each(|id| *visits.entry(id).or_default() += 1);
                before = dead(mission.plant());
            }
            assert!(before.len() > 15, "{}, {keys}: {} dead", strategy.name, before.len());
            assert!(visits.values().all(|&visits| visits <= most), "{}, {keys}: {visits:?}", strategy.name);
        }
    }
}

#[test]
fn a_uav_leaves_the_dead_for_the_living() {
    // A cluster of SNs around the start that die in slot 20; one that lives 100 m away, which fills in 20 slots.
    for strategy in STRATEGIES.iter().filter(|strategy| !["hover", "rfs", "offline", "sca"].contains(&strategy.name)) {
        let text = "name = 'x'\nslots = 150\nslot_s = 1.0\narea.side_m = 200.0\nsensors.file = 's.csv'\n\
                    uav.start_m = [20, 20]\nuav.max_speed_mps = 15.0\nsensors.energy.sleep_w = 1.0\n\
                    planner.horizon.iterations = 100\nplanner.objective = 'loss'\n";
        let scenario = scenario_of(text, strategy.name);
        let near: String = (0..6).map(|id| format!("{},{},0,900,20\n", 15 + 2 * id, 20)).collect();
        let csv = format!("x_m,y_m,queue_bits,sampling_bps,capacity_j\n{near}120,20,0,1500,1e6\n");
        let list = SensorList::parse(&csv, "s.csv".as_ref(), &scenario).unwrap();
        let mut mission = Mission::new(&scenario, &list).unwrap();
        let delivered = |mission: &Mission| mission.plant().field().delivered_bits()[6];
        mission.by_ref().take(60).count();
        assert_eq!(dead(mission.plant()).len(), 6);
        let before = delivered(&mission);
        mission.by_ref().count();
        assert!(delivered(&mission) >= before + 80 * 1_500, "{}: {before} {}", strategy.name, delivered(&mission));
    }
}

#[test]
fn a_full_buffer_of_the_greatest_length_is_neither_silent_nor_dead() {
    for keys in ["sensors.energy.capacity_j = 1e6\n", "link.duty_cycle = 0.9\nlink.duty_window_s = 10.0\n"] {
        for knowledge in ["oracle", "estimated"] {
            let text = format!(
                "name = 'x'\nslots = 20\nsensors.file = 's.csv'\nsensors.initial_queue_mean_bits = 4294967295\n\
                 sensors.capacity_bits = 4294967295\nplanner.knowledge = '{knowledge}'\n{keys}"
            );
            let scenario = scenario_of(&text, "gfs");
            let csv = "x_m,y_m,queue_bits\n50,50,4294967295\n55,50,2147483648\n";
            let list = SensorList::parse(csv, "s.csv".as_ref(), &scenario).unwrap();
            let mut mission = Mission::new(&scenario, &list).unwrap();
            let told = mission.plant().field().told();
            assert_eq!(told.queues_bits, [u32::MAX, 1 << 31]);
            assert!(!told.answers.is_empty() && told.answers.iter().all(|answer| answer.sends()), "{keys}");
            let record = mission.next().unwrap();
            let plan = record.plans()[0].unwrap();
            assert_eq!(plan.scheduled(), [0, 1], "{keys}, {knowledge}");
            assert!(record.header.delivered_bits > 0, "{keys}, {knowledge}");
        }
    }
}

#[test]
fn what_the_dead_lose_is_a_part_of_the_loss_and_the_bound_holds() {
    for strategy in ["tour", "horizon"] {
        let scenario =
            scenario_of(&field(4, "sensors.energy.wake = 'always'\nsensors.energy.listen_w = 0.01\n"), strategy);
        let list = sensors(&scenario);
        let mut tally = Tally::new(&scenario, &list, &RunMode::default());
        let mut mission = Mission::new(&scenario, &list).unwrap();
        mission.drive(&mut [&mut tally], &Stop::default()).unwrap();
        let summary = tally.summary(Duration::ZERO, 0);
        let energy = summary.node_energy.unwrap();
        let charges = charges(mission.plant());
        assert!(charges.is_balanced() && mission.header().totals.is_balanced());
        assert_eq!(energy, charges.summed_up(summary.delivered_bits), "the summary sees what the field does");
        assert!(energy.dead > 20 && energy.first_death_s < energy.half_dead_s, "{energy:?}");
        assert!((1..=summary.lost_bits).contains(&energy.lost_to_death_bits), "{energy:?}");
        let per_bit_j = energy.used_j / summary.delivered_bits as f64;
        assert!((energy.energy_per_bit_j.unwrap() - per_bit_j).abs() < 1e-12 && summary.loss_rate <= 1.0);
        let bound = mission_bound(&scenario, &list.sensors_of(&scenario), &list.queues_bits(), u64::MAX);
        assert!(bound.loss_bits <= summary.lost_bits);
    }
}

#[test]
fn a_restored_plant_continues_with_its_charges_and_airtimes_and_refuses_others() {
    for (keys, others) in [
        ("", "sensors.energy.initial = 0.9\n"), // another charge before slot 1
        ("sensors.expiry_s = 20.0\n", "sensors.expiry_s = 20.0\nsensors.energy.initial = 0.9\n"),
        // Half the airtime.
        ("link.duty_cycle = 2e-5\nlink.duty_window_s = 40.0\n", "link.duty_cycle = 1e-5\nlink.duty_window_s = 40.0\n"),
    ] {
        let scenario = scenario_of(&field(5, keys), "edf");
        let list = sensors(&scenario);
        let mut mission = Mission::new(&scenario, &list).unwrap();
        let records: Vec<_> = mission.by_ref().collect();
        let mut plant = Plant::new(&scenario, &list);
        records[..60].iter().for_each(|record| _ = plant.step(record.plans()));
        let mut bytes = Vec::new();
        plant.save(&mut bytes);
        let mut restored = Plant::new(&scenario, &list);
        restored.restore(&bytes).unwrap();
        assert!(!dead(&restored).is_empty() && restored.field() == plant.field());
        for record in &records[60..] {
            assert_eq!(restored.step(record.plans()).header, record.header);
        }
        restored.restore(&bytes).unwrap(); // backwards: some of its dead live
        assert!(restored.field() == plant.field());
        let other = scenario_of(&field(5, others), "edf");
        assert!(Plant::new(&other, &list).restore(&bytes).is_err(), "{keys}");
    }
}

#[test]
fn no_strategy_schedules_a_sensor_node_without_airtime() {
    // 0.8 ms of any 40 slots of 1 s, in which a full buffer takes about 0.6 ms.
    for strategy in STRATEGIES {
        for keys in ["", "planner.knowledge = 'estimated'\n", "uav.count = 2\n", "planner.objective = 'collect'\n"] {
            let text = format!(
                "name = 'duty'\nseed = 3\nslots = 120\narea.side_m = 150.0\nsensors.count = 12\n\
                 sensors.sampling_bps = [900.0, 4000.0]\nplanner.horizon.iterations = 100\n\
                 planner.offline.steps = 2000\nplanner.sca.iterations = 2\nlink.duty_cycle = 2e-5\nlink.duty_window_s = 40.0\n{keys}"
            );
            let scenario = scenario_of(&text, strategy.name);
            let list = sensors(&scenario);
            let mut tally = Tally::new(&scenario, &list, &RunMode::default());
            let mut mission = Mission::new(&scenario, &list).unwrap();
            let out = |mission: &Mission| -> HashSet<u32> {
                let answers = mission.plant().field().told().answers;
                (0..).zip(answers).filter(|(_, answer)| !answer.sends()).map(|(id, _)| id).collect()
            };
            let mut before = HashSet::new();
            let mut delivered_bits = [0; 12];
            let mut sent_s = vec![Vec::new(); 12];
            let [mut silenced, mut heard_again] = [0, 0];
            while let Some(record) = mission.next() {
                tally.add(&record).unwrap();
                let mut scheduled = record.plans().iter().flatten().flat_map(|plan| plan.scheduled().to_vec());
                assert!(!scheduled.any(|id| before.contains(&id)), "{}, {keys}", strategy.name);
                let now_bits = mission.plant().field().delivered_bits();
                for (id, sent_s) in sent_s.iter_mut().enumerate() {
                    let link = uploads(record.flights()).find(|link| link.sensor as usize == id);
                    let bits = now_bits[id] - delivered_bits[id];
                    sent_s.push(if bits > 0 { bits as f64 / link.unwrap().rate_bps } else { 0.0 });
                }
                delivered_bits.copy_from_slice(now_bits);
                let after = out(&mission);
                silenced += after.difference(&before).count();
                heard_again += before.difference(&after).count();
                before = after;
            }
            let most_s = sent_s.iter().flat_map(|sent_s| sent_s.windows(40)).map(|sent_s| sent_s.iter().sum::<f64>());
            let most_s = most_s.fold(0.0, f64::max);
            assert!(most_s <= 8e-4 + 1e-9, "{}, {keys}: {most_s} s", strategy.name);
            let is_still = ["hover", "rfs"].contains(&strategy.name);
            assert!(is_still || silenced > 3 && heard_again > 0, "{}, {keys}: {silenced}", strategy.name);
            assert_eq!(tally.summary(Duration::ZERO, 0).refused_duty, Some(0), "{}, {keys}", strategy.name);
        }
    }
}

#[test]
fn the_plan_of_offline_keeps_stops_of_sensor_nodes_that_are_silent_for_a_while() {
    for objective in ["", "planner.objective = 'age'\n", "planner.objective = 'collect'\n"] {
        let keys = |more: &str| {
            format!(
                "name = 'duty'\nseed = 3\nslots = 120\narea.side_m = 200.0\nsensors.count = 12\n\
                 sensors.sampling_bps = [900.0, 4000.0]\nplanner.offline.steps = 2000\n{objective}{more}"
            )
        };
        let flown = |more: &str| {
            let scenario = scenario_of(&keys(more), "offline");
            let list = sensors(&scenario);
            let mut mission = Mission::new(&scenario, &list).unwrap();
            let mut silent = 0;
            let mut visited = vec![[0; 2]; 12];
            while let Some(record) = mission.next() {
                for (node, visited) in list.nodes().iter().zip(&mut visited) {
                    let away = record.flights()[0].position().xy() - Position::new(node.x_m, node.y_m);
                    let is_near = away.norm() <= 20.0;
                    visited[usize::from(record.slot() > 60)] += usize::from(is_near);
                }
                silent += mission.plant().field().told().answers.iter().filter(|answer| !answer.sends()).count();
            }
            (silent, visited)
        };
        let (none, always) = flown("");
        let (silent, sometimes) = flown("link.duty_cycle = 2e-5\nlink.duty_window_s = 40.0\n");
        assert!(none == 0 && silent > 20, "{objective}: {silent} slots of silent SNs");
        // Those that are visited in the second half are still visited then.
        let kept = always.iter().zip(&sometimes).filter(|(always, _)| always[1] > 0).filter(|(_, now)| now[1] > 0);
        let late = always.iter().filter(|visits| visits[1] > 0).count();
        assert!(late > 0 && kept.count() * 4 >= late * 3, "{objective}: {always:?}, {sometimes:?}");
    }
}

#[test]
fn a_visit_to_a_dead_sensor_node_is_no_service() {
    // An SN that dies in slot 2, and is served in slots 1 to 5: two services, and its age goes on from slot 2.
    let text = "name = 'x'\nslots = 6\narea.side_m = 20.0\nsensors.file = 's.csv'\nsensors.energy.sleep_w = 1.0\n";
    let scenario = scenario_of(text, "gfs");
    let csv = "x_m,y_m,queue_bits,sampling_bps,capacity_j\n10,10,0,100,2\n";
    let list = SensorList::parse(csv, "s.csv".as_ref(), &scenario).unwrap();
    let mut plant = Plant::new(&scenario, &list);
    let mut tally = Tally::new(&scenario, &list, &RunMode::default());
    let mut singly = SensorTally::new(1);
    let mut plan = Plan::fly_to([10.0, 10.0, scenario.uav.altitude_m], Mode::Serve);
    plan.schedule(&[0]);
    for _ in 0..5 {
        let record = plant.step(&[Some(plan)]).clone();
        tally.add(&record).unwrap();
        singly.slot(&record, &plant).unwrap();
    }
    assert_eq!(singly.results(&plant, 1.0).next().unwrap().served_slots, 2);
    assert_eq!(tally.sums.gaps().sums(5).ages, (1 + 2 + 3) as f64);
    assert_eq!(tally.summary(Duration::ZERO, 0).mean_served, 2.0 / 5.0);
}
