//! What a file of a recording is made of, message by message.
#![allow(dead_code)] // each test program uses its part

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use re_log_encoding::DecoderApp;
use re_sdk::TimelineName;
use re_sdk::log::{Chunk, ChunkId, LogMsg};

/// The chunks of a file, as far as they are whole.
#[derive(Debug, Default)]
pub struct Chunks {
    /// Id of the recording that the first message names.
    pub recording_id: Option<String>,
    /// Entity and slots of those that have a time.
    pub timed: BTreeMap<ChunkId, (String, Vec<i64>)>,
}

impl Chunks {
    /// Reads a file that may be cut, be empty, or grow.
    pub fn of(path: &Path) -> Self {
        let mut chunks = Self::default();
        let messages = DecoderApp::decode_lazy(BufReader::new(File::open(path).unwrap()));
        for message in messages.map_while(Result::ok).filter(|message| message.store_id().is_recording()) {
            let id = message.store_id().recording_id().to_string();
            assert_eq!(chunks.recording_id.get_or_insert_with(|| id.clone()), &id);
            let LogMsg::ArrowMsg(_, chunk) = &message else { continue };
            let chunk = Chunk::from_arrow_msg(chunk).unwrap();
            if !chunk.is_static() {
                let before = chunks.timed.insert(chunk.id(), (chunk.entity_path().to_string(), slots(&chunk)));
                assert_eq!(before, None, "a chunk is there twice");
            }
        }
        chunks
    }

    /// The newest slot of anything but the event log.
    pub fn newest(&self) -> Option<i64> {
        self.timed.values().filter(|(entity, _)| entity != "/log/events").flat_map(|(_, slots)| slots).copied().max()
    }
}

fn slots(chunk: &Chunk) -> Vec<i64> {
    let slots = chunk.timelines().get(&TimelineName::try_new("slot").unwrap());
    slots.map_or_else(Vec::new, |slots| slots.times_raw().to_vec())
}

/// Checks that a file holds one recording, each chunk once, and ends with a footer that knows them all. Returns its id.
pub fn recording(path: &Path) -> String {
    let mut decoder = DecoderApp::decode_lazy(BufReader::new(File::open(path).unwrap()));
    let messages: Vec<_> = decoder.by_ref().map(Result::unwrap).collect();
    let of_recording = || messages.iter().filter(|message| message.store_id().is_recording());
    let names: BTreeSet<_> = of_recording().map(|message| message.store_id().recording_id().to_string()).collect();
    assert_eq!(names.len(), 1, "{names:?}");
    let chunks = of_recording().filter_map(|message| match message {
        LogMsg::ArrowMsg(_, chunk) => Some(ChunkId::from_tuid(chunk.chunk_id)),
        _ => None,
    });
    let count = chunks.clone().count();
    let ids = chunks.collect::<BTreeSet<_>>();
    assert_eq!(ids.len(), count, "a chunk is there twice");
    let footers = decoder.rrd_manifests().unwrap();
    let footer = footers.iter().find(|footer| footer.store_id.is_recording()).expect("a footer");
    assert_eq!(footer.col_chunk_id().unwrap().collect::<BTreeSet<_>>(), ids);
    names.into_iter().next().unwrap()
}
