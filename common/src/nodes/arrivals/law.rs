//! What a planner knows of the arrivals: their law, but no draw (decision D24).

use super::{ArrivalKeys, ArrivalModel};

/// The law of the bits that a sensor node (SN) samples, for a given mean.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ArrivalLaw {
    /// The same bits in every slot.
    Constant,
    /// A Poisson number of packets in every slot. A trace is planned for with its dispersion as the packet.
    Packets {
        /// Bits of a packet, above 0.
        packet_bits: f64,
    },
    /// On or off, for geometric times.
    OnOff {
        /// Mean time on [slots], at least 1.
        on_slots: f64,
        /// Mean time off [slots], at least 1.
        off_slots: f64,
    },
}

impl ArrivalLaw {
    /// The law of a checked scenario, in slots of `slot_s` [s]; constant without `keys`.
    #[must_use]
    pub fn of(keys: Option<&ArrivalKeys>, slot_s: f64) -> Self {
        let Some(&ArrivalKeys { model, packet_bits, on_s, off_s, dispersion_bits, .. }) = keys else {
            return Self::Constant;
        };
        let slots = |time_s: Option<f64>| time_s.map_or(1.0, |time_s| (time_s / slot_s).max(1.0));
        match model {
            ArrivalModel::Constant => Self::Constant,
            ArrivalModel::Poisson => Self::Packets { packet_bits: packet_bits.unwrap_or(1).into() },
            ArrivalModel::OnOff => Self::OnOff { on_slots: slots(on_s), off_slots: slots(off_s) },
            ArrivalModel::Trace => Self::Packets { packet_bits: dispersion_bits.unwrap_or(1.0) },
        }
    }

    /// Whether the bits of a slot are at random.
    pub fn is_random(&self) -> bool {
        *self != Self::Constant
    }

    /// Variance [bit²] of the bits sampled in `slots` consecutive slots at `mean_bits` [bit] per slot.
    ///
    /// For on-off with correlation `ρ = 1 − 1/on − 1/off` from slot to slot it is `r² π(1−π) [n(1+ρ)/(1−ρ) −
    /// 2ρ(1−ρⁿ)/(1−ρ)²]`, where `r` is the rate while on and `π` the fraction of time on.
    pub fn variance_bits2(&self, mean_bits: f64, slots: f64) -> f64 {
        match *self {
            Self::Constant => 0.0,
            Self::Packets { packet_bits } => packet_bits * mean_bits * slots,
            Self::OnOff { on_slots, off_slots } => {
                let left = 1.0 / on_slots + 1.0 / off_slots; // 1 − ρ
                let kept = 1.0 - left;
                let linear = slots * (1.0 + kept) / left;
                let edge = 2.0 * kept * (1.0 - kept.powf(slots)) / (left * left);
                let edge = if kept < 0.0 { 0.0 } else { edge }; // alternating: below the linear term by at most a slot
                mean_bits * mean_bits * off_slots / on_slots * (linear - edge)
            }
        }
    }

    /// Variance of the bits of many slots divided by their mean [bit], at `mean_bits` [bit] per slot.
    pub fn dispersion_bits(&self, mean_bits: f64) -> f64 {
        match *self {
            Self::Constant => 0.0,
            Self::Packets { packet_bits } => packet_bits,
            Self::OnOff { on_slots, off_slots } => {
                let left = 1.0 / on_slots + 1.0 / off_slots;
                mean_bits * off_slots / on_slots * (2.0 - left) / left
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn on_off_variance_matches_the_markov_chain() {
        // on 2, off 2: π = 1/2, r = 2 · 10, ρ = 0: independent slots of variance 400/4 = 100.
        let law = ArrivalLaw::OnOff { on_slots: 2.0, off_slots: 2.0 };
        assert_eq!([1.0, 3.0].map(|slots| law.variance_bits2(10.0, slots)), [100.0, 300.0]);
        assert_eq!(law.dispersion_bits(10.0), 10.0);
        // on 4, off 4: ρ = 1/2; two slots: 2 · 100 · (1 + 1/2).
        let law = ArrivalLaw::OnOff { on_slots: 4.0, off_slots: 4.0 };
        assert!((law.variance_bits2(10.0, 1.0) - 100.0).abs() < 1e-9);
        assert!((law.variance_bits2(10.0, 2.0) - 300.0).abs() < 1e-9);
        assert_eq!(law.dispersion_bits(10.0), 30.0); // 100 · (1 + ρ)/(1 − ρ) per 10
    }

    #[test]
    fn packet_variance_depends_on_packet_size() {
        let law = ArrivalLaw::Packets { packet_bits: 50.0 };
        assert_eq!((law.variance_bits2(100.0, 3.0), law.dispersion_bits(100.0)), (15_000.0, 50.0));
        assert_eq!(ArrivalLaw::Constant.variance_bits2(100.0, 3.0), 0.0);
        assert!(law.is_random() && !ArrivalLaw::Constant.is_random());
    }
}
