//! A finished run, read from its folder and checked against what was written when it was flown.

use std::fs::File;
use std::path::Path;

use serde::Deserialize;
use skysink_common::error::{InputError, read_text};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;

use crate::error::{FileContext, MissionError};
use crate::origin;
use crate::record::{TRACE, held, require};
use crate::trace::{RecordedSlot, SLOT_COLUMNS, chain};

/// A run that has flown all its slots.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedRun {
    /// The scenario as flown.
    pub scenario: Scenario,
    /// The sensor nodes as flown.
    pub list: SensorList,
    /// The strategy flown, or the label of an outside planner.
    pub strategy: String,
    /// Slot t is entry t − 1.
    pub slots: Vec<RecordedSlot>,
}

impl RecordedRun {
    /// Reads the run in `folder`.
    ///
    /// # Errors
    /// If it is no such folder, a run is writing it, the run has ended early, or the scenario, the sensor list or the
    /// trace was changed since.
    pub fn read(folder: &Path) -> Result<Self, MissionError> {
        let files = ["scenario.toml", "sensors.csv", TRACE, origin::FILE, "summary.json"];
        require(folder, &files, "the folder of a finished run")?;
        let path = folder.join(TRACE);
        let trace = File::open(&path).at(&path)?;
        held(trace.try_lock_shared(), &path)?;
        origin::read(folder)?;
        let FinishedRun { strategy, trace_hash, .. } = read_summary(folder)?;
        let scenario = Scenario::read(&folder.join("scenario.toml"), Overrides::default())?;
        let list = SensorList::of(&scenario)?;
        let slots = read_slots(&path, &trace_hash, &scenario, list.sensors().len())?;
        Ok(Self { scenario, list, strategy, slots })
    }
}

/// What `summary.json` says that is needed here.
#[derive(Deserialize)]
struct FinishedRun {
    strategy: String,
    trace_hash: String,
    complete: bool,
}

fn read_summary(folder: &Path) -> Result<FinishedRun, InputError> {
    let path = folder.join("summary.json");
    let refuse = |message: String| InputError::new("summary", &path, message);
    let text = read_text("summary", &path)?;
    let summary: FinishedRun =
        serde_json::from_str(&text).map_err(|error| refuse(format!("{error}: expected a run's summary")))?;
    if !summary.complete {
        return Err(refuse("complete = false: expected true, of a run that has flown all its slots".to_owned()));
    }
    Ok(summary)
}

/// The slots of the trace `path`, all of them, as they were written.
fn read_slots(path: &Path, hash: &str, scenario: &Scenario, sensors: usize) -> Result<Vec<RecordedSlot>, InputError> {
    let text = read_text("trace", path)?;
    let mut lines = text.split_inclusive('\n');
    let header = lines.next().unwrap_or_default();
    if header != SLOT_COLUMNS {
        return Err(InputError::line("trace", path, 1, header, format_args!("expected {}", SLOT_COLUMNS.trim_end())));
    }
    let mut slots: Vec<RecordedSlot> = Vec::new();
    let mut chained = 0;
    for line in lines {
        let next = slots.len() + 1;
        let recorded = RecordedSlot::parse(line.as_bytes())
            .filter(|slot| slot.slot == next as u64 && slot.scheduled.iter().all(|&id| (id as usize) < sensors))
            .ok_or_else(|| {
                let expected = format_args!("expected slot {next} of {} as skysink writes it", scenario.slots);
                InputError::line("trace", path, next + 1, line, expected)
            })?;
        chained = chain(chained, line.as_bytes());
        slots.push(recorded);
    }
    let refuse = |message: String| Err(InputError::new("trace", path, message));
    if slots.len() as u64 != scenario.slots {
        return refuse(format!("it ends after slot {}: expected {} slots", slots.len(), scenario.slots));
    }
    if format!("{chained:016x}") != hash {
        return refuse(format!("its hash is {chained:016x}: expected {hash}, trace_hash of summary.json"));
    }
    Ok(slots)
}
