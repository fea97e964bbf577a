//! The free-space uplink from a sensor node to the UAV, for whoever plans with it or draws from it.

use crate::scenario::Scenario;

/// Mean channel of one uplink at a fixed altitude, one resource block wide.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Link {
    /// Bandwidth of a resource block, `W` [Hz].
    pub bandwidth_hz: f64,
    /// Transmission power of a sensor node, `p` [W].
    pub tx_power_w: f64,
    /// Noise power, `σ²` [W].
    pub noise_w: f64,
    /// Altitude of the UAV, `H` [m], above 0.
    pub altitude_m: f64,
    /// Time for communication in a slot, `τ_c` [s].
    pub comm_s: f64,
}

impl Link {
    /// The link of a scenario.
    #[must_use]
    pub fn of(scenario: &Scenario) -> Self {
        Self {
            bandwidth_hz: scenario.link.bandwidth_hz,
            tx_power_w: scenario.link.tx_power_w,
            noise_w: scenario.link.noise_w,
            altitude_m: scenario.uav.altitude_m,
            comm_s: scenario.link.comm_s,
        }
    }

    /// Signal-to-noise ratio at 1 m, `γ = α p / σ²`, of a reference gain `α` (linear).
    #[must_use]
    pub fn reference_snr(&self, gain: f64) -> f64 {
        gain * self.tx_power_w / self.noise_w
    }

    /// Shannon rate [bit/s] of one uplink at the squared horizontal distance `d2_m2` [m²] (UTS eq. 4).
    ///
    /// `r = W log2(1 + α p / (σ² (H² + d²)))`. Finite at distance 0 because `H > 0`, which the scenario guarantees.
    #[must_use]
    pub fn rate_bps(&self, gain: f64, d2_m2: f64) -> f64 {
        let snr = self.reference_snr(gain) / (self.altitude_m * self.altitude_m + d2_m2);
        self.bandwidth_hz * (1.0 + snr).log2()
    }

    /// Whole bits that a link of `rate_bps` [bit/s] carries in one slot: `floor(r τ_c)` (UTS eq. 7).
    #[must_use]
    pub fn capacity_bits(&self, rate_bps: f64) -> u64 {
        (rate_bps * self.comm_s).floor() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn letter() -> Link {
        Link { bandwidth_hz: 5e6, tx_power_w: 0.05, noise_w: 1e-13, altitude_m: 20.0, comm_s: 0.1 }
    }

    #[test]
    fn the_rate_follows_the_closed_form() {
        // α = 10^−5.2, γ = α · 0.05 / 10^−13 = 3.1548e6; d = 10 m: x = 20² + 10² = 500
        // r = 5e6 · log2(1 + 3.1548e6/500) = 5e6 · log2(6310.6) = 5e6 · 12.6236
        let rate_bps = letter().rate_bps(10f64.powf(-5.2), 100.0);
        assert!((rate_bps / 5e6 - 12.6236).abs() < 1e-4, "{rate_bps}");
    }

    #[test]
    fn a_link_carries_whole_bits_rounded_down() {
        assert_eq!(letter().capacity_bits(99.99), 9);
        assert_eq!(letter().capacity_bits(0.0), 0);
    }
}
