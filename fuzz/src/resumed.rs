//! Records that a run or a sweep resumes from: the trace of a run, the journal of a sweep.

use skysink::Error;
use skysink::run::resume::resume;
use skysink_common::stop::Stop;
use skysink_lab::sweep::journal::{MissionRows, SweepJournal, check_seed, checked_line, read};
use skysink_lab::sweep::plan::Definition;
use skysink_mission::origin::RunMode;
use skysink_mission::record::RunFolder;
use skysink_mission::summary::Tally;
use skysink_mission::trace::RecordedSlot;
use skysink_planner::strategies::names;
use xxhash_rust::xxh3::xxh3_64_with_seed;

use crate::assert_one_line;
use crate::scratch::{FOLDER, file};
use crate::world::{WORLDS, World};

/// A trace is refused in one line, or its whole lines are what the scenario leads to, and the run resumes behind them.
pub fn trace(bytes: &[u8]) {
    for line in bytes.split_inclusive(|&byte| byte == b'\n') {
        let columns = line.iter().filter(|&&byte| byte == b',').count() + 1;
        assert!(RecordedSlot::parse(line).is_none() || columns == 10 && line.ends_with(b"\n"));
    }
    match go_on(bytes) {
        Err(error) => assert_one_line(&error),
        Ok(hash) => {
            let whole = bytes.iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1);
            let left = std::fs::read(FOLDER.path().join("slots.csv")).expect("the trace is there");
            let lines = left.split_inclusive(|&byte| byte == b'\n').skip(1);
            assert_eq!(lines.fold(0, |hash, line| xxh3_64_with_seed(line, hash)), hash);
            assert!(whole == 0 || left == bytes[..whole], "a whole line was changed");
            assert_eq!(go_on(&left).expect("the trace goes on as it did before"), hash);
        }
    }
}

/// Goes on with a trace, and returns the hash of its lines.
fn go_on(bytes: &[u8]) -> Result<u64, Error> {
    let World { scenario, list, .. } = &WORLDS[0];
    let folder = RunFolder::create(Some(FOLDER.path()), true, scenario, list, &RunMode::default())?;
    std::fs::write(folder.slots(), bytes).expect("a file can be written"); // the same file: it is locked
    let mut tally = Tally::new(scenario, list);
    let mut resumed = resume(&folder, scenario, list, &mut tally, &Stop::default())?;
    resumed.log.resume()?;
    Ok(resumed.log.hash())
}

/// A journal is refused in one line, or its missions read the same twice; also if each line gets the sweep's check.
pub fn sweep_journal(bytes: &[u8]) {
    let seed = check_seed(&sweep());
    let lines = bytes.split(|&byte| byte == b'\n').map(|line| checked_line(line, seed));
    read_and_opened(bytes);
    read_and_opened(&lines.collect::<Vec<_>>().concat());
}

fn read_and_opened(bytes: &[u8]) {
    let words = |rows: &MissionRows| format!("{rows:?}"); // a figure may be NaN, which equals nothing
    let path = file("missions.csv", bytes);
    let sweep = sweep();
    match (read(&path, &sweep), SweepJournal::open(&path, &sweep)) {
        (Err(error), Err(same)) => {
            assert_one_line(&error);
            assert_eq!(error.to_string(), same.to_string());
        }
        (Ok(found), Ok(journal)) => {
            let rows = journal.all().expect("its lines were just read");
            assert_eq!(words(&found), words(&rows));
            let left = std::fs::read(&path).expect("the journal is there");
            assert!(bytes.starts_with(&left) && left.last().is_none_or(|&byte| byte == b'\n'));
            let copy = file("copy.csv", &[]);
            let mut journal = SweepJournal::open(&copy, &sweep).expect("an empty journal opens");
            assert_eq!(journal.count(), 0);
            rows.values().for_each(|row| journal.add(row).expect("the row is written"));
            assert_eq!(words(&read(&copy, &sweep).expect("what was just written is a journal")), words(&rows));
        }
        (found, opened) => panic!("read: {found:?}, opened: {opened:?}"),
    }
}

/// The sweep of the journal: four points, all strategies, seeds 0 to 9.
fn sweep() -> Definition {
    Definition {
        identity: String::new(),
        version: String::new(),
        keys: vec!["slots".to_owned()],
        points: (1..=4).map(|slots| vec![slots.into()]).collect(),
        strategies: names().map(str::to_owned).to_vec(),
        seeds: (0..10).collect(),
    }
}
