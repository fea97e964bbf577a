//! What a scene shows: its units, labels, the view from above, and the map.

use std::collections::BTreeSet;
use std::net::TcpListener;
use std::path::Path;
use std::sync::Arc;

use crate::support::{Found, Slot, in_folder, letter, sensors};
use skysink_common::geodata::projection::{Origin, Projection};
use skysink_common::message::{Mode, PathPoint, SensorNode};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::Sensors;
use skysink_viewer::{
    Scene, Sinks, SlotView, WallClock, cameras, curves, events, geo, legend, maps, path, queues, uav,
};

const SENSORS: u32 = 20;

/// An area of 1 500 m × 1 500 m with three sensor nodes, two of them with names, flown at 40 m.
fn farm(folder: &Path, area: &str) -> (Scenario, Arc<Sensors>) {
    std::fs::write(folder.join("sensors.csv"), "x_m,y_m,name\n0,50,gate\n700,50,\n1500,1400,soil-07\n").unwrap();
    let text = format!(
        "name = \"farm\"\nslots = 100\nslot_s = 6.0\n[area]\nside_m = 1500.0\n{area}[sensors]\nfile = \"sensors.csv\"\n\
         [uav]\naltitude_m = 40.0\n[uav.battery]\ncapacity_j = 200.0\n[link]\ncomm_radius_m = 80.0\n"
    );
    let scenario = Scenario::parse(&text, &folder.join("farm.toml"), Overrides::default()).unwrap();
    let node = |[x_m, y_m]: [f64; 2]| SensorNode {
        x_m,
        y_m,
        gain: 1e-5,
        sampling_bps: 100.0,
        capacity_bits: 1_000,
        ..SensorNode::default()
    };
    let sensors = Sensors::of(&scenario, &[[0.0, 50.0], [700.0, 50.0], [1500.0, 1400.0]].map(node));
    (scenario, Arc::new(sensors))
}

/// South-west corner of a farm with a map.
const ORIGIN: &str = "origin_lat_deg = 47.4\norigin_lon_deg = 8.55\n";

/// Records slots 0 to `last` of a scenario, without slots 3 and 4.
fn record(scenario: &Scenario, sensors: &Arc<Sensors>, last: u64) -> Found {
    in_folder(|path| {
        let sinks = Sinks { save: Some(path.to_owned()), ..Sinks::default() };
        let mut scene = Scene::open(&sinks, scenario, sensors, "test-run", WallClock::Unmeasured, None).unwrap();
        for slot in (0..=last).filter(|slot| ![3, 4].contains(slot)) {
            if slot == 5 {
                scene.log_missed(3..=4).unwrap();
            }
            let mut slot = Slot::new(slot, sensors.count());
            slot.flight.energy_j = 50.0;
            slot.flight.served = 0;
            scene.log_slot(&slot.view()).unwrap();
        }
        scene.close().unwrap();
        Found::read(path)
    })
}

/// The farm's recording, with these keys of its area.
fn record_farm(area: &str) -> Found {
    let folder = tempfile::tempdir().unwrap();
    let (scenario, sensors) = farm(folder.path(), area);
    record(&scenario, &sensors, 5)
}

/// Whether the layout says `text`.
fn is_arranged(found: &Found, text: &str) -> bool {
    found.layout.values().flatten().any(|value| value.contains(text))
}

/// The numbers in a printed value.
fn numbers(text: &str) -> Vec<f64> {
    text.lines().filter_map(|line| line.trim_matches([' ', ',']).parse().ok()).collect()
}

#[test]
fn an_area_wider_than_100_m_is_drawn_in_a_larger_unit() {
    let wide = record_farm("");
    assert!(wide.text(cameras::REDUCED, "Transform3D:scale", None).contains("100.0"));
    assert!(is_arranged(&wide, "/cameras/field"));
    let small = record(&letter(), &sensors(SENSORS), 1);
    assert_eq!(small.text(cameras::REDUCED, "Transform3D:scale", None), "");
    assert!(!is_arranged(&small, "/cameras/field"));
}

#[test]
fn the_camera_of_the_view_from_above_has_a_pixel_for_each_metre_of_the_ground() {
    let found = record_farm("");
    let at = numbers(&found.text(cameras::TOP, "Transform3D:translation", None));
    let focal = numbers(&found.text(cameras::TOP, "Pinhole:image_from_camera", None));
    assert_eq!(at[..2], [750.0, 750.0]);
    assert_eq!(at[2], focal[0], "the ground is as far away as the image");
    let pixels = numbers(&found.text(cameras::TOP, "Pinhole:resolution", None));
    assert_eq!(pixels, [1500.0, 1500.0]);
    assert!(is_arranged(&found, "/cameras/top"));
}

#[test]
fn the_view_from_above_shows_a_uav_higher_than_the_area_is_long() {
    let text = "name = \"high\"\n[area]\nside_m = 20.0\n[uav]\naltitude_m = 100.0\n";
    let scenario = Scenario::parse(text, Path::new("high.toml"), Overrides::default()).unwrap();
    let found = record(&scenario, &sensors(SENSORS), 0);
    let camera_m = numbers(&found.text(cameras::TOP, "Transform3D:translation", None))[2];
    assert!(0.2 * camera_m > 100.0, "{camera_m}: the near plane, at 0.8 of the way down, hides it");
}

#[test]
fn a_north_arrow_has_a_tenth_of_the_area_width() {
    for (found, length_m) in [(record_farm(""), 150.0), (record(&letter(), &sensors(SENSORS), 1), 10.0)] {
        assert_eq!(numbers(&found.text(legend::NORTH, "Arrows3D:vectors", None)), [0.0, length_m, 0.0]);
        let east_m = numbers(&found.text(legend::NORTH, "Arrows3D:origins", None))[0];
        assert!(east_m > 10.0 * length_m, "{east_m}: it stands in the area");
    }
}

#[test]
fn every_sensor_node_is_labelled_by_its_name_or_number() {
    let found = record_farm(ORIGIN);
    let names = ["gate", "SN 1", "soil-07"];
    let texts = [
        found.text(queues::BARS, "Boxes3D:labels", None),
        found.text(geo::SENSORS, "name", None),
        found.text(&format!("{}/{}", maps::LOSS, maps::SHOWN), "name", None),
    ];
    for text in texts {
        assert!(names.iter().all(|name| text.contains(name)), "{text}");
    }
    assert!(found.text(events::STATUS, "TextDocument:text", Some(5)).contains("next full: "));
    let unnamed = |count| {
        let found = record(&letter(), &sensors(count), 0);
        let labels = [(queues::BARS, "Boxes3D:labels"), (queues::POINTS, "Points3D:labels")];
        labels.map(|(entity, component)| found.text(entity, component, None)).concat()
    };
    assert!(unnamed(2_000).contains("SN 1999"));
    assert_eq!(unnamed(2_001), "", "rerun tells the number");
}

/// rerun's tooltip lists no component if more than three have a value for each bar.
#[test]
fn at_most_three_components_differ_from_bar_to_bar() {
    let found = record_farm("");
    let bars = found.cells.keys().filter(|(entity, ..)| *entity == format!("/{}", queues::BARS));
    let components: BTreeSet<&str> = bars.map(|(_, component, ..)| component.as_str()).collect();
    let each = ["Boxes3D:centers", "Boxes3D:class_ids", "Boxes3D:labels"];
    let one = ["Boxes3D:fill_mode", "Boxes3D:half_sizes", "Boxes3D:show_labels"];
    assert_eq!(components, each.into_iter().chain(one).collect());
    assert_eq!(numbers(&found.text(queues::BARS, "Boxes3D:half_sizes", None)).len(), 3, "x, y and z of all bars");
}

#[test]
fn a_bar_rises_from_the_ground_with_its_queue() {
    let found = record(&letter(), &sensors(1), 9);
    let half_m = numbers(&found.text(queues::BARS, "Boxes3D:half_sizes", None))[2];
    let top_m = |slot| numbers(&found.shown_in(queues::BARS, "Boxes3D:centers", slot))[2] + half_m;
    // The letter's bars are 10 m high; queues grow by a tenth of the buffer.
    for (slot, height_m) in [(0, 0.2), (1, 1.0), (5, 5.0), (9, 9.0)] {
        assert!((top_m(slot) - height_m).abs() < 1e-5, "slot {slot}: {}", top_m(slot));
    }
}

#[test]
fn a_uav_is_labelled_in_the_scene_and_from_above() {
    let found = record_farm("");
    let label = |slot| found.text(uav::LABEL, "Points3D:labels", Some(slot));
    assert!(label(0).contains("00:00 · 20 m · 25 %"), "without a speed: {}", label(0));
    assert!(label(2).contains("00:12 · 20 m · 0.2 m/s · 25 %"), "1 m in 6 s: {}", label(2));
    assert!(label(5).contains("00:30 · 20 m · 25 %"), "after missed slots: {}", label(5));
    assert!(found.text(uav::LABELS_ABOVE, "Points2D:labels", Some(2)).contains("00:12"));
    let place = numbers(&found.shown_in(uav::LABELS_ABOVE, "Points2D:positions", 2));
    assert_eq!(place, [2.0, 1450.0], "50 m north of the south-west corner");
}

#[test]
fn a_mission_without_an_origin_has_no_map() {
    let found = record_farm("");
    assert!(!found.cells.keys().any(|(entity, ..)| entity.starts_with("/geo")));
    assert!(!is_arranged(&found, "Map"));
}

#[test]
fn a_map_shows_sensor_nodes_once_and_where_the_uav_is() {
    let found = record_farm(ORIGIN);
    assert!(is_arranged(&found, "Map"));
    let projection = Projection::at(Origin { lat_deg: 47.4, lon_deg: 8.55 });
    let is_at = |text: &str, expected_m: &[[f64; 2]]| {
        let degrees = numbers(text);
        assert_eq!(degrees.len(), 2 * expected_m.len(), "{text}");
        for (degrees, expected_m) in degrees.chunks_exact(2).zip(expected_m) {
            let at = projection.project(degrees[0], degrees[1]).unwrap();
            assert!((at.x - expected_m[0]).hypot(at.y - expected_m[1]) < 1e-3, "{expected_m:?}: {at}");
        }
    };
    let nodes = found.text(geo::SENSORS, "GeoPoints:positions", None);
    is_at(&nodes, &[[0.0, 50.0], [700.0, 50.0], [1500.0, 1400.0]]);
    assert!(found.slots_of(geo::SENSORS).is_empty(), "what is logged in a slot does not grow with their number");
    is_at(&found.text(geo::UAVS, "GeoPoints:positions", Some(2)), &[[2.0, 50.0]]);
    is_at(&found.text(geo::TRAIL, "GeoLineStrings:line_strings", Some(2)), &[[1.0, 50.0], [2.0, 50.0]]);
    is_at(&found.text(geo::TRAIL, "GeoLineStrings:line_strings", Some(5)), &[]); // slots 3 and 4 are missing
}

#[test]
fn only_a_live_mission_shows_its_newest_slot() {
    let newest = |live: Option<u16>, path: &Path| {
        let sinks = Sinks { save: Some(path.to_owned()), live, ..Sinks::default() };
        let mut scene = Scene::open(&sinks, &letter(), &sensors(SENSORS), "live", WallClock::Unmeasured, None).unwrap();
        for slot in 0..=65 {
            scene.log_slot(&Slot::new(slot, SENSORS as usize).view()).unwrap();
        }
        scene.close().unwrap();
        let found = Found::read(path);
        (found.text(events::NEWEST, "TextDocument:text", None), is_arranged(&found, "Newest slot"))
    };
    let port = TcpListener::bind(("127.0.0.1", 0)).unwrap().local_addr().unwrap().port();
    let (text, is_shown) = in_folder(|path| newest(Some(port), path));
    assert!(text.contains("newest slot **65** of 600, at 01:05") && is_shown, "{text}");
    assert_eq!(in_folder(|path| newest(None, path)), (String::new(), false));
}

#[test]
fn every_uav_has_its_own_position_path_and_waypoint() {
    let folder = tempfile::tempdir().unwrap();
    let battery = farm(folder.path(), "").0.uav.battery; // of 200 J
    let found = in_folder(|path| {
        let mut scenario = letter();
        scenario.uav.count = Some(2);
        scenario.uav.battery = battery;
        let sinks = Sinks { save: Some(path.to_owned()), ..Sinks::default() };
        let mut scene =
            Scene::open(&sinks, &scenario, &sensors(SENSORS), "test-run", WallClock::Unmeasured, None).unwrap();
        for slot in 0..=9 {
            let slot = Slot::new(slot, SENSORS as usize);
            let mut other = slot.flight;
            other.y_m = 80.0;
            other.x_m *= 2.0;
            other.energy_j = 150.0 - slot.slot as f64;
            if slot.slot >= 4 {
                other.mode = Mode::Transit as u32;
            }
            let flights = [slot.flight, other];
            let plans = [slot.plan; 2];
            let leads = [3, 5].contains(&slot.slot);
            let paths: Vec<_> =
                [[90.0, 11.0], [91.0, 12.0]].map(|[x, y]| PathPoint::of(1, &[x, y, 20.0].into())).into();
            let paths = if leads { &paths[..] } else { &[] };
            scene.log_slot(&SlotView { flights: &flights, plans: &plans, paths, ..slot.view() }).unwrap();
        }
        scene.close().unwrap();
        Found::read(path)
    });
    let at = |entity: &str| found.shown_in(entity, "Transform3D:translation", 9);
    assert_ne!(at(uav::UAV), at(&format!("{}/1", uav::FLEET)));
    assert!(at(&format!("{}/1", uav::FLEET)).contains("18"), "{}", at(&format!("{}/1", uav::FLEET)));
    for entity in [format!("{}/1", uav::TRAIL), format!("{}/1", uav::TRACK), format!("{}/1", uav::PLAN)] {
        assert_eq!(found.slots_of(&entity), (0..=9).collect(), "{entity}");
    }
    assert!(!found.slots_of(&format!("{}/1", uav::WAYPOINTS)).is_empty());
    let lane = format!("{}/1", events::FLEET_LANES);
    assert_eq!(found.slots_of(&lane), [1, 4].into(), "when its state changes");
    assert!(found.text(&lane, "StateChange:state", Some(4)).contains("transit"));
    for entity in path::OTHERS {
        assert_eq!(found.slots_of(entity), [3, 4, 5, 6].into(), "{entity}, and empty from there on");
        let drawn = |slot| found.text(entity, "LineStrips3D:strips", Some(slot)).contains("91.0");
        assert_eq!([3, 4, 5, 6].map(drawn), [true, false, true, false], "{entity}");
    }
    assert!(found.slots_of(path::PATH).is_empty(), "the first UAV has none");
    assert!(found.slots_of(&format!("{}/1", uav::WAYPOINT)).is_empty(), "it would move with the first one's");
    let label = found.shown_in(&format!("{}/1/label", uav::FLEET), "Points3D:labels", 9);
    assert!(label.contains("UAV 1 · 20 m · 2.0 m/s"), "{label}");
    let battery = format!("{}/1", curves::BATTERY);
    assert_eq!((found.curve(curves::BATTERY).len(), found.curve(&battery)[&9]), (10, 70.5));
    assert!(found.layout.values().flatten().any(|value| value.contains(&battery)), "it is plotted");
}
