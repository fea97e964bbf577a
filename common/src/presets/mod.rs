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

use toml::{Table, Value};

pub use rates::PathLoss;

use crate::channel::{LinkModel, RateTable};
use crate::error::InputError;
use crate::keys::{Accepts, Only, Source, dotted};
use crate::scenario::Scenario;
use drones::{DRONES, Drone};
use radios::{RADIOS, Radio};

/// The keys of a radio by name.
pub(crate) const OF_RADIO: [&str; 4] =
    ["link.preset", "link.preset_exponent", "link.preset_margin_db", "link.preset_sigma_db"];

/// The condition of these keys.
pub(crate) const ONLY: Only =
    Only { key: "preset", values: radios::NAMES, expected: Some("it only with a radio as preset") };

/// Altitudes of a table for a UAV that climbs.
const ALTITUDES: u32 = 5;

/// The rows that a scenario names.
struct Named {
    radio: Option<&'static Radio>,
    drone: Option<&'static Drone>,
}

/// The name under a key of a scenario that is one of `names`; `None` without the key, or if it is no text.
fn name<'a>(
    table: &'a Table,
    key: &str,
    names: &'static [&'static str],
    source: Source,
) -> Result<Option<&'a str>, InputError> {
    let Some(value) = dotted::value(table, key) else { return Ok(None) };
    match value.as_str() {
        Some(name) if !names.contains(&name) => {
            Err(source.refusal(key, value, &format!("one of {}", Accepts::OneOf(names).expected())))
        }
        name => Ok(name),
    }
}

impl Named {
    fn in_table(table: &Table, source: Source) -> Result<Self, InputError> {
        let radio = name(table, "link.preset", radios::NAMES, source)?;
        let drone = name(table, "uav.preset", drones::NAMES, source)?;
        Ok(Self {
            radio: radio.and_then(|name| RADIOS.iter().find(|radio| radio.name == name)),
            drone: drone.and_then(|name| DRONES.iter().find(|drone| drone.name == name)),
        })
    }

    /// The keys that they write, with their values; but for the radius, which depends on the altitude.
    fn keys(&self) -> Vec<(&'static str, Value)> {
        let of_radio = |radio: &Radio| {
            [("link.model", "table".into()), ("link.resource_blocks", i64::from(radio.resource_blocks).into())]
        };
        let of_drone = |drone: &Drone| drone.keys().map(|(key, value)| (key, value.into()));
        self.radio.map(of_radio).into_iter().flatten().chain(self.drone.map(of_drone).into_iter().flatten()).collect()
    }
}

/// Adds the keys of the presets that `table` names and that it lacks.
///
/// # Errors
/// If a name is unknown.
pub(crate) fn expand(table: &mut Table, source: Source) -> Result<(), InputError> {
    for (key, value) in Named::in_table(table, source)?.keys() {
        dotted::insert_missing(table, key, value);
    }
    Ok(())
}

/// The keys that a preset under `key` writes, which a setting of it removes.
pub(crate) fn written(key: &str) -> Vec<&'static str> {
    let any = match key {
        "link.preset" => Named { radio: RADIOS.first(), drone: None },
        "uav.preset" => Named { radio: None, drone: DRONES.first() },
        _ => return Vec::new(),
    };
    let radius = any.radio.map(|_| "link.comm_radius_m");
    any.keys().into_iter().map(|(key, _)| key).chain(radius).collect()
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
