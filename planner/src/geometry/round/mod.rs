//! A short round over disks: the shortest path that touches every one (close-enough travelling salesman problem).
//!
//! | module | contents |
//! |---|---|
//! | [`cover`] | which disks a leg touches |
//! | [`stops`] | the list of stops, and their points |
//! | [`search`] | ruin and recreate |
//! | [`cone`] | the best points of an order, by Clarabel |
//! | [`bound`] | lower bounds on the length of every round |

mod bound;
mod cone;
mod cover;
mod search;
mod stops;

use skysink_common::geometry::Position;
use skysink_common::random::{Purpose, Streams};
use skysink_common::stop::Stop;

pub use search::Effort;
use search::Search;
use stops::{Field, NO_DISK, Round};

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
    pub fn round(&self, effort: Effort, stop: &Stop) -> DiskRound {
        let field = self.field();
        let mut search = Search::new(&field, Streams::new(0).stream(Purpose::Round, 0, 0));
        let found = search.run(Round::of_one(&field), effort, stop);
        let order: Vec<u32> =
            found.stops.iter().map(|stop| stop.disk).filter(|&disk| disk != NO_DISK).collect();
        let straightened = cone::points(&field, &order).map(|points| found.at(&field, points));
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
    pub fn bound_m(&self, known_m: f64, effort: Effort, stop: &Stop) -> f64 {
        bound::bound_m(&self.field(), known_m, effort, stop)
    }

    fn field(&self) -> Field {
        Field::new(self.centres, self.radius_m, self.start, self.is_closed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    #[ignore]
    fn try_instances() {
        let text = std::fs::read_to_string("/tmp/cetsp.txt").unwrap();
        let seconds: f64 = std::env::var("S").unwrap().parse().unwrap();
        let only = std::env::var("O").unwrap_or_default();
        let mut sum = vec![];
        for block in text.split("\n\n").filter(|block| !block.trim().is_empty()) {
            let mut lines = block.trim().lines();
            let head: Vec<&str> = lines.next().unwrap().split(' ').collect();
            if !head[0].contains(&only) { continue; }
            let number = |text: &str| text.parse::<f64>().unwrap();
            let start = Position::new(number(head[2]), number(head[3]));
            let centres: Vec<Position> = lines
                .map(|line| {
                    let (x, y) = line.split_once(' ').unwrap();
                    Position::new(number(x), number(y))
                })
                .collect();
            let disks = Disks { centres: &centres, radius_m: number(head[1]), start: Some(start), is_closed: true };
            let begin = std::time::Instant::now();
            let effort = if seconds > 100.0 { Effort::Steps(seconds as u64) } else { Effort::Time(Duration::from_secs_f64(seconds)) };
            let round = disks.round(effort, &Stop::default());
            let worst = centres.iter().map(|centre| {
                let legs = (0..round.points.len()).map(|i| {
                    let (a, b) = (round.points[i], round.points[(i + 1) % round.points.len()]);
                    cover::distance_to_leg_squared(centre, &a, &b).sqrt()
                });
                legs.fold(f64::INFINITY, f64::min)
            }).fold(0.0, f64::max) / disks.radius_m;
            let ratio = round.length_m / number(head[4]);
            let took = begin.elapsed().as_secs_f64();
            let begin = std::time::Instant::now();
            let bound = disks.bound_m(round.length_m, effort, &Stop::default());
            println!("{:22} n {:5} stops {:4} ratio {:.4} bound {:.4} worst {:.9} {:.2} s {:.2} s", head[0], centres.len(), round.points.len(), ratio, bound / number(head[4]), worst, took, begin.elapsed().as_secs_f64());
            assert!(bound <= number(head[4]) * 1.0000001);
            assert!(worst <= 1.0);
            sum.push(ratio);
        }
        sum.sort_by(f64::total_cmp);
        println!("median {:.4} mean {:.4} worst {:.4}", sum[sum.len()/2], sum.iter().sum::<f64>()/sum.len() as f64, sum[sum.len()-1]);
    }
}
