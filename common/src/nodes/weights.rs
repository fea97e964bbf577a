//! The weights of the bits of sensor nodes (SNs), `w_i` (decision D25), and the values of their queues, `w_i B_i`.

use std::ops::RangeInclusive;

use crate::per_sensor::PerSensor;
use crate::sampling::Sampling;

/// Weights that a sensor list may have.
pub const WEIGHTS: RangeInclusive<f64> = 1e-6..=1e6;

/// The weights of all SNs of a field. Where they differ, methods panic if an SN is unknown.
///
/// Strategies that compare queues compare their *values*: `w_i B_i` in units of a power of two, rounded down to whole
/// numbers, so that the most valuable full buffer takes all 32 bits. A queue that is not empty has a value of at least
/// 1. Where all weights are equal, values are the queues themselves.
#[derive(Debug, Clone, PartialEq)]
pub struct Weights {
    weights: PerSensor<f64>,
    /// Values per weighted bit, a power of two.
    scale: f64,
}

impl Weights {
    /// The weights by id, above 0 and finite, of SNs with the buffers of `sampling`.
    #[must_use]
    pub fn new(weights: Vec<f64>, sampling: &Sampling) -> Self {
        let weighted_bits = |(id, weight): (usize, &f64)| weight * f64::from(sampling.of(id).capacity_bits);
        let most_bits = weights.iter().enumerate().map(weighted_bits).fold(1e-6, f64::max);
        let limit = f64::from(u32::MAX) + 1.0;
        let mut scale = 1.0;
        while most_bits * scale >= limit {
            scale /= 2.0;
        }
        while most_bits * scale < limit / 2.0 {
            scale *= 2.0;
        }
        Self { weights: PerSensor::new(weights), scale }
    }

    /// The weights of the SNs `ids`, which get the ids 0, 1, … in that order; values and factors stay the same.
    #[must_use]
    pub fn subset(&self, ids: &[u32]) -> Self {
        let weights = match &self.weights {
            PerSensor::Equal(weight) => PerSensor::Equal(*weight),
            PerSensor::Each(weights) => PerSensor::Each(ids.iter().map(|&id| weights[id as usize]).collect()),
        };
        Self { weights, scale: self.scale }
    }

    /// Whether all SNs have the same weight.
    pub fn are_equal(&self) -> bool {
        matches!(self.weights, PerSensor::Equal(_))
    }

    /// The weight of SN `id`, `w_i`.
    #[inline]
    pub fn of(&self, id: usize) -> f64 {
        self.weights.of(id)
    }

    /// The factor by which a loss of SN `id` counts where losses are compared: 1 where all weights are equal, whatever
    /// they are.
    #[inline]
    pub fn factor(&self, id: usize) -> f64 {
        match &self.weights {
            PerSensor::Equal(_) => 1.0,
            PerSensor::Each(weights) => weights[id],
        }
    }

    /// The value of `queue_bits` [bit] of SN `id`.
    #[inline]
    pub fn value(&self, id: u32, queue_bits: u32) -> u32 {
        match &self.weights {
            PerSensor::Equal(_) => queue_bits,
            PerSensor::Each(weights) => {
                ((f64::from(queue_bits) * weights[id as usize] * self.scale) as u32).max(queue_bits.min(1))
            }
        }
    }

    /// The values of the queues `queues_bits` [bit], by id; `room` is memory for them. Takes O(N) where weights differ,
    /// and no time where they are equal.
    #[inline]
    pub fn values<'a>(&self, queues_bits: &'a [u32], room: &'a mut Vec<u32>) -> &'a [u32] {
        if self.are_equal() {
            return queues_bits;
        }
        room.clear();
        room.extend((0..).zip(queues_bits).map(|(id, &queue_bits)| self.value(id, queue_bits)));
        room
    }

    /// `Σ w_i x_i` over numbers by id.
    pub fn sum(&self, numbers: impl Iterator<Item = f64>) -> f64 {
        numbers.enumerate().map(|(id, number)| self.of(id) * number).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weights(weights: &[f64], capacity_bits: u32) -> Weights {
        let count = weights.len();
        Weights::new(weights.to_vec(), &Sampling::new(vec![1.0; count], vec![capacity_bits; count]))
    }

    #[test]
    fn equal_weights_leave_queue_values_unchanged() {
        let weights = weights(&[7.5; 3], 30_000);
        let mut room = Vec::new();
        assert_eq!(weights.values(&[1, 2, 3], &mut room), [1, 2, 3]);
        assert_eq!((weights.value(2, 9), weights.factor(2), weights.of(2)), (9, 1.0, 7.5));
    }

    #[test]
    fn values_are_proportional_to_weight_and_queue() {
        // 4 · 1000 bit are below 2^12, so that a weighted bit counts 2^20.
        let weights = weights(&[0.5, 4.0], 1_000);
        let mut room = Vec::new();
        assert_eq!(weights.values(&[1_000, 1_000], &mut room), [500 << 20, 4_000 << 20]);
        assert_eq!([weights.value(0, 8), weights.value(1, 1), weights.value(1, 0)], [4 << 20, 4 << 20, 0]);
        assert_eq!(weights.sum([10.0, 100.0].into_iter()), 405.0);
    }

    #[test]
    fn a_nonempty_queue_has_a_positive_value_for_any_weights() {
        for [low, high] in [[1e-6, 1e6], [1.0, 1e6], [1e-6, 1e-5]] {
            for capacity_bits in [0, 1, 30_000, u32::MAX] {
                let weights = weights(&[low, high], capacity_bits);
                assert!(weights.value(0, 1) >= 1 && weights.value(0, 0) == 0, "{low} {high} {capacity_bits}");
                let full = weights.value(1, capacity_bits);
                assert!(capacity_bits == 0 || full >= 1 << 31, "{full} is not half of 2^32 or more");
            }
        }
    }
}
