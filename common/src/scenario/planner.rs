//! `[planner]` of a scenario: the name of the strategy, and keys and tables that this crate does not interpret.
//!
//! The planner reads them with [`Scenario::planner_keys`] and writes them back with all defaults by
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
    /// Reads `[planner]` as a `T`: `table` is `"planner"`, or the dotted name of one of its tables, such as
    /// `"planner.horizon"`. A missing table is read as an empty one.
    ///
    /// # Errors
    /// If `T` refuses a key or its value; the error names it.
    pub fn planner_keys<T: DeserializeOwned>(&self, table: &str) -> Result<T, InputError> {
        let keys = match table.strip_prefix("planner.").map(|name| self.planner.others.get(name)) {
            Some(Some(Value::Table(keys))) => keys.clone(),
            Some(Some(other)) => return Err(self.refusal(table, other, "a table")),
            Some(None) => Table::new(),
            None => Table::try_from(&self.planner).expect("it was read from TOML"),
        };
        value::read(keys, table, self.source())
    }

    /// The same scenario with `keys` as `[planner]`, such as the checked keys with all defaults.
    ///
    /// # Errors
    /// If `keys` have no strategy.
    ///
    /// # Panics
    /// If `keys` cannot be written as TOML.
    pub fn with_planner_keys(mut self, keys: &impl Serialize) -> Result<Self, InputError> {
        let keys = Table::try_from(keys).expect("keys are plain tables of numbers and strings");
        self.planner = value::read(keys, "planner", self.source())?;
        Ok(self)
    }

    /// The error for the `value` of `key`.
    #[must_use]
    pub fn refusal(&self, key: &str, value: &Value, expected: &str) -> InputError {
        self.source().refusal(key, value, expected)
    }
}
