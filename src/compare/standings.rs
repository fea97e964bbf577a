//! The tables of a comparison, with one row per contender.

use skysink_lab::compare::{Contender, MetricStanding};
use skysink_lab::statistics::limits_text;
use skysink_mission::metrics::Metric;

use crate::error::Error;
use crate::report::{print, table, with_numbers_from};
use skysink_mission::numbers::figure;

/// A column: its heading, and one cell per contender.
struct Column {
    heading: String,
    cells: Vec<String>,
}

/// A metric in a column: its heading, unit factor, and number of decimals.
struct ShownMetric {
    heading: &'static str,
    metric: Metric,
    factor: f64,
    decimals: usize,
}

const OTHERS: [ShownMetric; 7] = [
    ShownMetric { heading: "delivered\n[Mbit]", metric: Metric::DeliveredBits, factor: 1e-6, decimals: 3 },
    ShownMetric { heading: "SNs per\nslot", metric: Metric::MeanServed, factor: 1.0, decimals: 3 },
    ShownMetric { heading: "flown\n[km]", metric: Metric::FlownM, factor: 1e-3, decimals: 2 },
    ShownMetric { heading: "energy\n[kJ]", metric: Metric::EnergyJ, factor: 1e-3, decimals: 1 },
    ShownMetric { heading: "service\nage [s]", metric: Metric::AoiMeanS, factor: 1.0, decimals: 1 },
    ShownMetric { heading: "data\nage [s]", metric: Metric::DataAgeMeanS, factor: 1.0, decimals: 1 },
    ShownMetric { heading: "plan\np50 [µs]", metric: Metric::PlanP50Us, factor: 1.0, decimals: 1 },
];

/// Maximum length of a number in a cell; longer ones get fewer decimals.
const MAX_CHARACTERS: usize = 7;

/// Prints η with its 95 % confidence interval and the differences to the first contender, then the other metrics;
/// before them the same of the cost by an objective that all of them are `for_costs`.
///
/// With `holm` each difference has its adjusted p-value instead of its interval.
pub fn print_tables(
    contenders: &[Contender],
    standings: &[MetricStanding],
    for_costs: bool,
    holm: bool,
) -> Result<(), Error> {
    let find = |contender: &Contender, metric: Metric| {
        standings.iter().find(|standing| standing.label == contender.label && standing.metric == metric.name())
    };
    let column = |heading: &str, cell: &dyn Fn(&Contender) -> Option<String>| Column {
        heading: heading.to_owned(),
        cells: contenders.iter().map(|contender| cell(contender).unwrap_or_default()).collect(),
    };
    let loss = |contender: &Contender| find(contender, Metric::LossRate);
    let p_text = |standing: &MetricStanding| {
        standing.difference_p_holm.map(|p| if p < 0.001 { "< 0.001".to_owned() } else { format!("{p:.3}") })
    };
    let [interval, beside] = ["its 95 %\ninterval", if holm { "p\n(Holm)" } else { "its 95 %\ninterval" }];
    let cost = |contender: &Contender| find(contender, Metric::Objective).filter(|_| for_costs);
    let costs_text = |[low, high]: [f64; 2]| format!("[{}, {}]", figure(low), figure(high));
    let costs = [
        column("cost by\nobjective", &|contender| Some(figure(cost(contender)?.mean))),
        column(interval, &|contender| Some(costs_text(cost(contender)?.ci95?))),
        column("less the\nfirst", &|contender| Some(figure(cost(contender)?.difference?))),
        column(beside, &|contender| {
            let cost = cost(contender)?;
            if holm { p_text(cost) } else { Some(costs_text(cost.difference_ci95?)) }
        }),
    ];
    let losses = [
        column("loss\nrate η", &|contender| Some(format!("{:.4}", loss(contender)?.mean))),
        column(interval, &|contender| Some(limits_text(loss(contender)?.ci95?, 3))),
        column("weighted\nη_w", &|contender| Some(format!("{:.4}", find(contender, Metric::WeightedLossRate)?.mean))),
        column("\ntrapped", &|contender| {
            let trapped = find(contender, Metric::Trapped)?;
            (trapped.n > 1).then(|| format!("{:.0}%", 100.0 * trapped.mean))
        }),
        column("less the\nfirst", &|contender| Some(format!("{:+.4}", loss(contender)?.difference?))),
        column(beside, &|contender| {
            let loss = loss(contender)?;
            if holm { p_text(loss) } else { Some(limits_text(loss.difference_ci95?, 3)) }
        }),
    ];
    let other = |shown: &ShownMetric| {
        column(shown.heading, &|contender| {
            Some(number(find(contender, shown.metric)?.mean * shown.factor, shown.decimals))
        })
    };
    let labels: Vec<&str> = contenders.iter().map(|contender| contender.label.as_str()).collect();
    if for_costs {
        print(rows(&labels, &costs))?;
    }
    print(rows(&labels, &losses))?;
    print(rows(&labels, &OTHERS.each_ref().map(other)))?;
    print_missions(contenders.iter().filter_map(loss).map(|standing| standing.n).max(), holm)
}

/// Says how many missions each mean is over, if it is over several.
fn print_missions(missions: Option<usize>, holm: bool) -> Result<(), Error> {
    let Some(missions) = missions.filter(|missions| *missions > 1) else { return Ok(()) };
    let family = if holm { ", p-values for all of them together" } else { "" };
    print(format_args!("{missions} missions each; differences paired by seed{family}."))
}

/// The table of all columns that are not empty.
fn rows(labels: &[&str], columns: &[Column]) -> comfy_table::Table {
    let columns: Vec<&Column> =
        columns.iter().filter(|column| column.cells.iter().any(|cell| !cell.is_empty())).collect();
    let mut table = table();
    table.set_header([""].into_iter().chain(columns.iter().map(|column| column.heading.as_str())));
    for (row, label) in labels.iter().enumerate() {
        table.add_row([*label].into_iter().chain(columns.iter().map(|column| column.cells[row].as_str())));
    }
    with_numbers_from(1, table)
}

/// Formats a number with `decimals` decimals, or fewer if it is too long.
fn number(value: f64, decimals: usize) -> String {
    let texts = (0..=decimals).rev().map(|decimals| format!("{value:.decimals$}"));
    let fitting = texts.filter(|text| text.len() <= MAX_CHARACTERS).max_by_key(String::len);
    fitting.unwrap_or_else(|| format!("{value:.0}"))
}
