//! `skysink run`: flies a mission as a ring of processes.

pub(crate) mod commands;
pub mod executables;
mod external;
mod heartbeat;
pub(crate) mod limits;
pub mod link;
pub mod options;
mod plan_watch;
pub(crate) mod process;
pub mod recorder;
pub(crate) mod restart;
pub mod resume;
pub(crate) mod ring_mission;
pub(crate) mod supervise;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::Args;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::figures::Summary;
use skysink_mission::origin::RunMode;
use skysink_mission::record::RunFolder;
use skysink_mission::summary::OperatorUse;
use skysink_mission::tally::Tally;
use skysink_planner::settings;
use skysink_planner::strategy::Registered;

use crate::error::{Error, LeftToFly};
use crate::options::{MissionOptions, NewFolder, ScenarioFile};
use crate::report::{OutputForm, print_run};
use crate::unflown::warn_of_run;
use options::{Launch, RunOptions};
use resume::resume;
use ring_mission::{RingMission, clean_up, make_ring};

/// Fly a mission as a ring of processes over shared memory, and record it.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  skysink run                          the paper's mission, unpaced
  skysink run --pace realtime --live   watch it with
                                       rerun rerun+http://127.0.0.1:9876/proxy
  skysink run --external planner       waits for a planner that you start
  skysink run --resume runs/letter-uts-1")]
pub struct RunCommand {
    #[command(flatten)]
    scenario: ScenarioFile,
    #[command(flatten)]
    mission: MissionOptions,
    /// Resume the interrupted run in this folder.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["scenario", "strategy", "seed", "keys", "out", "force"])]
    resume: Option<PathBuf>,
    #[command(flatten)]
    options: RunOptions,
    #[command(flatten)]
    form: OutputForm,
}

impl RunCommand {
    /// Flies the mission and prints its results.
    ///
    /// # Errors
    /// If this build has no viewer, the scenario or the sensor list is refused, a process ends and is not restarted or
    /// does not answer, a file cannot be written or is changed by another process, or on a stop.
    pub fn run(self, stop: &Stop) -> Result<(), Error> {
        let scenario = match &self.resume {
            Some(folder) => {
                Scenario::read(&folder.join("scenario.toml"), Overrides::default()).and_then(settings::resolve)?
            }
            None => self.scenario.read(self.mission.overrides())?,
        };
        let (folder, summary) = self.fly(&scenario, stop)?;
        warn_of_run(&summary, &scenario);
        self.form.print(&summary, || print_run(&folder, &summary))
    }
    /// Flies the mission and returns its folder and summary. However the run ends, the folder is complete up to the
    /// last slot and shared memory is cleaned up.
    fn fly(&self, scenario: &Scenario, stop: &Stop) -> Result<(RunFolder, Summary), Error> {
        let options = &self.options;
        let list = SensorList::of(scenario)?;
        options.check(&list)?;
        let check_vehicle = |mode: &RunMode| options.check_vehicle(scenario, mode.pace.unwrap_or_default());
        let mut folder = match &self.resume {
            None => {
                if !options.has_external_planner() {
                    Registered::of(scenario)?;
                }
                check_vehicle(&options.run_mode(None))?;
                self.create(scenario, &list)?
            }
            Some(path) => RunFolder::reopen(path)?,
        };
        let mode = options.run_mode(Some(folder.run_mode()));
        let mut tally = Tally::new(scenario, &list, &mode);
        let mut resumed = None;
        if self.resume.is_some() {
            check_vehicle(&mode)?;
            options.check_resumed(&folder)?;
            resumed = Some(resume(&folder, scenario, &list, &mut tally, stop)?);
        }
        if tally.sums.last_slot() == scenario.slots {
            let hash = resumed.map_or(0, |resumed| resumed.log.hash());
            let summary = tally.summary(Duration::ZERO, hash);
            return complete(folder, summary);
        }
        folder.set_external(&mode.external)?;
        let ring = make_ring(scenario, options, &mode, mode.pace.unwrap_or_default())?;
        #[cfg(feature = "mavlink")]
        if options.vehicle_addresses().is_some() {
            skysink_vehicle::saved::begin(ring.path())?;
        }
        let mut log = match resumed {
            None => folder.slot_log()?,
            Some(resumed) => {
                folder.remove_derived()?; // they covered the slots so far
                resumed.save_checkpoints(&folder, &ring)?
            }
        };
        let launch = Launch::of(&folder);
        let mission = RingMission { scenario, options, launch: &launch, ring: &ring, stop };
        let begin = Instant::now();
        let recorded = mission.record(&mut log, &mut tally);
        let wall = *recorded.as_ref().unwrap_or(&begin.elapsed());
        let mut summary = tally.summary(wall, log.hash());
        let left = self.left_to_fly(&folder, tally.sums.last_slot() == scenario.slots && stop.requested().is_some());
        summary.search = skysink_planner::node::counts(&ring).into_iter().map(OperatorUse::from).collect();
        summary.complete &= recorded.is_ok() || left == LeftToFly::Nothing;
        let written = folder.finish(&log, &mut summary).map_err(Error::from);
        match recorded.and(written) {
            Err(first) => Err(first.ended_early(&folder, summary.slots, &left)),
            Ok(()) => Ok((folder, summary)),
        }
    }

    /// The folder of a new run.
    fn create(&self, scenario: &Scenario, list: &SensorList) -> Result<RunFolder, Error> {
        #[cfg(feature = "mavlink")]
        if self.options.vehicle_addresses().is_some() {
            skysink_vehicle::apart::check_starts(scenario)?;
        }
        let NewFolder { out, .. } = &self.mission.folder;
        let earlier = self.mission.folder.earlier();
        Ok(RunFolder::create(out.as_deref(), earlier, scenario, list, &self.options.run_mode(None))?)
    }

    /// What is left to fly of a run that ends early, if not all slots `are_recorded`. After the last slot, only a stop
    /// leaves a run as complete as a resumed one.
    fn left_to_fly(&self, run: &RunFolder, are_recorded: bool) -> LeftToFly {
        match (are_recorded, is_overridden(run)) {
            (true, _) => LeftToFly::Nothing,
            (false, true) => LeftToFly::Overridden,
            (false, false) => LeftToFly::Slots { options: self.options.resume_options() },
        }
    }
}

/// Whether others fly a vehicle of the bridge, or none flies any more.
#[cfg(feature = "mavlink")]
fn is_overridden(run: &RunFolder) -> bool {
    skysink_vehicle::saved::is_over(run.path())
}

/// Whether others fly a vehicle: there is none.
#[cfg(not(feature = "mavlink"))]
fn is_overridden(_: &RunFolder) -> bool {
    false
}

/// Completes the folder of a run whose slots are all there, which `again` sums up without times.
fn complete(folder: RunFolder, again: Summary) -> Result<(RunFolder, Summary), Error> {
    let summary = match folder.summary() {
        Ok(written) if written.complete => Summary { resumed_after: again.resumed_after, ..written },
        _ => {
            folder.write_summary(&again)?; // the only missing file
            again
        }
    };
    clean_up(&folder.recording());
    Ok((folder, summary))
}
