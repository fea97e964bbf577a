//! `skysink simulate`: a mission in one process.

use std::num::NonZeroU64;
use std::time::Instant;

use clap::Args;
use skysink_common::message::QueuesHeader;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::SlotRecord;
use skysink_common::stop::Stop;
use skysink_mission::drive::{Observer, SlotSink};
use skysink_mission::figures::Summary;
use skysink_mission::origin::RunMode;
use skysink_mission::record::RunFolder;
use skysink_mission::summary::OperatorUse;
use skysink_mission::tally::Tally;
use skysink_mission::{Mission, MissionError};
#[cfg(feature = "viewer")]
use skysink_viewer::{Scene, Sinks, SlotView, WallClock};

use crate::error::{Error, LeftToFly};
use crate::options::{MissionOptions, NewFolder, RecordingOptions, ScenarioFile};
use crate::report::{OutputForm, TerminalProgress, print_run};
#[cfg(feature = "viewer")]
use crate::slot_views::SlotViews;
use crate::unflown::warn_of_run;

/// Slots between two updates of the progress bar.
const SHOW_EVERY: u64 = 1000;

/// Simulate a mission in one process.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  skysink simulate scenarios/letter.toml
  skysink simulate scenarios/sparse.toml --strategy gfs --seed 3 --record
  skysink simulate scenarios/letter.toml --set link.bandwidth_hz=5e3")]
pub struct SimulateCommand {
    #[command(flatten)]
    scenario: ScenarioFile,
    #[command(flatten)]
    options: MissionOptions,
    #[command(flatten)]
    recording: RecordingOptions,
    #[command(flatten)]
    form: OutputForm,
}

impl SimulateCommand {
    /// Simulates the mission and prints its results.
    pub fn run(self, stop: &Stop) -> Result<(), Error> {
        let scenario = self.scenario.read(self.options.overrides())?;
        let list = SensorList::of(&scenario)?;
        let mission = Mission::until(&scenario, &list, stop)?;
        let record = self.recording.every();
        let (folder, summary) = simulate(&scenario, &list, mission, &self.options.folder, record, stop)?;
        warn_of_run(&summary, &scenario);
        self.form.print(&summary, || print_run(&folder, &summary))
    }
}

/// Simulates the mission of a scenario over the sensor nodes `list`, writes its run into the folder `new`, and returns
/// it with the summary. After a stop, the folder is complete up to the last slot. A recording for rerun contains every
/// K-th slot, by `record`.
pub fn simulate(
    scenario: &Scenario,
    list: &SensorList,
    mut mission: Mission,
    new: &NewFolder,
    record: Option<NonZeroU64>,
    stop: &Stop,
) -> Result<(RunFolder, Summary), Error> {
    let run_mode = RunMode::default();
    let folder = RunFolder::create(new.out.as_deref(), new.earlier(), scenario, list, &run_mode)?;
    #[cfg(not(feature = "viewer"))]
    if record.is_some() {
        return Err(Error::NoViewer);
    }
    #[cfg(feature = "viewer")]
    let mut recording = record.map(|every| recording(scenario, &folder, list, every)).transpose()?;
    #[cfg(feature = "viewer")]
    let mut views = recording.as_mut().map(|scene| SlotViews(|view: &SlotView| scene.log_slot(view)));
    let mut log = folder.slot_log()?;
    let mut shown = ShownTally {
        tally: Tally::new(scenario, list, &run_mode),
        progress: TerminalProgress::of_slots(),
        slots: scenario.slots,
    };
    let mut observers: Vec<&mut dyn Observer> = vec![&mut log, &mut shown];
    #[cfg(feature = "viewer")]
    observers.extend(views.as_mut().map(|views| views as &mut dyn Observer));

    let begin = Instant::now();
    let driven = mission.drive(&mut observers, stop);
    let wall = begin.elapsed();
    let ShownTally { tally, progress, .. } = shown;
    drop(progress);
    let flown = driven.map_err(Error::from).and_then(|end| Ok(end.unless_stopped()?));
    #[cfg(feature = "viewer")]
    let flown = flown.and(recording.map_or(Ok(()), Scene::close).map_err(Error::from));
    let mut summary = tally.summary(wall, log.hash());
    summary.search = mission.planner.counts().into_iter().map(OperatorUse::from).collect();
    summary.complete &= flown.is_ok();
    let written = folder.finish(&log, &mut summary).map_err(Error::from);
    match flown.and(written) {
        Err(first) => Err(first.ended_early(&folder, summary.slots, &LeftToFly::Slots { options: String::new() })),
        Ok(()) => Ok((folder, summary)),
    }
}

/// A tally that shows its progress.
struct ShownTally {
    tally: Tally,
    progress: TerminalProgress,
    /// Slots of the mission.
    slots: u64,
}

impl SlotSink for ShownTally {
    fn start(&mut self, header: &QueuesHeader) {
        self.tally.start(header);
    }

    fn add(&mut self, record: &SlotRecord) -> Result<(), MissionError> {
        self.tally.add(record)?;
        if record.slot().is_multiple_of(SHOW_EVERY) {
            self.progress.show_run(&self.tally, self.slots);
        }
        Ok(())
    }
}

/// Opens the recording of a simulation. It contains no wall-clock times, so that equal missions give equal recordings.
#[cfg(feature = "viewer")]
fn recording(scenario: &Scenario, folder: &RunFolder, list: &SensorList, every: NonZeroU64) -> Result<Scene, Error> {
    let sinks = Sinks { save: Some(folder.recording()), every: Some(every), ..Sinks::default() };
    let name = format!("{}-{}-{}", scenario.name, scenario.planner.strategy, scenario.seed);
    let estimated = skysink_planner::settings::estimated(scenario).map_err(MissionError::from)?;
    Ok(Scene::open(
        &sinks,
        scenario,
        &std::sync::Arc::new(list.sensors_of(scenario)),
        &name,
        WallClock::Unmeasured,
        estimated,
    )?)
}
