//! The studies of `skysink figures`: sweeps over one key, and their charts. `studies.toml` defines them.

use std::collections::BTreeMap;
use std::path::Path;

use clap::ValueEnum;
use serde::Deserialize;
use skysink_common::scenario::LETTER;
use skysink_common::stop::Stop;
use skysink_planner::strategies::{
    Registered, STRATEGIES, exact, gfs, horizon, max_age_first, offline, rfs, round_robin, tour, uts, uts_wide,
};

use super::chart::{Chart, Scale, Series};
use super::choice::{Choice, FigurePart};
use super::curves::{self, CurveValues};
use super::page::Look;
use super::style;
use crate::error::LabError;
use crate::metrics::Metric;
use crate::progress::{LabProgress, OnProgress, SweepNumber};
use crate::sweep::journal::{MissionRows, missions_of};
use crate::sweep::plan::{Shard, Sweep, SweepBase};
use crate::sweep::results::{BEST_KNOWN, best_known, number};
use crate::sweep::statistics::Support;
use crate::sweep::sweep;

/// Search steps of an offline plan per search step of `horizon` in a slot.
const OFFLINE_PER_HORIZON_STEP: i64 = 200;

/// Sweeps over the same points, and the charts of their results.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Study {
    /// The figures of the study; its sweeps have the same name.
    pub part: FigurePart,
    base: StudyBase,
    /// Keys with their values, as in a sweep file. The last key is the x axis; the one before has one value per chart.
    axes: toml::Table,
    x_label: String,
    /// The charts of each quantity: name in files, and title.
    charts: Vec<(String, String)>,
    quantities: Vec<Quantity>,
    /// Label of the reference curve for differences, which are drawn if the quantity is a fraction. `{}` is replaced by
    /// the strategy of the other curve.
    reference: Option<String>,
    flights: Vec<Flights>,
    /// Number of threads: 1 for time measurements, 0 for the number that the user has chosen.
    #[serde(default)]
    threads: usize,
    /// Factor on the number of search steps; 0 means 1.
    #[serde(default)]
    effort: i64,
}

/// The base scenario of a study.
#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum StudyBase {
    Letter,
    PlosDenseUrban,
}

/// A sweep of a study.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Flights {
    by: Flyers,
    /// Label of a curve; `{}` is replaced by the strategy.
    label: String,
    /// Suffix of the name of the sweep.
    #[serde(default)]
    suffix: String,
    /// Additional keys with their values in this sweep.
    #[serde(default)]
    axes: toml::Table,
    /// Maximum number of fields per point.
    most_runs: Option<u64>,
}

/// The strategies of a sweep.
#[derive(Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Flyers {
    /// [`AT_ONCE`], which decide in microseconds.
    AtOnce,
    /// Strategies with a search, which takes milliseconds. `offline` only contributes to the best known loss.
    Ahead,
    /// A list.
    Named(Vec<&'static Registered>),
}

/// A plotted metric. If it is the loss and offline plans are flown, best known loss and lower bounds are plotted, too.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Quantity {
    stem: String,
    title: String,
    metric: Metric,
}

/// The curves of a chart and of the chart of their differences.
struct ShownCurves<'a> {
    curves: &'a [CurveValues],
    /// The mission, for the title.
    about: &'a str,
    /// The file name.
    name: String,
}

/// All studies.
///
/// # Panics
/// Never: the studies are built in and tested.
pub(super) fn studies() -> Vec<Study> {
    let studies = toml::from_str(include_str!("studies.toml"));
    let mut studies: BTreeMap<String, Vec<Study>> = studies.expect("studies.toml is valid");
    studies.remove("study").unwrap_or_default()
}

/// The strategies of the figures that decide without a search. The comparison in `docs/src/results.md`, including the
/// best known loss, is among these; other baselines are not simulated.
pub(super) const AT_ONCE: [&Registered; 8] = [
    &rfs::STRATEGY,
    &gfs::STRATEGY,
    &uts::STRATEGY,
    &uts_wide::STRATEGY,
    &exact::STRATEGY,
    &tour::STRATEGY,
    &round_robin::STRATEGY,
    &max_age_first::STRATEGY,
];

/// The index of the style for a strategy's curve, the same in all figures. `None` if the strategy is not in the
/// registry.
pub(crate) fn style(name: &str) -> Option<usize> {
    let mut shown = AT_ONCE.into_iter().chain([&horizon::STRATEGY]);
    let place = || STRATEGIES.into_iter().position(|other| other.name == name);
    shown.position(|other| other.name == name).or_else(|| Some(style::STYLES + place()?))
}

impl StudyBase {
    /// The file name and the content of the scenario.
    fn scenario(self) -> (&'static str, &'static str) {
        match self {
            Self::Letter => ("letter.toml", LETTER),
            Self::PlosDenseUrban => ("plos-dense-urban.toml", include_str!("../../plos-dense-urban.toml")),
        }
    }
}

impl Quantity {
    /// The scale of its axis.
    fn scale(&self) -> Scale {
        if self.metric.is_timing() { Scale::Log } else { Scale::Linear }
    }
}

impl Flights {
    fn strategies(&self) -> Vec<&'static Registered> {
        match &self.by {
            Flyers::AtOnce => AT_ONCE.to_vec(),
            Flyers::Ahead => STRATEGIES.into_iter().filter(|strategy| strategy.has_path).collect(),
            Flyers::Named(strategies) => strategies.clone(),
        }
    }

    /// The number of fields per point.
    fn runs(&self, choice: &Choice) -> u64 {
        choice.runs.min(self.most_runs.unwrap_or(u64::MAX))
    }
}

impl Study {
    /// Runs or resumes the sweeps. Returns named charts: one per quantity and value of the last key but one, and those
    /// of differences. `first` is the number of the first sweep.
    pub fn charts(
        &self,
        choice: &Choice,
        first: SweepNumber,
        stop: &Stop,
        on_progress: OnProgress,
    ) -> Result<Vec<(String, Chart)>, LabError> {
        let fly = |(index, flights): (usize, &Flights)| {
            let number = SweepNumber { number: first.number + index, ..first };
            let progress = |progress| on_progress(LabProgress { sweep: number, ..progress });
            let folder = choice.out.join("data").join(self.name() + &flights.suffix);
            let threads = if self.threads > 0 { self.threads } else { choice.threads };
            sweep(&self.sweep(flights, choice)?, &folder, Shard::WHOLE, threads, stop, &progress)?.all()
        };
        let flown = self.flights.iter().enumerate().map(fly).collect::<Result<Vec<_>, _>>()?;
        let mut charts = Vec::new();
        for quantity in &self.quantities {
            for (index, (name, about)) in self.charts.iter().enumerate() {
                let curves = self.curves(quantity, &flown, index, choice);
                let shown = ShownCurves { curves: &curves, about, name: format!("{}-{name}", quantity.stem) };
                charts.push(self.chart_of_means(quantity, &shown, choice));
                charts.extend(self.chart_of_differences(quantity, &shown, choice));
            }
        }
        Ok(charts)
    }

    /// The chart of a quantity, with its name.
    fn chart_of_means(&self, quantity: &Quantity, shown: &ShownCurves, choice: &Choice) -> (String, Chart) {
        let metric = quantity.metric;
        let series = shown.curves.iter().map(|curve| curve.means(&self.xs(), metric.support())).collect();
        let chart = self.chart(&quantity.title, metric.label(), series, metric.support(), shown, choice);
        (shown.name.clone(), Chart { y_scale: quantity.scale(), ..chart })
    }

    /// The chart of the differences to the reference, paired by field, if there is a reference.
    fn chart_of_differences(
        &self,
        quantity: &Quantity,
        shown: &ShownCurves,
        choice: &Choice,
    ) -> Option<(String, Chart)> {
        let reference = self.reference.as_ref().filter(|_| quantity.metric.support() == Support::Fraction)?;
        let reference = reference.replace("{} ", "");
        let series = curves::differences(shown.curves, &self.xs(), Support::Fraction);
        let title = format!("{}, difference by field", quantity.title);
        let y_label = format!("{} − that of “{reference}”", quantity.metric.label());
        let chart = self.chart(&title, &y_label, series, Support::FractionDifference, shown, choice);
        Some((format!("{}-difference", shown.name), chart))
    }

    fn chart(
        &self,
        title: &str,
        y_label: &str,
        series: Vec<Series>,
        support: Support,
        shown: &ShownCurves,
        choice: &Choice,
    ) -> Chart {
        let seeds = curves::seeds(shown.curves);
        Chart {
            look: Look {
                title: format!("{title} · {}", shown.about),
                description: format!("{seeds} · bands: 95 % CI of the mean · {}", choice.command()),
                ..Look::default()
            },
            x_label: self.x_label.clone(),
            x_words: Vec::new(),
            y_label: y_label.to_owned(),
            series,
            seeds,
            support,
            y_scale: Scale::Linear,
        }
    }

    /// The number of sweeps.
    pub fn sweeps(&self) -> usize {
        self.flights.len()
    }

    /// The name on the command line.
    fn name(&self) -> String {
        self.part.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }

    /// The sweep of these flights, with the number of search steps of each strategy.
    fn sweep(&self, flights: &Flights, choice: &Choice) -> Result<Sweep, LabError> {
        let (file, text) = self.base.scenario();
        let table = text.parse().expect("a built-in scenario is valid TOML");
        let base = SweepBase { path: format!("{file} (built in)").into(), table };
        let strategies = flights.strategies();
        let mut axes = flights.axes.clone();
        let steps = i64::from(choice.horizon_iterations) * self.effort.max(1);
        for (strategy, key, steps) in [
            (&horizon::STRATEGY, "planner.horizon.iterations", steps),
            (&offline::STRATEGY, "planner.offline.steps", steps * OFFLINE_PER_HORIZON_STEP),
        ] {
            if strategies.contains(&strategy) {
                axes.insert(key.to_owned(), vec![steps].into());
            }
        }
        axes.extend(self.axes.clone());
        let strategies = strategies.into_iter().map(|strategy| strategy.name.to_owned()).collect();
        let seeds = (1..=flights.runs(choice)).collect();
        Sweep::new(Path::new(&self.name()), base, axes, strategies, seeds, Vec::new())
    }

    /// The curves of a quantity in the chart with the index `chart`: one per strategy of each sweep. For the loss, also
    /// the best known loss and the lower bounds, over the fields of all strategies.
    fn curves(&self, quantity: &Quantity, flown: &[MissionRows], chart: usize, choice: &Choice) -> Vec<CurveValues> {
        let count = self.xs().len();
        let mut curves = Vec::new();
        let mut add = |label: &str, reference: Option<String>, values: &dyn Fn(usize) -> BTreeMap<u64, f64>| {
            let points = (0..count).map(|index| values(chart * count + index)).collect();
            curves.push(CurveValues { label: label.to_owned(), style: curves.len(), reference, points });
        };
        for strategy in STRATEGIES {
            let reference = self.reference.as_ref().map(|reference| reference.replace("{}", strategy.name));
            for (flights, rows) in self.flights.iter().zip(flown) {
                let Some(index) = flights.strategies().iter().position(|flown| *flown == strategy) else { continue };
                let values = |metric: Metric| {
                    move |point| missions_of(rows, point, index).map(|row| (row.key.seed, row[metric])).collect()
                };
                if *strategy != offline::STRATEGY {
                    let label = flights.label.replace("{}", strategy.name);
                    add(&label, reference.clone(), &values(quantity.metric));
                } else if quantity.metric == Metric::LossRate {
                    let runs = flights.runs(choice);
                    let common = flown.iter().flat_map(MissionRows::values).filter(|row| row.key.seed <= runs);
                    let least = best_known(common);
                    add(BEST_KNOWN, reference.clone(), &|point| least[&point].clone());
                    add("lower bound", None, &values(Metric::LossBound));
                    let has_expected = |point: usize| {
                        missions_of(rows, point, index).all(|row| !row[Metric::ExpectedLossBound].is_nan())
                    };
                    if (0..self.charts.len() * self.xs().len()).all(has_expected) {
                        add("expected lower bound", None, &values(Metric::ExpectedLossBound));
                    }
                }
            }
        }
        curves
    }

    /// The values of the x axis.
    fn xs(&self) -> Vec<f64> {
        let values = self.axes.values().next_back().and_then(toml::Value::as_array).into_iter().flatten();
        values.filter_map(number).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_study_has_a_chart_for_each_value_of_the_last_key_but_one() {
        let choice =
            Choice { only: Vec::new(), runs: 2, horizon_iterations: 5, threads: 0, out: std::path::PathBuf::new() };
        let studies = studies();
        assert_eq!(studies.len(), FigurePart::value_variants().len() - 1, "all parts but the maps");
        for study in studies {
            assert!(study.xs().windows(2).all(|pair| pair[0] < pair[1]), "{}: ascending", study.name());
            for flights in &study.flights {
                let points = study.sweep(flights, &choice).unwrap().definition.points;
                assert_eq!(points.len(), study.charts.len() * study.xs().len(), "{}{}", study.name(), flights.suffix);
            }
        }
    }

    #[test]
    fn every_strategy_has_its_reference_curve() {
        for study in studies() {
            let curves = study.flights.iter().flat_map(|flights| {
                let label = |strategy: &Registered| (strategy.name, flights.label.replace("{}", strategy.name));
                flights.strategies().into_iter().map(label).collect::<Vec<_>>()
            });
            let curves: Vec<(&str, String)> = curves.collect();
            if let Some(reference) = &study.reference {
                for (strategy, label) in &curves {
                    let compared_with = reference.replace("{}", strategy);
                    let is_there = curves.iter().any(|(_, label)| *label == compared_with);
                    assert!(is_there, "{}: {label} is compared with {compared_with}", study.name());
                }
            }
        }
    }
}
