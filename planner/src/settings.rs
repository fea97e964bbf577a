//! `[planner]` of a scenario: every key of it, checked.
//!
//! Keys that concern every strategy are left to [`crate::keys`], those of one strategy to its file in
//! [`crate::strategies`], the rest of the scenario to [`skysink_common::scenario`].

use skysink_common::error::InputError;
use skysink_common::scenario::Scenario;
use toml::Table;

pub use crate::keys::{Knowledge, Settings};
use crate::strategies::{Registered, STRATEGIES, one_of};
pub use crate::waypoint::WaypointSolver;
pub use skysink_common::estimate::Rates;

/// Keys that have moved, and where to.
const MOVED: [(&str, &str); 3] = [
    ("horizon_iterations", "planner.horizon.iterations"),
    ("horizon_budget_ms", "planner.horizon.budget_ms"),
    ("offline_steps", "planner.offline.steps"),
];

/// Checks `[planner]` of a scenario, and fills in every key of it.
///
/// # Errors
/// If a key is unknown or has moved, or a value is out of its range.
pub fn resolve(scenario: Scenario) -> Result<Scenario, InputError> {
    change(scenario, |_| {})
}

/// A scenario with a change of its settings, and every key of `[planner]`.
///
/// # Errors
/// If a key is refused, before the change or after it.
pub fn change(scenario: Scenario, change: impl FnOnce(&mut Settings)) -> Result<Scenario, InputError> {
    let mut settings = Settings::of(&scenario)?;
    change(&mut settings);
    let keys = every_key(&scenario, &settings)?;
    let scenario = scenario.with_planner_keys(&keys)?;
    check(&scenario)?;
    Ok(scenario)
}

/// Checks `[planner]` of a scenario.
///
/// # Errors
/// If a key is unknown or has moved, or a value is out of its range.
pub fn check(scenario: &Scenario) -> Result<Settings, InputError> {
    let settings = Settings::of(scenario)?;
    every_key(scenario, &settings).map(|_| settings)
}

/// What the planner of a scenario knows of the rates where it has to estimate the queues; none where it sees them.
///
/// # Errors
/// As [`check`].
pub fn estimated(scenario: &Scenario) -> Result<Option<Rates>, InputError> {
    let settings = check(scenario)?;
    Ok((settings.knowledge == Knowledge::Estimated).then_some(settings.rates))
}

/// All keys of `[planner]`, with defaults where the scenario has none.
fn every_key(scenario: &Scenario, settings: &Settings) -> Result<Table, InputError> {
    let mut keys = Table::new();
    keys.insert("strategy".to_owned(), Registered::of(scenario)?.name.into());
    keys.extend(Table::try_from(settings).expect("keys are numbers and strings"));
    for strategy in STRATEGIES {
        if let Some(checked) = strategy.keys {
            keys.insert(strategy.name.to_owned(), checked(scenario, &format!("planner.{}", strategy.name))?.into());
        }
    }
    for (key, value) in &scenario.planner.others {
        let expected = match MOVED.iter().find(|(old, _)| old == key) {
            Some((_, new)) => format!("{new} instead"),
            None if keys.contains_key(key) => continue,
            None => one_of(keys.keys()),
        };
        return Err(scenario.refusal(&format!("planner.{key}"), value, &expected));
    }
    Ok(keys)
}
