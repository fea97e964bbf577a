//! Simulated annealing of a plan: changes of a few stops, accepted by chance if they lose a little more.

use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::budget::Budget;
use super::forecast::{FRESH, Forecast};
use super::world::World;

/// Longest part of a plan that moves as one.
const LONGEST_MOVED: usize = 40;

/// Longest part of a plan that is turned round.
const LONGEST_TURNED: usize = 150;

/// How willing a search is to accept more loss.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Heat {
    /// Loss [bit] that is accepted with chance 1/e, for a change in the far future.
    pub far_bits: f64,
    /// The slot from which on the future counts: changes start behind it.
    pub now: i32,
    /// Slots ahead of it from which on the future is far.
    pub far_slots: f64,
    /// The share of it for a change in the next slot.
    pub near_share: f64,
}

impl Heat {
    fn at(&self, slot: i32) -> f64 {
        self.far_bits * (f64::from(slot - self.now) / self.far_slots).clamp(self.near_share, 1.0)
    }
}

/// A number below `count`, which is at least 1 and below 2^32.
fn below(random: &mut ChaCha8Rng, count: usize) -> usize {
    ((u64::from(random.next_u32()) * count as u64) >> 32) as usize
}

/// A share from above 0 to 1.
fn share(random: &mut ChaCha8Rng) -> f64 {
    (f64::from(random.next_u32()) + 1.0) / 4_294_967_296.0
}

/// Improves the plan of `forecast` by as many changes as `budget` allows.
pub fn anneal(world: &World, forecast: &mut Forecast, heat: Heat, budget: Budget, random: &mut ChaCha8Rng) {
    for _ in (0..).take_while(|step| budget.allows(*step)) {
        let Some((from, to)) = propose(world, forecast, heat.now, random) else {
            continue;
        };
        let slot = forecast.trace().legs.get(from).map_or(forecast.outlook().slots, |leg| leg.end);
        let limit_bits = forecast.loss_bits - heat.at(slot) * share(random).ln();
        let loss_bits = forecast.attempt(world, from, to);
        if loss_bits <= limit_bits {
            forecast.accept(loss_bits);
        }
    }
}

/// Draws a change: fills the window of `forecast`, and says which stops it replaces.
fn propose(world: &World, forecast: &mut Forecast, now: i32, random: &mut ChaCha8Rng) -> Option<(usize, usize)> {
    let mut window = std::mem::take(&mut forecast.window);
    window.clear();
    let first = if now > 0 { forecast.trace().legs.partition_point(|leg| leg.end <= now) } else { 0 };
    let replaced = Proposal { world, forecast, first, random, window: &mut window }.draw();
    forecast.window = window;
    replaced
}

struct Proposal<'a> {
    world: &'a World,
    forecast: &'a Forecast,
    /// The first stop that a change may start from.
    first: usize,
    random: &'a mut ChaCha8Rng,
    window: &'a mut Vec<(u32, u32)>,
}

impl Proposal<'_> {
    fn stops(&self) -> usize {
        self.forecast.trace().legs.len()
    }

    fn place(&self, stop: usize) -> u32 {
        self.forecast.trace().legs[stop].place
    }

    /// A place near the one of `stop`, or anywhere.
    fn other(&mut self, stop: usize) -> u32 {
        let near = &self.world.neighbours[self.place(stop) as usize];
        if near.is_empty() || below(self.random, 16) == 0 {
            return self.world.stops[below(self.random, self.world.stops.len())];
        }
        near[below(self.random, near.len())]
    }

    /// The next stop at `place` after or before `stop`, at most `most` stops away.
    fn find(&mut self, place: u32, stop: usize, most: usize) -> Option<usize> {
        let legs = &self.forecast.trace().legs;
        if self.random.next_u32() & 1 == 0 {
            let end = legs.len().min(stop + 1 + most);
            legs[stop + 1..end].iter().position(|leg| leg.place == place).map(|away| stop + 1 + away)
        } else {
            let begin = stop.saturating_sub(most);
            legs[begin..stop].iter().rposition(|leg| leg.place == place).map(|index| begin + index)
        }
    }

    fn old(&mut self, stops: std::ops::Range<usize>) {
        let legs = &self.forecast.trace().legs;
        self.window.extend(stops.map(|stop| (legs[stop].place, stop as u32)));
    }

    fn turned(&mut self, stops: std::ops::Range<usize>) {
        let legs = &self.forecast.trace().legs;
        self.window.extend(stops.rev().map(|stop| (legs[stop].place, FRESH)));
    }

    fn draw(&mut self) -> Option<(usize, usize)> {
        if self.stops() == 0 {
            self.window.push((self.world.stops[below(self.random, self.world.stops.len())], FRESH));
            return Some((0, 0));
        }
        let first = self.first.min(self.stops() - 1);
        let stop = first + below(self.random, self.stops() - first);
        match below(self.random, 100) {
            0..20 => {
                let place = self.other(stop);
                self.window.push((place, FRESH));
                let at = stop + below(self.random, 2);
                Some((at, at))
            }
            20..35 => Some((stop, stop + 1)),
            35..50 => {
                let place = self.other(stop);
                self.window.push((place, FRESH));
                Some((stop, stop + 1))
            }
            50..75 => self.moved(stop),
            75..90 => self.turn(stop),
            _ => self.swap(stop),
        }
    }

    /// Moves a few stops from `stop` on to behind another one.
    fn moved(&mut self, stop: usize) -> Option<(usize, usize)> {
        let longest = LONGEST_MOVED.min(self.stops() - stop);
        let longest = if below(self.random, 2) == 0 { longest.min(3) } else { longest };
        let end = stop + 1 + below(self.random, longest);
        let near = self.other(stop);
        let behind = self.find(near, stop, usize::MAX / 2)? + 1;
        let turned = below(self.random, 2) == 0;
        let carry = |proposal: &mut Self| {
            if turned { proposal.turned(stop..end) } else { proposal.old(stop..end) }
        };
        if behind > end {
            self.old(end..behind);
            carry(self);
            Some((stop, behind))
        } else if behind <= stop {
            carry(self);
            self.old(behind..stop);
            Some((behind, end))
        } else {
            None
        }
    }

    /// Turns the stops round that lie between `stop` and one near it.
    fn turn(&mut self, stop: usize) -> Option<(usize, usize)> {
        let near = self.other(stop);
        let other = self.find(near, stop, LONGEST_TURNED)?;
        let (from, to) = if other > stop { (stop + 1, other + 1) } else { (other, stop) };
        if to - from < 2 {
            return None;
        }
        self.turned(from..to);
        Some((from, to))
    }

    /// Exchanges two stops.
    fn swap(&mut self, stop: usize) -> Option<(usize, usize)> {
        let near = self.other(stop);
        let other = self.find(near, stop, usize::MAX / 2)?;
        let (a, b) = (stop.min(other), stop.max(other));
        self.old(b..b + 1);
        self.old(a + 1..b);
        self.old(a..a + 1);
        Some((a, b + 1))
    }
}
