//! Tests of the log. `python/benchmarks/logs.py` compares its messages with those of two decoders of ROS 2.

use std::collections::BTreeMap;

use mcap::MessageStream;
use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::super::format::WriteFormat;
use super::super::mcap::FORMAT;
use super::hills::{hills, hilly_list};
use super::*;

/// Second, nanosecond, and frame.
type Header = (i32, u32, String);

/// Position and orientation.
type Pose = ([f64; 3], [f64; 4]);

/// Stamp, status and service, latitude, longitude and altitude.
type Fix = (Header, (i8, u16), [f64; 3]);

/// Slot, mode, SNs, their number, bits delivered, lost and queued, and energy.
type Figures = (u64, String, Vec<u32>, u32, [u64; 3], f64);

/// Up to the text.
#[derive(Deserialize)]
struct Marker {
    _header: Header,
    namespace: String,
    id: i32,
    _shape: i32,
    _action: i32,
    pose: Pose,
    _scale_m: [f64; 3],
    _colour: [f32; 4],
    _lifetime: [u32; 2],
    _frame_locked: bool,
    points: Vec<[f64; 3]>,
    _colours: Vec<[f32; 4]>,
    _texture_resource: String,
    _texture: (Header, String, Vec<u8>),
    _texture_coordinates: Vec<[f32; 2]>,
    text: String,
    _mesh: (String, String, Vec<u8>, bool),
}

/// The messages of a log by topic, with the name of their schema.
fn messages(run: &RecordedRun) -> BTreeMap<String, (String, Vec<Vec<u8>>)> {
    let WriteFormat::Flight(write) = FORMAT.write else { panic!("{} is no flight", FORMAT.name) };
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

/// The messages of a topic, as far as `T` goes.
fn read<T: DeserializeOwned>(run: &RecordedRun, topic: &str) -> Vec<T> {
    let read = |bytes: &Vec<u8>| cdr_encoding::from_bytes::<T, byteorder::LittleEndian>(&bytes[4..]).unwrap().0;
    messages(run)[topic].1.iter().map(read).collect()
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
    let paths: Vec<(Header, Vec<(Header, Pose)>)> = read(&run, "/uav/path");
    let [(_, path)] = &paths[..] else { panic!("{paths:?}") };
    let poses: Vec<(Header, Pose)> = read(&run, "/uav/pose");
    let transforms: Vec<Vec<(Header, String, Pose)>> = read(&run, "/tf");
    assert_eq!(path, &poses);
    assert_eq!(poses.iter().map(|((second, ..), _)| *second).collect::<Vec<_>>(), [0, 1, 2, 3]);
    for (index, [x_m, z, w]) in
        [[0.0, 0.0, 1.0], [30.0, 0.0, 1.0], [30.0, 0.0, 1.0], [20.0, 1.0, 0.0]].iter().enumerate()
    {
        let (_, pose) = &poses[index];
        assert_eq!(&transforms[index][0].2, pose);
        let is_near = |value: f64, expected: &f64| (value - expected).abs() < 1e-12;
        let (position_m, orientation) = pose;
        assert!(is_near(position_m[0], x_m), "{index}: {pose:?}");
        assert!(is_near(orientation[2], z) && is_near(orientation[3], w), "{index}: {pose:?}");
    }
    assert!(!messages(&run).contains_key("/uav/battery"), "without a battery");
}

/// The first SN stands at the start, on ground of 200 m; the UAV flies 20 m above.
#[test]
fn a_fix_over_hills_adds_the_ground_height() {
    let steps = [(100.0, None), (50.0, None)];
    let altitudes_m =
        |run: &RecordedRun| read::<Fix>(run, "/uav/fix").iter().map(|(.., [.., up_m])| *up_m).collect::<Vec<f64>>();
    let hilly_m = altitudes_m(&run_in("", &hilly_list(), &steps));
    assert!((hilly_m[0] - (hills(0.0, 0.0) + 20.0)).abs() < 1e-9, "{hilly_m:?}");
    assert!((hilly_m[1] - (hills(100.0, 0.0) + 20.0)).abs() < 1e-9, "{hilly_m:?}");
    assert!((hilly_m[2] - (hills(150.0, 0.0) + 20.0)).abs() < 10.0, "{hilly_m:?}");
    assert_eq!(altitudes_m(&run(&steps)), [20.0; 3]);
}

#[test]
fn the_battery_state_is_a_fraction_from_the_first_message() {
    let run = with_battery(run(&[(30.0, None), (0.0, Some(1))]));
    let states: Vec<(Header, [f32; 6], f32)> = read(&run, "/uav/battery");
    assert_eq!(states.iter().map(|(.., fraction)| *fraction).collect::<Vec<_>>(), [0.5, 0.45, 0.4]);
}

/// The second slot serves SN 3, which uploads 7 bits.
#[test]
fn each_slot_has_its_figures() {
    let run = with_battery(run(&[(30.0, None), (0.0, Some(7))]));
    let slots: Vec<Figures> = read(&run, "/slot");
    let figures = |slot: &RecordedSlot| {
        let RecordedSlot { slot, mode, scheduled, delivered_bits, lost_bits, queued_bits, energy_j, .. } = slot.clone();
        let served = scheduled.len() as u32;
        (slot, mode.to_string(), scheduled, served, [delivered_bits, lost_bits, queued_bits], energy_j)
    };
    assert_eq!(slots, run.slots.iter().map(|slot| figures(&slot[UAV])).collect::<Vec<_>>());
    assert_eq!((slots[1].3, slots[1].5), (1, 800.0));
}

#[test]
fn the_map_has_the_features_of_geojson() {
    let run = run(&[(1.0, None)]);
    let maps: Vec<String> = read(&run, "/map");
    assert_eq!(maps, [super::super::geojson::collection(&track(&run))]);
}

/// Two SNs, a no-fly zone and a building: outlines of the area, the zone, and the building at the ground and at its
/// top.
#[test]
fn the_scene_has_all_sensor_nodes_with_labels_and_all_outlines() {
    let zones = "[[area.no_fly]]\npolygon_m = [[40.0, 1.0], [60.0, 1.0], [60.0, 99.0]]\n\
        [[area.building]]\npolygon_m = [[70.0, 1.0], [80.0, 1.0], [80.0, 9.0]]\nheight_m = 12.0\n";
    let run = run_in(zones, "x_m,y_m,name\n1,1,soil\n2,3,\n3,3,\n4,4,\n", &[(1.0, None)]);
    let scene = &read::<Vec<Marker>>(&run, "/scene")[0];
    let ids: Vec<i32> = scene.iter().map(|marker| marker.id).collect();
    assert_eq!(ids, [0, 1, 2, 3, 4, 5, 6, 7, 8]);
    let of = |namespace: &str| scene.iter().filter(|marker| marker.namespace == namespace).collect::<Vec<_>>();
    assert_eq!(of("names").iter().map(|name| name.text.as_str()).collect::<Vec<_>>(), ["soil", "SN 1", "SN 2", "SN 3"]);
    assert_eq!(of("names")[1].pose.0[..2], [2.0, 3.0]);
    assert_eq!(of("sensor nodes")[0].points[1], [2.0, 3.0, 0.0]);
    // Closed by their first corner.
    let outlines = of("outlines");
    assert_eq!(outlines.iter().map(|outline| outline.points.len()).collect::<Vec<_>>(), [5, 4, 4, 4]);
    assert!(outlines.iter().all(|outline| outline.points[0] == *outline.points.last().unwrap()));
    assert_eq!(outlines[3].points[0][2], 12.0);
}

/// A `TFMessage` by hand: CDR header, one transform, stamp 1 s, `area` and `uav` with their length and zero, and, from
/// the next multiple of 8 after the header, seven floats.
#[test]
fn ros2_messages_have_cdr_alignment() {
    let log = messages(&with_battery(run(&[(30.0, None)])));
    let schemas: Vec<(&str, &str)> = log.iter().map(|(topic, (schema, _))| (&topic[..], &schema[..])).collect();
    let expected = [
        ("/map", "foxglove_msgs/msg/GeoJSON"),
        ("/scene", "visualization_msgs/msg/MarkerArray"),
        ("/slot", "skysink_msgs/msg/Slot"),
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

/// What does not change is published once, and kept for late subscribers.
#[test]
fn ros2_topics_have_a_quality_of_service() {
    let WriteFormat::Flight(write) = FORMAT.write else { panic!("a flight") };
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
    assert_eq!((topics, latched.len()), (vec!["/map", "/scene", "/uav/path"], 8));
}

#[test]
fn the_scene_has_the_boundary_of_the_area() {
    let run = run_in("boundary_m = [[0.0, 0.0], [90.0, 0.0], [90.0, 90.0]]\n", "x_m,y_m\n1,1\n", &[(1.0, None)]);
    assert_eq!(read::<Vec<Marker>>(&run, "/scene")[0][0].points.len(), 4, "closed by its first corner");
}
