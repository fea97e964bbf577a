//! Bound on the loss by throughput: in each slot at most n links carry at most their capacities.

use super::field_bits::FieldBits;
use super::margins::RELATIVE_MARGIN;

/// Lower bound on the loss [bit] of every flight, if the link of the sensor node `sensor` of the field carries at most
/// `link_bits(slot, sensor)` [bit].
///
/// For the sensor nodes (SNs) that overflow if never served: the bits that they hold and sample, less their buffers,
/// less the uploads before the last slot. A slot uploads from at most n of them, each at most the capacity of its link
/// and its buffer, and only from those that can be reached by then. In the last slot the overflow precedes the upload
/// (decision D1).
#[must_use]
pub fn by_throughput(field: &FieldBits, link_bits: impl Fn(u64, usize) -> u64) -> u64 {
    let (mut excess_bits, overflowing) = overflowing(field);
    let mut carried = Vec::with_capacity(overflowing.len());
    for slot in 1..field.slots {
        if excess_bits == 0 {
            break;
        }
        carried.clear();
        let reached = overflowing.iter().filter(|index| field.sensors[**index].is_reached(slot));
        carried.extend(reached.map(|&index| link_bits(slot, index).min(field.sensors[index].buffer_bits())));
        let blocks = field.blocks.min(carried.len());
        if blocks < carried.len() {
            carried.select_nth_unstable_by(blocks, |a, b| b.cmp(a));
        }
        excess_bits = excess_bits.saturating_sub(carried[..blocks].iter().sum());
    }
    excess_bits
}

/// Lower bound on the mean loss [bit] over the draws of a random channel, without knowledge of future draws, if every
/// link is expected to carry at most `expected_bits(slot)` [bit] of a queue of at most the largest buffer.
#[must_use]
pub fn by_expected_throughput(field: &FieldBits, mut expected_bits: impl FnMut(u64) -> f64) -> f64 {
    let (excess_bits, overflowing) = overflowing(field);
    let mut first_slots: Vec<u64> = overflowing.iter().filter_map(|&index| field.sensors[index].first_slot).collect();
    first_slots.sort_unstable();
    let mut carried_bits = 0.0;
    for slot in 1..field.slots {
        if carried_bits >= excess_bits as f64 {
            return 0.0;
        }
        let reached = first_slots.partition_point(|first| *first <= slot);
        carried_bits += expected_bits(slot) * reached.min(field.blocks) as f64;
    }
    ((excess_bits as f64) * (1.0 - RELATIVE_MARGIN) - carried_bits * (1.0 + RELATIVE_MARGIN)).max(0.0)
}

/// The SNs that overflow if never served, by index, and the bits that they hold and sample in the mission beyond their
/// buffers.
fn overflowing(field: &FieldBits) -> (u64, Vec<usize>) {
    let excess = field.sensors.iter().map(|sensor| sensor.overflow_bits(None, field.slots));
    let overflowing: Vec<(usize, u64)> = excess.enumerate().filter(|(_, bits)| *bits > 0).collect();
    let bits = overflowing.iter().map(|(_, bits)| bits).sum();
    (bits, overflowing.into_iter().map(|(index, _)| index).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bound::field_bits::SensorBits;
    use skysink_common::sampling::Sampler;

    /// Two SNs that sample 10 bit a slot into full buffers of 20 bit over 5 slots, 50 bit of overflow each. The second
    /// can be served from slot 3 on.
    fn field_of(blocks: usize) -> FieldBits {
        let sampler = Sampler { mean_bits: 10.0, capacity_bits: 20, lasting_slots: f64::INFINITY };
        let sensor =
            |first_slot| SensorBits { sampler, drawn_bits: None, queue_bits: 20, first_slot: Some(first_slot) };
        FieldBits { sensors: vec![sensor(1), sensor(3)], slots: 5, blocks, beyond_buffers_bits: 0 }
    }

    #[test]
    fn bits_carried_by_the_best_links_in_reach_are_not_lost() {
        let link_bits = |_slot, index: usize| [7, 100][index];
        // In slots 1 and 2 one link of 7 bit, in slots 3 and 4 one that carries a full buffer: 100 − 54.
        assert_eq!(by_throughput(&field_of(1), link_bits), 46);
        // Both links in slots 3 and 4: 100 − 2 · 7 − 2 · 27.
        assert_eq!(by_throughput(&field_of(2), link_bits), 32);
    }

    #[test]
    fn random_links_carry_their_expected_bits() {
        // One link of 6 bit in slots 1 and 2, two in slots 3 and 4: 100 − 36.
        assert!((by_expected_throughput(&field_of(2), |_| 6.0) - 64.0).abs() < 1e-6);
        assert!((by_expected_throughput(&field_of(1), |_| 6.0) - 76.0).abs() < 1e-6);
        assert_eq!(by_expected_throughput(&field_of(1), |_| 50.0), 0.0);
    }
}
