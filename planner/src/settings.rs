//! Checks of all keys of `[planner]`.
//!
//! Keys of all strategies are declared in [`crate::keys`], those of one strategy in its file in [`crate::strategies`].

use std::sync::Arc;

use skysink_common::battery::BatteryState;
use skysink_common::error::InputError;
use skysink_common::geometry::Position;
use skysink_common::link_places::placed;
use skysink_common::scenario::Scenario;
use toml::Table;

pub use crate::keys::{
    Knowledge, NamedObjective, ObjectiveWeights, PEAK_EXPONENT, PlanningObjective, Settings, WaypointSolver,
};
use crate::plan::keys::{HorizonKeys, LookAheadPart};
use crate::route::home::Home;
use crate::strategies::{PYTHON, STRATEGIES, one_of};
use crate::strategy::{Registered, StrategyKeys};
pub use skysink_common::estimate::Rates;

/// Renamed keys: the old and the new name.
const MOVED: [(&str, &str); 3] = [
    ("horizon_iterations", "planner.horizon.iterations"),
    ("horizon_budget_ms", "planner.horizon.budget_ms"),
    ("offline_steps", "planner.offline.steps"),
];

/// Checks `[planner]` of a scenario, and fills in its defaults.
///
/// # Errors
/// If a key is unknown or was renamed, or a value is out of range.
pub fn resolve(scenario: Scenario) -> Result<Scenario, InputError> {
    change(scenario, |_| {})
}

/// Changes the settings of a scenario, and fills in the defaults of `[planner]`.
///
/// # Errors
/// If a key is refused, before the change or after it.
pub fn change(scenario: Scenario, change: impl FnOnce(&mut Settings)) -> Result<Scenario, InputError> {
    let mut settings = Settings::of(&scenario)?;
    change(&mut settings);
    let keys = every_key(&scenario, &settings)?;
    let mut scenario = scenario.with_planner_keys(&keys)?;
    scenario.link.map = placed(&scenario)?;
    check(&scenario)?;
    Ok(scenario)
}

/// Checks `[planner]` of a scenario.
///
/// # Errors
/// If a key is unknown or was renamed, or a value is out of range.
pub fn check(scenario: &Scenario) -> Result<Settings, InputError> {
    let settings = Settings::of(scenario)?;
    every_key(scenario, &settings)?;
    check_parts(scenario, &settings)?;
    check_landing(scenario)?;
    Ok(settings)
}

/// Checks that an ablation leaves out a part that the search has.
fn check_parts(scenario: &Scenario, settings: &Settings) -> Result<(), InputError> {
    let HorizonKeys { without, .. } = scenario.planner_keys("planner.horizon")?;
    if settings.objective.is_collect() && without == Some(LookAheadPart::Groups) {
        let expected = "`nothing` or `annealing`: a plan that collects has no groups (planner.objective)";
        return Err(scenario.refusal("planner.horizon.without", &"groups".into(), expected));
    }
    Ok(())
}

/// Checks that UAVs that have to land can fly home from their starts.
fn check_landing(scenario: &Scenario) -> Result<(), InputError> {
    if !scenario.must_land() {
        return Ok(());
    }
    scenario.kinds().try_for_each(|kind| check_landing_of(&kind))
}

/// The same of a fleet of equal UAVs.
fn check_landing_of(scenario: &Scenario) -> Result<(), InputError> {
    let airspace = Arc::new(scenario.airspace());
    let BatteryState { energy_j, .. } = BatteryState::initial(scenario);
    let is_far = |(home, start): &(Home, Position)| !home.contains(start) && !home.is_in_reach(0, energy_j, start);
    let homes =
        (0..scenario.uav.uavs()).map(|uav| (Home::of(&scenario.of_uav(uav), &airspace), scenario.start_of(uav).xy()));
    let Some((home, start)) = homes.into_iter().find(is_far) else { return Ok(()) };
    let expected = if home.is_in_reach(0, f64::INFINITY, &start) {
        "an energy at the start that reaches the base and leaves the reserve (uav.battery)"
    } else {
        "a base that can be reached within the mission (base.position_m)"
    };
    Err(scenario.refusal("uav.must_land", &true.into(), expected))
}

/// The planner's knowledge of the rates, if the scenario's queues are estimated; `None` if they are known.
///
/// # Errors
/// As [`check`].
pub fn estimated(scenario: &Scenario) -> Result<Option<Rates>, InputError> {
    Ok(check(scenario)?.estimated())
}

/// All keys of `[planner]`, with defaults.
fn every_key(scenario: &Scenario, settings: &Settings) -> Result<Table, InputError> {
    let mut keys = Table::new();
    let strategy = Some(scenario.planner.strategy.as_str()).filter(|name| name.starts_with(PYTHON));
    keys.insert("strategy".to_owned(), strategy.map_or_else(|| Ok(Registered::of(scenario)?.name), Ok)?.into());
    keys.extend(Table::try_from(settings).expect("keys are numbers and strings"));
    for strategy in STRATEGIES {
        if let Some(StrategyKeys { check, .. }) = strategy.keys {
            keys.insert(strategy.name.to_owned(), check(scenario, &format!("planner.{}", strategy.name))?.into());
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
