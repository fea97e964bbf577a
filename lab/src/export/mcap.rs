//! MCAP with JSON messages, for Foxglove: position, pose, the map's features, and the figures of each slot.
//!
//! Foxglove identifies messages by the name of their schema, such as `foxglove.LocationFix`. The schemas here contain
//! only the fields that are written. A mission has no date: its time starts at 0.

use std::collections::BTreeMap;
use std::io::Cursor;

use mcap::records::MessageHeader;
use mcap::{WriteOptions, Writer};
use serde_json::{Map, Value, json};

use super::format::{ExportFormat, WriteFormat};
use super::track::{GeodeticTrack, TrackPoint};

/// The log.
pub static FORMAT: ExportFormat = ExportFormat {
    name: "mcap",
    about: "MCAP, for Foxglove: position and pose over time, map, queue figures",
    extension: "mcap",
    write: WriteFormat::Flight(write),
};

/// The frame of poses: origin in the south-west corner of the area, x east, y north, z up.
const FRAME: &str = "area";

/// A topic of the log.
struct LogTopic {
    name: &'static str,
    /// The name of the schema of its messages.
    schema: &'static str,
}

const MAP: LogTopic = LogTopic { name: "/map", schema: "foxglove.GeoJSON" };
const FIX: LogTopic = LogTopic { name: "/uav/fix", schema: "foxglove.LocationFix" };
const POSE: LogTopic = LogTopic { name: "/uav/pose", schema: "foxglove.PoseInFrame" };
const SLOT: LogTopic = LogTopic { name: "/slot", schema: "skysink.Slot" };

fn write(track: &GeodeticTrack<'_>) -> Vec<u8> {
    let library = format!("skysink {}", env!("CARGO_PKG_VERSION"));
    let options = WriteOptions::new().compression(None).library(library);
    let writer = options.create(Cursor::new(Vec::new())).expect(TO_MEMORY);
    let mut log = Log { writer, channels: BTreeMap::new() };
    let map = json!({ "geojson": super::geojson::collection(track) });
    log.write(&MAP, 0, 0.0, &map);
    for (sequence, point) in (0..).zip(&track.points) {
        let time_s = point.time_s;
        log.write(&FIX, sequence, time_s, &fix(point));
        log.write(&POSE, sequence, time_s, &pose(point));
        if let Some(slot) = point.slot {
            let mut figures = json!({
                "slot": slot.slot, "mode": slot.mode.to_string(), "scheduled": slot.scheduled,
                "served": slot.scheduled.len(), "delivered_bits": slot.delivered_bits, "lost_bits": slot.lost_bits,
                "queued_bits": slot.queued_bits,
            });
            if slot.energy_j.is_finite() {
                figures["energy_j"] = json!(slot.energy_j);
            }
            log.write(&SLOT, sequence, time_s, &figures);
        }
    }
    log.writer.finish().expect(TO_MEMORY);
    log.writer.into_inner().into_inner()
}

fn fix(point: &TrackPoint<'_>) -> Value {
    json!({
        "timestamp": timestamp(point.time_s), "frame_id": FRAME,
        "latitude": point.place.lat_deg, "longitude": point.place.lon_deg, "altitude": point.position.z,
        "position_covariance": vec![0.0; 9], "position_covariance_type": 0,
    })
}

fn pose(point: &TrackPoint<'_>) -> Value {
    let position = point.position;
    json!({
        "timestamp": timestamp(point.time_s), "frame_id": FRAME,
        "pose": {
            "position": { "x": position.x, "y": position.y, "z": position.z },
            "orientation": { "x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0 },
        },
    })
}

fn timestamp(time_s: f64) -> Value {
    let time_ns = nanoseconds(time_s);
    json!({ "sec": time_ns / 1_000_000_000, "nsec": time_ns % 1_000_000_000 })
}

fn nanoseconds(time_s: f64) -> u64 {
    (time_s * 1e9).round() as u64
}

/// Why writing cannot fail.
const TO_MEMORY: &str = "memory takes everything, and ids are few";

/// A log under construction.
struct Log {
    writer: Writer<Cursor<Vec<u8>>>,
    /// By topic.
    channels: BTreeMap<&'static str, u16>,
}

impl Log {
    /// Adds a message. The first message of a topic also adds the topic and its schema.
    fn write(&mut self, topic: &LogTopic, sequence: u32, time_s: f64, message: &Value) {
        let writer = &mut self.writer;
        let channel_id = *self.channels.entry(topic.name).or_insert_with(|| {
            let text = serde_json::to_vec(&schema_of(topic.schema, message)).expect("plain strings");
            let schema = writer.add_schema(topic.schema, "jsonschema", &text).expect(TO_MEMORY);
            writer.add_channel(schema, topic.name, "json", &BTreeMap::new()).expect(TO_MEMORY)
        });
        let time_ns = nanoseconds(time_s);
        let header = MessageHeader { channel_id, sequence, log_time: time_ns, publish_time: time_ns };
        let message = serde_json::to_vec(message).expect("plain numbers and strings");
        self.writer.write_to_known_channel(&header, &message).expect(TO_MEMORY);
    }
}

/// The JSON schema of a message.
fn schema_of(name: &str, message: &Value) -> Value {
    let mut schema = type_of(message);
    schema["title"] = json!(name);
    schema["$schema"] = json!("https://json-schema.org/draft/2020-12/schema");
    schema
}

fn type_of(value: &Value) -> Value {
    match value {
        Value::Object(fields) => {
            let properties: Map<_, _> = fields.iter().map(|(name, field)| (name.clone(), type_of(field))).collect();
            json!({ "type": "object", "properties": properties })
        }
        // A list may be empty in the first message; all lists contain numbers.
        Value::Array(_) => json!({ "type": "array", "items": { "type": "number" } }),
        Value::String(_) => json!({ "type": "string" }),
        number => json!({ "type": if number.is_u64() { "integer" } else { "number" } }),
    }
}
