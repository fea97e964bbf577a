//! What a recording is made of, message by message.
#![allow(dead_code)] // each test program uses its part

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::io::BufReader;
use std::path::Path;

use rerun::TimelineName;
use rerun::external::re_log_encoding::{DecoderApp, Encoder};
use rerun::log::{Chunk, ChunkId, LogMsg};

/// The chunks of a recording, as far as they are whole.
#[derive(Debug, Default)]
pub struct Chunks {
    /// Entity and slots of those that have a time.
    pub timed: BTreeMap<ChunkId, (String, Vec<i64>)>,
    /// How many have none.
    pub stay: usize,
    /// How many are of the layout.
    pub layout: usize,
}

impl Chunks {
    /// Reads a file that may be cut, be empty, or grow.
    pub fn of(path: &Path) -> Self {
        let mut chunks = Self::default();
        let messages = DecoderApp::decode_lazy(BufReader::new(File::open(path).unwrap()));
        for message in messages.map_while(Result::ok) {
            match &message {
                LogMsg::ArrowMsg(store, _) if !store.is_recording() => chunks.layout += 1,
                LogMsg::ArrowMsg(_, chunk) => {
                    let chunk = Chunk::from_arrow_msg(chunk).unwrap();
                    if chunk.is_static() {
                        chunks.stay += 1;
                    } else {
                        let before = chunks.timed.insert(chunk.id(), (chunk.entity_path().to_string(), slots(&chunk)));
                        assert_eq!(before, None, "a chunk is there twice");
                    }
                }
                _ => {}
            }
        }
        chunks
    }

    /// The entities that have a time.
    pub fn entities(&self) -> impl Iterator<Item = String> + use<> {
        self.timed.values().map(|(entity, _)| entity.clone()).collect::<BTreeSet<_>>().into_iter()
    }

    /// Slots of one of them.
    pub fn slots_of(&self, entity: &str) -> BTreeSet<i64> {
        self.timed.values().filter(|(name, _)| name == entity).flat_map(|(_, slots)| slots.clone()).collect()
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
    let (count, ids) = (chunks.clone().count(), chunks.collect::<BTreeSet<_>>());
    assert_eq!(ids.len(), count, "a chunk is there twice");
    let footers = decoder.rrd_manifests().unwrap();
    let footer = footers.iter().find(|footer| footer.store_id.is_recording()).expect("a footer");
    assert_eq!(footer.col_chunk_id().unwrap().collect::<BTreeSet<_>>(), ids);
    names.into_iter().next().unwrap()
}

/// Writes a recording again, without its footer and the chunks of an entity that have `slot`.
pub fn leave_out(path: &Path, entity: &str, slot: i64) {
    let messages: Vec<_> =
        DecoderApp::decode_lazy(BufReader::new(File::open(path).unwrap())).map(Result::unwrap).collect();
    let is_out = |message: &LogMsg| match message {
        LogMsg::ArrowMsg(store, chunk) if store.is_recording() => {
            let chunk = Chunk::from_arrow_msg(chunk).unwrap();
            chunk.entity_path().to_string() == entity && slots(&chunk).contains(&slot)
        }
        _ => false,
    };
    let mut encoder = Encoder::local().unwrap();
    encoder.do_not_emit_footer();
    encoder.extend(messages.iter().filter(|message| !is_out(message)).map(Ok)).unwrap();
    fs::write(path, encoder.into_inner().unwrap()).unwrap();
}
