//! Free space: the rate depends on the distance alone, and each sensor node has its own gain.

use std::f64::consts::LOG2_E;

use rand::RngExt;

use super::{Draw, Slopes, Uplink};
use crate::random::{Purpose, Streams};
use crate::scenario::{GainMode, Scenario};
use crate::units::ratio_of_db;

/// The parameters of a free-space uplink.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FreeSpace {
    /// Bandwidth of a resource block, `W` [Hz].
    pub bandwidth_hz: f64,
    /// Transmission power of a sensor node, `p` [W].
    pub tx_power_w: f64,
    /// Noise power, `σ²` [W].
    pub noise_w: f64,
    /// Time for communication in a slot, `τ_c` [s].
    pub comm_s: f64,
    /// Range [dB] of a reference gain that is redrawn in every slot; `None` if each sensor node keeps its gain.
    pub redrawn_db: Option<[f64; 2]>,
}

impl FreeSpace {
    /// The free-space channel of a scenario.
    #[must_use]
    pub fn of(scenario: &Scenario) -> Self {
        Self {
            bandwidth_hz: scenario.link.bandwidth_hz,
            tx_power_w: scenario.link.tx_power_w,
            noise_w: scenario.link.noise_w(),
            comm_s: scenario.link.comm_s,
            redrawn_db: (scenario.link.gain == Some(GainMode::PerSlot)).then_some(scenario.link.gain_range_db()),
        }
    }

    /// Signal-to-noise ratio at 1 m, `γ = α p / σ²`, of a reference gain `α` (linear).
    #[must_use]
    pub fn reference_snr(&self, gain: f64) -> f64 {
        gain * self.tx_power_w / self.noise_w
    }

    /// Shannon rate [bit/s] of one uplink (UTS eq. 4).
    ///
    /// `r = W log2(1 + α p / (σ² (H² + d²)))`. Finite at distance 0 because `H > 0`.
    #[must_use]
    pub fn rate_bps(&self, uplink: &Uplink) -> f64 {
        let snr = self.reference_snr(uplink.gain) / (uplink.z_m * uplink.z_m + uplink.d2_m2);
        self.bandwidth_hz * (1.0 + snr).log2()
    }

    /// The slopes of [`Self::rate_bps`]: `−W log2(e) γ / (x (x + γ))` with `x = H² + d²`, and 0 for the elevation.
    #[must_use]
    pub fn slopes(&self, uplink: &Uplink) -> Slopes {
        let snr = self.reference_snr(uplink.gain);
        let x_m2 = uplink.z_m * uplink.z_m + uplink.d2_m2;
        Slopes { by_distance2: -(self.bandwidth_hz * LOG2_E * snr / (x_m2 * (x_m2 + snr))), by_elevation: 0.0 }
    }

    /// The rate in `slot`, with the gain of the sensor node or the one drawn for the slot.
    #[must_use]
    pub fn draw(&self, uplink: &Uplink, streams: &Streams, slot: u64, sensor: u32) -> Draw {
        let gain =
            self.redrawn_db.map_or(uplink.gain, |range_db| ratio_of_db(draw_gain_db(range_db, streams, slot, sensor)));
        Draw { line_of_sight: true, rate_bps: self.rate_bps(&Uplink { gain, ..*uplink }) }
    }
}

/// Reference gain [dB] of `sensor`, uniform between two levels [dB]; `slot` is 0 for a gain of the whole mission.
#[must_use]
pub fn draw_gain_db([lowest_db, highest_db]: [f64; 2], streams: &Streams, slot: u64, sensor: u32) -> f64 {
    let fraction: f64 = streams.stream(Purpose::Gain, slot, sensor).random();
    lowest_db + (highest_db - lowest_db) * fraction
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The channel of the paper.
    fn paper_channel() -> FreeSpace {
        FreeSpace { bandwidth_hz: 5e6, tx_power_w: 0.05, noise_w: 1e-13, comm_s: 0.1, redrawn_db: None }
    }

    /// α = 10^−5.2, H = 20 m.
    fn uplink(d2_m2: f64) -> Uplink {
        Uplink { gain: 10f64.powf(-5.2), d2_m2, z_m: 20.0 }
    }

    #[test]
    fn the_rate_follows_the_closed_form() {
        // γ = α · 0.05 / 10^−13 = 3.1548e6; d = 10 m: x = 20² + 10² = 500
        // r = 5e6 · log2(1 + 3.1548e6/500) = 5e6 · log2(6310.6) = 5e6 · 12.6236
        let rate_bps = paper_channel().rate_bps(&uplink(100.0));
        assert!((rate_bps / 5e6 - 12.6236).abs() < 1e-4, "{rate_bps}");
    }

    #[test]
    fn the_slope_is_the_derivative_of_the_rate() {
        for d2_m2 in [0.5, 100.0, 2_500.0] {
            let rate_bps = |step_m2: f64| paper_channel().rate_bps(&uplink(d2_m2 + step_m2));
            let slope = (rate_bps(1e-3) - rate_bps(-1e-3)) / 2e-3;
            assert!((paper_channel().slopes(&uplink(d2_m2)).by_distance2 / slope - 1.0).abs() < 1e-4, "{slope}");
        }
    }

    #[test]
    fn a_link_carries_whole_bits_rounded_down() {
        let channel = super::super::Channel::FreeSpace(paper_channel());
        assert_eq!(channel.capacity_bits(99.99), 9);
        assert_eq!(channel.capacity_bits(0.0), 0);
    }
}
