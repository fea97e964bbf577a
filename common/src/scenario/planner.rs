//! `[planner]` of a scenario: the name of a strategy, and keys and tables that this crate does not interpret.
//!
//! The planner reads them by [`Scenario::planner_keys`] and writes them back with every default by
//! [`Scenario::with_planner_keys`].

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use super::{Scenario, value};
use crate::error::InputError;

/// `[planner]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(expecting = "a table")]
pub struct PlannerKeys {
    /// Name of the strategy.
    pub strategy: String,
    /// Every other key.
    #[serde(flatten)]
    pub others: Table,
}

impl Scenario {
    /// Reads `[planner]` as a `T`: `table` is `"planner"`, or the dotted name of one of its tables,
    /// `"planner.horizon"`. A table that is left out is an empty one.
    ///
    /// # Errors
    /// If `T` refuses a value or a key; the error names it.
    pub fn planner_keys<T: DeserializeOwned>(&self, table: &str) -> Result<T, InputError> {
        let keys = match table.strip_prefix("planner.").map(|name| self.planner.others.get(name)) {
            Some(Some(Value::Table(keys))) => keys.clone(),
            Some(Some(other)) => return Err(self.refusal(table, other, "a table")),
            Some(None) => Table::new(),
            None => Table::try_from(&self.planner).expect("it was read from TOML"),
        };
        value::read(keys, table, self.source())
    }

    /// The same scenario with the keys `keys` for `[planner]`, such as the checked ones with every default.
    ///
    /// # Errors
    /// If they have no strategy.
    ///
    /// # Panics
    /// If TOML cannot write them.
    pub fn with_planner_keys(mut self, keys: &impl Serialize) -> Result<Self, InputError> {
        let keys = Table::try_from(keys).expect("keys are plain tables of numbers and strings");
        self.planner = value::read(keys, "planner", self.source())?;
        Ok(self)
    }

    /// The refusal of what `key` holds.
    #[must_use]
    pub fn refusal(&self, key: &str, value: &Value, expected: &str) -> InputError {
        self.source().refusal(key, value, expected)
    }
}
