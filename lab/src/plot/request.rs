//! What a plot of a sweep is to show, as on the command line.

use std::iter::zip;
use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use skysink_common::error::InputError;
use skysink_common::scenario::Setting;

use crate::drawing::page::{Look, check_text};
use skysink_mission::metrics::Metric;

/// Allowed width of the figure [mm].
const WIDTHS_MM: std::ops::RangeInclusive<f64> = 50.0..=1000.0;

/// The parameters of a plot of a sweep.
#[derive(Debug, Clone, Args)]
pub struct PlotRequest {
    /// Key of the sweep on the x axis, for example area.side_m.
    #[arg(long, value_name = "KEY", default_value = "", hide_default_value = true)]
    pub x: String,
    /// Metric on the y axis [default: loss_rate].
    #[arg(long, value_name = "METRIC", value_parser = metric_parser())]
    pub y: Option<Metric>,
    /// Strategies to draw, in this order, comma-separated [default: all of the sweep].
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub strategies: Vec<String>,
    /// Draw a curve for each strategy and value of this key, for example uav.altitude.
    #[arg(long, value_name = "KEY")]
    pub by: Option<String>,
    /// Draw the differences to this strategy, or with --by to this value, paired by seed.
    #[arg(long, value_name = "STRATEGY")]
    pub difference_to: Option<String>,
    /// Draw the best known loss and the lower bounds of the loss, too, for a sweep with the strategy offline.
    #[arg(long, conflicts_with = "by")]
    pub bounds: bool,
    /// Draw only missions with this value of another key, for example link.bandwidth_hz=5e3 (repeatable).
    #[arg(long = "where", value_name = "KEY=VALUE")]
    pub conditions: Vec<Setting>,
    /// Use a logarithmic y axis; means of 0 are drawn at its lower end.
    #[arg(long, conflicts_with = "difference_to")]
    pub log_y: bool,
    /// Write the means alone into the tables, without their intervals.
    #[arg(long)]
    pub means: bool,
    /// Label of a strategy in the figure, for example python:mine.py:Mine=ours (repeatable) [default: its name; the
    /// class of a Python strategy].
    #[arg(long = "label", value_name = "STRATEGY=TEXT", value_parser = parse_label)]
    pub labels: Vec<(String, String)>,
    /// Label of the x axis [default: the key].
    #[arg(long, value_name = "TEXT")]
    pub x_label: Option<String>,
    /// Label of the y axis [default: that of the metric].
    #[arg(long, value_name = "TEXT")]
    pub y_label: Option<String>,
}

/// How a page looks, and where its files go.
#[derive(Debug, Clone, Args)]
pub struct SheetOptions {
    /// Title above the figure [default: none].
    #[arg(long, value_name = "TEXT", default_value = "", hide_default_value = true)]
    pub title: String,
    /// Show seeds, intervals and version below the figure; the SVG always contains them as metadata.
    #[arg(long)]
    pub footer: bool,
    /// Printed width, for example 88mm, 18cm, 3.5in or 252pt; text is then 8 pt [default: sized for a screen].
    #[arg(long = "width", value_name = "WIDTH", value_parser = parse_width_mm)]
    pub width_mm: Option<f64>,
    /// Output folder; existing files are replaced [default: SWEEPDIR/plots, or plots beside the first run].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

impl SheetOptions {
    /// The look of the page; `description` follows `footer` in the metadata.
    pub(crate) fn look(&self, footer: String, description: &str) -> Look {
        let description = format!("{footer}{description}");
        let footer = if self.footer { footer } else { String::new() };
        Look { title: self.title.clone(), footer, description, width_mm: self.width_mm }
    }

    /// Refuses a title with characters that the embedded font lacks.
    pub(crate) fn check(&self) -> Result<(), InputError> {
        check_text(&self.title).map_err(|message| InputError::of_argument("--title", &self.title, message))
    }
}

impl PlotRequest {
    /// The first option that is given.
    pub fn given(&self) -> Option<&'static str> {
        let options = [
            ("--x", !self.x.is_empty()),
            ("--y", self.y.is_some()),
            ("--strategies", !self.strategies.is_empty()),
            ("--by", self.by.is_some()),
            ("--difference-to", self.difference_to.is_some()),
            ("--bounds", self.bounds),
            ("--where", !self.conditions.is_empty()),
            ("--log-y", self.log_y),
            ("--means", self.means),
            ("--label", !self.labels.is_empty()),
            ("--x-label", self.x_label.is_some()),
            ("--y-label", self.y_label.is_some()),
        ];
        options.into_iter().find(|(_, is_given)| *is_given).map(|(option, _)| option)
    }

    /// The metric on the y axis.
    pub(crate) fn metric(&self) -> Metric {
        self.y.unwrap_or(Metric::LossRate)
    }

    /// Refuses labels with characters that the embedded font lacks.
    pub(crate) fn check_texts(&self) -> Result<(), InputError> {
        for (option, text) in zip(["--x-label", "--y-label"], [&self.x_label, &self.y_label]) {
            let text = text.as_deref().unwrap_or_default();
            check_text(text).map_err(|message| InputError::of_argument(option, text, message))?;
        }
        for (_, text) in &self.labels {
            check_text(text).map_err(|message| InputError::of_argument("--label", text, message))?;
        }
        Ok(())
    }
}

/// Parses the name of a metric.
fn metric_parser() -> impl TypedValueParser<Value = Metric> {
    PossibleValuesParser::new(Metric::all().map(|metric| PossibleValue::new(metric.name()).help(metric.label())))
        .map(|name| Metric::all().find(|metric| metric.name() == name).expect("one of the possible values"))
}

/// Parses `STRATEGY=TEXT`.
fn parse_label(text: &str) -> Result<(String, String), String> {
    let pair = text.rsplit_once('=').filter(|(name, label)| !name.is_empty() && !label.trim().is_empty());
    let pair = pair.map(|(name, label)| (name.to_owned(), label.trim().to_owned()));
    pair.ok_or_else(|| "expected a strategy and its label, such as uts=UTS".to_owned())
}

/// Parses a length with its unit and returns it in [mm].
fn parse_width_mm(text: &str) -> Result<f64, String> {
    let number = text.trim_end_matches(|character: char| character.is_ascii_alphabetic());
    let unit_mm = match &text[number.len()..] {
        "mm" => 1.0,
        "cm" => 10.0,
        "in" => 25.4,
        "pt" => 25.4 / 72.0,
        _ => f64::NAN,
    };
    let width_mm = number.parse().map_or(f64::NAN, |number: f64| number * unit_mm);
    let expected = "expected a width from 50mm to 1000mm, such as 88mm, 18cm, 3.5in or 252pt";
    if WIDTHS_MM.contains(&width_mm) { Ok(width_mm) } else { Err(expected.to_owned()) }
}
