//! What a plan costs: the sum over sensors of what each gap between two visits costs; the end of the window ends the
//! last gap.

use std::fmt::Debug;

use super::sensor::SensorModel;

/// States that differ by less [slots] are equal up to rounding.
pub(super) const EQUAL_SLOTS: f64 = 1e-9;

/// An objective of plans. Costs are in units of its own, of each sensor, times the sensor's price.
pub trait Objective: Debug + Clone + Copy + PartialEq + 'static {
    /// The state of a buffer.
    type Level: Debug + Clone + Copy + PartialEq;

    /// The style of its plans: what asks it says what a style has to answer.
    type Style;

    /// Whether ages of service count: then all sensors do, also those that sample nothing.
    const COUNTS_AGES: bool = false;

    /// The buffer of `sensor` before slot 1 of the window, with `queue_bits` [bit], `age_slots` after its last service.
    fn begin(sensor: &SensorModel, queue_bits: f64, age_slots: f64) -> Self::Level;

    /// The buffer after another UAV has taken `bits` [bit] in `slot`, where its visits are not flown through.
    fn leave(sensor: &SensorModel, level: Self::Level, slot: f64, bits: f64) -> Self::Level {
        let _ = (sensor, slot, bits);
        level
    }

    /// Cost of a unit.
    fn price(sensor: &SensorModel) -> f64;

    /// What a visit takes at most, of `bits` [bit] that the link carries, in the unit of [`Self::visit`].
    fn capacity(sensor: &SensorModel, bits: f64) -> f64;

    /// A visit at the end of `slot`: what the gap before it costs, and the buffer after it.
    fn visit(sensor: &SensorModel, level: Self::Level, slot: f64, capacity: f64) -> (f64, Self::Level);

    /// Bits [bit] of a visit that costs `units`, for other UAVs.
    fn visit_bits(sensor: &SensorModel, units: f64, capacity: f64) -> f64;

    /// What the last gap costs, up to the end of the slot `end`.
    fn rest(sensor: &SensorModel, level: Self::Level, end: f64) -> f64;

    /// What the `slots` slots after the window, which ends with `end`, are expected to cost.
    fn beyond(sensor: &SensorModel, level: Self::Level, end: f64, round_slots: f64, slots: f64) -> f64 {
        let _ = (sensor, level, end, round_slots, slots);
        0.0
    }

    /// By how much a visit at the end of `slot` costs more for each slot later, if that is the same for all visits up
    /// to `within` slots earlier or later, and the buffers after them, too, each at its time; `None` if it may not be.
    fn slope(sensor: &SensorModel, level: Self::Level, slot: f64, capacity: f64, within: f64) -> Option<f64> {
        let _ = (sensor, level, slot, capacity, within);
        None
    }

    /// What a visit at the end of `slot` saves, for a next one within `round_slots`, and of equals what is least.
    fn saving(sensor: &SensorModel, level: Self::Level, slot: f64, capacity: f64, round_slots: f64) -> (f64, f64);

    /// Since when a buffer fills [slots].
    fn since(level: Self::Level) -> f64;

    /// The buffer of a plan that is `slots` slots later.
    fn later(level: Self::Level, slots: f64) -> Self::Level;

    /// Whether two buffers are the same, each at its time.
    fn agree(sensor: &SensorModel, now: &Reached<Self::Level>, then: &Reached<Self::Level>) -> bool;

    /// The queue at the beginning of `slot` [bit], where plans hover.
    fn queue_bits(sensor: &SensorModel, level: Self::Level, slot: f64) -> f64 {
        let _ = (sensor, level, slot);
        0.0
    }

    /// What each slot in the air costs, over a window of `slots` slots that begins with these buffers.
    fn slot_cost(sensors: &[SensorModel], levels: &[Self::Level], slots: i32) -> f64 {
        let _ = (sensors, levels, slots);
        0.0
    }

    /// Lower bound on the cost of every plan of one UAV over such a window, with so many resource blocks; of `Collect`
    /// the cost of a plan that delivers all data at the last moment, which ends a search.
    fn least(sensors: &[SensorModel], levels: &[Self::Level], slots: i32, blocks: usize) -> f64;
}

/// A buffer at some time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reached<L> {
    /// The slot that has ended.
    pub slot: f64,
    /// The buffer.
    pub level: L,
}
