//! Warnings about radios, speeds and slots that do not fit the field.

use skysink_common::channel::LinkBudget;
use skysink_common::scenario::{Overrides, Scenario};

use super::figures::Figures;
use super::quantity::scaled;

/// Mean distance to the nearest SN, relative to `d_c`, from which on the paper's values were hardly meant.
const SPARSE: f64 = 10.0;

/// Reach from which on a slot moves a UAV [m].
const LEAST_REACH_M: f64 = 1.0;

/// The warnings for `scenario` with these figures, one line each.
pub fn of(scenario: &Scenario, figures: &Figures) -> Vec<String> {
    [paper_values(scenario, figures), short_slot(scenario, figures), too_few_slots(figures), no_rate_at_radius(figures)]
        .into_iter()
        .flatten()
        .collect()
}

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
