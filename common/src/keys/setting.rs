//! Settings: keys of the scenario with values that replace those of the file.

use std::fmt;
use std::str::FromStr;

use strum::{Display, IntoStaticStr};
use toml::{Table, Value};

use crate::error::{InputError, quoted};

/// Longest accepted key [bytes].
const MAX_KEY_BYTES: usize = 200;

/// Origin of a setting, by its name in messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Display, IntoStaticStr)]
pub enum SettingOrigin {
    /// The option `--set`.
    #[strum(serialize = "--set")]
    Option,
    /// An axis of a sweep.
    #[strum(serialize = "axis")]
    Axis,
    /// A program that replaces keys of a scenario.
    #[strum(serialize = "replace")]
    Replacement,
}

/// A dotted key with its value, such as `link.bandwidth_hz=5e3`.
#[derive(Debug, Clone, PartialEq)]
pub struct Setting {
    /// The key, such as `link.bandwidth_hz`.
    pub key: String,
    /// The value.
    pub value: Value,
    /// Where the setting was made.
    pub origin: SettingOrigin,
}

impl Setting {
    /// Sets the key in the table of a scenario.
    ///
    /// # Errors
    /// If a part of the key exists, but is not a table.
    pub fn apply(&self, mut table: &mut Table) -> Result<(), InputError> {
        let mut parts: Vec<&str> = self.key.split('.').collect();
        let last = parts.pop().unwrap_or_default();
        for (index, part) in parts.iter().enumerate() {
            let inner = table.entry(*part).or_insert_with(|| Table::new().into());
            table = inner.as_table_mut().ok_or_else(|| {
                let parent = parts[..=index].join(".");
                self.refusal(format_args!("{parent} is not a table: expected a key of the scenario"))
            })?;
        }
        table.insert(last.to_owned(), self.value.clone());
        Ok(())
    }

    /// The error for this setting.
    pub fn refusal(&self, message: impl fmt::Display) -> InputError {
        InputError::of_argument(self.origin.into(), &self.to_string(), message)
    }

    /// The settings as an addition to the error for another key, which they may have caused; empty without settings.
    pub fn list(settings: &[Self]) -> String {
        let texts: Vec<String> = settings.iter().map(|setting| format!("{} {setting}", setting.origin)).collect();
        if texts.is_empty() { String::new() } else { format!(" (with {})", texts.join(" ")) }
    }
}

impl fmt::Display for Setting {
    /// Writes it as on a command line.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let value = self.value.as_str().map_or_else(|| quoted(&self.value.to_string()), quoted);
        write!(formatter, "{}={value}", self.key)
    }
}

impl FromStr for Setting {
    type Err = &'static str;

    /// Parses `key=value`, with the value as in a scenario file. Text needs no quotes.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let is_key = |key: &str| {
            key.len() <= MAX_KEY_BYTES
                && key.split('.').all(|part| !part.is_empty() && !part.contains(char::is_whitespace))
        };
        let (key, value) = text.split_once('=').ok_or("expected key=value, such as link.bandwidth_hz=5e3")?;
        let key = key.trim();
        if !is_key(key) {
            return Err("expected a dotted key of the scenario before the =, such as link.bandwidth_hz");
        }
        let value = value.trim();
        if value.is_empty() {
            return Err("expected a value behind the =");
        }
        // One line only: a value must not add further keys.
        let as_toml = if value.contains('\n') { None } else { format!("value = {value}").parse::<Table>().ok() };
        let as_toml = as_toml.and_then(|mut table| table.remove("value"));
        let value = match as_toml {
            // Counts may be written as 3e4, also those of planners from outside, whose keys are not known here.
            Some(Value::Float(number)) if !value.contains('.') && number.fract() == 0.0 && number.abs() < 1e15 => {
                Value::Integer(number as i64)
            }
            Some(value) => value,
            None => Value::String(value.to_owned()),
        };
        Ok(Self { key: key.to_owned(), value, origin: SettingOrigin::Option })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(text: &str) -> Setting {
        text.parse().unwrap()
    }

    #[test]
    fn a_value_is_read_as_in_a_scenario_file() {
        assert_eq!(set("slots=7").value, Value::Integer(7));
        assert_eq!(set("link.bandwidth_hz = 5.5e3").value, Value::Float(5.5e3));
        assert_eq!(set("sensors.capacity_bits = 3e4").value, Value::Integer(30_000), "a count");
        assert_eq!(set("link.bandwidth_hz = 5e-1").value, Value::Float(0.5));
        assert_eq!(set("area.side_m = inf").value, Value::Float(f64::INFINITY));
        assert_eq!(set("sensors.sampling_bps=[50, 150.0]").value.as_array().unwrap().len(), 2);
        assert_eq!(set("link.environment=\"urban\"").value, Value::String("urban".to_owned()));
    }

    #[test]
    fn text_needs_no_quotes() {
        assert_eq!(set("planner.strategy=drift-plus-penalty").value, Value::String("drift-plus-penalty".to_owned()));
        assert_eq!(set("sensors.file=a=b.csv").value, Value::String("a=b.csv".to_owned()));
    }

    #[test]
    fn a_text_without_key_or_value_is_refused() {
        for text in ["", "slots", "=3", "slots=", ".slots=3", "a b=3", "link.=3"] {
            assert!(text.parse::<Setting>().is_err(), "{text}");
        }
    }

    #[test]
    fn a_setting_creates_missing_tables_but_does_not_replace_a_number_by_a_table() {
        let mut table: Table = "slots = 3".parse().unwrap();
        set("planner.horizon.iterations=5").apply(&mut table).unwrap();
        assert_eq!(table["planner"]["horizon"]["iterations"].as_integer(), Some(5));
        let refused = set("slots.x=1").apply(&mut table).unwrap_err();
        assert_eq!(refused.to_string(), "--set slots.x=1: slots is not a table: expected a key of the scenario");
    }
}
