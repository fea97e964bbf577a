//! What the MCAP formats have in common: topics, schemas and messages in time.

use std::collections::BTreeMap;
use std::io::Cursor;

use mcap::records::MessageHeader;
use mcap::{WriteOptions, Writer};

/// The frame of poses: origin in the south-west corner of the area, x east, y north, z up from the ground.
pub const AREA: &str = "area";

/// The frame of the UAV: x forward, y left, z up.
pub const UAV: &str = "uav";

/// A topic of a log.
#[derive(Debug)]
pub struct LogTopic {
    /// Its name.
    pub name: &'static str,
    /// The name of the schema of its messages.
    pub schema: &'static str,
}

/// How schemas and messages are encoded, by the names of the MCAP registry.
#[derive(Debug)]
pub struct LogEncoding {
    /// The profile of the file.
    pub profile: &'static str,
    /// The encoding of its schemas.
    pub schema: &'static str,
    /// The encoding of its messages.
    pub message: &'static str,
    /// The metadata of the channel of a topic, names and values.
    pub metadata: fn(&LogTopic) -> BTreeMap<String, String>,
}

/// Why writing cannot fail.
const TO_MEMORY: &str = "memory takes everything, and ids are few";

/// A log under construction. A mission has no date: its time starts at 0.
pub struct Log {
    writer: Writer<Cursor<Vec<u8>>>,
    encoding: &'static LogEncoding,
    /// By topic.
    channels: BTreeMap<&'static str, u16>,
}

impl Log {
    /// An empty log.
    pub fn new(encoding: &'static LogEncoding) -> Self {
        let library = format!("skysink {}", env!("CARGO_PKG_VERSION"));
        let options = WriteOptions::new().compression(None).profile(encoding.profile).library(library);
        let writer = options.create(Cursor::new(Vec::new())).expect(TO_MEMORY);
        Self { writer, encoding, channels: BTreeMap::new() }
    }

    /// Adds a message. The first message of a topic also adds the topic and its schema.
    pub fn write(
        &mut self,
        topic: &LogTopic,
        sequence: u32,
        time_s: f64,
        message: &[u8],
        schema: impl FnOnce() -> Vec<u8>,
    ) {
        let writer = &mut self.writer;
        let LogEncoding { schema: schema_encoding, message: message_encoding, metadata, .. } = self.encoding;
        let channel_id = *self.channels.entry(topic.name).or_insert_with(|| {
            let schema_id = writer.add_schema(topic.schema, schema_encoding, &schema()).expect(TO_MEMORY);
            writer.add_channel(schema_id, topic.name, message_encoding, &metadata(topic)).expect(TO_MEMORY)
        });
        let time_ns = nanoseconds(time_s);
        let header = MessageHeader { channel_id, sequence, log_time: time_ns, publish_time: time_ns };
        self.writer.write_to_known_channel(&header, message).expect(TO_MEMORY);
    }

    /// The bytes of the file.
    pub fn finish(mut self) -> Vec<u8> {
        self.writer.finish().expect(TO_MEMORY);
        self.writer.into_inner().into_inner()
    }
}

/// Whole seconds, and the nanoseconds after them.
pub fn seconds_and_nanoseconds(time_s: f64) -> (u64, u64) {
    let time_ns = nanoseconds(time_s);
    (time_ns / 1_000_000_000, time_ns % 1_000_000_000)
}

fn nanoseconds(time_s: f64) -> u64 {
    (time_s * 1e9).round() as u64
}
