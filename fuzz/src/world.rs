//! The small scenarios for the checks, and their temporary files.

use std::fs::{self, OpenOptions};
use std::io::ErrorKind;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use arbitrary::{Result, Unstructured};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_planner::plan::keys::HorizonKeys;
use skysink_planner::settings::{self, Knowledge, Rates, Settings};
use skysink_planner::strategies::best_of::{self, BestOfKeys};
use skysink_planner::strategies::horizon;
use skysink_planner::strategies::look_ahead::{self, OfflineKeys};
use skysink_planner::strategies::names;
use skysink_ring::folder::RingFolder;
use skysink_ring::terms::Terms;
use tempfile::TempDir;

/// A scenario and its sensor nodes.
#[derive(Debug)]
pub struct World {
    pub scenario: Scenario,
    pub list: SensorList,
}

/// All of them.
pub static WORLDS: LazyLock<[World; 3]> = LazyLock::new(|| {
    let free_space = include_str!("../worlds/free-space.toml");
    let texts = [free_space, include_str!("../worlds/origin.toml"), include_str!("../worlds/line-of-sight.toml")];
    texts.map(|text| {
        let scenario = Scenario::parse(text, Path::new("worlds"), Overrides::default()).expect("a valid scenario");
        let list = SensorList::of(&scenario).expect("its sensor nodes are drawn, not read");
        World { scenario, list }
    })
});

/// The sensor nodes and the scenario of a world, with arbitrary strategy, knowledge and rates, and short searches.
pub fn planned(u: &mut Unstructured) -> Result<(&'static SensorList, Scenario)> {
    let World { scenario, list } = u.choose(&*WORLDS)?;
    let mut scenario = scenario.clone();
    scenario.planner.strategy = (*u.choose(&names())?).to_owned();
    horizon::STRATEGY.set_keys(&mut scenario, HorizonKeys::of(20));
    best_of::STRATEGY.set_keys(&mut scenario, BestOfKeys { iterations: 20, simulated_slots: 50, window: 10 });
    look_ahead::OFFLINE.set_keys(&mut scenario, OfflineKeys { steps: 200 });
    let estimated = [Rates::Known, Rates::Learnt].map(|rates| (Knowledge::Estimated, rates));
    let (knowledge, rates) = *u.choose(&[(Knowledge::Oracle, Rates::Known), estimated[0], estimated[1]])?;
    let change = |settings: &mut Settings| (settings.knowledge, settings.rates) = (knowledge, rates);
    Ok((list, settings::change(scenario, change).expect("every combination is valid")))
}

/// Temporary folder of the process. Files of earlier inputs remain.
pub static FOLDER: LazyLock<TempDir> = LazyLock::new(|| tempfile::tempdir().expect("a temporary folder can be made"));

static RING: LazyLock<RingFolder> =
    LazyLock::new(|| RingFolder::create(Terms::default()).expect("a ring's folder can be made"));

/// Writes a file. An existing one is removed, not truncated, because some file systems then wait for the disk.
pub fn file(name: &str, bytes: &[u8]) -> PathBuf {
    let path = FOLDER.path().join(name);
    if let Err(error) = fs::remove_file(&path) {
        assert_eq!(error.kind(), ErrorKind::NotFound, "{}: {error}", path.display());
    }
    fs::write(&path, bytes).expect("a file can be written");
    path
}

/// The folder of a ring in which this journal is empty.
pub fn ring_without(journal: &str) -> &'static RingFolder {
    let states = RING.journal(journal);
    fs::write(states.with_extension("inputs"), []).expect("a journal can be emptied");
    fs::write(states, []).expect("a journal can be emptied");
    &RING
}

/// At most `length` bytes, fewer at the end of the input.
pub fn bytes<'a>(u: &mut Unstructured<'a>, length: usize) -> Result<&'a [u8]> {
    u.bytes(length.min(u.len()))
}

/// Corrupts a file as the input says: overwrites bytes, truncates or replaces it. Returns whether it did anything.
pub fn corrupt(path: &Path, u: &mut Unstructured) -> Result<bool> {
    let file = OpenOptions::new().write(true).open(path).expect("the file is there");
    let length = file.metadata().expect("the file is there").len();
    let done = !u.is_empty();
    while !u.is_empty() {
        let kind: u8 = u.arbitrary()?;
        let at = u64::from(u.arbitrary::<u32>()?) % (length + 64);
        let result = match kind {
            0 => file.set_len(at),
            u8::MAX => fs::write(path, u.bytes(u.len())?),
            _ => file.write_all_at(bytes(u, usize::from(kind % 32))?, at),
        };
        result.expect("the file can be changed");
    }
    Ok(done)
}

/// Fails unless the message is one line.
pub fn assert_one_line(words: &impl std::fmt::Display) {
    let words = words.to_string();
    assert!(!words.is_empty() && !words.contains('\n'), "not one line: {words:?}");
}
