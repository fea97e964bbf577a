//! The trace of a run that goes on.

use std::path::Path;

use skysink::Error;
use skysink::run::resume::resume;
use skysink_common::stop::Stop;
use skysink_mission::origin::RunMode;
use skysink_mission::record::RunFolder;
use skysink_mission::summary::Tally;
use skysink_mission::trace::RecordedSlot;
use xxhash_rust::xxh3::xxh3_64_with_seed;

use super::place::in_folder;
use super::world::{WORLDS, World};

/// A trace is refused in one line, or every whole line of it is what the scenario leads to: its hash is that of the
/// lines as they stand, and the run goes on behind them.
///
/// # Panics
/// If not.
pub fn trace(bytes: &[u8]) {
    for line in bytes.split_inclusive(|&byte| byte == b'\n') {
        let columns = line.iter().filter(|&&byte| byte == b',').count() + 1;
        assert!(RecordedSlot::parse(line).is_none() || columns == 10 && line.ends_with(b"\n"));
    }
    let [world, ..] = &*WORLDS;
    in_folder(|folder| match go_on(folder, world, bytes) {
        Err(error) => super::assert_one_line(&error),
        Ok(hash) => {
            let whole = bytes.iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1);
            let left = std::fs::read(folder.join("slots.csv")).expect("the trace is there");
            let lines = left.split_inclusive(|&byte| byte == b'\n').skip(1);
            assert_eq!(lines.fold(0, |hash, line| xxh3_64_with_seed(line, hash)), hash);
            assert!(whole == 0 || left == bytes[..whole], "a whole line was changed");
            assert_eq!(go_on(folder, world, &left).expect("the trace goes on as it did before"), hash);
        }
    });
}

/// Goes on with a trace, and returns the hash of its lines.
fn go_on(folder: &Path, World { scenario, list, .. }: &World, bytes: &[u8]) -> Result<u64, Error> {
    let folder = RunFolder::create(Some(folder), true, scenario, list, &RunMode::default())?;
    std::fs::write(folder.slots(), bytes).expect("a file can be written"); // the same file: it is locked
    let mut tally = Tally::new(scenario, list);
    let mut resumed = resume(&folder, scenario, list, &mut tally, &Stop::default())?;
    resumed.log.resume()?;
    Ok(resumed.log.hash())
}
