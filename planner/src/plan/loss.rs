//! The objective of least loss: the bits that overflow.

use super::in_passing::InPassing;
use super::objective::{EQUAL_SLOTS, Objective, Reached};
use super::sensor::SensorModel;
use crate::bound::window::{WindowField, WindowSensor};

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
        !((own - before).abs() > EQUAL_SLOTS || has_begun && are_apart)
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
