//! `skysink plot`: arguments and printed table.

use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use skysink_common::scenario::Setting;
use skysink_common::stop::Stop;
use skysink_lab::drawing::chart::Scale;
use skysink_lab::metrics::Metric;
use skysink_lab::plot::request::{BoundCurves, Footer, PlotRequest, SheetOptions};
use skysink_lab::plot::trajectories::{DrawnMaps, MapRequest, draw_maps};
use skysink_lab::plot::{DrawnPlot, plot};
use skysink_mission::record::is_run_folder;
use skysink_ring::role::Role;

use crate::error::Error;
use crate::report::{print, table, with_numbers_right};

/// Allowed width of the figure [mm].
const WIDTHS_MM: std::ops::RangeInclusive<f64> = 50.0..=1000.0;

/// Plot a metric of a sweep against one of its keys, with confidence intervals and tables, or map trajectories.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  skysink sweep scenarios/sweeps/letter.toml         writes runs/letter; then
  skysink plot runs/letter --x area.side_m --where link.bandwidth_hz=5e3
  skysink plot runs/letter --x area.side_m --where link.bandwidth_hz=5e3 \\
    --strategies uts,gfs --difference-to uts --width 88mm
  skysink plot runs/sparse-uts-1 runs/sparse-horizon-1    maps of trajectories

The output is SVG, PDF and PNG, and the numbers of a sweep as LaTeX and Markdown
tables. If several keys of the sweep vary, pass --where for each one except that
of the x axis and that of --by. See docs/src/plot.md.")]
pub struct PlotCommand {
    /// Output folder of a sweep, or run folders, whose trajectories are mapped side by side.
    #[arg(required = true, num_args = 1.., value_name = "SWEEPDIR | RUN")]
    what: Vec<PathBuf>,
    /// Key of the sweep on the x axis, for example area.side_m.
    #[arg(long, value_name = "KEY")]
    x: Option<String>,
    /// Metric on the y axis [default: loss_rate].
    #[arg(long, value_name = "METRIC", value_parser = metric_parser())]
    y: Option<Metric>,
    /// Strategies to draw, in this order, comma-separated [default: all of the sweep].
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    strategies: Vec<String>,
    /// Draw a curve for each strategy and value of this key, for example uav.altitude.
    #[arg(long, value_name = "KEY")]
    by: Option<String>,
    /// Draw the differences to this strategy, or with --by to this value, paired by seed.
    #[arg(long, value_name = "STRATEGY")]
    difference_to: Option<String>,
    /// Draw the best known loss and the lower bounds of the loss, too, for a sweep with the strategy offline.
    #[arg(long, conflicts_with = "by")]
    bounds: bool,
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
    /// Output folder; existing files are replaced [default: SWEEPDIR/plots, or plots beside the first run].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print the numbers as JSON instead of the table.
    #[arg(long)]
    json: bool,
}

impl PlotCommand {
    /// Draws the figure and prints its numbers.
    ///
    /// # Errors
    /// If an option does not fit what is drawn, and as [`plot`] and [`draw_maps`].
    pub fn run(self, stop: &Stop) -> Result<(), Error> {
        if is_run_folder(&self.what[0]) { self.plot_runs(stop) } else { self.plot_sweep() }
    }

    /// Draws a metric of a sweep.
    fn plot_sweep(self) -> Result<(), Error> {
        let sheet = self.sheet();
        let [sweep] = <[PathBuf; 1]>::try_from(self.what).map_err(|what| {
            let expected = "expected the folder of one sweep, or run folders";
            Error::Usage(format!("{}: {expected}", what[1].display()))
        })?;
        let x = self.x.ok_or_else(|| {
            let expected = "expected the key of the x axis, such as --x area.side_m";
            Error::Usage(format!("{}: {expected}", sweep.display()))
        })?;
        let drawn = plot(&PlotRequest {
            sweep,
            x,
            metric: self.y.unwrap_or(Metric::LossRate),
            strategies: self.strategies,
            by: self.by,
            reference: self.difference_to,
            bounds: if self.bounds { BoundCurves::Shown } else { BoundCurves::Hidden },
            conditions: self.conditions,
            y_scale: if self.log_y { Scale::Log } else { Scale::Linear },
            x_label: self.x_label,
            y_label: self.y_label,
            sheet,
        })?;
        if self.json {
            return print(serde_json::to_string_pretty(&drawn).expect("plain numbers and strings"));
        }
        if let Some(missing) = &drawn.missing {
            Role::Launcher.log(missing);
        }
        print_points(&drawn)
    }

    /// Draws the trajectories of runs.
    fn plot_runs(self, stop: &Stop) -> Result<(), Error> {
        let of_sweeps = [
            ("--x", self.x.is_some()),
            ("--y", self.y.is_some()),
            ("--strategies", !self.strategies.is_empty()),
            ("--by", self.by.is_some()),
            ("--difference-to", self.difference_to.is_some()),
            ("--bounds", self.bounds),
            ("--where", !self.conditions.is_empty()),
            ("--log-y", self.log_y),
            ("--x-label", self.x_label.is_some()),
            ("--y-label", self.y_label.is_some()),
        ];
        if let Some((option, _)) = of_sweeps.into_iter().find(|(_, is_given)| *is_given) {
            let run = self.what[0].display();
            return Err(Error::Usage(format!("{option}: {run} is a run, which is drawn as a map: omit this option")));
        }
        let drawn = draw_maps(&MapRequest { sheet: self.sheet(), runs: self.what }, stop)?;
        if self.json {
            return print(serde_json::to_string_pretty(&drawn).expect("plain numbers and strings"));
        }
        print_runs(&drawn)
    }

    fn sheet(&self) -> SheetOptions {
        SheetOptions {
            title: self.title.clone(),
            footer: if self.footer { Footer::Shown } else { Footer::Hidden },
            width_mm: self.width,
            out: self.out.clone(),
        }
    }
}

/// Prints one line per point of each curve, then the files.
fn print_points(drawn: &DrawnPlot) -> Result<(), Error> {
    print(&drawn.about)?;
    let mut table = table();
    table.set_header([drawn.x.as_str(), "", "", "missions"]);
    let mut last = "";
    for point in &drawn.points {
        let [x, value] = &point.texts;
        let shown = if x == last { "" } else { x };
        table.add_row([shown, &point.label, value, &point.n.to_string()]);
        last = x;
    }
    print(with_numbers_right(table))?;
    drawn.files.iter().try_for_each(|file| print(file.display()))
}

/// Prints one line per run, then the files.
fn print_runs(drawn: &DrawnMaps) -> Result<(), Error> {
    let mut table = table();
    table.set_header(["run", "strategy", "η", "slots"]);
    for run in &drawn.runs {
        let name = run.run.display().to_string();
        table.add_row([name, run.strategy.clone(), format!("{:.4}", run.loss_rate), run.slots.to_string()]);
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
