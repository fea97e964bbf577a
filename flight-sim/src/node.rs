//! flight-sim as a process of the ring: waits for the plan, or for the slot to begin, and publishes the flight.

use std::time::{Duration, Instant};

use iceoryx2::prelude::Service;
use skysink_common::message::{FlightReport, HoldReason, Plan};
use skysink_common::pace::Pace;
use skysink_common::scenario::Scenario;
use skysink_common::slot_record::Plans;
use skysink_common::stop::Stop;
use skysink_ring::error::NodeError;
use skysink_ring::folder::RingFolder;
use skysink_ring::refusals::{Refusal, Refusals};
use skysink_ring::role::Role;
use skysink_ring::topics::{Ring, is_release};

use crate::fleet::Fleet;
#[cfg(doc)]
use crate::flight::Flight;
use crate::journal::{journal, restore};

/// A recorded flight, which is flown again regardless of the plans received.
pub struct RecordedFlight<'a> {
    /// The plan for the recorded flight of a UAV, by its number, in a slot, from 1; `None` if there was none in time.
    pub plan_of: &'a dyn Fn(usize, u64) -> Option<Plan>,
    /// Whether the plans are the flights that another flight-sim has reported, as [`Flight::repeat`] takes them.
    pub are_reports: bool,
    /// Shortest time between two slots.
    pub period: Option<Duration>,
}

/// Flies until the mission ends. A restarted process resumes from its journal, and publishes the last flights again,
/// which a peer may have missed.
///
/// # Errors
/// If a peer is missing, the ring fails, or `stop` is requested.
pub fn run<S: Service + 'static>(scenario: &Scenario, folder: &RingFolder, stop: &Stop) -> Result<(), NodeError> {
    fly::<S>(scenario, folder, stop, None)
}

/// Flies the recorded flight until the mission ends. Waits for the plan of each slot, but does not follow it.
///
/// # Errors
/// As [`run`].
pub fn replay<S: Service + 'static>(
    scenario: &Scenario,
    folder: &RingFolder,
    stop: &Stop,
    recorded: &RecordedFlight,
) -> Result<(), NodeError> {
    fly::<S>(scenario, folder, stop, Some(recorded))
}

fn fly<S: Service + 'static>(
    scenario: &Scenario,
    folder: &RingFolder,
    stop: &Stop,
    recorded: Option<&RecordedFlight>,
) -> Result<(), NodeError> {
    let (ring, mut wait) = Ring::<S>::join(folder, scenario, Role::FlightSim, stop)?;
    let flights = ring.flight.list_writer(scenario.uav.uavs())?;
    let mut plans = ring.plan.reader()?;
    let mut ticks = ring.tick.reader()?;

    let mut sensors = ring.sensors.reader()?;
    let nodes = sensors.wait_for_next(&mut wait, 0)?;
    let _sensors = ring.terms.link.is_none().then_some(sensors); // behind a link its repeats would pile up
    let mut fleet = Fleet::new(scenario, nodes.payload());
    let mut reports = fleet.start();
    let mut journal = journal(folder, reports.len())?;
    let mut flown = restore(&journal, reports.len())?;
    if let Some((_, reports)) = flown.last() {
        fleet.restore(reports);
    } else {
        let start = reports.clone();
        journal.save(0, &[], &start)?;
        flown.push((0, start));
    }
    for (slot, reports) in &flown {
        flights.send_list(ring.header(*slot, 0), reports)?;
    }

    let mut next = Instant::now();
    for slot in flown.last().map_or(0, |(slot, _)| *slot) + 1..=scenario.slots {
        let plan = match ring.terms.pace {
            Pace::Max => plans.wait_for_slot(&mut wait, slot)?,
            Pace::Factor(_) => {
                ticks.wait_until(&mut wait, slot)?;
                plans.poll_slot(slot)?.available()
            }
        };
        if let Some(recorded) = recorded {
            wait.sleep_until(next)?;
            next = Instant::now() + recorded.period.unwrap_or_default();
        }
        match recorded {
            None => fleet.step(slot, |uav| plan.as_ref().map(|plans| &plans[uav]), &mut reports),
            Some(recorded) => {
                let plans: Plans = (0..reports.len()).map(|uav| (recorded.plan_of)(uav, slot)).collect();
                let plan_of = |uav: usize| plans[uav].as_ref();
                if recorded.are_reports {
                    fleet.repeat(slot, plan_of, &mut reports);
                } else {
                    fleet.step(slot, plan_of, &mut reports);
                }
            }
        }
        drop(plan);
        if recorded.is_none() {
            reports.iter().for_each(|report| count_refusals(&ring.refusals, slot, report));
        }
        journal.save(slot, &[], &reports)?; // before they are published
        flights.send_list(ring.header(slot, 0), &reports)?;
    }
    ring.wait_for_commit(&mut wait, is_release, || Ok(()))
}

/// Counts the refusals of a plan of the slot.
fn count_refusals(refusals: &Refusals, slot: u64, report: &FlightReport) {
    if report.refused > 0 {
        let refusal = match HoldReason::from_repr(report.hold).unwrap_or_default() {
            HoldReason::Waypoint => Refusal::Waypoint,
            HoldReason::Base => Refusal::Base,
            HoldReason::Zone => Refusal::Zone,
            HoldReason::Separation => Refusal::Separation,
            HoldReason::None | HoldReason::NoPlan => Refusal::Sensor,
        };
        refusals.add("plan", slot, refusal, u64::from(report.refused));
    }
}
