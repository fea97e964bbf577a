//! flight-sim as a process of the ring: waits for the plan, or for the slot to begin, and publishes the flight.

use std::time::{Duration, Instant};

use iceoryx2::prelude::Service;
use skysink_common::error::InputError;
use skysink_common::message::{FlightReport, HoldReason, Plan, SensorNode};
use skysink_common::pace::Pace;
use skysink_common::scenario::Scenario;
use skysink_common::slot_record::ByUav;
use skysink_common::stop::Stop;
use skysink_ring::error::NodeError;
use skysink_ring::folder::RingFolder;
use skysink_ring::refusals::{Refusal, Refusals};
use skysink_ring::role::Role;
use skysink_ring::topics::{Ring, is_release, monotonic_ns};
use skysink_ring::wait::WaitContext;

use crate::fleet::Fleet;
use crate::journal::{journal, restore};
use crate::orders::Orders;
use crate::outside::{OutsideFleet, OutsideVehicle};

/// A recorded flight, which is flown again regardless of the plans received.
pub struct RecordedFlight<'a> {
    /// The orders for the recorded flights of a slot, from 1; `None` if it was not flown.
    pub orders_of: &'a dyn Fn(u64) -> Option<Orders>,
    /// Shortest time between two slots.
    pub period: Option<Duration>,
}

/// Flies until the mission ends. A restarted process resumes from its journal, and publishes the last flights again,
/// which a peer may have missed.
///
/// # Errors
/// If a peer is missing, the ring fails, or `stop` is requested.
pub fn run<S: Service + 'static>(scenario: &Scenario, folder: &RingFolder, stop: &Stop) -> Result<(), NodeError> {
    fly::<S>(scenario, folder, stop, |nodes| Flying::Simulated(Fleet::new(scenario, nodes)))
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
    fly::<S>(scenario, folder, stop, |nodes| Flying::Recorded {
        fleet: Fleet::new(scenario, nodes),
        recorded,
        next: Instant::now(),
    })
}

/// Lets vehicles from outside fly until the mission ends, with the scenario's channel above where they are. A slot that
/// ends farther than `reached_m` [m] from its waypoint, such as [`REACHED_M`](crate::outside::REACHED_M), has not
/// reached it.
///
/// # Errors
/// As [`run`], and those of the vehicles.
pub fn run_by<S: Service + 'static>(
    scenario: &Scenario,
    folder: &RingFolder,
    stop: &Stop,
    vehicles: &mut [Box<dyn OutsideVehicle>],
    reached_m: f64,
) -> Result<(), NodeError> {
    fly::<S>(scenario, folder, stop, |nodes| Flying::Outside {
        fleet: Box::new(OutsideFleet::new(scenario, nodes, reached_m)),
        vehicles,
    })
}

/// Who flies the slots.
enum Flying<'a> {
    /// The simulated UAVs.
    Simulated(Fleet),
    /// The simulated UAVs, on a recorded flight.
    Recorded { fleet: Fleet, recorded: &'a RecordedFlight<'a>, next: Instant },
    /// Vehicles from outside, one for each UAV.
    Outside { fleet: Box<OutsideFleet>, vehicles: &'a mut [Box<dyn OutsideVehicle>] },
}

impl Flying<'_> {
    /// The UAVs, wherever they are flown.
    fn fleet(&mut self) -> &mut Fleet {
        match self {
            Self::Simulated(fleet) | Self::Recorded { fleet, .. } => fleet,
            Self::Outside { fleet, .. } => &mut fleet.fleet,
        }
    }

    /// Lets the vehicles begin over these sensor nodes, where they are.
    fn begin(&mut self, nodes: &[SensorNode], reports: &[FlightReport]) -> Result<(), NodeError> {
        if let Self::Outside { vehicles, .. } = self {
            vehicles.iter_mut().try_for_each(|vehicle| vehicle.begin(nodes, reports))?;
        }
        Ok(())
    }

    /// Flies a slot by its plans, if they are there; in a paced run it ends at `ends_ns` of the monotonic clock.
    fn step(
        &mut self,
        slot: u64,
        ends_ns: Option<u64>,
        plans: Option<&[Plan]>,
        reports: &mut ByUav<FlightReport>,
        wait: &mut WaitContext,
    ) -> Result<(), NodeError> {
        match self {
            Self::Simulated(fleet) => fleet.step(slot, |uav| plans.map(|plans| &plans[uav]), reports),
            Self::Recorded { fleet, recorded, next } => {
                wait.sleep_until(*next)?;
                *next = Instant::now() + recorded.period.unwrap_or_default();
                match (recorded.orders_of)(slot) {
                    Some(orders) => fleet.fly(slot, &orders, reports),
                    None => fleet.step(slot, |_| None, reports),
                }
            }
            Self::Outside { fleet, vehicles } => {
                let mut orders = fleet.orders(slot, plans);
                orders.iter_mut().for_each(|order| order.ends_ns = ends_ns);
                let refuse = |error| InputError::of_argument("slot", &slot.to_string(), error);
                for (order, (report, vehicle)) in orders.iter().zip(reports.iter_mut().zip(&mut **vehicles)) {
                    *report = vehicle.fly(order).map_err(refuse)?;
                }
                fleet.check(reports).map_err(refuse)?;
                fleet.complete(slot, &orders, reports);
                for (report, vehicle) in reports.iter_mut().zip(&mut **vehicles) {
                    if let Some(bits) = vehicle.delivered() {
                        fleet.deliver(&bits, report).map_err(refuse)?;
                    }
                }
            }
        }
        Ok(())
    }
}

fn fly<'a, S: Service + 'static>(
    scenario: &Scenario,
    folder: &RingFolder,
    stop: &Stop,
    flying: impl FnOnce(&[SensorNode]) -> Flying<'a>,
) -> Result<(), NodeError> {
    let (ring, mut wait) = Ring::<S>::join(folder, scenario, Role::FlightSim, stop)?;
    let flights = ring.flight.list_writer(scenario.uav.uavs())?;
    let mut plans = ring.plan.reader()?;
    let mut ticks = ring.tick.reader()?;

    let mut sensors = ring.sensors.reader()?;
    let nodes = sensors.wait_for_next(&mut wait, 0)?;
    let most_links = scenario.uav.uavs() * nodes.payload().len();
    let links = ring.links.as_ref().map(|links| links.list_writer(most_links)).transpose()?;
    let _sensors = ring.terms.link.is_none().then_some(sensors); // behind a link its repeats would pile up
    let mut flying = flying(nodes.payload());
    let is_recorded = matches!(flying, Flying::Recorded { .. });
    let mut reports = flying.fleet().start();
    let mut journal = journal(folder, reports.len())?;
    let mut flown = restore(&journal, reports.len())?;
    if let Some((_, reports)) = flown.last() {
        flying.fleet().restore(reports);
    } else {
        let start = reports.clone();
        journal.save(0, &[], &start)?;
        flown.push((0, start));
    }
    flying.begin(nodes.payload(), &flown[flown.len() - 1].1)?;
    // The links before the flight, so that its readers have them; both follow from the flight after a restart.
    let publish = |fleet: &Fleet, slot: u64, reports: &[FlightReport]| {
        if let Some(links) = &links {
            links.send_list(ring.header(slot, 0), &fleet.hear(slot, reports))?;
        }
        flights.send_list(ring.header(slot, 0), reports)
    };
    for (slot, reports) in &flown {
        publish(flying.fleet(), *slot, reports)?;
    }

    let mut ends_ns = None;
    for slot in flown.last().map_or(0, |(slot, _)| *slot) + 1..=scenario.slots {
        let plan = match ring.terms.pace {
            Pace::Max => plans.wait_for_slot(&mut wait, slot)?,
            Pace::Factor(_) => {
                if let Some(tick) = ticks.wait_until(&mut wait, slot)? {
                    // The clock of another host is not this one's.
                    let is_local = ring.terms.link.is_none();
                    let begin_ns = if is_local { tick.user_header().sent_ns } else { monotonic_ns() };
                    ends_ns = Some(begin_ns.saturating_add(tick.payload().period_ns));
                }
                plans.poll_slot(slot)?.available()
            }
        };
        flying.step(slot, ends_ns, plan.as_ref().map(|plans| &plans[..]), &mut reports, &mut wait)?;
        if !is_recorded {
            for (uav, report) in reports.iter().enumerate() {
                let plan = plan.as_ref().and_then(|plans| plans.get(uav));
                count_refusals(&ring.refusals, slot, plan, report);
            }
        }
        drop(plan);
        journal.save(slot, &[], &reports)?; // before they are published
        publish(flying.fleet(), slot, &reports)?;
    }
    ring.wait_for_commit(&mut wait, is_release, || Ok(()))
}

/// Counts the refusals of a plan of the slot.
fn count_refusals(refusals: &Refusals, slot: u64, plan: Option<&Plan>, report: &FlightReport) {
    if report.refused > 0 {
        let is_finite = |plan: &Plan| plan.waypoint().iter().all(|coordinate| coordinate.is_finite());
        let refusal = match HoldReason::from_repr(report.hold).unwrap_or_default() {
            HoldReason::Waypoint if !plan.is_none_or(is_finite) => Refusal::NotFinite,
            HoldReason::Waypoint => Refusal::Waypoint,
            HoldReason::Base => Refusal::Base,
            HoldReason::Zone => Refusal::Zone,
            HoldReason::Separation => Refusal::Separation,
            HoldReason::Pad => Refusal::Pad,
            HoldReason::None | HoldReason::NoPlan | HoldReason::Unknown => Refusal::Sensor,
        };
        refusals.add("plan", slot, refusal, u64::from(report.refused));
    }
}
