//! The keys of `[planner]` that concern every strategy: defaults and ranges.

use serde::{Deserialize, Serialize};
use skysink_common::error::InputError;
use skysink_common::scenario::{Count, Scenario};

use crate::waypoint::WaypointSolver;
use skysink_common::estimate::Rates;

/// The keys of `[planner]` beside the name of the strategy and the tables of some strategies.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Settings {
    /// Most expansions of sP2*; the letter takes one.
    pub sca_iterations: Count<1, 1000>,
    /// What solves sP2*.
    pub waypoint_solver: WaypointSolver,
    /// What it sees of the queues.
    pub knowledge: Knowledge,
    /// What it knows of the sampling rates; with [`Knowledge::Oracle`] each one.
    pub rates: Rates,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            sca_iterations: Count::of::<1>(),
            waypoint_solver: WaypointSolver::Geometric,
            knowledge: Knowledge::Oracle,
            rates: Rates::Known,
        }
    }
}

impl Settings {
    /// The keys of a scenario. What else `[planner]` holds is checked by [`crate::settings`].
    ///
    /// # Errors
    /// If a value is out of its range.
    pub fn of(scenario: &Scenario) -> Result<Self, InputError> {
        let settings: Self = scenario.planner_keys("planner")?;
        if settings.knowledge == Knowledge::Oracle && settings.rates == Rates::Learnt {
            let expected = "\"known\", or planner.knowledge = \"estimated\", with which rates may be learnt";
            return Err(scenario.refusal("planner.rates", &"learnt".into(), expected));
        }
        Ok(settings)
    }
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
