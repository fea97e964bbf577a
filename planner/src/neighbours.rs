//! What the UAVs of a fleet tell each other in a slot: prioritised planning (Erdmann and Lozano-Pérez, Algorithmica 2,
//! 1987) against reservations.

use skysink_common::base::Base;
use skysink_common::geometry::Position;
use skysink_common::message::FlightReport;

/// What the other UAVs of a fleet tell a UAV before it plans a slot.
///
/// ```
/// use skysink_planner::neighbours::{Neighbours, Reservations};
/// let reservations = Reservations { separation_m: 0.0, reserved: &[], has_right_of_way: true, base: None, last: 600 };
/// let alone = Neighbours { uav: 0, flights: &[], scheduled: &[], intents: None, reservations };
/// assert_eq!(alone.others().count(), 0);
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Neighbours<'a> {
    /// The number of the UAV that plans.
    pub uav: usize,
    /// The last flight of each UAV, by its number.
    pub flights: &'a [FlightReport],
    /// The SNs that the others have scheduled in this slot, which count as empty. Empty where each has a part of the
    /// field.
    pub scheduled: &'a [u32],
    /// What the others plan to serve, by slot, from those that look ahead; `None` where each has a part of the field.
    pub intents: Option<&'a [PlannedVisit]>,
    /// The places that are reserved for the others.
    pub reservations: Reservations<'a>,
}

impl<'a> Neighbours<'a> {
    /// The numbers of the other UAVs, and their last flights.
    pub fn others(&self) -> impl Iterator<Item = (usize, &'a FlightReport)> {
        let uav = self.uav;
        self.flights.iter().enumerate().filter(move |(number, _)| *number != uav)
    }
}

/// A visit of an SN in a plan.
///
/// ```
/// let visit = skysink_planner::neighbours::PlannedVisit { slot: 7, sensor: 3, bits: f64::INFINITY };
/// assert!(visit.bits > 30_000.0); // it empties the buffer
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannedVisit {
    /// Its slot.
    pub slot: u64,
    /// The SN.
    pub sensor: u32,
    /// What it is expected to take [bit]; infinite for all that is there.
    pub bits: f64,
}

/// What a UAV does at a place that is reserved for it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reserved {
    /// It ends the slot there.
    Ends,
    /// It begins the slot there, and has not left the place before its end.
    Leaves,
    /// It is there, has yet to plan, and may stay.
    MayStay,
}

/// A place that is reserved for another UAV in a slot.
#[derive(Debug, Clone, Copy)]
pub struct Reservation {
    /// Where [m].
    pub at: Position,
    /// What it does there.
    pub kind: Reserved,
}

/// The places that are reserved for the other UAVs of a fleet, which keep a distance.
#[derive(Debug, Clone, Copy)]
pub struct Reservations<'a> {
    /// Least distance to them [m]; 0 for any.
    pub separation_m: f64,
    /// None of a UAV that has landed.
    pub reserved: &'a [Reservation],
    /// Whether the UAV rather stays where it is than flies beside its path.
    pub has_right_of_way: bool,
    /// The base, in which they may be near to each other.
    pub base: Option<&'a Base>,
    /// The last slot of the UAV, before which it plans to be home.
    pub last: u64,
}
