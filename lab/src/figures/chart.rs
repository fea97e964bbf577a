//! Curves of means with 95 % confidence bands, a curve per strategy.

use std::path::Path;

pub use super::axis::Scale;
use super::axis::{Axis, Panel};
use super::page::{MARGIN, Page, TOP, WIDTH, line, stroke};
use super::style::SeriesStyle;
use crate::error::LabError;
use crate::sweep::statistics::Support;

/// Lower end of the x axis with its labels [units].
const BOTTOM: f64 = 970.0;
/// Em of the axes and the legend [units].
const EM: f64 = 28.0;

/// A mean over missions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurvePoint {
    /// What was varied, in the unit of the x axis.
    pub x: f64,
    /// Mean, in the unit of the y axis.
    pub mean: f64,
    /// Limits of its 95 % confidence interval, in the same unit; none of a single mission.
    pub limits: Option<[f64; 2]>,
}

/// A curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Name in the legend.
    pub label: String,
    /// Its points by ascending `x`, at least one.
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
    /// Over which fields the curves were flown.
    pub seeds: String,
    /// Missions, version, command: not drawn, but in the file.
    pub description: String,
    /// Which values the quantity can have.
    pub support: Support,
    /// Scale of the y axis; where it is logarithmic, a band that reaches below the axis ends there.
    pub y_scale: Scale,
}

impl Chart {
    /// Writes `stem`.svg and `stem`.png; the same chart gives the same bytes.
    ///
    /// # Errors
    /// A mean that has no place, a character that the embedded font lacks, a file that cannot be written.
    pub fn draw(&self, stem: &Path) -> Result<(), LabError> {
        let has_place = |mean: f64| mean.is_finite() && (self.y_scale == Scale::Linear || mean > 0.0);
        if let Some(CurvePoint { x, mean, .. }) = self.points().find(|point| !has_place(point.mean)) {
            let expected = "expected a finite number, above 0 on a logarithmic scale";
            return Err(LabError::Figure(format!("{:?}: mean {mean} at {x}: {expected}", self.title)));
        }
        let mut page = Page::new(&self.title, &self.description);
        let styled: Vec<_> = self.series.iter().zip((0..).map(SeriesStyle::of)).collect();
        let entries: Vec<_> = styled.iter().map(|(series, style)| (style.sample(), series.label.as_str())).collect();
        let top = page.add_legend([MARGIN, TOP], WIDTH - 2.0 * MARGIN, EM, &entries) + 10.0;
        let xs = self.points().map(|point| point.x);
        let mut panel = Panel {
            corner: [0.0, top],
            size: [0.0, BOTTOM - 3.0 * EM - top],
            x: Axis::around(&self.x_label, xs, Scale::Linear),
            y: self.y_axis(),
            em: EM,
        };
        panel.corner[0] = MARGIN + panel.left_room();
        panel.size[0] = WIDTH - 2.0 * MARGIN - panel.corner[0]; // half a tick label fits in on the right
        panel.draw_grid(&mut page);
        panel.draw_axes(&mut page);
        for (series, style) in &styled {
            series.draw_bands(&mut page, &panel, style);
        }
        for (series, style) in &styled {
            page.add(style.curve(&series.means(&panel)));
        }
        for (series, style) in &styled {
            page.add(style.markers(&series.means(&panel)));
        }
        page.write(stem, BOTTOM)
    }

    /// The chart as a Markdown table.
    #[must_use]
    pub fn table(&self) -> String {
        let labels: Vec<&str> = self.series.iter().map(|series| series.label.as_str()).collect();
        let interval = if self.support == Support::Real { "± half of the 95 % CI" } else { "[95 % CI]" };
        let mut table = format!("\n**{}**; {}, mean {interval}\n\n", self.title, self.y_label);
        table += &format!("| {} | {} |\n|{}\n", self.x_label, labels.join(" | "), " --- |".repeat(labels.len() + 1));
        for (index, point) in self.series[0].points.iter().enumerate() {
            let cells: Vec<String> = self.series.iter().map(|series| series.points[index].cell(self.support)).collect();
            table += &format!("| {} | {} |\n", point.x, cells.join(" | "));
        }
        table
    }

    fn points(&self) -> impl Iterator<Item = &CurvePoint> + Clone {
        self.series.iter().flat_map(|series| &series.points)
    }

    /// All means and confidence limits, and zero if the values reach near it.
    fn y_axis(&self) -> Axis {
        let means = self.points().map(|point| point.mean);
        let lowest = means.clone().fold(f64::INFINITY, f64::min);
        let highest = means.fold(f64::NEG_INFINITY, f64::max);
        let limits = self.points().filter_map(|point| point.limits).flatten();
        let shown = |limit: &f64| self.y_scale == Scale::Linear || *limit > lowest / 3.0;
        let near_zero = self.y_scale == Scale::Linear && lowest >= 0.0 && lowest < highest / 2.0;
        let zero = near_zero.then_some(0.0);
        Axis::around(&self.y_label, limits.filter(shown).chain([lowest, highest]).chain(zero), self.y_scale)
    }
}

impl CurvePoint {
    /// The mean with its confidence interval, in as many digits as its size needs. By Student's t the interval is
    /// symmetric; that of a bounded quantity need not be.
    fn cell(&self, support: Support) -> String {
        let Self { mean, limits, .. } = self;
        let digits = match mean.abs() {
            100.0.. => 0,
            1.0.. => 1,
            _ => 4,
        };
        let number = |value: f64| {
            let text = format!("{value:.digits$}");
            // Not −0.0000.
            text.strip_prefix('-')
                .filter(|text| text.bytes().all(|byte| b"0.".contains(&byte)))
                .unwrap_or(&text)
                .to_owned()
        };
        match limits {
            None => number(*mean),
            Some([_, high]) if support == Support::Real => format!("{} ± {}", number(*mean), number(high - mean)),
            Some([low, high]) => format!("{} [{}, {}]", number(*mean), number(*low), number(*high)),
        }
    }
}

impl Series {
    /// Where its means are on the page [units].
    fn means(&self, panel: &Panel) -> Vec<[f64; 2]> {
        self.points.iter().map(|point| panel.at(point.x, point.mean)).collect()
    }

    /// Draws an area over every stretch of points that have confidence limits, and a bar at a lone one.
    fn draw_bands(&self, page: &mut Page, panel: &Panel, style: &SeriesStyle) {
        for stretch in self.points.chunk_by(|a, b| a.limits.is_some() == b.limits.is_some()) {
            let side = |i: usize| stretch.iter().filter_map(move |point| Some(panel.at(point.x, point.limits?[i])));
            if stretch[0].limits.is_none() {
                continue;
            }
            let edge = line(side(0).chain(side(1).rev())) + "z";
            let width = if stretch.len() == 1 { 6.0 } else { 1.0 };
            page.add(stroke(edge, width, style.colour).set("fill", style.colour).set("fill-opacity", 0.16));
        }
    }
}
