//! The queue ledger: every bit of every sensor node (SN), accounted for exactly.
//!
//! `initial + sampled = delivered + lost + queued` holds as an equality of integers, for each SN and for the field. The
//! caller decides what arrives and what a link carries.

use std::iter::repeat;
use std::ops::Range;
use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
#[cfg(feature = "node")]
use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};

/// Bits of the whole field since the mission's start.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable, Serialize, Deserialize)]
#[cfg_attr(feature = "node", derive(ZeroCopySend), type_name("skysink.Totals.v1"))]
pub struct Totals {
    /// Queued before slot 1.
    pub initial_bits: u64,
    /// Sampled by the sensor nodes.
    pub sampled_bits: u64,
    /// Uploaded to the UAV.
    pub delivered_bits: u64,
    /// Lost to full buffers, `Σ D_i` (UTS eq. 8).
    pub lost_bits: u64,
    /// Queued now.
    pub queued_bits: u64,
    /// `Σ_t Σ_i D_i(t) / (s_i τ)`: the loss in slots of sampling, for the paper's loss rate. 0 in a [`Ledger`], which
    /// does not know the rates.
    #[serde(skip)]
    pub lost_slots: f64,
}

impl Totals {
    /// Whether every bit is accounted for.
    #[must_use]
    pub fn is_balanced(&self) -> bool {
        let sum = |bits: [u64; 3]| bits.into_iter().map(u128::from).sum::<u128>(); // received totals may be any numbers
        sum([self.initial_bits, self.sampled_bits, 0]) == sum([self.delivered_bits, self.lost_bits, self.queued_bits])
    }
}

/// Queue lengths `B_i` [bit] of all sensor nodes, and the totals.
#[derive(Debug, Clone, PartialEq)]
pub struct Ledger {
    capacity_bits: u32,
    initial_bits: Vec<u32>,
    /// Copied before a change if a caller holds a reference.
    queues_bits: Arc<Vec<u32>>,
    delivered_bits: Vec<u64>,
    totals: Totals,
}

impl Ledger {
    /// A ledger over the initial queues [bit], none of which exceeds `capacity_bits`.
    ///
    /// # Panics
    /// If a queue exceeds the buffer, which a sensor list rules out.
    #[must_use]
    pub fn new(capacity_bits: u32, queues_bits: Vec<u32>) -> Self {
        assert!(queues_bits.iter().all(|&queue| queue <= capacity_bits), "an initial queue exceeds the buffer");
        let queued_bits = queues_bits.iter().copied().map(u64::from).sum();
        let totals = Totals { initial_bits: queued_bits, queued_bits, ..Totals::default() };
        let delivered_bits = vec![0; queues_bits.len()];
        Self {
            capacity_bits,
            initial_bits: queues_bits.clone(),
            queues_bits: Arc::new(queues_bits),
            delivered_bits,
            totals,
        }
    }

    /// Restores the queues [bit] and the bits delivered so far, by sensor node, if sensor node i has sampled
    /// `sampled_bits(i)`. Returns false, and changes nothing, if the state is impossible.
    ///
    /// A state is possible if it has an entry for each sensor node, no queue exceeds the buffer, and no sensor node has
    /// delivered and still holds more bits than it had.
    #[must_use]
    pub fn restore(
        &mut self,
        queues_bits: &[u32],
        delivered_bits: &[u64],
        sampled_bits: impl Fn(usize) -> u64,
    ) -> bool {
        let count = self.initial_bits.len();
        if [queues_bits.len(), delivered_bits.len()] != [count; 2] {
            return false;
        }
        let lost_bits = |sensor: usize| {
            let had_bits = u64::from(self.initial_bits[sensor]) + sampled_bits(sensor);
            let left_bits = had_bits.checked_sub(delivered_bits[sensor])?.checked_sub(queues_bits[sensor].into())?;
            (queues_bits[sensor] <= self.capacity_bits).then_some(left_bits)
        };
        let Some(lost_bits) = (0..count).map(lost_bits).sum::<Option<u64>>() else { return false };
        let delivered = delivered_bits.iter().sum();
        let queued_bits = queues_bits.iter().copied().map(u64::from).sum();
        let sampled = delivered + lost_bits + queued_bits - self.totals.initial_bits;
        let totals = Totals { sampled_bits: sampled, delivered_bits: delivered, lost_bits, queued_bits, ..self.totals };
        self.totals = totals;
        Arc::make_mut(&mut self.queues_bits).copy_from_slice(queues_bits);
        self.delivered_bits.copy_from_slice(delivered_bits);
        true
    }

    /// Queue lengths [bit], by sensor node.
    #[must_use]
    pub fn queues_bits(&self) -> &[u32] {
        &self.queues_bits
    }

    /// A snapshot of the queue lengths [bit], by sensor node, without a copy. Later changes of the ledger do not affect
    /// it.
    #[must_use]
    pub fn shared_queues_bits(&self) -> Arc<Vec<u32>> {
        Arc::clone(&self.queues_bits)
    }

    /// Bits uploaded so far, by sensor node.
    #[must_use]
    pub fn delivered_bits(&self) -> &[u64] {
        &self.delivered_bits
    }

    /// Bits lost so far by each of the consecutive `sensors`, which have sampled `sampled_bits` so far: what they had
    /// and neither delivered nor hold.
    ///
    /// The ledger does not store them: eight more bytes per sensor node would double the time of a slot with 10^6 full
    /// sensor nodes (0.57 instead of 0.28 ms).
    ///
    /// # Panics
    /// If `sensors` reaches beyond the field.
    #[inline(always)]
    pub fn lost_bits(
        &self,
        sensors: Range<usize>,
        sampled_bits: impl Iterator<Item = u64>,
    ) -> impl Iterator<Item = u64> {
        let initial_bits = self.initial_bits[sensors.clone()].iter().zip(sampled_bits);
        let left_bits = self.delivered_bits[sensors.clone()].iter().zip(&self.queues_bits[sensors]);
        let had_bits = initial_bits.map(|(&initial_bits, sampled_bits)| u64::from(initial_bits) + sampled_bits);
        had_bits.zip(left_bits).map(|(had_bits, (delivered, &queue))| had_bits - delivered - u64::from(queue))
    }

    /// The field's totals.
    #[must_use]
    pub fn totals(&self) -> &Totals {
        &self.totals
    }

    /// Adds the same number of `bits` to each of the consecutive `sensors`, and returns the excess over their buffers,
    /// as [`Ledger::sample`] does.
    ///
    /// Without an overflow the bits are added without counting, which shortens a slot from 1.8 to 0.8 µs at 10^4 sensor
    /// nodes, and from 0.23 to 0.17 ms at 10^6 (`cargo bench -p skysink-field-sim --bench field`).
    ///
    /// # Panics
    /// If `sensors` reaches beyond the field.
    #[inline(always)]
    pub fn sample_equally(&mut self, sensors: Range<usize>, bits: u64) -> u64 {
        let queues_bits = &mut Arc::make_mut(&mut self.queues_bits)[sensors.clone()];
        let longest_bits = queues_bits.iter().fold(0, |longest, &queue_bits| queue_bits.max(longest));
        match u32::try_from(bits) {
            Ok(each_bits) if each_bits <= self.capacity_bits - longest_bits => {
                queues_bits.iter_mut().for_each(|queue_bits| *queue_bits += each_bits);
                self.count(bits * sensors.len() as u64, 0)
            }
            _ => self.sample(sensors, repeat(bits)),
        }
    }

    /// Adds `bits`, one entry for each of the consecutive `sensors`, and returns the excess over their buffers, which
    /// is lost: `Σ D_i` (UTS eq. 8).
    ///
    /// One pass without a branch, so that [`vectorized`](crate::simd::vectorized) applies.
    ///
    /// # Panics
    /// If `sensors` reaches beyond the field.
    #[inline(always)]
    pub fn sample(&mut self, sensors: Range<usize>, bits: impl Iterator<Item = u64>) -> u64 {
        let capacity_bits = self.capacity_bits;
        let mut sampled_bits = 0;
        let mut stored_bits = 0;
        for (queue_bits, bits) in Arc::make_mut(&mut self.queues_bits)[sensors].iter_mut().zip(bits) {
            let room_bits = capacity_bits - *queue_bits;
            let stored = (bits.min(u64::from(u32::MAX)) as u32).min(room_bits); // most processors compare 32 bits faster
            *queue_bits += stored;
            stored_bits += u64::from(stored);
            sampled_bits += bits;
        }
        self.count(sampled_bits, sampled_bits - stored_bits)
    }

    /// Adds the sampled bits and the lost part of them to the totals, and returns the lost bits.
    fn count(&mut self, sampled_bits: u64, lost_bits: u64) -> u64 {
        self.totals.sampled_bits += sampled_bits;
        self.totals.lost_bits += lost_bits;
        self.totals.queued_bits += sampled_bits - lost_bits;
        lost_bits
    }

    /// Removes up to `capacity_bits` from a queue, and returns the bits removed: at most the queue.
    #[must_use]
    pub fn upload(&mut self, sensor: usize, capacity_bits: u64) -> u64 {
        let queue_bits = u64::from(self.queues_bits[sensor]);
        let taken_bits = queue_bits.min(capacity_bits);
        Arc::make_mut(&mut self.queues_bits)[sensor] =
            u32::try_from(queue_bits - taken_bits).expect("at most the buffer, a u32");
        self.delivered_bits[sensor] += taken_bits;
        self.totals.delivered_bits += taken_bits;
        self.totals.queued_bits -= taken_bits;
        taken_bits
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::iter::once;

    #[test]
    fn a_snapshot_of_the_queues_does_not_change_and_is_copied_only_while_it_is_held() {
        let mut ledger = Ledger::new(30_000, vec![100, 200]);
        let held = ledger.shared_queues_bits();
        let _ = ledger.upload(0, 40);
        assert_eq!((&held[..], ledger.queues_bits()), (&[100, 200][..], &[60, 200][..]));
        drop(held);
        let address = ledger.queues_bits().as_ptr();
        let held = ledger.shared_queues_bits();
        assert_eq!(held.as_ptr(), address, "no copy");
        drop(held);
        let _ = ledger.sample(0..2, [5, 5].into_iter());
        assert_eq!((ledger.queues_bits(), ledger.queues_bits().as_ptr()), (&[65, 205][..], address));
    }

    #[test]
    fn an_overflowing_queue_loses_exactly_the_excess() {
        let mut ledger = Ledger::new(30_000, vec![29_950, 0]);
        assert_eq!(ledger.sample(0..2, [100, 30_001].into_iter()), 51); // 29 950 + 100 − 30 000, and 1
        assert_eq!(ledger.queues_bits(), [30_000, 30_000]);
        assert_eq!(ledger.lost_bits(0..2, [100, 30_001].into_iter()).collect::<Vec<_>>(), [50, 1]);
        assert!(ledger.totals().is_balanced());
    }

    #[test]
    fn more_bits_than_any_buffer_holds_are_counted_to_the_last() {
        let mut ledger = Ledger::new(u32::MAX, vec![7]);
        assert_eq!(ledger.sample(0..1, once(1 << 33)), (1 << 33) + 7 - u64::from(u32::MAX));
        assert_eq!(ledger.sample_equally(0..1, 1 << 33), 1 << 33);
        assert_eq!(ledger.totals().sampled_bits, 1 << 34);
        assert!(ledger.totals().is_balanced());
    }

    #[test]
    fn a_link_cannot_carry_bits_that_do_not_exist() {
        let mut ledger = Ledger::new(30_000, vec![700]);
        assert_eq!(ledger.upload(0, 500), 500);
        assert_eq!(ledger.upload(0, 500), 200);
        assert_eq!(ledger.upload(0, 500), 0);
        assert_eq!(ledger.totals().delivered_bits, 700);
    }

    #[test]
    fn only_a_possible_state_is_restored() {
        let new = || Ledger::new(10, vec![1, 2]);
        let sampled_bits = |sensor: usize| [5, 4][sensor];
        let mut ledger = new();
        for (queues_bits, delivered_bits) in [
            (&[3][..], &[1, 2][..]),
            (&[3, 4], &[1]),
            (&[11, 0], &[0, 0]), // more than the buffer
            (&[3, 4], &[4, 0]),  // 3 + 4 of 1 + 5
            (&[3, 4], &[0, u64::MAX]),
        ] {
            assert!(!ledger.restore(queues_bits, delivered_bits, sampled_bits), "{queues_bits:?}, {delivered_bits:?}");
            assert_eq!(ledger, new());
        }
        assert!(ledger.restore(&[3, 4], &[2, 2], sampled_bits));
        assert_eq!((ledger.queues_bits(), ledger.delivered_bits()), (&[3, 4][..], &[2, 2][..]));
        let totals = Totals { sampled_bits: 9, delivered_bits: 4, lost_bits: 1, queued_bits: 7, ..*new().totals() };
        assert_eq!(*ledger.totals(), totals); // 1 + 5 − 2 − 3 bits are lost
    }

    #[test]
    #[should_panic(expected = "exceeds the buffer")]
    fn an_initial_queue_above_the_buffer_is_refused() {
        let _ = Ledger::new(10, vec![3, 11]);
    }

    proptest! {
        #[test]
        fn sampling_equally_is_sampling_one_by_one(
            capacity_bits in prop_oneof![1u32..1_000, Just(u32::MAX)],
            bits in prop_oneof![0u64..500, any::<u64>().prop_map(|bits| bits >> 12)],
            step in prop_oneof![Just(0u32), Just(1), any::<u32>()],
        ) {
            let queue_bits = |sensor: u32| capacity_bits - sensor.wrapping_mul(step) % capacity_bits;
            let mut together = Ledger::new(capacity_bits, (1..100).map(queue_bits).collect());
            let mut singly = together.clone();
            for _ in 0..3 {
                let lost_bits: u64 = (0..99).map(|sensor| singly.sample(sensor..sensor + 1, once(bits))).sum();
                prop_assert_eq!(together.sample_equally(0..99, bits), lost_bits);
                prop_assert_eq!(&together, &singly);
            }
        }

        #[test]
        fn no_bit_is_ever_unaccounted_for(
            capacity_bits in 1u32..50_000,
            steps in prop::collection::vec((0usize..4, 0u64..80_000, 0u64..80_000), 1..200),
        ) {
            let initial_bits = vec![0, 1, capacity_bits / 2, capacity_bits];
            let mut ledger = Ledger::new(capacity_bits, initial_bits.clone());
            let mut sampled_bits = [0; 4];
            let mut lost_bits = [0; 4];
            for (sensor, bits, capacity) in steps {
                sampled_bits[sensor] += bits;
                lost_bits[sensor] += ledger.sample(sensor..sensor + 1, once(bits));
                let _ = ledger.upload(sensor, capacity);
                let queued_bits: u64 = ledger.queues_bits().iter().copied().map(u64::from).sum();
                prop_assert_eq!(queued_bits, ledger.totals().queued_bits);
                prop_assert!(ledger.totals().is_balanced());
                prop_assert_eq!(ledger.lost_bits(0..4, sampled_bits.into_iter()).collect::<Vec<_>>(), lost_bits);
            }
            let mut restored = Ledger::new(capacity_bits, initial_bits);
            prop_assert!(restored.restore(ledger.queues_bits(), ledger.delivered_bits(), |sensor| sampled_bits[sensor]));
            prop_assert_eq!(restored, ledger);
        }
    }
}
