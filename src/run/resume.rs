//! Resumes an interrupted run: simulates the recorded slots in one process and compares them with the trace.
//!
//! The state after the last recorded slot becomes the checkpoints from which the processes of a new ring resume.

use skysink_common::error::InputError;
use skysink_common::estimate::{Estimate, Rates};
use skysink_common::pace::Pace;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_field_sim::journal::FieldJournal;
use skysink_flight_sim::journal as flights;
use skysink_mission::Mission;
use skysink_mission::origin::RunMode;
use skysink_mission::record::RunFolder;
use skysink_mission::replay::RecordedLines;
use skysink_mission::slot_log::SlotLog;
use skysink_mission::summary::Tally;
use skysink_planner::node::journal;
use skysink_planner::settings;
use skysink_planner::strategies::horizon::HorizonKeys;
use skysink_ring::folder::RingFolder;

use crate::error::Error;

/// The state of an interrupted run after its last recorded slot.
pub struct ResumedRun {
    /// The trace, to be continued.
    pub log: SlotLog,
    mission: Mission,
}

/// Simulates the recorded slots of `folder` and adds them to `tally`. An incomplete last line is dropped, and its slot
/// is flown again by the ring.
///
/// Most plans are computed again. These are taken from the trace, because they cannot be reproduced: slots without a
/// plan in time, plans of an external planner, plans of a search with a time limit, and, for a planner with state, all
/// plans after a late one.
///
/// # Errors
/// If another process is writing the folder, or a line differs from the simulation.
pub fn resume(
    folder: &RunFolder,
    scenario: &Scenario,
    list: &SensorList,
    tally: &mut Tally,
    stop: &Stop,
) -> Result<ResumedRun, Error> {
    let (mut log, trace) = folder.reopen_slot_log()?;
    let mut lines = RecordedLines::new(folder, trace, scenario.slots);
    let HorizonKeys { budget_ms, .. } = scenario.planner_keys("planner.horizon")?;
    let mut mission = Mission::new(scenario, list)?;
    if let Some(rates) = estimated_rates(scenario, folder.run_mode())? {
        mission = mission.with_estimate(Estimate::new(scenario, rates, &list.nodes()));
    }
    mission.set_stop(stop);
    let mut repeatable = folder.run_mode().external_planner.is_none() && (budget_ms.is_none() || !log.was_in_a_ring());
    tally.start(&mission.header());
    while let Some(recorded) = lines.next_slot()? {
        stop.check()?;
        let planned = mission.plan();
        stop.check()?;
        let header = if recorded.is_missed() {
            repeatable &= !mission.planner().has_state();
            mission.fly(None)
        } else if repeatable {
            mission.fly(Some(&planned))
        } else {
            mission.fly(Some(&recorded.plan()))
        };
        if !log.repeat(lines.line(), mission.last_flight(), &header)? {
            return Err(lines.changed().into());
        }
        tally.add(None, mission.last_flight(), &header);
    }
    let is_lockstep = folder.run_mode().pace.is_none_or(|pace| pace == Pace::Max);
    let is_repeatable = is_lockstep && folder.run_mode().external_planner.is_none();
    if let Some(last) = log.last_checked().filter(|last| *last > tally.last_slot() && !is_repeatable) {
        let message = format_args!("lines up to slot {last} are missing, and these slots cannot be repeated");
        return Err(InputError::new("trace", &folder.slots(), message).into());
    }
    if folder.run_mode().pace.is_some() && tally.last_slot() > 1 && !log.was_checked() {
        let message = "slots.check is missing or belongs to another trace: expected the one written with this trace";
        return Err(InputError::new("run folder", folder.path(), message).into());
    }
    tally.resume();
    Ok(ResumedRun { log, mission })
}

/// How an external planner knows the sampling rates if the queues are estimated; `None` if it gets the true queues.
///
/// # Errors
/// If `[planner]` of the scenario is refused.
pub fn estimated_rates(scenario: &Scenario, run_mode: &RunMode) -> Result<Option<Rates>, InputError> {
    Ok(settings::estimated(scenario)?.filter(|_| run_mode.external_planner.is_some()))
}

impl ResumedRun {
    /// Writes the checkpoints for the processes of the ring in `ring_folder`, and returns the trace, truncated after
    /// the last complete line.
    ///
    /// # Errors
    /// If the trace or the ring folder cannot be written.
    pub fn save_checkpoints(mut self, ring_folder: &RingFolder) -> Result<SlotLog, Error> {
        self.log.resume()?;
        let slot = self.mission.slot();
        if slot == 0 {
            return Ok(self.log);
        }
        let mut field = self.mission.field().clone();
        let count = field.queues_bits().len();
        let planner = self.mission.planner();
        journal(ring_folder, count)?.save(slot, planner)?;
        FieldJournal::open(ring_folder, &mut field)?; // an empty journal starts with this state
        flights::save(&flights::journal(ring_folder)?, slot, self.mission.last_flight())?;
        Ok(self.log)
    }
}
