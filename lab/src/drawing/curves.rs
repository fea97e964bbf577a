//! The data of the curves of a chart: a value per mission, by seed. A chart shows their means or the means of paired
//! differences.

use std::collections::BTreeMap;

use super::chart::{CurvePoint, Series};
use crate::statistics::{MeanInterval, paired_differences};
use skysink_common::figure::Support;

/// The values of a curve.
#[derive(Debug, Clone)]
pub struct CurveValues {
    /// Label in the legend.
    pub label: String,
    /// Index of the style.
    pub style: usize,
    /// Label of the reference curve for differences, if any.
    pub reference: Option<String>,
    /// For each point of the x axis, the values by seed.
    pub points: Vec<BTreeMap<u64, f64>>,
}

impl CurveValues {
    /// The curve of the means at the points `xs`.
    pub fn means(&self, xs: &[f64], support: Support) -> Series {
        self.curve(xs, support, |place| self.points[place].values().copied().collect())
    }

    /// The curve of the mean differences to `reference` over common fields. That of the reference itself is 0 without
    /// an interval.
    fn differences(&self, reference: &Self, xs: &[f64], support: Support) -> Series {
        let differences = |place: usize| paired_differences(&self.points[place], &reference.points[place]);
        let mut series = self.curve(xs, support.of_difference(), differences);
        if self.label == reference.label {
            series.points.iter_mut().for_each(|point| point.limits = None);
        }
        series
    }

    fn curve(&self, xs: &[f64], support: Support, values: impl Fn(usize) -> Vec<f64>) -> Series {
        let point = |(place, &x): (usize, &f64)| {
            let MeanInterval { n, mean, limits, .. } = MeanInterval::of(&values(place), support);
            CurvePoint { x, n, mean, limits }
        };
        Series { label: self.label.clone(), style: self.style, points: xs.iter().enumerate().map(point).collect() }
    }
}

/// The curves of paired differences, for all `curves` with a reference, in their order.
pub fn differences(curves: &[CurveValues], xs: &[f64], support: Support) -> Vec<Series> {
    let compared = curves.iter().filter_map(|curve| {
        let reference = curves.iter().find(|other| Some(&other.label) == curve.reference.as_ref())?;
        Some(curve.differences(reference, xs, support))
    });
    compared.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(label: &str, values: &[(u64, f64)]) -> CurveValues {
        let points = vec![values.iter().copied().collect()];
        CurveValues { label: label.to_owned(), style: 0, reference: Some("uts".to_owned()), points }
    }

    #[test]
    fn differences_are_paired_by_field_in_the_order_of_the_curves() {
        let lone = CurveValues { reference: None, ..curve("lower bound", &[(1, 0.0)]) };
        let rfs = curve("rfs", &[(1, 0.25), (2, 0.5), (3, 1.0)]);
        let curves = [rfs, curve("uts", &[(1, 0.125), (2, 0.25), (3, 0.5)]), curve("horizon", &[(2, 0.125)]), lone];
        let shown = differences(&curves, &[100.0], Support::Fraction);
        let means: Vec<_> = shown.iter().map(|series| (series.label.as_str(), series.points[0].mean)).collect();
        // (0.125 + 0.25 + 0.5)/3, and 0.125 − 0.25
        assert_eq!(means, [("rfs", 0.875 / 3.0), ("uts", 0.0), ("horizon", -0.125)]);
        let has_limits = shown.iter().map(|series| series.points[0].limits.is_some());
        assert_eq!(
            has_limits.collect::<Vec<_>>(),
            [true, false, false],
            "the reference, and a single field, have none"
        );
    }

    #[test]
    fn paired_differences_have_narrower_intervals_than_the_values() {
        // Fields differ by up to 0.4, the strategies over each of them by 0.01 or 0.02.
        let uts: Vec<_> = (1..=20).map(|seed| (seed, 0.02 * seed as f64)).collect();
        let gfs: Vec<_> = uts.iter().map(|&(seed, loss)| (seed, loss + 0.01 * (1 + seed % 2) as f64)).collect();
        let curves = [curve("uts", &uts), curve("gfs", &gfs)];
        let width = |series: &Series| series.points[0].limits.map_or(f64::NAN, |[low, high]| high - low);
        let [apart, paired] =
            [curves[1].means(&[1.0], Support::Fraction), differences(&curves, &[1.0], Support::Fraction).remove(1)];
        assert!((paired.points[0].mean - 0.015).abs() < 1e-12);
        assert!(width(&paired) < width(&apart) / 10.0, "{} against {}", width(&paired), width(&apart));
    }
}
