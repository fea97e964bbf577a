//! Radios and drones by name, `link.preset` and `uav.preset`: the keys that a name stands for (decisions D38 and D40).
//!
//! A radio or a drone is a row of `radios` or `drones`. Keys of the scenario beside a preset have priority.

/// The names of the rows of a table.
macro_rules! names {
    ($rows:ident) => {
        &{
            let mut names = [""; $rows.len()];
            let mut row = 0;
            while row < $rows.len() {
                names[row] = $rows[row].name;
                row += 1;
            }
            names
        }
    };
}
use names;

pub mod drones;
pub mod radios;
mod rates;

use toml::Table;

pub use rates::PathLoss;

use crate::channel::{LinkModel, RateTable};
use crate::error::InputError;
use crate::keys::{Accepts, Only, Source, dotted};
use crate::scenario::Scenario;
use drones::DRONES;
use radios::RADIOS;

/// The keys of a radio by name.
pub(crate) const OF_RADIO: [&str; 4] =
    ["link.preset", "link.preset_exponent", "link.preset_margin_db", "link.preset_sigma_db"];

/// The condition of these keys.
pub(crate) const ONLY: Only =
    Only { key: "preset", values: radios::NAMES, expected: Some("it only with a radio as preset") };

/// Altitudes of a table for a UAV that climbs.
const ALTITUDES: u32 = 5;

/// The row that the `key` of `table` names; `None` without the key, or if it is no text.
fn named<Row>(
    table: &Table,
    key: &str,
    rows: &'static [Row],
    names: &'static [&'static str],
    source: Source,
) -> Result<Option<&'static Row>, InputError> {
    let Some(value) = dotted::value(table, key) else { return Ok(None) };
    let Some(name) = value.as_str() else { return Ok(None) };
    let row = names.iter().position(|other| *other == name);
    let expected = || format!("one of {}", Accepts::OneOf(names).expected());
    row.map_or_else(|| Err(source.refusal(key, value, &expected())), |row| Ok(Some(&rows[row])))
}

/// Adds the keys of the presets that `table` names and that it lacks; but for the radius, which depends on the altitude.
///
/// # Errors
/// If a name is unknown.
pub(crate) fn expand(table: &mut Table, source: Source) -> Result<(), InputError> {
    // The name 802154 without quotes, as in `--set link.preset=802154`, is a number.
    if let Some(value) = dotted::value_mut(table, "link.preset")
        && let Some(name) = value.as_integer().map(|number| number.to_string())
        && radios::NAMES.contains(&&*name)
    {
        *value = name.into();
    }
    if let Some(radio) = named(table, "link.preset", &RADIOS, radios::NAMES, source)? {
        dotted::insert_missing(table, "link.model", "table".into());
        dotted::insert_missing(table, "link.resource_blocks", i64::from(radio.resource_blocks).into());
    }
    if let Some(drone) = named(table, "uav.preset", &DRONES, drones::NAMES, source)? {
        drone.keys().into_iter().for_each(|(key, value)| dotted::insert_missing(table, key, value.into()));
    }
    Ok(())
}

/// The keys that a preset under `key` writes, which a setting of it removes.
pub(crate) fn written(key: &str) -> Vec<&'static str> {
    match key {
        "link.preset" => vec!["link.model", "link.comm_radius_m", "link.resource_blocks"],
        "uav.preset" => DRONES[0].keys().map(|(key, _)| key).to_vec(),
        _ => Vec::new(),
    }
}

/// The rates of the radio that a checked scenario names, and the radius of its lowest altitude [m]; `None` without one.
///
/// # Errors
/// If the radio does not reach the ground from there.
pub(crate) fn rates(scenario: &Scenario) -> Result<Option<(&'static RateTable, f64)>, InputError> {
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
    Ok(Some((radio.table(&loss, &altitudes_m).held(), radius_m)))
}

/// The altitudes of a table for the UAV of `scenario` [m].
fn altitudes_m(scenario: &Scenario) -> Vec<f64> {
    match scenario.uav.climb() {
        Some(climb) if climb.min_altitude_m < climb.max_altitude_m => {
            let height_m = climb.max_altitude_m - climb.min_altitude_m;
            let level_m = |level: u32| climb.min_altitude_m + height_m * f64::from(level) / f64::from(ALTITUDES - 1);
            (0..ALTITUDES).map(level_m).collect()
        }
        Some(climb) => vec![climb.min_altitude_m],
        None => vec![scenario.uav.altitude_m],
    }
}

#[cfg(test)]
mod tests;
