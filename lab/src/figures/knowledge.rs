//! What it costs not to know the queues: the same missions flown by a planner that sees every queue, by one that estimates
//! them from its contacts, and by one that has to learn the sampling rates, too.

use super::campaign::{Campaign, LETTER_BASE, all_of, curve, numbers, plan};
use super::chart::{Chart, Scale};
use crate::error::LabError;
use crate::sweep::journal::missions_of;
use crate::sweep::plan::Sweep;
use skysink_planner::strategies::{Registered, exact, horizon};

/// One strategy of each kind: of one slot, and of many.
const STRATEGIES: [&Registered; 2] = [&exact::STRATEGY, &horizon::STRATEGY];

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

/// Flies the sweeps, and draws the chart: of each strategy a curve for everything that it may know.
pub(super) fn draw(campaign: &mut Campaign) -> Result<(), LabError> {
    let mut flown = Vec::new();
    for (name, knowledge, rates, label) in KNOWLEDGE {
        flown.push((label, campaign.fly(name, &sweep(campaign, name, knowledge, rates)?, 0)?));
    }
    let mut series = Vec::new();
    for (strategy, name) in STRATEGIES.iter().enumerate() {
        series.extend(flown.iter().map(|(label, rows)| {
            curve(format!("{} {label}", name.name), &SIDES_M, |side| {
                missions_of(rows, side, strategy).map(|row| row.loss_rate).collect()
            })
        }));
    }
    let chart = Chart {
        title: "Data loss for not knowing · rates of 50 to 150 bit/s, initial queues of 0 to 20 kbit".to_owned(),
        x_label: "side of the area [m]".to_owned(),
        y_label: "data loss rate η".to_owned(),
        series,
        footer: campaign.choice.footer(&all_of(campaign.choice.runs.min(MOST_RUNS))),
        y_scale: Scale::Linear,
    };
    campaign.add_chart("loss-knowledge", &chart)
}

/// The letter's mission over areas of several sides, with unequal sensor nodes.
fn sweep(campaign: &Campaign, name: &str, knowledge: &str, rates: &str) -> Result<Sweep, LabError> {
    let range = |ends: [f64; 2]| vec![toml::Value::Array(ends.map(toml::Value::from).to_vec())];
    let axes = vec![
        ("slots", numbers("slots", &[500])),
        ("sensors.sampling_bps", range(RATES_BPS)),
        ("sensors.initial_queue_mean_bits", range(QUEUES_BITS)),
        ("planner.knowledge", vec![knowledge.into()]),
        ("planner.rates", vec![rates.into()]),
        ("planner.horizon.iterations", vec![i64::from(campaign.choice.horizon_iterations).into()]),
        ("area.side_m", numbers("area.side_m", &SIDES_M)),
    ];
    plan(name, LETTER_BASE, axes, &STRATEGIES, campaign.choice.runs.min(MOST_RUNS))
}
