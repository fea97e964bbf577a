//! `[planner]` of a scenario: its keys, defaults and checks, and the reader of a scenario with all of them.
//!
//! The rest of the scenario is left to [`skysink_common::scenario`].

use std::path::Path;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use skysink_common::error::InputError;
use skysink_common::scenario::{Count, Overrides, Scenario};

pub use crate::estimate::Rates;
use crate::strategies::Registered;
pub use crate::waypoint::WaypointSolver;

/// Keys that have moved, and where to.
const MOVED: [(&str, &str); 3] = [
    ("horizon_iterations", "planner.horizon.iterations"),
    ("horizon_budget_ms", "planner.horizon.budget_ms"),
    ("offline_steps", "planner.offline.steps"),
];

/// The checked keys of `[planner]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table")]
pub struct Settings {
    /// What decides schedule and waypoint.
    pub strategy: &'static Registered,
    /// Most expansions of sP2*; the letter takes one.
    pub sca_iterations: Count<1, 1000>,
    /// What solves sP2*.
    pub waypoint_solver: WaypointSolver,
    /// What it sees of the queues.
    pub knowledge: Knowledge,
    /// What it knows of the sampling rates; with [`Knowledge::Oracle`] each one.
    pub rates: Rates,
    /// The keys of `horizon`.
    pub horizon: HorizonSettings,
    /// The keys of `offline`.
    pub offline: OfflineSettings,
}

/// `[planner.horizon]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table")]
pub struct HorizonSettings {
    /// Search steps in each slot.
    pub iterations: Count<0, 1_000_000_000>,
    /// Longest that a slot's search may take where the mission is paced by a clock; elsewhere it has no effect.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub budget_ms: Option<BudgetMs>,
}

/// `[planner.offline]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table")]
pub struct OfflineSettings {
    /// Search steps before the mission; the most take a month.
    pub steps: Count<0, 1_000_000_000_000>,
}

/// A time [ms] above 0, at most an hour.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "f64")]
pub struct BudgetMs(f64);

impl TryFrom<f64> for BudgetMs {
    type Error = &'static str;

    fn try_from(budget_ms: f64) -> Result<Self, Self::Error> {
        let holds = budget_ms > 0.0 && budget_ms <= 3.6e6;
        if holds { Ok(Self(budget_ms)) } else { Err("expected milliseconds above 0, at most 3600000") }
    }
}

impl From<BudgetMs> for Duration {
    fn from(budget: BudgetMs) -> Self {
        Self::from_secs_f64(budget.0 / 1e3)
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            strategy: Registered::find("uts").expect("the letter's strategy is registered"),
            sca_iterations: Count::of::<1>(),
            waypoint_solver: WaypointSolver::Geometric,
            knowledge: Knowledge::Oracle,
            rates: Rates::Known,
            horizon: HorizonSettings::default(),
            offline: OfflineSettings::default(),
        }
    }
}

impl Default for HorizonSettings {
    fn default() -> Self {
        Self { iterations: Count::of::<6_000>(), budget_ms: None }
    }
}

impl Default for OfflineSettings {
    fn default() -> Self {
        Self { steps: Count::of::<1_000_000>() }
    }
}

impl Settings {
    /// The checked keys of a scenario.
    ///
    /// # Errors
    /// If a key is unknown or has moved, or a value is out of its range.
    pub fn of(scenario: &Scenario) -> Result<Self, InputError> {
        for (old, new) in MOVED {
            if let Some(value) = scenario.planner.others.get(old) {
                return Err(scenario.refusal(&format!("planner.{old}"), value, &format!("{new} instead")));
            }
        }
        let settings: Self = scenario.planner_keys("planner")?;
        if settings.knowledge == Knowledge::Oracle && settings.rates == Rates::Learnt {
            let expected = "\"known\", or planner.knowledge = \"estimated\", with which rates may be learnt";
            return Err(scenario.refusal("planner.rates", &"learnt".into(), expected));
        }
        Ok(settings)
    }
}

/// Reads and checks a scenario file; a relative sensor list is relative to its folder. The scenario has every key of
/// `[planner]`.
///
/// # Errors
/// If the file cannot be read, is not a scenario, or holds a value out of its range.
pub fn read(path: &Path, overrides: Overrides) -> Result<Scenario, InputError> {
    resolve(Scenario::read(path, overrides)?)
}

/// The letter's mission, with every key of `[planner]`.
///
/// # Errors
/// If an override is out of its range.
pub fn letter(overrides: Overrides) -> Result<Scenario, InputError> {
    resolve(Scenario::letter(overrides)?)
}

/// Checks the text of the scenario file `path`. The scenario has every key of `[planner]`.
///
/// # Errors
/// If the text is not a scenario or holds a value out of its range.
pub fn parse(text: &str, path: &Path, overrides: Overrides) -> Result<Scenario, InputError> {
    resolve(Scenario::parse(text, path, overrides)?)
}

/// Checks `[planner]` of a scenario and fills in its defaults.
fn resolve(scenario: Scenario) -> Result<Scenario, InputError> {
    change(scenario, |_| {})
}

/// A scenario with a change of its settings, and every key of `[planner]`.
///
/// # Errors
/// If a key is refused, before the change or after it.
pub fn change(scenario: Scenario, change: impl FnOnce(&mut Settings)) -> Result<Scenario, InputError> {
    let mut settings = Settings::of(&scenario)?;
    change(&mut settings);
    let scenario = scenario.with_planner_keys(&settings)?;
    Settings::of(&scenario)?;
    Ok(scenario)
}

/// What the planner sees of the queues.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Knowledge {
    /// All of them, in every slot.
    Oracle,
    /// What the UAV can know: the queues that it is told of on contact, and what must have come since at the rates that
    /// it knows.
    Estimated,
}
