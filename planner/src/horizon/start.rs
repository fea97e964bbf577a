//! Plans to start from.

use skysink_common::geometry::{Position, distance_squared};

use super::choice::Candidate;
use super::flight::slots_to;
use super::forecast::{FRESH, Forecast};
use super::world::World;

/// What the next stop of a greedy plan is chosen by, per slot of flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Greed {
    /// The data that its members will have sampled since they were empty, counting what has overflowed.
    Waiting,
    /// The loss that serving there is expected to save, whoever is in range.
    Saving,
}

/// Appends stops until none fits: each time the one whose data have waited longest, per slot of flight.
pub fn extend(world: &World, forecast: &mut Forecast) {
    extend_by(Greed::Waiting, world, forecast);
}

fn extend_by(greed: Greed, world: &World, forecast: &mut Forecast) {
    let mut around: Vec<Around> = match greed {
        Greed::Waiting => Vec::new(),
        Greed::Saving => world.stops.iter().map(|&stop| Around::new(world, stop)).collect(),
    };
    loop {
        let empty = forecast.levels(world);
        let trace = forecast.trace();
        let stops = trace.legs.len();
        let (at, slot) = trace.legs.last().map_or((forecast.outlook().start, 0), |leg| (leg.at, leg.end));
        let end = Ending { world, empty: &empty, at, slot, left: forecast.outlook().slots - slot };
        let best = match greed {
            Greed::Waiting => end.best(|stop, now| end.waited_bits(world.stops[stop], now)),
            Greed::Saving => end.best(|stop, now| end.saved_bits(&mut around[stop], now)),
        };
        let Some(place) = best else {
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
    /// The data [bit] that the members of `place` will have sampled by slot `now` since they were empty.
    fn waited_bits(&self, place: u32, now: f64) -> f64 {
        let waited_bits =
            |&member: &u32| (now - self.empty[member as usize]) * self.world.sources[member as usize].mean_bits;
        self.world.places[place as usize].members.iter().map(waited_bits).sum()
    }

    /// The loss [bit] that serving `around` at slot `now` saves: the members of a stop, then most of the others.
    fn saved_bits(&self, around: &mut Around, now: f64) -> f64 {
        let Around { members, others } = around;
        let candidates = members.iter_mut().chain(others.iter_mut());
        candidates.for_each(|candidate| candidate.weigh(self.world, now - self.empty[candidate.source as usize]));
        let free = self.world.blocks() - members.len();
        if others.len() > free && free > 0 {
            others.select_nth_unstable_by(free - 1, Candidate::order);
        }
        members.iter().chain(others.iter().take(free)).map(|candidate| candidate.saved_bits).sum()
    }

    /// The stop of most worth [bit] at its arrival, per slot of flight, of those in time; of equals the nearest.
    /// `worth_bits` takes the stop's number and the slot.
    fn best(&self, mut worth_bits: impl FnMut(usize, f64) -> f64) -> Option<u32> {
        let mut best: Option<(f64, f64, u32)> = None;
        for (stop, &place) in self.world.stops.iter().enumerate() {
            let slots = slots_to(self.world, &self.at, place);
            if slots > self.left {
                continue;
            }
            let worth = worth_bits(stop, f64::from(self.slot + slots)) / f64::from(slots);
            let away_m2 = distance_squared(&self.at, &self.world.places[place as usize].centre);
            if best.is_none_or(|(most, nearest_m2, _)| worth > most || worth == most && away_m2 < nearest_m2) {
                best = Some((worth, away_m2, place));
            }
        }
        best.map(|(.., place)| place)
    }
}

/// Who is in range of the centre of a stop.
struct Around {
    members: Vec<Candidate>,
    others: Vec<Candidate>,
}

impl Around {
    fn new(world: &World, place: u32) -> Self {
        let place = &world.places[place as usize];
        let mut around = Self { members: Vec::new(), others: Vec::new() };
        world.grid.visit(&place.centre, world.radius_m(), |node, d2_m2| {
            let is_member = place.members.contains(&node.id);
            let list = if is_member { &mut around.members } else { &mut around.others };
            list.push(Candidate::new(world, node.id, d2_m2));
        });
        around
    }
}

/// The best of several first plans: by greedy steps of either kind, and tours round and round over single sources and over groups.
pub fn begin(world: &World, forecast: &mut Forecast) {
    let mut best: Option<(f64, Vec<u32>)> = None;
    let mut offer = |forecast: &Forecast| {
        if best.as_ref().is_none_or(|(bits, _)| forecast.loss_bits < *bits) {
            best = Some((forecast.loss_bits, forecast.places()));
        }
    };
    for greed in [Greed::Waiting, Greed::Saving] {
        forecast.load(world, std::iter::empty());
        extend_by(greed, world, forecast);
        offer(forecast);
    }
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
