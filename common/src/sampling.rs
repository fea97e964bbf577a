//! What the sensor nodes (SNs) of a field sample in a slot, and how much they store.

use std::ops::Range;
use std::sync::Arc;

use crate::arrivals::{Arrivals, DrawnArrivals, bits_between, is_quick, sampled_bits, slot_of_bit};
use crate::per_sensor::PerSensor;

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
    /// The arrivals; `None` if they are constant, or only their means are known.
    arrivals: Option<Arc<Arrivals>>,
}

impl Sampling {
    /// The sampling of SNs that sample `mean_bits` [bit] per slot, at least 0, into buffers of `capacity_bits` [bit],
    /// both by id.
    #[must_use]
    pub fn new(mean_bits: Vec<f64>, capacity_bits: Vec<u32>) -> Self {
        Self::of_buffers(mean_bits, PerSensor::new(capacity_bits))
    }

    /// The sampling with these means [bit], by id, and the same buffers.
    #[must_use]
    pub fn with_means(&self, mean_bits: Vec<f64>) -> Self {
        Self::of_buffers(mean_bits, self.capacity_bits.clone())
    }

    fn of_buffers(mean_bits: Vec<f64>, capacity_bits: PerSensor<u32>) -> Self {
        let highest_mean_bits = mean_bits.iter().copied().fold(0.0, f64::max);
        Self { mean_bits: PerSensor::new(mean_bits), capacity_bits, highest_mean_bits, arrivals: None }
    }

    /// The sampling with these arrivals, or with constant ones.
    #[must_use]
    pub fn with_arrivals(self, arrivals: Option<Arrivals>) -> Self {
        Self { arrivals: arrivals.map(Arc::new), ..self }
    }

    /// Whether the arrivals are drawn; otherwise they are constant, and counted by [`crate::arrivals::sampled_bits`].
    #[must_use]
    pub fn is_drawn(&self) -> bool {
        self.arrivals.is_some()
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

    /// Bits sampled by SN `sensor` in `slot`, from 1.
    ///
    /// # Panics
    /// As [`Self::of`].
    #[inline]
    #[must_use]
    pub fn bits(&self, sensor: usize, slot: u64) -> u64 {
        let mean_bits = self.mean_bits.of(sensor);
        match &self.arrivals {
            None => bits_between(mean_bits, slot - 1, slot),
            Some(arrivals) => arrivals.bits(slot, sensor as u32, mean_bits), // a scenario has at most 10^7 SNs
        }
    }

    /// Writes the bits that each of the consecutive `sensors` samples in `slot`, from 1.
    pub(crate) fn fill(&self, slot: u64, sensors: Range<usize>, bits: &mut [u64]) {
        match &self.arrivals {
            None => bits.iter_mut().zip(sensors).for_each(|(bits, sensor)| *bits = self.bits(sensor, slot)),
            Some(arrivals) => arrivals.fill(slot, sensors, &self.mean_bits, bits),
        }
    }

    /// Bits sampled by SN `sensor` up to the end of `slot`. Takes time by the slot if arrivals are drawn.
    ///
    /// # Panics
    /// As [`Self::of`].
    #[inline]
    #[must_use]
    pub fn sampled_bits(&self, sensor: usize, slot: u64) -> u64 {
        match self.arrivals {
            None => sampled_bits(self.mean_bits.of(sensor), slot),
            Some(_) => (1..=slot).map(|slot| self.bits(sensor, slot)).sum(),
        }
    }

    /// Bits that SN `sensor` samples up to the end of `slot`, from an earlier `counted` slot and the bits up to its
    /// end. Takes time by the slots between.
    ///
    /// # Panics
    /// As [`Self::of`].
    #[must_use]
    pub fn counted_bits(&self, sensor: usize, counted: [u64; 2], slot: u64) -> u64 {
        let [from, before_bits] = counted;
        match self.arrivals {
            None => self.sampled_bits(sensor, slot),
            Some(_) => before_bits + (from + 1..=slot).map(|slot| self.bits(sensor, slot)).sum::<u64>(),
        }
    }

    /// The slot in which bit number `bit` (from 1) of SN `sensor` is sampled. By the end of slot `counted[0]`, not
    /// before it, `counted[1]` bits are sampled.
    ///
    /// # Panics
    /// As [`Self::of`], and if the bit is not among them.
    #[must_use]
    pub fn slot_of_bit(&self, sensor: usize, bit: u64, counted: [u64; 2]) -> u64 {
        let [mut slot, mut sampled_bits] = counted;
        if self.arrivals.is_none() {
            return slot_of_bit(self.mean_bits.of(sensor), bit, slot);
        }
        assert!(sampled_bits >= bit, "expected a bit that is sampled up to slot {slot}");
        loop {
            sampled_bits -= self.bits(sensor, slot);
            if sampled_bits < bit {
                return slot;
            }
            slot -= 1;
        }
    }

    /// Bits that SN `sensor` loses in `slot`, from 1, if its queue before it was `queue_bits` [bit].
    ///
    /// # Panics
    /// As [`Self::of`].
    #[inline]
    #[must_use]
    pub fn overflow_bits(&self, sensor: usize, queue_bits: u32, slot: u64) -> u64 {
        (u64::from(queue_bits) + self.bits(sensor, slot)).saturating_sub(self.capacity_bits.of(sensor).into())
    }

    /// Whether [`quick_bits`](crate::arrivals::quick_bits) counts the bits that any SN has sampled up to the end of
    /// `slot`.
    pub(crate) fn is_quick(&self, slot: u64) -> bool {
        is_quick(self.highest_mean_bits, slot)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
