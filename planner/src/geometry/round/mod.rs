//! A short round over disks: the shortest path that touches every one (close-enough travelling salesman problem).
//!
//! | module | contents |
//! |---|---|
//! | `cover` | which disks a leg touches |
//! | `stops` | the list of stops, and their points |
//! | `search` | ruin and recreate |
//! | `exchange` | parts of a round that change places |
//! | `cone` | the best points of an order, by Clarabel |
//! | `bound` | lower bounds on the length of every round |

mod bound;
mod cone;
mod cover;
mod exchange;
mod search;
mod stops;

use skysink_common::geometry::Position;
use skysink_common::random::{Purpose, Streams};
use skysink_common::stop::Stop;

pub use search::RoundEffort;
use search::RoundSearch;
use stops::{DiskField, Itinerary, NO_DISK};

/// What a round has to touch.
#[derive(Debug, Clone, Copy)]
pub struct Disks<'a> {
    /// Centres of the disks.
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
    /// A short round; deterministic if the effort is in steps. `stop` ends the search.
    #[must_use]
    pub fn round(&self, effort: RoundEffort, stop: &Stop) -> DiskRound {
        let field = self.field();
        let mut search = RoundSearch::new(&field, Streams::new(0).stream(Purpose::Round, 0, 0));
        let found = search.run(Itinerary::of_one(&field), effort, stop);
        let order: Vec<u32> = found.stops.iter().map(|stop| stop.disk).filter(|&disk| disk != NO_DISK).collect();
        let straightened = cone::shortest(&field, &order).map(|shortest| found.at(&field, shortest.points));
        let shorter = straightened.filter(|round| round.is_whole() && round.length_m < found.length_m);
        let round = shorter.unwrap_or(found);
        DiskRound {
            points: round.stops.iter().map(|stop| stop.point).collect(),
            order: order.into_iter().map(|disk| field.cover.ids[disk as usize]).collect(),
            length_m: (0..round.stops.len()).map(|leg| round.leg_m(&field, leg)).sum(),
        }
    }

    /// A lower bound on the length of every round [m], if one of `known_m` is known. A step evaluates an order of some of
    /// the disks.
    #[must_use]
    pub fn bound_m(&self, known_m: f64, effort: RoundEffort, stop: &Stop) -> f64 {
        bound::bound_m(&self.field(), known_m, effort, stop)
    }

    fn field(&self) -> DiskField {
        DiskField::new(self.centres, self.radius_m, self.start, self.is_closed)
    }
}

#[cfg(test)]
mod tests;
