//! `[sensors.energy]`: the keys of the batteries of sensor nodes (SNs).

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use strum::VariantNames;

use crate::keys::{Accepts, NOT_NEGATIVE, PATH};

/// When an SN listens for a UAV.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum WakeMode {
    /// In each slot.
    Always,
    /// In slots that end with a UAV in range.
    Scheduled,
    /// Never: a radio of its own wakes it when it is served.
    Radio,
}

/// Capacities whose nanojoules are whole numbers of 64 bits.
pub(super) const CAPACITY_J: Accepts =
    Accepts::Number("joules above 0, at most 1e9", |capacity_j| capacity_j > 0.0 && capacity_j <= 1e9);

crate::keys! {
    /// `[sensors.energy]`: the batteries of the SNs (decision D33).
    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, expecting = "a table")]
    pub struct NodeEnergyKeys {
        /// Energy of a full battery [J]; required without a column of the sensor list, which has priority.
        capacity_j: Option<f64>, CAPACITY_J;
        /// Energy before slot 1, as a fraction of the capacity.
        initial: f64 = 1.0,
            Accepts::Number("a fraction above 0, at most 1", |fraction| fraction > 0.0 && fraction <= 1.0);
        /// Harvested power [W]. A column of the sensor list has priority.
        harvest_w: f64 = 0.0, NOT_NEGATIVE;
        /// CSV file of the harvested power, `slot,sensor,harvest_w`: the power of an SN from a slot on until its next
        /// row [W]; before the first that of the list or `harvest_w`. An empty sensor is all SNs without rows of their
        /// own.
        harvest_file: Option<PathBuf>, PATH;
        /// Power that an SN always takes [W].
        sleep_w: f64 = 0.0, NOT_NEGATIVE;
        /// Energy of a sampled bit [J].
        sample_j_per_bit: f64 = 0.0, NOT_NEGATIVE;
        /// When an SN takes `listen_w`; if not given, waiting takes nothing.
        wake: Option<WakeMode>, Accepts::OneOf(WakeMode::VARIANTS);
        /// Power of listening [W]; required with `wake = "always"` or `"scheduled"`, and only there.
        listen_w: Option<f64>, NOT_NEGATIVE;
        /// Energy of each slot of service [J]; required with `wake = "radio"`.
        wake_j: Option<f64>, NOT_NEGATIVE;
        /// Power of sending [W].
        tx_w: f64 = 0.0, NOT_NEGATIVE;
    }
}
