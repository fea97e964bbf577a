//! What the third dimension is worth: a UAV that chooses its altitude against one that stays at the altitude where it
//! starts, in four surroundings, over the same fields.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use skysink_common::scenario::{Environment, Strategy};

use super::campaign::{Campaign, Quantity, write_table};
use super::{Chart, Point, Scale, Series};
use crate::error::LabError;
use crate::sweep::journal::Row;
use crate::sweep::plan::{Flight, Sweep};
use crate::sweep::results;
use crate::sweep::statistics::Estimate;

/// The mission that is changed: dense urban, d_c = 60 m, 20 m to 120 m.
const BASE: &str = include_str!("../../../scenarios/plos-dense-urban.toml");

/// Fixed altitudes, and those at which the free flights start [m].
const ALTITUDES_M: [i32; 4] = [20, 50, 80, 120];

/// Values of `uav.altitude`, and their names in legends.
const MODES: [(&str, &str); 2] = [("fixed", "fixed altitude"), ("free", "free altitude, from there")];

/// The strategy that flies, the best of those that look one slot ahead.
const STRATEGY: Strategy = Strategy::UtsWide;

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
pub(super) fn draw(campaign: &Campaign, tables: &mut String) -> Result<Vec<PathBuf>, LabError> {
    let rows = campaign.fly("altitude", &sweep(campaign.choice.runs)?, 0)?;
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
fn sweep(runs: u64) -> Result<Sweep, LabError> {
    let names = |names: Vec<&str>| toml::Value::Array(names.into_iter().map(toml::Value::from).collect());
    let mut axes = toml::Table::new();
    axes.insert("link.environment".to_owned(), names(Environment::ALL.map(Environment::name).to_vec()));
    axes.insert("uav.altitude".to_owned(), names(MODES.map(|(mode, _)| mode).to_vec()));
    let altitudes = ALTITUDES_M.map(|altitude_m| toml::Value::from(f64::from(altitude_m))).to_vec();
    axes.insert("uav.altitude_m".to_owned(), toml::Value::Array(altitudes));
    let base = (PathBuf::from("plos-dense-urban.toml (built in)"), BASE.parse().expect("a scenario of ours is TOML"));
    Sweep::new(Path::new("altitude"), base, axes, vec![STRATEGY], (1..=runs).collect())
}

/// One quantity in one environment, a curve for each of fixed and free.
fn chart(
    campaign: &Campaign,
    quantity: &Quantity,
    rows: &BTreeMap<Flight, Row>,
    environment: usize,
    name: Environment,
) -> Chart {
    let groups = results::groups(rows);
    let point = |mode: usize, place: usize| {
        let point = (environment * MODES.len() + mode) * ALTITUDES_M.len() + place;
        let estimate = Estimate::of(&groups[&(point, 0)].iter().map(|row| (quantity.value)(row)).collect::<Vec<_>>());
        let x = f64::from(ALTITUDES_M[place]);
        Point { x, mean: estimate.mean, half_width: estimate.half_width.unwrap_or(f64::NAN) }
    };
    let series = |(mode, (_, label)): (usize, &(&str, &str))| Series {
        label: (*label).to_owned(),
        points: (0..ALTITUDES_M.len()).map(|place| point(mode, place)).collect(),
    };
    Chart {
        title: format!("{} · {}, {}", quantity.title, name.name(), STRATEGY.name()),
        x_label: "altitude [m]".to_owned(),
        y_label: quantity.y_label.to_owned(),
        series: MODES.iter().enumerate().map(series).collect(),
        footer: campaign.footer(),
        y_scale: quantity.y_scale,
    }
}
