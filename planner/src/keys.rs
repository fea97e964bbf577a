//! The keys of `[planner]` that apply to all strategies.

use serde::{Deserialize, Serialize};
use skysink_common::error::InputError;
use skysink_common::estimate::Rates;
use skysink_common::keys::Accepts;
use skysink_common::scenario::Scenario;
use strum::VariantNames;

use crate::waypoint::WaypointSolver;

skysink_common::keys! {
    /// The keys of `[planner]` except the name of the strategy and the tables of single strategies.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
    pub struct Settings {
        /// Most expansions of sP2*; 1 in the paper.
        sca_iterations: u32 = 1, Accepts::Whole(1, 1000);
        /// Solver of sP2*.
        waypoint_solver: WaypointSolver = "geometric", Accepts::OneOf(WaypointSolver::VARIANTS);
        /// Knowledge of the queues: the true ones, or the UAV's estimate.
        knowledge: Knowledge = "oracle", Accepts::OneOf(Knowledge::VARIANTS);
        /// Knowledge of the sampling rates; `"learnt"` needs `knowledge = "estimated"`.
        rates: Rates = "known", Accepts::OneOf(Rates::VARIANTS);
        /// What `horizon` and `offline` plan for: the least loss, or the most data delivered until the mission's end.
        objective: PlanningObjective = "loss", Accepts::OneOf(PlanningObjective::VARIANTS);
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

    /// What the UAV knows of the rates if it has to estimate the queues; `None` if it knows them.
    #[must_use]
    pub fn estimated(&self) -> Option<Rates> {
        (self.knowledge == Knowledge::Estimated).then_some(self.rates)
    }
}

/// The planner's knowledge of the queues.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Knowledge {
    /// All queues, in every slot.
    Oracle,
    /// The UAV's estimate, from the queues reported on contact and the sampling rates.
    Estimated,
}

/// What plans over many slots are made for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum PlanningObjective {
    /// The least data lost.
    Loss,
    /// The most data delivered until the mission's end, wherever nothing, or little, is sampled.
    Collect,
}
