//! `[sensors]`: the sensor nodes (SNs), before their list is drawn or read, and what else the features of the SNs read
//! of a scenario.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use strum::VariantNames;

use crate::arrivals::{ArrivalKeys, ArrivalModel};
use crate::channel::LinkBudget;
use crate::keys::{Accepts, Interval, NOT_NEGATIVE, PATH, POSITIVE, WholeInterval};
use crate::slack::SLOTS_SLACK;

pub use super::energy::{NodeEnergyKeys, WakeMode};

/// Most sensor nodes of a field.
pub(crate) const MAX_SENSORS: u64 = 10_000_000;

/// Most bits that all sensor nodes together may sample in a mission: the totals of the ledger are `u64`.
pub(crate) const MAX_FIELD_BITS: f64 = 9.0e18;

/// Numbers of bits that fit into a queue.
const QUEUE_BITS: Accepts =
    Accepts::Interval("0 to 4294967295 bits", |queue_bits| (0.0..=4_294_967_295.0).contains(&queue_bits));

crate::keys! {
    /// `[sensors]`: the sensor nodes, before their list is drawn or read.
    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, expecting = "a table")]
    pub struct SensorKeys {
        /// Number of sensor nodes (SNs), or `file`. They are drawn uniformly over the area from the seed.
        count: Option<u32> = 200, Accepts::Whole(1, MAX_SENSORS);
        /// CSV file of the sensor list; instead of `count`.
        file: Option<PathBuf>, PATH;
        /// Buffer of each SN, `B` [bit]; overflow is lost. From an interval each SN draws its own, uniformly. A column
        /// of the sensor list has priority.
        capacity_bits: WholeInterval = 30000, Accepts::WholeInterval(1, u32::MAX as u64);
        /// Sampling rate, `s` [bit/s]; from an interval each SN draws its own, uniformly. A column of the sensor list
        /// has priority. At the highest rate an SN samples at most 9·10^15 bits in the mission, and all together at
        /// most 9·10^18.
        sampling_bps: Interval = 100.0, NOT_NEGATIVE.or_interval();
        /// Mean of the Poisson queue before slot 1, `λ` [bit]; from an interval each SN draws its own mean, uniformly.
        /// Draws are capped at the buffer. A column of the sensor list has priority.
        initial_queue_mean_bits: Interval = 10000.0, QUEUE_BITS;
        /// Height of the antennas above the ground [m], with `link.model = "buildings"`; below the UAV.
        height_m: Option<f64>, Accepts::Rule("0 or above, below the UAV, only with link.model = \"buildings\"");
        /// Longest time between two services of an SN [s], with `planner.objective` and for the metric `deadline_slots`
        /// (decision D36).
        deadline_s: Option<f64>, POSITIVE;
        /// Age above which stored bits are lost [s], at least a slot (decision D36).
        expiry_s: Option<f64>, POSITIVE;
        /// Which bits a full buffer drops, `"newest"` if not given.
        overflow: Option<Overflow>, Accepts::OneOf(Overflow::VARIANTS);
        /// The batteries of the SNs; without this table they need none.
        energy: Option<NodeEnergyKeys>, Accepts::TableOf(NodeEnergyKeys::KEYS);
        /// How the bits arrive; without this table the same in every slot.
        arrivals: Option<ArrivalKeys>, Accepts::TableOf(ArrivalKeys::KEYS);
    }
}

impl SensorKeys {
    /// Whether the arrivals are those of a file.
    pub fn has_trace(&self) -> bool {
        self.arrivals.as_ref().is_some_and(|arrivals| arrivals.model == ArrivalModel::Trace)
    }
}

/// Which bits a full buffer drops.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Overflow {
    /// Those that have just been sampled.
    #[default]
    Newest,
    /// The oldest.
    Oldest,
}

/// The keys of a mission that the features of its SNs read.
#[derive(Debug, Clone, Copy)]
pub struct NodeKeys<'a> {
    /// `[sensors]`.
    pub sensors: &'a SensorKeys,
    /// `[link]`.
    pub link: &'a LinkBudget,
    /// Length of a slot, `τ` [s].
    pub slot_s: f64,
    /// Slots of the mission, `T`.
    pub slots: u64,
    /// UAVs.
    pub uavs: usize,
}

impl NodeKeys<'_> {
    /// The whole slots in `time_s` [s], up to rounding.
    pub fn whole_slots(&self, time_s: f64) -> u64 {
        (time_s / self.slot_s + SLOTS_SLACK).floor() as u64 // saturates
    }
}
