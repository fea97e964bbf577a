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
    /// Slots in which bits are stored, `D + 1`; infinite where they do not expire (decision D36).
    pub lasting_slots: f64,
}

impl Sampler {
    /// Slots in which its empty buffer fills, `B / (s_i τ)`; infinite or NaN for one that does not sample.
    #[inline]
    pub fn fill_slots(&self) -> f64 {
        f64::from(self.capacity_bits) / self.mean_bits
    }

    /// Slots after which it loses what it samples, left empty: its buffer is full, or its oldest bits expire,
    /// `C = min(B/(s_i τ), D + 1)`.
    pub fn lossless_slots(&self) -> f64 {
        self.fill_slots().min(self.lasting_slots)
    }

    /// Most bits that it stores between two services [bit]: its buffer, or what it samples before they expire.
    #[inline]
    pub fn stored_bits(&self) -> u32 {
        let may_expire = self.lasting_slots < f64::INFINITY; // without a division for most fields
        let expires = may_expire && self.mean_bits > 0.0 && self.lasting_slots < self.fill_slots();
        if expires { (self.mean_bits * self.lasting_slots).ceil() as u32 } else { self.capacity_bits }
    }
}

/// The sampling of all SNs of a field, and their buffers. Where the SNs are not all alike, methods panic if one is
/// unknown.
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
    /// Slots in which bits are stored; infinite where they do not expire.
    lasting_slots: f64,
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
        Self::of_buffers(mean_bits, self.capacity_bits.clone()).with_lasting_slots(self.lasting_slots)
    }

    fn of_buffers(mean_bits: Vec<f64>, capacity_bits: PerSensor<u32>) -> Self {
        let highest_mean_bits = mean_bits.iter().copied().fold(0.0, f64::max);
        Self {
            mean_bits: PerSensor::new(mean_bits),
            capacity_bits,
            highest_mean_bits,
            arrivals: None,
            lasting_slots: f64::INFINITY,
        }
    }

    /// The sampling with these arrivals, or with constant ones.
    #[must_use]
    pub fn with_arrivals(self, arrivals: Option<Arrivals>) -> Self {
        Self { arrivals: arrivals.map(Arc::new), ..self }
    }

    /// The sampling of bits that are stored in so many slots; infinite where they do not expire.
    #[must_use]
    pub fn with_lasting_slots(self, lasting_slots: f64) -> Self {
        Self { lasting_slots, ..self }
    }

    /// The sampling into these buffers.
    pub(crate) fn with_buffers(self, capacity_bits: PerSensor<u32>) -> Self {
        Self { capacity_bits, ..self }
    }

    /// Slots in which bits are stored; infinite where they do not expire.
    pub fn lasting_slots(&self) -> f64 {
        self.lasting_slots
    }

    /// Whether the arrivals are drawn; otherwise they are constant, and counted by [`crate::arrivals::sampled_bits`].
    pub fn is_drawn(&self) -> bool {
        self.arrivals.is_some()
    }

    /// The sampling of SN `sensor`.
    #[inline]
    pub fn of(&self, sensor: usize) -> Sampler {
        Sampler {
            mean_bits: self.mean_bits.of(sensor),
            capacity_bits: self.capacity_bits.of(sensor),
            lasting_slots: self.lasting_slots,
        }
    }

    /// The highest mean of an SN [bit per slot].
    pub fn highest_mean_bits(&self) -> f64 {
        self.highest_mean_bits
    }

    /// Bits sampled by SN `sensor` in `slot`, from 1.
    #[inline]
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
    #[inline]
    pub fn sampled_bits(&self, sensor: usize, slot: u64) -> u64 {
        match self.arrivals {
            None => sampled_bits(self.mean_bits.of(sensor), slot),
            Some(_) => (1..=slot).map(|slot| self.bits(sensor, slot)).sum(),
        }
    }

    /// Bits that SN `sensor` samples up to the end of `slot`, from an earlier `counted` slot and the bits up to its
    /// end. Takes time by the slots between.
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
    /// If the bit is not among them.
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
    #[inline]
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
    fn what_expires_counts_as_a_smaller_buffer() {
        // 2.5 bit a slot into 20 bit: full in 8 slots; with an age of at most 3 slots, 10 bit in 4 slots.
        let sampling = Sampling::new(vec![2.5, 0.0], vec![20, 20]);
        let figures = |sampling: &Sampling| (sampling.of(0).lossless_slots(), sampling.of(0).stored_bits());
        assert_eq!(figures(&sampling), (8.0, 20));
        assert_eq!(figures(&sampling.clone().with_lasting_slots(4.0)), (4.0, 10));
        assert_eq!(figures(&sampling.with_lasting_slots(91.0)), (8.0, 20));
    }

    #[test]
    fn each_sensor_node_has_its_own_rate_and_buffer() {
        let sampling = Sampling::new(vec![2.5, 7.0], vec![10, 20]);
        assert_eq!(sampling.of(1), Sampler { mean_bits: 7.0, capacity_bits: 20, lasting_slots: f64::INFINITY });
        assert_eq!((sampling.sampled_bits(0, 3), sampling.sampled_bits(1, 3)), (7, 21));
        let faster = sampling.with_means(vec![5.0, 5.0]);
        assert_eq!([0, 1].map(|sensor| faster.of(sensor).capacity_bits), [10, 20]);
        assert_eq!([0, 1].map(|sensor| faster.of(sensor).mean_bits), [5.0, 5.0]);
    }
}
