//! Bound on the loss by visits: only a limited number of sensor nodes can be served in a number of slots.
//!
//! The capacities of links are ignored: a visit is assumed to empty the queue.

use std::cmp::Ordering;
use std::iter::Sum;

use super::field_bits::FieldBits;

/// Most gaps between visits that are compared.
const GAPS: u64 = 8;

/// Approximate limit on the losses that are computed, one for each sensor node, slot and gap. Beyond it fewer gaps are
/// compared.
const MOST_LOSSES: u64 = 400_000_000;

/// Lower bound on the loss [bit] of every flight, if at most `most(K)` sensor nodes (SNs) are served in any K
/// consecutive slots.
///
/// An SN that is not served in the K slots before slot t loses in slot t at least as much as if the slot before them
/// had left it empty or, if it cannot be reached by then, as if it were never served. So the loss in slot t is at least
/// the sum of these losses without the `most(K)` largest of the SNs that can be reached. The largest of these sums over
/// K is taken.
#[must_use]
pub fn by_visits(field: &FieldBits, most: impl Fn(u64) -> usize) -> u64 {
    let gaps: Vec<(u64, usize)> = gaps(field).into_iter().map(|gap| (gap, most(gap))).collect();
    let mut losses = Vec::with_capacity(field.sensors.len());
    let mut bound_bits = 0;
    for slot in 1..=field.slots {
        let shorter = gaps.iter().copied().take_while(|(gap, _)| gap + 1 < slot);
        let all = (slot - 1, most(slot - 1));
        let least_bits = shorter.chain([all]).map(|(gap, served)| lost_after(field, slot, gap, served, &mut losses));
        bound_bits += least_bits.max().unwrap_or(0);
    }
    bound_bits
}

/// Lower bound on the loss in `slot` [bit], if at most `served` SNs were served in the `gap` slots before it. `losses`
/// is working memory.
fn lost_after(field: &FieldBits, slot: u64, gap: u64, served: usize, losses: &mut Vec<u64>) -> u64 {
    let before = slot - 1 - gap;
    losses.clear();
    let mut unreached_bits = 0;
    for sensor in &field.sensors {
        let lost_bits = sensor.lost_bits(Some(before).filter(|before| sensor.is_reached(*before)), slot);
        if sensor.is_reached(slot - 1) {
            losses.push(lost_bits);
        } else {
            unreached_bits += lost_bits;
        }
    }
    unreached_bits + without_largest(losses, served, u64::cmp)
}

/// The gaps that are compared [slots]: some of those after which an empty queue overflows.
fn gaps(field: &FieldBits) -> Vec<u64> {
    let fills = field.sensors.iter().map(|sensor| sensor.sampler.fill_slots().ceil());
    let mut gaps: Vec<u64> = fills.filter(|fill| *fill < field.slots as f64).map(|fill| fill as u64).collect();
    gaps.sort_unstable();
    gaps.dedup();
    let losses = (field.sensors.len() as u64).saturating_mul(field.slots).max(1);
    let most = (MOST_LOSSES / losses).clamp(1, GAPS);
    let stride = gaps.len().div_ceil(most as usize).max(1);
    gaps.into_iter().step_by(stride).collect()
}

/// The sum of `values` without the `count` largest.
pub(crate) fn without_largest<T: Copy + Default + Sum<T>>(
    values: &mut [T],
    count: usize,
    compare: impl Fn(&T, &T) -> Ordering,
) -> T {
    if count >= values.len() {
        return T::default();
    }
    if count > 0 {
        values.select_nth_unstable_by(count - 1, |a, b| compare(b, a));
    }
    values[count..].iter().copied().sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bound::field_bits::SensorBits;
    use skysink_common::sampling::Sampler;

    /// An SN that samples 10 bit a slot.
    fn sensor(capacity_bits: u32, queue_bits: u32, first_slot: u64) -> SensorBits {
        let sampler = Sampler { mean_bits: 10.0, capacity_bits, lasting_slots: f64::INFINITY };
        SensorBits { sampler, drawn_bits: None, queue_bits, first_slot: Some(first_slot) }
    }

    #[test]
    fn one_of_three_sensor_nodes_is_late_with_one_visit_per_slot() {
        // One visit a slot; two fill from empty in 2 slots, one is full and fills in 2.5. Slot 1 loses 10 bit of the
        // full one, slot 2 none after one visit. Slot 3: unserved, all three lose 10 bit, and two were served. Slots 4
        // and 5: of those not served in 2 slots two lose 10 bit and one 5, and two were served.
        let field = FieldBits {
            sensors: vec![sensor(20, 0, 1), sensor(20, 0, 1), sensor(25, 25, 1)],
            slots: 5,
            blocks: 1,
            beyond_buffers_bits: 0,
        };
        assert_eq!(by_visits(&field, |slots| slots as usize), 10 + 10 + 5 + 5);
    }

    #[test]
    fn a_sensor_node_out_of_reach_loses_data_in_any_schedule() {
        // Full, and first served at the end of slot 3, whose overflow precedes the visit (decision D1).
        let field = FieldBits { sensors: vec![sensor(10, 10, 3)], slots: 6, blocks: 1, beyond_buffers_bits: 0 };
        assert_eq!(by_visits(&field, |slots| slots as usize), 30);
    }
}
