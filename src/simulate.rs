//! `skysink simulate`: a mission in one process.

use std::num::NonZeroU64;
use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;

#[cfg(feature = "viewer")]
use skysink_common::message::{PathPoint, Plan};
#[cfg(feature = "viewer")]
use skysink_mission::mission::FlownSlot;
#[cfg(feature = "viewer")]
use skysink_viewer::{Scene, SceneError, Sinks, SlotView, WallClock};

use crate::error::Error;
use crate::report::TerminalProgress;
use skysink_mission::MissionError;
use skysink_mission::mission::Mission;
use skysink_mission::origin::RunMode;
use skysink_mission::record::RunFolder;
use skysink_mission::summary::{Summary, Tally};

/// Slots between two updates of the progress bar.
const SHOW_EVERY: u64 = 1000;

/// The folder of a new run.
#[derive(Debug, Args)]
pub struct NewFolder {
    /// Run folder [default: runs/NAME-STRATEGY-SEED].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Replace an existing run in the folder --out.
    #[arg(long, requires = "out")]
    pub force: bool,
}

impl NewFolder {
    /// Creates the folder.
    ///
    /// # Errors
    /// As [`RunFolder::create`].
    pub fn create(
        &self,
        scenario: &Scenario,
        list: &SensorList,
        run_mode: &RunMode,
    ) -> Result<RunFolder, MissionError> {
        RunFolder::create(self.out.as_deref(), self.force, scenario, list, run_mode)
    }
}

/// Options for the recording of a simulation.
#[derive(Debug, Args)]
pub struct RecordingOptions {
    /// Write a recording for rerun, mission.rrd.
    #[arg(long)]
    record: bool,
    /// Write a recording with every K-th slot only; events are always recorded.
    #[arg(long, value_name = "K")]
    record_every: Option<NonZeroU64>,
}

impl RecordingOptions {
    /// K of the recording, which contains every K-th slot; `None` for no recording.
    #[must_use]
    pub fn every(&self) -> Option<NonZeroU64> {
        self.record_every.or(self.record.then_some(NonZeroU64::MIN))
    }
}

/// A simulation and where its run is written.
#[derive(Debug)]
pub struct Simulation {
    /// The scenario.
    pub scenario: Scenario,
    /// The folder of the run.
    pub folder: NewFolder,
    /// K of the recording for rerun, which contains every K-th slot; `None` for no recording.
    pub record: Option<NonZeroU64>,
}

/// Simulates a mission over the sensor nodes `list` and returns its folder and summary. After a stop, the folder is
/// complete up to the last slot.
///
/// # Errors
/// If something cannot be written, or on a stop.
pub fn simulate(
    simulation: &Simulation,
    list: &SensorList,
    mut mission: Mission,
    stop: &Stop,
) -> Result<(RunFolder, Summary), Error> {
    let scenario = &simulation.scenario;
    let folder = simulation.folder.create(scenario, list, &RunMode::default())?;
    #[cfg(not(feature = "viewer"))]
    if simulation.record.is_some() {
        return Err(Error::NoViewer);
    }
    #[cfg(feature = "viewer")]
    let mut recording = simulation.record.map(|every| recording(scenario, &folder, list, every)).transpose()?;
    let mut log = folder.slot_log()?;
    let mut tally = Tally::new(scenario, list);
    let progress = TerminalProgress::of_slots();

    let begin = Instant::now();
    tally.start(&mission.header());
    #[cfg(feature = "viewer")]
    record(&mut recording, &mission, None)?;
    mission.set_stop(stop);
    #[cfg_attr(
        not(feature = "viewer"),
        expect(clippy::while_let_on_iterator, reason = "the viewer borrows the mission")
    )]
    while let Some(flown) = mission.next() {
        log.add(&flown.flight, &flown.header)?;
        tally.add(Some(&flown.plan), &flown.flight, &flown.header);
        #[cfg(feature = "viewer")]
        record(&mut recording, &mission, Some(&flown))?;
        if tally.last_slot().is_multiple_of(SHOW_EVERY) {
            progress.show_run(&tally, scenario.slots);
        }
    }
    let wall = begin.elapsed();
    drop(progress);
    #[cfg(feature = "viewer")]
    recording.map_or(Ok(()), Scene::close)?;
    let summary = tally.summary(None, wall, log.hash());
    folder.write_json("summary.json", &summary)?;
    match stop.check() {
        Err(stopped) if !summary.complete => Err(Error::from(stopped).ended_early(&folder, summary.slots, "")),
        _ => Ok((folder, summary)),
    }
}

/// Opens the recording of a simulation. It contains no wall-clock times, so that equal missions give equal recordings.
#[cfg(feature = "viewer")]
fn recording(scenario: &Scenario, folder: &RunFolder, list: &SensorList, every: NonZeroU64) -> Result<Scene, Error> {
    let sinks = Sinks { save: Some(folder.recording()), every: Some(every), ..Sinks::default() };
    let name = format!("{}-{}-{}", scenario.name, scenario.planner.strategy, scenario.seed);
    let estimated = skysink_planner::settings::estimated(scenario).map_err(MissionError::from)?;
    Ok(Scene::open(&sinks, scenario, &list.nodes(), &name, WallClock::Unmeasured, estimated)?)
}

/// Records the last slot, if there is a recording. `flown` is `None` before slot 1.
#[cfg(feature = "viewer")]
fn record(recording: &mut Option<Scene>, mission: &Mission, flown: Option<&FlownSlot>) -> Result<(), SceneError> {
    let Some(scene) = recording else { return Ok(()) };
    let header = mission.header();
    let plan = flown.map(|flown| Plan { plan_ns: 0, ..flown.plan });
    let path: Vec<PathPoint> = mission.planner().path().iter().copied().map(PathPoint::from).collect();
    scene.log_slot(&SlotView {
        slot: header.head.slot,
        queues_bits: mission.queues_bits(),
        header: &header,
        plan: plan.as_ref(),
        path: &path,
        flight: mission.last_flight(),
        slots_per_s: None,
        plan_ms: None,
    })
}
