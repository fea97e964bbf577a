//! Lower bounds on the loss of any flight of a mission, in whole bits, and of any plan of the look-ahead.
//!
//! | module | contents |
//! |---|---|
//! | [`field_bits`] | the sensor nodes as the bounds of a mission see them |
//! | [`visits`] | bound by the sensor nodes that cannot be served in time |
//! | [`paths`] | upper bound on the sensor nodes served in some slots, by the lengths of paths |
//! | [`collect`] | bound on what is delivered, and when, by the same links |
//! | [`throughput`] | bound by the bits that [`links`] carry at most |
//! | [`window`] | bound within the model of the look-ahead, with real-valued queues and expected rates |

pub mod collect;
pub mod field_bits;
pub mod links;
mod margins;
pub mod paths;
pub mod throughput;
pub mod visits;
pub mod window;

use std::sync::Arc;

use skysink_common::channel::ChannelModel;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::Sensors;
use skysink_common::sensors::grid::Grid;

use crate::gap_costs::GapCosts;
use crate::keys::ObjectiveWeights;
use crate::mission_table::MissionTable;
use collect::Offer;
use field_bits::FieldBits;
use links::BestLinks;
use paths::PathBound;

/// Lower bounds on the loss of a mission.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MissionBound {
    /// Lower bound on the loss of every flight [bit], even with knowledge of all draws of the channel.
    pub loss_bits: u64,
    /// For a random channel: lower bound on the mean loss over its draws [bit], without knowledge of future draws.
    pub expected_loss_bits: Option<f64>,
}

/// The bounds of a mission with the queues `queues_bits` [bit] before slot 1, by id.
///
/// `known_bits` is the loss of some flight of this mission, or [`u64::MAX`]. It does not affect the result: no bound
/// exceeds it, so once one bound reaches it the others are not computed.
#[must_use]
pub fn mission_bound(scenario: &Scenario, sensors: &Sensors, queues_bits: &[u32], known_bits: u64) -> MissionBound {
    let field = FieldBits::new(scenario, sensors, queues_bits);
    let beyond_bits = field.beyond_buffers_bits;
    let known_bits = known_bits.saturating_sub(beyond_bits);
    let links = BestLinks::new(scenario, sensors);
    let carried_bits = throughput::by_throughput(&field, |slot, sensor| links.best_bits(slot, sensor));
    let expected_bits = links
        .channel
        .is_random()
        .then(|| throughput::by_expected_throughput(&field, links.expected_bits(field.capacity_bits())));
    // The bound by visits is at most `known_bits`, so it cannot raise bounds that have reached it.
    let lower_bits = expected_bits.map_or(carried_bits, |bits| carried_bits.min(bits as u64));
    let visits_bits =
        if lower_bits < known_bits { by_blocks_and_paths(scenario, &field, sensors, known_bits) } else { 0 };
    MissionBound {
        loss_bits: beyond_bits + carried_bits.max(visits_bits),
        expected_loss_bits: expected_bits.map(|bits| beyond_bits as f64 + bits.max(visits_bits as f64)),
    }
}

/// Bounds on what every flight of a mission delivers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CollectBound {
    /// Lower bound on what is not delivered, lost or left [bit], by the factors of the weights.
    pub undelivered_bits: f64,
    /// Upper bound on the fraction of all data that is delivered; NaN without data.
    pub delivered_fraction: f64,
    /// Lower bound on the slots after which all data is delivered; `None` if it never is, or sensor nodes sample.
    pub least_slots: Option<u64>,
}

/// The bounds on what is delivered in a mission with the queues `queues_bits` [bit] before slot 1, by id.
#[must_use]
pub fn collect_bound(scenario: &Scenario, sensors: &Sensors, queues_bits: &[u32]) -> CollectBound {
    let has_data = |id: &u32| queues_bits[*id as usize] > 0 || sensors.sampler(*id).mean_bits > 0.0;
    let ids: Vec<u32> = sensors.ids().filter(has_data).collect();
    let field = FieldBits::over(scenario, sensors, queues_bits, ids.iter().copied());
    let links = BestLinks::over(scenario, sensors, ids.iter().copied());
    let offer = Offer { field: &field, link_bits: |slot, sensor| links.best_bits(slot, sensor) };
    let data_bits = |index: usize| offer.data_bits(&field.sensors[index]) as f64;
    let total_bits: f64 = (0..ids.len()).map(data_bits).sum();
    let delivered_bits = offer.delivered_bits(|_| 1.0);
    let left_bits = (total_bits - delivered_bits).ceil(); // whole bits
    let is_sampled = sensors.sampling_ids().next().is_some();
    let undelivered_bits = if sensors.weights.are_equal() {
        left_bits
    } else {
        let factor = |index: usize| sensors.weights.factor(ids[index] as usize);
        let weighted_bits: f64 = (0..ids.len()).map(|index| factor(index) * data_bits(index)).sum();
        weighted_bits - offer.delivered_bits(factor)
    };
    CollectBound {
        undelivered_bits: undelivered_bits.max(0.0),
        delivered_fraction: (total_bits - left_bits) / total_bits,
        least_slots: offer.least_slots().filter(|_| left_bits == 0.0 && !is_sampled),
    }
}

/// Lower bound on the costs of every flight by `objective`, for weights of equal or differing sensor nodes (decision
/// D36), where no flight loses less than `loss_bits` [bit]. A lost bit costs at least as much as one of the sensor node
/// of the least weight.
#[must_use]
pub fn cost_bound(scenario: &Scenario, sensors: &Sensors, objective: &ObjectiveWeights, loss_bits: u64) -> f64 {
    let factor = |id: u32| sensors.weights.factor(id as usize);
    let of_loss = objective.of_bits() * least_weight(sensors) * loss_bits as f64;
    let costs = GapCosts::new(objective, scenario.slot_s, scenario.deadline_slots());
    if costs.is_by_bits() {
        return of_loss;
    }
    let paths = PathBound::new(&bounding_table(scenario, Arc::new(sensors.clone())));
    let most = |slots: u64| paths.most(slots).saturating_mul(scenario.uav.uavs());
    of_loss + costs.least_of_ages(sensors.ids().map(factor).collect(), scenario.slots, most)
}

/// The least factor by which a lost bit counts; 0 if no sensor node samples.
#[must_use]
pub fn least_weight(sensors: &Sensors) -> f64 {
    let factors = sensors.sampling_ids().map(|id| sensors.weights.factor(id as usize));
    factors.reduce(f64::min).unwrap_or(0.0)
}

/// The bound by visits [bit]: by the resource blocks and, unless this reaches `known_bits`, by paths.
fn by_blocks_and_paths(scenario: &Scenario, field: &FieldBits, sensors: &Sensors, known_bits: u64) -> u64 {
    let by_blocks =
        visits::by_visits(field, |slots| usize::try_from(slots).unwrap_or(usize::MAX).saturating_mul(field.blocks));
    if by_blocks >= known_bits {
        return by_blocks;
    }
    let ids: Vec<u32> = sensors.sampling_ids().collect();
    let sampling = sensors.subset(&ids, |positions| Grid::new(positions, scenario.link.comm_radius_m));
    let paths = PathBound::new(&bounding_table(scenario, Arc::new(sampling)));
    let uavs = scenario.uav.uavs();
    by_blocks.max(visits::by_visits(field, |slots| paths.most(slots).saturating_mul(uavs)))
}

/// The table of a mission for bounds on paths: its UAV flies as far in a slot, and serves as many sensor nodes, as any.
#[must_use]
pub fn bounding_table(scenario: &Scenario, sensors: Arc<Sensors>) -> MissionTable {
    let mut table = MissionTable::new(scenario, sensors);
    for kind in scenario.kinds() {
        table.farthest_m = table.farthest_m.max(kind.farthest_m());
        table.limits.resource_blocks = table.limits.resource_blocks.max(kind.link.resource_blocks as u32);
    }
    table
}
