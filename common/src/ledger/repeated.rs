//! Adding the same number many times, at once, with the rounding of every single addition.
//!
//! A full field loses a slot's worth of sampling at a million sensor nodes in every slot. The sum has to be what adding
//! them one by one gives, to the last bit.

/// Runs shorter than this are added one by one.
const WORTH_IT: u64 = 8;

/// A sum of `f64` whose terms come in runs of equals.
#[derive(Debug, Clone, Copy)]
pub(super) struct Repeated {
    sum: f64,
    /// The term of the run at hand, above 0, and how often it is still to be added.
    run: (f64, u64),
}

impl Repeated {
    /// A sum so far, at least 0.
    pub(super) fn from(sum: f64) -> Self {
        Self { sum, run: (0.0, 0) }
    }

    /// Adds `term`, above 0, `times` times.
    pub(super) fn add(&mut self, term: f64, times: u64) {
        if term == self.run.0 {
            self.run.1 += times;
        } else {
            self.sum = added(self.sum, self.run);
            self.run = (term, times);
        }
    }

    /// The sum.
    pub(super) fn sum(self) -> f64 {
        added(self.sum, self.run)
    }
}

/// `sum + term + term + …`, `times` terms, rounded after each.
///
/// Between two powers of two, floats are equidistant. Where the term is a multiple of their distance, every partial sum
/// up to the next power of two is a float, nothing is rounded, and one multiplication gives the last of them. The rest
/// is added one by one: the step over the power of two, and terms that have to be rounded.
fn added(mut sum: f64, (term, mut times): (f64, u64)) -> f64 {
    if times < WORTH_IT {
        return (0..times).fold(sum, |sum, _| sum + term);
    }
    while times > 0 {
        let (distance, next_power) = spacing(sum);
        let room = ((next_power - sum) / term).floor();
        if room >= 2.0 && term % distance == 0.0 {
            let steps = times.min(room as u64 - 1);
            sum += steps as f64 * term;
            times -= steps;
        } else {
            let single = if term % distance == 0.0 { 1 } else { times };
            for _ in 0..single {
                sum += term;
            }
            times -= single;
        }
    }
    sum
}

/// The distance between floats at `value`, at least 0, and the power of two that ends it.
fn spacing(value: f64) -> (f64, f64) {
    let last = f64::from_bits(value.to_bits() | ((1 << (f64::MANTISSA_DIGITS - 1)) - 1));
    (last - last.next_down(), last.next_up())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn one_by_one(sum: f64, term: f64, times: u64) -> f64 {
        (0..times).fold(sum, |sum, _| sum + term)
    }

    #[test]
    fn a_million_whole_slots_are_added_at_once() {
        let mut sum = Repeated::from(0.0);
        sum.add(1.0, 600_000);
        sum.add(1.0, 400_000);
        assert_eq!(sum.sum(), 1e6);
    }

    #[test]
    fn what_a_power_of_two_rounds_away_is_rounded_away() {
        // Above 1, floats are 2^−52 apart, above 2, 2^−51: the odd last digit is lost there, to even.
        let odd = 1.0 + f64::EPSILON;
        assert_eq!(added(odd, (1.0, 5)), one_by_one(odd, 1.0, 5));
        assert_eq!(added(odd, (1.0, 5)), 6.0);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(3_000))]

        #[test]
        fn runs_sum_up_as_single_terms_do(
            start in prop_oneof![Just(0.0), 0.0..1e-6, 0.0..10.0, 0.0..1e12],
            runs in prop::collection::vec(
                (prop_oneof![Just(1.0), Just(0.5), Just(0.8), Just(1.2), Just(1e-3), Just(3.0), 1e-9..100.0], 0u64..3_000),
                0..6,
            ),
        ) {
            let mut sum = Repeated::from(start);
            runs.iter().for_each(|&(term, times)| sum.add(term, times));
            let expected = runs.iter().fold(start, |sum, &(term, times)| one_by_one(sum, term, times));
            prop_assert_eq!(sum.sum().to_bits(), expected.to_bits());
        }
    }
}
