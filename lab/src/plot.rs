//! `skysink plot`: plots a metric of a sweep against one of its keys, as a figure and as tables, or maps the
//! trajectories of runs. The data are from the journal in the folder of the sweep, or from the run folders.

pub mod request;
mod selection;
pub mod trajectories;

use std::fs;
use std::path::{Path, PathBuf};

use serde::Serialize;
use skysink_common::build::commit_of;
use skysink_common::error::InputError;
use skysink_common::scenario::Setting;
use skysink_mission::error::FileContext;
use skysink_mission::files::write_whole;

use crate::drawing::chart::{Chart, Scale, Series};
use crate::drawing::curves::{self, CurveValues};
use crate::drawing::style::{BEST_KNOWN_STYLE, FIRST_STYLE, styles_of};
use crate::drawing::table::TableCells;
use crate::error::LabError;
use crate::statistics::Concentration;
use crate::sweep::folder::FlownSweep;
use crate::sweep::results::{BEST_KNOWN, best_known, few_of, number, text};
use request::{PlotRequest, SheetOptions};
use selection::{SelectedCurve, Selection};
use skysink_mission::metrics::Metric;

/// Millimetres per point.
const MM_PER_PT: f64 = 25.4 / 72.0;

/// A plot that has been drawn.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DrawnPlot {
    /// The key on the x axis.
    pub x: String,
    /// The metric.
    pub metric: &'static str,
    /// The reference of the differences, if any.
    pub difference_to: Option<String>,
    /// The key that has a curve for each value, if any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub by: Option<String>,
    /// Every point of every curve.
    pub points: Vec<PlotPoint>,
    /// A note on missing missions of the sweep.
    pub missing: Option<String>,
    /// The means of η that few fields determine, by their curves and points.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub few: Vec<(String, Concentration)>,
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
    /// The strategy, `best-known`, or the name of a bound.
    pub strategy: String,
    /// The value of the key that has a curve for each value, if any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub by: Option<toml::Value>,
    /// Number of missions.
    pub n: usize,
    /// Mean of the metric, or of its differences.
    pub mean: f64,
    /// Limits of its 95 % confidence interval; `None` for a single mission, and for the reference itself.
    pub ci95: Option<[f64; 2]>,
    /// Label of the curve.
    #[serde(skip)]
    pub label: String,
    /// Formatted: the value of the key, and mean with interval.
    #[serde(skip)]
    pub texts: [String; 2],
}

/// Draws a figure of the sweep in the folder `sweep`, and writes its numbers as tables. Existing files of the same name
/// are replaced.
///
/// # Errors
/// If the folder is not that of a sweep, the request does not fit the sweep, missions are missing, or a file cannot be
/// written.
pub fn plot(sweep: &Path, request: &PlotRequest, sheet: &SheetOptions) -> Result<DrawnPlot, LabError> {
    sheet.check()?;
    request.check_texts()?;
    let flown = FlownSweep::read("sweep", sweep)?;
    let refuse = |message| InputError::new("sweep", sweep, message);
    let selection = Selection::new(request, &flown).map_err(refuse)?;
    let chart = chart(request, sheet, &flown, &selection);
    if request.log_y && chart.series.iter().flat_map(|series| &series.points).all(|point| point.mean <= 0.0) {
        let message = format!("--log-y: {} is 0 in all missions: expected a linear axis", request.metric().name());
        return Err(refuse(message).into());
    }
    let folder = sheet.out.clone().unwrap_or_else(|| sweep.join("plots"));
    fs::create_dir_all(&folder).at(&folder)?;
    let stem = folder.join(name(request));
    let mut files = chart.draw(&stem)?;
    let table = chart.table(if request.means { TableCells::Means } else { TableCells::Intervals });
    write_whole(&stem.with_added_extension("md"), table.markdown().trim_start().as_bytes())?;
    let latex = table.latex(&chart.look.description, chart.look.width_mm.map(|width_mm| width_mm / MM_PER_PT));
    write_whole(&stem.with_added_extension("tex"), latex.as_bytes())?;
    let point = |series: &Series, index: usize| {
        let point = series.points[index];
        let x = &selection.xs[index];
        let texts = [text(x), point.cell(chart.support)];
        let curve = selection.curves.iter().find(|curve| curve.label == series.label);
        let name = |curve: &SelectedCurve| flown.definition.strategies[curve.strategy].clone();
        PlotPoint {
            x: x.clone(),
            strategy: curve.map_or_else(|| series.label.clone(), name),
            by: curve.and_then(|curve| curve.by.clone()),
            label: series.label.clone(),
            n: point.n,
            mean: point.mean,
            ci95: point.limits,
            texts,
        }
    };
    let points = (0..selection.xs.len()).flat_map(|index| chart.series.iter().map(move |series| (series, index)));
    files.extend(["tex", "md"].map(|extension| stem.with_added_extension(extension)));
    Ok(DrawnPlot {
        x: request.x.clone(),
        metric: request.metric().name(),
        difference_to: request.difference_to.clone(),
        by: request.by.clone(),
        points: points.map(|(series, index)| point(series, index)).collect(),
        missing: selection.missing.clone(),
        few: few(request, &flown, &selection),
        files,
        about: chart.table(TableCells::Intervals).about,
    })
}

/// The means of η in the figure that few fields determine; none of other metrics, of differences and of single seeds.
fn few(request: &PlotRequest, flown: &FlownSweep, selection: &Selection) -> Vec<(String, Concentration)> {
    if request.metric() != Metric::LossRate || request.difference_to.is_some() {
        return Vec::new();
    }
    let means = selection.curves.iter().flat_map(|curve| curve.points.iter().map(|&point| (point, curve.strategy)));
    few_of(&flown.definition, &flown.rows, means)
}

/// The chart of the selected missions.
fn chart(request: &PlotRequest, sheet: &SheetOptions, flown: &FlownSweep, selection: &Selection) -> Chart {
    let metric = request.metric();
    let numbers: Option<Vec<f64>> = selection.xs.iter().map(number).collect();
    let x_words = if numbers.is_some() { Vec::new() } else { selection.xs.iter().map(text).collect() };
    let xs = numbers.unwrap_or_else(|| (0..selection.xs.len()).map(|index| index as f64).collect());
    let styles = styles_of(&flown.definition.strategies);
    let curve = |(place, curve): (usize, &SelectedCurve)| {
        let values = |&point: &usize| flown.values(point, curve.strategy, metric);
        CurveValues {
            label: curve.label.clone(),
            // The curves of a strategy must differ, too.
            style: if request.by.is_none() { styles[curve.strategy] } else { FIRST_STYLE + place },
            reference: curve.reference.clone(),
            points: curve.points.iter().map(values).collect(),
        }
    };
    let mut curves: Vec<CurveValues> = selection.curves.iter().enumerate().map(curve).collect();
    if let Some(offline) = selection.offline {
        curves.extend(bounds(selection.curves[0].reference.clone(), flown, offline, &selection.curves[0].points));
    }
    let support = metric.support();
    let (series, support, y_label) = match &request.difference_to {
        None => (curves.iter().map(|curve| curve.means(&xs, support)).collect(), support, metric.label()),
        Some(reference) => {
            let named = selection.curves.iter().find(|curve| curve.reference.as_ref() == Some(&curve.label));
            let reference = named.filter(|_| request.by.is_none()).map_or(reference, |curve| &curve.label);
            let label = format!("{} − that of {reference}", metric.label());
            (curves::differences(&curves, &xs, support), support.of_difference(), label)
        }
    };
    let seeds = seeds(&flown.definition.seeds);
    let commits: Vec<&str> = flown.builds.iter().map(|build| commit_of(build)).collect();
    let footer =
        format!("{seeds} · bands: 95 % CI of the mean · skysink {} ({})", flown.definition.version, commits.join(", "));
    let conditions = request.conditions.iter().map(|Setting { key, value, .. }| format!(" · {key} = {}", text(value)));
    let conditions = conditions.collect::<String>();
    let description =
        format!(" · sweep {}{conditions} · built from {}", flown.definition.identity, flown.builds.join("; "));
    Chart {
        look: sheet.look(footer, &description),
        x_label: request.x_label.clone().unwrap_or_else(|| request.x.clone()),
        x_words,
        y_label: request.y_label.clone().unwrap_or(y_label),
        series,
        support,
        y_scale: if request.log_y { Scale::Log } else { Scale::Linear },
    }
}

/// The best known loss at each of the `points`, as a difference to `reference` if there is one, its lower bound, and,
/// if the channel is random, that of the expected loss.
fn bounds(
    reference: Option<String>,
    flown: &FlownSweep,
    offline: usize,
    points: &[usize],
) -> impl Iterator<Item = CurveValues> {
    let least = best_known(flown.rows.values());
    let of = |metric| points.iter().map(|&point| flown.values(point, offline, metric)).collect::<Vec<_>>();
    let expected = of(Metric::ExpectedLossBound);
    let is_expected = expected.iter().flat_map(|values| values.values()).all(|value| !value.is_nan());
    let best = points.iter().map(|point| least[point].clone()).collect();
    let curves = [
        (BEST_KNOWN, reference, best),
        ("lower bound", None, of(Metric::LossBound)),
        ("expected lower bound", None, expected),
    ];
    let shown = if is_expected { 3 } else { 2 };
    (BEST_KNOWN_STYLE..).zip(curves).take(shown).map(|(style, (label, reference, points))| CurveValues {
        label: label.to_owned(),
        style,
        reference,
        points,
    })
}

/// The file name without extension: metric, key, the values of other keys, the key of the curves, and the reference.
fn name(request: &PlotRequest) -> String {
    let mut name = format!("{}-{}", request.metric().name(), request.x);
    for Setting { key, value, .. } in &request.conditions {
        name += &format!("-{key}-{}", text(value));
    }
    if let Some(by) = &request.by {
        name += &format!("-by-{by}");
    }
    if request.bounds {
        name += "-bounds";
    }
    if let Some(reference) = &request.difference_to {
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
