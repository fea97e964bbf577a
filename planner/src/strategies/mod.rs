//! The registry of the strategies, which compute schedule and waypoint of a slot.
//!
//! A strategy is a file of this folder, its module, and a line of [`STRATEGIES`]. What a strategy is, is in
//! [`crate::strategy`]. Messages, and transit without a decision, are left to [`crate::planner`].

pub mod algorithm_1;
pub mod best_of;
pub mod drift_plus_penalty;
pub mod edf;
pub mod exact;
pub mod gfs;
pub mod horizon;
pub mod hover;
pub mod look_ahead;
pub mod max_age_first;
pub mod max_weight;
pub mod mes;
pub(crate) mod queue_weight;
pub mod rfs;
pub mod round_robin;
pub mod sca;
pub mod tour;
pub(crate) mod turns;
pub mod uts;
pub mod uts_wide;
pub mod whittle;

use std::fmt::Display;

use serde::de;
use serde::{Deserialize, Deserializer};
use skysink_common::error::{InputError, did_you_mean};
use skysink_common::scenario::Scenario;

use crate::strategy::Registered;

/// All strategies, in the order in which they are listed.
pub static STRATEGIES: &[&Registered] = &[
    &rfs::STRATEGY,
    &gfs::STRATEGY,
    &uts::STRATEGY,
    &uts_wide::STRATEGY,
    &exact::STRATEGY,
    &tour::STRATEGY,
    &round_robin::STRATEGY,
    &max_age_first::STRATEGY,
    &edf::STRATEGY,
    &mes::STRATEGY,
    &max_weight::STRATEGY,
    &drift_plus_penalty::STRATEGY,
    &whittle::STRATEGY,
    &hover::STRATEGY,
    &horizon::STRATEGY,
    &best_of::STRATEGY,
    &look_ahead::OFFLINE,
    &sca::STRATEGY,
];

/// Prefix of the names of strategies in Python, which only the Python package can fly.
pub const PYTHON: &str = "python:";

/// The names of all strategies.
///
/// ```
/// use skysink_planner::strategies::{names, stateless};
/// assert!(names().contains(&"horizon") && !stateless().contains(&"horizon"));
/// ```
#[must_use]
pub fn names() -> Vec<&'static str> {
    STRATEGIES.iter().map(|strategy| strategy.name).collect()
}

/// The names of the stateless strategies, whose plans do not depend on the plans before.
#[must_use]
pub fn stateless() -> Vec<&'static str> {
    STRATEGIES.iter().filter(|strategy| strategy.is_stateless).map(|strategy| strategy.name).collect()
}

/// ```
/// use skysink_planner::strategy::Registered;
/// let mut scenario = skysink_common::scenario::Scenario::letter(Default::default()).unwrap();
/// assert_eq!(Some(Registered::of(&scenario).unwrap()), Registered::find("uts"));
/// scenario.planner.strategy = "utz".to_owned();
/// assert!(Registered::of(&scenario).unwrap_err().to_string().ends_with("did you mean `uts`?"));
/// ```
impl Registered {
    /// The strategy called `name`, if there is one.
    #[must_use]
    pub fn find(name: &str) -> Option<&'static Self> {
        STRATEGIES.iter().copied().find(|strategy| strategy.name == name)
    }

    /// The strategy of a scenario.
    ///
    /// # Errors
    /// If none has the name that the scenario gives.
    pub fn of(scenario: &Scenario) -> Result<&'static Self, InputError> {
        let name = scenario.planner.strategy.as_str();
        let by_python = "a built-in strategy; this one is flown by skysink.simulate() of the Python package only";
        let expected = || if name.starts_with(PYTHON) { by_python.to_owned() } else { expected(name) };
        Self::find(name).ok_or_else(|| scenario.refusal("planner.strategy", &name.into(), &expected()))
    }
}

impl<'de> Deserialize<'de> for &'static Registered {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        Registered::find(&name).ok_or_else(|| de::Error::custom(format!("{name:?}: expected {}", expected(&name))))
    }
}

/// The expected names of strategies instead of the unknown `name`, for messages.
///
/// ```
/// let expected = skysink_planner::strategies::expected("horizom");
/// assert!(expected.starts_with("one of `rfs`") && expected.ends_with("did you mean `horizon`?"));
/// ```
#[must_use]
pub fn expected(name: &str) -> String {
    let hint = did_you_mean(name, names()).map(|meant| format!("; did you mean `{meant}`?"));
    one_of(names()) + &hint.unwrap_or_default()
}

/// The expected names, for messages.
pub(crate) fn one_of<T: Display>(names: impl IntoIterator<Item = T>) -> String {
    let quoted: Vec<String> = names.into_iter().map(|name| format!("`{name}`")).collect();
    format!("one of {}", quoted.join(", "))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::mission_table::MissionTable;
    use crate::strategy::{OwnedSetup, Strategy};
    use skysink_common::message::SensorNode;
    use skysink_common::scenario::Overrides;

    /// The letter's mission over SNs at `positions_m` [m].
    pub(crate) fn setup_of(positions_m: &[[f64; 2]]) -> OwnedSetup {
        let sensor = |&[x_m, y_m]: &[f64; 2]| SensorNode { x_m, y_m, gain: 10f64.powf(-5.2), ..SensorNode::default() };
        let scenario = Scenario::letter(Overrides::default()).unwrap();
        let nodes: Vec<SensorNode> = positions_m.iter().map(sensor).collect();
        OwnedSetup::new(scenario, &nodes).unwrap()
    }

    /// The strategy of that name in [`setup_of`].
    pub(crate) fn made(name: &str, positions_m: &[[f64; 2]]) -> (MissionTable, Box<dyn Strategy>) {
        let field = setup_of(positions_m);
        let strategy = (Registered::find(name).unwrap().make)(&field.setup());
        (field.table, strategy)
    }

    #[test]
    fn the_registry_lists_every_strategy_with_its_statefulness() {
        for strategy in STRATEGIES {
            let name = strategy.name;
            let overrides = Overrides { strategy: Some(name), ..Overrides::default() };
            assert_eq!(Registered::of(&Scenario::letter(overrides).unwrap()).unwrap().name, name);
            let mut bytes = Vec::new();
            made(name, &[[50.0, 50.0]]).1.save(&mut bytes);
            assert_eq!(bytes.is_empty(), strategy.is_stateless, "{name}");
        }
    }
}
