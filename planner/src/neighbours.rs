//! What the UAVs of a fleet tell each other in a slot: prioritised planning (Erdmann and Lozano-Pérez, Algorithmica 2,
//! 1987) against reservations.

use skysink_common::base::Base;
use skysink_common::geometry::Position;
use skysink_common::message::{FlightReport, Plan};
use skysink_common::scenario::{Coordination, Scenario};

use crate::mission_table::MissionTable;

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

/// The places of a slot that are reserved for the UAVs of a fleet that keeps a distance, and of which those of lower
/// number have planned.
#[derive(Debug, Clone, Default)]
pub struct ReservationTable {
    /// Least distance between the ends of slots of two UAVs [m]; 0 for any, or if they do not talk.
    separation_m: f64,
    /// Whether a place that a UAV leaves is reserved for the slot: two moves around a corner of a grid, one after the
    /// other, would come too near.
    reserves_begins: bool,
    /// The base, in which the UAVs may be near to each other.
    base: Option<Base>,
    /// The place of each UAV; `None` for one that has landed.
    places: Vec<Option<Reservation>>,
    /// Where each UAV is before the slot [m]; empty if such places are not reserved.
    begins: Vec<Option<Position>>,
    /// What is reserved for all but one.
    reserved: Vec<Reservation>,
}

impl ReservationTable {
    /// The table of a mission.
    #[must_use]
    pub fn of(scenario: &Scenario) -> Self {
        let talks = scenario.uav.coordination.unwrap_or_default() != Coordination::Independent;
        let separation_m = scenario.uav.separation_m.filter(|_| talks).unwrap_or(0.0);
        Self {
            separation_m,
            reserves_begins: scenario.kinds().any(|kind| kind.is_near_between_cells(separation_m)),
            base: scenario.landing_base(),
            ..Self::default()
        }
    }

    /// Takes down where each UAV begins the slot [m], by its number; `None` for one that has landed.
    pub fn begin(&mut self, begins: impl Iterator<Item = Option<Position>>) {
        self.places.clear();
        self.places.extend(begins.map(|at| at.map(|at| Reservation { at, kind: Reserved::MayStay })));
        self.begins.clear();
        if self.reserves_begins {
            self.begins.extend(self.places.iter().map(|place| place.map(|place| place.at)));
        }
    }

    /// Takes down that the UAV number `uav`, at `ground` [m], flies `slot` by `plan`.
    pub fn reserve(&mut self, table: &MissionTable, slot: u64, uav: usize, ground: &Position, plan: &Plan) {
        if let Some(place) = &mut self.places[uav] {
            let (_, at) = table.motion.committed(slot, ground, &plan.waypoint().xy());
            *place = Reservation { at, kind: Reserved::Ends };
        }
    }

    /// What is reserved for the others of the UAV number `uav`, whose last slot is `last`.
    pub fn others_of(&mut self, table: &MissionTable, slot: u64, uav: usize, last: u64) -> Reservations<'_> {
        self.reserved.clear();
        let others = self.places.iter().enumerate().filter(|(other, _)| *other != uav);
        self.reserved.extend(others.filter_map(|(_, reservation)| *reservation));
        let before = self.begins.iter().take(uav).flatten();
        self.reserved.extend(before.map(|&at| Reservation { at, kind: Reserved::Leaves }));
        Reservations {
            separation_m: self.separation_m,
            reserved: &self.reserved,
            // Every other UAV gives way, in turns.
            has_right_of_way: (slot / table.motion.move_slots() + uav as u64).is_multiple_of(2),
            base: self.base.as_ref(),
            last,
        }
    }

    /// Nothing, while nobody has planned.
    pub fn nothing(&self, last: u64) -> Reservations<'_> {
        let Self { separation_m, base, .. } = self;
        Reservations { separation_m: *separation_m, reserved: &[], has_right_of_way: true, base: base.as_ref(), last }
    }
}
