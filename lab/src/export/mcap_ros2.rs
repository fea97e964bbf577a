//! MCAP with ROS 2 messages, for `ros2 bag`, RViz and PlotJuggler: path, pose, transform, position and battery.
//!
//! The structs have the fields of the message definitions in [`DEFINITIONS`], in their order: CDR has no names.

use std::collections::BTreeMap;

use cdr_encoding::{Error, to_vec};
use nalgebra::{Point3, UnitQuaternion};
use serde::Serialize;

use super::format::{ExportFormat, WriteFormat};
use super::mcap_log::{AREA, Log, LogEncoding, LogTopic, UAV, seconds_and_nanoseconds};
use super::track::{BatteryLevel, GeodeticTrack, TrackPoint};

/// The log.
pub static FORMAT: ExportFormat = ExportFormat {
    name: "mcap-ros2",
    about: "MCAP with ROS 2 messages, for ros2 bag and RViz: path, pose, transform, position, battery",
    extension: "ros2.mcap",
    write: WriteFormat::Flight(write),
};

const ENCODING: LogEncoding = LogEncoding { profile: "ros2", schema: "ros2msg", message: "cdr", metadata };

const PATH: LogTopic = LogTopic { name: "/uav/path", schema: "nav_msgs/msg/Path" };
const TRANSFORM: LogTopic = LogTopic { name: "/tf", schema: "tf2_msgs/msg/TFMessage" };
const POSE: LogTopic = LogTopic { name: "/uav/pose", schema: "geometry_msgs/msg/PoseStamped" };
const FIX: LogTopic = LogTopic { name: "/uav/fix", schema: "sensor_msgs/msg/NavSatFix" };
const BATTERY: LogTopic = LogTopic { name: "/uav/battery", schema: "sensor_msgs/msg/BatteryState" };

/// The quality of service of a topic, as rosbag2 stores it in YAML by the numbers of `rmw/types.h`: reliable, and the
/// last messages kept. The path, which is published once, is kept for those who subscribe later (transient local).
fn metadata(topic: &LogTopic) -> BTreeMap<String, String> {
    let (depth, durability) = if topic.name == PATH.name { (1, 1) } else { (10, 2) };
    let unlimited = "\n    sec: 9223372036\n    nsec: 854775807";
    let profile = format!(
        "- history: 1\n  depth: {depth}\n  reliability: 1\n  durability: {durability}\n  deadline:{unlimited}\n  \
         lifespan:{unlimited}\n  liveliness: 1\n  liveliness_lease_duration:{unlimited}\n  \
         avoid_ros_namespace_conventions: false\n"
    );
    BTreeMap::from([("offered_qos_profiles".to_owned(), profile)])
}

/// The fields of the messages, by type; a type is named with its package.
const DEFINITIONS: [(&str, &str); 14] = [
    ("nav_msgs/Path", "std_msgs/Header header\ngeometry_msgs/PoseStamped[] poses"),
    ("tf2_msgs/TFMessage", "geometry_msgs/TransformStamped[] transforms"),
    (
        "sensor_msgs/NavSatFix",
        "std_msgs/Header header\nsensor_msgs/NavSatStatus status\nfloat64 latitude\nfloat64 longitude\n\
         float64 altitude\nfloat64[9] position_covariance\nuint8 position_covariance_type",
    ),
    (
        "sensor_msgs/BatteryState",
        "std_msgs/Header header\nfloat32 voltage\nfloat32 temperature\nfloat32 current\nfloat32 charge\n\
         float32 capacity\nfloat32 design_capacity\nfloat32 percentage\nuint8 power_supply_status\n\
         uint8 power_supply_health\nuint8 power_supply_technology\nbool present\nfloat32[] cell_voltage\n\
         float32[] cell_temperature\nstring location\nstring serial_number",
    ),
    ("geometry_msgs/PoseStamped", "std_msgs/Header header\ngeometry_msgs/Pose pose"),
    (
        "geometry_msgs/TransformStamped",
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform",
    ),
    ("geometry_msgs/Pose", "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation"),
    ("geometry_msgs/Transform", "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation"),
    ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z"),
    ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z"),
    ("geometry_msgs/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w"),
    ("sensor_msgs/NavSatStatus", "int8 status\nuint16 service"),
    ("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id"),
    ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec"),
];

#[derive(Serialize, Default)]
struct Header {
    sec: i32,
    nanosec: u32,
    frame_id: &'static str,
}

/// A `Pose`, and a `Transform`, which has the same fields.
#[derive(Serialize, Clone, Copy)]
struct RosPose {
    position: [f64; 3],
    /// x, y, z, w.
    orientation: [f64; 4],
}

#[derive(Serialize)]
struct PoseStamped {
    header: Header,
    pose: RosPose,
}

#[derive(Serialize)]
struct RosPath {
    header: Header,
    poses: Vec<PoseStamped>,
}

#[derive(Serialize)]
struct TransformStamped {
    header: Header,
    child_frame_id: &'static str,
    transform: RosPose,
}

#[derive(Serialize, Default)]
struct NavSatFix {
    header: Header,
    /// 0: a fix.
    status: i8,
    /// 1: GPS.
    service: u16,
    latitude_deg: f64,
    longitude_deg: f64,
    altitude_m: f64,
    position_covariance_m2: [f64; 9],
    /// 0: unknown.
    position_covariance_type: u8,
}

#[derive(Serialize, Default)]
struct BatteryState {
    header: Header,
    /// Voltage, temperature, current, charge, capacity and design capacity: not a number, which says that they are not
    /// measured.
    not_measured: [f32; 6],
    /// 0 to 1.
    percentage: f32,
    power_supply_status: u8,
    /// 0: unknown.
    power_supply_health: u8,
    /// 0: unknown.
    power_supply_technology: u8,
    present: bool,
    cell_voltage: Vec<f32>,
    cell_temperature: Vec<f32>,
    location: &'static str,
    serial_number: &'static str,
}

fn write(track: &GeodeticTrack<'_>) -> Vec<u8> {
    let mut log = Log::new(&ENCODING);
    let mut add = |topic: &LogTopic, sequence: u32, time_s: f64, message: Result<Vec<u8>, Error>| {
        // The header of CDR: little-endian, no options.
        let bytes = [&[0, 1, 0, 0], &message.expect("lists have lengths")[..]].concat();
        log.write(topic, sequence, time_s, &bytes, || definition(&topic.schema.replace("/msg/", "/")));
    };
    let altitudes_m = track.altitudes_m();
    let attitudes = track.attitudes();
    let poses: Vec<RosPose> =
        track.points.iter().zip(&attitudes).map(|(point, attitude)| pose(&point.position, attitude)).collect();
    let stamped =
        |(point, &pose): (&TrackPoint<'_>, &RosPose)| PoseStamped { header: header(point.time_s, AREA), pose };
    // From the start, for viewers that show the latest message.
    let path = RosPath { header: header(0.0, AREA), poses: track.points.iter().zip(&poses).map(stamped).collect() };
    add(&PATH, 0, 0.0, little_endian(&path));
    for (index, point) in track.points.iter().enumerate() {
        let sequence = index as u32;
        let time_s = point.time_s;
        let transform = TransformStamped { header: header(time_s, AREA), child_frame_id: UAV, transform: poses[index] };
        add(&TRANSFORM, sequence, time_s, little_endian(&vec![transform]));
        add(&POSE, sequence, time_s, little_endian(&stamped((point, &poses[index]))));
        add(&FIX, sequence, time_s, little_endian(&fix(point, altitudes_m[index])));
        if let Some(level) = track.battery(point) {
            add(&BATTERY, sequence, time_s, little_endian(&battery(time_s, level)));
        }
    }
    log.finish()
}

fn little_endian(message: &impl Serialize) -> Result<Vec<u8>, Error> {
    to_vec::<_, byteorder::LittleEndian>(message)
}

fn header(time_s: f64, frame_id: &'static str) -> Header {
    let (sec, nanosec) = seconds_and_nanoseconds(time_s);
    Header { sec: sec as i32, nanosec: nanosec as u32, frame_id }
}

fn pose(position: &Point3<f64>, attitude: &UnitQuaternion<f64>) -> RosPose {
    RosPose { position: (*position).into(), orientation: attitude.coords.into() }
}

fn fix(point: &TrackPoint<'_>, altitude_m: f64) -> NavSatFix {
    NavSatFix {
        header: header(point.time_s, UAV),
        service: 1,
        latitude_deg: point.place.lat_deg,
        longitude_deg: point.place.lon_deg,
        altitude_m,
        ..NavSatFix::default()
    }
}

fn battery(time_s: f64, level: BatteryLevel) -> BatteryState {
    BatteryState {
        header: header(time_s, UAV),
        not_measured: [f32::NAN; 6],
        percentage: level.fraction as f32,
        power_supply_status: level.power_supply_status(),
        present: true,
        ..BatteryState::default()
    }
}

/// The definition of a message with those of all types in it, each after a line of equals signs.
fn definition(name: &str) -> Vec<u8> {
    let fields = |name: &str| DEFINITIONS.iter().find(|(other, _)| *other == name).map(|(_, fields)| *fields);
    let mut names = vec![name.to_owned()];
    let mut text = String::new();
    let mut index = 0;
    while let Some(name) = names.get(index).cloned() {
        let fields = fields(&name).expect("all types of fields are defined");
        if index > 0 {
            text += &format!("{}\nMSG: {name}\n", "=".repeat(80));
        }
        text += &format!("{fields}\n");
        let types = fields.lines().filter_map(|line| line.split(['[', ' ']).next()).filter(|name| name.contains('/'));
        for name in types.map(str::to_owned) {
            if !names.contains(&name) {
                names.push(name);
            }
        }
        index += 1;
    }
    text.into_bytes()
}
