//! MCAP with JSON messages, for Foxglove: path, pose, transform and position, map and scene, battery, and the figures
//! of each slot.
//!
//! Foxglove identifies messages by the name of their schema, such as `foxglove.LocationFix`. The schemas here contain
//! only the fields that are written.

use nalgebra::{Point3, UnitQuaternion};
use serde_json::{Map, Value, json};

use super::format::{ExportFormat, WriteFormat};
use super::mcap_log::{AREA, Log, LogEncoding, LogTopic, UAV, seconds_and_nanoseconds};
use super::scene;
use super::track::{GeodeticTrack, TrackPoint};

/// The log.
pub static FORMAT: ExportFormat = ExportFormat {
    name: "mcap",
    about: "MCAP, for Foxglove: path, pose and position over time, map, scene, battery, queue figures",
    extension: "mcap",
    write: WriteFormat::Flight(write),
};

const ENCODING: LogEncoding =
    LogEncoding { profile: "", schema: "jsonschema", message: "json", metadata: |_| std::collections::BTreeMap::new() };

const MAP: LogTopic = LogTopic { name: "/map", schema: "foxglove.GeoJSON" };
const SCENE: LogTopic = LogTopic { name: "/scene", schema: "foxglove.SceneUpdate" };
const PATH: LogTopic = LogTopic { name: "/uav/path", schema: "foxglove.PosesInFrame" };
const TRANSFORM: LogTopic = LogTopic { name: "/tf", schema: "foxglove.FrameTransform" };
const FIX: LogTopic = LogTopic { name: "/uav/fix", schema: "foxglove.LocationFix" };
const POSE: LogTopic = LogTopic { name: "/uav/pose", schema: "foxglove.PoseInFrame" };
const BATTERY: LogTopic = LogTopic { name: "/uav/battery", schema: "skysink.Battery" };
const SLOT: LogTopic = LogTopic { name: "/slot", schema: "skysink.Slot" };

fn write(track: &GeodeticTrack<'_>) -> Vec<u8> {
    let mut log = Log::new(&ENCODING);
    let mut add = |topic: &LogTopic, sequence: u32, time_s: f64, message: &Value| {
        let bytes = serde_json::to_vec(message).expect("plain numbers and strings");
        log.write(topic, sequence, time_s, &bytes, || schema_of(topic.schema, message));
    };
    let attitudes = track.attitudes();
    let altitudes_m = track.altitudes_m();
    // What does not change is there from the start: a viewer shows the latest message before the time it shows.
    add(&MAP, 0, 0.0, &json!({ "geojson": super::geojson::collection(track) }));
    add(&SCENE, 0, 0.0, &scene::update(track));
    let poses: Vec<_> = track.points.iter().zip(&attitudes).map(|(point, to)| pose(&point.position, to)).collect();
    add(&PATH, 0, 0.0, &json!({ "timestamp": timestamp(0.0), "frame_id": AREA, "poses": poses }));
    for (index, point) in track.points.iter().enumerate() {
        let sequence = index as u32;
        let time_s = point.time_s;
        add(&TRANSFORM, sequence, time_s, &transform(point, &attitudes[index]));
        add(&FIX, sequence, time_s, &fix(point, altitudes_m[index]));
        let posed = json!({ "timestamp": timestamp(time_s), "frame_id": AREA, "pose": poses[index] });
        add(&POSE, sequence, time_s, &posed);
        if let Some(level) = track.battery(point) {
            let battery = json!({
                "timestamp": timestamp(time_s), "percentage": level.fraction, "energy_j": level.energy_j,
                "power_supply_status": level.power_supply_status(),
            });
            add(&BATTERY, sequence, time_s, &battery);
        }
        if let Some(slot) = point.slot {
            let mut figures = json!({
                "slot": slot.slot, "mode": slot.mode.to_string(), "scheduled": slot.scheduled,
                "served": slot.scheduled.len(), "delivered_bits": slot.delivered_bits, "lost_bits": slot.lost_bits,
                "queued_bits": slot.queued_bits,
            });
            if slot.energy_j.is_finite() {
                figures["energy_j"] = json!(slot.energy_j);
            }
            add(&SLOT, sequence, time_s, &figures);
        }
    }
    log.finish()
}

fn fix(point: &TrackPoint<'_>, altitude_m: f64) -> Value {
    json!({
        "timestamp": timestamp(point.time_s), "frame_id": UAV,
        "latitude": point.place.lat_deg, "longitude": point.place.lon_deg, "altitude": altitude_m,
        "position_covariance": vec![0.0; 9], "position_covariance_type": 0,
    })
}

fn transform(point: &TrackPoint<'_>, attitude: &UnitQuaternion<f64>) -> Value {
    json!({
        "timestamp": timestamp(point.time_s), "parent_frame_id": AREA, "child_frame_id": UAV,
        "translation": vector(&point.position), "rotation": quaternion(attitude),
    })
}

/// A `foxglove.Pose`.
pub(super) fn pose(position: &Point3<f64>, attitude: &UnitQuaternion<f64>) -> Value {
    json!({ "position": vector(position), "orientation": quaternion(attitude) })
}

/// A `foxglove.Vector3`.
pub(super) fn vector(point: &Point3<f64>) -> Value {
    json!({ "x": point.x, "y": point.y, "z": point.z })
}

fn quaternion(attitude: &UnitQuaternion<f64>) -> Value {
    json!({ "x": attitude.i, "y": attitude.j, "z": attitude.k, "w": attitude.w })
}

/// A time since the start.
pub(super) fn timestamp(time_s: f64) -> Value {
    let (sec, nsec) = seconds_and_nanoseconds(time_s);
    json!({ "sec": sec, "nsec": nsec })
}

/// The JSON schema of a message.
fn schema_of(name: &str, message: &Value) -> Vec<u8> {
    let mut schema = type_of(message);
    schema["title"] = json!(name);
    schema["$schema"] = json!("https://json-schema.org/draft/2020-12/schema");
    serde_json::to_vec(&schema).expect("plain strings")
}

fn type_of(value: &Value) -> Value {
    match value {
        Value::Object(fields) => {
            let properties: Map<_, _> = fields.iter().map(|(name, field)| (name.clone(), type_of(field))).collect();
            json!({ "type": "object", "properties": properties })
        }
        // A list may be empty in the first message; those contain numbers.
        Value::Array(items) => {
            let items = items.first().map_or_else(|| json!({ "type": "number" }), type_of);
            json!({ "type": "array", "items": items })
        }
        Value::String(_) => json!({ "type": "string" }),
        Value::Bool(_) => json!({ "type": "boolean" }),
        number => json!({ "type": if number.is_u64() { "integer" } else { "number" } }),
    }
}
