//! The rates of the radio that a scenario names (decision D38).

use std::sync::Arc;

use super::{Scenario, UavKeys};
use crate::channel::{LinkModel, PathLoss, RateTable};
use crate::error::InputError;
use crate::presets::radios::RADIOS;

/// Altitudes of a table for a UAV that climbs.
const ALTITUDES: u32 = 5;

/// The rates of the radio that a checked scenario names, and the radius of its lowest altitude [m]; `None` without one.
///
/// # Errors
/// If the radio does not reach the ground from there.
pub(crate) fn rates(scenario: &Scenario) -> Result<Option<(Arc<RateTable>, f64)>, InputError> {
    let link = &scenario.link;
    let named = link.preset.as_ref().filter(|_| link.model == LinkModel::Table);
    let radio = named.and_then(|name| RADIOS.iter().find(|radio| radio.name == name));
    let (Some(radio), Some(exponent), Some(margin_db), Some(sigma_db)) =
        (radio, link.preset_exponent, link.preset_margin_db, link.preset_sigma_db)
    else {
        return Ok(None);
    };
    let loss = PathLoss { exponent, margin_db, sigma_db };
    let altitudes_m = altitudes_m(scenario);
    let Some(radius_m) = radio.comm_radius_m(&loss, altitudes_m[0]) else {
        let expected = format!(
            "a radio that reaches the ground from {} m, for its range is {:.0} m",
            altitudes_m[0],
            radio.range_m(&loss, &radio.steps[0])
        );
        return Err(scenario.refusal("link.preset", &radio.name.into(), &expected));
    };
    Ok(Some((radio.table(&loss, &altitudes_m).shared(), radius_m)))
}

/// The altitudes of a table for the UAVs of `scenario` [m], ascending.
fn altitudes_m(scenario: &Scenario) -> Vec<f64> {
    let mut all_m: Vec<f64> = scenario.uav_kinds().flat_map(altitudes_of).collect();
    all_m.sort_by(f64::total_cmp);
    all_m.dedup();
    all_m
}

/// The altitudes of a table for a UAV [m].
fn altitudes_of(uav: &UavKeys) -> Vec<f64> {
    match uav.climb() {
        Some(climb) if climb.min_altitude_m < climb.max_altitude_m => {
            let height_m = climb.max_altitude_m - climb.min_altitude_m;
            let level_m = |level: u32| climb.min_altitude_m + height_m * f64::from(level) / f64::from(ALTITUDES - 1);
            (0..ALTITUDES).map(level_m).collect()
        }
        Some(climb) => vec![climb.min_altitude_m],
        None => vec![uav.altitude_m],
    }
}

#[cfg(test)]
mod tests;
