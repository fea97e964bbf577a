//! Sweeps over one key of the letter's mission, by every strategy, and the charts made of them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use skysink_common::scenario::{LETTER, Strategy};

use super::campaign::{Campaign, Part, Quantity, offline_steps, write_table};
use super::{Chart, Point, Scale, Series};
use crate::error::LabError;
use crate::sweep::journal::Row;
use crate::sweep::plan::{Flight, Sweep};
use crate::sweep::results::{BEST_KNOWN, best_known, groups};
use crate::sweep::statistics::Estimate;

/// Strategies that take microseconds a slot, in the order of legends and tables.
pub(super) const AT_ONCE: [Strategy; 8] = [
    Strategy::Rfs,
    Strategy::Gfs,
    Strategy::Uts,
    Strategy::UtsWide,
    Strategy::Exact,
    Strategy::Tour,
    Strategy::RoundRobin,
    Strategy::MaxAgeFirst,
];

/// Those that take milliseconds; the last is only shown as a part of the best known.
const AHEAD: [Strategy; 2] = [Strategy::Horizon, Strategy::Offline];

/// A regime of the radio: its name in files, its name for people, and its bandwidth [Hz].
type Regime = (&'static str, &'static str, f64);

/// A visit that empties every queue, and one that carries a part of a queue.
const LINKS: [Regime; 2] = [("letter", "W = 5 MHz, the letter's", 5e6), ("narrow", "W = 5 kHz", 5e3)];

/// A sweep over one key, and what is plotted of it.
pub(super) struct Study {
    /// The figures that it is.
    pub part: Part,
    name: &'static str,
    key: &'static str,
    values: &'static [i64],
    x_label: &'static str,
    /// Regimes of the radio, with charts of their own.
    links: &'static [Regime],
    /// What differs from the letter's mission, as axes of one value.
    fixed: &'static [(&'static str, i64)],
    /// Missions at the same time; 1 where time itself is measured, 0 for as many as asked for.
    threads: usize,
    /// Times as many search steps of `horizon` as elsewhere.
    effort: u32,
    /// Most fields per point of strategies that take milliseconds a slot.
    ahead_runs: u64,
    quantities: &'static [Quantity],
}

/// The missions of a study.
struct Rows {
    all: BTreeMap<Flight, Row>,
    /// Those over the fields that every strategy has flown over.
    common: BTreeMap<Flight, Row>,
}

const LOSS: fn(&Row) -> f64 = |row| row.loss_rate;

/// The letter's Fig. 2 (a) to (c), the bits per waypoint that its text speaks of, and fields larger than the letter's.
pub(super) const STUDIES: [Study; 4] = [
    Study {
        part: Part::Area,
        name: "area",
        key: "area.side_m",
        values: &[100, 150, 200, 250, 300],
        x_label: "side of the area [m]",
        links: &LINKS,
        fixed: &[("slots", 500)],
        threads: 0,
        effort: 1,
        ahead_runs: 20,
        quantities: &[
            Quantity {
                stem: "fig2a-loss-area",
                title: "Data loss against the area",
                y_label: "data loss rate η",
                y_scale: Scale::Linear,
                value: LOSS,
                bounded: true,
            },
            Quantity {
                stem: "bits-area",
                title: "Bits per waypoint against the area",
                y_label: "bits delivered per waypoint [bit]",
                y_scale: Scale::Linear,
                value: |row| row.bits_per_waypoint,
                bounded: false,
            },
        ],
    },
    Study {
        part: Part::Sparse,
        name: "sparse",
        key: "area.side_m",
        values: &[300, 400, 500, 700, 1000],
        x_label: "side of the area [m]",
        links: &[LINKS[0]],
        fixed: &[("slots", 500)],
        threads: 0,
        effort: 4,
        ahead_runs: 20,
        quantities: &[Quantity {
            stem: "loss-sparse",
            title: "Data loss in sparse fields",
            y_label: "data loss rate η",
            y_scale: Scale::Linear,
            value: LOSS,
            bounded: true,
        }],
    },
    Study {
        part: Part::Rate,
        name: "rate",
        key: "sensors.sampling_bps",
        values: &[100, 200, 300, 400, 500, 600, 700, 800],
        x_label: "sampling rate s [bit/s]",
        links: &LINKS,
        fixed: &[("slots", 600)],
        threads: 0,
        effort: 1,
        ahead_runs: 20,
        quantities: &[Quantity {
            stem: "fig2b-loss-rate",
            title: "Data loss against the sampling rate",
            y_label: "data loss rate η",
            y_scale: Scale::Linear,
            value: LOSS,
            bounded: true,
        }],
    },
    Study {
        part: Part::Time,
        name: "time",
        key: "sensors.count",
        values: &[50, 100, 200, 400],
        x_label: "sensor nodes N in 100 m × 100 m",
        links: &LINKS,
        fixed: &[("sensors.sampling_bps", 120), ("slots", 600)],
        threads: 1,
        effort: 1,
        ahead_runs: 5,
        quantities: &[Quantity {
            stem: "fig2c-time",
            title: "Planning time of a slot, median of each mission",
            y_label: "planning time [µs]",
            y_scale: Scale::Log,
            value: |row| row.plan_p50_us,
            bounded: false,
        }],
    },
];

impl Study {
    /// Flies the sweeps, draws a chart per quantity and regime, and adds their tables.
    pub fn draw(&self, campaign: &Campaign, tables: &mut String) -> Result<Vec<PathBuf>, LabError> {
        let rows = self.fly(campaign)?;
        let mut stems = Vec::new();
        for quantity in self.quantities {
            for (place, (link, regime, _)) in self.links.iter().enumerate() {
                let chart = self.chart(quantity, &rows, (place, regime), campaign);
                let stem = campaign.choice.out.join(format!("{}-{link}", quantity.stem));
                chart.draw(&stem)?;
                write_table(tables, &chart);
                stems.push(stem);
            }
        }
        Ok(stems)
    }

    /// Flies all strategies, those that take milliseconds over fewer fields.
    fn fly(&self, campaign: &Campaign) -> Result<Rows, LabError> {
        let (runs, ahead_runs) = (campaign.choice.runs, self.ahead_runs(campaign));
        let bounded = self.quantities.iter().any(|quantity| quantity.bounded);
        let ahead = if bounded { &AHEAD[..] } else { &AHEAD[..1] };
        let mut all = campaign.fly(self.name, &self.sweep(campaign, &AT_ONCE, runs)?, self.threads)?;
        let name = format!("{}-ahead", self.name);
        let flown = campaign.fly(&name, &self.sweep(campaign, ahead, ahead_runs)?, self.threads)?;
        all.extend(flown.into_values().map(|row| {
            let row = Row { strategy: row.strategy + AT_ONCE.len(), ..row };
            (row.flight(), row)
        }));
        let common = all.iter().filter(|(flight, _)| flight.seed <= ahead_runs);
        Ok(Rows { common: common.map(|(flight, row)| (*flight, *row)).collect(), all })
    }

    fn ahead_runs(&self, campaign: &Campaign) -> u64 {
        campaign.choice.runs.min(self.ahead_runs)
    }

    /// The sweep: regime of the radio, then the key, over the letter's mission.
    fn sweep(&self, campaign: &Campaign, strategies: &[Strategy], runs: u64) -> Result<Sweep, LabError> {
        let list = |values: Vec<toml::Value>| toml::Value::Array(values);
        let mut axes = toml::Table::new();
        for (key, value) in self.fixed {
            axes.insert((*key).to_owned(), list(vec![number(key, *value)]));
        }
        if strategies.contains(&Strategy::Horizon) {
            let iterations = campaign.choice.horizon_iterations.saturating_mul(self.effort);
            let steps = i64::try_from(offline_steps(iterations)).unwrap_or(i64::MAX);
            axes.insert("planner.horizon_iterations".to_owned(), list(vec![i64::from(iterations).into()]));
            axes.insert("planner.offline_steps".to_owned(), list(vec![steps.into()]));
        }
        axes.insert("link.bandwidth_hz".to_owned(), list(self.links.iter().map(|link| link.2.into()).collect()));
        axes.insert(self.key.to_owned(), list(self.values.iter().map(|&value| number(self.key, value)).collect()));
        let letter = LETTER.parse().expect("the built-in scenario is TOML");
        let base = (PathBuf::from("letter.toml (built in)"), letter);
        Sweep::new(Path::new(self.name), base, axes, strategies.to_vec(), (1..=runs).collect())
    }

    /// One quantity in one regime, a curve per strategy; of a loss the best known and the bound, too.
    fn chart(&self, quantity: &Quantity, rows: &Rows, (link, regime): (usize, &str), campaign: &Campaign) -> Chart {
        let groups = groups(&rows.all);
        let at = |place: usize| link * self.values.len() + place;
        let values = |strategy: usize, place: usize, value: &dyn Fn(&Row) -> f64| -> Vec<f64> {
            groups[&(at(place), strategy)].iter().map(|row| value(row)).collect()
        };
        let curve = |label: &str, values: &dyn Fn(usize) -> Vec<f64>| Series {
            label: label.to_owned(),
            points: self.values.iter().enumerate().map(|(place, &x)| point(x, &values(place))).collect(),
        };
        let horizon = AT_ONCE.len();
        let shown = AT_ONCE.into_iter().chain([Strategy::Horizon]).enumerate();
        let mut series: Vec<Series> = shown
            .map(|(strategy, name)| curve(name.name(), &|place| values(strategy, place, &quantity.value)))
            .collect();
        if quantity.bounded {
            let least = best_known(&rows.common);
            series.push(curve(BEST_KNOWN, &|place| least[&at(place)].clone()));
            let bound = |row: &Row| row.loss_bound.expect("an offline plan's mission has one");
            series.push(curve("lower bound", &|place| values(horizon + 1, place, &bound)));
        }
        let (runs, ahead) = (campaign.choice.runs, self.ahead_runs(campaign));
        let what = if quantity.bounded { "horizon, best-known and lower bound" } else { "horizon" };
        let runs = format!("seeds 1 to {runs}, of {what} 1 to {ahead}");
        Chart {
            title: format!("{} · {regime}", quantity.title),
            x_label: self.x_label.to_owned(),
            y_label: quantity.y_label.to_owned(),
            series,
            footer: campaign.footer_of(&runs),
            y_scale: quantity.y_scale,
        }
    }
}

/// The mean of some missions.
pub(super) fn point(x: i64, values: &[f64]) -> Point {
    let estimate = Estimate::of(values);
    Point { x: x as f64, mean: estimate.mean, half_width: estimate.half_width.unwrap_or(f64::NAN) }
}

/// A swept value: whole for counts, a float for what has a unit.
pub(super) fn number(key: &str, value: i64) -> toml::Value {
    if matches!(key, "slots" | "sensors.count") { value.into() } else { (value as f64).into() }
}
