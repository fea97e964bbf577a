//! The keys of `[planner]` that apply to all strategies.

use serde::{Deserialize, Serialize};
use skysink_common::error::InputError;
use skysink_common::scenario::{Count, Scenario};

use crate::waypoint::WaypointSolver;
use skysink_common::estimate::Rates;

/// The keys of `[planner]` except the name of the strategy and the tables of single strategies.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Settings {
    /// Most expansions of sP2*; 1 in the paper.
    pub sca_iterations: Count<1, 1000>,
    /// Solver of sP2*.
    pub waypoint_solver: WaypointSolver,
    /// Knowledge of the queues.
    pub knowledge: Knowledge,
    /// Knowledge of the sampling rates; all are known with [`Knowledge::Oracle`].
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
    /// The keys of a scenario. The rest of `[planner]` is checked by [`crate::settings`].
    ///
    /// # Errors
    /// If a value is out of range.
    pub fn of(scenario: &Scenario) -> Result<Self, InputError> {
        let settings: Self = scenario.planner_keys("planner")?;
        if settings.knowledge == Knowledge::Oracle && settings.rates == Rates::Learnt {
            let expected = "\"known\", or planner.knowledge = \"estimated\", with which rates may be learnt";
            return Err(scenario.refusal("planner.rates", &"learnt".into(), expected));
        }
        Ok(settings)
    }
}

/// The planner's knowledge of the queues.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Knowledge {
    /// All queues, in every slot.
    Oracle,
    /// The UAV's estimate, from the queues reported on contact and the sampling rates.
    Estimated,
}
