//! What the sensor nodes (SNs) of a field sample in a slot, and how much they store.

use crate::arrivals::{is_quick, sampled_bits};

/// A property of the SNs of a field.
#[derive(Debug, Clone, PartialEq)]
pub enum PerSensor<T> {
    /// The same for all SNs.
    Equal(T),
    /// By id.
    Each(Vec<T>),
}

impl<T: Copy + PartialEq> PerSensor<T> {
    /// The property of SNs with these `values`, by id.
    #[must_use]
    pub fn new(values: Vec<T>) -> Self {
        match values[..] {
            [first, ..] if values.iter().all(|&value| value == first) => Self::Equal(first),
            _ => Self::Each(values),
        }
    }

    /// That of SN `sensor`.
    ///
    /// # Panics
    /// If the values differ, and the SN is unknown.
    #[inline]
    #[must_use]
    pub fn of(&self, sensor: usize) -> T {
        match self {
            Self::Equal(value) => *value,
            Self::Each(values) => values[sensor],
        }
    }
}

/// The sampling of an SN, and its buffer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampler {
    /// Mean bits sampled per slot, `s_i τ`, at least 0.
    pub mean_bits: f64,
    /// Its buffer, `B` [bit].
    pub capacity_bits: u32,
}

impl Sampler {
    /// Slots in which its empty buffer fills, `B / (s_i τ)`; infinite or NaN for one that does not sample.
    #[must_use]
    pub fn fill_slots(&self) -> f64 {
        f64::from(self.capacity_bits) / self.mean_bits
    }
}

/// The sampling of all SNs of a field, and their buffers.
#[derive(Debug, Clone, PartialEq)]
pub struct Sampling {
    /// Mean bits sampled per slot, `s_i τ`.
    pub(crate) mean_bits: PerSensor<f64>,
    /// Buffers, `B` [bit].
    pub(crate) capacity_bits: PerSensor<u32>,
    /// The highest mean.
    highest_mean_bits: f64,
}

impl Sampling {
    /// The sampling of SNs that sample `mean_bits` [bit] per slot, at least 0, into buffers of `capacity_bits` [bit],
    /// both by id.
    #[must_use]
    pub fn new(mean_bits: Vec<f64>, capacity_bits: Vec<u32>) -> Self {
        Self::of_buffers(mean_bits, PerSensor::new(capacity_bits))
    }

    /// The same buffers with other means [bit], by id.
    #[must_use]
    pub fn with_means(&self, mean_bits: Vec<f64>) -> Self {
        Self::of_buffers(mean_bits, self.capacity_bits.clone())
    }

    fn of_buffers(mean_bits: Vec<f64>, capacity_bits: PerSensor<u32>) -> Self {
        let highest_mean_bits = mean_bits.iter().copied().fold(0.0, f64::max);
        Self { mean_bits: PerSensor::new(mean_bits), capacity_bits, highest_mean_bits }
    }

    /// The sampling of SN `sensor`.
    ///
    /// # Panics
    /// If the SN is unknown; never where all SNs are alike.
    #[inline]
    #[must_use]
    pub fn of(&self, sensor: usize) -> Sampler {
        Sampler { mean_bits: self.mean_bits.of(sensor), capacity_bits: self.capacity_bits.of(sensor) }
    }

    /// The highest mean of an SN [bit per slot].
    #[must_use]
    pub fn highest_mean_bits(&self) -> f64 {
        self.highest_mean_bits
    }

    /// Bits sampled by SN `sensor` up to the end of `slot`.
    ///
    /// # Panics
    /// As [`Self::of`].
    #[inline]
    #[must_use]
    pub fn sampled_bits(&self, sensor: usize, slot: u64) -> u64 {
        sampled_bits(self.mean_bits.of(sensor), slot)
    }

    /// Whether [`quick_bits`](crate::arrivals::quick_bits) counts the bits that any SN has sampled up to the end of `slot`.
    pub(crate) fn is_quick(&self, slot: u64) -> bool {
        is_quick(self.highest_mean_bits, slot)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_values_are_recognised() {
        assert_eq!(PerSensor::new(vec![2.5; 3]), PerSensor::Equal(2.5));
        assert_eq!(PerSensor::new(vec![2.5, 2.5, 2.0]), PerSensor::Each(vec![2.5, 2.5, 2.0]));
    }

    #[test]
    fn each_sensor_node_has_its_own_rate_and_buffer() {
        let sampling = Sampling::new(vec![2.5, 7.0], vec![10, 20]);
        assert_eq!(sampling.of(1), Sampler { mean_bits: 7.0, capacity_bits: 20 });
        assert_eq!((sampling.sampled_bits(0, 3), sampling.sampled_bits(1, 3)), (7, 21));
        let faster = sampling.with_means(vec![5.0, 5.0]);
        assert_eq!([0, 1].map(|sensor| faster.of(sensor).capacity_bits), [10, 20]);
        assert_eq!([0, 1].map(|sensor| faster.of(sensor).mean_bits), [5.0, 5.0]);
    }
}
