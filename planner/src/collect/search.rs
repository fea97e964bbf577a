//! The search for a plan: stops inserted where they deliver most, and simulated annealing.

use rand_chacha::ChaCha8Rng;
use skysink_common::geometry::Position;
use skysink_common::random::{below, fraction};
use skysink_common::stop::Stop;

use super::flight::{PlanFlight, PlannedStop};

/// Temperature at the end of a search, in parts of the mean data of an SN.
const LAST_TEMPERATURE: f64 = 1e-3;

/// Places that are tried for a first stop.
const FIRST_PLACES: usize = 4;

/// Positions in a plan that are tried for a first stop: those of the least detour.
const FIRST_POSITIONS: usize = 8;

/// Most hovers of a stop [moves].
const MOST_HOVERS: u32 = 60;

/// Steps between two checks whether a search is over.
const CHECK_STEPS: u64 = 8;

/// A search.
pub struct PlanSearch<'a, 'b> {
    /// What plans deliver.
    pub flight: &'a mut PlanFlight<'b>,
    /// Its random numbers.
    pub random: &'a mut ChaCha8Rng,
    /// Ends it early.
    pub is_over: &'a dyn Fn() -> bool,
}

impl PlanSearch<'_, '_> {
    /// A first plan: a stop for each SN, the fullest first, where the plan then delivers most. Where SNs sample it is
    /// the same round again and again, that of `tour`, or `offered`, whichever delivers most.
    pub fn insert_all(&mut self, offered: Vec<PlannedStop>, stop: &Stop) -> Vec<PlannedStop> {
        let mut stops: Vec<PlannedStop> = Vec::new();
        let mut value = self.flight.attempt(&stops, 0);
        self.flight.keep(&mut stops);
        let mut open = self.flight.open();
        open.sort_by(|a, b| self.flight.begun_bits(*b).total_cmp(&self.flight.begun_bits(*a)));
        for sensor in open {
            if (self.is_over)() {
                break;
            }
            let mut best: Option<(f64, usize, PlannedStop)> = None;
            for place in self.flight.places.first(sensor, FIRST_PLACES) {
                let stop = PlannedStop::new(place, sensor, self.hovers(sensor, &place));
                for index in self.by_detour(&stops, &place).into_iter().take(FIRST_POSITIONS) {
                    stops.insert(index, stop);
                    let found = self.flight.attempt(&stops, index);
                    stops.remove(index);
                    if found > best.map_or(value, |(best, ..)| best) {
                        best = Some((found, index, stop));
                    }
                }
            }
            if let Some((found, index, stop)) = best {
                stops.insert(index, stop);
                self.flight.attempt(&stops, index);
                self.flight.keep(&mut stops);
                value = found;
            }
        }
        if !self.flight.has_sampling() {
            return stops;
        }
        // What is sampled has to be fetched again and again: perhaps better in the round of `tour`.
        let round = stops.clone();
        value = self.repeat(&mut stops, &round, value);
        let table = &self.flight.places.table;
        let mut turns = table.turns(stop).as_ref().clone();
        let start = self.flight.begin();
        turns.begin_near(|point| table.motion.distance_m2(point, &start));
        let place = |point: &Position| table.airspace.nearest(point);
        let round = turns.order.iter().zip(&turns.points);
        let round: Vec<PlannedStop> = round.map(|(&sensor, point)| PlannedStop::new(place(point), sensor, 0)).collect();
        let mut tour = Vec::new();
        let begun = self.flight.attempt(&tour, 0);
        self.flight.keep(&mut tour);
        let tour_bits = self.repeat(&mut tour, &round, begun);
        let offered_bits = self.flight.attempt(&offered, 0);
        if offered_bits > value.max(tour_bits) {
            offered
        } else if tour_bits > value {
            tour
        } else {
            stops
        }
    }

    /// Appends `round` to a plan of this value as often as that delivers more: what was sampled meanwhile. Returns the
    /// value.
    fn repeat(&mut self, stops: &mut Vec<PlannedStop>, round: &[PlannedStop], mut value: f64) -> f64 {
        while !round.is_empty() && !(self.is_over)() {
            let same = stops.len();
            stops.extend(round);
            let found = self.flight.attempt(stops, same);
            if found <= value {
                stops.truncate(same);
                break;
            }
            self.flight.keep(stops);
            value = found;
        }
        value
    }

    /// The indices at which `place` may be inserted, by the length that it adds.
    fn by_detour(&self, stops: &[PlannedStop], place: &Position) -> Vec<usize> {
        let at = |index: usize| index.checked_sub(1).map_or(self.flight.begin(), |index| stops[index].place);
        let detour_m = |index: usize| {
            let before = at(index);
            let to_m = (place - before).norm();
            stops.get(index).map_or(to_m, |next| to_m + (next.place - place).norm() - (next.place - before).norm())
        };
        let mut indices: Vec<(f64, usize)> = (0..=stops.len()).map(|index| (detour_m(index), index)).collect();
        indices.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        indices.into_iter().map(|(_, index)| index).collect()
    }

    /// Hovers that empty the queue of an SN from `place`.
    fn hovers(&mut self, sensor: u32, place: &Position) -> u32 {
        let moves = self.flight.places.table.airspace.move_slots() as f64;
        let capacity_bits = f64::from(self.flight.places.table.sensors.sampler(sensor).capacity_bits);
        let queue_bits = self.flight.begun_bits(sensor).max(capacity_bits.min(1.0));
        let hovers = (queue_bits / (self.flight.places.link_bits(sensor, place) * moves)).ceil();
        hovers.clamp(1.0, f64::from(MOST_HOVERS)) as u32
    }

    /// The best plan that up to `steps` changes of `stops` lead to, from a temperature in parts of the mean data of an
    /// SN, and whether the search was in vain: it found no better plan than `stops`, which leaves little to deliver.
    pub fn anneal(&mut self, mut stops: Vec<PlannedStop>, steps: u64, temperature: f64) -> (Vec<PlannedStop>, bool) {
        if steps == 0 {
            return (stops, false); // with those that now take no slot: they may again
        }
        let mut value = self.flight.attempt(&stops, 0);
        self.flight.keep(&mut stops);
        let open = self.flight.open();
        if open.is_empty() {
            return (stops, true);
        }
        let begun = value;
        let mean_bits = self.flight.mean_bits();

        let mut best = (value, stops.clone());
        let mut changed = stops.clone();
        for step in 0..steps {
            if self.flight.is_complete(best.0) || step % CHECK_STEPS == 0 && (self.is_over)() {
                break;
            }
            let along = step as f64 / steps as f64;
            let limit_bits = mean_bits * temperature * (LAST_TEMPERATURE / temperature).powf(along);
            changed.clone_from(&stops);
            let Some(same) = self.change(&mut changed, &open) else { continue };
            // The UAV is on its way to no other stop.
            changed.iter_mut().skip(1).for_each(|stop| stop.is_begun = false);
            let found = self.flight.attempt(&changed, same);
            if found < value + limit_bits * fraction(self.random).ln() {
                continue;
            }
            self.flight.keep(&mut changed);
            std::mem::swap(&mut stops, &mut changed);
            value = found;
            if value > best.0 {
                best.0 = value;
                best.1.clone_from(&stops);
            }
        }
        let is_vain = best.0 <= begun && self.flight.leaves_little(best.0);
        (best.1, is_vain)
    }

    /// Changes a plan by chance; returns how many stops at its beginning stay the same. `None` if it changes nothing.
    fn change(&mut self, stops: &mut Vec<PlannedStop>, open: &[u32]) -> Option<usize> {
        let kind = below(self.random, 100);
        if stops.is_empty() || kind < 25 {
            let sensor = open[below(self.random, open.len())];
            let place = self.flight.places.draw(sensor, self.random)?;
            let hovers = self.hovers(sensor, &place);
            let hovers =
                if below(self.random, 2) == 0 { hovers } else { below(self.random, hovers as usize + 1) as u32 };
            let index = match below(self.random, 2) {
                0 => self.by_detour(stops, &place)[0],
                _ => below(self.random, stops.len() + 1),
            };
            stops.insert(index, PlannedStop::new(place, sensor, hovers));
            return Some(index);
        }
        let index = below(self.random, stops.len());
        match kind {
            25..40 => {
                stops.remove(index);
                Some(index)
            }
            40..55 => {
                let stop = stops.remove(index);
                let other = below(self.random, stops.len() + 1);
                stops.insert(other, stop);
                (other != index).then_some(index.min(other))
            }
            55..65 => {
                let end = index + 1 + below(self.random, stops.len() - index);
                stops[index..end].reverse();
                (end > index + 1).then_some(index)
            }
            65..85 => {
                let stop = &mut stops[index];
                stop.is_begun = false;
                stop.place = match below(self.random, 2) {
                    0 => self.flight.places.draw(stop.sensor, self.random)?,
                    _ => self.flight.places.beside(&stop.place, self.random),
                };
                Some(index)
            }
            _ => {
                let stop = &mut stops[index];
                let before = stop.hovers;
                stop.hovers = match below(self.random, 3) {
                    0 => before.saturating_sub(1),
                    1 => (before + 1).min(MOST_HOVERS),
                    _ => below(self.random, MOST_HOVERS as usize + 1) as u32,
                };
                (stop.hovers != before).then_some(index)
            }
        }
    }
}
