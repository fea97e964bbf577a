//! What the sensor nodes sample, in whole bits and without drift.

/// Keeps a product such as `0.1 × 30`, which is just below its integer, from losing a bit.
const ROUNDING_BITS: f64 = 1e-9;

/// Bits sampled up to the end of `slot` at `mean_bits` [bit] per slot, `s_i τ`: `A_i(t) = floor(s_i τ t)` (decision D2).
fn sampled_bits(mean_bits: f64, slot: u64) -> u64 {
    (mean_bits * slot as f64 + ROUNDING_BITS).floor() as u64
}

/// Bits sampled in `slot`, from 1: `a_i(t) = A_i(t) − A_i(t−1)` (decision D2).
#[must_use]
pub fn arrival_bits(mean_bits: f64, slot: u64) -> u64 {
    sampled_bits(mean_bits, slot) - sampled_bits(mean_bits, slot - 1)
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

    proptest! {
        #[test]
        fn arrivals_never_drift_from_the_rate(mean_bits in 0.0f64..1e5, slots in 1u64..3000) {
            let total: u64 = (1..=slots).map(|slot| arrival_bits(mean_bits, slot)).sum();
            prop_assert!((total as f64 - mean_bits * slots as f64).abs() <= 1.0);
        }
    }
}
