//! What a plan costs: the sum over sensors of what each gap between two visits costs; the end of the window ends the
//! last gap.

use std::fmt::Debug;

use super::hovering::Hovering;
use super::in_passing::InPassing;
use super::sensor::SensorModel;
use super::style::Style;
use crate::bound::window::{WindowField, WindowSensor};

/// States that differ by less [slots] are equal up to rounding.
pub(super) const ROUNDING: f64 = 1e-9;

/// What a slot in the air costs, as a fraction of all data: of plans that deliver the same the shortest is best.
const SLOT_COST: f64 = 1e-6;

/// An objective of plans. Costs are in units of its own, of each sensor, times the sensor's price.
pub trait Objective: Debug + Clone + Copy + PartialEq + 'static {
    /// The state of a buffer.
    type Level: Debug + Clone + Copy + PartialEq;

    /// The style of its plans.
    type Style: Style<Self>;

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

/// Expected loss [slots of sampling] of a sensor with `left` slots of room, until its next visit at a time that is
/// uniform within `until` slots: `max(0, until − left)²/(2 until)`.
#[inline]
#[must_use]
pub fn late_slots(left: f64, until: f64) -> f64 {
    let late = (until - left).max(0.0);
    late * late / (2.0 * until)
}

/// The bits that overflow, weighted [bit]. A level is `e_i`, the slot in which the buffer would have been empty: a
/// queue is `s_i τ (t − e_i)` after slot t if it did not overflow. Units are slots of sampling.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Loss;

impl Objective for Loss {
    type Level = f64;
    type Style = InPassing;

    #[inline]
    fn begin(sensor: &SensorModel, queue_bits: f64, _: f64) -> f64 {
        -queue_bits / sensor.mean_bits - sensor.overdue_slots
    }

    #[inline]
    fn price(sensor: &SensorModel) -> f64 {
        sensor.cost_bits
    }

    #[inline]
    fn capacity(sensor: &SensorModel, bits: f64) -> f64 {
        bits / sensor.mean_bits
    }

    #[inline]
    fn visit(sensor: &SensorModel, empty: f64, slot: f64, capacity: f64) -> (f64, f64) {
        let overflow_slots = sensor.overflow_slots(slot, empty);
        (overflow_slots, slot - ((slot - empty).min(sensor.fill_slots) - capacity).max(0.0))
    }

    fn visit_bits(sensor: &SensorModel, _: f64, capacity: f64) -> f64 {
        capacity * sensor.mean_bits
    }

    #[inline]
    fn rest(sensor: &SensorModel, empty: f64, end: f64) -> f64 {
        sensor.overflow_slots(end, empty)
    }

    fn beyond(sensor: &SensorModel, empty: f64, end: f64, round_slots: f64, slots: f64) -> f64 {
        let left = (sensor.fill_slots - (end - empty)).max(0.0);
        late_slots(left, round_slots).min(slots)
    }

    #[inline]
    fn slope(sensor: &SensorModel, empty: f64, slot: f64, capacity: f64, within: f64) -> Option<f64> {
        let gap = slot - empty;
        match gap - sensor.fill_slots {
            _ if !sensor.is_known() => None,
            late if late >= within => Some(1.0), // full, and left with the same
            late if late <= -within && capacity >= gap + within => Some(0.0), // emptied without a loss
            _ => None,
        }
    }

    /// The difference of [`late_slots`] with and without the visit. Of equals the buffer with the least room counts, at
    /// least 0: the planner of the next slot sees only that a queue is full, and has to make the same choice.
    #[inline]
    fn saving(sensor: &SensorModel, empty: f64, slot: f64, capacity: f64, round_slots: f64) -> (f64, f64) {
        let stored = (slot - empty).min(sensor.fill_slots);
        let rest = (stored - capacity).max(0.0);
        let late = |stored: f64| late_slots(sensor.fill_slots - stored, round_slots);
        ((late(stored) - late(rest)) * sensor.cost_bits, sensor.fill_slots - stored)
    }

    #[inline]
    fn since(empty: f64) -> f64 {
        empty
    }

    #[inline]
    fn later(empty: f64, slots: f64) -> f64 {
        empty + slots
    }

    #[inline]
    fn agree(sensor: &SensorModel, now: &Reached<f64>, then: &Reached<f64>) -> bool {
        let full = if sensor.is_known() { sensor.fill_slots } else { f64::INFINITY };
        let [own, before] = [now, then].map(|reached| (reached.slot - reached.level).min(full));
        let has_begun = sensor.initial_half_slots > 0.0 || sensor.left_slots > 0.0 || sensor.noise_slots2 > 0.0;
        // What is uncertain from before the window on counts from its beginning, not from a visit.
        let are_apart = now.slot != then.slot && now.level <= 0.0 || (now.level <= 0.0) != (then.level <= 0.0);
        !((own - before).abs() > ROUNDING || has_begun && are_apart)
    }

    fn least(sensors: &[SensorModel], levels: &[f64], slots: i32, blocks: usize) -> f64 {
        let sensor = |(sensor, empty): (&SensorModel, &f64)| WindowSensor {
            fill_slots: sensor.fill_slots,
            mean_bits: sensor.cost_bits,
            empty: *empty,
            capacity_slots: Self::capacity(sensor, sensor.best_bits),
        };
        let sensors = sensors.iter().zip(levels).map(sensor).collect();
        WindowField { sensors, slots, blocks }.least_loss_bits()
    }
}

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
