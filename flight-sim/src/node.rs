//! flight-sim as a process of the ring: waits for the plan, or for the slot to begin, and publishes the flight.

use std::time::{Duration, Instant};

use iceoryx2::prelude::Service;
use skysink_common::message::{FlightReport, HoldReason, Plan};
use skysink_common::pace::Pace;
use skysink_common::scenario::Scenario;
use skysink_common::stop::Stop;
use skysink_ring::error::NodeError;
use skysink_ring::folder::RingFolder;
use skysink_ring::refusals::{Refusal, Refusals};
use skysink_ring::role::Role;
use skysink_ring::topics::{Ring, is_release};

use crate::flight::Flight;
use crate::journal::{journal, restore};

/// A recorded flight, which is flown again regardless of the plans received.
pub struct RecordedFlight<'a> {
    /// The plan for the recorded flight of a slot, from 1; `None` if the slot had no plan in time.
    pub plan_of: &'a dyn Fn(u64) -> Option<Plan>,
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
    let flights = ring.flight.writer()?;
    let mut plans = ring.plan.reader()?;
    let mut ticks = ring.tick.reader()?;

    let mut sensors = ring.sensors.reader()?;
    let nodes = sensors.wait_for_next(&mut wait, 0)?;
    let _sensors = ring.terms.link.is_none().then_some(sensors); // behind a link its repeats would pile up
    let mut flight = Flight::new(scenario, nodes.payload());
    let mut journal = journal(folder)?;
    let mut flown = restore(&journal)?;
    if let Some((_, report)) = flown.last() {
        flight.restore(report);
    } else {
        let start = flight.start();
        journal.save(0, &[], &start)?;
        flown.push((0, start));
    }
    for (slot, report) in &flown {
        flights.send(ring.header(*slot, 0), *report)?;
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
        let report = match recorded {
            None => flight.step(slot, plan.as_ref().map(|plan| plan.payload())),
            Some(recorded) => {
                wait.sleep_until(next)?;
                next = Instant::now() + recorded.period.unwrap_or_default();
                flight.step(slot, (recorded.plan_of)(slot).as_ref())
            }
        };
        drop(plan);
        if recorded.is_none() {
            count_refusals(&ring.refusals, slot, &report);
        }
        journal.save(slot, &[], &report)?; // before it is published
        flights.send(ring.header(slot, 0), report)?;
    }
    ring.wait_for_commit(&mut wait, is_release, || Ok(()))
}

/// Counts the refusals of the slot's plan.
fn count_refusals(refusals: &Refusals, slot: u64, report: &FlightReport) {
    if report.refused > 0 {
        let refusal = match HoldReason::from_repr(report.hold).unwrap_or_default() {
            HoldReason::Waypoint => Refusal::Waypoint,
            HoldReason::None | HoldReason::NoPlan => Refusal::Sensor,
        };
        refusals.add("plan", slot, refusal, u64::from(report.refused));
    }
}
