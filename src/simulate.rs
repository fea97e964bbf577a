//! `skysink simulate`: a mission in one process.

use std::path::PathBuf;
use std::time::Instant;

use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;

use crate::error::Error;
use crate::report::RunProgress;
use skysink_mission::mission::{FlownSlot, Mission};
use skysink_mission::record::RunFolder;
use skysink_mission::summary::{Summary, Tally};

/// Slots after which the progress is shown again.
const SHOW_EVERY: u64 = 1000;

/// What to simulate and where to put it.
#[derive(Debug)]
pub struct Simulation {
    /// The scenario.
    pub scenario: Scenario,
    /// Folder, if not the default one.
    pub out: Option<PathBuf>,
    /// Whether a run in that folder may be replaced.
    pub force: bool,
    /// Whether to leave a recording for rerun.
    pub record: bool,
}

/// Flies the mission, and returns its folder and its figures. A stop leaves a folder that is whole up to the last slot.
///
/// # Errors
/// If the sensor list is refused or something cannot be written.
pub fn simulate(simulation: &Simulation, stop: &Stop) -> Result<(RunFolder, Summary), Error> {
    let list = SensorList::of(&simulation.scenario)?;
    let mission = Mission::new(&simulation.scenario, &list)?;
    simulate_mission(simulation, &list, mission, stop)
}

/// Flies a mission that was made ready, over the sensor nodes `list`, as [`simulate`] does.
///
/// # Errors
/// As [`simulate`].
pub fn simulate_mission(
    simulation: &Simulation,
    list: &SensorList,
    mut mission: Mission,
    stop: &Stop,
) -> Result<(RunFolder, Summary), Error> {
    let scenario = &simulation.scenario;
    let folder = RunFolder::create(simulation.out.as_deref(), simulation.force, scenario, list)?;
    let mut recording = Recording::open(simulation, &folder, list)?;
    let mut log = folder.slot_log()?;
    let mut tally = Tally::new(scenario, list);
    let progress = RunProgress::new(scenario.slots);

    let begin = Instant::now();
    tally.start(&mission.header());
    recording.log(&mission, None)?;
    let mut stopped = Ok(());
    while stopped.is_ok() {
        let Some(flown) = mission.next() else { break };
        log.add(&flown.flight, &flown.header)?;
        tally.add(Some(&flown.plan), &flown.flight, &flown.header);
        recording.log(&mission, Some(&flown))?;
        if tally.last_slot().is_multiple_of(SHOW_EVERY) {
            progress.show(&tally);
        }
        stopped = stop.check();
    }
    let wall = begin.elapsed();
    progress.finish();
    recording.close()?;
    let summary = tally.summary(None, wall, log.hash());
    folder.write_summary(&summary)?;
    stopped?;
    Ok((folder, summary))
}

/// The recording of a simulation, if one is wanted. It knows no clock, so that equal missions leave equal recordings.
struct Recording {
    #[cfg(feature = "viewer")]
    scene: Option<skysink_viewer::Scene>,
}

#[cfg(feature = "viewer")]
impl Recording {
    fn open(simulation: &Simulation, folder: &RunFolder, list: &SensorList) -> Result<Self, Error> {
        use skysink_viewer::{Scene, Sinks, WallClock};
        if !simulation.record {
            return Ok(Self { scene: None });
        }
        let scenario = &simulation.scenario;
        let sinks = Sinks { save: Some(folder.recording()), live: None };
        let name = format!("{}-{}-{}", scenario.name, scenario.planner.strategy, scenario.seed);
        let nodes = list.nodes();
        Ok(Self { scene: Some(Scene::open(&sinks, scenario, &nodes, &name, WallClock::Unmeasured)?) })
    }

    fn log(&mut self, mission: &Mission, flown: Option<&FlownSlot>) -> Result<(), Error> {
        use skysink_common::path::PathPoint;
        let Some(scene) = &mut self.scene else { return Ok(()) };
        let header = mission.header();
        let plan = flown.map(|flown| skysink_common::message::Plan { plan_ns: 0, ..flown.plan });
        let path: Vec<PathPoint> = mission.path().iter().copied().map(PathPoint::from).collect();
        scene.log_slot(&skysink_viewer::SlotView {
            slot: header.head.slot,
            queues_bits: mission.queues_bits(),
            header: &header,
            plan: plan.as_ref(),
            path: &path,
            flight: mission.last_flight(),
            slots_per_s: None,
            plan_ms: None,
        })?;
        Ok(())
    }

    fn close(self) -> Result<(), Error> {
        Ok(self.scene.map_or(Ok(()), skysink_viewer::Scene::close)?)
    }
}

#[cfg(not(feature = "viewer"))]
impl Recording {
    fn open(simulation: &Simulation, _: &RunFolder, _: &SensorList) -> Result<Self, Error> {
        if simulation.record { Err(Error::NoViewer) } else { Ok(Self {}) }
    }

    fn log(&mut self, _: &Mission, _: Option<&FlownSlot>) -> Result<(), Error> {
        Ok(())
    }

    fn close(self) -> Result<(), Error> {
        Ok(())
    }
}
