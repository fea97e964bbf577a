//! How the figures look: the embedded font, text sizes, and what tells the series apart in colour and without it.

use plotters::style::{FontDesc, FontFamily, FontStyle, RGBColor, register_font};
use std::sync::Once;

/// Axis lines and text.
pub const INK: RGBColor = RGBColor(0x20, 0x20, 0x20);
/// Footer.
pub const FAINT: RGBColor = RGBColor(0x66, 0x66, 0x66);
/// Path on a map.
pub const PATH: RGBColor = RGBColor(0x90, 0x90, 0x90);
/// Grid lines.
pub const GRID: RGBColor = RGBColor(0xDD, 0xDD, 0xDD);
/// Width of axis lines and ticks [units].
pub const AXIS_WIDTH: f64 = 2.0;

/// Em of the title [units].
pub const TITLE_EM: f64 = 34.0;
/// Em of axis labels and legend [units].
pub const LABEL_EM: f64 = 32.0;
/// Em of tick labels [units].
pub const TICK_EM: f64 = 28.0;
/// Em of the footer [units].
pub const FOOTER_EM: f64 = 20.0;

/// The font families that an SVG names; the first is the embedded one, by which text is measured.
const FAMILY: &str = "DejaVu Sans, Verdana, Arial, sans-serif";
/// Ascent plus descent of the embedded font [em], by which `ab_glyph` scales.
const LINE_PER_EM: f64 = (1901.0 + 483.0) / 2048.0;
/// DejaVu Sans reduced to the characters of [`lacks`]; licence and command in `DejaVuSans-subset.LICENSE.txt`.
static DEJAVU_SANS: &[u8] = include_bytes!("DejaVuSans-subset.ttf");

/// The embedded font at a plotters size [units], which is `LINE_PER_EM` ems in bitmaps and 1.24 ems in SVG.
///
/// # Panics
/// Never: the embedded font is valid.
pub fn font(size: f64) -> FontDesc<'static> {
    static REGISTERED: Once = Once::new();
    REGISTERED.call_once(|| {
        if register_font(FAMILY, FontStyle::Normal, DEJAVU_SANS).is_err() {
            unreachable!("the embedded font is a valid TrueType file");
        }
    });
    FontDesc::new(FontFamily::Name(FAMILY), size, FontStyle::Normal)
}

/// Plotters size at which `ab_glyph` draws an em of `em`.
pub fn bitmap_size(em: f64) -> f64 {
    em * LINE_PER_EM
}

/// Width [units] of `text` at an em of `em` [units].
///
/// # Panics
/// Never: the embedded font is valid.
pub fn text_width(text: &str, em: f64) -> f64 {
    const FINE: f64 = 1000.0; // plotters measures in whole pixels
    let ((left, _), (right, _)) = font(bitmap_size(FINE)).layout_box(text).expect("the font is embedded");
    f64::from(right - left) / FINE * em
}

/// `em`, or the smaller em at which `text` fits into `room` [units] with some room left for a viewer's wider font.
pub fn fitting(text: &str, em: f64, room: f64) -> f64 {
    em.min(em * room / (1.08 * text_width(text, em)).max(1.0))
}

/// First character of `text` that the embedded font lacks.
pub fn lacks(text: &str) -> Option<char> {
    text.chars().find(|character| {
        !matches!(character,
            ' '..='~' | '\u{a0}'..='\u{17f}' | 'Α'..='Ρ' | 'Σ'..='ω' | '‐'..='—' | '‘' | '’' | '“' | '”' | '…' | '‰'
            | '⁰' | '⁴'..='⁹' | '⁻' | '₀'..='₉' | '←'..='↓' | '∆' | '∑' | '−' | '√' | '∝' | '∞' | '≈' | '≠' | '≤' | '≥')
    })
}

/// What tells one series from another.
#[derive(Debug, Clone, Copy)]
pub struct SeriesStyle {
    /// From the palette of Okabe and Ito, which colour-blind readers can tell apart; they differ in lightness too.
    pub colour: RGBColor,
    /// Lengths [units] of dash, gap, dash, gap ...; empty for a solid line.
    pub dashes: &'static [f64],
    /// Width [units] of the line: later series are thinner, so that they do not hide an earlier one.
    pub width: f64,
    /// Sign at every point.
    pub marker: Marker,
}

/// A sign at a point. They are of different size and open or small, so that all are seen where curves coincide.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Marker {
    /// ○
    Circle,
    /// □
    Square,
    /// △
    Triangle,
    /// ×
    Cross,
    /// •
    Dot,
    /// ◇
    Diamond,
    /// ▽
    Nabla,
    /// +
    Plus,
    /// ☆, of three strokes
    Star,
    /// None.
    Bare,
}

/// The first series in the order of a chart: rfs, gfs, uts, uts-wide, exact, tour, round-robin, max-age-first, horizon, the best
/// known, the lower bound.
static SERIES: [SeriesStyle; 11] = [
    SeriesStyle { colour: RGBColor(0xE6, 0x9F, 0x00), dashes: &[], width: 6.0, marker: Marker::Circle },
    SeriesStyle { colour: RGBColor(0x00, 0x9E, 0x73), dashes: &[30.0, 14.0], width: 5.0, marker: Marker::Square },
    SeriesStyle { colour: RGBColor(0x00, 0x72, 0xB2), dashes: &[], width: 3.5, marker: Marker::Triangle },
    SeriesStyle {
        colour: RGBColor(0xD5, 0x5E, 0x00),
        dashes: &[20.0, 8.0, 4.0, 8.0],
        width: 4.0,
        marker: Marker::Cross,
    },
    SeriesStyle { colour: RGBColor(0x00, 0x00, 0x00), dashes: &[5.0, 7.0], width: 4.0, marker: Marker::Dot },
    SeriesStyle { colour: RGBColor(0x56, 0xB4, 0xE9), dashes: &[], width: 4.0, marker: Marker::Diamond },
    SeriesStyle { colour: RGBColor(0x99, 0x99, 0x99), dashes: &[10.0, 6.0], width: 4.0, marker: Marker::Plus },
    SeriesStyle { colour: RGBColor(0xB8, 0xA4, 0x00), dashes: &[18.0, 6.0], width: 4.0, marker: Marker::Nabla },
    SeriesStyle { colour: RGBColor(0xCC, 0x79, 0xA7), dashes: &[], width: 6.0, marker: Marker::Star },
    SeriesStyle { colour: RGBColor(0x66, 0x22, 0x55), dashes: &[], width: 2.0, marker: Marker::Bare },
    SeriesStyle { colour: RGBColor(0x55, 0x55, 0x55), dashes: &[3.0, 6.0], width: 3.0, marker: Marker::Bare },
];

impl SeriesStyle {
    /// The style of the series with this index. After the last of [`SERIES`] colours and lines begin again, each time with
    /// other markers.
    pub fn of(index: usize) -> Self {
        const MARKED: usize = 9; // the first series, each with a marker of its own
        let style = SERIES[index % SERIES.len()];
        match index / SERIES.len() {
            0 => style,
            round => Self { marker: SERIES[(index + 2 * round) % MARKED].marker, ..style },
        }
    }

    /// Cuts `curve` [units] into dashes, which go on around its corners.
    pub fn dashed(&self, curve: Vec<[f64; 2]>) -> Vec<Vec<[f64; 2]>> {
        if self.dashes.is_empty() {
            return vec![curve];
        }
        let mut lengths = self.dashes.iter().copied().cycle();
        let mut left = lengths.next().expect("a cycle does not end");
        let mut pieces = vec![vec![curve[0]]];
        for ends in curve.windows(2) {
            let ([x, y], [dx, dy]) = (ends[0], [ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]]);
            let length = dx.hypot(dy);
            let mut done = 0.0;
            while length - done > left {
                done += left;
                let cut = [x + dx * done / length, y + dy * done / length];
                pieces.last_mut().expect("there is a first piece").push(cut);
                pieces.push(vec![cut]);
                left = lengths.next().expect("a cycle does not end");
            }
            left -= length - done;
            pieces.last_mut().expect("there is a first piece").push(ends[1]);
        }
        pieces.into_iter().step_by(2).filter(|dash| dash.len() > 1).collect()
    }
}

impl Marker {
    /// Strokes [units] of the sign about `centre`.
    pub fn strokes(self, [x, y]: [f64; 2]) -> Vec<Vec<[f64; 2]>> {
        let ring = |corners: u32, radius: f64, turn: f64| {
            let corner = |i| {
                let angle = std::f64::consts::TAU * (f64::from(i) / f64::from(corners) + turn);
                [x + radius * angle.sin(), y - radius * angle.cos()]
            };
            (0..=corners).map(corner).collect::<Vec<_>>()
        };
        match self {
            Self::Circle => vec![ring(24, 9.0, 0.0)],
            Self::Square => vec![ring(4, 22.0, 0.125)],
            Self::Triangle => vec![ring(3, 26.0, 0.0)],
            Self::Cross => [12.0, -12.0].map(|r| vec![[x - 12.0, y - r], [x + 12.0, y + r]]).into(),
            Self::Diamond => vec![ring(4, 15.0, 0.0)],
            Self::Nabla => vec![ring(3, 20.0, 0.5)],
            Self::Plus => vec![vec![[x - 13.0, y], [x + 13.0, y]], vec![[x, y - 13.0], [x, y + 13.0]]],
            Self::Star => {
                let corners = ring(6, 17.0, 0.0);
                (0..3).map(|i| vec![corners[i], corners[i + 3]]).collect()
            }
            Self::Bare => Vec::new(),
            Self::Dot => vec![ring(12, 1.4, 0.0), ring(12, 4.0, 0.0)],
        }
    }
}

/// Colour of a fraction: cividis (Nuñez, Anderton and Renslow, 2018) from light (0) to dark (1).
///
/// Its lightness is monotonic, so that it reads in grey; what matters most, a high fraction, is darkest.
pub fn shade(fraction: f64) -> RGBColor {
    const DARK_TO_LIGHT: [[f64; 3]; 9] = [
        [0.0, 34.0, 78.0],
        [26.0, 56.0, 111.0],
        [67.0, 78.0, 108.0],
        [97.0, 101.0, 111.0],
        [125.0, 124.0, 120.0],
        [155.0, 148.0, 118.0],
        [188.0, 174.0, 108.0],
        [222.0, 201.0, 88.0],
        [254.0, 232.0, 56.0],
    ];
    let position = (1.0 - fraction.clamp(0.0, 1.0)) * 8.0;
    let below = (position as usize).min(7);
    let mix = |channel: usize| {
        let (a, b) = (DARK_TO_LIGHT[below][channel], DARK_TO_LIGHT[below + 1][channel]);
        (a + (b - a) * (position - below as f64)).round() as u8
    };
    RGBColor(mix(0), mix(1), mix(2))
}
