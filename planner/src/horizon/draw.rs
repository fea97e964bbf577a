//! Random numbers for annealing, each from one 32-bit word of the stream.

use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// A number below `count`, which is at least 1 and below 2^32.
#[inline]
#[must_use]
pub fn below(random: &mut ChaCha8Rng, count: usize) -> usize {
    ((u64::from(random.next_u32()) * count as u64) >> 32) as usize
}

/// A fraction in (0, 1].
#[inline]
#[must_use]
pub fn fraction(random: &mut ChaCha8Rng) -> f64 {
    (f64::from(random.next_u32()) + 1.0) / 4_294_967_296.0
}
