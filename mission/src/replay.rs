//! Replay of a recorded mission: its trace is flown again by the recorded plans. This recovers what the trace does not
//! hold, such as the queues, and verifies every line.

use std::path::Path;
use std::time::Duration;

use skysink_common::error::InputError;
use skysink_common::figure::FigureSource;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::{ByUav, SlotRecord};
use skysink_common::stop::Stop;
use skysink_common::terminal::shell_path;
use skysink_planner::settings;

use crate::drive::{Observer, SlotSink as _, drive};
use crate::error::MissionError;
use crate::figures::Summary;
use crate::origin::RunMode;
use crate::plant::Plant;
use crate::record::RunFolder;
use crate::recorded::Recorded;
use crate::tally::Tally;
use crate::trace::RecordedSlot;

/// A recorded mission that is flown again.
pub struct Replay {
    scenario: Scenario,
    list: SensorList,
    label: String,
    run_mode: RunMode,
    plant: Plant,
    trace: Recorded,
    tally: Tally,
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
        let trace = Recorded::open(&folder, &scenario)?;
        let label = folder.run_mode().external_planner.as_ref().unwrap_or(&scenario.planner.strategy).clone();
        let run_mode = folder.run_mode().clone();
        let plant = Plant::new(&scenario, &list);
        let tally = Tally::new(&scenario, &list, &run_mode);
        Ok(Self { plant, run_mode, scenario, list, label, trace, tally, summary })
    }

    /// The scenario as flown.
    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// Its sensor nodes.
    pub fn list(&self) -> &SensorList {
        &self.list
    }

    /// The strategy, or the label of an external planner.
    pub fn label(&self) -> &str {
        &self.label
    }

    /// How the run was flown.
    pub fn run_mode(&self) -> &RunMode {
        &self.run_mode
    }

    /// The summary of the run. Once all slots are flown again, it has the figures that they lead to.
    pub fn summary(&self) -> &Summary {
        &self.summary
    }

    /// The plant after the last slot.
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// Flies all recorded slots.
    ///
    /// # Errors
    /// If the trace cannot be read, the mission does not lead to it, or it does not match the summary; those of the
    /// observers; or on a stop.
    pub fn drive(&mut self, observers: &mut [&mut dyn Observer], stop: &Stop) -> Result<(), MissionError> {
        let observers = observers.iter_mut().map(|observer| &mut **observer as &mut dyn Observer);
        let mut observers: Vec<&mut dyn Observer> = observers.chain([&mut self.tally as &mut dyn Observer]).collect();
        drive(&mut self.plant, &mut self.trace, &mut observers, stop)?.unless_stopped()?;
        self.trace.finish(&self.plant)?;
        self.trace.check_end(&self.summary)?;
        self.recompute(FigureSource::Links);
        Ok(())
    }

    /// Recomputes the summary. Flights that an external flight-sim has reported are not flown again, because the trace
    /// does not hold their links: the ledger is that of the trace, and has to balance with the bits sampled.
    ///
    /// # Errors
    /// As [`Replay::drive`].
    pub fn add_up(&mut self, stop: &Stop) -> Result<(), MissionError> {
        if !self.run_mode.has_reported_flights() {
            return self.drive(&mut [], stop);
        }
        self.tally.start(&self.plant.header());
        while self.trace.add_next(&mut self.plant, &mut self.tally)? {
            stop.check()?;
        }
        self.trace.check_end(&self.summary)?;
        // The trace does not say which served SNs have answered.
        let known = if self.scenario.node_traits().may_refuse { FigureSource::Trace } else { FigureSource::Answers };
        self.recompute(known);
        Ok(())
    }

    /// Replaces the figures of the summary that follow from what is `known`.
    fn recompute(&mut self, known: FigureSource) {
        let again = self.tally.summary(Duration::ZERO, self.trace.log().hash());
        self.summary.recompute(again, known);
    }
}

/// A run that has flown all its slots.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedRun {
    /// The scenario as flown.
    pub scenario: Scenario,
    /// The sensor nodes as flown.
    pub list: SensorList,
    /// The strategy, or the label of an external planner.
    pub strategy: String,
    /// The slots of each UAV; slot t is entry t − 1.
    pub slots: Vec<ByUav<RecordedSlot>>,
    /// By slot and UAV: bits uploaded by each served sensor node, in the order of `scheduled`.
    pub uploads_bits: Vec<ByUav<Vec<u64>>>,
}

impl RecordedRun {
    /// Reads the run in `folder`, and flies it again to check it.
    ///
    /// # Errors
    /// If `folder` is not a run folder, the run is not over or ended early, the scenario, the sensor list or the trace
    /// was changed, or on a stop.
    pub fn read(folder: &Path, stop: &Stop) -> Result<Self, MissionError> {
        let mut replay = Replay::open(folder)?;
        let mut slots: Vec<ByUav<RecordedSlot>> = Vec::new();
        let mut uploads = Uploads { delivered_bits: vec![0; replay.list().sensors().len()], by_slot: Vec::new() };
        replay.drive(&mut [&mut slots, &mut uploads], stop)?;
        let expected = replay.scenario().slots;
        if slots.len() as u64 != expected {
            let last = slots.len();
            let resume = shell_path(folder);
            let message = format_args!(
                "it ends after slot {last}: expected {expected} slots, of a run that has ended (a run of the ring is \
                 resumed by skysink run --resume {resume})"
            );
            return Err(InputError::new("trace", &folder.join("slots.csv"), message).into());
        }
        let Replay { scenario, list, label, .. } = replay;
        Ok(Self { scenario, list, strategy: label, slots, uploads_bits: uploads.by_slot })
    }
}

/// The bits uploaded in each slot, by UAV and served sensor node.
struct Uploads {
    /// Bits delivered so far, by sensor node.
    delivered_bits: Vec<u64>,
    by_slot: Vec<ByUav<Vec<u64>>>,
}

impl Observer for Uploads {
    fn slot(&mut self, record: &SlotRecord, plant: &Plant) -> Result<(), MissionError> {
        let delivered_bits = plant.field().delivered_bits();
        let mut upload_bits = |sensor: usize| {
            let before_bits = std::mem::replace(&mut self.delivered_bits[sensor], delivered_bits[sensor]);
            delivered_bits[sensor] - before_bits
        };
        let uploads_bits = record.uavs().map(|row| {
            let served = row.flight.served_links().iter().map(|link| link.sensor as usize);
            served.map(&mut upload_bits).collect()
        });
        self.by_slot.push(uploads_bits.collect());
        Ok(())
    }
}
