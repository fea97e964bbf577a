//! What the sensor nodes sample in a slot, in whole bits and without drift; many of them at a time.

use skysink_common::arrivals::{ROUNDING_BITS, bits_between};
use skysink_common::wide::{BLOCK, wide};

/// From here on, floats are integers: what is added to it is rounded to one.
const FLOATS_ONE_APART: f64 = 4_503_599_627_370_496.0; // 2^52

/// Arrivals [bit] below this number are computed by the block.
const MOST_BITS: f64 = 2_147_483_648.0; // 2^31

/// Bits sampled in `slot`, from 1: `a_i(t) = A_i(t) − A_i(t−1)` (decision D2).
#[must_use]
pub fn arrival_bits(mean_bits: f64, slot: u64) -> u64 {
    bits_between(mean_bits, slot - 1, slot)
}

/// What the sensor nodes (SNs) of a field sample in a slot on average [bit], `s_i τ`.
#[derive(Debug, Clone, PartialEq)]
pub enum Rates {
    /// The same at all SNs, as the scenario says.
    Alike(f64),
    /// By SN, as the list says.
    Each(Vec<f64>),
}

impl Rates {
    /// The rates of SNs that sample `mean_bits[i]` [bit] per slot, at least 0.
    #[must_use]
    pub fn new(mean_bits: Vec<f64>) -> Self {
        match mean_bits[..] {
            [first, ..] if mean_bits.iter().all(|&mean| mean == first) => Self::Alike(first),
            _ => Self::Each(mean_bits),
        }
    }
}

/// [`arrival_bits`] of a block of SNs, `mean_bits[k]` [bit] on average at entry k.
///
/// Returned are the arrivals [bit], in `bits`; `None` if one is too large for the way they are computed, in `f64` and
/// without a call or branch.
///
/// # Panics
/// If there are more SNs than in a block.
pub fn block_bits<'a>(mean_bits: &[f64], slot: u64, bits: &'a mut [u32; BLOCK]) -> Option<&'a [u32]> {
    let bits = &mut bits[..mean_bits.len()];
    wide(|| fill(mean_bits, slot, bits)).then_some(bits)
}

/// The loop of [`block_bits`]: whether all went well.
#[inline(always)]
fn fill(mean_bits: &[f64], slot: u64, bits: &mut [u32]) -> bool {
    let (now, before) = (slot as f64, (slot - 1) as f64);
    let mut fit = true;
    for (bits, &mean) in bits.iter_mut().zip(mean_bits) {
        let sampled = mean * now + ROUNDING_BITS;
        let arrived = floor(sampled) - floor(mean * before + ROUNDING_BITS);
        fit &= (sampled < FLOATS_ONE_APART / 2.0) & (arrived < MOST_BITS);
        // The integer is in the last bits of a sum of this size.
        *bits = (arrived + FLOATS_ONE_APART).to_bits() as u32;
    }
    fit
}

/// `floor(value)` of a value from 0 to 2^51, in additions that a processor makes for several values at a time.
#[inline(always)]
fn floor(value: f64) -> f64 {
    let nearest = (value + FLOATS_ONE_APART) - FLOATS_ONE_APART;
    nearest - f64::from(u8::from(nearest > value))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_fraction_of_a_bit_per_slot_arrives_as_whole_bits() {
        // s τ = 2.5: A = 2, 5, 7, 10
        assert_eq!([1, 2, 3, 4].map(|slot| arrival_bits(2.5, slot)), [2, 3, 2, 3]);
        assert_eq!((1..=10).map(|slot| arrival_bits(0.7, slot)).sum::<u64>(), 7);
    }

    #[test]
    fn a_product_that_rounds_below_its_integer_loses_no_bit() {
        // 4.35 × 100 is 434.99999999999994 in f64.
        assert_eq!((1..=100).map(|slot| arrival_bits(4.35, slot)).sum::<u64>(), 435);
    }

    #[test]
    fn a_sensor_that_does_not_sample_has_no_arrivals() {
        assert_eq!(arrival_bits(0.0, 600), 0);
    }

    #[test]
    fn more_than_a_block_can_hold_is_said_to_be_too_much() {
        let mut bits = [0; BLOCK];
        assert_eq!(block_bits(&[100.0, 2e9], 1_000, &mut bits), Some(&[100, 2_000_000_000][..]));
        assert_eq!(block_bits(&[100.0, 2.2e9], 1, &mut bits), None);
        assert_eq!(block_bits(&[100.0, 2e9], 2_000_000, &mut bits), None);
    }

    #[test]
    fn equal_rates_are_recognised() {
        assert_eq!(Rates::new(vec![2.5; 3]), Rates::Alike(2.5));
        assert_eq!(Rates::new(vec![2.5, 2.5, 2.0]), Rates::Each(vec![2.5, 2.5, 2.0]));
    }

    /// Averages [bit] that are whole, halves, tenths, or anything.
    fn means() -> impl Strategy<Value = f64> {
        prop_oneof![
            (0u32..200).prop_map(f64::from),
            (0u32..200).prop_map(|half| f64::from(half) / 2.0),
            (0u32..2_000).prop_map(|tenth| f64::from(tenth) / 10.0),
            0.0..1e4,
            1e9..2.5e9,
        ]
    }

    proptest! {
        #[test]
        fn a_block_samples_what_each_of_its_sensor_nodes_does(
            mean_bits in prop::collection::vec(means(), 1..=BLOCK),
            slot in prop_oneof![1u64..10, 1u64..500_000],
        ) {
            let expected: Vec<u64> = mean_bits.iter().map(|&mean| arrival_bits(mean, slot)).collect();
            let mut room = [0; BLOCK];
            let bits = block_bits(&mean_bits, slot, &mut room);
            prop_assert!(bits.is_some() || mean_bits.iter().any(|&mean| mean > 1e9));
            if let Some(bits) = bits {
                prop_assert_eq!(bits.iter().copied().map(u64::from).collect::<Vec<_>>(), expected);
            }
        }

        #[test]
        fn arrivals_never_drift_from_the_rate(mean_bits in 0.0f64..1e5, slots in 1u64..3000) {
            let total: u64 = (1..=slots).map(|slot| arrival_bits(mean_bits, slot)).sum();
            prop_assert!((total as f64 - mean_bits * slots as f64).abs() <= 1.0);
        }
    }
}
