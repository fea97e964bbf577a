//! Values that are checked as they are read, and the reader that says which key of which file it refuses, and why.

use std::path::Path;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_path_to_error::Segment;
use toml::{Table, Value};

use super::error::ScenarioError;

/// A number that is checked as it is read.
pub trait Checked: Copy + Into<f64> {
    /// What is accepted.
    const EXPECTED: &'static str;

    /// The number, if it is accepted.
    fn of(value: f64) -> Option<Self>;
}

/// Declares checked numbers: a name, what is expected, and whether a value is that, written so that NaN fails.
macro_rules! checked_numbers {
    ($($(#[$doc:meta])* $name:ident: $expected:literal, |$value:ident| $holds:expr;)*) => {$(
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
        #[serde(try_from = "f64")]
        pub struct $name(pub(super) f64);

        impl Checked for $name {
            const EXPECTED: &'static str = $expected;

            fn of($value: f64) -> Option<Self> {
                if $holds { Some(Self($value)) } else { None }
            }
        }

        impl TryFrom<f64> for $name {
            type Error = &'static str;

            fn try_from(value: f64) -> Result<Self, Self::Error> {
                Self::of(value).ok_or(concat!("expected ", $expected))
            }
        }

        impl $name {
            /// The number.
            #[must_use]
            pub const fn get(self) -> f64 {
                self.0
            }
        }

        impl From<$name> for f64 {
            fn from(number: $name) -> f64 {
                number.0
            }
        }
    )*};
}

checked_numbers! {
    /// A finite number.
    Finite: "a finite number", |value| value.is_finite();
    /// A finite number above 0.
    Positive: "a finite number above 0", |value| value > 0.0 && value.is_finite();
    /// A finite number, 0 or above.
    NonNegative: "a finite number, 0 or above", |value| value >= 0.0 && value.is_finite();
    /// A mean number of bits, at most the largest storage.
    MeanBits: "0 to 4294967295 bits", |value| (0.0..=4_294_967_295.0).contains(&value);
    /// A gain [dB].
    GainDb: "a level from -300 to 0 dB", |value| (-300.0..=0.0).contains(&value);
    /// An SNR gap [dB].
    GapDb: "0 to 100 dB", |value| (0.0..=100.0).contains(&value);
    /// A noise power [dBm].
    NoiseDbm: "a finite level below 0 dBm (and not below -300)", |value| (-300.0..0.0).contains(&value);
    /// A path loss exponent.
    Exponent: "an exponent from 1 to 10", |value| (1.0..=10.0).contains(&value);
    /// A geodetic latitude [°].
    LatitudeDeg: "a latitude, -90 to 90", |value| value.abs() <= 90.0;
    /// A longitude [°].
    LongitudeDeg: "a longitude, -180 to 180", |value| value.abs() <= 180.0;
}

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

/// One number for all sensor nodes, or the lowest and the highest of the range that each draws its own from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Written", untagged, bound(deserialize = "T: Checked"))]
pub enum OneOrRange<T> {
    /// The same for all.
    One(T),
    /// Drawn uniformly; levels uniformly in dB.
    Range([T; 2]),
}

/// The same before its check.
#[derive(Deserialize)]
#[serde(untagged, expecting = "expected a number or [lowest, highest]")]
enum Written {
    One(f64),
    Range([f64; 2]),
}

impl<T: Checked> TryFrom<Written> for OneOrRange<T> {
    type Error = String;

    fn try_from(written: Written) -> Result<Self, String> {
        match written {
            Written::One(value) => T::of(value).map(Self::One).ok_or_else(|| format!("expected {}", T::EXPECTED)),
            Written::Range([lowest, highest]) => match (T::of(lowest), T::of(highest)) {
                (Some(low), Some(high)) if lowest <= highest => Ok(Self::Range([low, high])),
                _ => Err(format!("expected {}, the lower first", T::EXPECTED)),
            },
        }
    }
}

impl<T: Checked> OneOrRange<T> {
    /// The lowest value and the highest.
    #[must_use]
    pub fn ends(self) -> [f64; 2] {
        match self {
            Self::One(value) => [value.into(); 2],
            Self::Range(ends) => ends.map(Into::into),
        }
    }
}

/// The name of a mission, which becomes the name of a folder.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String")]
pub struct Name(pub(super) String);

/// Names become folders; file systems end at 255 bytes.
const MAX_NAME_BYTES: usize = 100;

impl TryFrom<String> for Name {
    type Error = &'static str;

    fn try_from(name: String) -> Result<Self, Self::Error> {
        let allowed = |byte: u8| byte.is_ascii_alphanumeric() || b"._-".contains(&byte);
        let holds = (1..=MAX_NAME_BYTES).contains(&name.len())
            && name.bytes().all(allowed)
            && !name.bytes().all(|byte| byte == b'.');
        if holds { Ok(Self(name)) } else { Err("expected 1 to 100 of A-Z a-z 0-9 . _ - (it becomes a folder)") }
    }
}

/// Reads `table`, whose dotted name in the file `path` is `name` (empty: the file itself), as a `T`.
pub(super) fn read<T: DeserializeOwned>(table: Table, name: &str, path: &Path) -> Result<T, ScenarioError> {
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
                Segment::Seq { index } => found = found.and_then(|outer| outer.get(*index)),
                Segment::Enum { .. } | Segment::Unknown => {}
            }
        }
        let message = error.inner().message();
        match (found.filter(|_| !key.is_empty()), message.rsplit_once("expected ")) {
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
                place: if key.is_empty() { key } else { key + ": " },
                message: message.replace('\n', " "),
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
    let key = if key.contains(char::is_control) { format!("{key:?}") } else { key.to_owned() };
    ScenarioError::Value { path: path.to_owned(), key, value, expected: expected.replace('\n', " ") }
}
