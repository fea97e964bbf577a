//! The sensor nodes (SNs) of a mission.
//!
//! | module | contents |
//! |---|---|
//! | [`list`], `rows` | the list: drawn from the seed or read from a CSV file, and written back with all columns |
//! | [`grid`] | points by cell, for range queries |

pub mod grid;
pub mod link_places;
pub mod list;
mod rows;

use std::ops::Range;

pub use list::{Sensor, SensorList};
pub use rows::{check_name, columns};

use crate::arrivals::mean_bits;
use crate::geometry::Position;
use crate::limits::Limits;
use crate::message::SensorNode;
use crate::nodes::NodeTraits;
use crate::sampling::{Sampler, Sampling};
use crate::scenario::Scenario;
use crate::weights::Weights;
use grid::Grid;

/// The SNs of a mission, by id: where they are, how strong their links are, and how they fill their buffers.
///
/// [`SensorList`] is the same as a file, [`SensorNode`] as a message.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensors {
    /// Positions, `L_i`.
    pub positions: Vec<Position>,
    /// Spatial index of `positions`, in cells of the side `d_c`. Must be rebuilt if they change.
    pub grid: Grid,
    /// Reference channel gains at 1 m, `α_i`, as linear ratios.
    pub gains: Vec<f64>,
    /// Mean bits sampled per slot, and buffers.
    pub sampling: Sampling,
    /// Weights of their bits, `w_i` (decision D25).
    pub weights: Weights,
    /// Whether they may not answer (decision D33): their [answers](crate::nodes::Answer) are told beside their queues.
    pub may_refuse: bool,
}

impl Sensors {
    /// The SNs `nodes` of a mission with these `limits`.
    #[must_use]
    pub fn new(limits: &Limits, nodes: &[SensorNode]) -> Self {
        let positions: Vec<Position> = nodes.iter().map(|node| Position::new(node.x_m, node.y_m)).collect();
        let mean_bits = nodes.iter().map(|node| mean_bits(node.sampling_bps, limits.slot_s)).collect();
        let sampling = Sampling::new(mean_bits, nodes.iter().map(|node| node.capacity_bits).collect());
        Self {
            grid: Grid::new(&positions, limits.comm_radius_m),
            positions,
            gains: nodes.iter().map(|node| node.gain).collect(),
            weights: Weights::new(nodes.iter().map(|node| node.weight).collect(), &sampling),
            sampling,
            may_refuse: false,
        }
    }

    /// The SNs `nodes` of a scenario.
    #[must_use]
    pub fn of(scenario: &Scenario, nodes: &[SensorNode]) -> Self {
        let sensors = Self::new(&Limits::of(scenario), nodes);
        let NodeTraits { may_refuse, lasting_slots, .. } = scenario.node_traits();
        let sampling = sensors.sampling.with_lasting_slots(lasting_slots);
        Self { sampling, may_refuse, ..sensors }
    }

    /// The SNs with the given `ids`, which get the ids 0, 1, … in that order, and the `grid` of their positions.
    ///
    /// # Panics
    /// If an SN is unknown.
    #[must_use]
    pub fn subset(&self, ids: &[u32], grid: impl FnOnce(&[Position]) -> Grid) -> Self {
        let positions: Vec<Position> = ids.iter().map(|&id| *self.position(id)).collect();
        let samplers: Vec<Sampler> = ids.iter().map(|&id| self.sampler(id)).collect();
        Self {
            grid: grid(&positions),
            positions,
            gains: ids.iter().map(|&id| self.gains[id as usize]).collect(),
            weights: self.weights.subset(ids),
            sampling: Sampling::new(
                samplers.iter().map(|sampler| sampler.mean_bits).collect(),
                samplers.iter().map(|sampler| sampler.capacity_bits).collect(),
            )
            .with_lasting_slots(self.sampling.lasting_slots()),
            may_refuse: self.may_refuse,
        }
    }

    /// Number of SNs.
    pub fn count(&self) -> usize {
        self.positions.len()
    }

    /// The ids of all SNs, ascending.
    ///
    /// # Panics
    /// If there are more SNs than ids; a scenario has at most 10^7 SNs.
    pub fn ids(&self) -> Range<u32> {
        0..u32::try_from(self.count()).expect("a scenario has at most 10^7 sensor nodes")
    }

    /// Position of SN `id`.
    ///
    /// # Panics
    /// If the SN is unknown.
    #[inline]
    pub fn position(&self, id: u32) -> &Position {
        &self.positions[id as usize]
    }

    /// Mean bits per slot and buffer of SN `id`.
    ///
    /// # Panics
    /// As [`Sampling`].
    #[inline]
    pub fn sampler(&self, id: u32) -> Sampler {
        self.sampling.of(id as usize)
    }

    /// The ids of the SNs that sample, ascending.
    pub fn sampling_ids(&self) -> impl Iterator<Item = u32> {
        self.ids().filter(|&id| self.sampler(id).mean_bits > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Overrides;
    use std::path::Path;

    /// Three SNs at x = 1, 2 and 3 m, that sample 5, 0 and 7 bit/s in slots of half a second.
    fn sensors() -> Sensors {
        let scenario =
            Scenario::parse("name = 'a'\nslot_s = 0.5\n", Path::new("a.toml"), Overrides::default()).unwrap();
        let node = |(id, sampling_bps): (u32, f64)| SensorNode {
            x_m: f64::from(id),
            y_m: 9.0,
            gain: 1e-5 * f64::from(id),
            sampling_bps,
            capacity_bits: 10 * id,
            ..SensorNode::default()
        };
        Sensors::of(&scenario, &[(1, 5.0), (2, 0.0), (3, 7.0)].map(node))
    }

    #[test]
    fn rates_become_bits_per_slot() {
        let sensors = sensors();
        assert_eq!(sensors.sampler(2), Sampler { mean_bits: 3.5, capacity_bits: 30, lasting_slots: f64::INFINITY });
        assert_eq!((sensors.count(), sensors.ids()), (3, 0..3));
        assert_eq!((sensors.position(1), sensors.gains[1]), (&Position::new(2.0, 9.0), 2e-5));
        assert_eq!(sensors.sampling_ids().collect::<Vec<_>>(), [0, 2]);
    }

    #[test]
    fn a_subset_renumbers_the_same_sensor_nodes() {
        let subset = sensors().subset(&[2, 0], |positions| Grid::new(positions, 10.0));
        assert_eq!(subset.positions, [Position::new(3.0, 9.0), Position::new(1.0, 9.0)]);
        assert_eq!(subset.gains, [3.0 * 1e-5, 1e-5]);
        assert_eq!([0, 1].map(|id| subset.sampler(id).mean_bits), [3.5, 2.5]);
        assert_eq!([0, 1].map(|id| subset.sampler(id).capacity_bits), [30, 10]);
        assert_eq!(subset.grid.nearest(&Position::new(3.0, 9.0), 2), [0, 1]);
    }
}
