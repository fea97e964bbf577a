//! The objective of most data delivered.

use super::hovering::Hovering;
use super::objective::{Objective, Reached};
use super::sensor::SensorModel;

/// What a slot in the air costs, as a fraction of all data: of plans that deliver the same the shortest is best.
const SLOT_COST: f64 = 1e-6;

/// The data that is delivered by the end of the window, weighted [bit], less a little for every slot in the air; costs
/// are negative. Units are bits. Plans that hover are flown anew after a change: their buffers are not compared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Collect;

/// The queue of a sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct QueueLevel {
    /// At the end of `slot` [bit], without what was sampled in it.
    bits: f64,
    slot: f64,
}

impl Objective for Collect {
    type Level = QueueLevel;
    type Style = Hovering;

    fn begin(_: &SensorModel, queue_bits: f64, _: f64) -> QueueLevel {
        QueueLevel { bits: queue_bits, slot: 0.0 }
    }

    /// No more than there is now: the rest has not been sampled yet.
    fn leave(sensor: &SensorModel, level: QueueLevel, slot: f64, bits: f64) -> QueueLevel {
        let waited = (slot - 1.0 - level.slot).max(0.0);
        let there = (level.bits + waited * sensor.mean_bits).min(sensor.capacity_bits.max(level.bits));
        QueueLevel { bits: (there - bits).clamp(0.0, level.bits), slot: level.slot + waited }
    }

    #[inline]
    fn price(sensor: &SensorModel) -> f64 {
        sensor.weight
    }

    #[inline]
    fn capacity(_: &SensorModel, bits: f64) -> f64 {
        bits
    }

    #[inline]
    fn visit(sensor: &SensorModel, level: QueueLevel, slot: f64, capacity: f64) -> (f64, QueueLevel) {
        let there = Self::queue_bits(sensor, level, slot);
        let taken = there.min(capacity);
        (-taken, QueueLevel { bits: there - taken, slot: (slot - 1.0).max(level.slot) })
    }

    fn visit_bits(_: &SensorModel, units: f64, _: f64) -> f64 {
        -units
    }

    #[inline]
    fn rest(_: &SensorModel, _: QueueLevel, _: f64) -> f64 {
        0.0
    }

    #[inline]
    fn saving(sensor: &SensorModel, level: QueueLevel, slot: f64, capacity: f64, _: f64) -> (f64, f64) {
        (Self::queue_bits(sensor, level, slot).min(capacity) * sensor.weight, 0.0)
    }

    fn since(level: QueueLevel) -> f64 {
        level.slot
    }

    fn later(level: QueueLevel, slots: f64) -> QueueLevel {
        QueueLevel { slot: level.slot + slots, ..level }
    }

    fn agree(sensor: &SensorModel, now: &Reached<QueueLevel>, then: &Reached<QueueLevel>) -> bool {
        let [own, before] = [now, then].map(|reached| Self::queue_bits(sensor, reached.level, reached.slot + 1.0));
        own == before
    }

    #[inline]
    fn queue_bits(sensor: &SensorModel, level: QueueLevel, slot: f64) -> f64 {
        let slots = slot - 1.0 - level.slot;
        if slots <= 0.0 { level.bits } else { (level.bits + slots * sensor.mean_bits).min(sensor.capacity_bits) }
    }

    fn slot_cost(sensors: &[SensorModel], levels: &[QueueLevel], slots: i32) -> f64 {
        all_bits(sensors, levels, slots) * SLOT_COST
    }

    fn least(sensors: &[SensorModel], levels: &[QueueLevel], slots: i32, _: usize) -> f64 {
        -all_bits(sensors, levels, slots) * (1.0 - SLOT_COST * (f64::from(slots) + 1.0))
    }
}

/// All data that can be delivered in a window, weighted [bit].
fn all_bits(sensors: &[SensorModel], levels: &[QueueLevel], slots: i32) -> f64 {
    let left_bits = |(sensor, level): (&SensorModel, &QueueLevel)| {
        sensor.weight * (level.bits + (f64::from(slots) - level.slot).max(0.0) * sensor.mean_bits)
    };
    sensors.iter().zip(levels).map(left_bits).sum()
}
