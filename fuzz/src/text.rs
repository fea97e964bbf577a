//! Texts that people write, and texts that a run or a sweep resumes from.

use std::collections::BTreeMap;
use std::path::Path;

use skysink::Error;
use skysink::run::resume::resume;
use skysink_common::checkpoint::{Checkpoint, encode};
use skysink_common::error::InputError;
use skysink_common::message::{FlightReport, HoldReason, Mode};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::UAV;
use skysink_common::stop::Stop;
use skysink_field_sim::Field;
use skysink_lab::sweep::definition::Definition;
use skysink_lab::sweep::journal::{CheckSeeds, MissionRows, SweepJournal, checked_line, read};
use skysink_mission::Mission;
use skysink_mission::folder::Earlier;
use skysink_mission::origin::RunMode;
use skysink_mission::record::RunFolder;
use skysink_mission::summary::Tally;
use skysink_mission::trace::RecordedSlot;
use skysink_planner::settings;
use skysink_planner::strategies::names;
use xxhash_rust::xxh3::xxh3_64_with_seed;

use crate::messages::balanced;
use crate::world::assert_one_line;
use crate::world::{FOLDER, WORLDS, World, file};

fn parse(text: &str) -> Result<Scenario, InputError> {
    Scenario::parse(text, Path::new("folder/city.toml"), Overrides::default()).and_then(settings::resolve)
}

/// A text is refused in one line, or is a scenario that survives a round trip.
pub fn scenario(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    match parse(text) {
        Err(error) => assert_one_line(&error),
        Ok(scenario) => {
            let written = scenario.to_toml();
            let again = parse(&written).unwrap_or_else(|error| panic!("{error}\n{written}"));
            assert_eq!(again, scenario);
            assert_eq!((again.to_toml(), again.hash()), (written, scenario.hash()));
            let flown = parse(&scenario.to_toml_with_list("sensors.csv")).expect("the run's own copy is a scenario");
            assert_eq!(flown.hash(), scenario.hash());
        }
    }
}

/// A list is refused in one line, or its sensor nodes are in range and survive a round trip, in each world.
pub fn sensors(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    for world in WORLDS.iter() {
        match SensorList::parse(text, Path::new("list.csv"), &world.scenario) {
            Err(error) => assert_one_line(&error),
            Ok(list) => accepted(&list, &world.scenario),
        }
    }
}

fn accepted(list: &SensorList, scenario: &Scenario) {
    assert!(!list.sensors().is_empty());
    for sensor in list.sensors() {
        assert!(scenario.area.contains(&sensor.position, 0.0), "{sensor:?}");
        assert!(sensor.queue_bits <= sensor.capacity_bits, "{sensor:?}");
        assert!((-300.0..=0.0).contains(&sensor.gain_db), "{sensor:?}");
        assert!(sensor.sampling_bps >= 0.0 && sensor.sampling_bps.is_finite(), "{sensor:?}");
    }
    let written = list.to_csv();
    let again = SensorList::parse(&written, Path::new("written.csv"), scenario);
    assert_eq!(&again.unwrap_or_else(|error| panic!("{error}\n{written}")), list);
}

/// An accepted scenario can be flown: no plan is refused, and no bit is unaccounted for.
pub fn mission(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let Ok(scenario) = parse(text) else { return };
    let Some(count @ ..=4096) = scenario.sensors.count else { return };
    let list = SensorList::of(&scenario).expect("sensor nodes are drawn, not read");
    advance(&scenario, &list);
    if count <= 16 {
        fly(&scenario, &list);
    }
}

fn fly(scenario: &Scenario, list: &SensorList) {
    let mut mission = Mission::new(scenario, list).expect("its planner's keys were checked");
    for _ in 0..3 {
        let Some(flown) = mission.next() else { return };
        let flight = flown.flights()[UAV];
        assert_eq!((flight.hold, flight.refused), (HoldReason::None as u32, 0), "{:?}", flown.plans());
        assert_ne!(flight.mode, Mode::Hold as u32);
        assert_eq!(flown.header.totals, mission.plant().field().totals());
        balanced(mission.plant().field(), scenario.sensors.capacity_bits.ends()[1]);
    }
}

/// The first and the last slot of the field, with no SN served.
fn advance(scenario: &Scenario, list: &SensorList) {
    let mut field = Field::new(scenario, list);
    let mut saved = Vec::new();
    field.save(&mut saved);
    for slot in [1, scenario.slots] {
        let mut state = Vec::new();
        encode(&(slot - 1), &mut state); // a state begins with its slot, and 0 takes one byte
        state.extend_from_slice(&saved[1..]);
        field.restore(&state).expect("the ledger of an untouched field balances");
        field.step(slot, &[FlightReport::at([0.0, 0.0, 0.0], Mode::Hold)]).expect("no SN is served");
        balanced(&field, scenario.sensors.capacity_bits.ends()[1]);
    }
}

/// A trace is refused in one line, or its complete lines are those of the scenario, and the run resumes after them.
pub fn trace(bytes: &[u8]) {
    for line in bytes.split_inclusive(|&byte| byte == b'\n') {
        let columns = line.iter().filter(|&&byte| byte == b',').count() + 1;
        assert!(RecordedSlot::parse(line).is_none() || (11..=12).contains(&columns) && line.ends_with(b"\n"));
    }
    match resumed(bytes) {
        Err(error) => assert_one_line(&error),
        Ok(hash) => {
            let whole = bytes.iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1);
            let left = std::fs::read(FOLDER.path().join("slots.csv")).expect("the trace is there");
            let lines = left.split_inclusive(|&byte| byte == b'\n').skip(1);
            assert_eq!(lines.fold(0, |hash, line| xxh3_64_with_seed(line, hash)), hash);
            assert!(whole == 0 || left == bytes[..whole], "a whole line was changed");
            assert_eq!(resumed(&left).expect("the trace resumes as before"), hash);
        }
    }
}

/// Resumes a run from a trace, and returns the hash of its lines.
fn resumed(bytes: &[u8]) -> Result<u64, Error> {
    let World { scenario, list } = &WORLDS[0];
    let folder = RunFolder::create(Some(FOLDER.path()), Earlier::Replaced, scenario, list, &RunMode::default())?;
    std::fs::write(folder.slots(), bytes).expect("a file can be written"); // the same file: it is locked
    let mut tally = Tally::new(scenario, list, folder.run_mode());
    let mut run = resume(&folder, scenario, list, &mut tally, &Stop::default())?;
    run.log.resume()?;
    Ok(run.log.hash())
}

/// A journal is refused in one line, or both ways to read it agree; also if each line gets the sweep's checksum.
pub fn sweep_journal(bytes: &[u8]) {
    let seeds = CheckSeeds::of(&sweep());
    let lines = bytes.split(|&byte| byte == b'\n').map(|line| checked_line(line, &seeds));
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
            let rows = journal.rows;
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
        grid: String::new(),
        version: String::new(),
        keys: vec!["slots".to_owned()],
        points: (1..=4).map(|slots| vec![slots.into()]).collect(),
        strategies: names().into_iter().map(str::to_owned).collect(),
        sources: BTreeMap::new(),
        models: Vec::new(),
        seeds: (0..10).collect(),
    }
}
