//! The queue ledger: every bit of every sensor node (SN), accounted for exactly.
//!
//! `initial + sampled = delivered + lost + queued` holds as an equality of integers, for each SN and for the field.
//! What a slot does to the queues is left to [`crate::queues`], what a link carries to the caller.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
#[cfg(feature = "node")]
use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};

use crate::arrivals::{quick_bits, sampled_bits};
use crate::checkpoint::CheckpointError;
use crate::geometry::Position;
use crate::nodes::{Answer, NodeFeatures, NodeService, SlotEnd};
use crate::per_sensor::PerSensor;
use crate::queues::{Queues, Sampled, blocks};
use crate::sampling::Sampling;
use crate::simd::{BLOCK, vectorized};

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
    /// Lost to full buffers, `Σ D_i` (UTS eq. 8), or expired.
    pub lost_bits: u64,
    /// Queued now.
    pub queued_bits: u64,
    /// `Σ_t Σ_i D_i(t) / (s_i τ)`: the loss in slots of sampling, for the paper's loss rate.
    #[serde(skip)]
    pub lost_slots: f64,
}

impl Totals {
    /// Whether every bit is accounted for.
    pub fn is_balanced(&self) -> bool {
        let sum = |bits: [u64; 3]| bits.into_iter().map(u128::from).sum::<u128>(); // received totals may be any numbers
        sum([self.initial_bits, self.sampled_bits, 0]) == sum([self.delivered_bits, self.lost_bits, self.queued_bits])
    }
}

/// The queues of all sensor nodes (SNs), and all bits since the mission's start.
#[derive(Debug, Clone, PartialEq)]
pub struct Ledger {
    sampling: Sampling,
    queues: Queues,
    initial_bits: Vec<u32>,
    delivered_bits: Vec<u64>,
    /// Bits sampled so far, by id, if arrivals are drawn; constant ones are counted by formula.
    drawn_bits: Option<Vec<u64>>,
    /// Loss of each block of SNs [slots of sampling], if the means differ.
    lost_slots: Vec<f64>,
    /// Without `lost_slots`.
    totals: Totals,
    /// What the SNs are beyond queues.
    features: NodeFeatures,
    /// The buffers of SNs that are alive [bit]; that of a dead one is 0 in `sampling`.
    alive_bits: PerSensor<u32>,
    /// SNs that were dead or silent when a UAV was to serve them in the last slot.
    unanswered: Vec<u32>,
}

impl Ledger {
    /// A ledger before slot 1 over the initial queues [bit] of SNs that fill them by `sampling`.
    ///
    /// # Panics
    /// If a queue exceeds its buffer, which a sensor list rules out.
    #[must_use]
    pub fn new(sampling: Sampling, queues_bits: Vec<u32>) -> Self {
        let fits = |(sensor, &queue): (usize, &u32)| queue <= sampling.of(sensor).capacity_bits;
        assert!(queues_bits.iter().enumerate().all(fits), "an initial queue exceeds the buffer");
        let queued_bits = queues_bits.iter().copied().map(u64::from).sum();
        Self {
            delivered_bits: vec![0; queues_bits.len()],
            drawn_bits: sampling.is_drawn().then(|| vec![0; queues_bits.len()]),
            lost_slots: match sampling.mean_bits {
                PerSensor::Equal(_) => Vec::new(),
                PerSensor::Each(_) => vec![0.0; blocks(queues_bits.len()).count()],
            },
            totals: Totals { initial_bits: queued_bits, queued_bits, ..Totals::default() },
            initial_bits: queues_bits.clone(),
            queues: Queues::new(queues_bits),
            features: NodeFeatures::default(),
            alive_bits: sampling.capacity_bits.clone(),
            unanswered: Vec::new(),
            sampling,
        }
    }

    /// This ledger of SNs with these features.
    #[must_use]
    pub fn with_features(mut self, features: NodeFeatures) -> Self {
        self.sampling = self.sampling_of(&features);
        self.features = features;
        self
    }

    /// The features of the SNs.
    pub fn features(&self) -> &NodeFeatures {
        &self.features
    }

    /// The sampling with buffers of 0 of those SNs that are dead by `features`.
    fn sampling_of(&self, features: &NodeFeatures) -> Sampling {
        let mut sampling = self.sampling.clone().with_buffers(self.alive_bits.clone());
        if features.may_refuse() {
            let mut answers = vec![Answer::Queue; self.initial_bits.len()];
            features.raise(&mut answers);
            for (sensor, _) in answers.iter().enumerate().filter(|(_, answer)| **answer == Answer::Dead) {
                sampling.capacity_bits.set(sensor, answers.len(), 0);
            }
        }
        sampling
    }

    /// Whether SN `sensor`, which a UAV served in the last slot, was neither dead nor silent.
    pub fn has_answered(&self, sensor: u32) -> bool {
        !self.unanswered.contains(&sensor)
    }

    /// Restores the queues [bit] after `slot`, the bits delivered so far, by id, the bits [`Self::drawn_bits`], and the
    /// features as they were saved in exactly `features`.
    ///
    /// A state is possible if it has an entry for each SN, no queue exceeds its buffer, no SN has delivered and still
    /// holds more bits than it had, and the states of the features are.
    ///
    /// # Errors
    /// If the state is impossible; nothing is then changed.
    pub fn restore(
        &mut self,
        slot: u64,
        queues_bits: &[u32],
        delivered_bits: &[u64],
        drawn_bits: Option<&[u64]>,
        features: &[u8],
    ) -> Result<(), CheckpointError> {
        let count = self.initial_bits.len();
        let is_of_field = [queues_bits.len(), delivered_bits.len()] == [count; 2]
            && drawn_bits.is_none_or(|drawn_bits| drawn_bits.len() == count)
            && drawn_bits.is_some() == self.drawn_bits.is_some();
        CheckpointError::ensure(is_of_field, POSSIBLE)?;
        let features = self.features.restored(slot, queues_bits, features)?;
        let sampling = self.sampling_of(&features);
        let sampled_bits = |sensor: usize| match drawn_bits {
            Some(drawn_bits) => drawn_bits[sensor],
            None => sampling.sampled_bits(sensor, slot),
        };
        let lost_bits = |sensor: usize| {
            let had_bits = u64::from(self.initial_bits[sensor]).checked_add(sampled_bits(sensor))?;
            let left_bits = had_bits.checked_sub(delivered_bits[sensor])?.checked_sub(queues_bits[sensor].into())?;
            (queues_bits[sensor] <= sampling.of(sensor).capacity_bits).then_some(left_bits)
        };
        let lost_bits = (0..count).map(lost_bits).try_fold(0u64, |sum, bits| sum.checked_add(bits?));
        CheckpointError::ensure(lost_bits.is_some(), POSSIBLE)?;
        let lost_bits = lost_bits.unwrap_or_default();
        let delivered = delivered_bits.iter().sum();
        let queued_bits = queues_bits.iter().copied().map(u64::from).sum();
        let sampled = delivered + lost_bits + queued_bits - self.totals.initial_bits;
        let totals = Totals { sampled_bits: sampled, delivered_bits: delivered, lost_bits, queued_bits, ..self.totals };
        self.totals = totals;
        self.features = features;
        self.sampling = sampling;
        self.queues.set(queues_bits);
        self.delivered_bits.copy_from_slice(delivered_bits);
        self.drawn_bits = drawn_bits.map(<[u64]>::to_vec);
        blocks(count).for_each(|sensors| self.sum_lost_slots(sensors, slot));
        Ok(())
    }

    /// Queue lengths [bit], by id.
    pub fn queues_bits(&self) -> &[u32] {
        self.queues.bits()
    }

    /// Replaces `answers` by what each SN does when it is served in the next slot, by id; by none if all send.
    pub fn fill_answers(&self, answers: &mut Vec<Answer>) {
        if self.may_refuse() {
            answers.clear();
            answers.resize(self.initial_bits.len(), Answer::Queue);
            self.features.raise(answers);
        }
    }

    /// Whether SNs may be dead or silent.
    pub fn may_refuse(&self) -> bool {
        self.features.may_refuse()
    }

    /// The sampling that fills the queues.
    pub fn sampling(&self) -> &Sampling {
        &self.sampling
    }

    /// Bits uploaded so far, by id.
    pub fn delivered_bits(&self) -> &[u64] {
        &self.delivered_bits
    }

    /// Bits sampled so far, by id, if arrivals are drawn, for a checkpoint.
    pub fn drawn_bits(&self) -> Option<&[u64]> {
        self.drawn_bits.as_deref()
    }

    /// Bits sampled by SN `sensor` up to the end of the last slot, `slot`.
    ///
    /// # Panics
    /// If the SN is unknown.
    pub fn sampled_bits(&self, sensor: usize, slot: u64) -> u64 {
        match &self.drawn_bits {
            Some(drawn_bits) => drawn_bits[sensor],
            None => self.sampling.sampled_bits(sensor, slot),
        }
    }

    /// Bits lost up to the end of the last slot, `slot`, by id.
    pub fn lost_bits(&self, slot: u64) -> impl Iterator<Item = u64> {
        let sensors = 0..self.initial_bits.len();
        self.lost_of_sampled(sensors.clone(), sensors.map(move |sensor| self.sampled_bits(sensor, slot)))
    }

    /// Bits lost by each of the consecutive `sensors`, which have sampled `sampled_bits`: what they had and neither
    /// delivered nor hold.
    ///
    /// The ledger does not store them: eight more bytes per SN would double the time of a slot with 10^6 full SNs (0.57
    /// instead of 0.28 ms).
    #[inline(always)]
    fn lost_of_sampled(
        &self,
        sensors: Range<usize>,
        sampled_bits: impl Iterator<Item = u64>,
    ) -> impl Iterator<Item = u64> {
        let initial_bits = self.initial_bits[sensors.clone()].iter().zip(sampled_bits);
        let left_bits = self.delivered_bits[sensors.clone()].iter().zip(&self.queues.bits()[sensors]);
        let had_bits = initial_bits.map(|(&initial_bits, sampled_bits)| u64::from(initial_bits) + sampled_bits);
        had_bits.zip(left_bits).map(|(had_bits, (delivered, &queue))| had_bits - delivered - u64::from(queue))
    }

    /// The field's totals.
    pub fn totals(&self) -> Totals {
        let lost_slots = match self.sampling.mean_bits {
            PerSensor::Equal(mean_bits) => self.totals.lost_bits as f64 / sampling_bits(mean_bits),
            PerSensor::Each(_) => self.lost_slots.iter().sum(),
        };
        Totals { lost_slots, ..self.totals }
    }

    /// All SNs sample in `slot`, which follows the last; returns the bits that they lose.
    pub fn sample(&mut self, slot: u64) -> u64 {
        blocks(self.initial_bits.len()).map(|sensors| self.sample_block(sensors, slot)).sum()
    }

    /// The SNs of a block of [`blocks`] sample in `slot`, which follows the last; returns the bits that they lose.
    ///
    /// # Panics
    /// If `sensors` reaches beyond the field.
    pub fn sample_block(&mut self, sensors: Range<usize>, slot: u64) -> u64 {
        self.unanswered.clear();
        let Sampled { sampled_bits, lost_bits } = if self.drawn_bits.is_none() && !self.features.stores() {
            self.queues.sample_block(sensors.clone(), &self.sampling, slot)
        } else {
            self.store_block(sensors.clone(), slot)
        };
        self.totals.sampled_bits += sampled_bits;
        self.totals.lost_bits += lost_bits;
        self.totals.queued_bits = self.totals.queued_bits + sampled_bits - lost_bits;
        if lost_bits > 0 {
            self.sum_lost_slots(sensors, slot);
        }
        lost_bits
    }

    /// As [`Self::sample_block`] where arrivals are drawn or a feature stores: the bits are counted one SN at a time.
    fn store_block(&mut self, sensors: Range<usize>, slot: u64) -> Sampled {
        let mut bits = [0; BLOCK];
        let bits = &mut bits[..sensors.len()];
        self.sampling.fill(slot, sensors.clone(), bits);
        if let Some(drawn_bits) = &mut self.drawn_bits {
            drawn_bits[sensors.clone()].iter_mut().zip(&*bits).for_each(|(sum, bits)| *sum += bits);
        }
        let queues_bits = self.queues.bits_mut(sensors.clone());
        match self.features.store(slot, sensors.clone(), bits, queues_bits, &self.sampling.capacity_bits) {
            Some(lost_bits) => Sampled { sampled_bits: bits.iter().sum(), lost_bits },
            None => self.queues.store_block(sensors, bits, &self.sampling),
        }
    }

    /// Updates the loss of a block up to the end of `slot`, if it is counted by block.
    fn sum_lost_slots(&mut self, sensors: Range<usize>, slot: u64) {
        let PerSensor::Each(mean_bits) = &self.sampling.mean_bits else { return };
        let block = sensors.start / BLOCK;
        let mean_bits = mean_bits[sensors.clone()].iter().copied();
        self.lost_slots[block] = if let Some(drawn_bits) = &self.drawn_bits {
            let sampled_bits = drawn_bits[sensors.clone()].iter().copied();
            in_slots(self.lost_of_sampled(sensors, sampled_bits), mean_bits)
        } else if self.sampling.is_quick(slot) {
            vectorized(|| {
                let sampled_bits = mean_bits.clone().map(|mean_bits| quick_bits(mean_bits, slot));
                in_slots(self.lost_of_sampled(sensors, sampled_bits), mean_bits)
            })
        } else {
            let sampled_bits = mean_bits.clone().map(|mean_bits| sampled_bits(mean_bits, slot));
            in_slots(self.lost_of_sampled(sensors, sampled_bits), mean_bits)
        };
    }

    /// Removes up to `capacity_bits` from a queue, and returns the bits removed: at most the queue.
    #[must_use]
    pub fn upload(&mut self, sensor: usize, capacity_bits: u64) -> u64 {
        let sent_bits = self.queues.upload(sensor, capacity_bits);
        self.features.upload(sensor, sent_bits);
        let taken_bits = u64::from(sent_bits);
        self.delivered_bits[sensor] += taken_bits;
        self.totals.delivered_bits += taken_bits;
        self.totals.queued_bits -= taken_bits;
        taken_bits
    }

    /// As [`Self::upload`] in `slot`, over a link of `rate_bps` [bit/s]: an SN that answers sends what it uploads, and
    /// others nothing.
    #[must_use]
    pub fn serve(&mut self, slot: u64, sensor: usize, capacity_bits: u64, rate_bps: f64) -> u64 {
        let answer = self.features.answer(sensor);
        if answer != Answer::Queue {
            self.features.refuse(sensor, answer);
            self.unanswered.push(sensor as u32);
            return 0;
        }
        let most_bits = self.features.most_bits(sensor, rate_bps);
        let bits = self.upload(sensor, capacity_bits.min(most_bits));
        self.features.serve(&NodeService { slot, sensor, bits, rate_bps });
        bits
    }

    /// Ends `slot` after its services, with `uavs` that wake the SNs in range. An SN that dies in it loses its queue,
    /// and from now on what it samples (decision D33). Returns the bits of the queues.
    pub fn end_slot(&mut self, slot: u64, uavs: &[Position]) -> u64 {
        if self.features.is_empty() {
            return 0;
        }
        let end = SlotEnd { slot, sampling: &self.sampling, queues_bits: self.queues.bits(), uavs };
        let died = self.features.end_slot(&end);
        let count = self.initial_bits.len();
        let mut lost_bits = 0;
        for of_block in died.chunk_by(|one, other| *one as usize / BLOCK == *other as usize / BLOCK) {
            for sensor in of_block.iter().map(|&sensor| sensor as usize) {
                let bits = self.queues.clear(sensor);
                self.features.discard(sensor, bits);
                self.sampling.capacity_bits.set(sensor, count, 0);
                lost_bits += u64::from(bits);
            }
            let first = of_block[0] as usize / BLOCK * BLOCK;
            self.sum_lost_slots(first..count.min(first + BLOCK), slot);
        }
        self.totals.lost_bits += lost_bits;
        self.totals.queued_bits -= lost_bits;
        lost_bits
    }
}

/// What is expected of a checkpoint.
const POSSIBLE: &str = "a possible state of this field";

/// What the loss of an SN is divided by [bit]: its mean, or infinity if it does not sample, as what expires there is no
/// loss in slots of sampling.
#[inline(always)]
fn sampling_bits(mean_bits: f64) -> f64 {
    if mean_bits > 0.0 { mean_bits } else { f64::INFINITY }
}

/// The loss of the SNs of a block [slots of sampling], `Σ_i lost_i / (s_i τ)`. Pairwise summation vectorizes and has
/// the same order on every processor.
#[inline(always)]
fn in_slots(lost_bits: impl Iterator<Item = u64>, mean_bits: impl Iterator<Item = f64>) -> f64 {
    let mut slots = [0.0; BLOCK];
    for ((slots, lost_bits), mean_bits) in slots.iter_mut().zip(lost_bits).zip(mean_bits) {
        *slots = lost_bits as f64 / sampling_bits(mean_bits);
    }
    let mut sums = &mut slots[..];
    while sums.len() > 1 {
        let (left, right) = sums.split_at_mut(sums.len() / 2);
        left.iter_mut().zip(right).for_each(|(left, right)| *left += *right);
        sums = left;
    }
    sums[0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::queues::overflow_bits;
    use proptest::prelude::*;

    /// A ledger of SNs with these means [bit per slot], one buffer and these queues [bit].
    fn ledger(capacity_bits: u32, mean_bits: &[f64], queues_bits: &[u32]) -> Ledger {
        let sampling = Sampling::new(mean_bits.to_vec(), vec![capacity_bits; mean_bits.len()]);
        Ledger::new(sampling, queues_bits.to_vec())
    }

    #[test]
    fn an_overflowing_queue_loses_exactly_the_excess() {
        let mut ledger = ledger(30_000, &[100.0, 30_001.0], &[29_950, 0]);
        assert_eq!(ledger.sample(1), 51); // 29 950 + 100 − 30 000, and 1
        assert_eq!(ledger.queues_bits(), [30_000, 30_000]);
        assert_eq!(ledger.lost_bits(1).collect::<Vec<_>>(), [50, 1]);
        assert!(ledger.totals().is_balanced());
        assert_eq!(ledger.totals().lost_slots, 50.0 / 100.0 + 1.0 / 30_001.0);
    }

    #[test]
    fn every_sensor_node_overflows_its_own_buffer() {
        let mut ledger = Ledger::new(Sampling::new(vec![100.0; 3], vec![150, 1_000, 50]), vec![100, 100, 0]);
        assert_eq!([ledger.sample(1), ledger.upload(0, 120), ledger.sample(2)], [50 + 50, 120, 100]);
        assert_eq!(ledger.queues_bits(), [130, 300, 50]);
        assert_eq!(ledger.lost_bits(2).collect::<Vec<_>>(), [50, 0, 150]);
        assert!(ledger.totals().is_balanced());
    }

    #[test]
    fn bits_beyond_any_buffer_are_counted_exactly() {
        let mut ledger = ledger(u32::MAX, &[(1u64 << 33) as f64], &[7]);
        assert_eq!(ledger.sample(1), (1 << 33) + 7 - u64::from(u32::MAX));
        assert_eq!(ledger.sample(2), 1 << 33);
        assert_eq!(ledger.totals().sampled_bits, 1 << 34);
        assert!(ledger.totals().is_balanced());
    }

    #[test]
    fn uploaded_bits_are_counted() {
        let mut ledger = ledger(30_000, &[100.0], &[700]);
        assert_eq!([500, 500].map(|capacity_bits| ledger.upload(0, capacity_bits)), [500, 200]);
        assert_eq!((ledger.totals().delivered_bits, ledger.delivered_bits()), (700, &[700][..]));
    }

    #[test]
    fn an_impossible_ledger_state_is_refused() {
        let new = || ledger(10, &[5.0, 4.0], &[1, 2]);
        let mut ledger = new();
        for (queues_bits, delivered_bits) in [
            (&[3][..], &[1, 2][..]),
            (&[3, 4], &[1]),
            (&[11, 0], &[0, 0]), // more than the buffer
            (&[3, 4], &[4, 0]),  // 3 + 4 of 1 + 5
            (&[3, 4], &[0, u64::MAX]),
        ] {
            let restored = ledger.restore(1, queues_bits, delivered_bits, None, &[]);
            assert!(restored.is_err(), "{queues_bits:?}, {delivered_bits:?}");
            assert_eq!(ledger, new());
        }
        ledger.restore(1, &[3, 4], &[2, 2], None, &[]).unwrap();
        assert_eq!((ledger.queues_bits(), ledger.delivered_bits()), (&[3, 4][..], &[2, 2][..]));
        let totals = Totals { sampled_bits: 9, delivered_bits: 4, lost_bits: 1, queued_bits: 7, ..new().totals() };
        assert_eq!(ledger.totals(), Totals { lost_slots: 0.2, ..totals }); // 1 + 5 − 2 − 3 bits are lost
    }

    #[test]
    #[should_panic(expected = "exceeds the buffer")]
    fn an_initial_queue_above_the_buffer_is_refused() {
        let _ = ledger(10, &[1.0, 1.0], &[3, 11]);
    }

    proptest! {
        #[test]
        fn every_bit_is_accounted_for(
            capacity_bits in 1u32..50_000,
            mean_bits in prop_oneof![
                prop::collection::vec(0.0f64..80_000.0, 4),
                (0.0f64..80_000.0).prop_map(|mean| vec![mean; 4]),
            ],
            uploads in prop::collection::vec((0usize..4, 0u64..80_000), 1..200),
        ) {
            let initial_bits = [0, 1, capacity_bits / 2, capacity_bits];
            let mut kept = ledger(capacity_bits, &mean_bits, &initial_bits);
            let mut lost_bits = [0; 4];
            let mut lost_slots = 0.0;
            for (slot, (sensor, capacity)) in (1u64..).zip(uploads) {
                let before_bits = kept.queues_bits().to_vec();
                let all_bits = kept.sample(slot);
                for id in 0..4 {
                    let lost = overflow_bits(&kept.sampling().of(id), before_bits[id], slot - 1, slot);
                    lost_bits[id] += lost;
                    lost_slots += if lost > 0 { lost as f64 / mean_bits[id] } else { 0.0 };
                }
                let _ = kept.upload(sensor, capacity);
                let queued_bits: u64 = kept.queues_bits().iter().copied().map(u64::from).sum();
                prop_assert_eq!(queued_bits, kept.totals().queued_bits);
                prop_assert!(kept.totals().is_balanced() && all_bits <= kept.totals().lost_bits);
                prop_assert_eq!(kept.lost_bits(slot).collect::<Vec<_>>(), lost_bits);
                prop_assert!((kept.totals().lost_slots - lost_slots).abs() <= 1e-9 * lost_slots);
                let mut restored = ledger(capacity_bits, &mean_bits, &initial_bits);
                restored.restore(slot, kept.queues_bits(), kept.delivered_bits(), None, &[]).unwrap();
                prop_assert_eq!(&restored, &kept);
            }
        }
    }
}
