//! Means of repeated missions, and how far they can be trusted.

use statrs::distribution::{ContinuousCDF, StudentsT};

/// The mean of repeated values with its confidence interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeanInterval {
    /// Number of values.
    pub n: usize,
    /// Their mean.
    pub mean: f64,
    /// Their standard deviation, with n − 1; none of a single value.
    pub deviation: Option<f64>,
    /// Half the width of the 95 % confidence interval of the mean, by Student's t; none of a single value.
    pub half_width: Option<f64>,
}

impl MeanInterval {
    /// The mean of these values, added in their order.
    ///
    /// # Panics
    /// If there are none.
    pub fn of(values: &[f64]) -> Self {
        assert!(!values.is_empty(), "a mean needs a value");
        let n = values.len();
        let mean = values.iter().sum::<f64>() / n as f64;
        if n == 1 {
            return Self { n, mean, deviation: None, half_width: None };
        }
        let freedom = (n - 1) as f64;
        let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        let deviation = (squares / freedom).sqrt();
        let t = StudentsT::new(0.0, 1.0, freedom).expect("a positive degree of freedom").inverse_cdf(0.975);
        Self { n, mean, deviation: Some(deviation), half_width: Some(t * deviation / (n as f64).sqrt()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interval_is_students() {
        // 1, 2, 3, 4: mean 2.5, s = sqrt(5/3) = 1.290994; t(0.975, 3) = 3.182446; 3.182446 · 1.290994/2 = 2.054260
        let estimate = MeanInterval::of(&[1.0, 2.0, 3.0, 4.0]);
        assert_eq!((estimate.n, estimate.mean), (4, 2.5));
        assert!((estimate.deviation.unwrap() - 1.290_994).abs() < 1e-6);
        assert!((estimate.half_width.unwrap() - 2.054_260).abs() < 1e-5);
    }

    #[test]
    fn one_value_has_a_mean_and_nothing_else() {
        let estimate = MeanInterval::of(&[7.0]);
        assert_eq!((estimate.mean, estimate.deviation, estimate.half_width), (7.0, None, None));
    }
}
