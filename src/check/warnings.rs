//! Warnings about scenarios that are probably unintended, from the figures alone. `tests/it/check.rs` tries each rule
//! on missions where it applies and where it does not.

use skysink_planner::strategies::uts;

use super::figures::Figures;
use super::quantity::{percent, scaled};
use super::verdict::LossFree;

/// The warnings for these figures, one line each.
pub fn of(figures: &Figures) -> Vec<String> {
    let rules: [fn(&Figures) -> Option<String>; 14] = [
        in_transit,
        slow_link,
        overloaded,
        unreachable,
        hidden,
        |figures| figures.energy.as_ref()?.warning(),
        |figures| figures.energy.as_ref()?.landing_warning(),
        |figures| figures.energy.as_ref()?.stranded_warning(),
        unserved,
        late,
        told_otherwise,
        told_steadier,
        |figures| figures.motion.start_warning(),
        |figures| figures.motion.warning(),
    ];
    rules.into_iter().filter_map(|rule| rule(figures)).collect()
}

/// For a reach `V τ ≤ d_c`, most sets that Algorithm 1 finds have no waypoint in reach.
fn in_transit(figures: &Figures) -> Option<String> {
    let Figures { reach_m, comm_radius_m, .. } = *figures;
    (figures.strategy == uts::STRATEGY.name && reach_m <= comm_radius_m).then(|| {
        let reach = scaled(reach_m, "m");
        let radius = scaled(comm_radius_m, "m");
        format!(
            "uts will mostly fly in transit: its anchor radius, the reach less d_c, is not above 0 ({reach} less \
             {radius}): try uts-wide or horizon, or longer slots"
        )
    })
}

/// Even the strongest link does not empty a full buffer in one visit.
fn slow_link(figures: &Figures) -> Option<String> {
    let most = scaled(figures.above.visit_bits[1] as f64, "bit");
    match figures.above.visits[0] {
        Some(1) => None,
        Some(visits) => Some(format!(
            "the radio is slow: a visit uploads at most {most}, so that a full buffer takes {visits} or more visits"
        )),
        None => Some("no link uploads a single bit per visit: nothing will be delivered".to_owned()),
    }
}

/// The offered load exceeds the capacity of the radio.
fn overloaded(figures: &Figures) -> Option<String> {
    let load = &figures.load;
    let fraction = load.fraction.filter(|&fraction| fraction > 1.0)?;
    let [offered, carried] = [load.offered_bits, load.carried_bits].map(|bits| scaled(bits, "bit"));
    let percent = percent(fraction);
    let is_buffer_limited = load.carried_bits < load.visits as f64 * figures.above.visit_bits[1] as f64;
    let limit = if is_buffer_limited { "buffer size" } else { "radio" };
    Some(format!(
        "the load is {percent} of the maximum that {} visits collect ({offered} of {carried} per slot, limited by the \
         {limit}): once buffers are full, every strategy loses data",
        load.visits
    ))
}

/// Some SNs are too far from the start to be reached within the mission.
fn unreachable(figures: &Figures) -> Option<String> {
    let Figures { unreachable, sensors, slots, .. } = *figures;
    (unreachable > 0).then(|| {
        format!("{unreachable} of the {sensors} sensor nodes cannot be reached within the mission's {slots} slots")
    })
}

/// Zones leave no place from which some SNs can be served.
fn hidden(figures: &Figures) -> Option<String> {
    let hidden = figures.hidden.filter(|&hidden| hidden > 0)?;
    let sensors = figures.sensors;
    let names = figures.hidden_nodes.join(", ");
    let more = if hidden > figures.hidden_nodes.len() { ", …" } else { "" };
    Some(format!(
        "{hidden} of the {sensors} sensor nodes cannot be served: no path leads into their range around the zones \
         ({names}{more})"
    ))
}

/// No buffer overflows in the mission, or no SN samples.
fn unserved(figures: &Figures) -> Option<String> {
    let advice = match figures.fill_slots {
        Some(_) => {
            "no buffer overflows within the mission, even if no sensor node is served: no strategy loses data; use more slots"
        }
        None => {
            "no sensor node samples: no strategy loses data; planner.objective = \"collect\" lets horizon and offline plan \
             for what is delivered"
        }
    };
    (figures.loss_free == LossFree::Unserved && figures.objective.is_none()).then(|| advice.to_owned())
}

/// Not every SN can be served within the limit of its age.
fn late(figures: &Figures) -> Option<String> {
    let deadline_slots = figures.deadline_slots?;
    let least_slots =
        figures.round.least_slots.filter(|&least_slots| least_slots.saturating_sub(1) > deadline_slots)?;
    Some(format!(
        "sensors.deadline_s is {deadline_slots} slots, and serving every sensor node takes at least {least_slots}: not \
         all can be served in time"
    ))
}

/// Fraction of the mean from which on a mission that samples more or less has probably been told another mean.
const OTHER_MEAN: f64 = 0.2;

/// A trace whose rates differ by more than 20 % from what the planner is told.
fn told_otherwise(figures: &Figures) -> Option<String> {
    let mission = figures.arrivals?.mission?;
    ((mission.of_mean - 1.0).abs() > OTHER_MEAN).then(|| {
        format!(
            "the mission samples {} of what sensors.sampling_bps tells the planner: change the rates to those of the \
             arrivals, unless that is the point",
            percent(mission.of_mean)
        )
    })
}

/// Ratio of the dispersion of a trace to what the planner is told, or the inverse, from which on it was hardly meant.
const OTHER_DISPERSION: f64 = 4.0;

/// A trace whose dispersion is not within a factor of 4 of what the planner is told.
fn told_steadier(figures: &Figures) -> Option<String> {
    let arrivals = figures.arrivals?;
    let told_bits = arrivals.told_dispersion_bits?;
    let found_bits = arrivals.mission?.dispersion_bits;
    let ratio = found_bits / told_bits;
    (ratio.max(1.0 / ratio) > OTHER_DISPERSION).then(|| {
        format!(
            "the bits of a slot vary by {} over their mean, and sensors.arrivals.dispersion_bits tells the planner {}: \
             give that of the trace, unless that is the point",
            scaled(found_bits, "bit"),
            scaled(told_bits, "bit")
        )
    })
}
