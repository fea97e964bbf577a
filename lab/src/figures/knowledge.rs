//! What it costs not to know the queues: the same missions flown by a planner that sees every queue, by one that estimates
//! them from its contacts, and by one that has to learn the sampling rates, too.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use skysink_common::scenario::{LETTER, Strategy};

use super::campaign::{Campaign, write_table};
use super::study::{number, point};
use super::{Chart, Scale, Series};
use crate::error::LabError;
use crate::sweep::journal::Row;
use crate::sweep::plan::{Flight, Sweep};
use crate::sweep::results::groups;

/// One strategy of each kind: of one slot, and of many.
const STRATEGIES: [Strategy; 2] = [Strategy::Exact, Strategy::Horizon];

/// What the planner knows: the name of the sweep, `planner.knowledge`, `planner.rates`, and what the legend says.
const KNOWLEDGE: [(&str, &str, &str, &str); 3] = [
    ("knowledge-oracle", "oracle", "known", "sees all queues"),
    ("knowledge-estimated", "estimated", "known", "estimates"),
    ("knowledge-learnt", "estimated", "learnt", "learns rates, too"),
];

/// Most fields per point.
const MOST_RUNS: u64 = 20;

/// Sides of the area [m].
const SIDES_M: [i64; 5] = [100, 200, 300, 500, 1000];

/// Sampling rates [bit/s] and means of the initial queues [bit] differ, so that there is something not to know.
const RATES_BPS: [f64; 2] = [50.0, 150.0];
const QUEUES_BITS: [f64; 2] = [0.0, 20_000.0];

/// Flies the sweeps, draws the chart, and adds its table.
pub(super) fn draw(campaign: &Campaign, tables: &mut String) -> Result<PathBuf, LabError> {
    let mut series = Vec::new();
    for (name, knowledge, rates, label) in KNOWLEDGE {
        let rows = campaign.fly(name, &sweep(campaign, name, knowledge, rates)?, 0)?;
        series.extend(curves(&rows, label));
    }
    series.sort_by_key(|(strategy, _)| *strategy);
    let runs = campaign.choice.runs.min(MOST_RUNS);
    let chart = Chart {
        title: "Data loss for not knowing · rates of 50 to 150 bit/s, initial queues of 0 to 20 kbit".to_owned(),
        x_label: "side of the area [m]".to_owned(),
        y_label: "data loss rate η".to_owned(),
        series: series.into_iter().map(|(_, series)| series).collect(),
        footer: campaign.footer_of(&format!("{runs} missions per point, seeds 1 to {runs}")),
        y_scale: Scale::Linear,
    };
    let stem = campaign.choice.out.join("loss-knowledge");
    chart.draw(&stem)?;
    write_table(tables, &chart);
    Ok(stem)
}

/// A curve per strategy, with its place in the list.
fn curves(rows: &BTreeMap<Flight, Row>, label: &str) -> Vec<(usize, Series)> {
    let groups = groups(rows);
    let losses = |place: usize, strategy: usize| -> Vec<f64> {
        groups[&(place, strategy)].iter().map(|row| row.loss_rate).collect()
    };
    let curve = |(strategy, name): (usize, &Strategy)| {
        let points = SIDES_M.iter().enumerate().map(|(place, &side_m)| point(side_m, &losses(place, strategy)));
        (strategy, Series { label: format!("{} {label}", name.name()), points: points.collect() })
    };
    STRATEGIES.iter().enumerate().map(curve).collect()
}

/// The letter's mission over areas of several sides, with unequal sensor nodes.
fn sweep(campaign: &Campaign, name: &str, knowledge: &str, rates: &str) -> Result<Sweep, LabError> {
    let mut axes = toml::Table::new();
    let mut add = |key: &str, values: Vec<toml::Value>| axes.insert(key.to_owned(), toml::Value::Array(values));
    let range = |[low, high]: [f64; 2]| vec![toml::Value::Array(vec![low.into(), high.into()])];
    add("slots", vec![500.into()]);
    add("sensors.sampling_bps", range(RATES_BPS));
    add("sensors.initial_queue_mean_bits", range(QUEUES_BITS));
    add("planner.knowledge", vec![knowledge.into()]);
    add("planner.rates", vec![rates.into()]);
    add("planner.horizon_iterations", vec![i64::from(campaign.choice.horizon_iterations).into()]);
    add("area.side_m", SIDES_M.map(|side_m| number("area.side_m", side_m)).to_vec());
    let base = (PathBuf::from("letter.toml (built in)"), LETTER.parse().expect("the built-in scenario is TOML"));
    Sweep::new(Path::new(name), base, axes, STRATEGIES.to_vec(), (1..=campaign.choice.runs.min(MOST_RUNS)).collect())
}
