//! Initial plans.

use skysink_common::geometry::distance_squared;

use super::flight::slots_to;
use super::forecast::Forecast;
use super::model::PlanningModel;

/// Loads the best of several initial plans: a greedy one, and repeated rounds over single sensors and over groups, in
/// both directions.
pub fn begin(model: &PlanningModel, forecast: &mut Forecast) {
    let mut best: Option<(f64, Vec<u32>)> = None;
    let mut offer = |forecast: &Forecast| {
        if best.as_ref().is_none_or(|(bits, _)| forecast.loss_bits < *bits) {
            best = Some((forecast.loss_bits, forecast.stops()));
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
        forecast.load(model, tour.iter().cycle().skip(first).take(rounds).copied());
        offer(forecast);
        forecast.load(model, tour.iter().rev().cycle().skip(tour.len() - 1 - first).take(rounds).copied());
        offer(forecast);
    }
    let (_, stops) = best.expect("at least one plan was offered");
    forecast.load(model, stops);
}

/// Appends stops until none fits, each time the one with most data per slot of flight, of equals the nearest: the bits
/// that its members will have sampled since they were empty, including overflow.
pub fn extend(model: &PlanningModel, forecast: &mut Forecast) {
    loop {
        let empty = forecast.levels(model);
        let legs = forecast.trace.legs.len();
        let (at, slot) = forecast.trace.legs.last().map_or((forecast.window.start, 0), |leg| (leg.at, leg.end));
        let mut best: Option<(f64, f64, u32)> = None;
        for &stop in &model.stops {
            let slots = slots_to(model, &at, stop);
            if slots > forecast.window.slots - slot {
                continue;
            }
            let now = f64::from(slot + slots);
            let waited_bits = |&member: &u32| {
                let sensor = member as usize;
                (now - model.last_empty(sensor, now, empty[sensor])) * model.sensors[sensor].cost_bits
            };
            let worth = model.disks[stop as usize].members.iter().map(waited_bits).sum::<f64>() / f64::from(slots);
            let away_m2 = distance_squared(&at, &model.disk(stop).centre);
            if best.is_none_or(|(most, nearest_m2, _)| worth > most || worth == most && away_m2 < nearest_m2) {
                best = Some((worth, away_m2, stop));
            }
        }
        let Some((.., stop)) = best else {
            return;
        };
        forecast.append(model, stop);
        if forecast.trace.legs.len() <= legs {
            return;
        }
    }
}
