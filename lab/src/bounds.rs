//! The bounds of a mission, as rates and costs.

use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_planner::bound::{MissionBound, cost_bound, mission_bound};
use skysink_planner::settings::{PlanningObjective, Settings};

/// Lower bounds of a mission (`docs/src/look-ahead.md`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MissionBounds {
    /// Of the loss rate η of every flight; 0 if nothing is sampled.
    pub loss_bound: f64,
    /// Of the mean loss rate over the draws of a random channel.
    pub expected_loss_bound: Option<f64>,
    /// Of the cost of every flight by an objective that is neither the loss nor what is collected.
    pub objective_bound: Option<f64>,
}

/// The bounds of a mission. `known_bits` is the loss of a known flight [bit].
#[must_use]
pub fn bounds(scenario: &Scenario, list: &SensorList, known_bits: u64) -> MissionBounds {
    let sensors = list.sensors_of(scenario);
    let MissionBound { loss_bits, expected_loss_bits } =
        mission_bound(scenario, &sensors, &list.queues_bits(), known_bits);
    let objective = Settings::of(scenario).ok().map(|settings| settings.objective);
    let weights = objective.filter(|objective| !objective.is_loss()).and_then(PlanningObjective::weights);
    MissionBounds {
        loss_bound: loss_rate(loss_bits as f64, scenario, list),
        expected_loss_bound: expected_loss_bits.map(|bits| loss_rate(bits, scenario, list)),
        objective_bound: weights.map(|weights| cost_bound(scenario, &sensors, &weights, loss_bits)),
    }
}

/// A loss [bit] as a fraction of the bits that the mission samples (decision D3); 0 if nothing is sampled.
pub(crate) fn loss_rate(lost_bits: f64, scenario: &Scenario, list: &SensorList) -> f64 {
    fraction(lost_bits, list.mission_bits(scenario))
}

/// A part of a whole; 0 of nothing.
pub(crate) fn fraction(lost_bits: f64, sampled_bits: f64) -> f64 {
    if sampled_bits > 0.0 { lost_bits / sampled_bits } else { 0.0 }
}
