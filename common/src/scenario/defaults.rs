//! Default values: those of the paper, and of keys that the paper's mission does not have.

use toml::{Table, Value};

use super::LETTER;
use super::forms::{self, value};

/// Defaults of a UAV with `altitude = "free"`.
const CLIMB: &str = "[uav]\nmin_altitude_m = 20.0\nmax_altitude_m = 120.0\nmax_climb_mps = 5.0";

/// Defaults of a link with `model = "probabilistic-los"`.
const FADING: &str = "[link]\nreference_gain_db = -60.0\nlos_exponent = 2.5\nnlos_exponent = 3.5\nnlos_extra_db = -20.0\n\
                      snr_gap_db = 8.2\nenvironment = \"urban\"";

/// Fills in the keys that `file` leaves out, except alternatives to keys that it has. The start of the UAV is left to
/// the caller.
pub(super) fn fill(file: &mut Table) {
    let is = |key, name| value(file, key).is_some_and(|value| value.as_str() == Some(name));
    let mut defaults = parse(LETTER);
    defaults.remove("name");
    if let Some(Value::Table(planner)) = defaults.get_mut("planner") {
        planner.retain(|key, _| key == "strategy"); // the planner has its own defaults
    }
    if is("uav.altitude", "free") {
        merge(&mut defaults, parse(CLIMB));
    }
    if is("link.model", "probabilistic-los") {
        merge(&mut defaults, parse(FADING));
    }
    for key in forms::keys() {
        let others = value(file, key).map_or_else(Vec::new, |value| forms::displaced(key, value));
        others.into_iter().for_each(|other| forms::remove(&mut defaults, other));
    }
    merge(file, defaults);
}

fn parse(defaults: &str) -> Table {
    defaults.parse().expect("the built-in defaults are TOML")
}

/// Adds the keys that `table` lacks.
fn merge(table: &mut Table, defaults: Table) {
    for (key, default) in defaults {
        match (table.get_mut(&key), default) {
            (Some(Value::Table(inner)), Value::Table(defaults)) => merge(inner, defaults),
            (Some(_), _) => {}
            (None, default) => drop(table.insert(key, default)),
        }
    }
}
