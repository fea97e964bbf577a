//! Values that are checked as they are read, and the reader that says which key of which file it refuses, and why.

use std::path::Path;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_path_to_error::Segment;
use toml::{Table, Value};

use super::ScenarioError;

/// A whole number from `MIN` to `MAX`, both at most TOML's largest, 2^63 − 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "i64")]
pub struct Count<const MIN: u64, const MAX: u64>(u64);

impl<const MIN: u64, const MAX: u64> Count<MIN, MAX> {
    /// The number `N`, which is checked when the program is built.
    #[must_use]
    pub const fn of<const N: u64>() -> Self {
        const { assert!(MIN <= N && N <= MAX) };
        Self(N)
    }

    /// The number nearest to `value`.
    #[must_use]
    pub fn clamped(value: u64) -> Self {
        Self(value.clamp(MIN, MAX))
    }

    /// The number.
    #[must_use]
    pub const fn get(self) -> u64 {
        self.0
    }
}

impl<const MIN: u64, const MAX: u64> TryFrom<i64> for Count<MIN, MAX> {
    type Error = String;

    fn try_from(value: i64) -> Result<Self, String> {
        let count = u64::try_from(value).ok().filter(|count| (MIN..=MAX).contains(count));
        count.map(Self).ok_or_else(|| format!("expected {MIN} to {MAX}"))
    }
}

/// Reads `table`, whose dotted name in the file `path` is `name`, as a `T`.
pub(super) fn read<T: DeserializeOwned>(table: Table, name: &str, path: &Path) -> Result<T, ScenarioError> {
    let table = Value::Table(table);
    serde_path_to_error::deserialize(table.clone()).map_err(|error| {
        let (mut key, mut found) = (name.to_owned(), Some(&table));
        for segment in error.path() {
            match segment {
                Segment::Map { key: inner } => {
                    key =
                        [key, inner.clone()].into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(".");
                    found = found.and_then(|outer| outer.get(inner));
                }
                Segment::Seq { index } => found = found.and_then(|outer| outer.get(*index)),
                Segment::Enum { .. } | Segment::Unknown => {}
            }
        }
        let message = error.inner().message();
        match (found, message.rsplit_once("expected ")) {
            (Some(value), Some((_, expected))) => {
                let plain = match expected {
                    "i64" => "a whole number",
                    "f64" => "a number",
                    "string only" => "a string",
                    other => other,
                };
                refusal(path, &key, value, plain)
            }
            _ => ScenarioError::Malformed {
                path: path.to_owned(),
                place: format!("{key}: "),
                message: message.to_owned(),
            },
        }
    })
}

/// The refusal of what the dotted `key` of the file `path` holds.
pub(super) fn refusal(path: &Path, key: &str, value: &Value, expected: &str) -> ScenarioError {
    let value = match value {
        Value::String(text) => format!("{text:?}"),
        other => other.to_string().replace('\n', " "),
    };
    ScenarioError::Value { path: path.to_owned(), key: key.to_owned(), value, expected: expected.replace('\n', " ") }
}
