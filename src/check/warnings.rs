//! Warnings about scenarios that are probably unintended, mostly from the figures alone. `tests/it/check.rs` tries each
//! rule on missions where it applies and where it does not.

use skysink_common::channel::LinkBudget;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_planner::strategies::uts;

use super::figures::{Figures, KindFigures};
use super::quantity::{percent, scaled};
use super::verdict::LossFree;

/// The warnings for `scenario` with these figures, one line each.
pub fn of(scenario: &Scenario, figures: &Figures) -> Vec<String> {
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
        |figures| figures.motion.warning().filter(|_| figures.kinds.is_empty()),
    ];
    let of_figures = rules.into_iter().filter_map(|rule| rule(figures));
    let of_both = [paper_values(scenario, figures), short_slot(scenario, figures)].into_iter().flatten();
    let of_kinds = figures.kinds.iter().flat_map(of_kind);
    of_figures.chain(of_kinds).chain(of_both).chain(too_few_slots(figures)).chain(no_rate_at_radius(figures)).collect()
}

/// The warnings about the UAVs of a kind, with its name.
fn of_kind(kind: &KindFigures) -> Vec<String> {
    let energy = kind.energy.as_ref();
    let of_energy = energy.map(|energy| [energy.warning(), energy.landing_warning(), energy.stranded_warning()]);
    let found = of_energy.into_iter().flatten().chain([kind.motion.warning()]).flatten();
    found.map(|text| format!("{}: {text}", kind.name)).collect()
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
    let visits = if load.visits == 1 { "1 visit".to_owned() } else { format!("{} visits", load.visits) };
    Some(format!(
        "the load is {percent} of what {visits} can collect ({offered} of {carried} per slot, limited by the {limit}): \
         once buffers are full, every strategy loses data"
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
            "no buffer overflows within the mission, even if no sensor node is served: no strategy loses data; use \
             more slots"
        }
        None => {
            "no sensor node samples: no strategy loses data; planner.objective = \"collect\" lets horizon and offline \
             plan for what is delivered"
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

/// Mean distance to the nearest SN, relative to `d_c`, from which on the paper's values were hardly meant.
const SPARSE: f64 = 10.0;

/// Radio, speed or slots are the paper's, but the mean distance to the nearest SN is more than 10 d_c.
fn paper_values(scenario: &Scenario, figures: &Figures) -> Option<String> {
    let neighbour_m = figures.neighbour_m.filter(|neighbour_m| *neighbour_m > SPARSE * figures.comm_radius_m)?;
    let letter = Scenario::letter(Overrides::default()).expect("the built-in scenario is valid");
    let LinkBudget { comm_s, resource_blocks, .. } = scenario.link;
    let is_radio = scenario.link == LinkBudget { comm_s, resource_blocks, ..letter.link };
    let is_speed = scenario.uav.max_speed_mps == letter.uav.max_speed_mps && scenario.uav.acceleration_mps2.is_none();
    let is_slot = scenario.slot_s == letter.slot_s;
    let parts = [(is_radio, "radio"), (is_speed, "speed"), (is_slot, "slots")];
    let parts: Vec<&str> = parts.into_iter().filter(|(is_papers, _)| *is_papers).map(|(_, part)| part).collect();
    (!parts.is_empty()).then(|| {
        format!(
            "the paper's values ({}) are for a dense field of 100 m, and here the nearest sensor node is {} away on \
             average, with d_c = {}: name yours by link.preset and uav.preset, or skysink new --radio --drone",
            parts.join(", "),
            scaled(neighbour_m, "m"),
            scaled(figures.comm_radius_m, "m")
        )
    })
}

/// Reach from which on a slot moves a UAV [m].
const LEAST_REACH_M: f64 = 1.0;

/// A slot reaches less than 1 m.
fn short_slot(scenario: &Scenario, figures: &Figures) -> Option<String> {
    (figures.reach_m < LEAST_REACH_M).then(|| {
        format!(
            "a slot reaches {}: slots of {} reach as far as d_c",
            scaled(figures.reach_m, "m"),
            scaled(scenario.leg_s(figures.comm_radius_m).ceil(), "s")
        )
    })
}

/// No flight serves every SN in the mission, though each can be reached.
fn too_few_slots(figures: &Figures) -> Option<String> {
    let least_slots = figures.round.least_slots.filter(|&least_slots| least_slots > figures.slots)?;
    (figures.unreachable == 0).then(|| {
        format!(
            "no flight serves every sensor node: that takes {least_slots} slots or more, and the mission has {}",
            figures.slots
        )
    })
}

/// The communication radius is larger than the range of the radio.
fn no_rate_at_radius(figures: &Figures) -> Option<String> {
    (figures.rim.visit_bits[1] == 0 && figures.above.visit_bits[1] > 0).then(|| {
        format!(
            "no link carries a bit at distance d_c, {}: use the range of the radio as link.comm_radius_m",
            scaled(figures.comm_radius_m, "m")
        )
    })
}
