//! `skysink run`: flies a mission as a ring of processes.

pub mod command;
pub mod executables;
pub mod external;
pub mod heartbeat;
pub mod limits;
pub mod link;
pub mod options;
pub mod process;
pub mod recorder;
pub mod restart;
pub mod resume;
pub mod ring_mission;
pub mod supervise;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::origin::RunMode;
use skysink_mission::record::RunFolder;
use skysink_mission::summary::{Summary, Tally};

use crate::error::Error;
use crate::options::NewFolder;
use options::{Launch, RunOptions};
use resume::{ResumedRun, resume};
use ring_mission::{RingMission, clean_up, make_ring};

/// A run: its scenario, folder and options.
#[derive(Debug)]
pub struct Run {
    /// The scenario.
    pub scenario: Scenario,
    /// The folder of a new run.
    pub folder: NewFolder,
    /// The folder of an interrupted run to resume.
    pub resume: Option<PathBuf>,
    /// The options of the processes.
    pub options: RunOptions,
}

/// Flies the mission and returns its folder and summary. However the run ends, the folder is complete up to the last
/// slot and shared memory is cleaned up.
///
/// # Errors
/// If this build has no viewer, the sensor list is refused, a process ends and is not restarted or does not answer, a
/// file cannot be written, or on a stop.
pub fn run(run: &Run, stop: &Stop) -> Result<(RunFolder, Summary), Error> {
    let Run { scenario, options, .. } = run;
    let list = SensorList::of(scenario)?;
    options.check(&list)?;
    let BegunRun { folder, mode, mut tally, resumed } = run.begin(&list, stop)?;
    if tally.last_slot() == scenario.slots {
        let hash = resumed.map_or(0, |resumed| resumed.log.hash());
        let summary = tally.summary(Duration::ZERO, hash);
        return complete(folder, summary);
    }
    let ring = make_ring(scenario, options, &mode, mode.pace.unwrap_or_default())?;
    let mut log = match resumed {
        None => folder.slot_log()?,
        Some(resumed) => {
            folder.remove_sensor_results()?; // they covered the slots so far
            resumed.save_checkpoints(&ring)?
        }
    };
    let launch = Launch::of(&folder);
    let mission = RingMission { scenario, options, launch: &launch, ring: &ring, stop };
    let begin = Instant::now();
    let recorded = mission.record(&mut log, &mut tally);
    let wall = *recorded.as_ref().unwrap_or(&begin.elapsed());
    let mut summary = tally.summary(wall, log.hash());
    summary.complete &= recorded.is_ok();
    let written = folder.write_json("summary.json", &summary);
    if let Err(cause) = recorded {
        return Err(cause.ended_early(&folder, summary.slots, &options.resume_options())); // the first error
    }
    written?;
    Ok((folder, summary))
}

/// A run before its first slot in the ring.
struct BegunRun {
    folder: RunFolder,
    mode: RunMode,
    /// The slots so far.
    tally: Tally,
    /// The state after these slots; `None` for a new run.
    resumed: Option<ResumedRun>,
}

impl Run {
    /// Creates the folder, or resumes the run in it.
    fn begin(&self, list: &SensorList, stop: &Stop) -> Result<BegunRun, Error> {
        let Self { scenario, options, .. } = self;
        let folder = match &self.resume {
            None => self.folder.create(scenario, list, &options.run_mode(None))?,
            Some(path) => RunFolder::reopen(path)?,
        };
        let mode = options.run_mode(Some(folder.run_mode()));
        let mut tally = Tally::new(scenario, list, &mode);
        let mut resumed = None;
        if self.resume.is_some() {
            options.check_resumed(&folder)?;
            resumed = Some(resume(&folder, scenario, list, &mut tally, stop)?);
        }
        Ok(BegunRun { folder, mode, tally, resumed })
    }
}

/// Completes the folder of a run whose slots are all there.
fn complete(folder: RunFolder, summary: Summary) -> Result<(RunFolder, Summary), Error> {
    if !folder.is_complete() {
        folder.write_json("summary.json", &summary)?; // the only missing file
    }
    clean_up(&folder.recording());
    Ok((folder, summary))
}
