//! A mission on record, read line by line and flown again by the recorded plans: what the trace does not hold, such as
//! the queues of every slot, comes back, and every line is compared.

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
use crate::trace::{RecordedSlot, chained};

/// The lines of a trace, one after the other.
pub struct RecordedLines {
    path: PathBuf,
    reader: BufReader<File>,
    slots: u64,
    slot: u64,
    line: Vec<u8>,
}

impl RecordedLines {
    /// The lines behind the header of the trace in `folder`, of a mission of `slots` slots.
    #[must_use]
    pub fn new(folder: &RunFolder, reader: BufReader<File>, slots: u64) -> Self {
        Self { path: folder.slots(), reader, slots, slot: 0, line: Vec::new() }
    }

    /// The next slot on record; `None` after the last whole line.
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

    /// Refuses a trace of whose lines, up to the last, `hash` is the hash, if that is not the one of `summary`.
    fn check_end(&self, hash: u64, summary: &Summary) -> Result<(), MissionError> {
        let found = format!("{} slots of hash {hash:016x}", self.slot);
        let expected = format!("{} slots of hash {}", summary.slots, summary.trace_hash);
        if found == expected {
            return Ok(());
        }
        let message = format_args!("{found}: expected {expected}, as in summary.json");
        Err(InputError::new("trace", &self.path, message).into())
    }

    /// The last line, with its end.
    #[must_use]
    pub fn line(&self) -> &[u8] {
        &self.line
    }

    /// The refusal of the last line.
    #[must_use]
    pub fn refuse(&self, what: &str) -> MissionError {
        let line = String::from_utf8_lossy(&self.line);
        InputError::line("trace", &self.path, self.slot as usize + 1, &line, what).into()
    }

    /// The refusal of a line to which the mission does not lead.
    #[must_use]
    pub fn changed(&self) -> MissionError {
        self.refuse("the mission does not lead to this line, or one before it was changed since it was written")
    }
}

/// All slots on record in the folder of a run that has ended, as they are written.
///
/// # Errors
/// If it is no such folder, its scenario or sensor list was changed since, or a line is not that of its slot.
pub fn recorded_slots(path: &Path) -> Result<Vec<RecordedSlot>, MissionError> {
    let folder = RunFolder::open_to_read(path)?;
    let scenario = Scenario::read(&folder.scenario(), Overrides::default())?;
    let (_, reader) = folder.reopen_slot_log()?;
    let mut lines = RecordedLines::new(&folder, reader, scenario.slots);
    std::iter::from_fn(|| lines.next_slot().transpose()).collect()
}

/// A mission on record that is flown again.
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
    /// If it is none, its scenario or sensor list was changed since, it has no summary, or is still under way.
    pub fn open(path: &Path) -> Result<Self, MissionError> {
        let folder = RunFolder::open_to_read(path)?;
        let summary = folder.summary()?;
        let scenario = Scenario::read(&folder.scenario(), Overrides::default()).and_then(settings::resolve)?;
        let list = SensorList::of(&scenario)?;
        let (log, reader) = folder.reopen_slot_log()?;
        let lines = RecordedLines::new(&folder, reader, scenario.slots);
        let label = folder.manner().outside_planner.as_ref().unwrap_or(&scenario.planner.strategy).clone();
        // The plans are on record: the planner is the one that takes least to set up.
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

    /// The strategy that planned it, or the label of an outside planner.
    #[must_use]
    pub fn label(&self) -> &str {
        &self.label
    }

    /// The figures of the run, as it ended.
    #[must_use]
    pub fn summary(&self) -> &Summary {
        &self.summary
    }

    /// The mission after the last slot.
    #[must_use]
    pub fn mission(&self) -> &Mission {
        &self.mission
    }

    /// What the trace says of the last slot.
    #[must_use]
    pub fn last_recorded(&self) -> Option<&RecordedSlot> {
        self.recorded.as_ref()
    }

    /// The next slot; `None` after the last on record. In a slot that had no plan in time the plan is to hold.
    ///
    /// # Errors
    /// If the trace cannot be read, or the mission does not lead to its next line.
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

    /// Refuses a trace whose end is not that of the run's summary.
    fn check_end(&self) -> Result<(), MissionError> {
        self.lines.check_end(self.log.hash(), &self.summary)
    }
}

/// The figures of a run that has ended, if its trace is the one that they are of. The lines are read, but not flown
/// again.
///
/// # Errors
/// If it has not ended, or its trace was changed since.
pub fn checked_summary(folder: &RunFolder) -> Result<Summary, MissionError> {
    let summary = folder.summary()?;
    let (_, reader) = folder.reopen_slot_log()?;
    let mut lines = RecordedLines::new(folder, reader, summary.planned_slots);
    let mut hash = 0;
    while lines.next_slot()?.is_some() {
        hash = chained(hash, lines.line());
    }
    lines.check_end(hash, &summary)?;
    Ok(summary)
}
