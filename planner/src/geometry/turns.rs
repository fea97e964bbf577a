//! The order in which a short closed round over disks of one radius serves them.

use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};

use skysink_common::airspace::Airspace;
use skysink_common::geometry::{Position, distance_squared};
use skysink_common::sensors::grid::Grid;
use skysink_common::stop::Stop;

use super::detour::{self, Lengths};
use super::round::{Disks, RoundEffort, nearest_of_leg};

/// Steps of the search for a round over at most [`MANY`] disks: about 0.1 s.
const STEPS: u64 = 3_000;

/// Disks from which on a search has fewer steps, in inverse proportion.
const MANY: usize = 500;

/// Most disks of a search. With more, the next one is the nearest.
const MOST: usize = 10_000;

/// Largest coordinate of a disk in a round [m]; with larger ones, too, the next one is the nearest.
const FARTHEST_M: f64 = 1e9;

/// Neighbours among which the nearest disk without a turn is looked for first.
const NEIGHBOURS: usize = 16;

/// Rounds that a process keeps, of at most [`MANY`] disks each: some MB. Each UAV of a fleet, and many missions of a
/// sweep, fly over a field for which there is one already.
const KEPT: usize = 64;

static KEPT_TURNS: Mutex<KeptTurns> = Mutex::new(KeptTurns(VecDeque::new()));

/// The turns of disks.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Turns {
    /// All disks in the order of a closed round.
    pub order: Vec<u32>,
    /// The point of the round at which it touches each disk of `order`.
    pub points: Vec<Position>,
}

impl Turns {
    /// The turns of disks about `centres`. `stop` ends the search for a shorter round.
    #[must_use]
    pub fn new(centres: &[Position], radius_m: f64, stop: &Stop) -> Self {
        if centres.len() > MOST || !centres.iter().all(is_measurable) {
            let order = nearest_first(centres, stop);
            let points = order.iter().map(|&disk| centres[disk as usize]).collect();
            return Self { order, points };
        }
        if centres.len() > MANY {
            let steps = STEPS * MANY as u64 / centres.len() as u64;
            return Self::of_round(centres, radius_m, RoundEffort::Steps(steps), stop);
        }
        let kept = || KEPT_TURNS.lock().unwrap_or_else(PoisonError::into_inner);
        let found = kept().find(centres, radius_m);
        found.unwrap_or_else(|| {
            let turns = Self::of_round(centres, radius_m, RoundEffort::Steps(STEPS), stop);
            if stop.requested().is_none() {
                kept().keep(centres, radius_m, &turns);
            }
            turns
        })
    }

    /// The turns of a round. Disks that have no stop of their own are touched where it is nearest to them.
    fn of_round(centres: &[Position], radius_m: f64, effort: RoundEffort, stop: &Stop) -> Self {
        let round = Disks { centres, radius_m, start: None, is_closed: true }.round(effort, stop);
        let stops = round.points.len();
        // Leg, way along it [m], disk and point.
        let mut turns: Vec<(usize, f64, u32, Position)> = Vec::with_capacity(centres.len());
        let mut has_stop = vec![false; centres.len()];
        for (index, (&disk, &point)) in round.order.iter().zip(&round.points).enumerate() {
            has_stop[disk as usize] = true;
            turns.push((index, 0.0, disk, point));
        }
        for (disk, centre) in (0..).zip(centres).filter(|&(disk, _)| !has_stop[disk as usize]) {
            let touched = (0..stops).map(|leg| {
                let [from, to] = [round.points[leg], round.points[(leg + 1) % stops]];
                let point = nearest_of_leg(centre, &from, &to);
                (distance_squared(&point, centre), (leg, (point - from).norm(), disk, point))
            });
            turns.extend(touched.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, turn)| turn));
        }
        turns.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2)));
        Self {
            order: turns.iter().map(|turn| turn.2).collect(),
            points: turns.into_iter().map(|turn| turn.3).collect(),
        }
    }

    /// Shortens the round by the lengths of the ways around zones or along a grid; in an open field it stays as it is.
    /// Its points stay, too. `stop` ends it early.
    pub fn shorten_within(&mut self, airspace: &Airspace, stop: &Stop) {
        let count = self.points.len();
        if airspace.is_open() || count > detour::MOST || stop.requested().is_some() {
            return;
        }
        let lengths = Lengths { count, lengths_m: airspace.distances_m(&self.points) };
        let mut round: Vec<u32> = (0..count as u32).collect();
        lengths.shorten(&mut round, stop);
        let all = std::mem::take(self);
        self.order = round.iter().map(|&turn| all.order[turn as usize]).collect();
        self.points = round.iter().map(|&turn| all.points[turn as usize]).collect();
    }

    /// Leaves out the turns of all disks but those that are `kept`.
    pub fn retain(&mut self, kept: impl Fn(u32) -> bool) {
        let all = std::mem::take(self);
        let turns = all.order.into_iter().zip(all.points).filter(|(disk, _)| kept(*disk));
        (self.order, self.points) = turns.unzip();
    }

    /// The turn whose point is nearest, by the square of its distance [m²]; the first of none.
    pub fn near(&self, distance_m2: impl Fn(&Position) -> f64) -> usize {
        let away_m2 = |&turn: &usize| distance_m2(&self.points[turn]);
        (0..self.points.len()).min_by(|a, b| away_m2(a).total_cmp(&away_m2(b))).unwrap_or(0)
    }

    /// Begins with that turn.
    pub fn begin_near(&mut self, distance_m2: impl Fn(&Position) -> f64) {
        let first = self.near(distance_m2);
        self.order.rotate_left(first);
        self.points.rotate_left(first);
    }
}

/// Turns that were found, and of which disks; those asked for last at the end.
struct KeptTurns(VecDeque<(Vec<Position>, f64, Turns)>);

impl KeptTurns {
    /// Those of disks about `centres`, to the bit.
    fn find(&mut self, centres: &[Position], radius_m: f64) -> Option<Turns> {
        let bits = |point: &Position| [point.x.to_bits(), point.y.to_bits()]; // 0 and -0 differ, too
        let found = self.0.iter().position(|(others, other_m, _)| {
            other_m.to_bits() == radius_m.to_bits() && others.iter().map(bits).eq(centres.iter().map(bits))
        });
        let found = self.0.remove(found?)?;
        let turns = found.2.clone();
        self.0.push_back(found);
        Some(turns)
    }

    /// Keeps turns in the place of the least recently used, unless another thread has kept them.
    fn keep(&mut self, centres: &[Position], radius_m: f64, turns: &Turns) {
        if self.find(centres, radius_m).is_some() {
            return;
        }
        if self.0.len() >= KEPT {
            self.0.pop_front();
        }
        self.0.push_back((centres.to_vec(), radius_m, turns.clone()));
    }
}

/// Whether lengths around `centre` can be computed: hostile messages may have any coordinates.
fn is_measurable(centre: &Position) -> bool {
    centre.iter().all(|coordinate_m| coordinate_m.abs() <= FARTHEST_M)
}

/// From the first point always to the nearest one that is left; after `stop` to any.
fn nearest_first(points: &[Position], stop: &Stop) -> Vec<u32> {
    let [low, high] = points.iter().fold([points[0]; 2], |[low, high], point| [low.inf(point), high.sup(point)]);
    let sides = high - low;
    let grid = Grid::new(points, (sides.x * sides.y / points.len() as f64).sqrt());
    let mut is_left = vec![true; points.len()];
    let mut order = vec![0];
    is_left[0] = false;
    while order.len() < points.len() {
        let at = &points[order[order.len() - 1] as usize];
        let mut count = NEIGHBOURS;
        let next = loop {
            let near = grid.nearest(at, count);
            if let Some(next) = near.iter().copied().find(|&other| is_left[other as usize]) {
                break next;
            }
            if near.len() < count || stop.requested().is_some() {
                // Positions that are not numbers are near nothing.
                break is_left.iter().position(|is_left| *is_left).expect("one is left") as u32;
            }
            count *= 4;
        };
        is_left[next as usize] = false;
        order.push(next);
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn at(angle_deg: f64) -> Position {
        let angle = angle_deg.to_radians();
        Position::new(50.0 + 40.0 * angle.cos(), 50.0 + 40.0 * angle.sin())
    }

    #[test]
    fn disks_on_a_circle_are_visited_around_it() {
        let centres: Vec<Position> = (0..20).map(|step| at(f64::from(step * 7 % 20) * 18.0)).collect();
        let Turns { order, points } = Turns::new(&centres, 1.0, &Stop::default());
        let place = |turn: usize| order[turn % 20] as i32 * 7 % 20; // around the ring
        let steps: Vec<i32> = (0..20).map(|turn| (place(turn + 1) - place(turn)).rem_euclid(20)).collect();
        assert!(steps.iter().all(|&step| step == 1) || steps.iter().all(|&step| step == 19), "{steps:?}");
        let away_m = |turn: usize| (points[turn] - Position::new(50.0, 50.0)).norm();
        assert!((0..20).all(|turn| away_m(turn) < 39.6), "it passes inside of the centres");
    }

    #[test]
    fn turns_of_a_field_that_was_flown_over_are_those_of_a_new_search() {
        let centres: Vec<Position> = (0..30).map(|step| at(f64::from(step * 47 % 360))).collect();
        let searched = Turns::of_round(&centres, 2.5, RoundEffort::Steps(STEPS), &Stop::default());
        for _ in 0..2 {
            assert_eq!(Turns::new(&centres, 2.5, &Stop::default()), searched);
        }
    }

    #[test]
    fn the_least_recently_used_turns_are_dropped_first() {
        let mut kept = KeptTurns(VecDeque::new());
        let centres = |field: usize| vec![Position::new(field as f64, 0.0), Position::new(9.0, 0.0)];
        let turns = |field: usize| Turns { order: vec![field as u32], points: Vec::new() };
        for field in 0..KEPT {
            kept.keep(&centres(field), 1.0, &turns(field));
            kept.keep(&centres(field), 1.0, &turns(field)); // of another thread
        }
        assert_eq!(kept.0.len(), KEPT);
        assert_eq!(kept.find(&centres(0), 1.0), Some(turns(0)));
        kept.keep(&centres(KEPT), 1.0, &turns(KEPT));
        assert_eq!((kept.find(&centres(0), 1.0), kept.find(&centres(1), 1.0)), (Some(turns(0)), None));
        let other = [Position::new(-0.0, 0.0), Position::new(9.0, 0.0)];
        assert_eq!((kept.find(&centres(0), 1.1), kept.find(&other, 1.0)), (None, None));
    }

    #[test]
    fn a_disk_touched_in_passing_is_visited_there() {
        // The round is a line from x = 10 to x = 90 and back; the disk in the middle is 3 m beside it.
        let centres = [Position::new(5.0, 50.0), Position::new(95.0, 50.0), Position::new(40.0, 53.0)];
        let Turns { order, points } = Turns::new(&centres, 5.0, &Stop::default());
        let turn = order.iter().position(|&disk| disk == 2).unwrap();
        assert!((points[turn] - Position::new(40.0, 50.0)).norm() < 0.5, "{points:?}");
    }

    #[test]
    fn the_visiting_order_begins_at_the_point_nearest_the_start() {
        let points = vec![Position::new(0.0, 0.0), Position::new(50.0, 0.0), Position::new(90.0, 0.0)];
        let mut turns = Turns { order: vec![5, 3, 4], points };
        turns.begin_near(|point| distance_squared(point, &Position::new(60.0, 9.0)));
        assert_eq!((turns.order, turns.points[0].x), (vec![3, 4, 5], 50.0));
        Turns::default().begin_near(|_| 0.0);
    }

    #[test]
    fn large_fields_use_the_nearest_neighbour_order() {
        let centres: Vec<Position> =
            (0..=MOST).map(|index| Position::new((index * 7919 % (MOST + 1)) as f64, 0.0)).collect();
        let Turns { order, points } = Turns::new(&centres, 1.0, &Stop::default());
        assert_eq!((order.len(), points.len()), (MOST + 1, MOST + 1));
        // From x = 0 along the line.
        assert!(points.windows(2).all(|pair| pair[1].x == pair[0].x + 1.0));
    }

    #[test]
    fn a_disk_at_an_invalid_position_is_visited_too() {
        for odd_m in [f64::NAN, f64::INFINITY, 1e300, 1e17] {
            let mut centres: Vec<Position> = (0..10).map(|index| Position::new(f64::from(index), 0.0)).collect();
            centres[7] = Position::new(odd_m, 0.0);
            let mut order = Turns::new(&centres, 1.0, &Stop::default()).order;
            order.sort_unstable();
            assert!((0..10).eq(order), "{odd_m}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(100))]

        #[test]
        fn every_disk_is_visited_once_at_a_point_inside(
            coordinates in prop::collection::vec((0.0..100.0, 0.0..100.0), 0..60),
            radius_m in prop_oneof![Just(0.0), 0.0..30.0],
            is_stopped: bool,
        ) {
            let centres: Vec<Position> = coordinates.into_iter().map(|(x_m, y_m)| Position::new(x_m, y_m)).collect();
            let stop = Stop::default();
            if is_stopped {
                stop.flag().store(2, std::sync::atomic::Ordering::Relaxed);
            }
            let Turns { mut order, points } = Turns::new(&centres, radius_m, &stop);
            for (&disk, point) in order.iter().zip(&points) {
                prop_assert!(is_stopped || (centres[disk as usize] - point).norm() <= radius_m + 1e-6);
            }
            order.sort_unstable();
            prop_assert!((0..centres.len() as u32).eq(order));
        }
    }
}
