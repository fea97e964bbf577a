//! A trace on record: its lines, and the pilot that flies it again.

use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::path::PathBuf;

use skysink_common::error::InputError;
use skysink_common::message::Mode;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::slot_record::{ByUav, UAV};
use skysink_flight_sim::Orders;

use crate::drive::{End, Ended, Pilot, SlotSink as _};
use crate::error::{FileContext, MissionError};
use crate::figures::Summary;
use crate::origin::RunMode;
use crate::plant::Plant;
use crate::record::RunFolder;
use crate::slot_log::SlotLog;
use crate::tally::Tally;
use crate::trace::RecordedSlot;

/// The lines of a trace, slot by slot.
#[derive(Debug)]
pub struct RecordedLines {
    path: PathBuf,
    reader: BufReader<File>,
    uavs: usize,
    slots: u64,
    slot: u64,
    /// The lines of the last slot, one for each UAV.
    lines: Vec<u8>,
    /// Where the last line that was read begins in `lines`.
    last: usize,
    /// The number of the last line in the file; the header is line 1.
    number: usize,
}

impl RecordedLines {
    /// The lines after the header of the trace of a mission in `folder`.
    #[must_use]
    pub fn new(folder: &RunFolder, reader: BufReader<File>, scenario: &Scenario) -> Self {
        let Scenario { slots, ref uav, .. } = *scenario;
        Self { path: folder.slots(), reader, uavs: uav.uavs(), slots, slot: 0, lines: Vec::new(), last: 0, number: 1 }
    }

    /// The next recorded slot of each UAV; `None` after the last slot whose lines are complete.
    ///
    /// # Errors
    /// If a line is not that of the next slot and UAV, or cannot be read.
    pub fn next_slot(&mut self) -> Result<Option<ByUav<RecordedSlot>>, MissionError> {
        self.lines.clear();
        let mut recorded = ByUav::new();
        for uav in 0..self.uavs {
            self.last = self.lines.len();
            self.reader.read_until(b'\n', &mut self.lines).at(&self.path)?;
            if !self.lines[self.last..].ends_with(b"\n") {
                return Ok(None);
            }
            self.number += 1;
            recorded.push(self.check_line(uav)?);
        }
        self.slot += 1;
        Ok(Some(recorded))
    }

    /// The last line, which is refused unless it is that of the next slot of the UAV number `uav`.
    fn check_line(&self, uav: usize) -> Result<RecordedSlot, MissionError> {
        let slots = self.slots;
        let slot = self.slot + 1;
        let recorded = RecordedSlot::parse(&self.lines[self.last..]);
        let recorded = recorded.ok_or_else(|| self.refuse("expected a slot as skysink run writes it"))?;
        if slot > slots {
            return Err(self.refuse(&format!("expected the end, after {slots} slots")));
        }
        if recorded.slot != slot {
            return Err(self.refuse(&format!("slot {}: expected slot {slot} of {slots}", recorded.slot)));
        }
        if recorded.mode == Mode::Serve && recorded.scheduled.is_empty() {
            return Err(self.refuse(
                "mode serve without a sensor node: expected fly (an earlier version wrote serve; a new run of \
                 scenario.toml flies the same)",
            ));
        }
        if recorded.uav != uav {
            return Err(self.refuse(&format!("uav {}: expected {uav}", recorded.uav)));
        }
        Ok(recorded)
    }

    /// The lines of the last slot, each with its newline.
    pub fn lines(&self) -> &[u8] {
        &self.lines
    }

    /// The error for the last line.
    pub fn refuse(&self, what: &str) -> MissionError {
        let line = String::from_utf8_lossy(&self.lines[self.last..]);
        InputError::line("trace", &self.path, self.number, &line, what).into()
    }

    /// The error for a line that the mission, flown like `mode`, does not reproduce.
    pub fn changed(&self, mode: &RunMode) -> MissionError {
        let or_another =
            if mode.has_reported_flights() { ", or the external flight-sim had another channel" } else { "" };
        let what = "it differs from the simulation of the scenario: it or an earlier line was modified";
        self.refuse(&format!("{what}{or_another}"))
    }
}

/// All recorded slots of each UAV in the folder of a run that has ended, without a replay.
///
/// # Errors
/// If the scenario is refused, or a line is not that of its slot.
pub fn recorded_slots(folder: &RunFolder) -> Result<Vec<ByUav<RecordedSlot>>, MissionError> {
    let scenario = Scenario::read(&folder.scenario(), Overrides::default())?;
    let (_, reader) = folder.reopen_slot_log()?;
    let mut lines = RecordedLines::new(folder, reader, &scenario);
    std::iter::from_fn(|| lines.next_slot().transpose()).collect()
}

/// The entry of `slot`, from 1, in the slots of a trace; `None` if there is none.
#[must_use]
pub fn slot_of(slots: &[ByUav<RecordedSlot>], slot: u64) -> Option<&ByUav<RecordedSlot>> {
    slots.get(usize::try_from(slot).ok()?.checked_sub(1)?)
}

/// A pilot that flies a trace again, and checks that the mission leads to each of its lines.
#[derive(Debug)]
pub struct Recorded {
    lines: RecordedLines,
    log: SlotLog,
    /// How the run was flown.
    mode: RunMode,
    /// The last slot that was compared with its line.
    compared: u64,
}

impl Recorded {
    /// The trace of a mission in `folder`.
    ///
    /// # Errors
    /// If it does not begin with the header of a trace.
    pub fn open(folder: &RunFolder, scenario: &Scenario) -> Result<Self, MissionError> {
        let (log, reader) = folder.reopen_slot_log()?;
        let mode = folder.run_mode().clone();
        Ok(Self { lines: RecordedLines::new(folder, reader, scenario), log, mode, compared: 0 })
    }

    /// Compares the last flown slot with its lines, and reads the next ones; `None` after the last complete slot.
    ///
    /// # Errors
    /// If the mission does not lead to the line, or the next line is not that of the next slot or cannot be read.
    pub fn next_slot(&mut self, plant: &Plant) -> Result<Option<ByUav<RecordedSlot>>, MissionError> {
        if plant.slot() > self.compared {
            self.compared = plant.slot();
            if !self.log.repeat(self.lines.lines(), plant.flights(), &plant.header())? {
                return Err(self.lines.changed(&self.mode));
            }
        }
        self.lines.next_slot()
    }

    /// Compares the last flown slot with its line, and refuses a trace that goes on after it.
    ///
    /// # Errors
    /// As [`Recorded::next_slot`].
    pub fn finish(&mut self, plant: &Plant) -> Result<(), MissionError> {
        self.next_slot(plant).map(drop)
    }

    /// Adds the next slot to `tally` with the bits of its lines, instead of those of links that the trace does not
    /// hold; false after the last complete slot. `plant` gives the bits sampled.
    pub(crate) fn add_next(&mut self, plant: &mut Plant, tally: &mut Tally) -> Result<bool, MissionError> {
        let Some(slots) = self.lines.next_slot()? else { return Ok(false) };
        let before = tally.sums.totals;
        let mut record = plant.fly(&self.mode.orders_of(&slots)).clone();
        let RecordedSlot { delivered_bits, lost_bits, queued_bits, .. } = slots[UAV];
        let totals = &mut record.header.totals;
        totals.delivered_bits = before.delivered_bits.saturating_add(delivered_bits);
        totals.lost_bits = before.lost_bits.saturating_add(lost_bits);
        totals.queued_bits = queued_bits;
        record.header.delivered_bits = delivered_bits;
        record.header.lost_bits = lost_bits;
        let is_balanced = record.header.totals.is_balanced();
        if !is_balanced || !self.log.repeat(self.lines.lines(), record.flights(), &record.header)? {
            let what = "it differs from the ledger of the scenario: it or an earlier line was modified";
            return Err(self.lines.refuse(what));
        }
        tally.add(&record)?;
        Ok(true)
    }

    /// Refuses a trace whose slots are not those of `summary`.
    pub(crate) fn check_end(&self, summary: &Summary) -> Result<(), MissionError> {
        let found = format!("{} slots of hash {:016x}", self.lines.slot, self.log.hash());
        let expected = format!("{} slots of hash {}", summary.slots, summary.trace_hash);
        if found == expected {
            return Ok(());
        }
        let message = format_args!("{found}: expected {expected}, as in summary.json");
        Err(InputError::new("trace", &self.lines.path, message).into())
    }

    /// The trace so far.
    pub fn log(&self) -> &SlotLog {
        &self.log
    }

    /// The trace, to be continued after the flown slots.
    #[must_use]
    pub fn into_log(self) -> SlotLog {
        self.log
    }
}

impl Pilot for Recorded {
    fn orders(&mut self, plant: &Plant) -> Result<Orders, Ended> {
        let recorded = self.next_slot(plant)?.ok_or(Ended::At(End::OutOfPlans))?;
        Ok(self.mode.orders_of(&recorded))
    }
}
