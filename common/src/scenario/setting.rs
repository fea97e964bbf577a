//! A key of the scenario with a value to take instead of the file's.

use std::str::FromStr;

use toml::{Table, Value};

/// Letters of a key, at most: more than any has.
const MOST_LETTERS: usize = 200;

/// A dotted key with its value, such as `link.bandwidth_hz=5e3`.
#[derive(Debug, Clone, PartialEq)]
pub struct Setting {
    /// The key, such as `link.bandwidth_hz`.
    pub key: String,
    /// What it becomes.
    pub value: Value,
}

impl Setting {
    /// Changes the table of a scenario; `None` if a part of the key is there, but no table.
    #[must_use]
    pub fn apply(&self, mut table: &mut Table) -> Option<()> {
        let mut parts = self.key.split('.');
        let last = parts.next_back()?;
        for part in parts {
            table = table.entry(part).or_insert_with(|| Table::new().into()).as_table_mut()?;
        }
        table.insert(last.to_owned(), self.value.clone());
        Some(())
    }
}

impl FromStr for Setting {
    type Err = &'static str;

    /// From `key=value`. The value is written as in a scenario file; text needs no quotes.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let is_key = |key: &str| {
            key.len() <= MOST_LETTERS
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
        // One line, so that a value cannot bring in keys of its own.
        let as_toml = if value.contains('\n') { None } else { format!("value = {value}").parse::<Table>().ok() };
        let as_toml = as_toml.and_then(|mut table| table.remove("value"));
        Ok(Self { key: key.to_owned(), value: as_toml.unwrap_or_else(|| Value::String(value.to_owned())) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(text: &str) -> Setting {
        text.parse().unwrap()
    }

    #[test]
    fn a_value_is_what_a_scenario_file_would_have_there() {
        assert_eq!(set("slots=7").value, Value::Integer(7));
        assert_eq!(set("link.bandwidth_hz = 5e3").value, Value::Float(5e3));
        assert_eq!(set("sensors.sampling_bps=[50, 150.0]").value.as_array().unwrap().len(), 2);
        assert_eq!(set("link.environment=\"urban\"").value, Value::String("urban".to_owned()));
    }

    #[test]
    fn text_needs_no_quotes() {
        assert_eq!(set("planner.strategy=drift-plus-penalty").value, Value::String("drift-plus-penalty".to_owned()));
        assert_eq!(set("sensors.file=a=b.csv").value, Value::String("a=b.csv".to_owned()));
    }

    #[test]
    fn what_is_no_key_with_a_value_is_refused() {
        for text in ["", "slots", "=3", "slots=", ".slots=3", "a b=3", "link.=3"] {
            assert!(text.parse::<Setting>().is_err(), "{text}");
        }
    }

    #[test]
    fn a_key_is_set_in_tables_that_are_made_for_it_but_not_below_a_number() {
        let mut table: Table = "slots = 3".parse().unwrap();
        set("planner.horizon.iterations=5").apply(&mut table).unwrap();
        assert_eq!(table["planner"]["horizon"]["iterations"].as_integer(), Some(5));
        assert_eq!(set("slots.x=1").apply(&mut table), None);
    }
}
