//! Axes: their range, the position of values, the tick labels, and the panel of two axes.

use super::page::{INK, Page, fitting, line, stroke, text, text_width};

/// The scale of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    Linear,
    /// Logarithmic; every value is above 0.
    Log,
}

/// An axis from `low` to `high`.
#[derive(Debug, Clone)]
pub struct Axis {
    label: String,
    low: f64,
    high: f64,
    scale: Scale,
    naming: Naming,
}

/// The tick labels of an axis.
#[derive(Debug, Clone)]
enum Naming {
    /// Round values.
    Round,
    /// Round values, and 0 at the lower end of a logarithmic scale.
    RoundAndZero,
    /// Words for 0, 1, 2 and so on.
    Words(Vec<String>),
}

/// A tick: its position, from 0 at the lower end of the axis to 1 at the upper end, and its label.
type Tick = (f64, String);

impl Axis {
    /// A linear axis that ends exactly at `low` and `high`.
    pub fn exact(label: &str, [low, high]: [f64; 2]) -> Self {
        Self { label: label.to_owned(), low, high, scale: Scale::Linear, naming: Naming::Round }
    }

    /// An axis of categories at 0, 1, 2 and so on.
    pub fn of_words(label: &str, words: &[String]) -> Self {
        let naming = Naming::Words(words.to_vec());
        Self { naming, ..Self::exact(label, [-0.5, words.len() as f64 - 0.5]) }
    }

    /// Extends a logarithmic axis by a position for 0 at its lower end.
    pub fn with_zero(self) -> Self {
        Self { low: self.low / (self.high / self.low).powf(0.15), naming: Naming::RoundAndZero, ..self }
    }

    /// An axis with the range of `values` (finite; above 0 on a logarithmic scale) and a margin of 4 % at both ends.
    pub fn around(label: &str, values: impl Iterator<Item = f64> + Clone, scale: Scale) -> Self {
        let low = values.clone().fold(f64::INFINITY, f64::min);
        let high = values.fold(f64::NEG_INFINITY, f64::max);
        let [low, high] = match scale {
            Scale::Linear => {
                let margin = 0.04 * if high > low { high - low } else { high.abs().max(1.0) };
                [low - margin, high + margin]
            }
            Scale::Log => {
                let margin = if high > low { (high / low).powf(0.04) } else { 3.0 };
                [low / margin, high * margin]
            }
        };
        Self { label: label.to_owned(), low, high, scale, naming: Naming::Round }
    }

    /// Position of `value`: 0 at the lower end, 1 at the upper end. Clipped at 0 on a logarithmic scale.
    fn position(&self, value: f64) -> f64 {
        match self.scale {
            Scale::Linear => (value - self.low) / (self.high - self.low),
            Scale::Log => (value.max(self.low) / self.low).ln() / (self.high / self.low).ln(),
        }
    }

    /// The ticks of the axis: all its words, or at most `most` round values.
    fn ticks(&self, most: usize) -> Vec<Tick> {
        match &self.naming {
            Naming::Round => self.round_ticks(most),
            Naming::RoundAndZero => {
                let has_room = |(position, _): &Tick| *position > 0.07;
                let round = self.round_ticks(most).into_iter().filter(has_room);
                [(0.0, "0".to_owned())].into_iter().chain(round).collect()
            }
            Naming::Words(words) => {
                (0..).zip(words).map(|(i, word)| (self.position(f64::from(i)), word.clone())).collect()
            }
        }
    }

    /// At most `most` round values on the axis.
    fn round_ticks(&self, most: usize) -> Vec<Tick> {
        let decimals = match self.scale {
            Scale::Linear => self.linear_ticks(most),
            Scale::Log => self.log_ticks(most),
        };
        let tick = |(mantissa, exponent)| (decimal(mantissa, exponent), label(mantissa, exponent));
        let on_axis = |(value, _): &Tick| (self.low..=self.high).contains(value);
        decimals.into_iter().map(tick).filter(on_axis).map(|(value, label)| (self.position(value), label)).collect()
    }

    /// Multiples of 1, 2 or 5 times a power of ten, as mantissa and exponent of ten.
    fn linear_ticks(&self, most: usize) -> Vec<(i64, i32)> {
        let finest = ((self.high - self.low) / most.max(1) as f64).log10().floor() as i32;
        let steps = (finest..).flat_map(|exponent| [1, 2, 5].map(|factor| (factor, exponent)));
        let multiples = |(factor, exponent)| {
            let step = decimal(factor, exponent);
            let multiples = (self.low / step).ceil() as i64..=(self.high / step).floor() as i64;
            multiples.map(|multiple| (multiple * factor, exponent)).collect::<Vec<_>>()
        };
        steps.map(multiples).find(|ticks| ticks.len() <= most.max(1)).expect("steps become as wide as needed")
    }

    /// Powers of ten, or 1, 2 and 5 times powers of ten if they fit, as mantissa and exponent of ten.
    fn log_ticks(&self, most: usize) -> Vec<(i64, i32)> {
        let low = self.low.log10();
        let high = self.high.log10();
        let decades = (high.floor() - low.ceil()) as usize + 1; // at least 1: a negative float becomes 0
        let stride = decades.div_ceil(most.max(1)) as i32;
        let factors: &[i64] = if 3 * decades <= most { &[1, 2, 5] } else { &[1] };
        let exponents = (low.floor() as i32..=high.floor() as i32).filter(|exponent| exponent % stride == 0);
        exponents.flat_map(|exponent| factors.iter().map(move |&factor| (factor, exponent))).collect()
    }
}

/// `mantissa` · 10^`exponent`, rounded once.
fn decimal(mantissa: i64, exponent: i32) -> f64 {
    format!("{mantissa}e{exponent}").parse().expect("a decimal number")
}

/// Formats `mantissa` · 10^`exponent` with the decimals of the exponent, or in scientific notation if these are too
/// many.
fn label(mantissa: i64, exponent: i32) -> String {
    let value = decimal(mantissa, exponent);
    if mantissa == 0 && exponent < -4 {
        return "0".to_owned();
    }
    if mantissa == 0 || exponent > -4 && value.abs() < 1e6 {
        return format!("{value:.*}", usize::try_from(-exponent).unwrap_or(0)).replace('-', "−");
    }
    let text = format!("{value:e}");
    let (mantissa, exponent) = text.split_once('e').expect("in this notation");
    let factor = if mantissa == "1" { String::new() } else { mantissa.replace('-', "−") + "·" };
    format!("{factor}10{}", superscript(exponent))
}

/// An integer in superscript digits.
fn superscript(number: &str) -> String {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let raised = |character: char| character.to_digit(10).map_or('⁻', |digit| DIGITS[digit as usize]);
    number.chars().map(raised).collect()
}

/// The plot area of two axes on a page.
#[derive(Debug)]
pub struct Panel {
    /// Upper left corner [units].
    pub corner: [f64; 2],
    /// Width and height [units].
    pub size: [f64; 2],
    /// Axis at the lower side.
    pub x: Axis,
    /// Axis at the left side.
    pub y: Axis,
    /// Font size [units].
    pub em: f64,
}

/// Distance from the side of a panel to its tick labels [units]. A tick is half as long.
const GAP: f64 = 16.0;

impl Panel {
    /// The position of the point (`x`, `y`) on the page [units].
    pub fn at(&self, x: f64, y: f64) -> [f64; 2] {
        [self.corner[0] + self.x.position(x) * self.size[0], self.bottom() - self.y.position(y) * self.size[1]]
    }

    /// Lower side [units].
    pub fn bottom(&self) -> f64 {
        self.corner[1] + self.size[1]
    }

    fn y_ticks(&self) -> Vec<Tick> {
        self.y.ticks((self.size[1] / (2.5 * self.em)) as usize + 1)
    }

    /// Width of the ticks, tick labels and axis label at the left side [units].
    pub fn left_room(&self) -> f64 {
        let widest = self.y_ticks().iter().map(|(_, label)| text_width(label, self.em)).fold(0.0, f64::max);
        GAP + widest + 1.7 * self.em
    }

    /// Draws a horizontal line at every tick of the y axis.
    pub fn draw_grid(&self, page: &mut Page) {
        let [left, _] = self.corner;
        for (position, _) in self.y_ticks() {
            let y = self.bottom() - position * self.size[1];
            page.add(stroke(line([[left, y], [left + self.size[0], y]]), 1.0, "#DDDDDD"));
        }
    }

    /// Draws frame, ticks and labels.
    pub fn draw_axes(&self, page: &mut Page) {
        let [left, top] = self.corner;
        let [width, height] = self.size;
        let bottom = self.bottom();
        let em = self.em;
        let mut lines = format!("M{left:.1},{top:.1}h{width:.1}v{height:.1}h-{width:.1}z");
        let room = match &self.x.naming {
            Naming::Words(words) => width / words.len() as f64,
            Naming::Round | Naming::RoundAndZero => f64::INFINITY,
        };
        let ticks = self.x.ticks((width / (4.0 * em)) as usize + 1);
        let tick_em = ticks.iter().map(|(_, label)| fitting(label, em, room)).fold(em, f64::min);
        for (position, label) in ticks {
            let x = left + position * width;
            lines += &format!("M{x:.1},{bottom:.1}v{}", GAP / 2.0);
            page.add(text(&label, [x, bottom + GAP + 0.76 * em], tick_em, "middle"));
        }
        for (position, label) in self.y_ticks() {
            let y = bottom - position * height;
            lines += &format!("M{left:.1},{y:.1}h-{}", GAP / 2.0);
            page.add(text(&label, [left - GAP, y + 0.36 * em], em, "end"));
        }
        page.add(stroke(lines, 2.0, INK));
        let at = [left + width / 2.0, bottom + GAP + 2.1 * em];
        page.add(text(&self.x.label, at, fitting(&self.x.label, 1.14 * em, width), "middle"));
        let turned =
            format!("translate({:.1} {:.1}) rotate(-90)", left - self.left_room() + 0.9 * em, top + height / 2.0);
        let label = text(&self.y.label, [0.0, 0.0], fitting(&self.y.label, 1.14 * em, height), "middle");
        page.add(label.set("transform", turned));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(axis: Axis, most: usize) -> Vec<String> {
        axis.ticks(most).into_iter().map(|(_, label)| label).collect()
    }

    #[test]
    fn linear_ticks_are_round_with_equal_decimals() {
        assert_eq!(labels(Axis::exact("", [-0.01, 0.26]), 7), ["0.00", "0.05", "0.10", "0.15", "0.20", "0.25"]);
        assert_eq!(labels(Axis::exact("", [-120.0, 120.0]), 5), ["−100", "−50", "0", "50", "100"]);
        assert_eq!(labels(Axis::exact("", [0.0, 4e-5]), 5), ["0", "10⁻⁵", "2·10⁻⁵", "3·10⁻⁵", "4·10⁻⁵"]);
    }

    #[test]
    fn logarithmic_ticks_are_powers_of_ten_or_round_steps() {
        let log = |low, high| Axis { scale: Scale::Log, ..Axis::exact("", [low, high]) };
        assert_eq!(labels(log(0.9, 30.0), 9), ["1", "2", "5", "10", "20"]);
        assert_eq!(labels(log(1.5e-7, 1.5e4), 7), ["10⁻⁶", "10⁻⁴", "0.01", "1", "100", "10000"]);
        assert_eq!(labels(log(5e-5, 2e3), 8), ["10⁻⁴", "0.001", "0.01", "0.1", "1", "10", "100", "1000"]);
    }

    #[test]
    fn an_axis_accepts_a_single_value() {
        for scale in [Scale::Linear, Scale::Log] {
            let position = Axis::around("", [7.0].into_iter(), scale).position(7.0);
            assert!((position - 0.5).abs() < 1e-12, "{scale:?}: {position}");
        }
    }
}
