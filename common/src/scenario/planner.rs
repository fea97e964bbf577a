//! `[planner]` of a scenario: the name of the strategy, and keys and tables that this crate does not interpret.

use serde::{Deserialize, Serialize};
use toml::Table;

use crate::keys::Accepts;

crate::keys! {
    /// `[planner]`. The planner reads it with [`Scenario::planner_keys`](super::Scenario::planner_keys) and writes it
    /// back with all defaults by [`Scenario::with_planner_keys`](super::Scenario::with_planner_keys).
    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    #[serde(expecting = "a table")]
    pub struct PlannerKeys {
        /// Strategy, one of those in `skysink simulate --help`.
        strategy: String = "uts", Accepts::Rule("the name of a strategy");
        also {
            /// Every other key.
            #[serde(flatten)]
            pub others: Table,
        }
    }
}
