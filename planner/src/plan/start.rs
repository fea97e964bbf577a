//! Initial plans.

use skysink_common::geometry::{Position, distance_squared};

use super::forecast::{FRESH, Forecast};
use super::groups::PlannedStop;
use super::model::PlanModel;
use super::objective::Objective;
use super::operators::detours_m;
use crate::geometry::turns::Turns;

/// Points that are tried for a first stop to hover at.
const FIRST_POINTS: usize = 4;

/// Positions in a plan that are tried for it: those of the least detour.
const FIRST_POSITIONS: usize = 8;

/// Slack of the worth of stops that are compared, relative to it.
const ROUNDING: f64 = 1e-12;

/// Loads the best of several initial plans: a greedy one, and repeated rounds over single sensors and over groups, in
/// both directions.
pub fn begin<O: Objective>(model: &PlanModel, forecast: &mut Forecast<O>) {
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
pub fn extend<O: Objective>(model: &PlanModel, forecast: &mut Forecast<O>) {
    loop {
        let levels = forecast.levels();
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
            if best.is_some_and(|(most, ..)| most_worth() < most * (1.0 - ROUNDING)) {
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

/// Loads a first plan that hovers: a stop for each sensor, the fullest first, where the plan then delivers most, the round
/// of `turns`, or the stops `offered`, whichever delivers most. Where sensors sample, the rounds are flown again and again.
pub fn begin_at_points<O: Objective>(
    model: &mut PlanModel,
    forecast: &mut Forecast<O>,
    turns: &Turns,
    offered: Vec<PlannedStop>,
    is_over: &dyn Fn() -> bool,
) {
    forecast.keeps_idle = false;
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
    let stop = |(&sensor, point): (&u32, &Position)| {
        let point = model.table.airspace.nearest(point);
        if model.has_sampling {
            return Some(model.add_point(sensor, point, 0));
        }
        let (_, queue_bits) = open.iter().find(|(other, _)| *other == sensor)?;
        let hovers = model.hovers(sensor, *queue_bits, &point);
        Some(model.add_point(sensor, point, hovers))
    };
    let round: Vec<PlannedStop> = turns.order.iter().zip(&turns.points).filter_map(stop).collect();
    forecast.load(model, []);
    repeat(model, forecast, &round, is_over);
    if forecast.cost < best.0 {
        best = (forecast.cost, forecast.stops());
    }
    forecast.load(model, offered);
    if forecast.cost < best.0 {
        best = (forecast.cost, forecast.stops());
    }
    forecast.load(model, best.1);
    forecast.keeps_idle = true;
}

/// Appends `round` to the plan as often as that lowers the cost: what was sampled meanwhile.
fn repeat<O: Objective>(
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
