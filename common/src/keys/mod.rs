//! Scenario keys, each described once: its name, default, unit, range and meaning.
//!
//! [`keys!`](crate::keys!) declares the keys of a table. From this description are made the defaults ([`fill`]), the
//! checks and their messages ([`read`]), the scenario of `skysink new`, and the page on scenario keys of the book.
//! Rules between keys are left to [`crate::scenario`] and to the planner.

pub mod dotted;
mod interval;
pub mod presets;
mod reader;
mod setting;

use serde::Serialize;
use serde::de::DeserializeOwned;
use toml::{Table, Value};

use crate::error::InputError;

pub use interval::{Interval, WholeInterval};
pub use reader::{OwnKeys, Source, fill, read};
pub use setting::{Setting, SettingOrigin};

/// Checks a rule between keys: whether it holds, the dotted key that is refused where it does not, and what is expected
/// there. Keys that are not given are not refused.
pub type Rule<'a> = &'a dyn Fn(bool, &str, &str) -> Result<(), InputError>;

/// A table of a scenario file, declared by [`keys!`](crate::keys!).
pub trait Keys: Serialize + DeserializeOwned {
    /// Its keys, in the order in which they are written.
    const KEYS: &'static [Key];
}

/// The description of a key.
#[derive(Debug, Clone, Copy)]
pub struct Key {
    /// Its name in its table.
    pub name: &'static str,
    /// Its meaning, with the unit in brackets.
    pub words: &'static str,
    /// Its default, as TOML; `None` if it is required, or may be absent.
    pub default: Option<&'static str>,
    /// Its values.
    pub accepts: Accepts,
    /// The condition for its default.
    pub only: Option<Only>,
}

impl Key {
    /// A key without a default.
    #[must_use]
    pub const fn new(name: &'static str, words: &'static str, accepts: Accepts) -> Self {
        Self { name, words: words.trim_ascii(), default: None, accepts, only: None }
    }

    /// This key with a default.
    #[must_use]
    pub const fn or(self, default: &'static str) -> Self {
        Self { default: Some(default), ..self }
    }

    /// This key under a condition.
    #[must_use]
    pub const fn only(self, only: Only) -> Self {
        Self { only: Some(only), ..self }
    }
}

/// A condition on another key of the same table. A key under this condition has its default only where it holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Only {
    /// The other key.
    pub key: &'static str,
    /// Its values.
    pub values: &'static [&'static str],
    /// What is expected of the key where the condition does not hold; `None` if the key is accepted there, too.
    pub expected: Option<&'static str>,
}

impl Only {
    /// Whether `table` meets the condition.
    pub fn holds(&self, table: &Table) -> bool {
        table.get(self.key).and_then(Value::as_str).is_some_and(|value| self.values.contains(&value))
    }
}

/// The values that a key accepts. Messages and the book describe them by the same words.
#[derive(Debug, Clone, Copy)]
pub enum Accepts {
    /// Numbers by a test that is false for NaN.
    Number(&'static str, fn(f64) -> bool),
    /// An [`Interval`] of such numbers.
    Interval(&'static str, fn(f64) -> bool),
    /// Whole numbers, from the least to the greatest.
    Whole(u64, u64),
    /// A [`WholeInterval`] of such numbers.
    WholeInterval(u64, u64),
    /// Texts by a test.
    Text(&'static str, fn(&str) -> bool),
    /// The names of the variants of an enum.
    OneOf(&'static [&'static str]),
    /// A table with these keys.
    TableOf(&'static [Key]),
    /// A list of tables with these keys.
    TablesOf(&'static [Key]),
    /// Values that a rule checks after all keys are read.
    Rule(&'static str),
}

/// Numbers above 0.
pub const POSITIVE: Accepts = Accepts::Number("a finite number above 0", |number| number > 0.0 && number.is_finite());

/// Paths.
pub const PATH: Accepts = Accepts::Text("the path of a CSV file, relative to the scenario", |path| !path.is_empty());

/// Numbers from 0.
pub const NOT_NEGATIVE: Accepts =
    Accepts::Number("a finite number, 0 or above", |number| number >= 0.0 && number.is_finite());

/// All numbers but infinities and NaN.
pub const FINITE: Accepts = Accepts::Number("a finite number", f64::is_finite);

/// Gains of links [dB].
pub const LEVEL_DB: Accepts =
    Accepts::Number("a level from -300 to 0 dB", |level_db| (-300.0..=0.0).contains(&level_db));

impl Accepts {
    /// The numbers that it accepts, and intervals of them.
    #[must_use]
    pub const fn or_interval(self) -> Self {
        match self {
            Self::Number(expected, is_accepted) => Self::Interval(expected, is_accepted),
            other => other,
        }
    }

    /// The keys of the table.
    pub const fn inner(&self) -> Option<&'static [Key]> {
        match self {
            Self::TableOf(keys) => Some(keys),
            _ => None, // the tables of a list have no dotted names
        }
    }

    /// What is expected, for messages and for the book.
    pub fn expected(&self) -> String {
        match self {
            Self::Number(expected, _)
            | Self::Interval(expected, _)
            | Self::Text(expected, _)
            | Self::Rule(expected) => (*expected).to_owned(),
            Self::Whole(least, greatest) | Self::WholeInterval(least, greatest) => format!("{least} to {greatest}"),
            Self::OneOf(names) => names.iter().map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(", "),
            Self::TableOf(_) => "a table".to_owned(),
            Self::TablesOf(_) => "a list of tables".to_owned(),
        }
    }

    /// Makes whole numbers of those without a fraction, where such are expected.
    pub(super) fn make_whole(&self, value: &mut Value) {
        match (self, value) {
            (Self::Whole(..) | Self::WholeInterval(..), value @ Value::Float(_)) => {
                let number = value.as_float().filter(|number| number.fract() == 0.0 && number.abs() <= MOST_EXACT);
                if let Some(number) = number {
                    *value = Value::Integer(number as i64);
                }
            }
            (Self::WholeInterval(..), Value::Array(ends)) => ends.iter_mut().for_each(|end| self.make_whole(end)),
            _ => {}
        }
    }

    /// What is expected instead of `value`; `None` if it is accepted, or is of a type that the reader refuses.
    pub fn refusal(&self, value: &Value) -> Option<String> {
        match self {
            Self::Number(_, is_accepted) => (!is_accepted(number(value)?)).then(|| self.expected()),
            Self::Interval(expected, is_accepted) => {
                let Some([lowest, highest]) = value.as_array().map(Vec::as_slice) else {
                    return Self::Number(expected, *is_accepted).refusal(value);
                };
                let ends = [number(lowest)?, number(highest)?];
                let is_refused = !ends.into_iter().all(is_accepted) || !ends.is_sorted();
                is_refused.then(|| self.expected() + ", the lower first")
            }
            Self::Whole(least, greatest) => {
                let whole = value.as_integer()?;
                let is_accepted = u64::try_from(whole).is_ok_and(|whole| (*least..=*greatest).contains(&whole));
                (!is_accepted).then(|| self.expected())
            }
            Self::WholeInterval(least, greatest) => {
                let Some(ends) = value.as_array() else { return Self::Whole(*least, *greatest).refusal(value) };
                let [lowest, highest] = ends.as_slice() else { return None };
                let is_refused = !(*least as i64..=highest.as_integer()?).contains(&lowest.as_integer()?)
                    || Self::Whole(*least, *greatest).refusal(highest).is_some();
                is_refused.then(|| self.expected() + ", the lower first")
            }
            Self::Text(_, is_accepted) => value.as_str().filter(|text| !is_accepted(text)).map(|_| self.expected()),
            Self::OneOf(names) => {
                let is_nested = matches!(value, Value::Table(_) | Value::Array(_));
                is_nested.then(|| format!("one of `{}`", names.join("`, `")))
            }
            Self::TableOf(_) | Self::TablesOf(_) | Self::Rule(_) => None,
        }
    }
}

/// 2^53, up to which floats are whole numbers without a gap.
const MOST_EXACT: f64 = 9_007_199_254_740_992.0;

/// The number, if it is one.
fn number(value: &Value) -> Option<f64> {
    value.as_float().or_else(|| value.as_integer().map(|whole| whole as f64))
}

/// All keys below `keys`, the keys of the table `name`, by their dotted names; those of the tables in a list have `[]`
/// after its name. `name` is empty for the scenario itself.
#[must_use]
pub fn all(keys: &'static [Key], name: &str) -> Vec<(String, &'static Key)> {
    let mut found = Vec::new();
    for key in keys {
        let name = dotted::join(name, key.name);
        let inner = match key.accepts {
            Accepts::TableOf(inner) => all(inner, &name),
            Accepts::TablesOf(inner) => all(inner, &format!("{name}[]")),
            _ => Vec::new(),
        };
        found.push((name, key));
        found.extend(inner);
    }
    found
}

/// Declares a table of a scenario file: a struct, and the description of each of its fields as a key.
///
/// A key is its meaning, name, type, default and [`Accepts`], and, if it depends on another key, [`Only`]:
///
/// ```
/// use serde::{Deserialize, Serialize};
/// use skysink_common::keys::{Accepts::Whole, Keys, POSITIVE};
///
/// skysink_common::keys! {
///     /// `[power_pack]`.
///     #[derive(Debug, Serialize, Deserialize)]
///     pub struct PowerPack {
///         /// Energy of a full battery [Wh].
///         capacity_wh: f64 = 90.0, POSITIVE;
///         /// Number of cells in series.
///         cells: Option<u32>, Whole(1, 12);
///     }
/// }
///
/// assert_eq!((PowerPack::KEYS[0].name, PowerPack::KEYS[0].default), ("capacity_wh", Some("90.0")));
/// ```
///
/// The default is TOML. A key without one is required if its type is not an [`Option`]. A table that is always present
/// has the default `{}`. Fields that are not keys follow in a block `also { }`.
#[macro_export]
macro_rules! keys {
    ($(#[$attribute:meta])* pub struct $table:ident {
        $($(#[doc = $words:literal])+ $name:ident: $type:ty $(= $default:expr)?, $accepts:expr $(, $only:expr)?;)*
        $(also { $($others:tt)* })?
    }) => {
        $(#[$attribute])*
        pub struct $table {
            $($(#[doc = $words])+ pub $name: $type,)*
            $($($others)*)?
        }

        impl $crate::keys::Keys for $table {
            const KEYS: &'static [$crate::keys::Key] = &[$(
                $crate::keys::Key::new(stringify!($name), concat!($($words),+), $accepts)
                    $(.or(stringify!($default)))?
                    $(.only($only))?
            ),*];
        }
    };
}
