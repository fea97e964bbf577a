//! Resumes an interrupted run: simulates the recorded slots in one process and compares them with the trace.
//!
//! The state after the last recorded slot becomes the checkpoints from which the processes of a new ring resume.

use std::fs;
use std::path::Path;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;

use skysink_common::belief::Belief;
use skysink_common::error::InputError;
use skysink_common::estimate::Rates;
use skysink_common::message::{FlightReport, Mode, Plan};
use skysink_common::pace::Pace;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::Plans;
use skysink_common::stop::Stop;
use skysink_common::told::Received;
use skysink_field_sim::journal as fields;
use skysink_flight_sim::journal as flights;
use skysink_mission::drive::{End, Ended, Pilot};
use skysink_mission::error::FileContext;
use skysink_mission::origin::RunMode;
use skysink_mission::record::RunFolder;
use skysink_mission::recorded::Recorded;
use skysink_mission::slot_log::SlotLog;
use skysink_mission::tally::Tally;
use skysink_mission::trace::RecordedSlot;
use skysink_mission::{MissionError, Orders, Plant, drive};
use skysink_planner::FleetPlanner;
use skysink_planner::node::journal;
use skysink_planner::plan::keys::HorizonKeys;
use skysink_planner::settings;
use skysink_planner::strategy::rule;
use skysink_ring::folder::RingFolder;
use skysink_ring::role::Role;

use crate::error::Error;

/// Time after which the command says what takes so long.
const PATIENCE: Duration = Duration::from_secs(2);

/// The state of an interrupted run after its last recorded slot.
pub struct ResumedRun {
    /// The trace, to be continued.
    pub log: SlotLog,
    plant: Plant,
    planner: FleetPlanner,
}

/// Simulates the recorded slots of `folder` and adds them to `tally`. An incomplete last line is dropped, and its slot
/// is flown again by the ring.
///
/// Most plans are computed again. These are taken from the trace, because they cannot be reproduced: slots without a
/// plan in time, plans of an external planner, plans of a search with a time limit, and, for a planner with state, all
/// plans after a late one. So are the flights that an external flight-sim has reported. A complete run is not planned
/// further once no plan is used.
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
    let (_patience, ended) = channel::<()>(); // hung up when this function returns
    std::thread::spawn(move || say_if_long(&ended));
    let trace = Recorded::open(folder, scenario)?;
    let HorizonKeys { budget_ms, .. } = scenario.planner_keys("planner.horizon")?;
    let belief = Belief::of(scenario, list, estimated_rates(scenario, folder.run_mode())?);
    let are_reports = folder.run_mode().has_reported_flights();
    let mut plant = Plant::new(scenario, list).with_belief(belief);
    let is_ours = folder.run_mode().external_planner.is_none();
    // An external planner finds what it believed of the queues; what its strategy has kept is lost.
    let planner = match is_ours {
        true => FleetPlanner::until(scenario, &list.nodes(), stop)?,
        false => FleetPlanner::by(scenario, &list.nodes(), &mut |_| Ok(rule(|_| None)), stop)?,
    };
    let has_free_budget = budget_ms.is_none() || !trace.log().was_in_a_ring();
    let is_continued = count_lines(&folder.slots())? <= scenario.slots * scenario.uav.uavs() as u64;
    let is_repeatable = is_ours && has_free_budget;
    let mut pilot = Repeating { trace, planner, is_ours, are_reports, is_repeatable, is_continued };
    drive(&mut plant, &mut pilot, &mut [&mut *tally], stop)?.unless_stopped()?;
    pilot.trace.finish(&plant)?;
    let Repeating { trace, planner, .. } = pilot;
    let log = trace.into_log();
    let is_lockstep = folder.run_mode().pace.is_none_or(|pace| pace == Pace::Max);
    let is_repeatable = is_lockstep && is_ours && !are_reports;
    if let Some(last) = log.last_checked().filter(|last| *last > tally.sums.last_slot() && !is_repeatable) {
        let message = format_args!("lines up to slot {last} are missing, and these slots cannot be repeated");
        return Err(InputError::new("trace", &folder.slots(), message).into());
    }
    if folder.run_mode().pace.is_some() && tally.sums.last_slot() > 1 && !log.was_checked() {
        let message = "slots.check is missing or belongs to another trace: expected the one written with this trace";
        return Err(InputError::new("run folder", folder.path(), message).into());
    }
    tally.resume();
    Ok(ResumedRun { log, plant, planner })
}

/// Plans the slots of a trace again, and takes from the trace what cannot be repeated.
struct Repeating {
    trace: Recorded,
    planner: FleetPlanner,
    /// Whether that planner has planned the trace.
    is_ours: bool,
    /// Whether an external flight-sim has reported the flights.
    are_reports: bool,
    /// Whether the next plan is that of the planner.
    is_repeatable: bool,
    /// Whether slots are missing, for which the planner needs its state.
    is_continued: bool,
}

impl Pilot for Repeating {
    fn orders(&mut self, plant: &Plant) -> Result<Orders, Ended> {
        let recorded = self.trace.next_slot(plant)?.ok_or(Ended::At(End::OutOfPlans))?;
        let is_planned = self.is_repeatable || self.is_continued;
        let planned: Plans = match is_planned {
            true => self.planner.orders(plant)?.plans(),
            false => recorded.iter().map(|_| None).collect(),
        };
        if !self.is_ours && is_planned {
            let plans: Vec<Plan> = recorded.iter().map(RecordedSlot::plan).collect();
            self.planner.follow(&plant.sensed(&Received::NOTHING), &plans);
        }
        if recorded.iter().any(RecordedSlot::is_missed) {
            self.is_repeatable &= !self.planner.has_state();
        }
        if self.are_reports {
            return Ok(Orders::Reports(recorded.iter().map(RecordedSlot::report).collect()));
        }
        let is_repeatable = self.is_repeatable;
        let plan = |((recorded, planned), flown): ((&RecordedSlot, Option<Plan>), &FlightReport)| {
            // Whether there was a plan in time is not in the line of a UAV that stayed and went down: it hovers again.
            let is_down = recorded.mode == Mode::Down && recorded.position == flown.position();
            let plan = planned.filter(|_| is_repeatable && !is_down).unwrap_or_else(|| recorded.plan());
            (!recorded.is_missed()).then_some(plan)
        };
        Ok(Orders::Plans(recorded.iter().zip(planned).zip(plant.flights()).map(plan).collect()))
    }
}

/// Says why the command is silent, unless it has `ended` soon.
fn say_if_long(ended: &Receiver<()>) {
    if let Err(RecvTimeoutError::Timeout) = ended.recv_timeout(PATIENCE) {
        Role::Launcher.log("resuming: simulating the recorded slots again, to check each and to go on after the last");
    }
}

/// Number of complete lines of the trace `path`, with its header.
fn count_lines(path: &Path) -> Result<u64, MissionError> {
    let text = fs::read(path).at(path)?;
    Ok(text.iter().filter(|&&byte| byte == b'\n').count() as u64)
}

/// How an external planner knows the sampling rates if the queues are estimated; `None` if it gets the true queues.
pub(crate) fn estimated_rates(scenario: &Scenario, run_mode: &RunMode) -> Result<Option<Rates>, InputError> {
    Ok(settings::estimated(scenario)?.filter(|_| run_mode.external_planner.is_some()))
}

/// Hands the states of the vehicles over MAVLink to the ring.
#[cfg(feature = "mavlink")]
fn resume_vehicles(run: &RunFolder, ring: &RingFolder) -> Result<(), InputError> {
    skysink_vehicle::saved::resume(run.path(), ring.path())
}

/// There are none.
#[cfg(not(feature = "mavlink"))]
fn resume_vehicles(_: &RunFolder, _: &RingFolder) -> Result<(), InputError> {
    Ok(())
}

impl ResumedRun {
    /// Writes the checkpoints for the processes of the ring in `ring_folder`, and returns the trace of `run`, truncated
    /// after the last complete line.
    ///
    /// # Errors
    /// If a file cannot be read or written.
    pub(crate) fn save_checkpoints(mut self, run: &RunFolder, ring_folder: &RingFolder) -> Result<SlotLog, Error> {
        self.log.resume()?;
        resume_vehicles(run, ring_folder)?;
        let slot = self.plant.slot();
        if slot == 0 {
            return Ok(self.log);
        }
        let mut field = self.plant.field().clone();
        let count = field.queues_bits().len();
        let uavs = self.plant.flights().len();
        journal(ring_folder, count, uavs)?.save(slot, &[], &self.planner)?;
        // An empty journal starts with this state.
        fields::resume(&mut fields::journal(ring_folder, &field, uavs)?, &mut field, uavs)?;
        flights::journal(ring_folder, uavs)?.save(slot, &[], self.plant.flights())?;
        Ok(self.log)
    }
}
