//! Loss that no flight of a mission avoids, in whole bits.
//!
//! [`visits`] counts the sensor nodes that cannot be served in time, with the paths of
//! [`path_bound`](crate::horizon::path_bound); [`throughput`] counts bits, with the best [`links`] that the channel
//! allows. What the search of the look-ahead takes for unavoidable in its own model is left to
//! [`crate::horizon::bound`].

pub mod field_bits;
pub mod links;
pub mod throughput;
pub mod visits;

use skysink_common::message::SensorNode;
use skysink_common::scenario::Scenario;

use crate::horizon::path_bound::PathBound;
use crate::sensor_table::SensorTable;
use field_bits::FieldBits;
use links::BestLinks;

/// Lower bounds on the loss of a mission.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MissionBound {
    /// Every flight of this mission loses at least this [bit], even one of somebody who knows every draw of the
    /// channel.
    pub loss_bits: u64,
    /// Where the channel is random: who does not know its draws in advance loses at least this on average over them
    /// [bit].
    pub expected_loss_bits: Option<f64>,
}

/// The bounds of a mission with the queues `queues_bits` [bit] before slot 1, by id.
///
/// `known_bits` is the loss of some flight of this mission, or [`u64::MAX`]. It changes no bound: no bound on every
/// flight is above it, so once one meets it the others need not be computed.
#[must_use]
pub fn mission_bound(
    scenario: &Scenario,
    sensors: &[SensorNode],
    queues_bits: &[u32],
    known_bits: u64,
) -> MissionBound {
    let (field, sampling) = FieldBits::new(scenario, sensors, queues_bits);
    let links = BestLinks::new(scenario, &sampling);
    let carried_bits = throughput::by_throughput(&field, |slot, sensor| links.best_bits(slot, sensor));
    let expected_bits = links
        .are_random()
        .then(|| throughput::by_expected_throughput(&field, links.expected_bits(field.capacity_bits())));
    // What counting visits gives is no more than what is known to be lost, so it raises neither from there on.
    let lower_bits = expected_bits.map_or(carried_bits, |bits| carried_bits.min(bits as u64));
    let visits_bits = if lower_bits < known_bits { by_visits(scenario, &field, &sampling, known_bits) } else { 0 };
    MissionBound {
        loss_bits: carried_bits.max(visits_bits),
        expected_loss_bits: expected_bits.map(|bits| bits.max(visits_bits as f64)),
    }
}

/// The loss [bit] by visits: by the resource blocks, and unless this meets `known_bits`, by paths.
fn by_visits(scenario: &Scenario, field: &FieldBits, sampling: &[(u32, SensorNode)], known_bits: u64) -> u64 {
    let by_blocks =
        visits::by_visits(field, |slots| usize::try_from(slots).unwrap_or(usize::MAX).saturating_mul(field.blocks));
    if by_blocks >= known_bits {
        return by_blocks;
    }
    let nodes: Vec<SensorNode> = sampling.iter().map(|&(_, node)| node).collect();
    let paths = PathBound::new(&SensorTable::new(scenario, &nodes));
    by_blocks.max(visits::by_visits(field, |slots| paths.most(slots)))
}
