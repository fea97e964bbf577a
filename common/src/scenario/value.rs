//! Counts, intervals and names, which are checked as they are read, and a reader whose errors name the file and the
//! key.

use std::fmt::Display;
use std::path::Path;

use serde::de::{DeserializeOwned, Error as _};
use serde::{Deserialize, Deserializer, Serialize};
use serde_path_to_error::Segment;
use toml::{Table, Value};

use super::Setting;
use super::forms::is_below;
use crate::error::{InputError, quoted, suggestion};

/// A whole number from `MIN` to `MAX`, both at most 2^63 − 1, the largest integer of TOML.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "i64")]
pub struct Count<const MIN: u64, const MAX: u64>(u64);

impl<const MIN: u64, const MAX: u64> Count<MIN, MAX> {
    /// The number `N`, checked at compile time.
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

/// Reads a [`Count`] as a plain number.
pub(super) fn count<'de, const MIN: u64, const MAX: u64, D: Deserializer<'de>, N: TryFrom<u64>>(
    deserializer: D,
) -> Result<N, D::Error> {
    let Count(count) = Count::<MIN, MAX>::deserialize(deserializer)?;
    N::try_from(count).map_err(|_| D::Error::custom(format!("expected {MIN} to {MAX}")))
}

/// One number for all sensor nodes, or a range from which each draws its own.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected a number or [lowest, highest]")]
pub enum Interval {
    /// The same for all.
    One(f64),
    /// The lowest and the highest; drawn uniformly, levels uniformly in dB.
    Range([f64; 2]),
}

impl Interval {
    /// The lowest and the highest value.
    #[must_use]
    pub fn ends(self) -> [f64; 2] {
        match self {
            Self::One(value) => [value; 2],
            Self::Range(ends) => ends,
        }
    }

    /// The mean of the interval.
    #[must_use]
    pub fn mean(self) -> f64 {
        let [lowest, highest] = self.ends();
        lowest + (highest - lowest) / 2.0
    }
}

/// Longest name of a mission [bytes]: names become folders, whose names end at 255 bytes.
const MAX_NAME_BYTES: usize = 100;

/// Reads the name of a mission.
pub(super) fn name<'de, D: Deserializer<'de>>(deserializer: D) -> Result<String, D::Error> {
    let name = String::deserialize(deserializer)?;
    let is_allowed = |byte: u8| byte.is_ascii_alphanumeric() || b"._-".contains(&byte);
    let is_valid = (1..=MAX_NAME_BYTES).contains(&name.len())
        && name.bytes().all(is_allowed)
        && !name.bytes().all(|byte| byte == b'.');
    let expected = "expected 1 to 100 of A-Z a-z 0-9 . _ - (it becomes a folder)";
    if is_valid { Ok(name) } else { Err(D::Error::custom(expected)) }
}

/// Origin of the values of a scenario, for messages.
#[derive(Debug, Clone, Copy)]
pub(super) struct Source<'a> {
    /// The file.
    pub(super) path: &'a Path,
    /// The settings that replaced its values.
    pub(super) settings: &'a [Setting],
}

impl Source<'_> {
    /// The error for the `value` of the dotted `key`.
    pub(super) fn refusal(self, key: &str, value: &Value, expected: &str) -> InputError {
        let value = match value {
            Value::String(text) => format!("\"{}\"", quoted(text)),
            other => quoted(&other.to_string()),
        };
        self.refuse(key, &format!("{} = {value}: ", quoted(key)), format_args!("expected {expected}"))
    }

    /// The error for `key`, whose value is described by `found`. It names the setting that the value comes from, or
    /// else the file.
    fn refuse(self, key: &str, found: &str, message: impl Display) -> InputError {
        let is_from = |setting: &&Setting| key == setting.key || is_below(key, &setting.key);
        match self.settings.iter().rfind(is_from) {
            Some(setting) if key == setting.key => setting.refusal(message),
            Some(setting) => setting.refusal(format_args!("{found}{message}")),
            None => {
                let settings = Setting::list(self.settings);
                InputError::new("scenario", self.path, format_args!("{found}{message}{settings}"))
            }
        }
    }
}

/// Reads `table` as a `T`. `name` is its dotted name in the scenario, empty for the scenario itself.
pub(super) fn read<T: DeserializeOwned>(table: Table, name: &str, source: Source) -> Result<T, InputError> {
    let table = Value::Table(table);
    serde_path_to_error::deserialize(table.clone()).map_err(|error| {
        let mut found = Some(&table);
        let mut key = name.to_owned();
        for segment in error.path() {
            match segment {
                Segment::Map { key: inner } => {
                    let dot = if key.is_empty() { "" } else { "." };
                    key = format!("{key}{dot}{inner}");
                    found = found.and_then(|outer| outer.get(inner));
                }
                Segment::Seq { index } => {
                    let inner = found.and_then(|outer| outer.get(*index));
                    if let (Some(outer), Some(Value::Table(_))) = (found, inner) {
                        return source.refusal(&key, outer, &format!("a table, [{key}]"));
                    }
                    found = inner;
                }
                Segment::Enum { .. } | Segment::Unknown => {}
            }
        }
        let message = error.inner().message();
        match (found.filter(|_| !key.is_empty()), message.rsplit_once("expected ")) {
            (Some(value), Some((_, expected))) => {
                let plain = match expected {
                    "i64" if value.is_float() => "a whole number, without decimal point or exponent",
                    "i64" => "a whole number",
                    "f64" => "a number",
                    "string only" => "a string",
                    "fewer elements in array" => "two numbers",
                    other => other,
                };
                source.refusal(&key, value, &(plain.to_owned() + &suggestion(message)))
            }
            _ => {
                let location = if key.is_empty() { String::new() } else { format!("{key}: ") };
                let message = match message.strip_prefix("missing field ") {
                    Some(name) => format!("missing {name}: this key is required"),
                    None => message.to_owned() + &suggestion(message),
                };
                source.refuse(&key, &location, message)
            }
        }
    })
}
