//! `skysink plot`: arguments and printed table.

use std::path::PathBuf;

use clap::Args;
use skysink_common::stop::Stop;
use skysink_lab::plot::request::{PlotRequest, SheetOptions};
use skysink_lab::plot::trajectories::{DrawnMaps, draw_maps};
use skysink_lab::plot::{DrawnPlot, plot};
use skysink_mission::record::is_run_folder;
use skysink_ring::role::Role;

use crate::error::Error;
use crate::report::{print, table, warn_of_few, with_numbers_from};

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
    #[command(flatten)]
    request: PlotRequest,
    #[command(flatten)]
    sheet: SheetOptions,
    /// Sensor node whose map of links is drawn under the trajectories of runs, by name or id [default: the best link].
    #[arg(long, value_name = "SENSOR")]
    links_of: Option<String>,
    /// Print the numbers as JSON instead of the table.
    #[arg(long)]
    json: bool,
}

impl PlotCommand {
    /// Draws the figure and prints its numbers.
    pub fn run(self, stop: &Stop) -> Result<(), Error> {
        if is_run_folder(&self.what[0]) { self.plot_runs(stop) } else { self.plot_sweep() }
    }

    /// Draws a metric of a sweep.
    fn plot_sweep(self) -> Result<(), Error> {
        let [sweep] = <[PathBuf; 1]>::try_from(self.what).map_err(|what| {
            let expected = "expected the folder of one sweep, or run folders";
            Error::Usage(format!("{}: {expected}", what[1].display()))
        })?;
        if self.links_of.is_some() {
            let expected = "a sweep, which is not drawn as a map: omit this option";
            return Err(Error::Usage(format!("--links-of: {} is {expected}", sweep.display())));
        }
        if !sweep.is_dir() {
            return Err(Error::Usage(format!("{}: expected the folder of a sweep or of a run", sweep.display())));
        }
        if self.request.x.is_empty() {
            let expected = "expected the key of the x axis, one of [axes] of the sweep, such as --x area.side_m; a \
                comparison has none";
            return Err(Error::Usage(format!("{}: {expected}", sweep.display())));
        }
        let drawn = plot(&sweep, &self.request, &self.sheet)?;
        warn_of_few(drawn.few.iter().cloned());
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
        if let Some(option) = self.request.given() {
            let run = self.what[0].display();
            return Err(Error::Usage(format!("{option}: {run} is a run, which is drawn as a map: omit this option")));
        }
        let drawn = draw_maps(&self.what, self.links_of.as_deref(), &self.sheet, stop)?;
        if self.json {
            return print(serde_json::to_string_pretty(&drawn).expect("plain numbers and strings"));
        }
        print_runs(&drawn)
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
    print(with_numbers_from(1, table))?;
    drawn.files.iter().try_for_each(|file| print(file.display()))
}

/// Prints one line per run, then the files.
fn print_runs(drawn: &DrawnMaps) -> Result<(), Error> {
    let mut table = table();
    table.set_header(["run", "strategy", "η", "slots"]);
    for run in &drawn.runs {
        let name = run.run.display().to_string();
        table.add_row([name, run.strategy.clone(), format!("{:.4}", run.loss_rate), run.flown()]);
    }
    print(with_numbers_from(1, table))?;
    drawn.files.iter().try_for_each(|file| print(file.display()))
}
