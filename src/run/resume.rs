//! Resuming a run that has ended early: the record is flown again in one process, line by line, and compared.
//!
//! The state after the last line becomes the checkpoints from which the processes of a new ring resume.

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

/// A run as far as it is on record.
pub struct Resumed {
    /// The trace, to be written on.
    pub log: SlotLog,
    mission: Mission,
}

/// Flies what is on record in `folder` again and adds it to `tally`. A last line that is cut is dropped: its slot is
/// flown by the ring.
///
/// Slots without a plan in time are taken from the record, and so are plans that the record alone knows: those from
/// outside, those of a search that was limited by the clock, and, where the planner has a state, those after a plan
/// that came too late, because the record does not tell what the planner did meanwhile.
///
/// # Errors
/// If a run is still writing it, or a line is not what the mission leads to.
pub fn resume(
    folder: &RunFolder,
    scenario: &Scenario,
    list: &SensorList,
    tally: &mut Tally,
    stop: &Stop,
) -> Result<Resumed, Error> {
    let (mut log, trace) = folder.reopen_slot_log()?;
    let mut lines = RecordedLines::new(folder, trace, scenario.slots);
    let HorizonKeys { budget_ms, .. } = scenario.planner_keys("planner.horizon")?;
    let mut mission = Mission::new(scenario, list)?;
    if let Some(rates) = told(scenario, folder.run_mode())? {
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
    let is_flown_again = is_lockstep && folder.run_mode().external_planner.is_none();
    if let Some(last) = log.last_checked().filter(|last| *last > tally.last_slot() && !is_flown_again) {
        let message = format_args!("it ends before slot {last}, which was on record and would be flown otherwise");
        return Err(InputError::new("trace", &folder.slots(), message).into());
    }
    if folder.run_mode().pace.is_some() && tally.last_slot() > 1 && !log.was_checked() {
        let message = "slots.check is missing, or not that of this trace: expected the one that was written with it";
        return Err(InputError::new("run folder", folder.path(), message).into());
    }
    tally.resume();
    Ok(Resumed { log, mission })
}

/// What the field tells a planner that is not Skysink's: by what it knows of the rates, if the queues are estimated.
///
/// # Errors
/// If `[planner]` of the scenario is refused.
pub fn told(scenario: &Scenario, manner: &RunMode) -> Result<Option<Rates>, InputError> {
    Ok(settings::estimated(scenario)?.filter(|_| manner.external_planner.is_some()))
}

impl Resumed {
    /// Saves the state after the last line, from which the processes of the ring in `ring_folder` resume, and returns
    /// the trace, cut behind that line.
    ///
    /// # Errors
    /// If the trace or the ring's folder cannot be written.
    pub fn hand_over(mut self, ring_folder: &RingFolder) -> Result<SlotLog, Error> {
        self.log.resume()?;
        let slot = self.mission.slot();
        if slot == 0 {
            return Ok(self.log);
        }
        let mut field = self.mission.field().clone();
        let count = field.queues_bits().len();
        let planner = self.mission.planner();
        journal(ring_folder, count)?.save(slot, planner)?;
        FieldJournal::open(ring_folder, &mut field)?; // an empty one begins with this state
        flights::save(&flights::journal(ring_folder)?, slot, self.mission.last_flight())?;
        Ok(self.log)
    }
}
