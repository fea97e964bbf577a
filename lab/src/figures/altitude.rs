//! What the third dimension is worth: a UAV that chooses its altitude against one that stays at the altitude where it
//! starts, in four surroundings, over the same fields.

use skysink_common::scenario::Environment;
use skysink_planner::strategies::{Registered, uts_wide};

use super::campaign::{Campaign, Quantity, all_of, curve, numbers, plan};
use super::chart::Chart;
use crate::error::LabError;
use crate::sweep::journal::missions_of;
use crate::sweep::plan::Sweep;

/// The mission that is varied: dense urban, d_c = 60 m, 20 m to 120 m.
const BASE: (&str, &str) = ("plos-dense-urban.toml", include_str!("../../../scenarios/plos-dense-urban.toml"));

/// Fixed altitudes, and those at which the free flights start [m].
const ALTITUDES_M: [i64; 4] = [20, 50, 80, 120];

/// Values of `uav.altitude`, and their names in legends.
const MODES: [(&str, &str); 2] = [("fixed", "fixed altitude"), ("free", "free altitude, from there")];

/// The strategy that flies, the best of those that look one slot ahead.
const STRATEGY: &Registered = &uts_wide::STRATEGY;

/// What is plotted.
const QUANTITIES: [Quantity; 2] = [
    Quantity { is_bounded: false, ..Quantity::loss("altitude-loss", "Data loss against altitude") },
    Quantity::bits("altitude-bits", "Bits per waypoint against altitude"),
];

/// Flies the sweep, and draws a chart per quantity and environment, with a curve for each of fixed and free.
pub(super) fn draw(campaign: &mut Campaign) -> Result<(), LabError> {
    let runs = campaign.choice.runs;
    let rows = campaign.fly("altitude", &sweep(runs)?, 0)?;
    for quantity in &QUANTITIES {
        for (environment, name) in Environment::ALL.iter().map(|environment| environment.name()).enumerate() {
            let series = MODES.iter().enumerate().map(|(mode, (_, label))| {
                curve(*label, &ALTITUDES_M, |altitude| {
                    let point = (environment * MODES.len() + mode) * ALTITUDES_M.len() + altitude;
                    missions_of(&rows, point, 0).map(quantity.value).collect()
                })
            });
            let chart = Chart {
                title: format!("{} · {name}, {}", quantity.title, STRATEGY.name),
                x_label: "altitude [m]".to_owned(),
                y_label: quantity.y_label.to_owned(),
                series: series.collect(),
                footer: campaign.choice.footer(&all_of(runs)),
                y_scale: quantity.y_scale,
            };
            campaign.add_chart(&format!("{}-{name}", quantity.stem), &chart)?;
        }
    }
    Ok(())
}

/// Environment, then fixed or free, then altitude.
fn sweep(runs: u64) -> Result<Sweep, LabError> {
    let axes = vec![
        ("link.environment", Environment::ALL.iter().map(|environment| environment.name().into()).collect()),
        ("uav.altitude", MODES.map(|(mode, _)| mode.into()).to_vec()),
        ("uav.altitude_m", numbers("uav.altitude_m", &ALTITUDES_M)),
    ];
    plan("altitude", BASE, axes, &[STRATEGY], runs)
}
