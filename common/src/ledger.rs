//! The queue ledger: every bit of every sensor node, accounted for exactly.
//!
//! It keeps `initial + sampled = delivered + lost + queued` as an equality of integers; what arrives and what a link
//! carries is decided by the caller.

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

/// Bits of the whole field since the mission's start.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, ZeroCopySend, Pod, Zeroable)]
#[type_name("skysink.Totals.v1")]
pub struct Totals {
    /// Queued before slot 1.
    pub initial_bits: u64,
    /// Sampled by the sensor nodes.
    pub sampled_bits: u64,
    /// Uploaded to the UAV.
    pub delivered_bits: u64,
    /// Thrown away by full storages, `Σ D_i` (UTS eq. 8).
    pub lost_bits: u64,
    /// Queued now.
    pub queued_bits: u64,
    /// `Σ_t Σ_i D_i(t) / (s_i τ)`: the loss in slots' worth of sampling, for the letter's own figure of merit.
    pub lost_slots: f64,
}

impl Totals {
    /// Whether every bit is accounted for.
    #[must_use]
    pub fn balanced(&self) -> bool {
        let sum = |bits: [u64; 3]| bits.into_iter().map(u128::from).sum::<u128>(); // totals from outside may be anything
        sum([self.initial_bits, self.sampled_bits, 0]) == sum([self.delivered_bits, self.lost_bits, self.queued_bits])
    }
}

/// Queue lengths `B_i` [bit] of all sensor nodes, and the totals.
#[derive(Debug, Clone, PartialEq)]
pub struct Ledger {
    capacity_bits: u32,
    queues_bits: Vec<u32>,
    delivered_bits: Vec<u64>,
    totals: Totals,
}

impl Ledger {
    /// A ledger over the initial queues [bit], none of which exceeds `capacity_bits`.
    ///
    /// # Panics
    /// If a queue exceeds the storage: the sensor list guarantees that none does.
    #[must_use]
    pub fn new(capacity_bits: u32, queues_bits: Vec<u32>) -> Self {
        assert!(queues_bits.iter().all(|&queue| queue <= capacity_bits), "an initial queue exceeds the storage");
        let queued_bits = queues_bits.iter().copied().map(u64::from).sum();
        let totals = Totals { initial_bits: queued_bits, queued_bits, ..Totals::default() };
        let delivered_bits = vec![0; queues_bits.len()];
        Self { capacity_bits, queues_bits, delivered_bits, totals }
    }

    /// Takes over the state of another ledger of this field, if it can be one: as many queues, none above the storage,
    /// every bit accounted for, and no more bits than a mission may have. Says whether it did. What each sensor node has delivered counts from here.
    #[must_use]
    pub fn take_over(&mut self, queues_bits: &[u32], totals: Totals) -> bool {
        let queued_bits: u64 = queues_bits.iter().copied().map(u64::from).sum();
        let possible = queues_bits.len() == self.queues_bits.len()
            && queues_bits.iter().all(|&queue| queue <= self.capacity_bits)
            && queued_bits == totals.queued_bits
            && u128::from(totals.initial_bits) + u128::from(totals.sampled_bits) <= i64::MAX as u128
            && totals.balanced();
        if possible {
            self.queues_bits.copy_from_slice(queues_bits);
            self.totals = totals;
        }
        possible
    }

    /// Queue lengths [bit], by sensor node.
    #[must_use]
    pub fn queues_bits(&self) -> &[u32] {
        &self.queues_bits
    }

    /// Bits uploaded so far, by sensor node.
    #[must_use]
    pub fn delivered_bits(&self) -> &[u64] {
        &self.delivered_bits
    }

    /// The field's totals.
    #[must_use]
    pub fn totals(&self) -> &Totals {
        &self.totals
    }

    /// Adds `bits` sampled by `sensor` and returns the excess over its storage, `D_i` (UTS eq. 8), which is lost.
    ///
    /// `mean_bits` is what it samples in a slot on average, `s_i τ` [bit]; it only weighs [`Totals::lost_slots`].
    pub fn sample(&mut self, sensor: usize, bits: u64, mean_bits: f64) -> u64 {
        let full_bits = u64::from(self.queues_bits[sensor]) + bits;
        let lost_bits = full_bits.saturating_sub(u64::from(self.capacity_bits));
        let queue_bits = full_bits - lost_bits;
        self.queues_bits[sensor] = u32::try_from(queue_bits).expect("at most the storage, a u32");
        self.totals.sampled_bits += bits;
        self.totals.lost_bits += lost_bits;
        self.totals.queued_bits += bits - lost_bits;
        if lost_bits > 0 {
            self.totals.lost_slots += lost_bits as f64 / mean_bits;
        }
        lost_bits
    }

    /// Removes up to `capacity_bits` and returns what was really taken: a link cannot carry bits that do not exist.
    #[must_use]
    pub fn upload(&mut self, sensor: usize, capacity_bits: u64) -> u64 {
        let queue_bits = u64::from(self.queues_bits[sensor]);
        let taken_bits = queue_bits.min(capacity_bits);
        self.queues_bits[sensor] = u32::try_from(queue_bits - taken_bits).expect("at most the storage, a u32");
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

    #[test]
    fn an_overflowing_queue_loses_exactly_the_excess() {
        let mut ledger = Ledger::new(30_000, vec![29_950]);
        assert_eq!(ledger.sample(0, 100, 100.0), 50); // 29 950 + 100 − 30 000
        assert_eq!(ledger.queues_bits(), [30_000]);
        assert_eq!(ledger.totals().lost_slots, 0.5);
        assert!(ledger.totals().balanced());
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
    fn only_a_possible_state_is_taken_over() {
        let mut ledger = Ledger::new(10, vec![1, 2]);
        let totals = Totals {
            initial_bits: 3,
            sampled_bits: 9,
            delivered_bits: 4,
            lost_bits: 1,
            queued_bits: 7,
            ..Totals::default()
        };
        for (queues, totals) in [
            (&[7][..], totals),
            (&[3, 3], totals),
            (&[11, 0], Totals { sampled_bits: 13, queued_bits: 11, ..totals }),
            (&[3, 4], Totals { lost_bits: 2, ..totals }),
            (&[3, 4], Totals { delivered_bits: u64::MAX, lost_bits: u64::MAX, ..totals }),
        ] {
            assert!(!ledger.take_over(queues, totals), "{queues:?}");
            assert_eq!(ledger, Ledger::new(10, vec![1, 2]));
        }
        assert!(ledger.take_over(&[3, 4], totals));
        assert_eq!((ledger.queues_bits(), *ledger.totals()), (&[3, 4][..], totals));
    }

    #[test]
    #[should_panic(expected = "exceeds the storage")]
    fn an_initial_queue_above_the_storage_is_refused() {
        let _ = Ledger::new(10, vec![3, 11]);
    }

    proptest! {
        #[test]
        fn no_bit_is_ever_unaccounted_for(
            capacity_bits in 1u32..50_000,
            steps in prop::collection::vec((0usize..4, 0u64..80_000, 0u64..80_000), 1..200),
        ) {
            let mut ledger = Ledger::new(capacity_bits, vec![0, 1, capacity_bits / 2, capacity_bits]);
            for (sensor, sampled_bits, capacity) in steps {
                let _ = ledger.sample(sensor, sampled_bits, 1.0);
                let _ = ledger.upload(sensor, capacity);
                let queued_bits: u64 = ledger.queues_bits().iter().copied().map(u64::from).sum();
                prop_assert_eq!(queued_bits, ledger.totals().queued_bits);
                prop_assert!(ledger.totals().balanced());
            }
        }
    }
}
