//! flight-sim and planner, which may repeat what is on record.

use std::path::{Path, PathBuf};

use clap::Args;
use iceoryx2::prelude::{Service, ipc};
use skysink_common::message::{FLAG_END, Mode, Plan};
use skysink_common::pace::Pace;
use skysink_common::scenario::Scenario;
use skysink_common::stop::Stop;
use skysink_flight_sim::node::RecordedFlight;
use skysink_mission::MissionError;
use skysink_mission::replay::recorded_slots;
use skysink_mission::trace::RecordedSlot;
use skysink_ring::error::NodeError;
use skysink_ring::folder::RingFolder;
use skysink_ring::role::Role;
use skysink_ring::topics::{RING_BUFFER, Ring, is_release};

/// What flight-sim takes beside its ring.
#[derive(Debug, Args)]
pub struct FlightSimArguments {
    /// Fly what the run in this folder has on record, as skysink replay does.
    #[arg(long, value_name = "RUN")]
    replay: Option<PathBuf>,
    /// How fast its slots follow each other at most.
    #[arg(long, default_value = "max", requires = "replay")]
    pace: Pace,
}

/// What planner takes beside its ring.
#[derive(Debug, Args)]
pub struct PlannerArguments {
    /// Send what the run in this folder has on record, as skysink replay does.
    #[arg(long, value_name = "RUN")]
    replay: Option<PathBuf>,
}

/// flight-sim: flies what is planned, or what is on record.
///
/// # Errors
/// As those of [`skysink_flight_sim::node`]; or if there is no such record.
pub fn flight_sim(
    scenario: &Scenario,
    folder: &RingFolder,
    stop: &Stop,
    arguments: &FlightSimArguments,
) -> Result<(), NodeError> {
    let Some(run) = &arguments.replay else {
        return skysink_flight_sim::node::run::<ipc::Service>(scenario, folder, stop);
    };
    let slots = read(run)?;
    let plan_of = |slot: u64| {
        let recorded = usize::try_from(slot - 1).ok().and_then(|index| slots.get(index));
        recorded.filter(|recorded| !recorded.is_missed()).map(RecordedSlot::plan)
    };
    let recorded = RecordedFlight { plan_of: &plan_of, period: arguments.pace.period(scenario.slot_s) };
    skysink_flight_sim::node::replay::<ipc::Service>(scenario, folder, stop, &recorded)
}

/// planner: plans, or sends the recorded decisions, waypoint and schedule. In a slot without one it is to hold.
///
/// # Errors
/// If a peer is missing or wrong, the ring breaks, or `stop` is requested; or if there is no such record.
pub fn planner(
    scenario: &Scenario,
    folder: &RingFolder,
    stop: &Stop,
    arguments: &PlannerArguments,
) -> Result<(), NodeError> {
    match &arguments.replay {
        None => skysink_planner::node::run::<ipc::Service>(scenario, folder, stop),
        Some(run) => send_plans::<ipc::Service>(scenario, folder, stop, &read(run)?),
    }
}

/// The slots of the run in this folder.
fn read(run: &Path) -> Result<Vec<RecordedSlot>, NodeError> {
    recorded_slots(run).map_err(|error| match error {
        MissionError::Input(error) => error.into(),
        error => NodeError::Recording(Box::new(error)),
    })
}

fn send_plans<S: Service + 'static>(
    scenario: &Scenario,
    folder: &RingFolder,
    stop: &Stop,
    slots: &[RecordedSlot],
) -> Result<(), NodeError> {
    let (ring, mut wait) = Ring::<S>::join(folder, scenario, Role::Planner, stop)?;
    let plans = ring.plan.writer()?;
    let mut queues = ring.truth.reader(RING_BUFFER)?;
    let mut next = 0;
    loop {
        let head = queues.wait_for_next(&mut wait, next)?.user_header().head;
        if head.flags & FLAG_END != 0 {
            return ring.wait_for_commit(&mut wait, is_release, || Ok(()));
        }
        if head.slot < next {
            continue; // a field-sim that was started again repeats itself
        }
        let recorded = usize::try_from(head.slot).ok().and_then(|index| slots.get(index));
        let Some(recorded) = recorded else {
            return Err(NodeError::Peer(format!("slot {}: not on record", head.slot)));
        };
        next = recorded.slot;
        let plan = if recorded.is_missed() { Plan::fly_to(recorded.position, Mode::Hold) } else { recorded.plan() };
        plans.send(ring.header(next, 0), plan)?;
    }
}
