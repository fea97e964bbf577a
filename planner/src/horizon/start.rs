//! Initial plans.

use skysink_common::geometry::distance_squared;

use super::choice::Candidate;
use super::flight::slots_to;
use super::forecast::Forecast;
use super::model::PlanningModel;

/// Loads the best of several initial plans: greedy plans of two kinds, and repeated tours over single sensors and
/// groups.
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
    forecast.load(model, []);
    extend_by_savings(model, forecast);
    offer(forecast);
    let start = forecast.window.start;
    for tour in &model.tours {
        let away_m2 = |index: &usize| distance_squared(&model.disk(tour[*index]).centre, &start);
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

/// Appends stops until none fits, each time the one with most data per slot of flight: the bits that its members will
/// have sampled since they were empty, including overflow.
pub fn extend(model: &PlanningModel, forecast: &mut Forecast) {
    extend_by(model, forecast, |index, now, empty| {
        let waited_bits = |&member: &u32| (now - empty[member as usize]) * model.sensors[member as usize].cost_bits;
        model.disks[model.stops[index] as usize].members.iter().map(waited_bits).sum()
    });
}

/// As [`extend`], by the expected loss that serving all sensors in range saves.
fn extend_by_savings(model: &PlanningModel, forecast: &mut Forecast) {
    let mut around: Vec<InRange> = model.stops.iter().map(|&stop| InRange::new(model, stop)).collect();
    extend_by(model, forecast, |index, now, empty| around[index].saved_bits(model, now, empty));
}

/// Appends stops until none fits, each time the one of most worth [bit] per slot of flight; of equals the nearest.
/// `worth_bits` takes the index of the stop in the model's list, the slot of arrival, and when each sensor is empty.
fn extend_by(model: &PlanningModel, forecast: &mut Forecast, mut worth_bits: impl FnMut(usize, f64, &[f64]) -> f64) {
    loop {
        let empty = forecast.levels(model);
        let legs = forecast.trace.legs.len();
        let (at, slot) = forecast.trace.legs.last().map_or((forecast.window.start, 0), |leg| (leg.at, leg.end));
        let mut best: Option<(f64, f64, u32)> = None;
        for (index, &stop) in model.stops.iter().enumerate() {
            let slots = slots_to(model, &at, stop);
            if slots > forecast.window.slots - slot {
                continue;
            }
            let worth = worth_bits(index, f64::from(slot + slots), &empty) / f64::from(slots);
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

/// The sensors in range of the centre of a stop.
struct InRange {
    members: Vec<Candidate>,
    others: Vec<Candidate>,
}

impl InRange {
    fn new(model: &PlanningModel, stop: u32) -> Self {
        let mut found = Self { members: Vec::new(), others: Vec::new() };
        model.table.sensors.grid.visit(&model.disk(stop).centre, model.table.limits.comm_radius_m, |node, d2_m2| {
            let is_member = model.disks[stop as usize].members.contains(&node.id);
            let list = if is_member { &mut found.members } else { &mut found.others };
            list.push(Candidate::new(model, node.id, d2_m2));
        });
        found
    }

    /// The loss [bit] that serving them at slot `now` saves: the members of the stop, and the best of the others.
    fn saved_bits(&mut self, model: &PlanningModel, now: f64, empty: &[f64]) -> f64 {
        let Self { members, others } = self;
        let candidates = members.iter_mut().chain(others.iter_mut());
        candidates.for_each(|candidate| candidate.weigh(model, now - empty[candidate.sensor as usize]));
        let free = model.table.limits.blocks() - members.len();
        if others.len() > free && free > 0 {
            others.select_nth_unstable_by(free - 1, Candidate::order);
        }
        members.iter().chain(others.iter().take(free)).map(|candidate| candidate.saved_bits).sum()
    }
}
