//! Tests of the MCAP formats.

use std::collections::BTreeMap;

use mcap::MessageStream;
use serde_json::Value;

use super::super::format::WriteFormat;
use super::super::{mcap as json_log, mcap_ros2};
use super::hills::{hills, hilly_list};
use super::*;

/// The messages of a log by topic, with the name of their schema.
fn messages(format: &super::super::ExportFormat, run: &RecordedRun) -> BTreeMap<String, (String, Vec<Vec<u8>>)> {
    let WriteFormat::Flight(write) = format.write else { panic!("{} is no flight", format.name) };
    let log = write(&track(run));
    let mut topics = BTreeMap::new();
    for message in MessageStream::new(&log).unwrap() {
        let message = message.unwrap();
        let schema = message.channel.schema.as_ref().unwrap().name.clone();
        let (_, all) = topics.entry(message.channel.topic.clone()).or_insert_with(|| (schema, Vec::new()));
        all.push(message.data.into_owned());
    }
    topics
}

fn json_messages(run: &RecordedRun) -> BTreeMap<String, Vec<Value>> {
    let parse = |bytes: &Vec<u8>| serde_json::from_slice(bytes).unwrap();
    messages(&json_log::FORMAT, run)
        .into_iter()
        .map(|(topic, (_, all))| (topic, all.iter().map(parse).collect()))
        .collect()
}

fn with_battery(mut run: RecordedRun) -> RecordedRun {
    let battery = "name = \"a\"\n[uav.battery]\ncapacity_j = 2000.0\ninitial = 0.5\n";
    run.scenario.uav.battery = Scenario::parse(battery, Path::new("a"), Overrides::default()).unwrap().uav.battery;
    for slot in &mut run.slots {
        slot[UAV].energy_j = 1000.0 - 100.0 * slot[UAV].slot as f64;
    }
    run
}

/// East for 30 m, a hold, and west: half a turn, (0, 0, 1, 0).
#[test]
fn poses_transforms_and_the_path_have_the_heading_of_the_flight() {
    let run = run(&[(30.0, None), (0.0, Some(1)), (-10.0, None)]);
    let log = json_messages(&run);
    let path = log["/uav/path"][0]["poses"].as_array().unwrap();
    assert_eq!((log["/uav/path"].len(), path.len()), (1, 4));
    for (index, [x_m, z, w]) in
        [[0.0, 0.0, 1.0], [30.0, 0.0, 1.0], [30.0, 0.0, 1.0], [20.0, 1.0, 0.0]].iter().enumerate()
    {
        let pose = &log["/uav/pose"][index]["pose"];
        assert_eq!(&path[index], pose);
        let transform = &log["/tf"][index];
        assert_eq!((&transform["translation"], &transform["rotation"]), (&pose["position"], &pose["orientation"]));
        let is_near = |value: &Value, expected: f64| (value.as_f64().unwrap() - expected).abs() < 1e-12;
        let orientation = &pose["orientation"];
        assert!(is_near(&pose["position"]["x"], *x_m), "{index}: {pose}");
        assert!(is_near(&orientation["z"], *z) && is_near(&orientation["w"], *w), "{index}: {pose}");
    }
    assert!(!log.contains_key("/uav/battery"), "without a battery");
}

/// The first SN stands at the start, on ground of 200 m; the UAV flies 20 m above.
#[test]
fn a_fix_over_hills_adds_the_ground_height() {
    let steps = [(100.0, None), (50.0, None)];
    let hilly = json_messages(&run_in("", &hilly_list(), &steps));
    let altitudes_m: Vec<f64> = hilly["/uav/fix"].iter().map(|fix| fix["altitude"].as_f64().unwrap()).collect();
    assert!((altitudes_m[0] - (hills(0.0, 0.0) + 20.0)).abs() < 1e-9, "{altitudes_m:?}");
    assert!((altitudes_m[1] - (hills(100.0, 0.0) + 20.0)).abs() < 1e-9, "{altitudes_m:?}");
    assert!((altitudes_m[2] - (hills(150.0, 0.0) + 20.0)).abs() < 10.0, "{altitudes_m:?}");
    assert!(json_messages(&run(&steps))["/uav/fix"].iter().all(|fix| fix["altitude"] == 20.0));
}

#[test]
fn the_battery_state_is_a_fraction_from_the_first_message() {
    let log = json_messages(&with_battery(run(&[(30.0, None), (0.0, Some(1))])));
    let fractions: Vec<f64> =
        log["/uav/battery"].iter().map(|battery| battery["percentage"].as_f64().unwrap()).collect();
    assert_eq!(fractions, [0.5, 0.45, 0.4]);
}

/// Two SNs, a no-fly zone and a building: outlines of the area, the zone, and the building at the ground and at its
/// top.
#[test]
fn the_scene_has_all_sensor_nodes_with_labels_and_all_outlines() {
    let zones = "[[area.no_fly]]\npolygon_m = [[40.0, 1.0], [60.0, 1.0], [60.0, 99.0]]\n\
        [[area.building]]\npolygon_m = [[70.0, 1.0], [80.0, 1.0], [80.0, 9.0]]\nheight_m = 12.0\n";
    let run = run_in(zones, "x_m,y_m,name\n1,1,soil\n2,3,\n3,3,\n4,4,\n", &[(1.0, None)]);
    let scene = &json_messages(&run)["/scene"][0]["entities"][0];
    let texts: Vec<&str> =
        scene["texts"].as_array().unwrap().iter().map(|text| text["text"].as_str().unwrap()).collect();
    assert_eq!(texts, ["soil", "SN 1", "SN 2", "SN 3"]);
    assert_eq!(scene["spheres"][1]["pose"]["position"], serde_json::json!({ "x": 2.0, "y": 3.0, "z": 0.0 }));
    let corners = |line: &Value| line["points"].as_array().unwrap().len();
    assert_eq!(scene["lines"].as_array().unwrap().iter().map(corners).collect::<Vec<_>>(), [4, 3, 3, 3]);
    assert_eq!(scene["lines"][3]["points"][0]["z"], 12.0);
}

/// A `TFMessage` by hand: CDR header, one transform, stamp 1 s, `area` and `uav` with their length and zero, and, from
/// the next multiple of 8 after the header, seven floats.
#[test]
fn ros2_messages_have_cdr_alignment() {
    let log = messages(&mcap_ros2::FORMAT, &with_battery(run(&[(30.0, None)])));
    let schemas: Vec<(&str, &str)> = log.iter().map(|(topic, (schema, _))| (&topic[..], &schema[..])).collect();
    let expected = [
        ("/tf", "tf2_msgs/msg/TFMessage"),
        ("/uav/battery", "sensor_msgs/msg/BatteryState"),
        ("/uav/fix", "sensor_msgs/msg/NavSatFix"),
        ("/uav/path", "nav_msgs/msg/Path"),
        ("/uav/pose", "geometry_msgs/msg/PoseStamped"),
    ];
    assert_eq!(schemas, expected);
    let mut bytes = vec![0, 1, 0, 0];
    bytes.extend([1_u32, 1, 0, 5].iter().flat_map(|word| word.to_le_bytes()));
    bytes.extend(b"area\0\0\0\0\x04\0\0\0uav\0");
    assert_eq!((bytes.len() - 4) % 8, 0);
    bytes.extend([30.0, 0.0, 20.0, 0.0, 0.0, 0.0, 1.0_f64].iter().flat_map(|number| number.to_le_bytes()));
    assert_eq!(log["/tf"].1[1], bytes);
}

/// Only the path is published once, and kept for late subscribers.
#[test]
fn ros2_topics_have_a_quality_of_service() {
    let WriteFormat::Flight(write) = mcap_ros2::FORMAT.write else { panic!("a flight") };
    let log = write(&track(&with_battery(run(&[(30.0, None)]))));
    let mut latched = BTreeMap::new();
    for message in MessageStream::new(&log).unwrap() {
        let channel = message.unwrap().channel;
        let profile = &channel.metadata["offered_qos_profiles"];
        assert!(
            profile.starts_with("- history: 1\n  depth: ") && profile.contains("\n  reliability: 1\n"),
            "{profile}"
        );
        assert_eq!(profile.matches("\n    sec: 9223372036\n    nsec: 854775807\n").count(), 3, "{profile}");
        latched
            .insert(channel.topic.clone(), profile.contains("  depth: 1\n") && profile.contains("\n  durability: 1\n"));
    }
    let topics: Vec<&str> =
        latched.iter().filter(|(_, is_latched)| **is_latched).map(|(topic, _)| &topic[..]).collect();
    assert_eq!((topics, latched.len()), (vec!["/uav/path"], 5));
}

#[test]
fn the_scene_has_the_boundary_of_the_area() {
    let run = run_in("boundary_m = [[0.0, 0.0], [90.0, 0.0], [90.0, 90.0]]\n", "x_m,y_m\n1,1\n", &[(1.0, None)]);
    let scene = &json_messages(&run)["/scene"][0]["entities"][0];
    assert_eq!(scene["lines"][0]["points"].as_array().unwrap().len(), 3);
}
