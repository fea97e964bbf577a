//! Ruin and recreate on touching points, with simulated annealing.
//!
//! A step takes some stops out, or exchanges parts of the round; then disks that no leg touches get a stop where the
//! detour is least, and the stops around move to where the path is shortest. Insertions are valued by their detour
//! *after* the stop has found its point. A stop whose disk another leg touches leaves.

use std::time::{Duration, Instant};

use rand_chacha::ChaCha8Rng;
use skysink_common::geometry::Position;
use skysink_common::random::{below, fraction};
use skysink_common::stop::Stop;

use super::cover::distance_to_leg_squared;
use super::stops::{DiskField, Itinerary};

/// Temperature at the beginning and at the end, in mean legs; a long search begins hotter.
const HOT: f64 = 0.3;
const HOTTER: f64 = 1.0;
const COLD: f64 = 0.001;

/// A search of more steps, or of more time, is long.
const LONG_STEPS: u64 = 100_000;
const LONG_TIME: Duration = Duration::from_secs(5);

/// Fraction of the steps that exchange parts of the round; the others take stops out.
const EXCHANGED: f64 = 0.4;

/// Most strings of stops, and most stops of a string, that a step takes out.
const STRINGS: usize = 2;
const STRING: usize = 10;

/// Steps between two looks at the clock and the stop.
const WATCHED: u64 = 64;

/// Fewer stops than this are often inserted farthest from the round first.
const FEW_STOPS: usize = 40;

/// Least shortening of a round that counts, relative to it.
const LEAST_GAIN: f64 = 1e-12;

/// How long a search goes on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RoundEffort {
    /// A number of steps: the result repeats.
    Steps(u64),
    /// A time, approximately.
    Time(Duration),
}

pub struct RoundSearch<'a> {
    pub(super) field: &'a DiskField,
    pub(super) random: ChaCha8Rng,
    /// How often each disk was inserted in this step.
    inserted: Vec<u8>,
    open: Vec<u32>,
    /// Distances of a disk to the legs, less the radius [m].
    beyond_m: Vec<f64>,
    stop: &'a Stop,
}

impl<'a> RoundSearch<'a> {
    pub fn new(field: &'a DiskField, random: ChaCha8Rng, stop: &'a Stop) -> Self {
        let inserted = vec![0; field.cover.centres.len()];
        Self { field, random, inserted, open: Vec::new(), beyond_m: Vec::new(), stop }
    }

    /// The shortest round found from `first` on, which need not touch all disks. The result does, unless the search is
    /// stopped.
    pub fn run(&mut self, first: Itinerary, effort: RoundEffort) -> Itinerary {
        let field = self.field;
        let mut current = first;
        if !self.complete(&mut current, f64::INFINITY) || effort == RoundEffort::Steps(0) {
            return current;
        }
        let mut best = current.clone();
        let mut tried = Itinerary::default();
        let begin = Instant::now();
        let hot = match effort {
            RoundEffort::Steps(steps) if steps > LONG_STEPS => HOTTER,
            RoundEffort::Time(time) if time > LONG_TIME => HOTTER,
            _ => HOT,
        };
        let mut done = 0.0; // fraction of the effort
        for step in 0u64.. {
            if step.is_multiple_of(WATCHED) {
                if let RoundEffort::Time(time) = effort {
                    done = begin.elapsed().as_secs_f64() / time.as_secs_f64();
                }
                if self.stop.requested().is_some() {
                    break;
                }
            }
            if let RoundEffort::Steps(steps) = effort {
                done = step as f64 / steps as f64;
            }
            // Nothing to search: all in range of one point, or of one leg.
            if done >= 1.0 || current.stops.len() <= field.fixed() || current.stops.len() < 2 {
                break;
            }
            let warmth = hot * (COLD / hot).powf(done) * current.mean_m();
            let limit_m = current.length_m - warmth * fraction(&mut self.random).ln();
            tried.clone_from(&current);
            let is_changed = if fraction(&mut self.random) <= EXCHANGED {
                self.exchange(&mut tried, limit_m)
            } else {
                self.ruin(&mut tried);
                true
            };
            if is_changed && self.complete(&mut tried, limit_m) && tried.length_m < limit_m {
                std::mem::swap(&mut current, &mut tried);
                if current.length_m < best.length_m * (1.0 - LEAST_GAIN) {
                    best.clone_from(&current);
                }
            }
        }
        let mut polished = best.clone();
        let stops = polished.stops.len();
        if stops > field.fixed() {
            polished.relax(field, field.fixed(), stops - 1, 400);
            self.recreate(&mut polished, f64::INFINITY);
        }
        if polished.length_m < best.length_m { polished } else { best }
    }

    /// Makes a round whole; `false` if it becomes clearly longer than `limit_m` [m], or after a stop.
    fn complete(&mut self, round: &mut Itinerary, limit_m: f64) -> bool {
        if !self.recreate(round, limit_m) {
            return false;
        }
        self.leave_out(round);
        self.settle(round);
        self.recreate(round, limit_m)
    }

    /// Inserts disks that no leg touches, until all are touched. `false` if the round is clearly longer than `limit_m`,
    /// or after a stop.
    fn recreate(&mut self, round: &mut Itinerary, limit_m: f64) -> bool {
        let slack_m = 0.05 * round.mean_m();
        let mut is_first = true;
        let mut insertions = 0;
        let whole = round.stops.len();
        loop {
            self.open.clear();
            let untouched = round.counts.iter().enumerate().filter(|(_, count)| **count == 0);
            self.open.extend(untouched.map(|(disk, _)| disk as u32));
            if self.open.is_empty() {
                return true;
            }
            if round.length_m > limit_m + slack_m || self.stop.requested().is_some() {
                return false;
            }
            if std::mem::take(&mut is_first) {
                self.inserted.fill(0);
            }
            let disk = self.next_open(round);
            let times = &mut self.inserted[disk as usize];
            *times = times.saturating_add(1);
            // Without a descent an insertion opens no disk that has a stop, so that this ends.
            let may_descend = *times < 4 && insertions <= 40 + 4 * whole.max(self.open.len());
            insertions += 1;
            let (leg, point) = self.best_leg(round, disk);
            if may_descend {
                round.insert(self.field, leg, disk, point, 2, 2);
            } else {
                round.insert(self.field, leg, disk, point, 0, 0);
            }
        }
    }

    /// The open disk that is inserted next.
    fn next_open(&mut self, round: &Itinerary) -> u32 {
        let Self { field, random, open, .. } = self;
        let centre = |disk: u32| &field.cover.centres[disk as usize];
        let by = |value: &dyn Fn(u32) -> f64| {
            let values = open.iter().map(|&disk| (value(disk), disk));
            values.max_by(|a, b| a.0.total_cmp(&b.0)).expect("an open disk").1
        };
        if round.stops.len() < FEW_STOPS && below(random, 4) == 0 {
            let to_leg_m2 = |disk: u32, leg: usize| match round.leg(field, leg) {
                (from, Some(to)) => distance_to_leg_squared(centre(disk), from, to),
                (from, None) => (centre(disk) - from).norm_squared(),
            };
            let nearest_m2 =
                |disk| (0..round.stops.len()).map(|leg| to_leg_m2(disk, leg)).fold(f64::INFINITY, f64::min);
            return by(&nearest_m2);
        }
        match below(random, 6) {
            0..=2 => open[below(random, open.len())],
            drawn @ (3 | 4) => {
                let from = centre(below(random, field.cover.centres.len()) as u32);
                let sign = if drawn == 3 { -1.0 } else { 1.0 }; // the nearest, or the farthest
                by(&|disk| sign * (centre(disk) - from).norm_squared())
            }
            _ => {
                let (sine, cosine) = (std::f64::consts::TAU * fraction(random)).sin_cos();
                by(&|disk| centre(disk).x * cosine + centre(disk).y * sine)
            }
        }
    }

    /// The leg in which a stop at `disk` costs least, and its point. Legs are passed over at random.
    ///
    /// A disk whose rim is `h` from a leg of length `l` costs at least `√(l² + 4h²) − l`: more than a known cost `c` if
    /// `h² ≥ c (c/4 + l/2)`.
    fn best_leg(&mut self, round: &Itinerary, disk: u32) -> (usize, Position) {
        let Self { field, random, beyond_m, .. } = self;
        let centre = &field.cover.centres[disk as usize];
        beyond_m.clear();
        let mut nearest = (f64::INFINITY, 0);
        for leg in 0..round.stops.len() {
            let (from, to) = round.leg(field, leg);
            let away_m2 = match to {
                Some(to) => distance_to_leg_squared(centre, from, to),
                None => (centre - from).norm_squared(),
            };
            let away_m = (away_m2.sqrt() - field.inner_m).max(0.0);
            beyond_m.push(away_m);
            let leg_m = round.leg_m(field, leg);
            let least_m = (leg_m * leg_m + 4.0 * away_m * away_m).sqrt() - leg_m;
            if least_m < nearest.0 {
                nearest = (least_m, leg);
            }
        }
        let value = |leg: usize| {
            let (from, to) = round.leg(field, leg);
            field.touch(disk, from, to)
        };
        let (cost_m, point) = value(nearest.1);
        let mut best = (cost_m, nearest.1, point);
        for (leg, &away_m) in beyond_m.iter().enumerate() {
            let leg_m = round.leg_m(field, leg);
            if leg == nearest.1 || away_m * away_m >= best.0 * (best.0 / 4.0 + leg_m / 2.0) || below(random, 100) == 0 {
                continue;
            }
            let (cost_m, point) = value(leg);
            if cost_m < best.0 {
                best = (cost_m, leg, point);
            }
        }
        (best.1, best.2)
    }

    /// Takes out stops that have changed, or whose neighbours have, and whose disk another leg touches, unless that
    /// opens another disk.
    fn leave_out(&self, round: &mut Itinerary) {
        let mut index = 1;
        while index < round.stops.len() {
            let stop = round.stops[index];
            if stop.is_dirty && round.counts[stop.disk as usize] > 2 {
                round.remove(self.field, index, index + 1);
                if round.is_whole() {
                    continue;
                }
                round.insert(self.field, index - 1, stop.disk, stop.point, 0, 0);
            }
            index += 1;
        }
    }

    /// Moves the stops around those that have changed.
    fn settle(&self, round: &mut Itinerary) {
        let mut index = 0;
        while index < round.stops.len() {
            if !round.stops[index].is_dirty {
                index += 1;
                continue;
            }
            let low = index.saturating_sub(3).max(self.field.fixed());
            let mut high = index;
            let stops = round.stops.len();
            while let Some(next) = (high + 1..stops.min(high + 4)).rev().find(|&next| round.stops[next].is_dirty) {
                high = next;
            }
            let high = (high + 3).min(stops - 1);
            if low <= high {
                round.relax(self.field, low, high, 4);
            }
            index = (high + 1).saturating_sub(stops - round.stops.len()).max(index + 1);
        }
        round.stops.iter_mut().for_each(|stop| stop.is_dirty = false);
    }

    /// Takes out one or two strings of stops near random disks.
    fn ruin(&mut self, round: &mut Itinerary) {
        let fixed = self.field.fixed();
        for _ in 0..=below(&mut self.random, STRINGS) {
            let free = round.stops.len() - fixed;
            // One stop has to remain.
            let most = if fixed == 0 { free - 1 } else { free }.min(STRING);
            if most == 0 {
                return;
            }
            let centre = self.field.cover.centres[below(&mut self.random, self.field.cover.centres.len())];
            let away_m2 = |index: &usize| (round.stops[*index].point - centre).norm_squared();
            let nearest = (fixed..round.stops.len()).min_by(|a, b| away_m2(a).total_cmp(&away_m2(b)));
            let length = 1 + below(&mut self.random, most);
            let nearest = nearest.expect("a stop that may leave");
            let low =
                nearest.saturating_sub(below(&mut self.random, length)).max(fixed).min(round.stops.len() - length);
            round.remove(self.field, low, low + length);
        }
    }
}
