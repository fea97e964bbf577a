//! Reads a table of a scenario: fills in defaults, checks ranges, and makes errors that name the file and the key.

use std::fmt::Display;
use std::path::Path;

use serde::de::DeserializeOwned;
use serde_path_to_error::Segment;
use toml::{Table, Value};

use super::dotted::{is_below, join};
use super::setting::Setting;
use super::{Accepts, Key, Keys};
use crate::error::{InputError, quoted, suggestion};

/// Origin of the values of a scenario, for messages.
#[derive(Debug, Clone, Copy)]
pub struct Source<'a> {
    /// The file.
    pub path: &'a Path,
    /// The settings that replaced its values.
    pub settings: &'a [Setting],
    /// The keys that a table of a list has instead of those of `[uav]`, if it is read over them.
    pub own: Option<&'a OwnKeys>,
}

/// The keys of a table of `[[uav.each]]`, which replace others of the scenario.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OwnKeys {
    /// Its name, such as `uav.each[2]`.
    pub name: String,
    /// The dotted names of the keys that it replaces.
    pub keys: Vec<String>,
}

impl OwnKeys {
    /// Whether the value of the dotted `key`, or one below it, is its own.
    #[must_use]
    pub fn has(&self, key: &str) -> bool {
        self.keys.iter().any(|own| own == key || is_below(key, own) || is_below(own, key))
    }

    /// The name of the dotted `key` in its table.
    fn name_of(&self, key: &str) -> String {
        let inner = key.strip_prefix(UAV).or_else(|| key.rfind('.').map(|dot| &key[dot..]));
        self.name.clone() + inner.unwrap_or_default()
    }
}

/// The table whose keys are replaced, in the names of keys.
const UAV: &str = "uav";

impl Source<'_> {
    /// The error for the `value` of the dotted `key`.
    #[must_use]
    pub fn refusal(self, key: &str, value: &Value, expected: &str) -> InputError {
        let value = match value {
            Value::String(text) => format!("\"{}\"", quoted(text)),
            other => quoted(&other.to_string()),
        };
        self.refuse(key, &format!("{} = {value}: ", quoted(key)), format_args!("expected {expected}"))
    }

    /// The error for `key`, whose value is described by `found`. It names the setting that the value comes from, or
    /// else the file.
    fn refuse(self, key: &str, found: &str, message: impl Display) -> InputError {
        if let Some(own) = self.own {
            let plain = Self { own: None, ..self };
            let (named, of) = match own.has(key) {
                true => (own.name_of(key), String::new()),
                false if is_below(key, UAV) => (key.to_owned(), format!(" (for {})", own.name)),
                false => (key.to_owned(), String::new()),
            };
            let found = found.replacen(&*quoted(key), &quoted(&named), 1);
            return plain.refuse(&named, &found, format_args!("{message}{of}"));
        }
        let is_in = |rest: &str| rest.is_empty() || rest.starts_with(['.', '[']);
        let is_from = |setting: &&Setting| key.strip_prefix(&*setting.key).is_some_and(is_in);
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

/// Fills in the defaults of `keys` that `table`, called `name`, and the tables in it lack, except those of the dotted
/// names `displaced`.
///
/// # Panics
/// If a declared default is not TOML.
pub fn fill(keys: &[Key], name: &str, table: &mut Table, displaced: &[String]) {
    for key in keys {
        let name = join(name, key.name);
        if !table.contains_key(key.name)
            && !displaced.contains(&name)
            && let Some(default) = key.default.filter(|_| key.only.is_none_or(|only| only.holds(table)))
        {
            table.insert(key.name.to_owned(), default.parse().expect("a declared default is TOML"));
        }
        if let (Some(keys), Some(Value::Table(inner))) = (key.accepts.inner(), table.get_mut(key.name)) {
            fill(keys, &name, inner, displaced);
        }
    }
}

/// Checks the values of `keys` in `table`, called `name`, and in the tables in it. Whole numbers may be written as 3e4.
fn check(keys: &[Key], name: &str, table: &mut Table, source: Source) -> Result<(), InputError> {
    for key in keys {
        let Some(value) = table.get_mut(key.name) else { continue };
        let name = join(name, key.name);
        key.accepts.make_whole(value);
        if let Some(expected) = key.accepts.refusal(value) {
            return Err(source.refusal(&name, value, &expected));
        }
        if let (Some(keys), Value::Table(inner)) = (key.accepts.inner(), &mut *value) {
            check(keys, &name, inner, source)?;
        }
        if let (Accepts::TablesOf(keys), Value::Array(tables)) = (key.accepts, value) {
            for (index, inner) in tables.iter_mut().enumerate() {
                let Value::Table(inner) = inner else { continue };
                check(keys, &format!("{name}[{index}]"), inner, source)?;
            }
        }
    }
    Ok(())
}

/// Reads `table`, which has all defaults, as a `T`. `name` is its dotted name in the scenario, empty for the scenario
/// itself.
///
/// # Errors
/// If a key is unknown or missing, or its value is out of range or of another type.
pub fn read<T: Keys>(mut table: Table, name: &str, source: Source) -> Result<T, InputError> {
    check(T::KEYS, name, &mut table, source)?;
    let all = super::all(T::KEYS, name);
    let lists = all.into_iter().filter(|(_, key)| matches!(key.accepts, Accepts::TablesOf(_)));
    deserialize(table, name, source, &lists.map(|(name, _)| name).collect::<Vec<_>>())
}

/// The message of serde becomes one about a key of the scenario.
/// `lists` are the dotted names of the keys that are lists of tables.
fn deserialize<T: DeserializeOwned>(
    table: Table,
    name: &str,
    source: Source,
    lists: &[String],
) -> Result<T, InputError> {
    let table = Value::Table(table);
    serde_path_to_error::deserialize(table.clone()).map_err(|error| {
        let mut found = Some(&table);
        let mut key = name.to_owned();
        for segment in error.path() {
            match segment {
                Segment::Map { key: inner } => {
                    key = join(&key, inner);
                    found = found.and_then(|outer| outer.get(inner));
                }
                Segment::Seq { index } => {
                    let inner = found.and_then(|outer| outer.get(*index));
                    if lists.contains(&key) {
                        key += &format!("[{index}]");
                    } else if let (Some(outer), Some(Value::Table(_))) = (found, inner) {
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
                    "u32" | "u64" | "usize" => "a whole number",
                    "f64" => "a number",
                    "string only" => "a string",
                    "a sequence" if lists.contains(&key) => &format!("a list of tables, [[{key}]]"),
                    "a sequence" => "a list",
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
