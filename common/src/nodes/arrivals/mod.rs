//! The registry of the arrival models, and the keys of `[sensors.arrivals]` (decision D24).
//!
//! Arrivals are the bits that the sensor nodes (SNs) sample. Without the table they are constant. Any other model is
//! a file of this folder, a variant of [`Arrivals`] and of [`ArrivalModel`], and its keys. The field is filled by
//! [`Arrivals`], what is drawn; a planner knows the [`ArrivalLaw`] alone.

mod constant;
mod law;
mod on_off;
mod poisson;
mod trace;

use std::ops::Range;
use std::path::PathBuf;

use enum_dispatch::enum_dispatch;
use serde::{Deserialize, Serialize};
use strum::VariantNames;

pub use constant::*;
pub use law::ArrivalLaw;
pub use on_off::OnOff;
pub use poisson::Poisson;
pub use trace::{Arrival, ArrivalTrace};

use crate::keys::{Accepts, Only, PATH, POSITIVE};
use crate::per_sensor::PerSensor;
use crate::random::Streams;

/// The realised arrivals of a mission.
#[enum_dispatch(DrawnArrivals)]
#[derive(Debug, Clone, PartialEq)]
pub enum Arrivals {
    /// Poisson numbers of packets.
    Poisson(Poisson),
    /// SNs that are at random on or off.
    OnOff(OnOff),
    /// Bits of a file, by slot and SN.
    Trace(ArrivalTrace),
}

/// The properties of realised arrivals.
#[enum_dispatch]
pub trait DrawnArrivals {
    /// Bits that SN `sensor` with the mean `mean_bits` [bit per slot] samples in `slot`, from 1.
    fn bits(&self, slot: u64, sensor: u32, mean_bits: f64) -> u64;

    /// Writes the bits that the consecutive `sensors` sample in `slot` into `bits`. Blocks of all slots begin alike.
    fn fill(&self, slot: u64, sensors: Range<usize>, mean_bits: &PerSensor<f64>, bits: &mut [u64]) {
        for (bits, sensor) in bits.iter_mut().zip(sensors) {
            *bits = self.bits(slot, sensor as u32, mean_bits.of(sensor)); // a scenario has at most 10^7 SNs
        }
    }
}

/// Arrival model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum ArrivalModel {
    /// The same bits in every slot, without drift (decision D2).
    Constant,
    /// A Poisson number of packets in every slot.
    Poisson,
    /// A Markov chain for each SN that is on or off.
    OnOff,
    /// The rows of a file.
    Trace,
}

/// The condition of the keys of one model.
const fn only(values: &'static [&'static str], expected: &'static str) -> Only {
    Only { key: "model", values, expected: Some(expected) }
}

crate::keys! {
    /// `[sensors.arrivals]`: how the bits arrive that are sampled at the mean `sampling_bps`.
    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, expecting = "a table")]
    pub struct ArrivalKeys {
        /// Arrival model; without the table `"constant"`.
        model: ArrivalModel = "constant", Accepts::OneOf(ArrivalModel::VARIANTS);
        /// Bits that arrive together, `L` [bit]: an SN samples `L` times a Poisson number of mean `s τ / L` in a slot.
        packet_bits: Option<u32> = 1, Accepts::Whole(1, u32::MAX as u64),
            only(&["poisson"], "it only with model = \"poisson\"");
        /// Mean time that an SN is on [s], at least `slot_s`; on, it samples at `s (on_s + off_s)/on_s`.
        on_s: Option<f64> = 10.0, POSITIVE, only(&["on-off"], "it only with model = \"on-off\"");
        /// Mean time that an SN is off [s], at least `slot_s`.
        off_s: Option<f64> = 40.0, POSITIVE, only(&["on-off"], "it only with model = \"on-off\"");
        /// CSV file with the columns `slot,sensor,bits`, a row for each slot (from 1) in which an SN (from 0) samples.
        file: Option<PathBuf>, PATH, only(&["trace"], "it only with model = \"trace\"");
        /// What the planner is told of a trace: the variance of the bits in a slot, divided by their mean [bit].
        dispersion_bits: Option<f64> = 1.0, POSITIVE, only(&["trace"], "it only with model = \"trace\"");
    }
}

impl Arrivals {
    /// The arrivals of `count` SNs by `law` in the first `slots` slots, drawn from `streams`, or those of a `trace`;
    /// `None` if they are constant.
    #[must_use]
    pub fn of(
        law: ArrivalLaw,
        trace: Option<&ArrivalTrace>,
        streams: Streams,
        count: usize,
        slots: u64,
    ) -> Option<Self> {
        if let Some(trace) = trace {
            return Some(trace.clone().into());
        }
        match law {
            ArrivalLaw::Constant => None,
            ArrivalLaw::Packets { packet_bits } => Some(Poisson::new(packet_bits, streams).into()),
            ArrivalLaw::OnOff { on_slots, off_slots } => {
                Some(OnOff::new([on_slots, off_slots], streams, count, 1..slots + 1).into())
            }
        }
    }
}

#[cfg(test)]
mod tests;
