//! Bounds on what a mission delivers, and on when all of it is delivered, by the best links.

use super::field_bits::{FieldBits, SensorBits};

/// Margin on sums of bits against rounding, relative to them.
const SUM_MARGIN: f64 = 1e-12;

/// What the sensor nodes (SNs) hold and sample, and what their links carry at most.
pub struct Offer<'a, Links> {
    /// The SNs that hold or sample data.
    pub field: &'a FieldBits,
    /// At most so much [bit] is carried in a slot of the SN at an index.
    pub link_bits: Links,
}

/// The services that take all data of an SN: all but the last take `most_bits`.
struct Services {
    most_bits: u64,
    count: u64,
    last_bits: u64,
}

impl<Links: Fn(u64, usize) -> u64> Offer<'_, Links> {
    /// Upper bound on the bits that any flight delivers, each by the factor of its SN, by index.
    ///
    /// In each slot the `U n` links that carry most are served, of the SNs that can be reached by then. And all slots
    /// together have `U n` services each, of which an SN takes as many as it has data for.
    pub fn delivered_bits(&self, factor: impl Fn(usize) -> f64) -> f64 {
        let data_bits = |(index, sensor): (usize, &SensorBits)| factor(index) * self.data_bits(sensor) as f64;
        let total_bits: f64 = self.field.sensors.iter().enumerate().map(data_bits).sum();
        let by_slots: f64 = (1..=self.field.slots).map(|slot| self.carried_bits(slot, &factor)).sum();
        (by_slots.min(self.by_services(&factor)) * (1.0 + SUM_MARGIN)).min(total_bits)
    }

    /// Lower bound on the slots after which all data is delivered, for SNs that do not sample; `None` if it never is.
    pub fn least_slots(&self) -> Option<u64> {
        let mut services = 0u64;
        let mut slots = 0;
        for (index, sensor) in self.field.sensors.iter().enumerate() {
            let count = self.services(index, sensor)?.count;
            services = services.saturating_add(count);
            slots = slots.max(sensor.first_slot? - 1 + count);
        }
        let slots = slots.max(services.div_ceil(self.field.blocks as u64));
        (slots <= self.field.slots).then_some(slots)
    }

    /// What an SN holds and samples [bit].
    pub fn data_bits(&self, sensor: &SensorBits) -> u64 {
        u64::from(sensor.queue_bits) + sensor.sampled_bits(self.field.slots)
    }

    /// What a slot carries at most [bit], by the factors of SNs.
    fn carried_bits(&self, slot: u64, factor: impl Fn(usize) -> f64) -> f64 {
        let reached = self.field.sensors.iter().enumerate().filter(|(_, sensor)| sensor.is_reached(slot));
        let link_bits = |index: usize, sensor: &SensorBits| (self.link_bits)(slot, index).min(sensor.buffer_bits());
        let mut carried: Vec<f64> =
            reached.map(|(index, sensor)| factor(index) * link_bits(index, sensor) as f64).collect();
        let blocks = self.field.blocks.min(carried.len());
        if blocks < carried.len() {
            carried.select_nth_unstable_by(blocks, |a, b| b.total_cmp(a));
        }
        carried[..blocks].iter().sum()
    }

    /// What the services of all slots take at most [bit], by the factors of SNs.
    fn by_services(&self, factor: impl Fn(usize) -> f64) -> f64 {
        let mut offers: Vec<(f64, u64)> = Vec::new(); // the value of a service, and how many have it
        for (index, sensor) in self.field.sensors.iter().enumerate() {
            let Some(first_slot) = sensor.first_slot else { continue };
            let Some(Services { most_bits, count, last_bits }) = self.services(index, sensor) else { continue };
            let slots = (self.field.slots + 1).saturating_sub(first_slot);
            let full = (count - 1).min(slots);
            offers.extend([
                (factor(index) * most_bits as f64, full),
                (factor(index) * last_bits as f64, u64::from(slots > full)),
            ]);
        }
        offers.sort_by(|(a, _), (b, _)| b.total_cmp(a));
        let mut blocks = self.field.slots.saturating_mul(self.field.blocks as u64);
        let taken = |(bits, count): (f64, u64)| {
            let services = count.min(blocks);
            blocks -= services;
            bits * services as f64
        };
        offers.into_iter().map(taken).sum()
    }

    /// The fewest services that take all data of an SN; `None` if its links never carry a bit. Without data, one of 0
    /// bit.
    fn services(&self, index: usize, sensor: &SensorBits) -> Option<Services> {
        let data_bits = self.data_bits(sensor);
        let most_bits = (1..=self.field.slots).map(|slot| (self.link_bits)(slot, index)).max()?;
        let most_bits = most_bits.min(sensor.buffer_bits());
        let count = data_bits.checked_sub(1).map_or(Some(0), |last| last.checked_div(most_bits))? + 1;
        Some(Services { most_bits, count, last_bits: data_bits - (count - 1) * most_bits })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::sampling::Sampler;

    /// SNs that hold data [bit] and do not sample, each from a first slot on.
    fn field(slots: u64, blocks: usize, sensors: &[(u32, u64)]) -> FieldBits {
        let sensor = |&(queue_bits, first_slot): &(u32, u64)| SensorBits {
            sampler: Sampler { mean_bits: 0.0, capacity_bits: queue_bits.max(1), lasting_slots: f64::INFINITY },
            drawn_bits: None,
            queue_bits,
            first_slot: Some(first_slot),
        };
        FieldBits { sensors: sensors.iter().map(sensor).collect(), slots, blocks, beyond_buffers_bits: 0 }
    }

    #[test]
    fn data_is_delivered_by_the_best_links_in_reach() {
        // 6 slots, one link of 10 or 4 bit a slot; the strong one is in reach from slot 3 on, and holds 25 bit: 4 + 4
        // in slots 1 and 2. By slots 4 · 10 + 8 = 48; by services 10 + 10 + 5 and three of 4: 37.
        let field = field(6, 1, &[(25, 3), (100, 1)]);
        let offer = Offer { field: &field, link_bits: |_: u64, index: usize| [10u64, 4][index] };
        let bits = offer.delivered_bits(|_| 1.0);
        assert!((bits - 37.0).abs() < 1e-9, "{bits}");
        // Bits of the second count three times: 6 services of 12.
        let weighted = offer.delivered_bits(|index| [1.0, 3.0][index]);
        assert!((weighted - 72.0).abs() < 1e-9, "{weighted}");
        assert_eq!(offer.least_slots(), None); // 25 services of the second alone
    }

    #[test]
    fn all_is_delivered_after_the_services_that_it_takes() {
        // 25 bit by 10 and 8 by 4: 3 + 2 services, in 5 slots with one block, and in slots 3 to 5 with two.
        for (blocks, slots) in [(1, 5), (2, 5), (3, 5)] {
            let field = field(9, blocks, &[(25, 3), (8, 1)]);
            let offer = Offer { field: &field, link_bits: |_: u64, index: usize| [10u64, 4][index] };
            assert_eq!(offer.least_slots(), Some(slots), "{blocks} blocks");
            assert_eq!(offer.delivered_bits(|_| 1.0), 33.0);
        }
        let field = field(9, 2, &[(25, 1), (8, 1)]);
        let slots =
            |rates: [u64; 2]| Offer { field: &field, link_bits: |_: u64, index: usize| rates[index] }.least_slots();
        assert_eq!([slots([10, 4]), slots([10, 0]), slots([3, 4])], [Some(3), None, Some(9)]);
    }

    #[test]
    fn no_flight_of_few_slots_delivers_more() {
        // Every schedule of two SNs over 5 slots, with links that change by slot.
        let link_bits = |slot: u64, index: usize| [[3u64, 9, 1, 7, 2], [8, 2, 6, 4, 5]][index][slot as usize - 1];
        for (held, blocks) in [([10, 20], 1), ([30, 4], 1), ([5, 5], 1), ([19, 11], 2), ([100, 100], 2)] {
            let field = field(5, blocks, &[(held[0], 1), (held[1], 2)]);
            let offer = Offer { field: &field, link_bits };
            let mut most = 0;
            let mut least_slots = None::<u64>;
            let choices: u32 = if blocks == 1 { 2 } else { 1 };
            for plan in 0..choices.pow(5) {
                let mut left = held;
                for slot in 1..=5u64 {
                    for (index, left_bits) in left.iter_mut().enumerate() {
                        let is_served = blocks == 2 || (plan >> (slot - 1)) & 1 == index as u32;
                        if is_served && slot >= [1, 2][index] {
                            *left_bits -= (*left_bits).min(link_bits(slot, index) as u32);
                        }
                    }
                    if left == [0, 0] {
                        least_slots = Some(least_slots.map_or(slot, |least| least.min(slot)));
                    }
                }
                most = most.max(held[0] + held[1] - left[0] - left[1]);
            }
            assert!(offer.delivered_bits(|_| 1.0) >= f64::from(most), "{held:?}: {most}");
            if let Some(slots) = least_slots {
                assert!(offer.least_slots().is_some_and(|least| least <= slots), "{held:?}: {slots}");
            }
        }
    }
}
