//! What is probably not meant, told by the figures alone. Each rule was tried on missions where it holds and where it
//! does not; `tests/check.rs` repeats that.

use super::figures::Figures;
use super::quantity::{percent, scaled};
use super::verdict::LossFree;

/// Fraction of the SNs in the largest group below which the paper's search is trapped: at 0.98 `uts` loses about 1 % of
/// the data of the paper's field, at 0.9 about 8 %, at 0.55 30 % or more, and `tour` nothing.
const CONNECTED: f64 = 0.95;

/// What is said of a scenario with these figures, one line each.
#[must_use]
pub fn of(figures: &Figures) -> Vec<String> {
    let rules = [trapped, in_transit, slow_link, overloaded, unreachable, unserved];
    rules.into_iter().filter_map(|rule| rule(figures)).collect()
}

/// Algorithm 1 circles over SNs that it has just emptied, if there is always an anchor in reach (the last one served is
/// within `d_c`) and no chain of anchors leads on. Below `V τ = 2 d_c` `uts` may find none, and transit frees it.
fn trapped(figures: &Figures) -> Option<String> {
    let Figures { reach_m, comm_radius_m, sensors, .. } = *figures;
    let (step_m, formula, group) = match figures.strategy.as_str() {
        "uts" if reach_m >= 2.0 * comm_radius_m => (figures.anchor_radius_m, "V τ − d_c", figures.uts_group?),
        "uts-wide" => (reach_m + comm_radius_m, "V τ + d_c", figures.uts_wide_group?),
        _ => return None,
    };
    let is_split = (group as f64) < CONNECTED * sensors as f64;
    is_split.then(|| {
        let strategy = &figures.strategy;
        let step = scaled(step_m, "m");
        format!(
            "{strategy} is likely to be trapped: it looks for anchors within {step} ({formula}), and steps of that length \
             connect no more than {group} of the {sensors} sensor nodes: try horizon or tour"
        )
    })
}

/// With `V τ ≤ d_c` most sets that Algorithm 1 finds have no waypoint in reach.
fn in_transit(figures: &Figures) -> Option<String> {
    let Figures { reach_m, comm_radius_m, .. } = *figures;
    (figures.strategy == "uts" && reach_m <= comm_radius_m).then(|| {
        let reach = scaled(reach_m, "m");
        let radius = scaled(comm_radius_m, "m");
        format!(
            "uts will mostly fly in transit: its anchor radius V τ − d_c is not above 0 (V τ = {reach}, \
             d_c = {radius}): try uts-wide or horizon, or longer slots"
        )
    })
}

/// Even the strongest link does not empty a full buffer in a visit.
fn slow_link(figures: &Figures) -> Option<String> {
    let most = scaled(figures.above.visit_bits[1] as f64, "bit");
    match figures.above.visits[0] {
        Some(1) => None,
        Some(visits) => Some(format!(
            "the radio is slow: a visit carries {most} at best, so that a full buffer takes {visits} visits or more"
        )),
        None => Some("no link carries a single bit in a visit: nothing will be delivered".to_owned()),
    }
}

/// More is sampled than the radio takes.
fn overloaded(figures: &Figures) -> Option<String> {
    let load = &figures.load;
    let fraction = load.fraction.filter(|&fraction| fraction > 1.0)?;
    let [offered, carried] = [load.offered_bits, load.carried_bits].map(|bits| scaled(bits, "bit"));
    let percent = percent(fraction);
    let is_by_buffers = load.carried_bits < load.visits as f64 * figures.above.visit_bits[1] as f64;
    let limit = if is_by_buffers { "a full buffer" } else { "what the radio carries" };
    Some(format!(
        "the load is {percent} of what {} visits collect ({offered} a slot, {carried} at best, {limit} each): once \
         buffers are full, every strategy loses data",
        load.visits
    ))
}

/// SNs are too far away from the start for the length of the mission.
fn unreachable(figures: &Figures) -> Option<String> {
    let Figures { unreachable, sensors, slots, .. } = *figures;
    (unreachable > 0).then(|| {
        format!("{unreachable} of the {sensors} sensor nodes cannot be reached within the mission's {slots} slots")
    })
}

/// No strategy can lose anything.
fn unserved(figures: &Figures) -> Option<String> {
    (figures.loss_free == LossFree::Unserved).then(|| {
        "no buffer overflows within the mission, even if nobody is served: every strategy loses nothing; try more slots"
            .to_owned()
    })
}
