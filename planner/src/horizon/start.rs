//! Plans to start from.

use skysink_common::geometry::{Position, distance_squared};

use super::flight::slots_to;
use super::forecast::{FRESH, Forecast};
use super::world::World;

/// Appends stops until none fits: each time the one whose data have waited longest, per slot of flight.
pub fn extend(world: &World, forecast: &mut Forecast) {
    loop {
        let empty = forecast.levels(world);
        let trace = forecast.trace();
        let stops = trace.legs.len();
        let (at, slot) = trace.legs.last().map_or((forecast.outlook().start, 0), |leg| (leg.at, leg.end));
        let end = Ending { world, empty: &empty, at, slot, left: forecast.outlook().slots - slot };
        let Some(place) = end.longest_waiting() else {
            return;
        };
        forecast.window.clear();
        forecast.window.push((place, FRESH));
        let loss_bits = forecast.attempt(world, stops, stops);
        forecast.accept(loss_bits);
        if forecast.trace().legs.len() <= stops {
            return;
        }
    }
}

/// The end of a plan.
struct Ending<'a> {
    world: &'a World,
    /// When each source is empty, after the last visit.
    empty: &'a [f64],
    at: Position,
    slot: i32,
    /// Slots to look ahead from there.
    left: i32,
}

impl Ending<'_> {
    /// Slots to `place`, if that is in time, and the data [bit] that its members will have sampled since they were empty.
    fn arrival(&self, place: u32) -> Option<(i32, f64)> {
        let slots = slots_to(self.world, &self.at, place);
        if slots > self.left {
            return None;
        }
        let now = f64::from(self.slot + slots);
        let waited_bits =
            |&member: &u32| (now - self.empty[member as usize]) * self.world.sources[member as usize].mean_bits;
        Some((slots, self.world.places[place as usize].members.iter().map(waited_bits).sum()))
    }

    /// The stop with most data per slot of flight, counting what has overflowed; of equals the nearest.
    fn longest_waiting(&self) -> Option<u32> {
        let mut best: Option<(f64, f64, u32)> = None;
        for &place in &self.world.stops {
            let Some((slots, bits)) = self.arrival(place) else {
                continue;
            };
            let worth = bits / f64::from(slots);
            let away_m2 = distance_squared(&self.at, &self.world.places[place as usize].centre);
            if best.is_none_or(|(most, nearest_m2, _)| worth > most || worth == most && away_m2 < nearest_m2) {
                best = Some((worth, away_m2, place));
            }
        }
        best.map(|(.., place)| place)
    }
}

/// The best of several first plans: by greedy steps, and tours round and round over single sources and over groups.
pub fn begin(world: &World, forecast: &mut Forecast) {
    let mut best: Option<(f64, Vec<u32>)> = None;
    let mut offer = |forecast: &Forecast| {
        if best.as_ref().is_none_or(|(bits, _)| forecast.loss_bits < *bits) {
            best = Some((forecast.loss_bits, forecast.places()));
        }
    };
    extend(world, forecast);
    offer(forecast);
    for tour in &world.tours {
        let start = forecast.outlook().start;
        let away = |place: &u32| distance_squared(&world.places[*place as usize].centre, &start);
        let Some(first) = (0..tour.len()).min_by(|&a, &b| away(&tour[a]).total_cmp(&away(&tour[b]))) else {
            continue;
        };
        let rounds = 2 * forecast.outlook().slots as usize * world.blocks();
        let ahead = tour.iter().cycle().skip(first).take(rounds).copied();
        forecast.load(world, ahead);
        offer(forecast);
        let back = tour.iter().rev().cycle().skip(tour.len() - 1 - first).take(rounds).copied();
        forecast.load(world, back);
        offer(forecast);
    }
    let (_, places) = best.expect("the first was offered");
    forecast.load(world, places.into_iter());
}
