//! Sampling of the sensor nodes (SNs) of a field, in whole bits and without drift (decision D2).

/// 2^52: from here on consecutive floats are at least 1 apart.
const FLOATS_ONE_APART: f64 = 4_503_599_627_370_496.0;

/// Mean bits sampled per slot by the SNs of a field, `s_i τ`.
#[derive(Debug, Clone, PartialEq)]
pub enum SamplingMeans {
    /// The same for all SNs.
    Equal(f64),
    /// By SN.
    Each(Vec<f64>),
}

impl SamplingMeans {
    /// The means of SNs that sample `mean_bits[i]` [bit] per slot, at least 0.
    #[must_use]
    pub fn new(mean_bits: Vec<f64>) -> Self {
        match mean_bits[..] {
            [first, ..] if mean_bits.iter().all(|&mean| mean == first) => Self::Equal(first),
            _ => Self::Each(mean_bits),
        }
    }

    /// Mean bits per slot of SN `sensor`.
    #[must_use]
    pub fn mean_bits(&self, sensor: usize) -> f64 {
        match self {
            Self::Equal(mean_bits) => *mean_bits,
            Self::Each(mean_bits) => mean_bits[sensor],
        }
    }
}

/// Whether [`quick_integer`] converts `whole`, at least 0.
#[must_use]
pub fn is_quick(whole: f64) -> bool {
    whole < FLOATS_ONE_APART
}

/// Converts the whole number `whole`, from 0 to below 2^52, to an integer: it is in the low bits of its sum with 2^52.
/// Unlike `as`, this vectorizes (5.6 instead of 26 µs for 10^4 numbers).
#[inline(always)]
#[must_use]
pub fn quick_integer(whole: f64) -> u64 {
    (whole + FLOATS_ONE_APART).to_bits() - FLOATS_ONE_APART.to_bits()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use skysink_common::arrivals::{bits_between, sampled_bits};

    #[test]
    fn a_fraction_of_a_bit_per_slot_arrives_as_whole_bits() {
        // s τ = 2.5: A = 2, 5, 7, 10
        assert_eq!([1, 2, 3, 4].map(|slot| bits_between(2.5, slot - 1, slot)), [2, 3, 2, 3]);
        assert_eq!(sampled_bits(0.7, 10), 7);
    }

    #[test]
    fn a_product_that_rounds_below_its_integer_loses_no_bit() {
        // 4.35 × 100 is 434.99999999999994 in f64.
        assert_eq!(sampled_bits(4.35, 100), 435);
    }

    #[test]
    fn equal_rates_are_recognised() {
        assert_eq!(SamplingMeans::new(vec![2.5; 3]), SamplingMeans::Equal(2.5));
        assert_eq!(SamplingMeans::new(vec![2.5, 2.5, 2.0]), SamplingMeans::Each(vec![2.5, 2.5, 2.0]));
    }

    proptest! {
        #[test]
        fn a_quick_integer_is_the_number(number in prop_oneof![0u64..100, 0u64..1 << 52, Just((1 << 52) - 1)]) {
            prop_assert!(is_quick(number as f64));
            prop_assert_eq!(quick_integer(number as f64), number);
        }

        #[test]
        fn arrivals_never_drift_from_the_rate(mean_bits in 0.0f64..1e5, slots in 1u64..3000) {
            let total: u64 = (1..=slots).map(|slot| bits_between(mean_bits, slot - 1, slot)).sum();
            prop_assert!((total as f64 - mean_bits * slots as f64).abs() <= 1.0);
        }
    }
}
