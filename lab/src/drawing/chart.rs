//! Charts: curves of means with 95 % confidence bands.

use std::path::{Path, PathBuf};

pub use super::axis::Scale;
use super::axis::{Axis, Panel};
use super::page::{Look, MARGIN, Page, line, stroke};
use super::style::SeriesStyle;
use crate::error::LabError;
use skysink_common::figure::Support;

/// Lower end of the x axis with its labels, for a screen [units].
const BOTTOM: f64 = 970.0;
/// Height of the panel over the width of the page, in print.
const PANEL_ASPECT: f64 = 0.5;
/// Font size of the axes and the legend [units].
const EM: f64 = 28.0;

/// A mean over missions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurvePoint {
    /// Value of the swept key in the unit of the x axis, or the index of a word.
    pub x: f64,
    /// Number of missions.
    pub n: usize,
    /// Mean, in the unit of the y axis.
    pub mean: f64,
    /// Limits of its 95 % confidence interval, in the same unit; `None` for a single mission.
    pub limits: Option<[f64; 2]>,
}

/// A curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Label in the legend.
    pub label: String,
    /// Index of the style.
    pub style: usize,
    /// Its points by ascending `x`; at least one.
    pub points: Vec<CurvePoint>,
}

/// Curves over the same axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    /// Texts and size of the page.
    pub look: Look,
    /// Label of the x axis, with its unit.
    pub x_label: String,
    /// The categories of the x axis; empty if it is numeric.
    pub x_words: Vec<String>,
    /// Label of the y axis, with its unit.
    pub y_label: String,
    /// The curves; at least one.
    pub series: Vec<Series>,
    /// The range of the quantity.
    pub support: Support,
    /// Scale of the y axis. On a logarithmic scale, bands are clipped at its lower end, where means of 0 are drawn.
    pub y_scale: Scale,
}

impl Chart {
    /// Writes `stem`.svg, and with the feature `pictures` `stem`.pdf and `stem`.png; the same chart gives the same
    /// bytes.
    ///
    /// # Errors
    /// If a mean is not finite or negative on a logarithmic scale, all means are 0 on a logarithmic scale, the embedded
    /// font lacks a character, or a file cannot be written.
    pub fn draw(&self, stem: &Path) -> Result<Vec<PathBuf>, LabError> {
        self.check()?;
        let mut page = Page::new(&self.look);
        let width = self.look.width();
        let is_print = self.look.width_mm.is_some();
        let styled = || self.series.iter().map(|series| (series, SeriesStyle::of(series.style, is_print)));
        let entries: Vec<_> = styled().map(|(series, style)| (style.sample(), series.label.as_str())).collect();
        let top = page.add_legend([MARGIN, self.look.top()], width - 2.0 * MARGIN, EM, &entries) + 10.0;
        let below = 3.0 * EM;
        let bottom = self.look.width_mm.map_or(BOTTOM, |_| top + PANEL_ASPECT * width + below);
        let mut panel =
            Panel { corner: [0.0, top], size: [0.0, bottom - below - top], x: self.x_axis(), y: self.y_axis(), em: EM };
        panel.corner[0] = MARGIN + panel.left_room();
        panel.size[0] = width - 2.0 * MARGIN - panel.corner[0]; // half a tick label fits in on the right
        panel.draw_grid(&mut page);
        panel.draw_axes(&mut page);
        if self.x_words.is_empty() {
            styled().for_each(|(series, style)| series.draw_bands(&mut page, &panel, &style));
            styled().for_each(|(series, style)| page.add(style.curve(&series.means(&panel))));
            styled().for_each(|(series, style)| page.add(style.markers(&series.means(&panel))));
        } else {
            // Categories are not connected: one bar per interval, side by side.
            let step = 0.7 / self.series.len() as f64;
            for (place, (series, style)) in styled().enumerate() {
                let offset = step * (place as f64 - (self.series.len() - 1) as f64 / 2.0);
                let single = |point: &CurvePoint| vec![CurvePoint { x: point.x + offset, ..*point }];
                for points in series.points.iter().map(single) {
                    let series = Series { points, ..series.clone() };
                    series.draw_bands(&mut page, &panel, &style);
                    page.add(style.markers(&series.means(&panel)));
                }
            }
        }
        page.write(stem, bottom)
    }

    /// Refuses means that are not on the axis.
    fn check(&self) -> Result<(), LabError> {
        let is_log = self.y_scale == Scale::Log;
        let is_drawable = |mean: f64| mean.is_finite() && (!is_log || mean >= 0.0);
        let title = || self.look.title.clone();
        match self.points().find(|point| !is_drawable(point.mean)) {
            Some(&CurvePoint { x, mean, .. }) => Err(LabError::FigureMean { title: title(), x, mean }),
            None if is_log && self.points().all(|point| point.mean == 0.0) => {
                Err(LabError::FigureZeros { title: title() })
            }
            None => Ok(()),
        }
    }

    fn points(&self) -> impl Iterator<Item = &CurvePoint> + Clone {
        self.series.iter().flat_map(|series| &series.points)
    }

    fn x_axis(&self) -> Axis {
        match &self.x_words[..] {
            [] => Axis::around(&self.x_label, self.points().map(|point| point.x), Scale::Linear),
            words => Axis::of_words(&self.x_label, words),
        }
    }

    /// The y axis, with room for all means and confidence limits, and for zero if the values are near it.
    fn y_axis(&self) -> Axis {
        let is_at_end = |mean: &f64| self.y_scale == Scale::Log && *mean == 0.0;
        let means = self.points().map(|point| point.mean).filter(|mean| !is_at_end(mean));
        let lowest = means.clone().fold(f64::INFINITY, f64::min);
        let highest = means.fold(f64::NEG_INFINITY, f64::max);
        let limits = self.points().filter_map(|point| point.limits).flatten();
        let shown = |limit: &f64| self.y_scale == Scale::Linear || *limit > lowest / 3.0;
        let near_zero = self.y_scale == Scale::Linear && lowest >= 0.0 && lowest < highest / 2.0;
        let zero = near_zero.then_some(0.0);
        let values = limits.filter(shown).chain([lowest, highest]).chain(zero);
        let axis = Axis::around(&self.y_label, values, self.y_scale);
        if self.points().any(|point| is_at_end(&point.mean)) { axis.with_zero() } else { axis }
    }
}

impl Series {
    /// The positions of its means on the page [units].
    fn means(&self, panel: &Panel) -> Vec<[f64; 2]> {
        self.points.iter().map(|point| panel.at(point.x, point.mean)).collect()
    }

    /// Draws a band over every run of points with confidence limits, or a bar for a single point.
    fn draw_bands(&self, page: &mut Page, panel: &Panel, style: &SeriesStyle) {
        for run in self.points.chunk_by(|a, b| a.limits.is_some() == b.limits.is_some()) {
            let side = |i: usize| run.iter().filter_map(move |point| Some(panel.at(point.x, point.limits?[i])));
            if run[0].limits.is_none() {
                continue;
            }
            let edge = line(side(0).chain(side(1).rev())) + "z";
            let width = if run.len() == 1 { 6.0 } else { 1.0 };
            page.add(stroke(edge, width, &style.colour).set("fill", &*style.colour).set("fill-opacity", 0.16));
        }
    }
}
