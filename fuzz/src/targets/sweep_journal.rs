//! The journal of a sweep.

use std::path::Path;

use skysink_lab::sweep::journal::{MissionRows, SweepJournal, check_seed, checked_line, read};
use skysink_lab::sweep::plan::Definition;
use skysink_planner::strategies::names;

use super::place::{in_folder, write};

/// A journal is refused in one line, or its missions are the same however they are read, and written again they read
/// back as themselves; opened, it ends with a whole line. The same holds when each line is given the check that it
/// needs to be taken for one of the sweep.
///
/// # Panics
/// If not.
pub fn sweep_journal(bytes: &[u8]) {
    let seed = check_seed(&sweep());
    let lines = bytes.split(|&byte| byte == b'\n').map(|line| checked_line(line, seed));
    read_and_opened(bytes);
    read_and_opened(&lines.collect::<Vec<_>>().concat());
}

fn read_and_opened(bytes: &[u8]) {
    in_folder(|folder| {
        let (path, copy) = (folder.join("missions.csv"), folder.join("copy.csv"));
        write(&path, bytes);
        let sweep = sweep();
        let found = read(&path, &sweep);
        match (found, SweepJournal::open(&path, &sweep)) {
            (Err(error), Err(same)) => {
                super::assert_one_line(&error);
                assert_eq!(error.to_string(), same.to_string());
            }
            (Ok(found), Ok(journal)) => {
                let rows = journal.all().expect("its lines were just read");
                assert_eq!(told(&found), told(&rows));
                let left = std::fs::read(&path).expect("the journal is there");
                assert!(bytes.starts_with(&left) && left.last().is_none_or(|&byte| byte == b'\n'));
                write_again(&copy, &sweep, &rows);
            }
            (found, opened) => panic!("read: {found:?}, opened: {opened:?}"),
        }
    });
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

fn write_again(copy: &Path, sweep: &Definition, rows: &MissionRows) {
    write(copy, &[]);
    let mut journal = SweepJournal::open(copy, sweep).expect("an empty journal opens");
    assert_eq!(journal.count(), 0);
    for row in rows.values() {
        journal.add(row).expect("the row is written");
    }
    assert_eq!(told(&read(copy, sweep).expect("what was just written is a journal")), told(rows));
}

/// The missions in words: a figure may be NaN, which equals nothing.
fn told(rows: &MissionRows) -> String {
    format!("{rows:?}")
}
