//! MCAP with ROS 2 messages, for `ros2 bag`, RViz, PlotJuggler and Foxglove: path, pose, transform and position, map
//! and scene, battery, and the figures of each slot.

use std::collections::BTreeMap;
use std::io::Cursor;

use mcap::records::MessageHeader;
use mcap::{WriteOptions, Writer};
use serde::Serialize;
use skysink_common::battery::Battery;

use super::format::{ExportFormat, WriteFormat};
use super::ros2::{
    GeoJson, NavSatFix, PoseStamped, RosBattery, RosHeader, RosPath, RosPose, SlotFigures, TransformStamped,
    definition, encode, nanoseconds,
};
use super::scene;
use super::track::{GeodeticTrack, TrackPoint};

/// Messages of ROS 2, with their definitions.
pub static FORMAT: ExportFormat = ExportFormat {
    name: "mcap",
    about: "MCAP with ROS 2 messages, for ros2 bag, RViz and Foxglove: path, pose and position over time, map, scene, \
            battery, queue figures",
    extension: "mcap",
    write: WriteFormat::Flight(write),
};

/// The frame of poses: origin in the south-west corner of the area, x east, y north, z up from the ground.
pub const AREA: &str = "area";

/// The frame of the UAV: x forward, y left, z up.
const UAV: &str = "uav";

/// A topic of the log.
struct LogTopic {
    name: &'static str,
    /// The type of its messages.
    schema: &'static str,
    /// Whether its only message is sent at the start, and kept for subscribers that come later.
    is_latched: bool,
}

impl LogTopic {
    const fn new(name: &'static str, schema: &'static str) -> Self {
        Self { name, schema, is_latched: false }
    }

    const fn latched(name: &'static str, schema: &'static str) -> Self {
        Self { name, schema, is_latched: true }
    }
}

const MAP: LogTopic = LogTopic::latched("/map", "foxglove_msgs/msg/GeoJSON");
const SCENE: LogTopic = LogTopic::latched("/scene", "visualization_msgs/msg/MarkerArray");
const PATH: LogTopic = LogTopic::latched("/uav/path", "nav_msgs/msg/Path");
const TRANSFORM: LogTopic = LogTopic::new("/tf", "tf2_msgs/msg/TFMessage");
const POSE: LogTopic = LogTopic::new("/uav/pose", "geometry_msgs/msg/PoseStamped");
const FIX: LogTopic = LogTopic::new("/uav/fix", "sensor_msgs/msg/NavSatFix");
const BATTERY: LogTopic = LogTopic::new("/uav/battery", "sensor_msgs/msg/BatteryState");
const SLOT: LogTopic = LogTopic::new("/slot", "skysink_msgs/msg/Slot");

fn write(track: &GeodeticTrack<'_>) -> Vec<u8> {
    let mut log = Log::new();
    let altitudes_m = track.altitudes_m();
    let battery = Battery::finite(&track.run.scenario);
    let poses = track.points.iter().zip(track.attitudes());
    let poses: Vec<RosPose> = poses.map(|(point, attitude)| RosPose::new(&point.position, &attitude)).collect();
    let stamped =
        |(point, &pose): (&TrackPoint<'_>, &RosPose)| PoseStamped { header: RosHeader::new(point.time_s, AREA), pose };
    // What does not change is there from the start: a viewer shows the latest message before the time it shows.
    log.add(&MAP, 0, 0.0, &GeoJson { geojson: super::geojson::collection(track) });
    log.add(&SCENE, 0, 0.0, &scene::markers(track));
    let path = track.points.iter().zip(&poses).map(stamped).collect();
    log.add(&PATH, 0, 0.0, &RosPath { header: RosHeader::new(0.0, AREA), poses: path });
    for (index, point) in track.points.iter().enumerate() {
        let sequence = index as u32;
        let time_s = point.time_s;
        let header = |frame_id| RosHeader::new(time_s, frame_id);
        let transform = TransformStamped { header: header(AREA), child_frame_id: UAV, transform: poses[index] };
        log.add(&TRANSFORM, sequence, time_s, &vec![transform]);
        log.add(&POSE, sequence, time_s, &stamped((point, &poses[index])));
        log.add(&FIX, sequence, time_s, &NavSatFix::new(header(UAV), point.place, altitudes_m[index]));
        if let Some(battery) = &battery {
            log.add(&BATTERY, sequence, time_s, &RosBattery::new(header(UAV), battery, point.slot));
        }
        if let Some(slot) = point.slot {
            log.add(&SLOT, sequence, time_s, &SlotFigures::of(slot));
        }
    }
    log.finish()
}

/// Why writing cannot fail.
const TO_MEMORY: &str = "memory takes everything, and ids are few";

/// A log under construction. A mission has no date: its time starts at 0.
struct Log {
    writer: Writer<Cursor<Vec<u8>>>,
    /// By topic.
    channels: BTreeMap<&'static str, u16>,
}

impl Log {
    fn new() -> Self {
        let library = format!("skysink {}", env!("CARGO_PKG_VERSION"));
        let options = WriteOptions::new().compression(None).profile("ros2").library(library);
        let writer = options.create(Cursor::new(Vec::new())).expect(TO_MEMORY);
        Self { writer, channels: BTreeMap::new() }
    }

    /// Adds a message. The first message of a topic also adds the topic and its schema.
    fn add(&mut self, topic: &LogTopic, sequence: u32, time_s: f64, message: &impl Serialize) {
        let writer = &mut self.writer;
        let channel_id = *self.channels.entry(topic.name).or_insert_with(|| {
            let schema_id = writer.add_schema(topic.schema, "ros2msg", &definition(topic.schema)).expect(TO_MEMORY);
            let metadata = BTreeMap::from([("offered_qos_profiles".to_owned(), quality_of_service(topic))]);
            writer.add_channel(schema_id, topic.name, "cdr", &metadata).expect(TO_MEMORY)
        });
        let time_ns = nanoseconds(time_s);
        let header = MessageHeader { channel_id, sequence, log_time: time_ns, publish_time: time_ns };
        self.writer.write_to_known_channel(&header, &encode(message)).expect(TO_MEMORY);
    }

    /// The bytes of the file.
    fn finish(mut self) -> Vec<u8> {
        self.writer.finish().expect(TO_MEMORY);
        self.writer.into_inner().into_inner()
    }
}

/// The quality of service of a topic, as rosbag2 stores it in YAML by the numbers of `rmw/types.h`: reliable, and the
/// last messages kept; of a latched topic also for those who subscribe later (transient local).
fn quality_of_service(topic: &LogTopic) -> String {
    let (depth, durability) = if topic.is_latched { (1, 1) } else { (10, 2) };
    let unlimited = "\n    sec: 9223372036\n    nsec: 854775807";
    format!(
        "- history: 1\n  depth: {depth}\n  reliability: 1\n  durability: {durability}\n  deadline:{unlimited}\n  \
         lifespan:{unlimited}\n  liveliness: 1\n  liveliness_lease_duration:{unlimited}\n  \
         avoid_ros_namespace_conventions: false\n"
    )
}
