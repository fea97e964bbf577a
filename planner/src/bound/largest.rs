//! Sums without the largest terms, of both bounds by visits.

use std::cmp::Ordering;
use std::iter::Sum;

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
