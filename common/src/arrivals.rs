//! What a sensor node samples, in whole bits and without drift (decision D2).
//!
//! field-sim fills the queues by it, and a planner that has to estimate them counts by it.

/// Keeps a product such as `0.1 × 30`, which is just below its integer, from losing a bit.
const ROUNDING_BITS: f64 = 1e-9;

/// Bits sampled up to the end of `slot` at `mean_bits` [bit] per slot, `s_i τ`: `A_i(t) = floor(s_i τ t)`, a whole
/// number below 2^53 in every mission.
#[inline(always)]
#[must_use]
pub fn sampled(mean_bits: f64, slot: u64) -> f64 {
    (mean_bits * slot as f64 + ROUNDING_BITS).floor()
}

/// The same as an integer.
#[inline]
#[must_use]
pub fn sampled_bits(mean_bits: f64, slot: u64) -> u64 {
    sampled(mean_bits, slot) as u64
}

/// Bits sampled in the slots after `from` up to `to`, `A_i(to) − A_i(from)`; none if `to` is not later.
#[inline]
#[must_use]
pub fn bits_between(mean_bits: f64, from: u64, to: u64) -> u64 {
    sampled_bits(mean_bits, to).saturating_sub(sampled_bits(mean_bits, from))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_comes_between_two_slots_is_what_the_slots_between_them_bring() {
        // s τ = 2.5: A = 0, 2, 5, 7, 10
        assert_eq!([0, 1, 2, 3, 4].map(|slot| sampled_bits(2.5, slot)), [0, 2, 5, 7, 10]);
        assert_eq!((bits_between(2.5, 1, 4), bits_between(2.5, 0, 3), bits_between(2.5, 3, 3)), (8, 7, 0));
        assert_eq!(bits_between(2.5, 4, 1), 0);
    }
}
