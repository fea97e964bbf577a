//! Curves of means with 95 % confidence bands, a curve per strategy.

use std::path::Path;

use super::axis::Axis;
pub use super::axis::Scale;
use super::canvas::{Canvas, FontTransform, HPos, Text};
use super::error::FigureError;
use super::panel::{Grid, Panel, draw_footer, footer_height, footer_lines};
use super::style::{LABEL_EM, SeriesStyle, TICK_EM, TITLE_EM, fitting, text_width};
use crate::error::LabError;

/// Width and height of a chart [units, pixels of the PNG].
const SIZE: [u32; 2] = [1600, 1000];
/// Distance of everything from the edge of the sheet [units].
const MARGIN: f64 = 30.0;
/// Distance of the curves from the right edge [units]; half a tick label fits in.
const RIGHT_MARGIN: f64 = 55.0;
/// About so far apart are ticks [units], horizontally and vertically.
const TICK_SPACING: [f64; 2] = [140.0, 70.0];
/// Left of the curves, labels of the y axis take up about this much [units], hardly more.
const Y_AXIS: f64 = 200.0;
/// Line and sign of a legend entry are this wide [units].
const SAMPLE: f64 = 100.0;
/// Height of a row of legend entries [units].
const LEGEND_ROW: f64 = 56.0;
/// Width of the strokes of a marker [units].
const MARKER_WIDTH: f64 = 3.0;

/// A mean over missions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurvePoint {
    /// What was varied, in the unit of the x axis.
    pub x: f64,
    /// Mean, in the unit of the y axis.
    pub mean: f64,
    /// Half width of its 95 % confidence interval, in the same unit; NaN if there is none (a single mission).
    pub half_width: f64,
}

/// A curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Name in the legend.
    pub label: String,
    /// Its points by ascending `x`.
    pub points: Vec<CurvePoint>,
}

/// Curves over the same axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    /// Above everything.
    pub title: String,
    /// What was varied, with its unit.
    pub x_label: String,
    /// What was measured, with its unit.
    pub y_label: String,
    /// The curves, at least one; the index fixes colour, dashes and marker.
    pub series: Vec<Series>,
    /// Missions, seeds, version, command.
    pub footer: String,
    /// Scale of the y axis; where it is logarithmic, a band that reaches below the axis ends there.
    pub y_scale: Scale,
}

impl Chart {
    /// Writes `stem`.svg and `stem`.png; the same chart gives the same bytes.
    ///
    /// # Errors
    /// No series, a series without points, a number that cannot be placed, a character that the
    /// embedded font lacks, a file that cannot be written.
    pub fn draw(&self, stem: &Path) -> Result<(), LabError> {
        self.check()?;
        let mut canvas = Canvas::new(SIZE[0], SIZE[1]);
        let panel = self.draw_surroundings(&mut canvas);
        let styled = || self.series.iter().zip((0..).map(SeriesStyle::of));
        for (series, style) in styled() {
            series.draw_bands(&mut canvas, &panel, &style);
        }
        for (series, style) in styled() {
            draw_dashed(&mut canvas, series.means(&panel).collect(), &style);
        }
        for (series, style) in styled() {
            series.means(&panel).for_each(|at| draw_marker(&mut canvas, at, &style));
        }
        canvas.write(stem)
    }

    fn check(&self) -> Result<(), FigureError> {
        if self.series.is_empty() {
            return Err(FigureError::Nothing { place: format!("chart {:?}", self.title), what: "series" });
        }
        for series in &self.series {
            if series.points.is_empty() {
                return Err(FigureError::Nothing { place: self.place(series), what: "points" });
            }
            let mut last_x = f64::NEG_INFINITY;
            for &CurvePoint { x, mean, half_width } in &series.points {
                let place = || format!("{}, x = {x}", self.place(series));
                let ascending = x.is_finite() && x > last_x;
                FigureError::unless(ascending, || self.place(series), "x", x, "finite numbers in ascending order")?;
                FigureError::unless(mean.is_finite(), place, "mean", mean, "a finite number")?;
                let on_scale = self.y_scale == Scale::Linear || mean > 0.0;
                FigureError::unless(on_scale, place, "mean", mean, "above 0 on a logarithmic scale")?;
                let width = half_width.is_nan() || half_width.is_finite() && half_width >= 0.0;
                FigureError::unless(width, place, "half width", half_width, "at least 0, or NaN for none")?;
                last_x = x;
            }
        }
        Ok(())
    }

    fn place(&self, series: &Series) -> String {
        format!("chart {:?}, series {:?}", self.title, series.label)
    }

    /// Draws title, legend, axes, footer; gives the place for the curves.
    fn draw_surroundings(&self, canvas: &mut Canvas) -> Panel {
        let [width, height] = SIZE.map(f64::from);
        let footer = footer_lines(&self.footer, width - 2.0 * MARGIN);
        let below = footer_height(&footer) + MARGIN + Panel::bottom_margin(TICK_EM) + 1.9 * LABEL_EM;
        let rows = self.legend_rows(width - 2.0 * MARGIN - Y_AXIS);
        let top = MARGIN + 1.4 * TITLE_EM + LEGEND_ROW * rows.len() as f64 + 10.0;

        let points = || self.series.iter().flat_map(|series| &series.points);
        let mut panel = Panel {
            corner: [0.0, top],
            size: [0.0, height - below - top],
            x: Axis::around(points().map(|point| point.x), Scale::Linear),
            y: self.y_axis(),
        };
        let left = MARGIN + 1.5 * LABEL_EM + panel.left_margin(TICK_EM, TICK_SPACING[1]);
        panel.corner[0] = left;
        panel.size[0] = width - RIGHT_MARGIN - left;
        panel.draw(canvas, TICK_EM, TICK_SPACING, Grid::Rows);

        let middle = [left + panel.size[0] / 2.0, top + panel.size[1] / 2.0];
        let em = fitting(&self.title, TITLE_EM, panel.size[0]);
        canvas.text(Text::new(&self.title, [left, MARGIN + 0.8 * TITLE_EM], em, HPos::Left));
        let base = panel.bottom() + Panel::bottom_margin(TICK_EM) + 1.1 * LABEL_EM;
        let em = fitting(&self.x_label, LABEL_EM, panel.size[0]);
        canvas.text(Text::new(&self.x_label, [middle[0], base], em, HPos::Center));
        let em = fitting(&self.y_label, LABEL_EM, panel.size[1]);
        let y_label = Text::new(&self.y_label, [MARGIN + 0.8 * LABEL_EM, middle[1]], em, HPos::Center);
        canvas.text(Text { turn: FontTransform::Rotate270, ..y_label });
        self.draw_legend(canvas, rows, left);
        draw_footer(canvas, footer, [MARGIN, height - MARGIN]);
        panel
    }

    /// Draws the legend under the title, from `left` [units].
    fn draw_legend(&self, canvas: &mut Canvas, rows: Vec<Vec<(f64, usize)>>, left: f64) {
        for (row, entries) in rows.into_iter().enumerate() {
            let y = MARGIN + 1.4 * TITLE_EM + LEGEND_ROW * (row as f64 + 0.5);
            for (x, series) in entries {
                let style = SeriesStyle::of(series);
                draw_dashed(canvas, vec![[left + x, y], [left + x + SAMPLE, y]], &style);
                draw_marker(canvas, [left + x + SAMPLE / 2.0, y], &style);
                let at = [left + x + SAMPLE + 14.0, y + 0.36 * LABEL_EM];
                canvas.text(Text::new(&self.series[series].label, at, LABEL_EM, HPos::Left));
            }
        }
    }

    /// All means and confidence limits, and zero if the values reach near it.
    fn y_axis(&self) -> Axis {
        let points = || self.series.iter().flat_map(|series| &series.points);
        let lowest = points().map(|point| point.mean).fold(f64::INFINITY, f64::min);
        let highest = points().map(|point| point.mean).fold(f64::NEG_INFINITY, f64::max);
        let limits = points().flat_map(CurvePoint::limits).filter(|limit| limit.is_finite());
        let shown = |limit: &f64| self.y_scale == Scale::Linear || *limit > lowest / 3.0;
        let near_zero = self.y_scale == Scale::Linear && lowest >= 0.0 && lowest < highest / 2.0;
        let zero = near_zero.then_some(0.0);
        Axis::around(limits.filter(shown).chain([lowest, highest]).chain(zero), self.y_scale)
    }

    /// The legend: in each row the left end [units] and the number of every series.
    fn legend_rows(&self, width: f64) -> Vec<Vec<(f64, usize)>> {
        let mut rows = vec![Vec::new()];
        let mut x = 0.0;
        for (i, series) in self.series.iter().enumerate() {
            let entry = SAMPLE + 14.0 + 1.1 * text_width(&series.label, LABEL_EM); // a viewer's font may be wider
            if x > 0.0 && x + entry > width {
                rows.push(Vec::new());
                x = 0.0;
            }
            rows.last_mut().expect("there is a first row").push((x, i));
            x += entry + 40.0;
        }
        rows
    }
}

impl CurvePoint {
    /// Confidence limits; NaN where there are none.
    fn limits(&self) -> [f64; 2] {
        [self.mean - self.half_width, self.mean + self.half_width]
    }
}

impl Series {
    /// Where its means are on the sheet [units].
    fn means<'a>(&'a self, panel: &'a Panel) -> impl Iterator<Item = [f64; 2]> + 'a {
        self.points.iter().map(|point| panel.at(point.x, point.mean))
    }

    /// Draws an area over every stretch of points that have confidence limits, and a bar at a lone one.
    fn draw_bands(&self, canvas: &mut Canvas, panel: &Panel, style: &SeriesStyle) {
        for stretch in self.points.chunk_by(|a, b| a.half_width.is_nan() == b.half_width.is_nan()) {
            if stretch[0].half_width.is_nan() {
                continue;
            }
            let side = |i: usize| stretch.iter().map(move |point| panel.at(point.x, panel.y.raised(point.limits()[i])));
            let (lower, upper): (Vec<_>, Vec<_>) = (side(0).collect(), side(1).collect());
            if let ([below], [above]) = (&lower[..], &upper[..]) {
                canvas.line(vec![*below, *above], 2.0 * MARKER_WIDTH, style.colour);
                continue;
            }
            canvas.area(lower.iter().chain(upper.iter().rev()).copied().collect(), style.colour, 0.16);
            canvas.line(lower, 1.0, style.colour);
            canvas.line(upper, 1.0, style.colour);
        }
    }
}

fn draw_marker(canvas: &mut Canvas, at: [f64; 2], style: &SeriesStyle) {
    for stroke in style.marker.strokes(at) {
        canvas.line(stroke, MARKER_WIDTH, style.colour);
    }
}

/// Draws a curve in the dashes of its series.
fn draw_dashed(canvas: &mut Canvas, curve: Vec<[f64; 2]>, style: &SeriesStyle) {
    for dash in style.dashed(curve) {
        canvas.line(dash, style.width, style.colour);
    }
}
