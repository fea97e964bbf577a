//! An axis: which range it shows, where a value lies on it, and which values are named.

use plotters::coord::ranged1d::Ranged;
use plotters::coord::types::RangedCoordf64;

/// How values are spread over an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// Equal differences are equally far apart.
    Linear,
    /// Equal ratios are equally far apart; every value is above 0.
    Log,
}

/// An axis from `low` to `high`.
#[derive(Debug, Clone, Copy)]
pub struct Axis {
    low: f64,
    high: f64,
    scale: Scale,
}

impl Axis {
    /// A linear axis that ends exactly at `low` and `high`.
    pub fn exact(low: f64, high: f64) -> Self {
        Self { low, high, scale: Scale::Linear }
    }

    /// An axis that shows all `values` (finite; above 0 on a logarithmic scale) with a margin of 4 % at both ends.
    pub fn around(values: impl Iterator<Item = f64> + Clone, scale: Scale) -> Self {
        let low = values.clone().fold(f64::INFINITY, f64::min);
        let high = values.fold(f64::NEG_INFINITY, f64::max);
        match scale {
            Scale::Linear => {
                let reach = if high > low { high - low } else { high.abs().max(1.0) };
                Self { low: low - 0.04 * reach, high: high + 0.04 * reach, scale }
            }
            Scale::Log => {
                let margin = if high > low { (high / low).powf(0.04) } else { 3.0 };
                Self { low: low / margin, high: high * margin, scale }
            }
        }
    }

    /// Place of `value`, 0 at the low end and 1 at the high end.
    pub fn place(&self, value: f64) -> f64 {
        match self.scale {
            Scale::Linear => (value - self.low) / (self.high - self.low),
            Scale::Log => (value / self.low).ln() / (self.high / self.low).ln(),
        }
    }

    /// `value`, or the low end of the axis if that is higher.
    pub fn raised(&self, value: f64) -> f64 {
        value.max(self.low)
    }

    /// At most `most` round values on the axis with their labels.
    pub fn ticks(&self, most: usize) -> Vec<(f64, String)> {
        match self.scale {
            Scale::Linear => {
                let values = RangedCoordf64::from(self.low..self.high).key_points(most);
                let step = values.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
                values.into_iter().map(|value| (value, linear_label(value, step))).collect()
            }
            Scale::Log => self.log_ticks(most),
        }
    }

    /// Powers of ten, or 1, 2 and 5 times these where there is room for them.
    fn log_ticks(&self, most: usize) -> Vec<(f64, String)> {
        let (low, high) = (self.low.log10(), self.high.log10());
        let decades = (high.floor() - low.ceil()) as usize + 1; // at least 1: a negative float becomes 0
        let stride = decades.div_ceil(most.max(1)) as i32;
        let factors: &[u32] = if 3 * decades <= most { &[1, 2, 5] } else { &[1] };
        (low.floor() as i32..=high.floor() as i32)
            .filter(|exponent| exponent % stride == 0)
            .flat_map(|exponent| factors.iter().map(move |&factor| (factor, exponent)))
            .map(|(factor, exponent)| (f64::from(factor) * 10_f64.powi(exponent), log_label(factor, exponent)))
            .filter(|(value, _)| (self.low..=self.high).contains(value))
            .collect()
    }
}

/// A value with the decimals that tell it from the next one `step` away.
fn linear_label(value: f64, step: f64) -> String {
    let exponent = step.log10().floor() as i32;
    if value.abs() < step / 2.0 && exponent < -4 {
        return "0".to_owned();
    }
    let value = if value.abs() < step / 2.0 { 0.0 } else { value }; // no "−0.0"
    if exponent < -4 || value.abs() >= 1e6 {
        let exponent = value.abs().log10().floor() as i32;
        let mantissa = format!("{:.2}", value / 10_f64.powi(exponent));
        let mantissa = mantissa.trim_end_matches('0').trim_end_matches('.').replace('-', "−");
        return format!("{mantissa}·10{}", superscript(exponent));
    }
    format!("{value:.*}", usize::try_from(-exponent).unwrap_or(0)).replace('-', "−")
}

/// `factor` · 10^`exponent`, written out between 0.001 and 50 000.
fn log_label(factor: u32, exponent: i32) -> String {
    match (factor, exponent) {
        (_, -3..=4) => {
            format!("{:.*}", usize::try_from(-exponent).unwrap_or(0), f64::from(factor) * 10_f64.powi(exponent))
        }
        (1, _) => format!("10{}", superscript(exponent)),
        _ => format!("{factor}·10{}", superscript(exponent)),
    }
}

/// A whole number in raised digits.
fn superscript(number: i32) -> String {
    let raise = |character| match character {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        digit => char::from_u32('⁰' as u32 + digit as u32 - '0' as u32).expect("raised digits are in a row"),
    };
    number.to_string().chars().map(raise).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(axis: Axis, most: usize) -> Vec<String> {
        axis.ticks(most).into_iter().map(|(_, label)| label).collect()
    }

    #[test]
    fn ticks_of_a_linear_axis_are_round_and_share_their_decimals() {
        assert_eq!(labels(Axis::exact(-0.01, 0.26), 7), ["0.00", "0.05", "0.10", "0.15", "0.20", "0.25"]);
        assert_eq!(labels(Axis::exact(-120.0, 120.0), 5), ["−100", "−50", "0", "50", "100"]);
        assert_eq!(labels(Axis::exact(0.0, 4e-5), 5), ["0", "1·10⁻⁵", "2·10⁻⁵", "3·10⁻⁵", "4·10⁻⁵"]);
    }

    #[test]
    fn ticks_of_a_logarithmic_axis_are_powers_of_ten_and_round_steps_between_few() {
        let log = |low, high| Axis { low, high, scale: Scale::Log };
        assert_eq!(labels(log(0.9, 30.0), 9), ["1", "2", "5", "10", "20"]);
        assert_eq!(labels(log(1.5e-7, 1.5e4), 7), ["10⁻⁶", "10⁻⁴", "0.01", "1", "100", "10000"]);
        assert_eq!(labels(log(5e-5, 2e3), 8), ["10⁻⁴", "0.001", "0.01", "0.1", "1", "10", "100", "1000"]);
    }

    #[test]
    fn a_lone_value_still_has_an_axis() {
        for scale in [Scale::Linear, Scale::Log] {
            let place = Axis::around([7.0].into_iter(), scale).place(7.0);
            assert!((place - 0.5).abs() < 1e-12, "{scale:?}: {place}");
        }
    }
}
