//! Defaults: the letter's values, and what the letter's mission does not have.

use toml::{Table, Value};

use super::LETTER;

/// Keys of the link that belong to one model only.
pub(super) const FREE_SPACE: [&str; 2] = ["gain_db", "gain"];
pub(super) const LINE_OF_SIGHT: [&str; 7] =
    ["environment", "los", "reference_gain_db", "los_exponent", "nlos_exponent", "nlos_extra_db", "snr_gap_db"];

/// Defaults of a UAV with `altitude = "free"`.
const CLIMB: &str = "[uav]\nmin_altitude_m = 20.0\nmax_altitude_m = 120.0\nmax_climb_mps = 5.0";

/// Defaults of a link with `model = "probabilistic-los"`.
const FADING: &str = "[link]\nreference_gain_db = -60.0\nlos_exponent = 2.5\nnlos_exponent = 3.5\nnlos_extra_db = -20.0\n\
                      snr_gap_db = 8.2";

/// The same where it has no parameters `los` of its own.
const ENVIRONMENT: &str = "[link]\nenvironment = \"urban\"";

/// Fills in every key that `file` leaves out and that what it says needs; the start of the UAV is left to the caller.
/// Where it says something twice, neither is touched.
pub(super) fn fill(file: &mut Table) {
    let given = |table: &str, key: &str| file.get(table).and_then(|table| table.get(key));
    let is = |table, key, name| given(table, key).is_some_and(|value| value.as_str() == Some(name));
    let mut defaults = parse(LETTER);
    defaults.remove("name");
    keep(&mut defaults, "planner", |key| key == "strategy"); // the planner has defaults of its own
    if given("area", "width_m").or(given("area", "height_m")).is_some() {
        keep(&mut defaults, "area", |key| key != "side_m");
    }
    if given("sensors", "file").is_some() {
        keep(&mut defaults, "sensors", |key| key != "count");
    }
    if is("uav", "altitude", "free") {
        merge(&mut defaults, parse(CLIMB));
    }
    if is("link", "model", "probabilistic-los") {
        keep(&mut defaults, "link", |key| !FREE_SPACE.contains(&key));
        merge(&mut defaults, parse(FADING));
        if given("link", "los").is_none() {
            merge(&mut defaults, parse(ENVIRONMENT));
        }
    }
    merge(file, defaults);
}

fn parse(defaults: &str) -> Table {
    defaults.parse().expect("TOML, by the tests")
}

/// Keeps of a table what is wanted.
fn keep(defaults: &mut Table, table: &str, is_wanted: impl Fn(&str) -> bool) {
    if let Some(Value::Table(table)) = defaults.get_mut(table) {
        table.retain(|key, _| is_wanted(key));
    }
}

/// Adds what `table` lacks.
fn merge(table: &mut Table, defaults: Table) {
    for (key, default) in defaults {
        match (table.get_mut(&key), default) {
            (Some(Value::Table(inner)), Value::Table(defaults)) => merge(inner, defaults),
            (Some(_), _) => {}
            (None, default) => drop(table.insert(key, default)),
        }
    }
}
