//! What the third dimension is worth: a UAV that chooses its altitude against one that stays at the altitude where it
//! starts, in four surroundings, by a strategy of one slot and by one of many.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use skysink_common::scenario::{Environment, Strategy};

use super::campaign::{Campaign, Quantity, write_table};
use super::study::point;
use super::{Chart, Scale, Series};
use crate::error::Error;
use crate::sweep::journal::Row;
use crate::sweep::plan::{Flight, Sweep};
use crate::sweep::results;

/// The mission that is changed: dense urban, d_c = 60 m, 20 m to 120 m.
const BASE: &str = include_str!("../../scenarios/plos-dense-urban.toml");

/// Fixed altitudes, and those at which the free flights start [m].
const ALTITUDES_M: [i32; 4] = [20, 50, 80, 120];

/// Values of `uav.altitude`, and their names in legends.
const MODES: [(&str, &str); 2] = [("fixed", "fixed altitude"), ("free", "free from there")];

/// The strategies that fly, the first the letter's among those that look one slot ahead, with the name of its sweep.
const STRATEGIES: [(Strategy, &str); 2] = [(Strategy::UtsWide, "altitude"), (Strategy::Horizon, "altitude-ahead")];

/// Most fields per point of `horizon`.
const AHEAD_RUNS: u64 = 5;

/// Share of the search steps of `horizon` that are taken here, where a step takes longer.
const EFFORT: u32 = 4;

/// What is plotted.
const QUANTITIES: [Quantity; 2] = [
    Quantity {
        stem: "altitude-loss",
        title: "Data loss against altitude",
        y_label: "data loss rate η",
        y_scale: Scale::Linear,
        value: |row| row.loss_rate,
        bounded: false,
    },
    Quantity {
        stem: "altitude-bits",
        title: "Bits per waypoint against altitude",
        y_label: "bits delivered per waypoint [bit]",
        y_scale: Scale::Linear,
        value: |row| row.bits_per_waypoint,
        bounded: false,
    },
];

/// Flies the sweep, draws a chart per quantity and environment, and adds their tables.
pub(super) fn draw(campaign: &Campaign, tables: &mut String) -> Result<Vec<PathBuf>, Error> {
    let fly = |(strategy, name)| campaign.fly(name, &sweep(campaign, strategy)?, 0);
    let [first, ahead] = STRATEGIES.map(fly);
    let rows = [first?, ahead?];
    let mut stems = Vec::new();
    for quantity in &QUANTITIES {
        for (place, environment) in Environment::ALL.into_iter().enumerate() {
            let chart = chart(campaign, quantity, &rows, place, environment);
            let stem = campaign.choice.out.join(format!("{}-{}", quantity.stem, environment.name()));
            chart.draw(&stem)?;
            write_table(tables, &chart);
            stems.push(stem);
        }
    }
    Ok(stems)
}

/// Environment, then fixed or free, then altitude.
fn sweep(campaign: &Campaign, strategy: Strategy) -> Result<Sweep, Error> {
    let names = |names: Vec<&str>| toml::Value::Array(names.into_iter().map(toml::Value::from).collect());
    let mut axes = toml::Table::new();
    axes.insert("link.environment".to_owned(), names(Environment::ALL.map(Environment::name).to_vec()));
    axes.insert("uav.altitude".to_owned(), names(MODES.map(|(mode, _)| mode).to_vec()));
    let altitudes = ALTITUDES_M.map(|altitude_m| toml::Value::from(f64::from(altitude_m))).to_vec();
    axes.insert("uav.altitude_m".to_owned(), toml::Value::Array(altitudes));
    if strategy == Strategy::Horizon {
        let iterations = i64::from(campaign.choice.horizon_iterations.div_ceil(EFFORT));
        axes.insert("planner.horizon_iterations".to_owned(), toml::Value::Array(vec![iterations.into()]));
    }
    let base = (PathBuf::from("plos-dense-urban.toml (built in)"), BASE.parse().expect("a scenario of ours is TOML"));
    Sweep::new(Path::new("altitude"), base, axes, vec![strategy], (1..=runs(campaign, strategy)).collect())
}

/// Fields per point.
fn runs(campaign: &Campaign, strategy: Strategy) -> u64 {
    let runs = campaign.choice.runs;
    if strategy == Strategy::Horizon { runs.min(AHEAD_RUNS) } else { runs }
}

/// One quantity in one environment, a curve for each strategy and each of fixed and free.
fn chart(
    campaign: &Campaign,
    quantity: &Quantity,
    rows: &[BTreeMap<Flight, Row>; 2],
    environment: usize,
    name: Environment,
) -> Chart {
    let mut series = Vec::new();
    for ((strategy, _), rows) in STRATEGIES.iter().zip(rows) {
        let groups = results::groups(rows);
        for (mode, (_, label)) in MODES.iter().enumerate() {
            let first = (environment * MODES.len() + mode) * ALTITUDES_M.len();
            let values = |place: usize| -> Vec<f64> {
                groups[&(first + place, 0)].iter().map(|row| (quantity.value)(row)).collect()
            };
            let points = ALTITUDES_M.iter().enumerate();
            let points = points.map(|(place, &altitude_m)| point(altitude_m.into(), &values(place))).collect();
            series.push(Series { label: format!("{}, {label}", strategy.name()), points });
        }
    }
    let [all, ahead] = STRATEGIES.map(|(strategy, _)| runs(campaign, strategy));
    Chart {
        title: format!("{} · {}", quantity.title, name.name()),
        x_label: "altitude [m]".to_owned(),
        y_label: quantity.y_label.to_owned(),
        series,
        footer: campaign.footer_of(&format!("seeds 1 to {all}, of horizon 1 to {ahead}")),
        y_scale: quantity.y_scale,
    }
}
