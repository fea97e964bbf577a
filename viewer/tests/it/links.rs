//! Recorded links by place, heard SNRs and batteries of sensor nodes.

use std::path::Path;
use std::sync::Arc;

use crate::support::{Found, Slot, letter, sensors};
use skysink_common::channel::LinkMap;
use skysink_common::geometry::Position;
use skysink_common::message::HeardLink;
use skysink_common::nodes::{Answer, NodeFeatures};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::{SensorList, Sensors};
use skysink_viewer::{Scene, Sinks, SlotView, WallClock, curves, energy, heard, legend, link_map};

const SENSORS: u32 = 3;

/// A map of rates over 100 m × 100 m: SN 0 has a link in the west, SN 1 none, SN 2 a better one everywhere.
fn mapped() -> Scenario {
    let levels = [[9e4, 9e4, f64::NAN], [f64::NAN; 3], [1.8e5; 3]].concat();
    let axes_m = [vec![0.0, 50.0, 100.0], vec![0.0], vec![20.0]];
    let map = LinkMap::of_arrays(axes_m, &[3, 1, 1, 3], &levels, None).unwrap();
    let places: Vec<Position> = sensors(SENSORS).positions.clone();
    let overrides = Overrides { map: Some(map.at_places(&places).shared()), ..Overrides::default() };
    let text = "name = 'mapped'\nlink = { model = 'map', file = 'none.csv', comm_radius_m = 200.0 }\n";
    Scenario::parse(text, Path::new("mapped.toml"), overrides).unwrap()
}

/// Records what `log` logs of a scenario.
fn record(scenario: &Scenario, sensors: &Arc<Sensors>, log: impl Fn(&mut Scene)) -> Found {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mission.rrd");
    let sinks = Sinks { save: Some(path.clone()), ..Sinks::default() };
    let mut scene = Scene::open(&sinks, scenario, sensors, "test-run", WallClock::Unmeasured, None).unwrap();
    log(&mut scene);
    scene.close().unwrap();
    Found::read(&path)
}

fn log_slots(scene: &mut Scene) {
    (0..3).for_each(|slot| scene.log_slot(&Slot::new(slot, SENSORS as usize).view()).unwrap());
}

/// Whether an entity or one below it is in a recording.
fn has(found: &Found, entity: &str) -> bool {
    found.cells.keys().any(|(name, ..)| name.starts_with(&format!("/{entity}")))
}

fn hidden(found: &Found) -> usize {
    let is_hidden = |(entity, component, ..): &&(String, String, Option<i64>, Option<i64>)| {
        component == "EntityBehavior:visible" && entity.ends_with(link_map::LINK_MAPS)
    };
    found.layout.keys().filter(is_hidden).count()
}

#[test]
fn without_these_models_a_recording_has_none_of_their_entities() {
    let found = record(&letter(), &sensors(SENSORS), log_slots);
    for entity in [link_map::LINK_MAP, heard::HEARD, energy::ENERGY, energy::DEAD_MARKS, energy::ALIVE] {
        assert!(!has(&found, entity), "{entity}");
    }
    assert_eq!(hidden(&found), 0);
}

#[test]
fn the_map_of_the_best_link_is_shown_and_those_of_each_sensor_node_are_hidden() {
    let found = record(&mapped(), &sensors(SENSORS), log_slots);
    let best = found.text(link_map::LINK_MAP, "GridMap:data", None);
    assert!(best.contains("140"), "{best}");
    for id in 0..SENSORS {
        assert!(has(&found, &format!("{}/{id}", link_map::LINK_MAPS)), "{id}");
    }
    // The map begins in the north-west: SN 0 has a link there, and SN 1 none anywhere.
    let of = |id: u32| found.text(&format!("{}/{id}", link_map::LINK_MAPS), "GridMap:data", None);
    assert!(of(0).contains("140") && !of(1).contains("140"), "{}", of(1));
    assert_eq!(hidden(&found), 3, "in each view of the field");
    assert!(found.text(legend::PAGE, "TextDocument:text", None).contains("rate expected of the best link"));
    let many = record(&mapped(), &sensors(201), |_| {});
    assert!(has(&many, link_map::LINK_MAP) && !has(&many, link_map::LINK_MAPS) && hidden(&many) == 0);
}

#[test]
fn heard_links_are_lines_by_their_snr() {
    let text = "name = 'x'\nlink = { model = 'probabilistic-los', beacon_radius_m = 30.0 }\n";
    let scenario = Scenario::parse(text, Path::new("x.toml"), Overrides::default()).unwrap();
    let heard = |sensor: u32, snr_db: f32| HeardLink { uav: 0, sensor, snr_db };
    let found = record(&scenario, &sensors(SENSORS), |scene| {
        // An SN and a UAV that do not exist are left out.
        let heard = [heard(0, -40.0), heard(2, 30.0), heard(9, 5.0), HeardLink { uav: 1, ..heard(0, 5.0) }];
        for slot in 0..2 {
            let slot = Slot::new(slot, SENSORS as usize);
            scene.log_slot(&SlotView { heard: &heard[..2 * slot.slot as usize + 2], ..slot.view() }).unwrap();
        }
        scene.log_missed(2..=3).unwrap();
    });
    let lines = |slot| found.text(heard::HEARD, "LineStrips3D:strips", Some(slot)).matches("20.0").count();
    assert_eq!([0, 1, 2].map(lines), [2, 2, 0], "each begins at the UAV, 20 m high; none in missed slots");
    let colours = found.text(heard::HEARD, "LineStrips3D:colors", Some(0));
    let number = |[red, green, blue]: [u32; 3]| (((red << 8 | green) << 8 | blue) << 8 | 255).to_string();
    assert!([[74, 82, 100], [245, 246, 250]].map(number).iter().all(|of| colours.contains(of)), "{colours}");
    assert!(found.text(legend::PAGE, "TextDocument:text", None).contains("within 30 m: -10 → 30 dB"));
}

#[test]
fn batteries_are_rings_and_dead_sensor_nodes_crosses() {
    let text = "name = 'x'\nslots = 9\nsensors = { count = 3, sampling_bps = 100.0, \
                energy = { capacity_j = 2.0, sleep_w = 1.0 } }\n";
    let scenario = Scenario::parse(text, Path::new("x.toml"), Overrides::default()).unwrap();
    let list = SensorList::of(&scenario).unwrap();
    let sensors = Arc::new(Sensors::of(&scenario, &list.nodes()));
    let mut ledger = list.ledger(&scenario);
    let mut slots: Vec<(Vec<Answer>, Option<NodeFeatures>)> = Vec::new();
    for slot in 0..=2 {
        if slot > 0 {
            ledger.sample(slot);
            let _ = ledger.end_slot(slot, &[]);
        }
        let mut answers = Vec::new();
        ledger.fill_answers(&mut answers);
        slots.push((answers, Some(ledger.features().clone())));
    }
    assert_eq!(slots[2].0, [Answer::Dead; 3], "1 J of 2 J in each slot");
    slots.push((vec![Answer::Dead; 3], None)); // a viewer in a ring that has missed slots
    let found = record(&scenario, &sensors, |scene| {
        for (slot, (answers, features)) in (0..).zip(&slots) {
            let slot = Slot { answers: answers.clone(), ..Slot::new(slot, 3) };
            scene.log_slot(&SlotView { features: features.as_ref(), ..slot.view() }).unwrap();
        }
    });
    let levels = |slot| found.text(energy::ENERGY, "LineStrips3D:class_ids", Some(slot));
    for (slot, level) in [(0, "10"), (1, "5"), (2, "0")] {
        assert_eq!(levels(slot).matches(&format!("  {level},")).count(), 3, "{}", levels(slot));
    }
    assert!(found.slots_of(energy::ENERGY).contains(&3), "cleared");
    assert_eq!(found.slots_of_component(energy::DEAD_MARKS, "LineStrips3D:strips"), [0, 2].into());
    assert_eq!(found.curve(energy::ALIVE).into_values().collect::<Vec<_>>(), [3.0, 3.0, 0.0, 0.0]);
    assert!(found.layout.values().flatten().any(|value| value.contains("SNs alive")));
    assert!(!found.curve(curves::LOSS).is_empty());
}
