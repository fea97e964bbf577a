//! `skysink plot`: plots a metric of a sweep against one of its keys, as a figure and as tables. The data are from the
//! journal in the folder of the sweep.

mod selection;

use std::fs;
use std::iter::zip;
use std::path::{Path, PathBuf};

use serde::Serialize;
use skysink_common::error::InputError;
use skysink_common::scenario::Setting;
use skysink_mission::error::FileContext;
use skysink_mission::record::write_whole;
use skysink_planner::strategies::STRATEGIES;

use crate::error::LabError;
use crate::figures::chart::{Chart, Scale, Series};
use crate::figures::curves::{self, CurveValues};
use crate::figures::page::{Look, check_text};
use crate::figures::study::style;
use crate::figures::style::STYLES;
use crate::metrics::Metric;
use crate::sweep::folder::FlownSweep;
use crate::sweep::results::{number, text};
use selection::Selection;

/// The parameters of a plot.
#[derive(Debug, Clone)]
pub struct PlotRequest {
    /// The folder of the sweep.
    pub sweep: PathBuf,
    /// The key on the x axis.
    pub x: String,
    /// The metric on the y axis.
    pub metric: Metric,
    /// The strategies, in the order of the legend; all of the sweep if empty.
    pub strategies: Vec<String>,
    /// If set, the plot shows the differences to this strategy, paired by seed.
    pub reference: Option<String>,
    /// Selects the missions with these values of other keys.
    pub conditions: Vec<Setting>,
    /// Scale of the y axis; linear for differences.
    pub y_scale: Scale,
    /// Label of the x axis; `None` for the key.
    pub x_label: Option<String>,
    /// Label of the y axis; `None` for that of the metric.
    pub y_label: Option<String>,
    /// Title above the figure, or empty.
    pub title: String,
    /// Whether seeds, intervals and version are shown below the figure.
    pub footer: Footer,
    /// Printed width [mm]; `None` for a screen.
    pub width_mm: Option<f64>,
    /// Output folder; `None` for `plots` in the folder of the sweep.
    pub out: Option<PathBuf>,
}

impl PlotRequest {
    /// Refuses texts with characters that the embedded font lacks.
    fn check_texts(&self) -> Result<(), InputError> {
        let empty = String::new();
        let labels = [&self.x_label, &self.y_label].map(|label| label.as_ref().unwrap_or(&empty));
        for (option, text) in zip(["--title", "--x-label", "--y-label"], [&self.title, labels[0], labels[1]]) {
            check_text(text).map_err(|message| InputError::of_argument(option, text, message))?;
        }
        Ok(())
    }
}

/// Whether the footer with seeds, intervals and version is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Footer {
    /// Only contained as metadata.
    Hidden,
    /// Drawn below the axis.
    Shown,
}

/// A plot that has been drawn.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Plot {
    /// The key on the x axis.
    pub x: String,
    /// The metric.
    pub metric: &'static str,
    /// The reference of the differences, if any.
    pub difference_to: Option<String>,
    /// Every point of every curve.
    pub points: Vec<PlotPoint>,
    /// A note on missing missions of the sweep.
    pub missing: Option<String>,
    /// Figure and tables.
    pub files: Vec<PathBuf>,
    /// Describes the texts of the points.
    #[serde(skip)]
    pub about: String,
}

/// A point of a curve.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlotPoint {
    /// Value of the key on the x axis.
    pub x: toml::Value,
    /// The strategy.
    pub strategy: String,
    /// Number of missions.
    pub n: usize,
    /// Mean of the metric, or of its differences.
    pub mean: f64,
    /// Limits of its 95 % confidence interval; `None` for a single mission, and for the reference itself.
    pub ci95: Option<[f64; 2]>,
    /// Formatted: the value of the key, and mean with interval.
    #[serde(skip)]
    pub texts: [String; 2],
}

/// Draws a figure and writes its numbers as tables. Existing files of the same name are replaced.
///
/// # Errors
/// If the folder is not that of a sweep, the request does not fit the sweep, missions are missing, or a file cannot be
/// written.
pub fn plot(request: &PlotRequest) -> Result<Plot, LabError> {
    request.check_texts()?;
    let flown = FlownSweep::read("sweep", &request.sweep)?;
    let selection = Selection::new(request, &flown)?;
    let chart = chart(request, &flown, &selection);
    if request.y_scale == Scale::Log
        && chart.series.iter().flat_map(|series| &series.points).all(|point| point.mean <= 0.0)
    {
        let message = format!("--log-y: {} is 0 in all missions: expected a linear axis", request.metric.name());
        return Err(InputError::new("sweep", &request.sweep, message).into());
    }
    let folder = request.out.clone().unwrap_or_else(|| request.sweep.join("plots"));
    fs::create_dir_all(&folder).at(&folder)?;
    let stem = folder.join(name(request));
    chart.draw(&stem)?;
    let table = chart.table();
    write_whole(&stem.with_added_extension("md"), table.markdown().trim_start().as_bytes())?;
    write_whole(&stem.with_added_extension("tex"), table.latex(&chart.look.description).as_bytes())?;
    let point = |series: &Series, index: usize| {
        let point = series.points[index];
        let x = &selection.xs[index];
        let texts = [text(x), point.cell(chart.support)];
        PlotPoint {
            x: x.clone(),
            strategy: series.label.clone(),
            n: point.n,
            mean: point.mean,
            ci95: point.limits,
            texts,
        }
    };
    let points = (0..selection.xs.len()).flat_map(|index| chart.series.iter().map(move |series| (series, index)));
    let files = ["svg", "pdf", "png", "tex", "md"].map(|extension| stem.with_added_extension(extension));
    Ok(Plot {
        x: request.x.clone(),
        metric: request.metric.name(),
        difference_to: request.reference.clone(),
        points: points.map(|(series, index)| point(series, index)).collect(),
        missing: selection.missing.clone(),
        files: files.to_vec(),
        about: table.about,
    })
}

/// The chart of the selected missions.
fn chart(request: &PlotRequest, flown: &FlownSweep, selection: &Selection) -> Chart {
    let PlotRequest { metric, reference, .. } = request;
    let numbers: Option<Vec<f64>> = selection.xs.iter().map(number).collect();
    let x_words = if numbers.is_some() { Vec::new() } else { selection.xs.iter().map(text).collect() };
    let xs = numbers.unwrap_or_else(|| (0..selection.xs.len()).map(|index| index as f64).collect());
    let curve = |&strategy: &usize| {
        let name = &flown.definition.strategies[strategy];
        CurveValues {
            label: name.clone(),
            style: style(name).unwrap_or(STYLES + STRATEGIES.len() + strategy),
            reference: reference.clone(),
            points: selection.points.iter().map(|&point| flown.values(point, strategy, *metric)).collect(),
        }
    };
    let curves: Vec<CurveValues> = selection.strategies.iter().map(curve).collect();
    let support = metric.support();
    let (series, support, y_label) = match reference {
        None => (curves.iter().map(|curve| curve.means(&xs, support)).collect(), support, metric.label().to_owned()),
        Some(reference) => {
            let label = format!("{} − that of {reference}", metric.label());
            (curves::differences(&curves, &xs, support), support.of_difference(), label)
        }
    };
    let seeds = seeds(&flown.definition.seeds);
    let footer = format!("{seeds} · bands: 95 % CI of the mean · skysink {}", flown.definition.version);
    let conditions = request.conditions.iter().map(|Setting { key, value, .. }| format!(" · {key} = {}", text(value)));
    let description = format!("{footer} · sweep {}{}", flown.definition.identity, conditions.collect::<String>());
    let shown_footer = if request.footer == Footer::Shown { footer } else { String::new() };
    let title = request.title.clone();
    Chart {
        look: Look { title, footer: shown_footer, description, width_mm: request.width_mm },
        x_label: request.x_label.clone().unwrap_or_else(|| request.x.clone()),
        x_words,
        y_label: request.y_label.clone().unwrap_or(y_label),
        series,
        seeds,
        support,
        y_scale: request.y_scale,
    }
}

/// The file name without extension: metric, key, the values of other keys, and the reference.
fn name(request: &PlotRequest) -> String {
    let mut name = format!("{}-{}", request.metric.name(), request.x);
    for Setting { key, value, .. } in &request.conditions {
        name += &format!("-{key}-{}", text(value));
    }
    if let Some(reference) = &request.reference {
        name += &format!("-difference-to-{reference}");
    }
    let is_plain = |character: char| character.is_alphanumeric() || "._-".contains(character);
    name.chars().map(|character| if is_plain(character) { character } else { '-' }).collect()
}

/// Describes the seeds, which are ascending and not empty.
fn seeds(seeds: &[u64]) -> String {
    match seeds {
        [only] => format!("seed {only}"),
        [first, .., last] if last - first + 1 == seeds.len() as u64 => format!("seeds {first} to {last}"),
        _ => format!("{} seeds", seeds.len()),
    }
}

/// An error about the sweep in `folder`.
fn refuse(folder: &Path, message: String) -> LabError {
    InputError::new("sweep", folder, message).into()
}
