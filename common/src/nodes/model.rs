//! What a property of the sensor nodes (SNs) is: how it changes answers, services, storage and the end of a slot.
//!
//! The properties are files beside this one, and variants of [`NodeFeature`](super::NodeFeature).

use std::ops::Range;

use enum_dispatch::enum_dispatch;
use serde::{Deserialize, Serialize};
use strum::{FromRepr, IntoStaticStr};

use crate::checkpoint::CheckpointError;
use crate::geometry::Position;
use crate::per_sensor::PerSensor;
use crate::sampling::Sampling;

/// What an SN does when a UAV serves it in the next slot, by its number in messages. Of several features the last of
/// these counts.
#[derive(
    Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, FromRepr, IntoStaticStr, Serialize, Deserialize,
)]
#[strum(serialize_all = "lowercase")]
#[repr(u8)]
pub enum Answer {
    /// It sends its queue.
    #[default]
    Queue,
    /// It sends nothing, but will later.
    Silent,
    /// It sends nothing any more.
    Dead,
}

impl Answer {
    /// Whether it sends its queue.
    #[inline]
    #[must_use]
    pub fn sends(self) -> bool {
        self == Self::Queue
    }
}

/// A service of an SN that has answered.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NodeService {
    /// The slot.
    pub slot: u64,
    /// The SN.
    pub sensor: usize,
    /// Bits that it has sent, at most its queue [bit].
    pub bits: u64,
    /// Rate of the link [bit/s].
    pub rate_bps: f64,
}

/// A slot after its services.
#[derive(Debug, Clone, Copy)]
pub struct SlotEnd<'a> {
    /// The slot.
    pub slot: u64,
    /// The sampling that has filled the queues; buffers of dead SNs are 0.
    pub sampling: &'a Sampling,
    /// The queues [bit], by id.
    pub queues_bits: &'a [u32],
    /// Where the UAVs are that wake SNs in range.
    pub uavs: &'a [Position],
}

impl SlotEnd<'_> {
    /// Whether SN `sensor` was dead before the slot. One whose battery was emptied by a service of the slot was not.
    #[inline]
    pub fn was_dead(&self, sensor: usize) -> bool {
        self.sampling.capacity_bits.of(sensor) == 0
    }
}

/// A property of the SNs of a field. Each method answers by default as if it was not there.
#[enum_dispatch]
pub trait NodeModel {
    /// What SN `sensor` does when it is served in the next slot.
    fn answer(&self, _sensor: usize) -> Answer {
        Answer::Queue
    }

    /// Raises the `answers` of all SNs, by id, to those of this feature.
    fn raise(&self, answers: &mut [Answer]) {
        if self.may_refuse() {
            for (sensor, answer) in answers.iter_mut().enumerate() {
                *answer = (*answer).max(self.answer(sensor));
            }
        }
    }

    /// Whether an SN may give another answer than its queue.
    fn may_refuse(&self) -> bool {
        false
    }

    /// SN `sensor` was served, and has not answered because of this feature.
    fn refuse(&mut self, _sensor: usize) {}

    /// Bits that SN `sensor` may send in the next slot at `rate_bps` [bit/s].
    fn most_bits(&self, _sensor: usize, _rate_bps: f64) -> u64 {
        u64::MAX
    }

    /// An SN was served.
    fn serve(&mut self, _service: &NodeService) {}

    /// Whether this feature stores bits in the place of the ledger ([`Self::store`]). At most one of a mission does.
    fn stores(&self) -> bool {
        false
    }

    /// Each of the consecutive `sensors` samples `sampled_bits` in `slot`, and loses what it cannot store in its
    /// buffer. Their queues are `queues_bits` [bit]. Returns the lost bits; `None` if the feature does not store.
    fn store(
        &mut self,
        _slot: u64,
        _sensors: Range<usize>,
        _sampled_bits: &[u64],
        _queues_bits: &mut [u32],
        _capacities_bits: &PerSensor<u32>,
    ) -> Option<u64> {
        None
    }

    /// SN `sensor` has uploaded `bits` [bit], at most its queue.
    fn upload(&mut self, _sensor: usize, _bits: u32) {}

    /// SN `sensor` has died with `bits` [bit] in its queue, which are lost.
    fn discard(&mut self, _sensor: usize, _bits: u32) {}

    /// Ends a slot after its services, and adds the SNs that die in it to `died`.
    fn end_slot(&mut self, _end: &SlotEnd<'_>, _died: &mut Vec<u32>) {}

    /// What SN `sensor` has left, from 0 to 1; `None` if nothing runs out.
    fn level(&self, _sensor: usize) -> Option<f64> {
        None
    }

    /// The slot that has sampled the last bit that SN `sensor` has uploaded, 0 before that; `None` if that is not
    /// stored.
    fn freshest_slot(&self, _sensor: usize) -> Option<u64> {
        None
    }

    /// Bytes that [`Self::save`] takes at most.
    fn most_bytes(&self) -> usize;

    /// Appends the state for a checkpoint.
    fn save(&self, bytes: &mut Vec<u8>);

    /// Restores the state that was saved at the beginning of `bytes`, after `slot` and with the queues `queues_bits`
    /// [bit], and moves `bytes` behind it.
    ///
    /// # Errors
    /// If the state is impossible; this feature may then be changed.
    fn restore(&mut self, slot: u64, queues_bits: &[u32], bytes: &mut &[u8]) -> Result<(), CheckpointError>;
}
