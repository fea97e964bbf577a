//! Messages of ROS 2: their definitions and their bytes.
//!
//! The structs have the fields of the message definitions in [`DEFINITIONS`], in their order: CDR has no names.

use std::collections::VecDeque;

use cdr_encoding::to_vec;
use nalgebra::{Point3, UnitQuaternion};
use serde::Serialize;
use skysink_common::battery::Battery;
use skysink_common::geodata::projection::GeodeticPosition;
use skysink_common::message::Mode;
use skysink_mission::trace::RecordedSlot;

/// The fields of the messages, by type; a type is named with its package.
const DEFINITIONS: &str = include_str!("ros2.msg");

/// A time, and the frame of a message.
#[derive(Debug, Serialize, Default)]
pub struct RosHeader {
    sec: i32,
    nanosec: u32,
    frame_id: &'static str,
}

impl RosHeader {
    /// The header of a message at a time since the start of the mission.
    pub fn new(time_s: f64, frame_id: &'static str) -> Self {
        let time_ns = nanoseconds(time_s);
        Self { sec: (time_ns / 1_000_000_000) as i32, nanosec: (time_ns % 1_000_000_000) as u32, frame_id }
    }
}

/// A `Pose`, and a `Transform`, which has the same fields.
#[derive(Debug, Serialize, Clone, Copy)]
pub struct RosPose {
    position: [f64; 3],
    /// x, y, z, w.
    orientation: [f64; 4],
}

impl RosPose {
    /// The pose of a body at a position.
    pub fn new(position: &Point3<f64>, attitude: &UnitQuaternion<f64>) -> Self {
        Self { position: (*position).into(), orientation: attitude.coords.into() }
    }
}

/// A pose at a time.
#[derive(Debug, Serialize)]
pub struct PoseStamped {
    pub header: RosHeader,
    pub pose: RosPose,
}

/// Poses at several times.
#[derive(Debug, Serialize)]
pub struct RosPath {
    pub header: RosHeader,
    pub poses: Vec<PoseStamped>,
}

/// Where a frame is in another.
#[derive(Debug, Serialize)]
pub struct TransformStamped {
    pub header: RosHeader,
    pub child_frame_id: &'static str,
    pub transform: RosPose,
}

/// A position by a satellite receiver.
#[derive(Debug, Serialize, Default)]
pub struct NavSatFix {
    header: RosHeader,
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

impl NavSatFix {
    /// The fix at a position on the ground and an altitude.
    pub fn new(header: RosHeader, place: GeodeticPosition, altitude_m: f64) -> Self {
        let GeodeticPosition { lat_deg, lon_deg } = place;
        Self { header, service: 1, latitude_deg: lat_deg, longitude_deg: lon_deg, altitude_m, ..Self::default() }
    }
}

/// What is left in a battery.
#[derive(Debug, Serialize, Default)]
pub struct RosBattery {
    header: RosHeader,
    /// Voltage, temperature, current, charge, capacity and design capacity: not a number, which says that they are not
    /// measured.
    not_measured: [f32; 6],
    /// 0 to 1.
    percentage: f32,
    /// 1: charging, 2: discharging.
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

impl RosBattery {
    /// The state of a battery at the start or after `slot`.
    pub fn new(header: RosHeader, battery: &Battery, slot: Option<&RecordedSlot>) -> Self {
        let energy_j = slot.map_or(battery.initial_j, |slot| slot.energy_j);
        let is_charging = slot.is_some_and(|slot| slot.mode == Mode::Charge);
        Self {
            header,
            not_measured: [f32::NAN; 6],
            percentage: (energy_j / battery.capacity_j) as f32,
            power_supply_status: if is_charging { 1 } else { 2 },
            present: true,
            ..Self::default()
        }
    }
}

/// The figures of a slot.
#[derive(Debug, Serialize)]
pub struct SlotFigures<'a> {
    slot: u64,
    mode: String,
    scheduled: &'a [u32],
    served: u32,
    delivered_bits: u64,
    lost_bits: u64,
    queued_bits: u64,
    /// Infinite without a battery.
    energy_j: f64,
}

impl<'a> SlotFigures<'a> {
    /// The figures of a recorded slot.
    pub fn of(recorded: &'a RecordedSlot) -> Self {
        let RecordedSlot { slot, delivered_bits, lost_bits, queued_bits, energy_j, .. } = *recorded;
        let scheduled = &recorded.scheduled[..];
        let served = scheduled.len() as u32;
        Self {
            slot,
            mode: recorded.mode.to_string(),
            scheduled,
            served,
            delivered_bits,
            lost_bits,
            queued_bits,
            energy_j,
        }
    }
}

/// A shape or a text of a scene.
#[derive(Debug, Serialize, Default)]
pub struct Marker {
    pub header: RosHeader,
    pub namespace: &'static str,
    pub id: i32,
    pub shape: i32,
    /// 0: add.
    pub action: i32,
    pub position: [f64; 3],
    /// x, y, z, w.
    pub orientation: [f64; 4],
    pub scale_m: [f64; 3],
    /// Red, green, blue, opacity [0 to 1].
    pub colour: [f32; 4],
    /// 0: for ever.
    pub lifetime: [u32; 2],
    pub frame_locked: bool,
    pub points: Vec<[f64; 3]>,
    pub colours: Vec<[f32; 4]>,
    pub texture_resource: &'static str,
    pub texture: CompressedImage,
    pub texture_coordinates: Vec<[f32; 2]>,
    pub text: String,
    pub mesh_resource: &'static str,
    pub mesh_file: &'static str,
    pub mesh_data: Vec<u8>,
    pub has_mesh_materials: bool,
}

/// A picture; there is none.
#[derive(Debug, Serialize, Default)]
pub struct CompressedImage {
    header: RosHeader,
    format: &'static str,
    data: Vec<u8>,
}

/// The features of a map as text.
#[derive(Debug, Serialize)]
pub struct GeoJson {
    pub geojson: String,
}

/// A time since the start [ns].
pub fn nanoseconds(time_s: f64) -> u64 {
    (time_s * 1e9).round() as u64
}

/// The bytes of a message: the header of CDR, which says little-endian without options, and the fields.
pub fn encode(message: &impl Serialize) -> Vec<u8> {
    let fields = to_vec::<_, byteorder::LittleEndian>(message).expect("lists have lengths");
    [&[0, 1, 0, 0], &fields[..]].concat()
}

/// The definition of a message `PACKAGE/msg/NAME`, with those of all types in it, each after a line of equals signs.
pub fn definition(schema: &str) -> Vec<u8> {
    let fields = |name: &str| {
        let found = DEFINITIONS.split("\n\n").find_map(|it| it.strip_prefix(&format!("MSG: {name}\n")));
        found.expect("all types of fields are defined").trim_end()
    };
    let mut names = vec![schema.replace("/msg/", "/")];
    let mut text = fields(&names[0]).to_owned() + "\n";
    let mut open = fields(&names[0]).lines().collect::<VecDeque<_>>();
    while let Some(field) = open.pop_front() {
        let name = field.split(['[', ' ']).next().unwrap_or_default();
        if name.contains('/') && !names.iter().any(|other| other == name) {
            names.push(name.to_owned());
            text += &format!("{}\nMSG: {name}\n{}\n", "=".repeat(80), fields(name));
            open.extend(fields(name).lines());
        }
    }
    text.into_bytes()
}
