//! How fast the ring turns.

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Pace of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pace {
    /// Lock-step: each process waits for its input, nobody looks at a clock.
    Max,
    /// By the clock of field-sim, this many times as fast as real time; a plan that is late is void.
    Factor(f64),
}

/// Fastest clock: beyond it a slot's start cannot be timed.
const MAX_FACTOR: f64 = 1e6;

/// Why a pace is refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("pace {0}: expected max, realtime, or a factor above 0 such as 10x")]
pub struct PaceError(String);

impl Pace {
    /// Wall time between the starts of two slots of `slot_s` [s]; none in lock-step.
    #[must_use]
    pub fn period(self, slot_s: f64) -> Option<Duration> {
        match self {
            Self::Max => None,
            Self::Factor(factor) => Some(Duration::from_secs_f64(slot_s / factor)),
        }
    }
}

impl FromStr for Pace {
    type Err = PaceError;

    fn from_str(text: &str) -> Result<Self, PaceError> {
        let refuse = || PaceError(text.to_owned());
        match text {
            "max" => Ok(Self::Max),
            "realtime" => Ok(Self::Factor(1.0)),
            _ => {
                let factor: f64 = text.strip_suffix('x').and_then(|factor| factor.parse().ok()).ok_or_else(refuse)?;
                if factor > 0.0 && factor <= MAX_FACTOR { Ok(Self::Factor(factor)) } else { Err(refuse()) }
            }
        }
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
    }

    #[test]
    fn a_pace_that_is_no_pace_is_refused() {
        for text in ["", "fast", "10", "x", "0x", "-1x", "NaNx", "infx"] {
            assert!(text.parse::<Pace>().is_err(), "{text}");
        }
    }
}
