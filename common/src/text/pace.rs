//! The pace of a run: lock-step, or slots by the clock.

use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;
use std::time::Duration;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Pace of a run.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum Pace {
    /// Lock-step: each process waits for its input, and none reads a clock.
    #[default]
    Max,
    /// Slots by the clock of field-sim, at this multiple of real time; a late plan is void.
    Factor(f64),
}

/// Allowed factors.
const FACTORS: RangeInclusive<f64> = 1e-6..=1e6;

/// Longest time between two slots, longer than any run, and short enough to be added to an instant.
const LONGEST: Duration = Duration::from_secs(u32::MAX as u64);

impl Pace {
    /// Wall time between the starts of two slots of `slot_s` [s]; `None` in lock-step.
    #[must_use]
    pub fn period(self, slot_s: f64) -> Option<Duration> {
        match self {
            Self::Max => None,
            Self::Factor(factor) => {
                Some(Duration::try_from_secs_f64(slot_s / factor).map_or(LONGEST, |period| period.min(LONGEST)))
            }
        }
    }
}

impl FromStr for Pace {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let factor = match text {
            "max" => return Ok(Self::Max),
            "realtime" => Some(1.0),
            _ => text.strip_suffix('x').and_then(|factor| factor.parse().ok()),
        };
        let factor = factor.filter(|factor| FACTORS.contains(factor)).map(Self::Factor);
        factor.ok_or_else(|| format!("pace {text}: expected max, realtime, or a factor such as 10x, 1e-6x to 1e6x"))
    }
}

impl fmt::Display for Pace {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Max => formatter.write_str("max"),
            Self::Factor(1.0) => formatter.write_str("realtime"),
            Self::Factor(factor) => write!(formatter, "{factor}x"),
        }
    }
}

impl Serialize for Pace {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Pace {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pace_is_read_as_it_is_written() {
        for text in ["max", "realtime", "10x", "0.5x"] {
            assert_eq!(text.parse::<Pace>().unwrap().to_string(), text);
        }
        assert_eq!("10x".parse::<Pace>().unwrap().period(1.0), Some(Duration::from_millis(100)));
        assert_eq!("1e-6x".parse::<Pace>().unwrap().period(1e300), Some(LONGEST));
    }

    #[test]
    fn an_invalid_pace_is_refused() {
        for text in ["", "fast", "10", "x", "0x", "-1x", "NaNx", "infx", "1e-25x", "2e6x"] {
            assert!(text.parse::<Pace>().is_err(), "{text}");
        }
    }
}
