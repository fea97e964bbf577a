//! What a slot of a mission leaves, by UAV.

use std::mem::offset_of;

use bytemuck::Zeroable as _;
use smallvec::{SmallVec, smallvec};

use crate::checkpoint::{Checkpoint, CheckpointError};
use crate::geometry::Position;
use crate::message::{FlightReport, LinkReport, Mode, PathPoint, Plan, QueuesHeader};

/// The first UAV of a mission, by its number; the only one of most missions.
pub const UAV: usize = 0;

/// One item for each UAV, in the order of their numbers. The item of a single UAV needs no allocation.
pub type ByUav<T> = SmallVec<[T; 1]>;

/// The plans of a slot; a UAV without one holds its position.
pub type Plans = ByUav<Option<Plan>>;

/// The links of a slot that upload: an SN that several UAVs serve is served by the first of them (decision D19).
pub fn uploads(flights: &[FlightReport]) -> impl Iterator<Item = &LinkReport> {
    flights.iter().enumerate().flat_map(move |(uav, flight)| {
        let is_first = move |link: &&LinkReport| !flights[..uav].iter().any(|other| other.serves(link.sensor));
        flight.served_links().iter().filter(is_first)
    })
}

/// Above where the UAVs are that wake SNs in range (decision D33): those in the air.
pub fn beacons(flights: &[FlightReport]) -> impl Iterator<Item = Position> {
    let is_flying = |flight: &&FlightReport| !matches!(flight.flown_mode(), Mode::Charge | Mode::Down);
    flights.iter().filter(is_flying).map(|flight| flight.position().xy())
}

/// Length of a report without its links [byte].
const REPORT_BYTES: usize = offset_of!(FlightReport, links);

/// The flights of a slot, with the links that count.
impl Checkpoint for ByUav<FlightReport> {
    fn save(&self, bytes: &mut Vec<u8>) {
        for flight in self {
            let length = REPORT_BYTES + size_of_val(flight.served_links());
            bytes.extend_from_slice(&bytemuck::bytes_of(flight)[..length]);
        }
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        let mut rest = bytes;
        let mut restored = self.clone();
        for flight in &mut restored {
            *flight = FlightReport::zeroed();
            let (head, links) = cut(rest, REPORT_BYTES)?;
            bytemuck::bytes_of_mut(flight)[..REPORT_BYTES].copy_from_slice(head);
            let length = size_of_val(flight.served_links());
            let (links, after) = cut(links, length)?;
            bytemuck::bytes_of_mut(flight)[REPORT_BYTES..][..length].copy_from_slice(links);
            rest = after;
        }
        CheckpointError::ensure(rest.is_empty(), "a flight of each UAV")?;
        *self = restored;
        Ok(())
    }
}

/// The first `length` bytes, and the rest.
fn cut(bytes: &[u8], length: usize) -> Result<(&[u8], &[u8]), CheckpointError> {
    CheckpointError::ensure(length <= bytes.len(), "a flight of each UAV")?;
    Ok(bytes.split_at(length))
}

/// What a slot leaves of a UAV.
#[derive(Debug, Clone, Copy)]
pub struct UavSlot<'a> {
    /// The number of the UAV.
    pub uav: usize,
    /// Its plan; `None` if it had none and held its position. In a ring, a plan is also here if it came too late to be
    /// flown.
    pub plan: Option<&'a Plan>,
    /// The planned path, with the waypoint of the slot first. Empty in a ring, and for a planner that does not look
    /// ahead, but for its way home.
    pub path: &'a [PathPoint],
    /// Its flight.
    pub flight: &'a FlightReport,
}

/// What a slot leaves: a row for each UAV, and the ledger after them.
#[derive(Debug, Clone)]
pub struct SlotRecord {
    plans: Plans,
    paths: ByUav<Vec<PathPoint>>,
    flights: ByUav<FlightReport>,
    /// The ledger after the slot.
    pub header: QueuesHeader,
}

/// ```
/// use skysink_common::message::{FlightReport, Mode, PathPoint, Plan, QueuesHeader};
/// use skysink_common::slot_record::{ByUav, SlotRecord};
/// let flights: ByUav<_> = [1.0, 2.0].map(|x_m| FlightReport::at([x_m, 0.0, 20.0], Mode::Serve)).into_iter().collect();
/// let mut record = SlotRecord::unplanned(flights, QueuesHeader::default());
/// let plan = Plan::fly_to([2.0, 0.0, 20.0], Mode::Serve);
/// record.begin(&[None, Some(plan)]);
/// record.add_path(1, [PathPoint::of(1, &plan.waypoint())].into_iter());
/// let of_uavs = record.uavs().map(|row| (row.uav, row.plan.is_some(), row.path.len(), row.flight.x_m));
/// assert!(of_uavs.eq([(0, false, 0, 1.0), (1, true, 1, 2.0)]));
/// ```
impl SlotRecord {
    /// The record of flights without plans.
    #[must_use]
    pub fn unplanned(flights: ByUav<FlightReport>, header: QueuesHeader) -> Self {
        let uavs = flights.len();
        Self { plans: smallvec![None; uavs], paths: smallvec![Vec::new(); uavs], flights, header }
    }

    /// The slot, from 1.
    pub fn slot(&self) -> u64 {
        self.header.head.slot
    }

    /// What the slot leaves of each UAV, in the order of their numbers.
    pub fn uavs(&self) -> impl ExactSizeIterator<Item = UavSlot<'_>> {
        self.flights.iter().enumerate().map(|(uav, flight)| UavSlot {
            uav,
            plan: self.plans[uav].as_ref(),
            path: &self.paths[uav],
            flight,
        })
    }

    /// The flights as one block, as field and messages take them.
    pub fn flights(&self) -> &ByUav<FlightReport> {
        &self.flights
    }

    /// The plans as one block, as a plant takes them.
    pub fn plans(&self) -> &Plans {
        &self.plans
    }

    /// Begins a slot with its plans, and without paths. Returns the flights, for those of the slot to replace the last.
    ///
    /// # Panics
    /// If there is not one entry for each UAV.
    pub fn begin(&mut self, plans: &[Option<Plan>]) -> &mut [FlightReport] {
        self.plans.copy_from_slice(plans);
        self.paths.iter_mut().for_each(Vec::clear);
        &mut self.flights
    }

    /// Adds points to the path of the UAV number `uav`.
    ///
    /// # Panics
    /// If there is no such UAV.
    pub fn add_path(&mut self, uav: usize, path: impl Iterator<Item = PathPoint>) {
        self.paths[uav].extend(path);
    }
}
