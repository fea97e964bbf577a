//! The sensor nodes as the bounds see them: those that sample, in whole bits, with the first slot of a possible service.

use skysink_common::arrivals::sampled_bits;
use skysink_common::geometry::{Position, distance_squared};
use skysink_common::message::SensorNode;
use skysink_common::scenario::Scenario;

use crate::horizon::path_bound::legs::fewest_slots;
use crate::sensor_table::SensorTable;

/// A sensor node (SN) that samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorBits {
    /// Mean bits sampled per slot, `s_i τ`, above 0.
    pub mean_bits: f64,
    /// Its buffer, `B` [bit].
    pub capacity_bits: u64,
    /// Its queue before slot 1 [bit].
    pub queue_bits: u64,
    /// The first slot at whose end the UAV can be in range, at least 1.
    pub first_slot: u64,
}

impl SensorBits {
    /// Overflow up to the end of `slot` [bit], if the SN is never served after the slot `emptied`, which left it empty; or
    /// never at all if that is `None`.
    #[inline]
    #[must_use]
    pub fn overflow_bits(&self, emptied: Option<u64>, slot: u64) -> u64 {
        let held_bits = match emptied {
            Some(emptied) => sampled_bits(self.mean_bits, slot) - sampled_bits(self.mean_bits, emptied.min(slot)),
            None => self.queue_bits + sampled_bits(self.mean_bits, slot),
        };
        held_bits.saturating_sub(self.capacity_bits)
    }

    /// Overflow in `slot` [bit], under the same assumption.
    #[inline]
    #[must_use]
    pub fn lost_bits(&self, emptied: Option<u64>, slot: u64) -> u64 {
        self.overflow_bits(emptied, slot) - self.overflow_bits(emptied, slot - 1)
    }
}

/// The SNs that sample, and the slots of the mission.
#[derive(Debug, Clone, PartialEq)]
pub struct FieldBits {
    /// The SNs.
    pub sensors: Vec<SensorBits>,
    /// Slots of the mission.
    pub slots: u64,
    /// Resource blocks, `n`.
    pub blocks: usize,
}

impl FieldBits {
    /// The field of a scenario with these SNs and queues [bit], by id, and the list of the SNs that sample, with their
    /// ids.
    #[must_use]
    pub fn new(scenario: &Scenario, sensors: &[SensorNode], queues_bits: &[u32]) -> (Self, Vec<(u32, SensorNode)>) {
        let table = SensorTable::new(scenario, &[]);
        let start = scenario.start().xy();
        let samples = |(_, node): &(u32, SensorNode)| node.sampling_bps * scenario.slot_s > 0.0;
        let sampling: Vec<(u32, SensorNode)> = (0..).zip(sensors.iter().copied()).filter(samples).collect();
        let bits = |&(id, node): &(u32, SensorNode)| {
            let away_m = distance_squared(&start, &Position::new(node.x_m, node.y_m)).sqrt();
            let slots = fewest_slots(&table, away_m - table.comm_radius_m * (1.0 + 1e-8));
            SensorBits {
                mean_bits: node.sampling_bps * scenario.slot_s,
                capacity_bits: node.capacity_bits.into(),
                queue_bits: queues_bits[id as usize].into(),
                first_slot: (slots as u64).max(1),
            }
        };
        let sensors = sampling.iter().map(bits).collect();
        (Self { sensors, slots: scenario.slots, blocks: scenario.link.resource_blocks }, sampling)
    }

    /// The largest buffer [bit].
    #[must_use]
    pub fn capacity_bits(&self) -> u64 {
        self.sensors.iter().map(|sensor| sensor.capacity_bits).max().unwrap_or(0)
    }
}
