//! The queue ledger: every bit of every sensor node, accounted for exactly.
//!
//! It keeps `initial + sampled = delivered + lost + queued` as an equality of integers; what arrives and what a link
//! carries is decided by the caller.

mod repeated;

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
#[cfg(feature = "node")]
use iceoryx2::prelude::ZeroCopySend;

use crate::wide::wide;
use repeated::Repeated;

/// Bits of the whole field since the mission's start.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[cfg_attr(feature = "node", derive(ZeroCopySend), type_name("skysink.Totals.v1"))]
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

    /// Adds `bits` sampled by each of the neighbours `sensors`, as [`Ledger::sample`] would one by one, and returns the sum
    /// of what they lost. `mean_bits` is what each samples in a slot on average [bit].
    ///
    /// # Panics
    /// If `sensors` reaches beyond the field.
    pub fn sample_alike(&mut self, sensors: Range<usize>, bits: u64, mean_bits: f64) -> u64 {
        let capacity_bits = self.capacity_bits;
        let Some(each_bits) = u32::try_from(bits).ok().filter(|&bits| simple(capacity_bits, bits)) else {
            return sensors.map(|sensor| self.sample(sensor, bits, mean_bits)).sum();
        };
        let queues_bits = &mut self.queues_bits[sensors];
        let sensors = queues_bits.len() as u64;
        let overflow = wide(|| add_alike(queues_bits, each_bits, capacity_bits));
        let mut lost = Lost::since(&self.totals);
        if overflow {
            wide(|| lost.spill_alike(queues_bits, each_bits, capacity_bits, mean_bits));
        }
        self.book(bits * sensors, lost)
    }

    /// Adds `bits[k]` sampled by sensor node `first + k`, as [`Ledger::sample`] would one by one, and returns the sum of
    /// what they lost. `mean_bits[k]` is what each samples in a slot on average [bit].
    ///
    /// # Panics
    /// If the lengths differ, or reach beyond the field.
    pub fn sample_each(&mut self, first: usize, bits: &[u32], mean_bits: &[f64]) -> u64 {
        assert_eq!(bits.len(), mean_bits.len(), "expected one average per sensor node");
        let capacity_bits = self.capacity_bits;
        let (sampled_bits, at_least_the_most_bits) = wide(|| sum_and_union(bits));
        if !simple(capacity_bits, at_least_the_most_bits) {
            let sensors = (first..).zip(bits.iter().zip(mean_bits));
            return sensors.map(|(sensor, (&bits, &mean))| self.sample(sensor, u64::from(bits), mean)).sum();
        }
        let queues_bits = &mut self.queues_bits[first..first + bits.len()];
        let overflow = wide(|| add_each(queues_bits, bits, capacity_bits));
        let mut lost = Lost::since(&self.totals);
        if overflow {
            let queues = queues_bits.iter_mut().zip(mean_bits);
            queues.for_each(|(queue_bits, &mean_bits)| lost.spill(queue_bits, capacity_bits, mean_bits));
        }
        self.book(sampled_bits, lost)
    }

    /// Enters what some sensor nodes sampled and lost, and returns the latter [bit].
    fn book(&mut self, sampled_bits: u64, lost: Lost) -> u64 {
        self.totals.sampled_bits += sampled_bits;
        self.totals.lost_bits += lost.bits;
        self.totals.queued_bits += sampled_bits - lost.bits;
        self.totals.lost_slots = lost.slots.sum();
        lost.bits
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

/// Sensor nodes that are looked at together where some may be full and others not.
const FEW: usize = 32;

/// Whether a queue and what is sampled stay below 2^31 bit together, so that the sign of what is left of the storage
/// says whether it is too little: unlike a comparison, a subtraction is quick even for several at a time.
fn simple(capacity_bits: u32, sampled_bits: u32) -> bool {
    capacity_bits.checked_add(sampled_bits).is_some_and(|most_bits| most_bits < 1 << 31)
}

/// Adds `bits` to every queue; whether one then exceeds `capacity_bits`. All are [`simple`].
#[inline(always)]
fn add_alike(queues_bits: &mut [u32], bits: u32, capacity_bits: u32) -> bool {
    let mut signs = 0;
    for queue_bits in queues_bits {
        *queue_bits += bits;
        signs |= capacity_bits.wrapping_sub(*queue_bits);
    }
    signs.leading_zeros() == 0
}

/// Adds `bits[k]` to queue k; whether one then exceeds `capacity_bits`. All are [`simple`].
#[inline(always)]
fn add_each(queues_bits: &mut [u32], bits: &[u32], capacity_bits: u32) -> bool {
    let mut signs = 0;
    for (queue_bits, bits) in queues_bits.iter_mut().zip(bits) {
        *queue_bits += bits;
        signs |= capacity_bits.wrapping_sub(*queue_bits);
    }
    signs.leading_zeros() == 0
}

/// Whether every queue holds `bits`.
#[inline(always)]
fn all_hold(queues_bits: &[u32], bits: u32) -> bool {
    queues_bits.iter().fold(0, |differences, queue_bits| differences | (queue_bits ^ bits)) == 0
}

/// The sum of `bits`, and all their digits together, which is at least the largest.
#[inline(always)]
fn sum_and_union(bits: &[u32]) -> (u64, u32) {
    bits.iter().fold((0, 0), |(sum, union), &bits| (sum + u64::from(bits), union | bits))
}

/// What some sensor nodes lose, in their order.
struct Lost {
    bits: u64,
    /// [`Totals::lost_slots`] in the making.
    slots: Repeated,
}

impl Lost {
    /// Nothing yet.
    fn since(totals: &Totals) -> Self {
        Self { bits: 0, slots: Repeated::from(totals.lost_slots) }
    }

    /// The next `sensors` lose `bits` each, above 0, of `mean_bits` sampled on average.
    fn add(&mut self, bits: u32, mean_bits: f64, sensors: u64) {
        self.bits += u64::from(bits) * sensors;
        self.slots.add(f64::from(bits) / mean_bits, sensors);
    }

    /// The next ones, to whom `each_bits` were added, lose what their queues hold above the storage.
    ///
    /// Most were full already, in a field that nobody can visit in time: one that was visited costs its neighbours.
    #[inline(always)]
    fn spill_alike(&mut self, queues_bits: &mut [u32], each_bits: u32, capacity_bits: u32, mean_bits: f64) {
        for few_bits in queues_bits.chunks_mut(FEW) {
            if all_hold(few_bits, capacity_bits + each_bits) {
                few_bits.fill(capacity_bits);
                self.add(each_bits, mean_bits, few_bits.len() as u64);
            } else {
                few_bits.iter_mut().for_each(|queue_bits| self.spill(queue_bits, capacity_bits, mean_bits));
            }
        }
    }

    /// The next one loses what its queue holds above the storage.
    fn spill(&mut self, queue_bits: &mut u32, capacity_bits: u32, mean_bits: f64) {
        if *queue_bits > capacity_bits {
            self.add(*queue_bits - capacity_bits, mean_bits, 1);
            *queue_bits = capacity_bits;
        }
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

    /// Averages [bit], and what they come to in a slot: whole, fractional, beyond any storage.
    fn samples() -> impl Strategy<Value = (u32, f64)> {
        prop_oneof![
            Just((100, 100.0)),
            prop_oneof![Just(2u32), Just(3)].prop_map(|bits| (bits, 2.5)),
            (1u32..500).prop_map(|bits| (bits, f64::from(bits) - 0.3)),
            Just((0, 0.0)),
            Just((u32::MAX, 4_294_967_295.0)),
        ]
    }

    /// Storages [bit], and how full the queues are: anyhow, or to the brim.
    fn ledgers() -> impl Strategy<Value = Ledger> {
        let capacity = prop_oneof![1u32..1_000, Just(30_000), Just(u32::MAX)];
        (capacity, 1usize..300, prop_oneof![Just(0u32), Just(1), Just(100), any::<u32>()]).prop_map(
            |(capacity_bits, sensors, step)| {
                let room_bits = |sensor: usize| (sensor as u32).wrapping_mul(step) % capacity_bits;
                Ledger::new(capacity_bits, (0..sensors).map(|sensor| capacity_bits - room_bits(sensor)).collect())
            },
        )
    }

    proptest! {
        /// `f64` sums depend on the order: equality shows that it was kept.
        #[test]
        fn neighbours_sample_together_as_they_do_one_by_one(
            ledger in ledgers(),
            slots in prop::collection::vec(prop_oneof![
                samples().prop_map(|alike| vec![alike]),
                prop::collection::vec(samples(), 300),
            ], 1..8),
        ) {
            let (mut together, mut singly, sensors) = (ledger.clone(), ledger.clone(), ledger.queues_bits().len());
            for samples in slots {
                let of = |sensor: usize| samples[sensor % samples.len()];
                let (bits, mean_bits): (Vec<u32>, Vec<f64>) = (0..sensors).map(of).unzip();
                let lost_bits = match samples[..] {
                    [(bits, mean_bits)] => together.sample_alike(0..sensors, u64::from(bits), mean_bits),
                    _ => together.sample_each(0, &bits, &mean_bits),
                };
                let lost = |sensor| singly.sample(sensor, u64::from(bits[sensor]), mean_bits[sensor]);
                prop_assert_eq!((0..sensors).map(lost).sum::<u64>(), lost_bits);
                prop_assert_eq!(together.totals.lost_slots.to_bits(), singly.totals.lost_slots.to_bits());
                prop_assert_eq!(&together, &singly);
            }
        }

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
