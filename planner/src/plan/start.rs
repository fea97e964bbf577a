//! Initial plans.

use skysink_common::geometry::{Position, distance_squared};

use super::forecast::{FRESH, Forecast, ForecastStyle};
use super::groups::PlannedStop;
use super::model::PlanModel;
use super::objective::Objective;
use super::operators::detours_m;
use super::states::HoverStore;
use super::timelines::Timelines;
use crate::geometry::turns::Turns;

/// Points that are tried for a first stop to hover at.
const FIRST_POINTS: usize = 4;

/// Positions in a plan that are tried for it: those of the least detour.
const FIRST_POSITIONS: usize = 8;

/// Slack of the worth of stops that are compared, relative to it.
const WORTH_SLACK: f64 = 1e-12;

/// Loads the best of several initial plans: a greedy one, and repeated rounds over single sensors and over groups, in
/// both directions.
pub fn begin<O: Objective<Style: ForecastStyle<O, Store = Timelines<O>>>>(
    model: &PlanModel,
    forecast: &mut Forecast<O>,
) {
    let mut best: Option<(f64, Vec<PlannedStop>)> = None;
    let mut offer = |forecast: &Forecast<O>| {
        if best.as_ref().is_none_or(|(cost, _)| forecast.cost < *cost) {
            best = Some((forecast.cost, forecast.stops()));
        }
    };
    forecast.load(model, []);
    extend(model, forecast);
    offer(forecast);
    let start = forecast.window.start;
    for tour in &model.tours {
        let away_m2 = |index: &usize| model.table.motion.distance_m2(&model.disk(tour[*index]).centre, &start);
        let Some(first) = (0..tour.len()).min_by(|a, b| away_m2(a).total_cmp(&away_m2(b))) else {
            continue;
        };
        let rounds = 2 * forecast.window.slots as usize * model.table.limits.blocks();
        forecast.load(model, tour.iter().cycle().skip(first).take(rounds).map(|&disk| PlannedStop::at(disk)));
        offer(forecast);
        let backward = tour.iter().rev().cycle().skip(tour.len() - 1 - first);
        forecast.load(model, backward.take(rounds).map(|&disk| PlannedStop::at(disk)));
        offer(forecast);
    }
    let (_, stops) = best.expect("at least one plan was offered");
    forecast.load(model, stops);
}

/// Appends stops until none fits, each time the one with most data per slot of flight, of equals the nearest: the bits
/// that its members will have sampled since they were empty, including overflow.
pub fn extend<O: Objective<Style: ForecastStyle<O, Store = Timelines<O>>>>(
    model: &PlanModel,
    forecast: &mut Forecast<O>,
) {
    loop {
        let levels = forecast.store.levels();
        let legs = forecast.trace.legs.len();
        let (at, slot) = forecast.trace.legs.last().map_or((forecast.window.start, 0), |leg| (leg.at, leg.end));
        let mut best: Option<(f64, f64, u32)> = None;
        let waited_bits = |member: u32, now: f64, level: O::Level| {
            (now - O::since(level)) * O::price(&model.sensors[member as usize])
        };
        for &stop in &model.stops {
            let members = &model.disks[stop as usize].members;
            let left = f64::from(forecast.window.slots - slot);
            let least = model.table.motion.least_slots_into(&at, model.disk(stop));
            if least > left || model.is_out(stop) {
                continue;
            }
            // The later it is there the less is its worth, and the fewer the visits of others before.
            let most_worth = || {
                let now = f64::from(slot) + least;
                members.iter().map(|&member| waited_bits(member, now, levels[member as usize])).sum::<f64>() / least
            };
            if best.is_some_and(|(most, ..)| most_worth() < most * (1.0 - WORTH_SLACK)) {
                continue;
            }
            let slots = model.table.motion.slots_into(&at, model.disk(stop));
            if slots > left {
                continue;
            }
            let now = f64::from(slot) + slots;
            let level = |member: u32| model.level_at::<O>(member as usize, now, levels[member as usize]);
            let worth = members.iter().map(|&member| waited_bits(member, now, level(member))).sum::<f64>() / slots;
            let away_m2 = distance_squared(&at, &model.disk(stop).centre);
            if best.is_none_or(|(most, nearest_m2, _)| worth > most || worth == most && away_m2 < nearest_m2) {
                best = Some((worth, away_m2, stop));
            }
        }
        let Some((.., stop)) = best else { break };
        forecast.append(model, PlannedStop::at(stop));
        if forecast.trace.legs.len() <= legs {
            break;
        }
    }
    forecast.settle();
}

/// Loads a first plan that hovers: a stop for each sensor, the fullest first, where the plan then delivers most, the
/// round of `turns`, or the stops `offered`, whichever delivers most. Where sensors sample, the first two are rounds
/// that are flown again and again.
pub fn begin_at_points<O: Objective<Style: ForecastStyle<O, Store = HoverStore<O>>>>(
    model: &mut PlanModel,
    forecast: &mut Forecast<O>,
    turns: &Turns,
    offered: Vec<PlannedStop>,
    is_over: &dyn Fn() -> bool,
) {
    forecast.store.keeps_idle = false;
    forecast.load(model, []);
    let mut open = forecast.open(model);
    open.sort_by(|(_, a), (_, b)| b.total_cmp(a));
    for &(sensor, queue_bits) in &open {
        if is_over() {
            break;
        }
        let mut best: Option<(f64, usize, PlannedStop)> = None;
        for point in model.first_points(sensor, FIRST_POINTS) {
            let hovers = model.hovers(sensor, queue_bits, &point);
            let stop = model.add_point(sensor, point, hovers);
            let detours = detours_m(model, &forecast.trace.legs, &forecast.window.start, &point);
            let mut by_detour: Vec<(f64, usize)> = detours.zip(0..).collect();
            by_detour.sort_by(|(a, _), (b, _)| a.total_cmp(b));
            for (_, index) in by_detour.into_iter().take(FIRST_POSITIONS) {
                let found = forecast.attempt(model, index, index, &[(stop, FRESH)]);
                if found < best.map_or(forecast.cost, |(best, ..)| best) {
                    best = Some((found, index, stop));
                }
            }
        }
        if let Some((_, index, stop)) = best {
            let cost = forecast.attempt(model, index, index, &[(stop, FRESH)]);
            forecast.accept(model, cost);
        }
    }
    if model.has_sampling {
        // What is sampled has to be fetched again and again.
        let round = forecast.stops();
        repeat(model, forecast, &round, is_over);
    }
    let mut best = (forecast.cost, forecast.stops());
    let mut offer = |forecast: &Forecast<O>| {
        if forecast.cost < best.0 {
            best = (forecast.cost, forecast.stops());
        }
    };
    if !is_over() {
        let round = round_of(model, turns, &open);
        forecast.load(model, []);
        repeat(model, forecast, &round, is_over);
        offer(forecast);
    }
    forecast.load(model, offered);
    offer(forecast);
    forecast.load(model, best.1);
    forecast.store.keeps_idle = true;
}

/// The stops of the round of `turns`; where nothing is sampled those of the sensors with data, `open` with their queues
/// [bit], from where they can be served until they are empty.
fn round_of(model: &mut PlanModel, turns: &Turns, open: &[(u32, f64)]) -> Vec<PlannedStop> {
    let mut queues_bits = vec![None; model.sensors.len()];
    for &(sensor, queue_bits) in open.iter().filter(|(sensor, _)| model.sensors[*sensor as usize].weight > 0.0) {
        queues_bits[sensor as usize] = Some(queue_bits);
    }
    let stop = |(&sensor, point): (&u32, &Position)| {
        let point = model.table.airspace.nearest(point);
        if model.has_sampling {
            return Some(model.add_point(sensor, point, 0));
        }
        let queue_bits = queues_bits[sensor as usize]?;
        let is_linked = model.link_bits(sensor, &point) > 0.0;
        // Beside a zone, in the middle of a cell or behind a building it may be out of range.
        let point = if is_linked { point } else { model.first_points(sensor, 1).pop()? };
        let hovers = model.hovers(sensor, queue_bits, &point);
        Some(model.add_point(sensor, point, hovers))
    };
    turns.order.iter().zip(&turns.points).filter_map(stop).collect()
}

/// Appends `round` to the plan as often as that lowers the cost: what was sampled meanwhile.
fn repeat<O: Objective<Style: ForecastStyle<O, Store = HoverStore<O>>>>(
    model: &PlanModel,
    forecast: &mut Forecast<O>,
    round: &[PlannedStop],
    is_over: &dyn Fn() -> bool,
) {
    let round: Vec<(PlannedStop, u32)> = round.iter().map(|stop| (*stop, FRESH)).collect();
    while !round.is_empty() && !is_over() {
        let legs = forecast.trace.legs.len();
        let cost = forecast.attempt(model, legs, legs, &round);
        if cost >= forecast.cost {
            break;
        }
        forecast.accept(model, cost);
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use skysink_common::stop::Stop;

    use super::*;
    use crate::plan::collect::Collect;
    use crate::plan::tests::points_model;
    use crate::plan::window::PlanningWindow;

    #[test]
    fn a_first_plan_that_hovers_delivers_no_less_than_the_round_of_the_tour() {
        let mut rounds = 0;
        for (seed, keys) in
            (0..12).flat_map(|seed| [(seed, ""), (seed, "moves = 'grid'\ncell_m = 16.0\nmax_speed_mps = 16.0\n")])
        {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let positions: Vec<[f64; 2]> = (0..40).map(|_| [0, 1].map(|_| random.random_range(20.0..380.0))).collect();
            let mut model = points_model(&positions, 0.0, keys);
            let turns = model.table.turns(&Stop::default()).as_ref().clone();
            let start = model.table.airspace.nearest(&Position::new(200.0, 200.0));
            let queues_bits = vec![9_000; 40];
            let window = PlanningWindow::<Collect>::new(&model, start, &queues_bits, |_| 0.0, 120, 0);
            let mut forecast = Forecast::new(&model, window);
            begin_at_points(&mut model, &mut forecast, &turns, Vec::new(), &|| false);
            let cost = forecast.cost;
            let open = forecast.open(&model);
            let round = round_of(&mut model, &turns, &open);
            for stop in &round {
                let sensor = model.disks[stop.disk as usize].members[0];
                assert!(model.link_bits(sensor, &model.disk(stop.disk).centre) > 0.0, "seed {seed}, {keys}: {sensor}");
            }
            forecast.store.keeps_idle = false;
            forecast.load(&model, round);
            assert!(cost <= forecast.cost, "seed {seed}, {keys}: {cost}, the round {}", forecast.cost);
            rounds += usize::from(cost == forecast.cost);
        }
        assert!(rounds > 2, "{rounds} plans are the round");
    }
}
