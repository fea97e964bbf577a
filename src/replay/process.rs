//! The processes of a ring that repeat what is on record.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
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
use skysink_ring::wait::stop_on_signals;

use crate::worker::{RingArguments, exit, join};

/// A process of a run that skysink run supervises.
#[derive(Debug, Parser)]
#[command(version)]
struct Cli {
    #[command(flatten)]
    place: RingArguments,
    /// Repeat what the run in this folder has on record, as skysink replay does.
    #[arg(long, value_name = "RUN")]
    record: Option<PathBuf>,
    /// How fast its slots follow each other at most.
    #[arg(long, default_value = "max", requires = "record")]
    pace: Pace,
}

/// A process of the ring.
type NodeFn = fn(&Scenario, &RingFolder, &Stop) -> Result<(), NodeError>;

/// A process of the ring that repeats these slots.
type RepeatFn = fn(&Scenario, &RingFolder, &Stop, &[RecordedSlot], Pace) -> Result<(), NodeError>;

/// Runs the executable of `role`, which can be repeated.
#[must_use]
pub fn main(role: Role, node: NodeFn, repeat: RepeatFn) -> ExitCode {
    let cli = Cli::parse();
    let stop = stop_on_signals();
    let ended = join(&cli.place).and_then(|(scenario, folder)| match &cli.record {
        None => node(&scenario, &folder, &stop),
        Some(run) => repeat(&scenario, &folder, &stop, &recorded_slots(run).map_err(refused)?, cli.pace),
    });
    exit(role, ended)
}

fn refused(error: MissionError) -> NodeError {
    match error {
        MissionError::Input(error) => error.into(),
        error => NodeError::Recording(Box::new(error)),
    }
}

/// flight-sim, flying what is on record.
///
/// # Errors
/// As that of [`skysink_flight_sim::node::run`].
pub fn repeat_flight(
    scenario: &Scenario,
    folder: &RingFolder,
    stop: &Stop,
    slots: &[RecordedSlot],
    pace: Pace,
) -> Result<(), NodeError> {
    let plan_of = |slot: u64| {
        let recorded = usize::try_from(slot - 1).ok().and_then(|index| slots.get(index));
        recorded.filter(|recorded| !recorded.is_missed()).map(RecordedSlot::plan)
    };
    let recorded = RecordedFlight { plan_of: &plan_of, period: pace.period(scenario.slot_s) };
    skysink_flight_sim::node::repeat::<ipc::Service>(scenario, folder, stop, &recorded)
}

/// planner, sending the recorded decisions: waypoint and schedule. In a slot without one it is to hold.
///
/// # Errors
/// If a peer is missing or wrong, the ring breaks, or `stop` is requested.
pub fn repeat_plans(
    scenario: &Scenario,
    folder: &RingFolder,
    stop: &Stop,
    slots: &[RecordedSlot],
    _pace: Pace,
) -> Result<(), NodeError> {
    send_plans::<ipc::Service>(scenario, folder, stop, slots)
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
