//! Loss that no flight avoids, because the links of n sensor nodes carry only so much in every slot.

use super::field_bits::FieldBits;

/// Keeps a sum of expectations from being rounded down, relative to it.
const ROUNDING: f64 = 1e-9;

/// A lower bound on the loss [bit] of every flight, if the link of the sensor node `sensor` of the field carries at most
/// `link_bits(slot, sensor)` [bit].
///
/// Of the sensor nodes (SNs) that overflow if nobody serves them: what they hold and sample, less what fits into their
/// buffers, less what was uploaded before the last slot. A slot uploads from n of them, each no more than its link
/// carries and its buffer holds, and from none that cannot be reached yet. In the last slot the overflow comes before
/// the upload (decision D1).
#[must_use]
pub fn by_throughput(field: &FieldBits, link_bits: impl Fn(u64, usize) -> u64) -> u64 {
    let (mut excess_bits, overflowing) = overflowing(field);
    let mut carried = Vec::with_capacity(overflowing.len());
    for slot in 1..field.slots {
        if excess_bits == 0 {
            break;
        }
        carried.clear();
        for &index in &overflowing {
            let sensor = &field.sensors[index];
            if sensor.first_slot <= slot {
                carried.push(link_bits(slot, index).min(sensor.capacity_bits));
            }
        }
        let blocks = field.blocks.min(carried.len());
        if blocks < carried.len() {
            carried.select_nth_unstable_by(blocks, |a, b| b.cmp(a));
        }
        excess_bits = excess_bits.saturating_sub(carried[..blocks].iter().sum());
    }
    excess_bits
}

/// The same of the mean loss [bit] over the draws of a random channel, for whoever does not know them in advance, if
/// every link is expected to carry at most `expected_bits(slot)` [bit], of no more than the largest buffer.
#[must_use]
pub fn by_expected_throughput(field: &FieldBits, expected_bits: impl Fn(u64) -> f64) -> f64 {
    let (excess_bits, overflowing) = overflowing(field);
    let mut first_slots: Vec<u64> = overflowing.iter().map(|&index| field.sensors[index].first_slot).collect();
    first_slots.sort_unstable();
    let mut carried_bits = 0.0;
    for slot in 1..field.slots {
        if carried_bits >= excess_bits as f64 {
            return 0.0;
        }
        let reached = first_slots.partition_point(|first| *first <= slot);
        carried_bits += expected_bits(slot) * reached.min(field.blocks) as f64;
    }
    ((excess_bits as f64) * (1.0 - ROUNDING) - carried_bits * (1.0 + ROUNDING)).max(0.0)
}

/// What the SNs that overflow if nobody serves them hold and sample in the mission beyond their buffers [bit], and
/// which they are.
fn overflowing(field: &FieldBits) -> (u64, Vec<usize>) {
    let excess = field.sensors.iter().map(|sensor| sensor.overflow_bits(None, field.slots));
    let overflowing: Vec<(usize, u64)> = excess.enumerate().filter(|(_, bits)| *bits > 0).collect();
    let bits = overflowing.iter().map(|(_, bits)| bits).sum();
    (bits, overflowing.into_iter().map(|(index, _)| index).collect())
}
