//! Probabilistic line of sight: an air-to-ground channel that is at random in or out of line of sight.
//!
//! The probability depends on the elevation angle of the UAV as seen from the sensor node (UTS section IV). The planner
//! knows the probability, but not the draw.

use std::f64::consts::LOG2_E;

use rand::RngExt;

use super::{Draw, Slopes, Uplink};
use crate::geometry::elevation_deg;
use crate::random::{Purpose, Streams};
use crate::scenario::{LosCurve, Scenario};
use crate::units::ratio_of_db;

/// The parameters of a probabilistic line-of-sight uplink.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineOfSight {
    /// Bandwidth of a resource block, `W` [Hz].
    pub bandwidth_hz: f64,
    /// Time for communication in a slot, `τ_c` [s].
    pub comm_s: f64,
    /// Probability of line of sight over the elevation angle.
    pub curve: LosCurve,
    /// Signal-to-noise ratio at 1 m in line of sight, `γ = p β0/(σ² Γ)`.
    pub los_snr: f64,
    /// The same out of line of sight, `μ γ`.
    pub nlos_snr: f64,
    /// Path loss exponent in line of sight, `α_L`.
    pub los_exponent: f64,
    /// Path loss exponent out of line of sight, `α_N`.
    pub nlos_exponent: f64,
}

impl LineOfSight {
    /// The channel of a scenario; `None` in free space.
    #[must_use]
    pub fn of(scenario: &Scenario) -> Option<Self> {
        let link = &scenario.link;
        let snr_gap = ratio_of_db(link.snr_gap_db?);
        let los_snr = link.tx_power_w * ratio_of_db(link.reference_gain_db?) / (link.noise_w() * snr_gap);
        Some(Self {
            bandwidth_hz: link.bandwidth_hz,
            comm_s: link.comm_s,
            curve: link.los_curve()?,
            los_snr,
            nlos_snr: ratio_of_db(link.nlos_extra_db?) * los_snr,
            los_exponent: link.los_exponent?,
            nlos_exponent: link.nlos_exponent?,
        })
    }

    /// Probability of line of sight, `P_L`.
    #[must_use]
    pub fn los_probability(&self, d2_m2: f64, z_m: f64) -> f64 {
        self.curve.probability(elevation_deg(d2_m2, z_m))
    }

    /// Rate [bit/s] in line of sight, `R_L = W log2(1 + γ D^−α_L)`, `D² = d² + z²`.
    #[must_use]
    pub fn los_rate_bps(&self, d2_m2: f64, z_m: f64) -> f64 {
        self.rate_bps(self.los_snr, self.los_exponent, d2_m2 + z_m * z_m)
    }

    /// Rate [bit/s] out of line of sight, `R_N = W log2(1 + μ γ D^−α_N)`.
    #[must_use]
    pub fn nlos_rate_bps(&self, d2_m2: f64, z_m: f64) -> f64 {
        self.rate_bps(self.nlos_snr, self.nlos_exponent, d2_m2 + z_m * z_m)
    }

    /// Expected rate [bit/s], `P_L R_L + (1 − P_L) R_N`; not the rate of the expected gain, which is higher.
    #[must_use]
    pub fn expected_rate_bps(&self, d2_m2: f64, z_m: f64) -> f64 {
        let probability = self.los_probability(d2_m2, z_m);
        probability * self.los_rate_bps(d2_m2, z_m) + (1.0 - probability) * self.nlos_rate_bps(d2_m2, z_m)
    }

    /// The slopes of [`Self::expected_rate_bps`].
    ///
    /// `∂E/∂D² = P_L R_L' + (1 − P_L) R_N'` with `R' = −W log2(e) (α/2) γ / (D² (D^α + γ))`, and
    /// `∂E/∂θ = P_L' (R_L − R_N)`.
    #[must_use]
    pub fn slopes(&self, d2_m2: f64, z_m: f64) -> Slopes {
        let probability = self.los_probability(d2_m2, z_m);
        let distance2_m2 = d2_m2 + z_m * z_m;
        let decrease = |snr: f64, exponent: f64| {
            let kappa = exponent / 2.0;
            self.bandwidth_hz * LOG2_E * kappa * snr / (distance2_m2 * (distance2_m2.powf(kappa) + snr))
        };
        let los_decrease = decrease(self.los_snr, self.los_exponent);
        let nlos_decrease = decrease(self.nlos_snr, self.nlos_exponent);
        let curve_slope = self.curve.slope(elevation_deg(d2_m2, z_m));
        Slopes {
            by_distance2: -(probability * los_decrease + (1.0 - probability) * nlos_decrease),
            by_elevation: curve_slope * (self.los_rate_bps(d2_m2, z_m) - self.nlos_rate_bps(d2_m2, z_m)),
        }
    }

    /// Whether the link of `sensor` is in line of sight in `slot`, and its rate.
    #[must_use]
    pub fn draw(&self, uplink: &Uplink, streams: &Streams, slot: u64, sensor: u32) -> Draw {
        let Uplink { d2_m2, z_m, .. } = *uplink;
        let drawn: f64 = streams.stream(Purpose::LineOfSight, slot, sensor).random();
        if drawn < self.los_probability(d2_m2, z_m) {
            Draw { line_of_sight: true, rate_bps: self.los_rate_bps(d2_m2, z_m) }
        } else {
            Draw { line_of_sight: false, rate_bps: self.nlos_rate_bps(d2_m2, z_m) }
        }
    }

    fn rate_bps(&self, snr_at_1m: f64, exponent: f64, distance2_m2: f64) -> f64 {
        self.bandwidth_hz * (1.0 + snr_at_1m * distance2_m2.powf(-exponent / 2.0)).log2()
    }
}

impl LosCurve {
    /// Probability of line of sight at the elevation angle `theta_deg` [deg], 0 to 1.
    #[must_use]
    pub fn probability(&self, theta_deg: f64) -> f64 {
        match *self {
            Self::Sigmoid { a, b } => 1.0 / (1.0 + a * (-b * (theta_deg - a)).exp()),
            Self::Logistic { b1, b2, b3, b4 } => (b3 + b4 / (1.0 + (-(b1 + b2 * theta_deg)).exp())).clamp(0.0, 1.0),
        }
    }

    /// Slope of the probability at the elevation angle `theta_deg` [deg], `P_L'` [1/°].
    #[must_use]
    pub fn slope(&self, theta_deg: f64) -> f64 {
        let probability = self.probability(theta_deg);
        match *self {
            Self::Sigmoid { b, .. } => b * probability * (1.0 - probability),
            // Flat where it is clamped to 0. P_L = b3 + b4 σ and b3 + b4 = 1, so 1 − P_L = b4 (1 − σ).
            Self::Logistic { b2, b3, b4, .. } if probability > 0.0 => {
                b2 * (probability - b3) / b4 * (1.0 - probability)
            }
            Self::Logistic { .. } => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_probability_follows_the_closed_form() {
        // Urban at 45°: 1/(1 + 9.61 exp(−0.16 · 35.39)) = 1/(1 + 9.61 · 0.0034742) = 0.967692
        let urban = LosCurve::Sigmoid { a: 9.61, b: 0.16 };
        assert!((urban.probability(45.0) - 0.967_692).abs() < 1e-5, "{}", urban.probability(45.0));
        // The fitted logistic at 90°: −0.63 + 1.63/(1 + exp(0.4568 − 4.23)) = −0.63 + 1.63 · 0.977539 = 0.963388
        let logistic = LosCurve::Logistic { b1: -0.4568, b2: 0.047, b3: -0.63, b4: 1.63 };
        assert!((logistic.probability(90.0) - 0.963_388).abs() < 1e-5, "{}", logistic.probability(90.0));
        assert_eq!(logistic.probability(0.0), (-0.63f64 + 1.63 / (1.0 + 0.4568f64.exp())).max(0.0));
    }

    #[test]
    fn the_expected_rate_lies_between_the_two() {
        let link = LineOfSight {
            bandwidth_hz: 1e6,
            comm_s: 0.1,
            curve: LosCurve::Sigmoid { a: 12.08, b: 0.11 },
            los_snr: 1e5,
            nlos_snr: 1e3,
            los_exponent: 2.5,
            nlos_exponent: 3.5,
        };
        let los = link.los_rate_bps(900.0, 40.0);
        let nlos = link.nlos_rate_bps(900.0, 40.0);
        let expected = link.expected_rate_bps(900.0, 40.0);
        assert!(nlos < expected && expected < los);
        // D = 50 m: γ D^−2.5 = 1e5/17677.67 = 5.656854; log2(6.656854) = 2.734841
        assert!((los / 1e6 - 2.734_841).abs() < 1e-5, "{los}");
        assert_eq!(elevation_deg(0.0, 40.0), 90.0);
    }
}
