//! Exchanges of parts of a round, whose points stay where they are.

use skysink_common::random::below;

use super::search::RoundSearch;
use super::stops::Itinerary;

/// Longest part that or-opt moves.
const PART: usize = 8;

#[derive(Clone, Copy)]
enum Exchange {
    /// What lies between two legs, in the other direction. That of one stop, which changes nothing, stands for no
    /// exchange: without it, rounds of equal steps are as long on average.
    Reversed,
    /// A part moves into another leg.
    Moved { is_turned: bool },
}

impl RoundSearch<'_> {
    /// Exchanges parts of the round, its points held, if that makes it shorter than `limit_m` or little longer; `false`
    /// if not.
    pub(super) fn exchange(&mut self, round: &mut Itinerary, limit_m: f64) -> bool {
        if round.stops.len() < 4 {
            return false;
        }
        let slack_m = limit_m + 0.1 * round.mean_m() - round.length_m;
        if below(&mut self.random, 10) < 6 { self.bridge(round, slack_m) } else { self.two_opt(round, slack_m) }
    }

    /// Length [m] from stop `from` to stop `to`, the end of leg `leg`; 0 where an open round ends.
    fn joined_m(&self, round: &Itinerary, from: usize, to: usize) -> f64 {
        if to == 0 && !self.field.is_closed {
            return 0.0;
        }
        (round.stops[to].point - round.stops[from].point).norm()
    }

    /// Two neighbouring parts change places: legs i, j, k, in this order, become i to j+1, k to i+1, j to k+1.
    fn bridge(&mut self, round: &mut Itinerary, slack_m: f64) -> bool {
        let stops = round.stops.len();
        let after = |leg: usize| (leg + 1) % stops;
        let i = below(&mut self.random, stops);
        let own_m = self.joined_m(round, i, after(i));
        let mut second = None;
        let mut found = 0;
        for j in (0..stops).filter(|&j| j != i) {
            if self.joined_m(round, i, after(j)) < own_m {
                found += 1;
                if below(&mut self.random, found) == 0 {
                    second = Some(j);
                }
            }
        }
        let Some(j) = second else {
            return false;
        };
        let base_m = own_m + self.joined_m(round, j, after(j)) - self.joined_m(round, i, after(j));
        let mut best = (f64::INFINITY, 0);
        for k in (1..stops).map(|step| (j + step) % stops).take_while(|&k| k != i) {
            let change_m = self.joined_m(round, k, after(i)) + self.joined_m(round, j, after(k))
                - base_m
                - self.joined_m(round, k, after(k));
            if change_m < best.0 {
                best = (change_m, k);
            }
        }
        if best.0 >= slack_m {
            return false;
        }
        let mut legs = [i, j, best.1];
        legs.sort_unstable();
        self.cut(round, &legs);
        let [low, middle, high] = legs;
        round.stops[low + 1..=high].rotate_left(middle - low);
        self.join(round, &[low, low + high - middle, high]);
        true
    }

    /// The best of 2-opt and or-opt of a leg with all others.
    fn two_opt(&mut self, round: &mut Itinerary, slack_m: f64) -> bool {
        let stops = round.stops.len();
        let i = below(&mut self.random, stops);
        let part = 1 + below(&mut self.random, PART.min(stops - 3));
        let last = i + part;
        let (change_m, j, exchange) = self.best_exchange(round, i, part);
        if change_m >= slack_m {
            return false;
        }
        match exchange {
            Exchange::Reversed => {
                let [low, high] = [i.min(j), i.max(j)];
                self.cut(round, &[low, high]);
                round.stops[low + 1..=high].reverse();
                self.join(round, &[low, high]);
            }
            Exchange::Moved { is_turned } => {
                self.cut(round, &[i, last, j]);
                if is_turned {
                    round.stops[i + 1..=last].reverse();
                }
                if j > last {
                    round.stops[i + 1..=j].rotate_left(part);
                    self.join(round, &[i, j - part, j]);
                } else {
                    round.stops[j + 1..=last].rotate_right(part);
                    self.join(round, &[j, j + part, last]);
                }
            }
        }
        true
    }

    /// The best exchange of leg `i`, or of the `part` stops behind it, with another leg: the change of the length [m],
    /// infinite if there is none, the other leg, and what is done.
    fn best_exchange(&mut self, round: &Itinerary, i: usize, part: usize) -> (f64, usize, Exchange) {
        let stops = round.stops.len();
        let after = |leg: usize| (leg + 1) % stops;
        // The part behind leg i, if it does not contain the end.
        let last = i + part;
        let has_part = last < stops;
        let cut_m = self.joined_m(round, i, after(i));
        let freed_m = if has_part {
            cut_m + self.joined_m(round, last, after(last)) - self.joined_m(round, i, after(last))
        } else {
            f64::NEG_INFINITY
        };
        let mut best = (f64::INFINITY, 0, Exchange::Reversed);
        for j in (0..stops).filter(|&j| j != i) {
            if below(&mut self.random, 4) == 0 {
                continue;
            }
            let [low, high] = [i.min(j), i.max(j)];
            let base_m = self.joined_m(round, j, after(j));
            let crossed_m =
                (round.stops[high].point - round.stops[low].point).norm() + self.joined_m(round, low + 1, after(high));
            let mut offer = |change_m: f64, exchange: Exchange| {
                if change_m < best.0 {
                    best = (change_m, j, exchange);
                }
            };
            offer(crossed_m - cut_m - base_m, Exchange::Reversed);
            if has_part && !(i..=last).contains(&j) {
                let to = |from: usize, to: usize| (round.stops[to].point - round.stops[from].point).norm();
                let end = |from: usize| self.joined_m(round, from, after(j));
                offer(to(j, i + 1) + end(last) - base_m - freed_m, Exchange::Moved { is_turned: false });
                offer(to(j, last) + end(i + 1) - base_m - freed_m, Exchange::Moved { is_turned: true });
            }
        }
        best
    }

    /// Takes legs that are exchanged out of the counts.
    fn cut(&self, round: &mut Itinerary, legs: &[usize]) {
        legs.iter().for_each(|&leg| round.count_legs(self.field, leg, 1, u16::MAX));
    }

    /// Counts legs that were exchanged, and marks their ends.
    fn join(&self, round: &mut Itinerary, legs: &[usize]) {
        for &leg in legs {
            round.count_legs(self.field, leg, 1, 1);
            let next = (leg + 1) % round.stops.len();
            [leg, next].into_iter().for_each(|index| round.stops[index].is_dirty = true);
        }
    }
}
