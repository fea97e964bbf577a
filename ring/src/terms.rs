//! The parameters of a run that are common to its processes, in `ring.toml`.

use std::fs;
use std::path::Path;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use skysink_common::estimate::Rates;
use skysink_common::pace::Pace;

use crate::wait::Waiting;

/// The parameters of a run that are common to its processes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Terms {
    /// Id of the run; every sample carries it.
    #[serde(with = "hexadecimal")]
    pub mission: u64,
    /// Pace of the run.
    pub pace: Pace,
    /// How its processes wait for samples.
    pub wait: Waiting,
    /// How long the launcher waits for a sample [s].
    pub timeout_s: f64,
    /// Whether the ring has a viewer.
    pub viewer: bool,
    /// What the UAV knows of the sampling rates, if the run has the topic `belief`, for an external planner.
    pub belief: Option<Rates>,
    /// The topics that the scenario asks for, besides those of every run.
    #[serde(default)] // of an earlier protocol, which the link refuses
    pub topics: Vec<String>,
    /// What the hosts compare, if a link carries the samples to processes of other hosts.
    pub link: Option<LinkTerms>,
}

/// What the hosts of a ring must agree on, because a link does not carry the attributes of services.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkTerms {
    /// Version of the messages and their semantics.
    pub version: u32,
    /// Hash of the scenario and its sensor list.
    #[serde(with = "hexadecimal")]
    pub scenario: u64,
}

impl Default for Terms {
    /// In lock-step, without a viewer; the time-out is an hour.
    fn default() -> Self {
        Self {
            mission: 0,
            pace: Pace::Max,
            wait: Waiting::default(),
            timeout_s: 3600.0,
            viewer: false,
            belief: None,
            topics: Vec::new(),
            link: None,
        }
    }
}

impl Terms {
    /// Whether the run has the topic `belief`.
    pub fn has_belief(&self) -> bool {
        self.belief.is_some()
    }

    /// Whether the run has the topic `rates`.
    pub fn has_learnt_rates(&self) -> bool {
        self.belief == Some(Rates::Learnt)
    }

    /// Reads `ring.toml`; the error says what is wrong.
    pub(crate) fn read(file: &Path) -> Result<Self, String> {
        let expected = "expected the folder of a ring, as skysink run prints it, or a copy of the ring.toml in it";
        let text = fs::read_to_string(file).map_err(|error| format!("{error}: {expected}"))?;
        let terms: Self = toml::from_str(&text).map_err(|error| error.message().to_owned())?;
        if Duration::try_from_secs_f64(terms.timeout_s).is_err() {
            return Err(format!("timeout_s = {}: expected seconds, 0 or above", terms.timeout_s));
        }
        Ok(terms)
    }

    /// How long the launcher waits for a sample before it ends the run.
    pub fn timeout(&self) -> Duration {
        Duration::from_secs_f64(self.timeout_s)
    }

    /// After this time without a heartbeat, a process is killed and restarted.
    pub fn silence_limit(&self) -> Duration {
        self.timeout() / 2
    }

    /// How long a writer waits for a reader that does not take its samples.
    pub fn full_limit(&self) -> Duration {
        self.timeout() * 2 / 3
    }

    /// After this time without the sample that the others wait for, its sender is killed and restarted.
    pub fn overdue_limit(&self) -> Duration {
        self.timeout() * 3 / 4
    }
}

/// Serializes `u64` as hexadecimal text, because integers of TOML end at 2^63.
mod hexadecimal {
    use serde::{Deserialize, Deserializer, Serializer};

    pub fn serialize<S: Serializer>(value: &u64, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(&format_args!("{value:016x}"))
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u64, D::Error> {
        u64::from_str_radix(&String::deserialize(deserializer)?, 16).map_err(serde::de::Error::custom)
    }
}
