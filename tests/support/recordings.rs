//! Recordings, read back and verified.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::io::BufReader;
use std::path::{Path, PathBuf};

use re_log_encoding::DecoderApp;
use re_sdk::log::{Chunk, ChunkId, LogMsg};
use re_sdk_types::reflection::generate_reflection;

/// An entity that is recorded in every slot.
pub const EACH_SLOT: &str = "/metrics/loss_rate";

/// The slots in which a recording holds the entity.
pub fn slots(recording: &Path, entity: &str) -> BTreeSet<i64> {
    rows(recording, entity).into_keys().collect()
}

/// Checks that a file which begins with the slot `begin` holds every slot up to its last one, but for as many as it
/// says that the viewer missed; returns the last.
#[track_caller]
pub fn assert_whole_from(begin: i64, recording: &Path) -> i64 {
    let recorded = slots(recording, EACH_SLOT);
    let first = *recorded.first().expect("the first slot of a file is written at once");
    let last = *recorded.last().unwrap();
    assert!(begin <= first, "from {begin}: {recorded:?}");
    let missing = last + 1 - begin - recorded.len() as i64;
    let (_, missed) = rows(recording, "/metrics/missed_slots").pop_last().unwrap();
    assert!(missed.contains(&format!(" {missing}.0,")), "{missing} missing from {begin} on: {missed}, {recorded:?}");
    last
}

/// The files of a run's recording, in no order.
pub fn recordings(run: &Path) -> Vec<PathBuf> {
    let paths = fs::read_dir(run).unwrap().map(|entry| entry.unwrap().path());
    paths.filter(|path| path.extension().is_some_and(|extension| extension == "rrd")).collect()
}

/// The slots in which any of these files holds the entity.
pub fn slots_of_all(recordings: &[PathBuf], entity: &str) -> BTreeSet<i64> {
    recordings.iter().flat_map(|recording| slots(recording, entity)).collect()
}

/// The components of the entity in each slot of a recording, as text.
pub fn rows(recording: &Path, entity: &str) -> BTreeMap<i64, String> {
    let mut config = re_chunk_store::ChunkStoreConfig::DEFAULT;
    config.enable_changelog = false;
    let stores = re_chunk_store::ChunkStore::from_rrd_reader(&config, &mut File::open(recording).unwrap()).unwrap();
    let timeline = re_sdk::TimelineName::try_new("slot").unwrap();
    let mut rows = BTreeMap::<_, String>::new();
    for (_, store) in stores.into_iter().filter(|(id, _)| id.is_recording()) {
        for chunk in
            store.iter_physical_chunks().filter(|chunk| chunk.entity_path() == &re_sdk::EntityPath::from(entity))
        {
            let Some(times) = chunk.timelines().get(&timeline) else { continue };
            for (row, &slot) in times.times_raw().iter().enumerate() {
                let values = rows.entry(slot).or_default();
                for component in chunk.components_identifiers() {
                    let column = chunk.components().get_array(component).unwrap();
                    values.push_str(&format!("{component}: {:?}\n", column.value(row)));
                }
            }
        }
    }
    rows
}

/// The slots in which a recording holds each entity.
pub type EntitySlots = BTreeMap<String, BTreeSet<i64>>;

/// Verifies a recording as `rerun rrd verify` does: each message decodes, each column has the type that rerun knows for
/// its component, and the footer knows every chunk. It holds one recording at most. Returns its slots.
#[track_caller]
pub fn verify(recording: &Path) -> EntitySlots {
    let file = recording.display();
    let reflection = generate_reflection().unwrap();
    let mut decoder = DecoderApp::decode_lazy(BufReader::new(File::open(recording).unwrap()));
    let messages: Vec<_> = decoder.by_ref().map(|message| message.unwrap_or_else(|e| panic!("{file}: {e}"))).collect();
    let stores: BTreeSet<_> = messages.iter().map(LogMsg::store_id).filter(|id| id.is_recording()).collect();
    assert!(stores.len() <= 1, "{file}: {stores:?}");
    let footers = decoder.rrd_manifests().unwrap();
    let mut listed = BTreeSet::new();
    footers.iter().for_each(|footer| listed.extend(footer.col_chunk_id().unwrap()));
    let timeline = re_sdk::TimelineName::try_new("slot").unwrap();
    let mut chunks = BTreeSet::<ChunkId>::new();
    let mut slots = EntitySlots::new();
    for message in &messages {
        let LogMsg::ArrowMsg(store, message) = message else { continue };
        let chunk = Chunk::from_arrow_msg(message).unwrap_or_else(|error| panic!("{file}: {error}"));
        assert!(chunks.insert(chunk.id()), "{file}: a chunk is there twice");
        for column in chunk.components().0.values() {
            let Some(component) = column.descriptor.component_type else { continue };
            let known = reflection.components.get(&component);
            let known = known.unwrap_or_else(|| panic!("{file}: {component} is unknown"));
            assert!(known.deprecation_summary.is_none(), "{file}: {component} is deprecated");
            (known.verify_arrow_array)(column.list_array.values())
                .unwrap_or_else(|e| panic!("{file}: {component}: {e}"));
        }
        if let Some(times) = chunk.timelines().get(&timeline).filter(|_| store.is_recording()) {
            slots.entry(chunk.entity_path().to_string()).or_default().extend(times.times_raw());
        }
    }
    assert_eq!(listed, chunks, "{file}: the footer and the chunks");
    slots
}

/// Verifies all files of the recording in `run`. The entities that the recording `undisturbed` of a mission has in
/// every slot must be in each file in every slot after the first one shown, up to the last of anything but the event
/// log. A file of a viewer that was started after the last slot shows none.
#[track_caller]
pub fn verify_all(run: &Path, undisturbed: &EntitySlots) {
    let all = undisturbed.values().map(BTreeSet::len).max().unwrap();
    let is_in_every_slot = |entity: &String| undisturbed.get(entity).is_some_and(|slots| slots.len() == all);
    for recording in recordings(run) {
        let file = recording.display();
        let found = verify(&recording);
        let drawn = found.iter().filter(|(entity, _)| *entity != "/log/events").map(|(_, slots)| slots);
        let Some(&last) = drawn.filter_map(BTreeSet::last).max() else { continue };
        let shown = *found["/metrics/loss_rate"].first().unwrap(); // a later file begins with what was missed before
        for (entity, slots) in found.iter().filter(|(entity, _)| is_in_every_slot(entity)) {
            let after = slots.range(shown + 1..).copied();
            assert!(after.eq(shown + 1..=last), "{file}: {entity}: {shown} to {last}: {slots:?}");
        }
    }
}
