//! Constant arrivals: the bits that a sensor node samples, whole and without drift (decision D2).

/// Most bits that one sensor node may sample in a mission: counted through `f64`, which is exact up to 2^53.
pub(crate) const MAX_SAMPLED_BITS: f64 = 9.0e15;

/// Added before `floor`, so that a product just below its integer, such as `0.1 × 30`, does not lose a bit.
const ROUNDING_BITS: f64 = 1e-9;

/// Bits sampled up to the end of `slot` at `mean_bits` [bit] per slot, `s_i τ`: `A_i(t) = floor(s_i τ t)`, below 2^53
/// in every mission.
#[inline(always)]
#[must_use]
pub fn sampled(mean_bits: f64, slot: u64) -> f64 {
    (mean_bits * slot as f64 + ROUNDING_BITS).floor()
}

/// [`sampled`] as an integer.
#[inline]
#[must_use]
pub fn sampled_bits(mean_bits: f64, slot: u64) -> u64 {
    sampled(mean_bits, slot) as u64
}

/// Mean bits sampled per slot of `slot_s` [s] at the rate `sampling_bps` [bit/s], `s_i τ`.
#[must_use]
pub fn mean_bits(sampling_bps: f64, slot_s: f64) -> f64 {
    sampling_bps * slot_s
}

/// 2^52: from here on consecutive floats are at least 1 apart.
const FLOATS_ONE_APART: f64 = 4_503_599_627_370_496.0;

/// Whether [`quick_bits`] counts the bits sampled up to the end of `slot`.
#[must_use]
pub fn is_quick(mean_bits: f64, slot: u64) -> bool {
    sampled(mean_bits, slot) < FLOATS_ONE_APART
}

/// [`sampled_bits`] below 2^52: a whole number is in the low bits of its sum with 2^52. Unlike `as`, this conversion
/// vectorizes (5.6 instead of 26 µs for 10^4 numbers).
#[inline(always)]
#[must_use]
pub fn quick_bits(mean_bits: f64, slot: u64) -> u64 {
    (sampled(mean_bits, slot) + FLOATS_ONE_APART).to_bits() - FLOATS_ONE_APART.to_bits()
}

/// Bits sampled in the slots after `from` up to `to`, `A_i(to) − A_i(from)`; 0 if `to ≤ from`.
#[inline]
#[must_use]
pub fn bits_between(mean_bits: f64, from: u64, to: u64) -> u64 {
    sampled_bits(mean_bits, to).saturating_sub(sampled_bits(mean_bits, from))
}

/// The slot in which bit number `bit` (from 1) is sampled: the first with `A_i(slot) ≥ bit`.
///
/// # Panics
/// If the bit is not sampled by the end of slot `last`.
#[must_use]
pub fn slot_of_bit(mean_bits: f64, bit: u64, last: u64) -> u64 {
    if last == 0 || sampled_bits(mean_bits, last - 1) < bit {
        assert!(sampled_bits(mean_bits, last) >= bit, "expected a bit that is sampled up to slot {last}");
        return last;
    }
    let mut slot = ((bit as f64 / mean_bits).ceil() as u64).min(last); // off by rounding only
    while sampled_bits(mean_bits, slot) < bit {
        slot += 1;
    }
    while slot > 0 && sampled_bits(mean_bits, slot - 1) >= bit {
        slot -= 1;
    }
    slot
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn whole_bits_are_sampled_in_the_exact_slot() {
        assert_eq!(sampled_bits(0.29, 100), 29, "of a product that rounding puts below its integer");
        assert_eq!([0.999_999_998, 0.999_999_999_5].map(|mean_bits| sampled_bits(mean_bits, 1)), [0, 1]);
        assert_eq!(sampled_bits(4.35, 100), 435, "4.35 × 100 is 434.99999999999994 in f64");
    }

    #[test]
    fn fast_conversion_ends_where_floats_are_one_apart() {
        assert_eq!([(1u64 << 52) - 1, 1 << 52].map(|bits| is_quick(bits as f64, 1)), [true, false]);
        assert!(!is_quick(9e15, 1));
    }

    #[test]
    fn bits_between_slots_sum_the_slots_in_between() {
        // s τ = 2.5: A = 0, 2, 5, 7, 10
        assert_eq!([0, 1, 2, 3, 4].map(|slot| sampled_bits(2.5, slot)), [0, 2, 5, 7, 10]);
        assert_eq!((bits_between(2.5, 1, 4), bits_between(2.5, 0, 3), bits_between(2.5, 3, 3)), (8, 7, 0));
        assert_eq!(bits_between(2.5, 4, 1), 0);
    }

    #[test]
    fn each_bit_is_assigned_to_its_sampling_slot() {
        assert_eq!([1, 2, 3, 5, 6].map(|bit| slot_of_bit(2.5, bit, 9)), [1, 1, 2, 2, 3]);
        for mean_bits in [0.1, 0.3, 1.0 / 3.0, 0.9999999999, 1.0, 2.5, 7.7, 100.0, 4e9] {
            for last in [1, 2, 30, 1_000] {
                let most = sampled_bits(mean_bits, last);
                for bit in (1..=most.min(2_000)).chain(most.saturating_sub(9).max(1)..=most) {
                    let slot = slot_of_bit(mean_bits, bit, last);
                    let is_first = sampled_bits(mean_bits, slot) >= bit && sampled_bits(mean_bits, slot - 1) < bit;
                    assert!(is_first, "{mean_bits} bits per slot: bit {bit} in slot {slot} of {last}");
                }
            }
        }
    }

    #[test]
    #[should_panic(expected = "sampled up to slot 3")]
    fn an_unsampled_bit_has_no_slot() {
        let _ = slot_of_bit(2.5, 8, 3);
    }

    proptest! {
        #[test]
        fn fast_integer_conversion_is_exact(number in prop_oneof![0u64..100, 0u64..1 << 52, Just((1 << 52) - 1)]) {
            prop_assert!(is_quick(number as f64, 1));
            prop_assert_eq!(quick_bits(number as f64, 1), number);
        }

        #[test]
        fn arrivals_do_not_drift_from_the_rate(mean_bits in 0.0f64..1e5, slots in 1u64..3000) {
            let total: u64 = (1..=slots).map(|slot| bits_between(mean_bits, slot - 1, slot)).sum();
            prop_assert!((total as f64 - mean_bits * slots as f64).abs() <= 1.0);
        }
    }
}
