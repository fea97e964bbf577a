//! The entry points of flight-sim and planner, which can also replay a recorded run.

use std::path::PathBuf;

use clap::Args;
use iceoryx2::prelude::{Service, ipc};
use skysink_common::message::{FLAG_END, Mode, Plan};
use skysink_common::pace::Pace;
use skysink_common::scenario::Scenario;
use skysink_common::slot_record::ByUav;
use skysink_common::stop::Stop;
use skysink_flight_sim::node::RecordedFlight;
use skysink_mission::MissionError;
use skysink_mission::record::RunFolder;
use skysink_mission::recorded::{recorded_slots, slot_of};
use skysink_mission::trace::RecordedSlot;
use skysink_ring::error::NodeError;
use skysink_ring::folder::RingFolder;
use skysink_ring::role::Role;
use skysink_ring::topics::{Ring, is_release};

/// Additional arguments of flight-sim.
#[derive(Debug, Args)]
pub struct FlightSimArguments {
    /// Replay the flight recorded in this run folder (used by skysink replay).
    #[arg(long, value_name = "RUN")]
    replay: Option<PathBuf>,
    /// Maximum speed of the replayed slots: max, realtime, or a factor, for example 10x.
    #[arg(long, default_value = "max", requires = "replay")]
    pace: Pace,
}

/// Additional arguments of planner.
#[derive(Debug, Args)]
pub struct PlannerArguments {
    /// Send the plans recorded in this run folder (used by skysink replay).
    #[arg(long, value_name = "RUN")]
    replay: Option<PathBuf>,
}

/// Runs flight-sim: flies the plans, or replays a recorded flight.
pub fn flight_sim(
    scenario: &Scenario,
    folder: &RingFolder,
    stop: &Stop,
    arguments: &FlightSimArguments,
) -> Result<(), NodeError> {
    let Some(run) = &arguments.replay else {
        return skysink_flight_sim::node::run::<ipc::Service>(scenario, folder, stop);
    };
    let folder_of_run = RunFolder::open_to_read(run).map_err(of_run)?;
    let slots = recorded_slots(&folder_of_run).map_err(of_run)?;
    let mode = folder_of_run.run_mode();
    let orders_of = |slot: u64| slot_of(&slots, slot).map(|recorded| mode.orders_of(recorded));
    let period = arguments.pace.period(scenario.slot_s);
    let recorded = RecordedFlight { orders_of: &orders_of, period };
    skysink_flight_sim::node::replay::<ipc::Service>(scenario, folder, stop, &recorded)
}

/// Runs planner: plans, or sends the recorded waypoints and schedules. For a slot without a recorded decision it sends
/// a plan that holds the position.
pub fn planner(
    scenario: &Scenario,
    folder: &RingFolder,
    stop: &Stop,
    arguments: &PlannerArguments,
) -> Result<(), NodeError> {
    match &arguments.replay {
        None => skysink_planner::node::run::<ipc::Service>(scenario, folder, stop),
        Some(run) => {
            let slots = RunFolder::open_to_read(run).and_then(|run| recorded_slots(&run)).map_err(of_run)?;
            send_plans::<ipc::Service>(scenario, folder, stop, &slots)
        }
    }
}

/// The error of a run that cannot be read.
fn of_run(error: MissionError) -> NodeError {
    match error {
        MissionError::Input(error) => error.into(),
        error => NodeError::Recording(Box::new(error)),
    }
}

fn send_plans<S: Service + 'static>(
    scenario: &Scenario,
    folder: &RingFolder,
    stop: &Stop,
    slots: &[ByUav<RecordedSlot>],
) -> Result<(), NodeError> {
    let (ring, mut wait) = Ring::<S>::join(folder, scenario, Role::Planner, stop)?;
    let plans = ring.plan.list_writer(scenario.uav.uavs())?;
    let mut queues = ring.queues.reader()?;
    let mut next = 0;
    loop {
        let head = queues.wait_for_next(&mut wait, next)?.user_header().head;
        if head.flags & FLAG_END != 0 {
            return ring.wait_for_commit(&mut wait, is_release, || Ok(()));
        }
        if head.slot < next {
            continue; // a restarted field-sim sends its last samples again
        }
        let Some(recorded) = slot_of(slots, head.slot.saturating_add(1)) else {
            return Err(NodeError::NotRecorded(head.slot));
        };
        next = head.slot + 1;
        let plan = |uav: &RecordedSlot| uav.decision().unwrap_or_else(|| Plan::fly_to(uav.position, Mode::Hold));
        plans.send_list(ring.header(next, 0), &recorded.iter().map(plan).collect::<ByUav<_>>())?;
    }
}
