//! A round as a list of stops, each of which binds a disk, and its changes.

use nalgebra::Vector2;
use skysink_common::geometry::Position;

use super::cover::{Cover, nearest_of_leg};

/// The disk of the fixed start.
pub const NO_DISK: u32 = u32::MAX;

/// Newton steps to value an insertion, and to move a stop.
const VALUED: u32 = 2;
const MOVED: u32 = 4;

/// Stops lie within this fraction of the radius, so that rounding takes none out of its disk.
const INNER: f64 = 1.0 - 2e-7;

/// Least radius within which a disk is touched, as a fraction of the range of coordinates: points are touched whatever
/// the rounding.
const LEAST_RADIUS: f64 = 1e-9;

/// What rounding may add to the distance of a stop from its centre, as a fraction of the largest coordinate.
const COORDINATE_ROUNDING: f64 = 1e-14;

/// A turn of a stop about its centre below this [rad] ends the search for its angle.
const SETTLED_RAD: f64 = 1e-7;

/// Stops that all move by less than this fraction of the radius stay.
pub const SETTLED: f64 = 1e-9;

/// Distances below this [m] are rounding.
const LEAST_M: f64 = 1e-150;

/// What a round has to touch, and where it begins and ends.
pub struct DiskField {
    /// The disks.
    pub cover: Cover,
    /// Radius on which stops lie [m].
    pub inner_m: f64,
    /// Where a round begins; `None` for anywhere.
    pub start: Option<Position>,
    /// Whether a round ends where it begins.
    pub is_closed: bool,
}

impl DiskField {
    /// The disks of this radius [m] about these centres.
    #[must_use]
    pub fn new(centres: &[Position], radius_m: f64, start: Option<Position>, is_closed: bool) -> Self {
        let all = || centres.iter().chain(&start).flat_map(|point| [point.x, point.y]);
        let [lowest_m, highest_m] = [all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max)];
        let range_m = (highest_m - lowest_m).max(0.0);
        let rounding_m = COORDINATE_ROUNDING * all().map(f64::abs).fold(0.0, f64::max);
        let touched_m = radius_m.max(LEAST_RADIUS * range_m) + rounding_m;
        Self { cover: Cover::new(centres, touched_m), inner_m: radius_m * INNER, start, is_closed }
    }

    /// Stops that never move.
    pub fn fixed(&self) -> usize {
        usize::from(self.start.is_some())
    }

    /// The least detour to a disk on the way from `from` to `to` [m], and its point.
    pub fn touch(&self, disk: u32, from: &Position, to: Option<&Position>) -> (f64, Position) {
        let centre = &self.cover.centres[disk as usize];
        let Some(to) = to else {
            let away = from - centre;
            let beyond_m = away.norm() - self.inner_m;
            let point = if beyond_m > 0.0 { centre + away * (self.inner_m / away.norm()) } else { *from };
            return (beyond_m.max(0.0), point);
        };
        let foot = nearest_of_leg(centre, from, to);
        match self.turn(centre, &foot, [from, to], VALUED) {
            Some(point) => ((point - from).norm() + (to - point).norm() - (to - from).norm(), point),
            None => (0.0, foot),
        }
    }

    /// The point of a disk where the path from `from` over it to `to` is shortest.
    pub fn turning_point(&self, disk: u32, from: &Position, to: &Position) -> Position {
        let centre = &self.cover.centres[disk as usize];
        let foot = nearest_of_leg(centre, from, to);
        self.turn(centre, &foot, [from, to], MOVED).unwrap_or(foot)
    }

    /// The point of a disk between two ends that makes the path shortest; `None` if the leg between them touches it
    /// already, at `foot`. Newton's method on the angle: the length is convex where both ends see the rim.
    fn turn(&self, centre: &Position, foot: &Position, ends: [&Position; 2], steps: u32) -> Option<Position> {
        let outward = foot - centre;
        let away_m = outward.norm();
        if away_m <= self.inner_m {
            return None;
        }
        let mut normal = outward / away_m;
        for _ in 0..steps {
            let point = centre + normal * self.inner_m;
            let across = Vector2::new(-normal.y, normal.x);
            let [mut slope, mut curve] = [0.0; 2];
            for end in ends {
                let leg = point - end;
                let per_m = 1.0 / leg.norm().max(LEAST_M);
                let along = leg.dot(&across) * per_m;
                slope += along;
                curve += self.inner_m * (1.0 - along * along) * per_m - leg.dot(&normal) * per_m;
            }
            if curve <= 0.0 || !curve.is_finite() {
                break;
            }
            let angle = (-slope / curve).clamp(-1.0, 1.0);
            let turned = normal + across * angle;
            normal = turned / turned.norm();
            if angle.abs() < SETTLED_RAD {
                break;
            }
        }
        Some(centre + normal * self.inner_m)
    }
}

/// A stop of a round.
#[derive(Debug, Clone, Copy)]
pub struct Touch {
    pub point: Position,
    /// The disk that binds it, by its place in the cover.
    pub disk: u32,
    /// Whether it or a neighbour has changed.
    pub is_dirty: bool,
}

/// A round: stops, and how many legs touch each disk.
#[derive(Clone, Default)]
pub struct Itinerary {
    pub stops: Vec<Touch>,
    pub counts: Vec<u16>,
    pub length_m: f64,
}

impl Itinerary {
    /// A round of one stop: the start, or the disk farthest from the middle.
    pub fn of_one(field: &DiskField) -> Self {
        let centres = &field.cover.centres;
        let middle =
            centres.iter().fold(Vector2::zeros(), |sum, centre| sum + centre.coords) / centres.len().max(1) as f64;
        let away_m2 = |&disk: &usize| (centres[disk].coords - middle).norm_squared();
        let farthest = (0..centres.len()).max_by(|a, b| away_m2(a).total_cmp(&away_m2(b)));
        let stop = |point: Position, disk: u32| Touch { point, disk, is_dirty: true };
        let farthest = farthest.map(|disk| stop(centres[disk], disk as u32));
        let first = field.start.map(|point| stop(point, NO_DISK)).or(farthest);
        let mut round = Self { stops: first.into_iter().collect(), counts: vec![0; centres.len()], length_m: 0.0 };
        round.count_legs(field, 0, round.stops.len(), 1);
        round
    }

    /// The same stops at other points.
    pub fn at(&self, field: &DiskField, points: Vec<Position>) -> Self {
        let stops = self.stops.iter().zip(points).map(|(stop, point)| Touch { point, ..*stop }).collect();
        let mut round = Self { stops, counts: vec![0; self.counts.len()], length_m: 0.0 };
        round.count_legs(field, 0, round.stops.len(), 1);
        round
    }

    /// The stop after stop `index`; `None` after the last of an open round. The only stop of a closed one is after
    /// itself.
    pub fn next(&self, field: &DiskField, index: usize) -> Option<usize> {
        match index + 1 {
            next if next < self.stops.len() => Some(next),
            _ => (field.is_closed).then_some(0),
        }
    }

    fn previous(&self, field: &DiskField, index: usize) -> Option<usize> {
        match index {
            0 => field.is_closed.then(|| self.stops.len() - 1),
            _ => Some(index - 1),
        }
    }

    /// Start and end of leg `index`.
    pub fn leg(&self, field: &DiskField, index: usize) -> (&Position, Option<&Position>) {
        (&self.stops[index].point, self.next(field, index).map(|next| &self.stops[next].point))
    }

    pub fn leg_m(&self, field: &DiskField, index: usize) -> f64 {
        let (from, to) = self.leg(field, index);
        to.map_or(0.0, |to| (to - from).norm())
    }

    /// Mean length of a leg [m].
    pub fn mean_m(&self) -> f64 {
        self.length_m / self.stops.len().max(1) as f64
    }

    /// Counts `legs` legs from leg `first` on, around the end, in (1) or out (`u16::MAX`), and their lengths.
    pub fn count_legs(&mut self, field: &DiskField, first: usize, legs: usize, change: u16) {
        let stops = self.stops.len();
        for leg in (first..first + legs).map(|leg| leg % stops) {
            let Some(next) = self.next(field, leg) else {
                // An open round may be a single point.
                if stops == 1 {
                    field.cover.count(&mut self.counts, &self.stops[0].point, &self.stops[0].point, change);
                }
                continue;
            };
            let [from, to] = [leg, next].map(|index| self.stops[index].point);
            field.cover.count(&mut self.counts, &from, &to, change);
            let leg_m = (to - from).norm();
            self.length_m += if change == 1 { leg_m } else { -leg_m };
        }
    }

    /// Inserts a stop at `disk` in leg `leg`, at `point`, and moves the stops up to `wide` away `sweeps` times.
    pub fn insert(&mut self, field: &DiskField, leg: usize, disk: u32, point: Position, wide: usize, sweeps: u32) {
        let at = leg + 1;
        let [low, high] = [at.saturating_sub(wide).max(field.fixed()), (at + wide).min(self.stops.len())];
        // Before the insertion the window ends one stop earlier, and has at least the leg that is cut.
        self.change(field, low, high, |round| {
            round.stops.insert(at, Touch { point, disk, is_dirty: true });
            round.descend(field, low, high, sweeps)
        });
    }

    /// Moves the stops `low..=high` `sweeps` times.
    pub fn relax(&mut self, field: &DiskField, low: usize, high: usize, sweeps: u32) {
        self.change(field, low, high + 1, |round| round.descend(field, low, high, sweeps));
    }

    /// Takes the legs at the stops `low..end` out of the counts, changes the stops, and counts the legs of the window
    /// that remains, whose last stop is returned by `change`, plus one.
    fn change(&mut self, field: &DiskField, low: usize, end: usize, change: impl FnOnce(&mut Self) -> usize) {
        let legs = |round: &Self, end: usize| {
            let first = if low == 0 { round.stops.len() - 1 } else { low - 1 };
            (first, (end - low + 1).min(round.stops.len()))
        };
        let (first, count) = legs(self, end);
        self.count_legs(field, first, count, u16::MAX);
        let end = change(self);
        let (first, count) = legs(self, end);
        self.count_legs(field, first, count, 1);
    }

    /// Moves the stops `low..=high` one after the other to where the path is shortest, and takes out those that the leg
    /// between their neighbours touches. Counts stay as they are. Returns the end of the window.
    fn descend(&mut self, field: &DiskField, low: usize, high: usize, sweeps: u32) -> usize {
        let mut end = high + 1;
        for _ in 0..sweeps {
            let mut moved_m = 0.0f64;
            let mut index = low.max(field.fixed());
            while index < end {
                let old = self.stops[index];
                let centre = &field.cover.centres[old.disk as usize];
                let [before, after] = [self.previous(field, index), self.next(field, index)]
                    .map(|other| other.filter(|&other| other != index).map(|other| self.stops[other].point));
                let found = match (before, after) {
                    (Some(before), Some(after)) => {
                        let foot = nearest_of_leg(centre, &before, &after);
                        field.turn(centre, &foot, [&before, &after], MOVED)
                    }
                    (Some(other), None) | (None, Some(other)) => {
                        let (beyond_m, point) = field.touch(old.disk, &other, None);
                        (beyond_m > 0.0).then_some(point)
                    }
                    (None, None) => Some(old.point),
                };
                match found {
                    None => {
                        self.stops.remove(index);
                        end -= 1;
                        moved_m = f64::INFINITY;
                    }
                    Some(point) => {
                        let path_m = |point: &Position| {
                            [before, after].iter().flatten().map(|end| (end - point).norm()).sum::<f64>()
                        };
                        if path_m(&point) < path_m(&old.point) || !self.is_in(field, &old) {
                            moved_m = moved_m.max((point - old.point).norm());
                            self.stops[index].point = point;
                        }
                        self.stops[index].is_dirty = true;
                        index += 1;
                    }
                }
            }
            if moved_m <= SETTLED * field.inner_m {
                break;
            }
        }
        end
    }

    /// Whether a stop lies in its disk: not one that was just placed at the foot of a leg.
    fn is_in(&self, field: &DiskField, stop: &Touch) -> bool {
        (stop.point - field.cover.centres[stop.disk as usize]).norm_squared() <= field.cover.radius_m.powi(2)
    }

    /// Takes the stops `low..end` out; at least one remains.
    pub fn remove(&mut self, field: &DiskField, low: usize, end: usize) {
        self.change(field, low, end, |round| {
            round.stops.drain(low..end);
            let stops = round.stops.len();
            let around = if low == 0 { stops - 1 } else { low - 1 };
            for index in [around, low % stops] {
                round.stops[index].is_dirty = true;
            }
            low
        });
    }

    /// Whether all disks are touched.
    pub fn is_whole(&self) -> bool {
        !self.counts.contains(&0)
    }
}
