//! A short round over disks: the shortest path that touches every one (close-enough travelling salesman problem).
//!
//! | module | contents |
//! |---|---|
//! | `cover` | which disks a leg touches |
//! | `stops` | the list of stops, and their points |
//! | `search` | ruin and recreate |
//! | `exchange` | parts of a round that change places |
//! | `cone` | the best points of an order, by Clarabel |

mod cone;
mod cover;
mod exchange;
mod search;
mod stops;

use nalgebra::Vector2;
use skysink_common::geometry::Position;
use skysink_common::random::{Purpose, Streams};
use skysink_common::stop::Stop;

pub use cone::{Shortest, shortest};
pub(crate) use cover::nearest_of_leg;
pub use cover::{Cover, distance_to_leg_squared};
pub use search::RoundEffort;
use search::RoundSearch;
pub use stops::{DiskField, SETTLED};
use stops::{Itinerary, NO_DISK};

/// Largest coordinate [m] of a first centre at which lengths are not yet computed relative to it.
const FAR_M: f64 = 1e6;

/// What a round has to touch.
#[derive(Debug, Clone, Copy)]
pub struct Disks<'a> {
    /// Centres of the disks, finite.
    pub centres: &'a [Position],
    /// Their radius [m], not negative.
    pub radius_m: f64,
    /// Where the round begins; `None` for anywhere.
    pub start: Option<Position>,
    /// Whether it ends where it begins.
    pub is_closed: bool,
}

/// A path that touches every disk.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DiskRound {
    /// Its points in order, from the start on if one is given; each but the start lies in the disk of `order`.
    pub points: Vec<Position>,
    /// The disk of each point after the start; other disks are touched in passing.
    pub order: Vec<u32>,
    /// Its length [m], with the leg back if it is closed.
    pub length_m: f64,
}

impl Disks<'_> {
    /// A short round; deterministic if the effort is in steps. `stop` ends the search; the round may then miss disks.
    pub fn round(&self, effort: RoundEffort, stop: &Stop) -> DiskRound {
        self.seeded_round(0, effort, stop)
    }

    /// The same, searched with the random numbers of `seed`.
    pub fn seeded_round(&self, seed: u64, effort: RoundEffort, stop: &Stop) -> DiskRound {
        let field = self.field();
        let mut search = RoundSearch::new(&field, Streams::new(seed).stream(Purpose::Round, 0, 0), stop);
        let found = search.run(Itinerary::of_one(&field), effort);
        let order: Vec<u32> = found.stops.iter().map(|stop| stop.disk).filter(|&disk| disk != NO_DISK).collect();
        let straightened = shortest(&field, &order).map(|shortest| found.at(&field, shortest.points));
        let shorter = straightened.filter(|round| round.is_whole() && round.length_m < found.length_m);
        let round = shorter.unwrap_or(found);
        let free = round.stops[field.fixed().min(round.stops.len())..].iter();
        DiskRound {
            points: self.start.into_iter().chain(free.map(|stop| stop.point + self.origin())).collect(),
            order: order.into_iter().map(|disk| field.cover.ids[disk as usize]).collect(),
            length_m: (0..round.stops.len())
                .map(|leg| round.leg_m(&field, leg))
                .fold(0.0, |sum_m, leg_m| sum_m + leg_m),
        }
    }

    /// The disks, prepared for the search: sorted, and relative to the first centre if they lie far from the origin.
    pub fn field(&self) -> DiskField {
        let centres: Vec<Position> = self.centres.iter().map(|centre| centre - self.origin()).collect();
        DiskField::new(&centres, self.radius_m, self.start.map(|start| start - self.origin()), self.is_closed)
    }

    /// What coordinates are relative to: far from the origin the first centre, because there rounding is coarse.
    fn origin(&self) -> Vector2<f64> {
        let is_far = |centre: &&Position| centre.coords.amax() > FAR_M;
        self.centres.first().filter(is_far).map_or(Vector2::zeros(), |centre| centre.coords)
    }
}

#[cfg(test)]
mod tests;
