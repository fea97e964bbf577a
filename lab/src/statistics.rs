//! Means of repeated missions and of paired differences, with confidence intervals.

use std::collections::BTreeMap;

use serde::Serialize;
use skysink_common::figure::Support;
use statrs::distribution::{ContinuousCDF, StudentsT};

/// The confidence limits of the mean for a half-width (t quantile times standard error) on the linear scale. Delta
/// method: `g⁻¹(g(mean) ± g′(mean) half_width)`, where g is the identity, the logarithm, or the logit on the range.
fn limits(support: Support, mean: f64, half_width: f64) -> [f64; 2] {
    let [low, high] = support.ends();
    let below = mean - low;
    let above = high - mean;
    if half_width == 0.0 || below <= 0.0 || above <= 0.0 {
        return [mean; 2];
    }
    let transformed = half_width / below + half_width / above; // an infinite side contributes 0
    let limits = match support {
        Support::Real => [mean - half_width, mean + half_width],
        Support::NonNegative => [mean * (-transformed).exp(), mean * transformed.exp()],
        Support::Fraction | Support::FractionDifference => [-transformed, transformed].map(|shift| {
            let factor = shift.exp(); // of below / above
            if factor.is_finite() { mean + below * above * (factor - 1.0) / (above + below * factor) } else { high }
        }),
    };
    // Rounding must not move a limit across the mean.
    [limits[0].clamp(low, mean), limits[1].clamp(mean, high)]
}

/// The mean of repeated values with its confidence interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeanInterval {
    /// Number of values.
    pub n: usize,
    /// Their mean.
    pub mean: f64,
    /// Their sample standard deviation (n − 1); `None` for a single value.
    pub deviation: Option<f64>,
    /// Limits of the 95 % confidence interval of the mean, by Student's t; `None` for a single value.
    ///
    /// They lie within the range of the values: computed on the logit scale for fractions and on the log scale for
    /// non-negative quantities, by the delta method. They are approximate. Equal values give an interval of width 0.
    pub limits: Option<[f64; 2]>,
}

impl MeanInterval {
    /// The mean of these values, summed in their order.
    ///
    /// # Panics
    /// If `values` is empty.
    #[must_use]
    pub fn of(values: &[f64], support: Support) -> Self {
        let n = values.len();
        assert!(n > 0, "a mean needs a value");
        let mean = values.iter().sum::<f64>() / n as f64;
        if n == 1 {
            return Self { n, mean, deviation: None, limits: None };
        }
        let freedom = (n - 1) as f64;
        let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        let deviation = (squares / freedom).sqrt();
        let t = StudentsT::new(0.0, 1.0, freedom).expect("a positive degree of freedom").inverse_cdf(0.975);
        let limits = limits(support, mean, t * deviation / (n as f64).sqrt());
        Self { n, mean, deviation: Some(deviation), limits: Some(limits) }
    }

    /// The p-value of the two-sided test that a mean difference is 0, the paired t test on the scale of the interval of
    /// `support`: it is below 0.05 where 0 lies outside the interval. `None` for a single value.
    pub(crate) fn p_of_zero(&self, support: Support) -> Option<f64> {
        let error = self.deviation? / (self.n as f64).sqrt();
        let statistic = match support {
            Support::FractionDifference => self.mean.atanh() * (1.0 - self.mean * self.mean),
            Support::Real | Support::NonNegative | Support::Fraction => self.mean,
        } / error;
        if error == 0.0 {
            return Some(f64::from(u8::from(self.mean == 0.0)));
        }
        let t = StudentsT::new(0.0, 1.0, (self.n - 1) as f64).expect("a positive degree of freedom");
        Some(2.0 * t.cdf(-statistic.abs()))
    }
}

/// The p-values of several tests, adjusted by Holm's method: if none of the tested differences exists, one below 0.05
/// occurs in at most 5 % of all cases (S. Holm, "A Simple Sequentially Rejective Multiple Test Procedure", Scandinavian
/// Journal of Statistics 6(2), 1979).
#[must_use]
pub fn holm(p_values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..p_values.len()).collect();
    order.sort_by(|&one, &other| p_values[one].total_cmp(&p_values[other]));
    let mut adjusted = vec![0.0; p_values.len()];
    let mut greatest: f64 = 0.0;
    for (rank, &index) in order.iter().enumerate() {
        greatest = greatest.max(p_values[index] * (p_values.len() - rank) as f64).min(1.0);
        adjusted[index] = greatest;
    }
    adjusted
}

/// Fewest fields, fewest with a loss, and largest fraction of the sum in one field, for which an interval is trusted.
const FEWEST_FIELDS: usize = 10;
const FEWEST: usize = 5;
const LARGEST: f64 = 0.2;

/// By how few of its values, none negative, a mean is determined.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Concentration {
    /// Number of values.
    #[serde(skip)]
    pub n: usize,
    /// Number of values that are not 0.
    pub nonzero: usize,
    /// Fraction of the sum that the largest value has; 0 if all values are 0.
    pub largest_fraction: f64,
}

impl Concentration {
    /// The concentration of these values.
    #[must_use]
    pub fn of(values: impl Iterator<Item = f64>) -> Self {
        let mut sum = 0.0;
        let mut most: f64 = 0.0;
        let mut n = 0;
        let mut nonzero = 0;
        for value in values {
            n += 1;
            sum += value;
            most = most.max(value);
            nonzero += usize::from(value != 0.0);
        }
        Self { n, nonzero, largest_fraction: if sum > 0.0 { most / sum } else { 0.0 } }
    }

    /// Whether the interval of the mean is not to be trusted: it is of fewer than 10 values, fewer than 5 of them are
    /// not 0, or one has more than 20 % of the sum. A single value has no interval, and values that are all 0 determine
    /// it.
    pub fn is_few(&self) -> bool {
        let is_narrow = self.is_small() || self.nonzero < FEWEST || self.largest_fraction > LARGEST;
        self.n > 1 && self.nonzero > 0 && is_narrow
    }

    /// Whether there are fewer than 10 values: too few to say how the sum is distributed.
    pub fn is_small(&self) -> bool {
        self.n < FEWEST_FIELDS
    }
}

/// The fewest decimals, at least `decimals`, that tell each of the limits of an interval from 0; `None` if they are
/// many.
pub(crate) fn told_decimals(limits: [f64; 2], decimals: usize) -> Option<usize> {
    let is_told = |text: &str| text.bytes().any(|byte| (b'1'..=b'9').contains(&byte));
    let mut enough = decimals..=decimals + MORE_DECIMALS;
    enough.find(|&decimals| limits.iter().all(|&limit| limit == 0.0 || is_told(&format!("{limit:.decimals$}"))))
}

/// The limits of an interval in brackets, with as many decimals as it takes to tell each of them from 0, at least
/// `decimals`.
#[must_use]
pub fn limits_text(limits: [f64; 2], decimals: usize) -> String {
    let text = |limit: f64| match told_decimals(limits, decimals) {
        Some(decimals) => format!("{:.decimals$}", limit + 0.0), // no sign for −0
        None => format!("{limit:.1e}"),
    };
    let [low, high] = limits.map(text);
    format!("[{low}, {high}]")
}

/// Most decimals that are added before limits are written with exponents.
const MORE_DECIMALS: usize = 5;

/// `values − reference` for each common seed, ascending.
pub(crate) fn paired_differences(values: &BTreeMap<u64, f64>, reference: &BTreeMap<u64, f64>) -> Vec<f64> {
    values.iter().filter_map(|(seed, value)| Some(value - reference.get(seed)?)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;
    use skysink_common::random::{Purpose, Streams};
    use std::iter::zip;

    fn limits(values: &[f64], support: Support) -> [f64; 2] {
        MeanInterval::of(values, support).limits.unwrap()
    }

    fn assert_near(limits: [f64; 2], expected: [f64; 2]) {
        let is_near = limits.iter().zip(expected).all(|(limit, expected)| (limit - expected).abs() < 1e-5);
        assert!(is_near, "{limits:?} instead of {expected:?}");
    }

    #[test]
    fn intervals_of_real_numbers_use_students_t() {
        // 1, 2, 3, 4: mean 2.5, s = sqrt(5/3) = 1.290994; t(0.975, 3) = 3.182446; 3.182446 · 1.290994/2 = 2.054260
        let estimate = MeanInterval::of(&[1.0, 2.0, 3.0, 4.0], Support::Real);
        assert_eq!((estimate.n, estimate.mean), (4, 2.5));
        assert!((estimate.deviation.unwrap() - 1.290_994).abs() < 1e-6);
        assert_near(estimate.limits.unwrap(), [2.5 - 2.054_260, 2.5 + 2.054_260]);
    }

    #[test]
    fn intervals_of_fractions_use_the_logit_scale() {
        // The same / 10: mean 0.25, half width h = 0.205426; logit(0.25) = −1.098612, its slope 1/(0.25 · 0.75) =
        // 5.333333; −1.098612 ± 1.095605; the logistic function of −2.194217 is 0.100271, of −0.003007 0.499248
        let fractions = [0.1, 0.2, 0.3, 0.4];
        assert_near(limits(&fractions, Support::Fraction), [0.100_271, 0.499_248]);
        // As differences: logit of (1 + 0.25)/2 = 0.625 is 0.510826, its slope 1/(0.625 · 0.375) · ½ = 2.133333;
        // 0.510826 ± 0.438242; 2 · 0.518138 − 1 and 2 · 0.720928 − 1
        assert_near(limits(&fractions, Support::FractionDifference), [0.036_276, 0.441_855]);
    }

    #[test]
    fn intervals_of_non_negative_numbers_use_the_log_scale() {
        // 2.5 · exp(∓2.054260/2.5) = 2.5 · exp(∓0.821704)
        assert_near(limits(&[1.0, 2.0, 3.0, 4.0], Support::NonNegative), [1.099_204, 5.685_931]);
    }

    #[test]
    fn a_single_value_has_a_mean_only() {
        for support in [Support::Real, Support::NonNegative, Support::Fraction, Support::FractionDifference] {
            let estimate = MeanInterval::of(&[0.7], support);
            assert_eq!((estimate.mean, estimate.deviation, estimate.limits), (0.7, None, None));
        }
    }

    #[test]
    fn equal_values_have_an_interval_of_zero_width() {
        for support in [Support::Real, Support::NonNegative, Support::Fraction, Support::FractionDifference] {
            for value in [0.0, 0.25, 1.0] {
                assert_eq!(limits(&[value; 20], support), [value; 2], "{support:?}");
            }
        }
    }

    #[test]
    fn differences_are_computed_for_common_seeds() {
        let values = BTreeMap::from([(1, 0.5), (2, 0.25), (4, 1.0)]);
        let reference = BTreeMap::from([(2, 0.125), (3, 0.0), (4, 0.25)]);
        assert_eq!(paired_differences(&values, &reference), [0.125, 0.75]);
    }

    #[test]
    fn p_values_come_from_the_paired_t_test_on_the_scale_of_the_interval() {
        // 1, 2, 3, 4: t = 2.5/0.645497 = 3.872983 with 3 degrees of freedom, p = 0.030466
        let p = |values: &[f64], support| MeanInterval::of(values, support).p_of_zero(support).unwrap();
        assert!((p(&[1.0, 2.0, 3.0, 4.0], Support::Real) - 0.030_466).abs() < 1e-6);
        assert_eq!(MeanInterval::of(&[0.7], Support::Real).p_of_zero(Support::Real), None);
        assert_eq!([p(&[0.0; 3], Support::Real), p(&[0.5; 3], Support::Real)], [1.0, 0.0]);
        for support in [Support::Real, Support::FractionDifference] {
            for values in samples(|uniform| uniform() - 0.3, 6, 300) {
                let [low, high] = limits(&values, support);
                assert_eq!(p(&values, support) < 0.05, !(low..=high).contains(&0.0), "{values:?}");
            }
        }
    }

    #[test]
    fn holm_adjustment_scales_the_smallest_p_value_and_keeps_the_order() {
        // 0.01 · 4, 0.02 · 3, 0.03 · 2, which is not below the one before, 0.9 · 1
        let adjusted = holm(&[0.03, 0.01, 0.9, 0.02]);
        zip(adjusted, [0.06, 0.04, 0.9, 0.06]).for_each(|(one, other)| assert!((one - other).abs() < 1e-12));
        assert_eq!(holm(&[0.5, 0.6]), [1.0, 1.0]);
        assert!(holm(&[]).is_empty());
    }

    #[test]
    fn a_mean_dominated_by_few_values_is_flagged() {
        let few = |values: &[f64]| Concentration::of(values.iter().copied());
        assert_eq!(few(&[0.0; 9]), Concentration { n: 9, nonzero: 0, largest_fraction: 0.0 });
        assert_eq!(few(&[0.0, 0.25, 0.75]), Concentration { n: 3, nonzero: 2, largest_fraction: 0.75 });
        let padded = |losses: &[f64]| few(&[losses, &[0.0; 10]].concat()).is_few();
        assert!(padded(&[1.0; 4]) && !padded(&[1.0; 5]), "fewer than 5");
        assert!(!padded(&[1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.5]), "1.5 of 7.5 are 20 %");
        assert!(padded(&[1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.6]));
        assert!(few(&[1.0; 9]).is_few() && few(&[1.0; 9]).is_small() && !few(&[1.0; 10]).is_few(), "fewer than 10");
        assert!(!few(&[1.0]).is_few() && !few(&[0.0; 3]).is_few() && !padded(&[]), "no interval, or no loss");
    }

    #[test]
    fn interval_limits_have_enough_decimals_to_differ_from_0() {
        assert_eq!(limits_text([0.0, 0.0123], 3), "[0.000, 0.012]");
        assert_eq!(limits_text([0.000_04, 0.0123], 3), "[0.00004, 0.01230]");
        assert_eq!(limits_text([-0.000_4, 0.5], 3), "[-0.0004, 0.5000]");
        assert_eq!(limits_text([3.2e-12, 0.5], 3), "[3.2e-12, 5.0e-1]");
        assert_eq!(limits_text([-133.25, 2.0], 0), "[-133, 2]");
    }

    /// Samples of a population, each from a stream of its own.
    fn samples(draw: Draw, n: usize, count: u64) -> impl Iterator<Item = Vec<f64>> {
        (0..count).map(move |seed| {
            let mut stream = Streams::new(seed).stream(Purpose::Position, n as u64, 0);
            (0..n).map(|_| draw(&mut || stream.random::<f64>())).collect()
        })
    }

    /// Draws a value from numbers that are uniform on [0, 1).
    type Draw = fn(&mut dyn FnMut() -> f64) -> f64;

    /// 1 − u^(1/20) is of the beta distribution (1, 20), with mean 1/21.
    fn beta_1_20(uniform: &mut dyn FnMut() -> f64) -> f64 {
        1.0 - uniform().powf(1.0 / 20.0)
    }

    fn zero_or_beta(uniform: &mut dyn FnMut() -> f64) -> f64 {
        if uniform() < 0.7 { 0.0 } else { beta_1_20(uniform) }
    }

    /// Nine fields of ten lose 0 to 2 %, one 25 to 35 %.
    fn trapped(uniform: &mut dyn FnMut() -> f64) -> f64 {
        if uniform() < 0.9 { 0.02 * uniform() } else { 0.25 + 0.1 * uniform() }
    }

    /// Populations of fractions, with their means.
    const POPULATIONS: [(&str, Draw, f64); 6] = [
        ("uniform", |uniform| uniform(), 0.5),
        ("beta (1, 20)", beta_1_20, 1.0 / 21.0),
        ("seven of ten 0, others beta (1, 20)", zero_or_beta, 0.3 / 21.0),
        ("trapped in one field of ten", trapped, 0.9 * 0.01 + 0.1 * 0.3),
        ("beta (20, 1)", |uniform| uniform().powf(1.0 / 20.0), 20.0 / 21.0),
        ("0 or 1", |uniform| if uniform() < 0.3 { 1.0 } else { 0.0 }, 0.3),
    ];

    /// The fraction of samples whose interval holds the mean.
    fn coverage(draw: Draw, mean: f64, n: usize, support: Support) -> f64 {
        const SAMPLES: u64 = 2_000;
        let holds = |values: Vec<f64>| {
            let [low, high] = limits(&values, support);
            let [least, most] = if support == Support::Real { [f64::MIN, f64::MAX] } else { [0.0, 1.0] };
            assert!(least <= low && low <= high && high <= most, "{low} to {high}");
            low <= mean && mean <= high
        };
        samples(draw, n, SAMPLES).filter(|values| holds(values.clone())).count() as f64 / SAMPLES as f64
    }

    #[test]
    fn intervals_of_fractions_have_their_nominal_coverage() {
        // The standard error of a coverage of 95 % over 2 000 samples is 0.5 %.
        for (name, draw, mean) in POPULATIONS {
            for (n, least) in [(20, 0.835), (50, 0.91), (300, 0.935)] {
                let [logit, student] =
                    [Support::Fraction, Support::Real].map(|support| coverage(draw, mean, n, support));
                println!("{name}, n = {n}: {:.1} %, Student's t {:.1} %", 100.0 * logit, 100.0 * student);
                assert!((least..=0.992).contains(&logit), "{name}, n = {n}: {logit}");
                assert!(logit > student - 0.03, "{name}, n = {n}: {logit} against {student} by Student's t");
            }
        }
    }

    #[test]
    fn logit_intervals_cover_the_mean_of_skewed_fractions_better_than_students_t() {
        for (n, gain) in [(20, 0.04), (50, 0.01)] {
            let [logit, student] =
                [Support::Fraction, Support::Real].map(|support| coverage(zero_or_beta, 0.3 / 21.0, n, support));
            assert!(logit >= student + gain, "n = {n}: {logit} against {student}");
        }
    }
}
