//! `skysink plot`: arguments and printed table.

use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use skysink_common::scenario::Setting;
use skysink_lab::figures::chart::Scale;
use skysink_lab::metrics::Metric;
use skysink_lab::plot::{Footer, Plot, PlotRequest, plot};
use skysink_ring::role::Role;

use crate::error::Error;
use crate::report::{print, table, with_numbers_right};

/// Printed below the options of `skysink plot --help`.
pub const EXAMPLES: &str = "\
Examples:
  skysink sweep scenarios/sweeps/letter.toml         writes runs/letter; then
  skysink plot runs/letter --x area.side_m --where link.bandwidth_hz=5e3
  skysink plot runs/letter --x area.side_m --where link.bandwidth_hz=5e3 \\
    --strategies uts,gfs --difference-to uts --width 88mm

The output is SVG, PDF and PNG, and the numbers as LaTeX and Markdown tables.
If several keys of the sweep vary, pass --where for each one except that of the
x axis. See docs/src/plot.md.";

/// Allowed width of the figure [mm].
const WIDTHS_MM: std::ops::RangeInclusive<f64> = 50.0..=1000.0;

/// Options of `skysink plot`.
#[derive(Debug, Args)]
pub struct PlotOptions {
    /// Output folder of a sweep.
    #[arg(value_name = "SWEEPDIR")]
    sweep: PathBuf,
    /// Key on the x axis, for example area.side_m.
    #[arg(long, value_name = "KEY")]
    x: String,
    /// Metric on the y axis.
    #[arg(long, value_name = "METRIC", default_value = "loss_rate", value_parser = metric_parser())]
    y: Metric,
    /// Strategies to draw, in this order, comma-separated [default: all of the sweep].
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    strategies: Vec<String>,
    /// Draw the differences to this strategy, paired by seed.
    #[arg(long, value_name = "STRATEGY")]
    difference_to: Option<String>,
    /// Draw only missions with this value of another key, for example link.bandwidth_hz=5e3 (repeatable).
    #[arg(long = "where", value_name = "KEY=VALUE")]
    conditions: Vec<Setting>,
    /// Use a logarithmic y axis; means of 0 are drawn at its lower end.
    #[arg(long, conflicts_with = "difference_to")]
    log_y: bool,
    /// Label of the x axis [default: the key].
    #[arg(long, value_name = "TEXT")]
    x_label: Option<String>,
    /// Label of the y axis [default: that of the metric].
    #[arg(long, value_name = "TEXT")]
    y_label: Option<String>,
    /// Title above the figure [default: none].
    #[arg(long, value_name = "TEXT", default_value = "", hide_default_value = true)]
    title: String,
    /// Show seeds, intervals and version below the figure; the SVG always contains them as metadata.
    #[arg(long)]
    footer: bool,
    /// Printed width, for example 88mm, 18cm, 3.5in or 252pt; text is then 8 pt [default: sized for a screen].
    #[arg(long, value_parser = parse_width_mm)]
    width: Option<f64>,
    /// Output folder; existing files are replaced [default: SWEEPDIR/plots].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print the numbers as JSON instead of the table.
    #[arg(long)]
    json: bool,
}

impl PlotOptions {
    /// Draws the figure and prints its numbers.
    ///
    /// # Errors
    /// As [`plot`].
    pub fn plot(self) -> Result<(), Error> {
        let drawn = plot(&PlotRequest {
            sweep: self.sweep,
            x: self.x,
            metric: self.y,
            strategies: self.strategies,
            reference: self.difference_to,
            conditions: self.conditions,
            y_scale: if self.log_y { Scale::Log } else { Scale::Linear },
            x_label: self.x_label,
            y_label: self.y_label,
            title: self.title,
            footer: if self.footer { Footer::Shown } else { Footer::Hidden },
            width_mm: self.width,
            out: self.out,
        })?;
        if self.json {
            return print(serde_json::to_string_pretty(&drawn).expect("plain numbers and strings"));
        }
        if let Some(missing) = &drawn.missing {
            Role::Launcher.log(missing);
        }
        print_points(&drawn)
    }
}

/// Prints one line per point of each curve, then the files.
fn print_points(drawn: &Plot) -> Result<(), Error> {
    print(&drawn.about)?;
    let mut table = table();
    table.set_header([drawn.x.as_str(), "", "", "missions"]);
    let mut last = "";
    for point in &drawn.points {
        let [x, value] = &point.texts;
        let shown = if x == last { "" } else { x };
        table.add_row([shown, &point.strategy, value, &point.n.to_string()]);
        last = x;
    }
    print(with_numbers_right(table))?;
    drawn.files.iter().try_for_each(|file| print(file.display()))
}

/// Parses the name of a metric.
fn metric_parser() -> impl TypedValueParser<Value = Metric> {
    PossibleValuesParser::new(Metric::all().map(|metric| PossibleValue::new(metric.name()).help(metric.label())))
        .map(|name| Metric::all().find(|metric| metric.name() == name).expect("one of the possible values"))
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
