//! What all parts of `skysink figures` share: the choice of figures, the sweeps behind them, and the files made of them.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::ValueEnum;
use skysink_common::scenario::LETTER;
use skysink_common::stop::Stop;
use skysink_mission::error::FileContext;
use skysink_mission::record::write_whole;
use skysink_planner::strategies::Registered;

use super::chart::{Chart, CurvePoint, Scale, Series};
use super::map::MapSheet;
use crate::error::LabError;
use crate::progress::OnProgress;
use crate::sweep::journal::{MissionRow, MissionRows};
use crate::sweep::plan::{Shard, Sweep, SweepBase};
use crate::sweep::statistics::MeanInterval;
use crate::sweep::sweep;

/// Search steps of an offline plan, for each step that `horizon` takes in a slot.
const OFFLINE_PER_HORIZON_STEP: u64 = 200;

/// Search steps of `horizon` in a slot, if nothing else is wanted: the sparse fields take four times as many.
pub const HORIZON_ITERATIONS: u32 = 2_000;

/// The letter's mission: the name of its file, and its text.
pub(super) const LETTER_BASE: (&str, &str) = ("letter.toml", LETTER);

/// A group of figures with sweeps of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum FigurePart {
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
    pub only: Vec<FigurePart>,
    /// Missions per point.
    pub runs: u64,
    /// Search steps of `horizon` in a slot.
    pub horizon_iterations: u32,
    /// Missions at the same time, 0 for one per core.
    pub threads: usize,
    /// Folder of the figures.
    pub out: PathBuf,
}

impl Choice {
    /// Whether figures of this part are to be drawn.
    pub(super) fn wants(&self, part: FigurePart) -> bool {
        self.only.is_empty() || self.only.contains(&part)
    }

    /// Version and command, for footers.
    pub(super) fn command(&self) -> String {
        let steps = match self.horizon_iterations {
            HORIZON_ITERATIONS => String::new(),
            steps => format!(" --horizon-iterations {steps}"),
        };
        format!("skysink {} · skysink figures --runs {}{steps}", env!("CARGO_PKG_VERSION"), self.runs)
    }

    /// The footer of a chart; `fields` says which fields were flown over.
    pub(super) fn footer(&self, fields: &str) -> String {
        format!("{fields} · bands: 95 % CI of the mean, Student's t · {}", self.command())
    }

    /// Search steps of an offline plan beside `iterations` of `horizon` in a slot.
    pub(super) fn offline_steps(iterations: u32) -> u64 {
        u64::from(iterations) * OFFLINE_PER_HORIZON_STEP
    }
}

/// What is plotted of the missions of a sweep.
pub(super) struct Quantity {
    pub stem: &'static str,
    pub title: &'static str,
    pub y_label: &'static str,
    pub y_scale: Scale,
    pub value: fn(&MissionRow) -> f64,
    /// Whether the best known and the lower bound are shown, too: of a loss.
    pub is_bounded: bool,
}

impl Quantity {
    /// The data loss rate, with its bounds.
    pub const fn loss(stem: &'static str, title: &'static str) -> Self {
        let value = |row: &MissionRow| row.loss_rate;
        Self { stem, title, y_label: "data loss rate η", y_scale: Scale::Linear, value, is_bounded: true }
    }

    /// Bits per waypoint.
    pub const fn bits(stem: &'static str, title: &'static str) -> Self {
        let value = |row: &MissionRow| row.bits_per_waypoint;
        let y_label = "bits delivered per waypoint [bit]";
        Self { stem, title, y_label, y_scale: Scale::Linear, value, is_bounded: false }
    }
}

/// One call of `skysink figures`.
pub(super) struct Campaign<'a> {
    /// What is wanted.
    pub choice: &'a Choice,
    stop: &'a Stop,
    on_progress: OnProgress<'a>,
    /// Paths of the figures drawn so far, without their extensions.
    stems: Vec<PathBuf>,
    /// The charts drawn so far as Markdown.
    tables: String,
}

impl<'a> Campaign<'a> {
    /// Makes the folder of the figures.
    pub fn open(choice: &'a Choice, stop: &'a Stop, on_progress: OnProgress<'a>) -> Result<Self, LabError> {
        std::fs::create_dir_all(&choice.out).at(&choice.out)?;
        let tables = format!("Made by {}; mean ± half of the 95 % CI.\n", choice.command());
        Ok(Self { choice, stop, on_progress, stems: Vec::new(), tables })
    }

    /// Flies what is missing of a sweep, into a folder of its own; on `threads` threads if that is not 0.
    pub fn fly(&self, name: &str, plan: &Sweep, threads: usize) -> Result<MissionRows, LabError> {
        let threads = if threads > 0 { threads } else { self.choice.threads };
        sweep(plan, &self.choice.out.join("data").join(name), Shard::WHOLE, threads, self.stop, self.on_progress)
    }

    /// Draws a chart and adds its table.
    pub fn add_chart(&mut self, name: &str, chart: &Chart) -> Result<(), LabError> {
        let stem = self.choice.out.join(name);
        chart.draw(&stem)?;
        write_table(&mut self.tables, chart);
        self.stems.push(stem);
        Ok(())
    }

    /// Draws a sheet of maps.
    pub fn add_maps(&mut self, name: &str, sheet: &MapSheet) -> Result<(), LabError> {
        let stem = self.choice.out.join(name);
        sheet.draw(&stem)?;
        self.stems.push(stem);
        Ok(())
    }

    /// Writes the tables, and returns the paths of the figures.
    pub fn finish(self) -> Result<Vec<PathBuf>, LabError> {
        write_whole(&self.choice.out.join("tables.md"), self.tables.as_bytes())?;
        Ok(self.stems)
    }
}

/// The fields of a chart whose points are all of as many missions.
pub(super) fn all_of(runs: u64) -> String {
    format!("{runs} missions per point, seeds 1 to {runs}")
}

/// A sweep over a mission of ours, given by the name and the text of its file: keys with their values, the last key
/// varies fastest.
pub(super) fn plan(
    name: &str,
    (file, text): (&str, &str),
    axes: Vec<(&str, Vec<toml::Value>)>,
    strategies: &[&'static Registered],
    runs: u64,
) -> Result<Sweep, LabError> {
    let table = text.parse().expect("a scenario of ours is TOML");
    let base = SweepBase { path: format!("{file} (built in)").into(), table };
    let axes = axes.into_iter().map(|(key, values)| (key.to_owned(), toml::Value::Array(values)));
    Sweep::new(Path::new(name), base, axes.collect(), strategies.to_vec(), (1..=runs).collect())
}

/// Values of a swept key: whole for counts, floats for what has a unit.
pub(super) fn numbers(key: &str, values: &[i64]) -> Vec<toml::Value> {
    let is_count = matches!(key, "slots" | "sensors.count");
    values.iter().map(|&value| if is_count { value.into() } else { (value as f64).into() }).collect()
}

/// A curve through the means of the values of each point, which are asked for by index.
pub(super) fn curve(label: impl Into<String>, xs: &[i64], values: impl Fn(usize) -> Vec<f64>) -> Series {
    let point = |(index, &x): (usize, &i64)| {
        let MeanInterval { mean, half_width, .. } = MeanInterval::of(&values(index));
        CurvePoint { x: x as f64, mean, half_width: half_width.unwrap_or(f64::NAN) }
    };
    Series { label: label.into(), points: xs.iter().enumerate().map(point).collect() }
}

/// The chart as a Markdown table.
fn write_table(tables: &mut String, chart: &Chart) {
    let labels = chart.series.iter().map(|series| series.label.clone());
    let header: Vec<String> = [chart.x_label.clone()].into_iter().chain(labels).collect();
    let rule = header.iter().map(|_| "---".to_owned()).collect();
    let mut lines = vec![header, rule];
    for (index, point) in chart.series[0].points.iter().enumerate() {
        let cells = chart.series.iter().map(|series| cell(&series.points[index]));
        lines.push([point.x.to_string()].into_iter().chain(cells).collect());
    }
    writeln!(tables, "\n**{}**; {}\n", chart.title, chart.y_label).expect("a string takes everything");
    for cells in lines {
        writeln!(tables, "| {} |", cells.join(" | ")).expect("a string takes everything");
    }
}

/// A mean with its confidence interval, in as many digits as its size needs.
fn cell(&CurvePoint { mean, half_width, .. }: &CurvePoint) -> String {
    let digits = match mean.abs() {
        100.0.. => 0,
        1.0.. => 1,
        _ => 4,
    };
    if half_width.is_nan() { format!("{mean:.digits$}") } else { format!("{mean:.digits$} ± {half_width:.digits$}") }
}
