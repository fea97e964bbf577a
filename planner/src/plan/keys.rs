//! `[planner.horizon]`.

use std::time::Duration;

use serde::{Deserialize, Serialize};
use skysink_common::keys::Accepts;
use strum::VariantNames;

use crate::strategy::{Timing, View};

/// Times for a search.
const BUDGET_MS: Accepts =
    Accepts::Number("milliseconds above 0, at most 3600000", |budget_ms| budget_ms > 0.0 && budget_ms <= 3.6e6);

skysink_common::keys! {
    /// `[planner.horizon]`.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct HorizonKeys {
        /// Search steps in each slot.
        iterations: u32 = 6000, Accepts::Whole(0, 1_000_000_000);
        /// Longest planning window [slots]; 2400 if absent. A window that reaches to the mission's end loses less than
        /// a shorter one that moves with the slot.
        window: Option<u64>, Accepts::Whole(1, 1_000_000);
        /// A part of the method to leave out, for ablations.
        without: Option<LookAheadPart>, Accepts::OneOf(LookAheadPart::VARIANTS);
        /// Time limit for the plan of a slot in paced runs [ms]. It has no effect in lock-step and in one process,
        /// where results must not depend on a clock.
        budget_ms: Option<f64>, BUDGET_MS;
    }
}

impl HorizonKeys {
    /// All parts of the method, over the default window.
    #[must_use]
    pub fn of(iterations: u32) -> Self {
        Self { iterations, window: None, without: None, budget_ms: None }
    }

    /// Longest planning time for the slot of `view`; `None` if the mission is not paced.
    pub fn budget(&self, view: &View) -> Option<Duration> {
        let budget_ms = self.budget_ms.filter(|_| view.timing == Timing::Paced);
        budget_ms.map(|budget_ms| Duration::from_secs_f64(budget_ms / 1e3))
    }
}

/// A part of the look-ahead that an ablation leaves out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum LookAheadPart {
    /// All parts are there, as if the key were absent.
    Nothing,
    /// Changes that lose more for a while: only improvements are accepted.
    Annealing,
    /// Groups of sensor nodes as stops.
    Groups,
    /// The choice among strategies by simulation, where links, arrivals, queues or rates are by chance.
    Choice,
}
