//! `skysink figures`: the sweeps behind the letter's Fig. 2 and what goes beyond it, and the charts, maps and tables made
//! of them.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;

use clap::ValueEnum;
use skysink_common::stop::Stop;

use super::altitude;
use super::flights::map_sheet;
use super::knowledge;
use super::study::STUDIES;
use super::{Chart, Point, Scale};
use crate::error::LabError;
use crate::sweep::journal::Row;
use crate::sweep::plan::{Flight, Sweep};
use crate::sweep::sweep;
use skysink_mission::record::write_whole;

/// Steps of an offline plan, for each step that `horizon` takes in a slot.
const OFFLINE_SHARE: u64 = 200;

/// Search steps of an offline plan beside a `horizon` of `horizon_iterations` a slot.
pub(super) fn offline_steps(horizon_iterations: u32) -> u64 {
    u64::from(horizon_iterations) * OFFLINE_SHARE
}

/// What is plotted of the missions of a sweep.
pub(super) struct Quantity {
    pub stem: &'static str,
    pub title: &'static str,
    pub y_label: &'static str,
    pub y_scale: Scale,
    pub value: fn(&Row) -> f64,
    /// Whether the best known and the lower bound are shown, too: of a loss.
    pub bounded: bool,
}

/// A group of figures with sweeps of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Part {
    /// Against the area, the letter's Fig. 2 (a).
    Area,
    /// Against the area, up to 1 000 m.
    Sparse,
    /// Against the sampling rate, Fig. 2 (b).
    Rate,
    /// Planning time, Fig. 2 (c).
    Time,
    /// What it costs not to know the queues.
    Knowledge,
    /// What the third dimension is worth.
    Altitude,
    /// Trajectories.
    Maps,
}

/// What the figures are made of.
#[derive(Debug, Clone)]
pub struct Choice {
    /// Which of them; all if none is named.
    pub only: Vec<Part>,
    /// Missions per point.
    pub runs: u64,
    /// Search steps of `horizon` in a slot.
    pub horizon_iterations: u32,
    /// Missions at the same time, 0 for one per core.
    pub threads: usize,
    /// Folder of the figures.
    pub out: PathBuf,
}

/// One call of `skysink figures`.
pub(super) struct Campaign<'a> {
    /// What is wanted.
    pub choice: &'a Choice,
    stop: &'a Stop,
}

impl Campaign<'_> {
    /// Flies what is missing of a sweep, into a folder of its own; on `threads` threads if that is not 0.
    pub fn fly(&self, name: &str, plan: &Sweep, threads: usize) -> Result<BTreeMap<Flight, Row>, LabError> {
        let threads = if threads > 0 { threads } else { self.choice.threads };
        sweep(plan, &self.choice.out.join("data").join(name), (1, 1), threads, self.stop)
    }

    /// Version and command, for footers.
    pub fn command(&self) -> String {
        let Choice { runs, horizon_iterations, .. } = self.choice;
        let steps = match *horizon_iterations {
            HORIZON_ITERATIONS => String::new(),
            steps => format!(" --horizon-iterations {steps}"),
        };
        format!("skysink {} · skysink figures --runs {runs}{steps}", env!("CARGO_PKG_VERSION"))
    }

    /// The footer of a chart with `runs` fields per point.
    pub fn footer_of(&self, runs: &str) -> String {
        format!("{runs} · bands: 95 % CI of the mean, Student's t · {}", self.command())
    }

    /// The footer of a chart whose curves are all of as many missions.
    pub fn footer(&self) -> String {
        let runs = self.choice.runs;
        self.footer_of(&format!("{runs} missions per point, seeds 1 to {runs}"))
    }
}

/// Search steps of `horizon` in a slot, if nothing else is wanted: the sparse fields take four times as many.
pub const HORIZON_ITERATIONS: u32 = 2_000;

/// The fields of the trajectory maps: the letter's, and one that is too large for Algorithm 1.
const MAPS: [(&str, &str); 2] = [("map-letter", ""), ("map-sparse", "[area]\nside_m = 300.0\n")];

/// Flies what is wanted and draws everything; returns the figures' paths without their endings.
///
/// # Errors
/// If a sweep is refused, something cannot be written, or on a stop.
pub fn draw(choice: &Choice, stop: &Stop) -> Result<Vec<PathBuf>, LabError> {
    let campaign = Campaign { choice, stop };
    std::fs::create_dir_all(&choice.out).map_err(LabError::file(&choice.out))?;
    let mut stems = Vec::new();
    let mut tables = format!("Made by {}; mean ± half of the 95 % CI.\n", campaign.command());
    let is_wanted = |part: Part| choice.only.is_empty() || choice.only.contains(&part);
    for study in STUDIES.iter().filter(|study| is_wanted(study.part)) {
        stems.extend(study.draw(&campaign, &mut tables)?);
    }
    if is_wanted(Part::Knowledge) {
        stems.push(knowledge::draw(&campaign, &mut tables)?);
    }
    if is_wanted(Part::Altitude) {
        stems.extend(altitude::draw(&campaign, &mut tables)?);
    }
    for (name, change) in MAPS.into_iter().filter(|_| is_wanted(Part::Maps)) {
        let stem = choice.out.join(name);
        map_sheet(change, &campaign)?.draw(&stem)?;
        stems.push(stem);
    }
    write_whole(&choice.out.join("tables.md"), tables.as_bytes())?;
    Ok(stems)
}

/// The chart as a Markdown table.
pub(super) fn write_table(tables: &mut String, chart: &Chart) {
    let labels = chart.series.iter().map(|series| series.label.clone());
    let header: Vec<String> = [chart.x_label.clone()].into_iter().chain(labels).collect();
    let rule = header.iter().map(|_| "---".to_owned()).collect();
    let mut lines = vec![header, rule];
    for (place, point) in chart.series[0].points.iter().enumerate() {
        let cells = chart.series.iter().map(|series| {
            let Point { mean, half_width, .. } = series.points[place];
            let digits = if mean.abs() >= 100.0 {
                0
            } else if mean.abs() >= 1.0 {
                1
            } else {
                4
            };
            if half_width.is_nan() {
                format!("{mean:.digits$}")
            } else {
                format!("{mean:.digits$} ± {half_width:.digits$}")
            }
        });
        lines.push([point.x.to_string()].into_iter().chain(cells).collect());
    }
    writeln!(tables, "\n**{}**; {}\n", chart.title, chart.y_label).expect("a string takes everything");
    for cells in lines {
        writeln!(tables, "| {} |", cells.join(" | ")).expect("a string takes everything");
    }
}
