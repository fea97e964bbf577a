//! Replay of a recorded mission: its trace is read line by line and flown again by the recorded plans. This recovers
//! what the trace does not hold, such as the queues, and verifies every line.

use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};

use skysink_common::error::InputError;
use skysink_common::message::{Mode, Plan};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_planner::settings;
use skysink_planner::strategies::rfs;

use crate::error::{FileContext, MissionError};
use crate::mission::{FlownSlot, Mission};
use crate::record::RunFolder;
use crate::slot_log::SlotLog;
use crate::summary::Summary;
use crate::trace::{RecordedSlot, chain_hash};

/// The lines of a trace, one after the other.
pub struct RecordedLines {
    path: PathBuf,
    reader: BufReader<File>,
    slots: u64,
    slot: u64,
    line: Vec<u8>,
}

impl RecordedLines {
    /// The lines after the header of the trace in `folder`, of a mission of `slots` slots.
    #[must_use]
    pub fn new(folder: &RunFolder, reader: BufReader<File>, slots: u64) -> Self {
        Self { path: folder.slots(), reader, slots, slot: 0, line: Vec::new() }
    }

    /// The next recorded slot; `None` after the last complete line.
    ///
    /// # Errors
    /// If the line is not that of the next slot, or cannot be read.
    pub fn next_slot(&mut self) -> Result<Option<RecordedSlot>, MissionError> {
        self.line.clear();
        self.reader.read_until(b'\n', &mut self.line).at(&self.path)?;
        if self.line.last() != Some(&b'\n') {
            return Ok(None);
        }
        self.slot += 1;
        let Self { slot, slots, .. } = *self;
        let recorded = RecordedSlot::parse(&self.line);
        let recorded = recorded.ok_or_else(|| self.refuse("expected a slot as skysink run writes it"))?;
        if slot > slots {
            return Err(self.refuse(&format!("expected the end, after {slots} slots")));
        }
        if recorded.slot != slot {
            return Err(self.refuse(&format!("slot {}: expected slot {slot} of {slots}", recorded.slot)));
        }
        Ok(Some(recorded))
    }

    /// Refuses a trace whose hash of all lines, `hash`, is not that of `summary`.
    fn check_end(&self, hash: u64, summary: &Summary) -> Result<(), MissionError> {
        let found = format!("{} slots of hash {hash:016x}", self.slot);
        let expected = format!("{} slots of hash {}", summary.slots, summary.trace_hash);
        if found == expected {
            return Ok(());
        }
        let message = format_args!("{found}: expected {expected}, as in summary.json");
        Err(InputError::new("trace", &self.path, message).into())
    }

    /// The last line, with its newline.
    #[must_use]
    pub fn line(&self) -> &[u8] {
        &self.line
    }

    /// The error for the last line.
    #[must_use]
    pub fn refuse(&self, what: &str) -> MissionError {
        let line = String::from_utf8_lossy(&self.line);
        InputError::line("trace", &self.path, self.slot as usize + 1, &line, what).into()
    }

    /// The error for a line that the mission does not reproduce.
    #[must_use]
    pub fn changed(&self) -> MissionError {
        self.refuse("it differs from the simulation of the scenario: it or an earlier line was modified")
    }
}

/// All recorded slots in the folder of a run that has ended, without a replay.
///
/// # Errors
/// If `path` is not a run folder, its scenario or sensor list was changed, or a line is not that of its slot.
pub fn recorded_slots(path: &Path) -> Result<Vec<RecordedSlot>, MissionError> {
    let folder = RunFolder::open_to_read(path)?;
    let scenario = Scenario::read(&folder.scenario(), Overrides::default())?;
    let (_, reader) = folder.reopen_slot_log()?;
    let mut lines = RecordedLines::new(&folder, reader, scenario.slots);
    std::iter::from_fn(|| lines.next_slot().transpose()).collect()
}

/// A recorded mission that is flown again.
pub struct Replay {
    scenario: Scenario,
    list: SensorList,
    label: String,
    mission: Mission,
    lines: RecordedLines,
    log: SlotLog,
    recorded: Option<RecordedSlot>,
    summary: Summary,
}

impl Replay {
    /// Opens the folder of a run that has ended, early or not.
    ///
    /// # Errors
    /// If `path` is not a run folder, its scenario or sensor list was changed, or the run is not over.
    pub fn open(path: &Path) -> Result<Self, MissionError> {
        let folder = RunFolder::open_to_read(path)?;
        let summary = folder.summary()?;
        let scenario = Scenario::read(&folder.scenario(), Overrides::default()).and_then(settings::resolve)?;
        let list = SensorList::of(&scenario)?;
        let (log, reader) = folder.reopen_slot_log()?;
        let lines = RecordedLines::new(&folder, reader, scenario.slots);
        let label = folder.run_mode().external_planner.as_ref().unwrap_or(&scenario.planner.strategy).clone();
        // The plans are recorded, so the planner is not used: `rfs` is the cheapest to construct.
        let mut flown = scenario.clone();
        rfs::STRATEGY.name.clone_into(&mut flown.planner.strategy);
        let mission = Mission::new(&flown, &list)?;
        Ok(Self { scenario, list, label, mission, lines, log, recorded: None, summary })
    }

    /// The scenario as flown.
    #[must_use]
    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// Its sensor nodes.
    #[must_use]
    pub fn list(&self) -> &SensorList {
        &self.list
    }

    /// The strategy, or the label of an external planner.
    #[must_use]
    pub fn label(&self) -> &str {
        &self.label
    }

    /// The summary of the run.
    #[must_use]
    pub fn summary(&self) -> &Summary {
        &self.summary
    }

    /// The mission after the last slot.
    #[must_use]
    pub fn mission(&self) -> &Mission {
        &self.mission
    }

    /// The last slot, as recorded in the trace.
    #[must_use]
    pub fn last_recorded(&self) -> Option<&RecordedSlot> {
        self.recorded.as_ref()
    }

    /// Flies the next slot; `None` after the last recorded one. A slot that had no plan in time is returned with a plan
    /// to hold.
    ///
    /// # Errors
    /// If the trace cannot be read, or the mission does not reproduce its next line.
    pub fn next_slot(&mut self) -> Result<Option<FlownSlot>, MissionError> {
        let Some(recorded) = self.lines.next_slot()? else { return self.check_end().map(|()| None) };
        let plan = (!recorded.is_missed()).then(|| recorded.plan());
        let header = self.mission.fly(plan.as_ref());
        let flight = *self.mission.last_flight();
        if !self.log.repeat(self.lines.line(), &flight, &header)? {
            return Err(self.lines.changed());
        }
        let plan = plan.unwrap_or_else(|| Plan::fly_to(recorded.position, Mode::Hold));
        self.recorded = Some(recorded);
        Ok(Some(FlownSlot { plan, flight, header }))
    }

    /// Refuses a trace that does not match the summary.
    fn check_end(&self) -> Result<(), MissionError> {
        self.lines.check_end(self.log.hash(), &self.summary)
    }
}

/// The summary of a run that has ended, after a check that it matches the trace, without a replay.
///
/// # Errors
/// If the run has not ended, or its trace was changed.
pub fn checked_summary(folder: &RunFolder) -> Result<Summary, MissionError> {
    let summary = folder.summary()?;
    let (_, reader) = folder.reopen_slot_log()?;
    let mut lines = RecordedLines::new(folder, reader, summary.planned_slots);
    let mut hash = 0;
    while lines.next_slot()?.is_some() {
        hash = chain_hash(hash, lines.line());
    }
    lines.check_end(hash, &summary)?;
    Ok(summary)
}
