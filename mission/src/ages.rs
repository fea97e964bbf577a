//! Ages of information: since the last service of each sensor node (SN), and of the delivered data.
//!
//! Definitions in `docs/src/metrics.md`. Ages are counted in whole slots, so that their mean and quantiles are exact.

use std::collections::VecDeque;
use std::ops::Range;

use skysink_common::nodes::keys::Overflow;
use skysink_common::sampling::Sampling;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::{Sensor, SensorList};
use skysink_field_sim::Field;

/// The age of one SN after each slot: `slot − stamp` from slot `from` on, until the next refresh. A mission has at most
/// 10⁹ slots.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AgeRun {
    from: u32,
    stamp: u32,
}

impl AgeRun {
    /// An age since the mission's start.
    pub const FIRST: Self = Self { from: 1, stamp: 0 };

    /// The ages [slots] after the slots before `end`.
    #[must_use]
    pub fn ages(self, end: u64) -> Range<u64> {
        (self.from - self.stamp).into()..end - u64::from(self.stamp)
    }

    /// Lets the age count from slot `stamp`, from `slot` on. Returns the ages [slots] of the slots before `slot`.
    pub fn refresh(&mut self, slot: u64, stamp: u64) -> Range<u64> {
        let ages = self.ages(slot);
        *self = Self { from: slot as u32, stamp: stamp as u32 };
        ages
    }
}

/// The ages of all SNs after each slot.
#[derive(Debug, Clone)]
pub struct Ages {
    runs: Vec<AgeRun>,
    counts: AgeCounts,
}

impl Ages {
    /// Ages since the mission's start.
    #[must_use]
    pub fn new(sensors: usize) -> Self {
        Self { runs: vec![AgeRun::FIRST; sensors], counts: AgeCounts::default() }
    }

    /// Lets the age of the SN count from slot `stamp`, from `slot` on.
    pub fn refresh(&mut self, sensor: usize, slot: u64, stamp: u64) {
        self.counts.add(self.runs[sensor].refresh(slot, stamp));
    }

    /// Histogram of the ages up to the end of `slot`, over the SNs that `is_counted` selects. Only these may have been
    /// refreshed.
    pub fn counts(&self, slot: u64, is_counted: impl Fn(usize) -> bool) -> AgeCounts {
        let mut counts = self.counts.clone();
        let counted = self.runs.iter().enumerate().filter(|(sensor, _)| is_counted(*sensor));
        counted.for_each(|(_, run)| counts.add(run.ages(slot + 1)));
        counts
    }
}

/// The sum of consecutive numbers.
pub(crate) fn sum(ages: &Range<u64>) -> u64 {
    let count = ages.end.saturating_sub(ages.start);
    count * (ages.start + ages.end).saturating_sub(1) / 2
}

/// Histogram of ages [slots], stored as differences of consecutive counts.
#[derive(Debug, Clone, Default)]
pub struct AgeCounts(Vec<i64>);

impl AgeCounts {
    /// Counts each of these ages once.
    fn add(&mut self, ages: Range<u64>) {
        let [first, end] =
            [ages.start, ages.end].map(|age| usize::try_from(age).expect("a mission that fits in memory"));
        if self.0.len() <= end {
            self.0.resize(end + 1, 0);
        }
        self.0[first] += 1;
        self.0[end] -= 1;
    }

    /// The ages with their counts, ascending.
    fn by_age(&self) -> impl Iterator<Item = (u64, u64)> {
        let count = |count: &mut i64, change: &i64| {
            *count += change;
            Some(u64::try_from(*count).expect("a run ends after it begins"))
        };
        (0..).zip(self.0.iter().scan(0, count))
    }

    fn samples(&self) -> u64 {
        self.by_age().map(|(_, count)| count).sum()
    }

    /// Mean age [slots]; 0 without samples.
    pub fn mean(&self) -> f64 {
        let sum: u64 = self.by_age().map(|(age, count)| age * count).sum();
        let samples = self.samples();
        if samples == 0 { 0.0 } else { sum as f64 / samples as f64 }
    }

    /// The least age [slots] that is not exceeded by a fraction `q` of the samples (nearest rank).
    pub fn quantile(&self, q: f64) -> u64 {
        let rank = (q * self.samples() as f64).ceil() as u64;
        let mut seen = 0;
        for (age, count) in self.by_age() {
            seen += count;
            if seen >= rank {
                return age;
            }
        }
        0
    }
}

/// The ages of the delivered data, from the sampling times of the stored bits.
///
/// A buffer is a first-in-first-out queue, and the freshest delivered bit is the last one uploaded. A full buffer drops
/// the newest bits (decision D1), so that the bits stored between two uploads are the first of those sampled then, or
/// the oldest: then the stored bits are the last of all. Where bits expire, the ledger knows their slots.
#[derive(Debug, Clone)]
pub struct DeliveredData {
    sampling: Sampling,
    overflow: Overflow,
    backlogs: Vec<Backlog>,
    ages: Ages,
}

/// The stored bits of one SN, by sampling time.
#[derive(Debug, Clone)]
struct Backlog {
    delivered_bits: u64,
    /// The slot of the last upload, and the bits sampled up to its end.
    counted: [u64; 2],
    /// The batch of the last delivered bit, or of the next.
    batch: Batch,
    /// The batches after it, ascending; empty after the buffer was emptied.
    later: VecDeque<Batch>,
}

/// The bits stored from one upload to the next.
#[derive(Debug, Clone, Copy)]
struct Batch {
    /// Bits sampled up to the first upload, `A_i`, including lost ones.
    after_sampled_bits: u64,
    /// Bits stored up to the first upload, including the initial queue.
    after_bits: u64,
}

/// What an SN has delivered after a slot.
#[derive(Debug, Clone, Copy)]
pub struct Delivered {
    /// Since the mission's start [bit].
    pub bits: u64,
    /// What it holds [bit].
    pub queue_bits: u64,
    /// The slot that has sampled the last bit delivered, where the ledger knows it.
    pub freshest_slot: Option<u64>,
}

impl Delivered {
    /// What SN `sensor` of `field` has delivered.
    ///
    /// # Panics
    /// If the SN is unknown.
    #[must_use]
    pub fn of(field: &Field, sensor: usize) -> Self {
        Self {
            bits: field.delivered_bits()[sensor],
            queue_bits: field.queues_bits()[sensor].into(),
            freshest_slot: field.freshest_slot(sensor),
        }
    }
}

impl DeliveredData {
    /// The state before slot 1.
    #[must_use]
    pub fn new(scenario: &Scenario, list: &SensorList) -> Self {
        let queues_bits = list.sensors().iter().map(|sensor: &Sensor| sensor.queue_bits);
        Self::over(list.sampling(scenario), scenario.sensors.overflow.unwrap_or_default(), queues_bits)
    }

    fn over(sampling: Sampling, overflow: Overflow, queues_bits: impl Iterator<Item = u32>) -> Self {
        let backlogs: Vec<Backlog> = queues_bits.map(Backlog::new).collect();
        Self { sampling, overflow, ages: Ages::new(backlogs.len()), backlogs }
    }

    /// Adds a service of an SN in `slot`. A service without data is ignored, and bits of the initial queue do not
    /// change the age.
    pub fn add(&mut self, sensor: usize, slot: u64, delivered: Delivered) {
        let Delivered { bits: delivered_bits, queue_bits, freshest_slot } = delivered;
        let backlog = &mut self.backlogs[sensor];
        if delivered_bits <= backlog.delivered_bits {
            return;
        }
        if let Some(stamp) = freshest_slot {
            backlog.delivered_bits = delivered_bits;
            if stamp > 0 {
                self.ages.refresh(sensor, slot, stamp);
            }
            return;
        }
        let sampled_bits = self.sampling.counted_bits(sensor, backlog.counted, slot);
        backlog.counted = [slot, sampled_bits];
        let last = match self.overflow {
            Overflow::Newest => backlog.deliver(sampled_bits, delivered_bits, queue_bits),
            Overflow::Oldest => {
                backlog.delivered_bits = delivered_bits;
                sampled_bits.checked_sub(queue_bits).filter(|bit| *bit > 0)
            }
        };
        if let Some(bit) = last {
            let stamp = self.sampling.slot_of_bit(sensor, bit, backlog.counted);
            self.ages.refresh(sensor, slot, stamp);
        }
    }

    /// Histogram of the ages up to the end of `slot`, over the SNs that sample.
    pub fn counts(&self, slot: u64) -> AgeCounts {
        self.ages.counts(slot, |sensor| self.sampling.of(sensor).mean_bits > 0.0)
    }
}

impl Backlog {
    fn new(queue_bits: u32) -> Self {
        let batch = Batch { after_sampled_bits: 0, after_bits: queue_bits.into() };
        Self { delivered_bits: 0, counted: [0; 2], batch, later: VecDeque::new() }
    }

    /// Adds an upload, by which `sampled_bits` were sampled, and returns the number of its last bit among them; `None`
    /// for a bit of the initial queue.
    fn deliver(&mut self, sampled_bits: u64, delivered_bits: u64, queue_bits: u64) -> Option<u64> {
        while let Some(next) = self.later.pop_front_if(|next| next.after_bits < delivered_bits) {
            self.batch = next;
        }
        let offset_bits = delivered_bits.saturating_sub(self.batch.after_bits);
        let bit = self.batch.after_sampled_bits + offset_bits;
        let next = Batch { after_sampled_bits: sampled_bits, after_bits: delivered_bits + queue_bits };
        self.delivered_bits = delivered_bits;
        if queue_bits == 0 {
            self.batch = next;
            self.later.clear();
        } else {
            self.later.push_back(next);
        }
        (offset_bits > 0).then_some(bit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use skysink_common::arrivals::Poisson;
    use skysink_common::ledger::Ledger;
    use skysink_common::nodes::NodeFeature;
    use skysink_common::nodes::expiry::{Cohorts, Expiry};
    use skysink_common::random::Streams;

    #[test]
    fn ages_count_slots_since_the_last_service() {
        let mut ages = Ages::new(2);
        for (slot, sensor) in [(2, 0), (4, 0), (4, 1)] {
            ages.refresh(sensor, slot, slot);
        }
        // Ages after slots 1 to 4: SN 0: 1, 0, 1, 0; SN 1: 1, 2, 3, 0.
        let counts = ages.counts(4, |_| true);
        assert_eq!(counts.by_age().map(|(_, count)| count).collect::<Vec<_>>(), [3, 3, 1, 1, 0]);
        assert_eq!((counts.mean(), counts.quantile(0.99), counts.quantile(0.75)), (1.0, 3, 1));
    }

    #[test]
    fn ages_are_0_without_sensor_nodes() {
        let counts = Ages::new(2).counts(9, |_| false);
        assert_eq!((counts.mean(), counts.quantile(0.99)), (0.0, 0));
    }

    /// Mean and 99th percentile of ages [slots], one by one.
    fn by_hand(mut ages: Vec<u64>) -> (f64, u64) {
        ages.sort_unstable();
        let mean = ages.iter().sum::<u64>() as f64 / ages.len().max(1) as f64;
        (mean, if ages.is_empty() { 0 } else { ages[(ages.len() * 99).div_ceil(100) - 1] })
    }

    /// A sensor node bit by bit: a queue of the slots in which its bits were sampled.
    struct BitQueue {
        slots: VecDeque<u64>,
        freshest: u64,
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(500))]

        #[test]
        fn ages_agree_with_a_direct_count(services in prop::collection::vec((0usize..7, 1u64..40), 0..60)) {
            let mut ages = Ages::new(7);
            let mut last = [0; 7];
            let mut seen = Vec::new();
            let mut slot = 0;
            for (sensor, wait) in services {
                for _ in 0..wait {
                    slot += 1;
                    if slot % wait == 0 && last[sensor] < slot {
                        last[sensor] = slot;
                        ages.refresh(sensor, slot, slot);
                    }
                    seen.extend(last.iter().map(|last| slot - last));
                }
            }
            let counts = ages.counts(slot, |_| true);
            prop_assert_eq!((counts.mean(), counts.quantile(0.99)), by_hand(seen));
        }

        #[test]
        fn data_ages_agree_with_a_fifo_of_single_bits(
            means in prop::collection::vec(
                prop_oneof![Just(0.0), Just(0.1), Just(1.0 / 3.0), Just(1.0), Just(2.5), 0.0..9.0f64], 1..4),
            capacity_bits in 1u32..30,
            initial_bits in 0u32..30,
            is_drawn in any::<bool>(),
            overflow in prop_oneof![Just(Overflow::Newest), Just(Overflow::Oldest)],
            expiry_slots in prop_oneof![Just(None), (1u64..9).prop_map(Some)],
            uploads in prop::collection::vec((0usize..6, 0u64..20), 1..80),
        ) {
            let initial_bits = initial_bits.min(capacity_bits);
            let drawn = Poisson::new(2.0, Streams::new(initial_bits.into()));
            let sampling = Sampling::new(means.clone(), vec![capacity_bits; means.len()])
                .with_arrivals(is_drawn.then(|| drawn.into()));
            let queues_bits = vec![initial_bits; means.len()];
            let cohorts = expiry_slots.map(|slots| Cohorts::new(Expiry { slots, overflow }, &queues_bits));
            let features = cohorts.map(NodeFeature::from).into_iter().collect();
            let mut ledger = Ledger::new(sampling.clone(), queues_bits).with_features(features);
            let mut queues: Vec<BitQueue> = means.iter()
                .map(|_| BitQueue { slots: VecDeque::from(vec![0; initial_bits as usize]), freshest: 0 }).collect();
            let mut data = DeliveredData::over(sampling.clone(), overflow, means.iter().map(|_| initial_bits));
            let mut ages = Vec::new();
            for (slot, &(served, link_bits)) in (1u64..).zip(&uploads) {
                let _ = ledger.sample(slot);
                for (sensor, queue) in queues.iter_mut().enumerate() {
                    queue.slots.retain(|sampled| expiry_slots.is_none_or(|slots| slot - sampled <= slots));
                    queue.slots.extend(vec![slot; sampling.bits(sensor, slot) as usize]);
                    let excess = queue.slots.len().saturating_sub(capacity_bits as usize);
                    match overflow {
                        Overflow::Newest => queue.slots.truncate(capacity_bits as usize),
                        Overflow::Oldest => _ = queue.slots.drain(..excess),
                    }
                }
                if served < means.len() {
                    let _ = ledger.upload(served, link_bits);
                    data.add(served, slot, Delivered {
                        bits: ledger.delivered_bits()[served],
                        queue_bits: ledger.queues_bits()[served].into(),
                        freshest_slot: ledger.features().freshest_slot(served),
                    });
                    for _ in 0..link_bits {
                        if let Some(sampled) = queues[served].slots.pop_front() {
                            queues[served].freshest = sampled;
                        }
                    }
                }
                for (queue, &mean) in queues.iter().zip(&means) {
                    ages.extend((mean > 0.0).then_some(slot - queue.freshest));
                }
            }
            let counts = data.counts(uploads.len() as u64);
            prop_assert_eq!((counts.mean(), counts.quantile(0.99)), by_hand(ages));
        }
    }
}
