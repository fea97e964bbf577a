//! The entry of a strategy in the registry.

use serde::{Serialize, Serializer};
use skysink_common::error::InputError;
use skysink_common::keys::{Key, Keys};
use skysink_common::scenario::Scenario;
use toml::Table;

use super::{Setup, Strategy};

/// The keys of one strategy, a table of `[planner]`.
#[derive(Debug, Clone, Copy)]
pub struct StrategyKeys {
    /// Their description.
    pub keys: &'static [Key],
    /// Checks the named table of a scenario, and fills in its defaults.
    pub check: fn(&Scenario, &str) -> Result<Table, InputError>,
}

/// An entry of the registry. It is serialized as its name.
///
/// ```
/// use skysink_planner::keys::Settings;
/// use skysink_planner::strategy::{Registered, rule};
/// let wait = Registered::new("wait", "never serve", |_| rule(|_| None)).with_state().with_path();
/// assert!(!wait.is_stateless && wait.has_path);
/// let keys = wait.with_keys::<Settings>().keys.unwrap();
/// assert_eq!(keys.keys[0].name, "sca_iterations");
/// let mut scenario = skysink_common::scenario::Scenario::letter(Default::default()).unwrap();
/// wait.set_keys(&mut scenario, toml::toml! { sca_iterations = 2 });
/// assert!((keys.check)(&scenario, "planner.wait").is_ok());
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Registered {
    /// Its name in scenario files, folders and tables.
    pub name: &'static str,
    /// What it does, in a line.
    pub about: &'static str,
    /// Whether it keeps no state between slots.
    pub is_stateless: bool,
    /// Whether it plans beyond a slot ([`Strategy::path`]).
    pub has_path: bool,
    /// Whether it flies as if all weights were equal (decision D25).
    pub ignores_weights: bool,
    /// Its own keys, `[planner.<name>]`; `None` if it has none.
    pub keys: Option<StrategyKeys>,
    /// Constructs it, for a scenario with checked keys.
    pub make: fn(&Setup<'_>) -> Box<dyn Strategy>,
}

impl Registered {
    /// A strategy without state, path and keys of its own.
    #[must_use]
    pub const fn new(name: &'static str, about: &'static str, make: fn(&Setup<'_>) -> Box<dyn Strategy>) -> Self {
        Self { name, about, is_stateless: true, has_path: false, ignores_weights: false, keys: None, make }
    }

    /// Says that it has state between slots.
    #[must_use]
    pub const fn with_state(self) -> Self {
        Self { is_stateless: false, ..self }
    }

    /// Says that it plans beyond a slot.
    #[must_use]
    pub const fn with_path(self) -> Self {
        Self { has_path: true, ..self }
    }

    /// Says that it flies as if all weights were equal.
    #[must_use]
    pub const fn without_weights(self) -> Self {
        Self { ignores_weights: true, ..self }
    }

    /// Gives it the keys that `T` declares.
    #[must_use]
    pub const fn with_keys<T: Keys>(self) -> Self {
        Self { keys: Some(StrategyKeys { keys: T::KEYS, check: checked::<T> }), ..self }
    }

    /// Replaces its own keys in a scenario.
    pub fn set_keys(&self, scenario: &mut Scenario, keys: impl Serialize) {
        let keys = Table::try_from(keys).expect("keys are numbers and strings");
        scenario.planner.others.insert(self.name.to_owned(), keys.into());
    }
}

impl PartialEq for Registered {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl Serialize for Registered {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name)
    }
}

/// The table `table` of a scenario, read as the keys `T` of a strategy, with all defaults.
fn checked<T: Keys>(scenario: &Scenario, table: &str) -> Result<Table, InputError> {
    let keys: T = scenario.planner_keys(table)?;
    Ok(Table::try_from(keys).expect("keys are numbers and strings"))
}
