//! Cohorts: the stored bits of the sensor nodes (SNs) by the slot that has sampled them, where bits expire (decision
//! D36).
//!
//! The lengths of the queues are left to [`crate::ledger`], which asks for what a slot and an upload do to them.

use std::mem::take;
use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::keys::{NodeKeys, Overflow};
use super::model::NodeModel;
use super::row::{Declared, NodeRefusal, NodeSetup, NodeTraits};
use crate::checkpoint::{CheckpointError, decode_first, encode};
use crate::error::InputError;
use crate::keys::Rule;
use crate::per_sensor::PerSensor;

/// Most cohorts: sensor nodes times the slots in which bits are stored, of 4 bytes.
const MOST_COHORTS: f64 = 2.5e8;

/// How long bits are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Expiry {
    /// The age above which a bit is lost, `D` [slots].
    pub slots: u64,
    /// Which bits a full buffer drops.
    pub overflow: Overflow,
}

impl Expiry {
    /// How long bits are stored, by `sensors.expiry_s`; `None` if none expires in the mission.
    fn of(keys: &NodeKeys<'_>) -> Option<Self> {
        let slots = keys.whole_slots(keys.sensors.expiry_s?);
        (slots < keys.slots).then(|| Self { slots, overflow: keys.sensors.overflow.unwrap_or_default() })
    }

    /// Slots in which bits are stored, `D + 1`.
    pub fn lasting_slots(&self) -> f64 {
        self.slots as f64 + 1.0
    }
}

/// The bits of all SNs by the slot that has sampled them; the initial queues count as sampled in slot 0.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cohorts {
    expiry: Expiry,
    /// Number of SNs.
    count: usize,
    /// The last slot.
    slot: u64,
    /// Bits by slot modulo `D + 1`, and within it by id: a slot takes the place of the one that expires in it.
    bits: Vec<u32>,
    /// The slot that has sampled the last bit uploaded, by id; 0 before that.
    freshest: Vec<u32>,
    /// A slot before which no stored bit was sampled, by id.
    oldest: Hints,
    /// Bits that have expired so far.
    expired_bits: u64,
}

/// Where searches may begin: it makes no difference to what is found.
#[derive(Debug, Clone)]
struct Hints(Vec<u32>);

impl PartialEq for Hints {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Eq for Hints {}

impl Cohorts {
    /// The cohorts before slot 1 over these queues [bit].
    #[must_use]
    pub fn new(expiry: Expiry, queues_bits: &[u32]) -> Self {
        let mut bits = queues_bits.to_vec();
        let rows = usize::try_from(expiry.slots + 1).expect("an age within a mission that fits in memory");
        let count = queues_bits.len();
        bits.resize(rows * count, 0);
        let oldest = Hints(vec![0; count]);
        Self { expiry, count, slot: 0, bits, freshest: vec![0; count], oldest, expired_bits: 0 }
    }

    /// Bits that have expired so far.
    pub fn expired_bits(&self) -> u64 {
        self.expired_bits
    }

    /// Index in `bits` of the first SN in the cohort of `slot`.
    fn row(&self, slot: u64) -> usize {
        (slot % (self.expiry.slots + 1)) as usize * self.count
    }

    /// Removes the oldest `bits` [bit] of SN `sensor`, and returns the slot that has sampled the last of them.
    fn take_oldest(&mut self, sensor: usize, mut bits: u64) -> Option<u64> {
        let mut last = None;
        let first = self.slot.saturating_sub(self.expiry.slots).max(self.oldest.0[sensor].into());
        for slot in first..=self.slot {
            if bits == 0 {
                break;
            }
            self.oldest.0[sensor] = u32::try_from(slot).unwrap_or(0); // 0 is before all, and only slower
            let index = self.row(slot) + sensor;
            let taken_bits = bits.min(self.bits[index].into()) as u32;
            self.bits[index] -= taken_bits;
            bits -= u64::from(taken_bits);
            last = if taken_bits > 0 { Some(slot) } else { last };
        }
        last
    }

    /// Whether these cohorts after `slot` add up to the queues `queues_bits` [bit].
    fn are_of(&self, slot: u64, queues_bits: &[u32]) -> bool {
        let rows = self.bits.chunks(self.count.max(1));
        let sum = |sensor: usize| rows.clone().map(|row| u64::from(row[sensor])).sum::<u64>();
        self.slot == slot
            && queues_bits.iter().enumerate().all(|(sensor, &queue_bits)| sum(sensor) == u64::from(queue_bits))
    }
}

/// The checkpoint of cohorts.
#[derive(Serialize, Deserialize)]
struct State {
    slot: u64,
    expired_bits: u64,
    /// `u32` by cohort and sensor node, in native byte order.
    #[serde(with = "serde_bytes")]
    bits: Vec<u8>,
    /// `u32` by sensor node, in native byte order.
    #[serde(with = "serde_bytes")]
    freshest: Vec<u8>,
}

impl NodeModel for Cohorts {
    fn stores(&self) -> bool {
        true
    }

    /// Each of the SNs loses its expired bits, samples, and loses what exceeds its buffer.
    fn store(
        &mut self,
        slot: u64,
        sensors: Range<usize>,
        sampled_bits: &[u64],
        queues_bits: &mut [u32],
        capacities_bits: &PerSensor<u32>,
    ) -> Option<u64> {
        self.slot = slot;
        let row = self.row(slot);
        let mut lost_bits = 0;
        for ((sensor, queue_bits), &bits) in sensors.zip(queues_bits).zip(sampled_bits) {
            let expired_bits = take(&mut self.bits[row + sensor]);
            let capacity_bits = capacities_bits.of(sensor);
            let held_bits = u64::from(*queue_bits - expired_bits) + bits;
            let excess_bits = held_bits.saturating_sub(capacity_bits.into());
            let stored_bits = match self.expiry.overflow {
                Overflow::Newest => bits - excess_bits, // what was there before fits
                Overflow::Oldest => bits.min(capacity_bits.into()),
            };
            self.bits[row + sensor] = stored_bits as u32; // at most the buffer
            self.take_oldest(sensor, excess_bits - (bits - stored_bits));
            *queue_bits = (held_bits - excess_bits) as u32;
            self.expired_bits += u64::from(expired_bits);
            lost_bits += u64::from(expired_bits) + excess_bits;
        }
        Some(lost_bits)
    }

    /// The oldest go first.
    fn upload(&mut self, sensor: usize, bits: u32) {
        if let Some(slot) = self.take_oldest(sensor, bits.into()) {
            self.freshest[sensor] = u32::try_from(slot).unwrap_or(u32::MAX);
        }
    }

    fn discard(&mut self, sensor: usize, bits: u32) {
        let _ = self.take_oldest(sensor, bits.into());
    }

    fn freshest_slot(&self, sensor: usize) -> Option<u64> {
        Some(self.freshest[sensor].into())
    }

    fn most_bytes(&self) -> usize {
        size_of::<u32>() * (self.bits.len() + self.count)
    }

    fn save(&self, bytes: &mut Vec<u8>) {
        let [bits, freshest] = [&self.bits, &self.freshest].map(|numbers| bytemuck::cast_slice(numbers).to_vec());
        encode(&State { slot: self.slot, expired_bits: self.expired_bits, bits, freshest }, bytes);
    }

    fn restore(&mut self, slot: u64, queues_bits: &[u32], bytes: &mut &[u8]) -> Result<(), CheckpointError> {
        let (state, left) = decode_first(bytes)?;
        let State { slot: saved, expired_bits, bits, freshest } = state;
        let [bits, freshest] = [bits, freshest].map(|bytes| bytemuck::pod_collect_to_vec::<u8, u32>(&bytes));
        let is_of_field = bits.len() == self.bits.len() && freshest.len() == self.count;
        CheckpointError::ensure(is_of_field, "the cohorts of this field")?;
        let oldest = Hints(vec![0; self.count]);
        *self = Self { slot: saved, bits, freshest, oldest, expired_bits, ..*self };
        CheckpointError::ensure(self.are_of(slot, queues_bits), "the cohorts of these queues")?;
        *bytes = left;
        Ok(())
    }
}

impl Declared for Cohorts {
    const KEY: &'static str = "sensors.expiry_s";

    fn traits(keys: &NodeKeys<'_>) -> Option<NodeTraits> {
        let lasting_slots = Expiry::of(keys)?.lasting_slots();
        Some(NodeTraits { loses_initial: true, lasting_slots, ..NodeTraits::default() })
    }

    fn check(keys: &NodeKeys<'_>, rule: Rule<'_>) -> Result<(), InputError> {
        let is_slot = keys.sensors.expiry_s.is_none_or(|expiry_s| expiry_s >= keys.slot_s);
        rule(is_slot, "sensors.expiry_s", &format!("at least the slot's {} s", keys.slot_s))
    }

    fn refusal(keys: &NodeKeys<'_>, count: usize) -> Option<NodeRefusal> {
        let most_slots = (MOST_COHORTS / count as f64).floor() - 1.0;
        let _ = Expiry::of(keys).filter(|expiry| expiry.slots as f64 > most_slots)?;
        let [most_s, mission_s] = [most_slots, keys.slots as f64].map(|slots| slots * keys.slot_s);
        let expected = format!("at most {most_s} with {count} sensor nodes, or the mission's {mission_s} s");
        Some(NodeRefusal { key: "sensors.expiry_s", value: keys.sensors.expiry_s?, expected })
    }

    fn make(setup: &NodeSetup<'_>) -> Option<Self> {
        Some(Self::new(Expiry::of(&setup.keys)?, setup.queues_bits))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arrivals::Poisson;
    use crate::ledger::Ledger;
    use crate::random::Streams;
    use crate::sampling::Sampling;
    use proptest::prelude::*;
    use std::collections::VecDeque;

    /// SNs that sample 10 bit a slot into buffers of `capacity_bits`, and bits that expire above an age of 3 slots.
    fn ledger(overflow: Overflow, capacity_bits: u32, queues_bits: &[u32]) -> Ledger {
        let sampling = Sampling::new(vec![10.0; queues_bits.len()], vec![capacity_bits; queues_bits.len()]);
        let cohorts = Cohorts::new(Expiry { slots: 3, overflow }, queues_bits);
        Ledger::new(sampling, queues_bits.to_vec()).with_features([cohorts.into()].into_iter().collect())
    }

    fn cohorts(ledger: &Ledger) -> &Cohorts {
        ledger.features().find::<Cohorts>().unwrap()
    }

    /// Lost and expired bits.
    fn lost(ledger: &Ledger) -> [u64; 2] {
        assert!(ledger.totals().is_balanced());
        [ledger.totals().lost_bits, cohorts(ledger).expired_bits()]
    }

    #[test]
    fn an_unvisited_sensor_node_loses_a_cohort_in_each_slot() {
        let mut ledger = ledger(Overflow::Newest, 1_000, &[7]);
        let slots = (1..=10).map(|slot| ledger.sample(slot)).collect::<Vec<_>>();
        // The 7 bit of slot 0 have an age of 4 in slot 4, and the 10 bit of slot 1 in slot 5. 40 bit stay.
        assert_eq!(slots, [0, 0, 0, 7, 10, 10, 10, 10, 10, 10]);
        assert_eq!((ledger.queues_bits(), lost(&ledger)), (&[40][..], [67, 67]));
    }

    #[test]
    fn a_visit_every_six_slots_comes_two_slots_late() {
        let mut ledger = ledger(Overflow::Newest, 1_000, &[0]);
        for slot in 1..=12 {
            ledger.sample(slot);
            if slot % 6 == 0 {
                assert_eq!(ledger.upload(0, u64::MAX), 40);
            }
        }
        // C = D + 1 = 4: each gap of 6 slots loses the bits of 2.
        assert_eq!(lost(&ledger), [40, 40]);
    }

    #[test]
    fn a_full_buffer_drops_the_newest_or_the_oldest_bits() {
        // 80 bit in 8 slots, of which 25 stay. The newest are dropped: of the slots 1 to 3 the buffer has 10, 10 and 5
        // bit, which expire in the slots 5 to 7 and leave as much room; 12 bit of the slots 5 and 6 are uploaded. The
        // oldest: it has those of the slots 6 to 8, 5, 10 and 10 bit, and none expires.
        for (overflow, expired_bits, freshest_slot) in [(Overflow::Newest, 25, 6), (Overflow::Oldest, 0, 7)] {
            let mut ledger = ledger(overflow, 25, &[0]);
            (1..=8).for_each(|slot| _ = ledger.sample(slot));
            assert_eq!((ledger.queues_bits(), lost(&ledger)), (&[25][..], [55, expired_bits]));
            assert_eq!(ledger.upload(0, 12), 12);
            assert_eq!(ledger.features().freshest_slot(0), Some(freshest_slot), "{overflow:?}");
        }
    }

    #[test]
    fn cohorts_of_another_field_or_queue_are_refused() {
        let mut field = ledger(Overflow::Newest, 25, &[0, 3]);
        field.sample(1);
        let mut bytes = Vec::new();
        field.features().save(&mut bytes);
        for (queues_bits, bytes, is_possible) in [
            (&[10, 13][..], &bytes[..], true),
            (&[10], &bytes, false),
            (&[10, 13], &[], false),
            (&[10, 12], &bytes, false),
        ] {
            let mut restored = ledger(Overflow::Newest, 25, &[0, 3][..queues_bits.len()]);
            let found = restored.restore(1, queues_bits, &vec![0; queues_bits.len()], None, bytes);
            assert_eq!(found.is_ok(), is_possible, "{queues_bits:?}");
        }
    }

    /// A sensor node bit by bit: the slots in which its bits were sampled.
    #[derive(Default)]
    struct BitQueue {
        slots: VecDeque<u64>,
        lost: u64,
        expired: u64,
        freshest: u64,
    }

    impl BitQueue {
        fn sample(&mut self, slot: u64, bits: u64, capacity_bits: usize, expiry: Expiry) {
            while self.slots.front().is_some_and(|sampled| slot - sampled > expiry.slots) {
                self.slots.pop_front();
                self.expired += 1;
            }
            for _ in 0..bits {
                self.slots.push_back(slot);
            }
            while self.slots.len() > capacity_bits {
                self.lost += 1;
                match expiry.overflow {
                    Overflow::Newest => self.slots.pop_back(),
                    Overflow::Oldest => self.slots.pop_front(),
                };
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(1_000))]

        #[test]
        fn cohorts_agree_with_queues_of_single_bits(
            means in prop::collection::vec(
                prop_oneof![Just(0.0), Just(0.1), Just(1.0 / 3.0), Just(2.5), Just(30.0), 0.0..9.0f64], 1..4),
            capacity_bits in 1u32..30,
            initial_bits in 0u32..30,
            slots in 1u64..9,
            overflow in prop_oneof![Just(Overflow::Newest), Just(Overflow::Oldest)],
            seed in prop::option::of(any::<u64>()),
            uploads in prop::collection::vec((0usize..5, prop_oneof![Just(99u64), 0u64..20]), 1..60),
        ) {
            let expiry = Expiry { slots, overflow };
            let initial_bits = vec![initial_bits.min(capacity_bits); means.len()];
            let drawn = seed.map(|seed| Poisson::new(2.0, Streams::new(seed)).into());
            let sampling = Sampling::new(means.clone(), vec![capacity_bits; means.len()])
                .with_arrivals(drawn);
            let cohorts = Cohorts::new(expiry, &initial_bits);
            let new = || Ledger::new(sampling.clone(), initial_bits.clone())
                .with_features([cohorts.clone().into()].into_iter().collect());
            let mut ledger = new();
            let mut queues: Vec<BitQueue> = initial_bits.iter()
                .map(|&bits| BitQueue { slots: vec![0; bits as usize].into(), ..BitQueue::default() }).collect();
            for (slot, &(served, link_bits)) in (1u64..).zip(&uploads) {
                let _ = ledger.sample(slot);
                for (sensor, queue) in queues.iter_mut().enumerate() {
                    queue.sample(slot, sampling.bits(sensor, slot), capacity_bits as usize, expiry);
                }
                if let Some(queue) = queues.get_mut(served) {
                    let taken = link_bits.min(queue.slots.len() as u64);
                    prop_assert_eq!(ledger.upload(served, link_bits), taken);
                    queue.freshest = queue.slots.drain(..taken as usize).next_back().unwrap_or(queue.freshest);
                }
                prop_assert!(ledger.totals().is_balanced());
                let cohorts = ledger.features().find::<Cohorts>().unwrap();
                prop_assert_eq!(cohorts.expired_bits(), queues.iter().map(|queue| queue.expired).sum::<u64>());
                for (sensor, (queue, lost_bits)) in queues.iter().zip(ledger.lost_bits(slot)).enumerate() {
                    prop_assert_eq!(ledger.queues_bits()[sensor] as usize, queue.slots.len());
                    prop_assert_eq!(lost_bits, queue.lost + queue.expired);
                    prop_assert_eq!(cohorts.freshest_slot(sensor), Some(queue.freshest));
                }
                let mut restored = new();
                let mut saved = Vec::new();
                ledger.features().save(&mut saved);
                prop_assert!(restored
                    .restore(slot, ledger.queues_bits(), ledger.delivered_bits(), ledger.drawn_bits(), &saved)
                    .is_ok());
                prop_assert_eq!(&restored, &ledger);
            }
        }
    }
}
