//! Radios and drones by name, `link.preset` and `uav.preset`: the keys that a name stands for (decisions D38 and D40).
//!
//! A radio or a drone is a row of `radios` or `drones`. Keys of the scenario beside a preset have priority.

pub mod drones;
mod names;
pub mod radios;

use toml::Table;

use crate::error::InputError;
use crate::keys::{Accepts, Only, Source, dotted};
use drones::DRONES;
use radios::RADIOS;

/// The keys of a radio by name.
pub(crate) const OF_RADIO: [&str; 4] =
    ["link.preset", "link.preset_exponent", "link.preset_margin_db", "link.preset_sigma_db"];

/// The condition of these keys.
pub(crate) const ONLY: Only =
    Only { key: "preset", values: radios::NAMES, expected: Some("it only with a radio as preset") };

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

/// Adds the keys of the presets that `table` names and that it lacks; but for the radius, which depends on the
/// altitude.
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
        dotted::insert_missing(table, "link.setup_s", radio.setup_s[0].into());
    }
    if let Some(drone) = named(table, "uav.preset", &DRONES, drones::NAMES, source)? {
        drone.keys().into_iter().for_each(|(key, value)| dotted::insert_missing(table, key, value.into()));
    }
    Ok(())
}

/// The keys that a preset under `key` writes, which a setting of it removes.
pub(crate) fn written(key: &str) -> Vec<&'static str> {
    match key {
        "link.preset" => vec!["link.model", "link.comm_radius_m", "link.resource_blocks", "link.setup_s"],
        "uav.preset" => DRONES[0].keys().map(|(key, _)| key).to_vec(),
        _ => Vec::new(),
    }
}
