//! Line of sight: an air-to-ground channel that is in or out of it, with a rate for either.
//!
//! Either at random, with a probability by the elevation angle of the UAV as seen from the sensor node (UTS section
//! IV), of which the planner knows the probability, but not the draw; or by a map of buildings, which the planner
//! knows.

use std::f64::consts::LOG2_E;
use std::sync::Arc;

use rand::RngExt;
use serde::{Deserialize, Serialize};
use strum::VariantNames;

use super::buildings::Buildings;
use super::fading::Fading;
use super::model::{ChannelModel, Draw, Slopes, Uplink};
use crate::geometry::elevation_deg;
use crate::interpolation::interpolate;
use crate::keys::{Accepts, FINITE, Key, Only, POSITIVE};
use crate::random::{Purpose, Streams};

/// Keys of the model `probabilistic-los`.
pub(crate) const ONLY: Only =
    Only { key: "model", values: &["probabilistic-los"], expected: Some("it only with model = \"probabilistic-los\"") };

/// Keys of both models with a line of sight.
pub(crate) const EITHER: Only = Only {
    key: "model",
    values: &["probabilistic-los", "buildings"],
    expected: Some("it only with model = \"probabilistic-los\" or \"buildings\""),
};

/// Path loss exponents.
pub(crate) const EXPONENT: Accepts =
    Accepts::Number("an exponent from 1 to 10", |exponent| (1.0..=10.0).contains(&exponent));

/// SNR gaps.
pub(crate) const GAP_DB: Accepts = Accepts::Number("0 to 100 dB", |gap_db| (0.0..=100.0).contains(&gap_db));

/// `[link.los]`, in either form of [`LosCurve`].
pub(crate) const LOS: &[Key] = &[
    Key::new("a", "Parameter a; with b.", POSITIVE),
    Key::new("b", "Parameter b; with a.", POSITIVE),
    Key::new("b1", "Parameter b1; with b2, b3 and b4.", FINITE),
    Key::new("b2", "Parameter b2.", POSITIVE),
    Key::new("b3", "Parameter b3, 1 − b4.", FINITE),
    Key::new("b4", "Parameter b4.", POSITIVE),
];

/// `link.los`: probability of line of sight over the elevation angle `θ` [deg].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(
    untagged,
    deny_unknown_fields,
    expecting = "expected { a = , b = } or { b1 = , b2 = , b3 = , b4 = }, all of them numbers"
)]
pub enum LosCurve {
    /// `1/(1 + a e^{−b(θ−a)})`.
    Sigmoid {
        /// Parameter a.
        a: f64,
        /// Parameter b.
        b: f64,
    },
    /// `b3 + b4/(1 + e^{−(b1 + b2 θ)})`, `b3 + b4 = 1`, clamped to 0.
    Logistic {
        /// Parameter b1.
        b1: f64,
        /// Parameter b2.
        b2: f64,
        /// Parameter b3.
        b3: f64,
        /// Parameter b4.
        b4: f64,
    },
}

/// Surroundings with published parameters of the line-of-sight probability, from open to built up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Environment {
    /// (a, b) = (4.88, 0.43).
    Suburban,
    /// (a, b) = (9.61, 0.16).
    Urban,
    /// (a, b) = (12.08, 0.11).
    DenseUrban,
    /// (a, b) = (27.23, 0.08).
    HighRise,
}

impl Environment {
    /// Its probability of line of sight.
    #[must_use]
    pub fn curve(self) -> LosCurve {
        let [a, b] = match self {
            Self::Suburban => [4.88, 0.43],
            Self::Urban => [9.61, 0.16],
            Self::DenseUrban => [12.08, 0.11],
            Self::HighRise => [27.23, 0.08],
        };
        LosCurve::Sigmoid { a, b }
    }
}

/// What decides on line of sight.
#[derive(Debug, Clone, PartialEq)]
pub enum Sight {
    /// A draw, with a probability over the elevation angle.
    Curve(LosCurve),
    /// A map.
    Buildings(Arc<Buildings>),
}

/// The parameters of an uplink that is in or out of line of sight.
#[derive(Debug, Clone, PartialEq)]
pub struct LineOfSight {
    /// Bandwidth of a resource block, `W` [Hz].
    pub bandwidth_hz: f64,
    /// Time for communication in a slot, `τ_c` [s].
    pub comm_s: f64,
    /// What decides on line of sight.
    pub sight: Sight,
    /// Signal-to-noise ratio at 1 m in line of sight, `γ = p β0/(σ² Γ)`.
    pub los_snr: f64,
    /// Signal-to-noise ratio at 1 m out of line of sight, `μ γ`.
    pub nlos_snr: f64,
    /// Path loss exponent in line of sight, `α_L`.
    pub los_exponent: f64,
    /// Path loss exponent out of line of sight, `α_N`.
    pub nlos_exponent: f64,
    /// Correlation distance of a line of sight that stays for the mission [m]; `None` if it is redrawn in every slot.
    pub correlation_m: Option<f64>,
    /// Fading of the power, in either state.
    pub fading: Option<Fading>,
    /// Shadowing in and out of line of sight, instead of fading.
    pub shadowing: Option<[Fading; 2]>,
}

impl LineOfSight {
    /// The curve of the probability; `None` among buildings.
    pub fn curve(&self) -> Option<&LosCurve> {
        match &self.sight {
            Sight::Curve(curve) => Some(curve),
            Sight::Buildings(_) => None,
        }
    }

    /// The map of buildings; `None` if line of sight is drawn.
    pub fn buildings(&self) -> Option<&Buildings> {
        match &self.sight {
            Sight::Curve(_) => None,
            Sight::Buildings(buildings) => Some(buildings),
        }
    }

    /// Probability of line of sight, `P_L`; among buildings 0 or 1.
    pub fn los_probability(&self, uplink: &Uplink) -> f64 {
        match &self.sight {
            Sight::Curve(curve) => curve.probability(uplink.elevation_deg()),
            Sight::Buildings(_) => f64::from(u8::from(uplink.in_sight)),
        }
    }

    /// The fading in and out of line of sight.
    fn fadings(&self) -> [Option<&Fading>; 2] {
        self.shadowing.as_ref().map_or([self.fading.as_ref(); 2], |shadowing| shadowing.each_ref().map(Some))
    }

    /// Whether the position decides on line of sight, and not the draw of a slot.
    fn stays(&self) -> bool {
        self.correlation_m.is_some() || self.buildings().is_some()
    }

    /// Rate [bit/s] in line of sight, `R_L = W log2(1 + γ D^−α_L)`, `D² = d² + z²`; its mean over the fading.
    pub fn los_rate_bps(&self, d2_m2: f64, z_m: f64) -> f64 {
        self.rate_bps(0, self.los_snr, self.los_exponent, d2_m2 + z_m * z_m)
    }

    /// Rate [bit/s] out of line of sight, `R_N = W log2(1 + μ γ D^−α_N)`; its mean over the fading.
    pub fn nlos_rate_bps(&self, d2_m2: f64, z_m: f64) -> f64 {
        self.rate_bps(1, self.nlos_snr, self.nlos_exponent, d2_m2 + z_m * z_m)
    }

    fn rate_bps(&self, state: usize, snr_at_1m: f64, exponent: f64, distance2_m2: f64) -> f64 {
        let snr = snr_at_1m * distance2_m2.powf(-exponent / 2.0);
        match self.fadings()[state] {
            None => self.bandwidth_hz * (1.0 + snr).log2(),
            Some(fading) => self.bandwidth_hz * fading.mean(snr),
        }
    }

    /// The rate [bit/s] in a state, 0 for in line of sight and 1 for out of it, with `power_gain` times the power
    /// instead of the fading.
    fn faded_bps(&self, state: usize, power_gain: f64, &Uplink { d2_m2, z_m, .. }: &Uplink) -> f64 {
        let [snr_at_1m, exponent] = match state {
            0 => [self.los_snr, self.los_exponent],
            _ => [self.nlos_snr, self.nlos_exponent],
        };
        let snr = snr_at_1m * power_gain * (d2_m2 + z_m * z_m).powf(-exponent / 2.0);
        self.bandwidth_hz * (1.0 + snr).log2()
    }

    /// What `gain` makes of the fading in and out of line of sight; 1 without fading.
    fn power_gains(&self, gain: impl Fn(&Fading) -> f64) -> [f64; 2] {
        match (&self.fading, &self.shadowing) {
            (None, None) => [1.0; 2],
            (Some(fading), None) => [gain(fading); 2],
            (_, Some(shadowing)) => shadowing.each_ref().map(gain),
        }
    }

    /// The power gains of `sensor` in `slot`.
    fn drawn_gains_at(&self, streams: &Streams, slot: u64, sensor: u32) -> [f64; 2] {
        self.power_gains(|fading| fading.draw(streams, slot, sensor))
    }

    /// The higher rate [bit/s] of both states with these power gains.
    fn better_bps(&self, [los, nlos]: [f64; 2], uplink: &Uplink) -> f64 {
        self.faded_bps(0, los, uplink).max(self.faded_bps(1, nlos, uplink))
    }

    /// The link of `sensor` in `slot`: in line of sight if `level`, uniform from 0 to 1, is below the probability.
    pub(super) fn draw_at(&self, uplink: &Uplink, level: f64, streams: &Streams, slot: u64, sensor: u32) -> Draw {
        let line_of_sight = level < self.los_probability(uplink);
        let state = usize::from(!line_of_sight);
        let power_gain = self.drawn_gains_at(streams, slot, sensor)[state];
        Draw { line_of_sight, rate_bps: self.faded_bps(state, power_gain, uplink) }
    }

    /// Mean over the fading of `value` of the rate [bit/s] in and out of line of sight.
    fn means_by_state(&self, uplink: &Uplink, value: &dyn Fn(f64) -> f64) -> [f64; 2] {
        let fadings = self.fadings();
        std::array::from_fn(|state| match fadings[state] {
            None => value(self.faded_bps(state, 1.0, uplink)),
            Some(fading) => fading.mean_of(1, |gain| value(self.faded_bps(state, gain, uplink))),
        })
    }
}

impl ChannelModel for LineOfSight {
    /// `P_L R_L + (1 − P_L) R_N`; not the rate of the expected gain, which is higher.
    #[inline]
    fn expected_rate_bps(&self, uplink: &Uplink) -> f64 {
        let Uplink { d2_m2, z_m, in_sight, .. } = *uplink;
        if self.buildings().is_some() {
            return if in_sight { self.los_rate_bps(d2_m2, z_m) } else { self.nlos_rate_bps(d2_m2, z_m) };
        }
        let probability = self.los_probability(uplink);
        probability * self.los_rate_bps(d2_m2, z_m) + (1.0 - probability) * self.nlos_rate_bps(d2_m2, z_m)
    }

    /// `∂E/∂D² = P_L R_L' + (1 − P_L) R_N'` with `R' = −W log2(e) (α/2) γ / (D² (D^α + γ))`, and
    /// `∂E/∂θ = P_L' (R_L − R_N)`. With fading `R' = −W (α/2) / D²` times the slope of the mean by `ln(γ D^−α)`.
    #[inline]
    fn slopes(&self, uplink: &Uplink) -> Slopes {
        let Uplink { d2_m2, z_m, .. } = *uplink;
        let probability = self.los_probability(uplink);
        let distance2_m2 = d2_m2 + z_m * z_m;
        let decrease = |state: usize, snr: f64, exponent: f64| {
            let kappa = exponent / 2.0;
            if let Some(fading) = self.fadings()[state] {
                let slope = fading.slope(snr * distance2_m2.powf(-kappa));
                return self.bandwidth_hz * kappa * slope / distance2_m2;
            }
            self.bandwidth_hz * LOG2_E * kappa * snr / (distance2_m2 * (distance2_m2.powf(kappa) + snr))
        };
        let los_decrease = decrease(0, self.los_snr, self.los_exponent);
        let nlos_decrease = decrease(1, self.nlos_snr, self.nlos_exponent);
        let curve_slope = self.curve().map_or(0.0, |curve| curve.slope(elevation_deg(d2_m2, z_m)));
        Slopes {
            by_distance2: -(probability * los_decrease + (1.0 - probability) * nlos_decrease),
            by_elevation: curve_slope * (self.los_rate_bps(d2_m2, z_m) - self.nlos_rate_bps(d2_m2, z_m)),
        }
    }

    fn is_random(&self) -> bool {
        self.buildings().is_none() || self.fadings() != [None; 2]
    }

    /// Whether the link of `sensor` is in line of sight in `slot`, and its rate.
    fn draw(&self, uplink: &Uplink, streams: &Streams, slot: u64, sensor: u32) -> Draw {
        let level = match &self.sight {
            Sight::Curve(_) => streams.stream(Purpose::LineOfSight, slot, sensor).random(),
            Sight::Buildings(_) => 0.5, // whatever is between the probabilities 0 and 1
        };
        self.draw_at(uplink, level, streams, slot, sensor)
    }

    /// The rate in line of sight, unless its parameters make it the lower one.
    fn best_rate_bps(&self, uplink: &Uplink) -> f64 {
        self.better_bps(self.power_gains(Fading::highest), uplink)
    }

    /// The probability of line of sight is not higher where the angle is lower, so a link without it has none there.
    /// Where the position decides, it is assumed.
    fn best_drawn_rate_bps(&self, uplink: &Uplink, streams: &Streams, slot: u64, sensor: u32) -> f64 {
        let Draw { line_of_sight, rate_bps } = self.draw(uplink, streams, slot, sensor);
        let may_see = line_of_sight || self.stays();
        if may_see { self.better_bps(self.drawn_gains_at(streams, slot, sensor), uplink) } else { rate_bps }
    }

    fn mean_over_draws(&self, uplink: &Uplink, value: &dyn Fn(f64) -> f64) -> f64 {
        let probability = self.los_probability(uplink);
        let [seen, hidden] = self.means_by_state(uplink, value);
        // In this form the mean of two equal numbers is that number.
        interpolate(hidden, seen, probability)
    }

    /// If the rate in line of sight is the lower one, a link that is never in line of sight is best. Where line of
    /// sight stays, what was seen tells where to find it.
    fn best_mean_over_draws(&self, uplink: &Uplink, value: &dyn Fn(f64) -> f64) -> f64 {
        let [seen, hidden] = self.means_by_state(uplink, value);
        let probability = self.los_probability(uplink);
        let seen = if self.stays() { seen } else { interpolate(hidden, seen, probability) };
        seen.max(hidden)
    }

    fn fading(&self) -> Option<&Fading> {
        self.fading.as_ref()
    }

    fn depends_on_elevation(&self) -> bool {
        self.buildings().is_none()
    }

    fn has_own_gains(&self) -> bool {
        false
    }
}

impl LosCurve {
    /// Probability of line of sight at the elevation angle `theta_deg` [deg], 0 to 1.
    pub fn probability(&self, theta_deg: f64) -> f64 {
        match *self {
            Self::Sigmoid { a, b } => 1.0 / (1.0 + a * (-b * (theta_deg - a)).exp()),
            Self::Logistic { b1, b2, b3, b4 } => (b3 + b4 / (1.0 + (-(b1 + b2 * theta_deg)).exp())).clamp(0.0, 1.0),
        }
    }

    /// Slope of the probability at the elevation angle `theta_deg` [deg], `P_L'` [1/°].
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
    fn a_negative_logistic_curve_is_clamped_to_zero_with_zero_slope() {
        // At 0°: −0.63 + 1.63/(1 + exp(2)) = −0.43; at 90°: −0.63 + 1.63/(1 + exp(2 − 4.23)) = 0.84
        let curve = LosCurve::Logistic { b1: -2.0, b2: 0.047, b3: -0.63, b4: 1.63 };
        assert_eq!((curve.probability(0.0), curve.slope(0.0)), (0.0, 0.0));
        assert!((curve.probability(90.0) - 0.84).abs() < 1e-2 && curve.slope(90.0) > 0.0);
    }

    #[test]
    fn the_expected_rate_lies_between_los_and_nlos_rates() {
        let link = LineOfSight {
            bandwidth_hz: 1e6,
            comm_s: 0.1,
            sight: Sight::Curve(LosCurve::Sigmoid { a: 12.08, b: 0.11 }),
            los_snr: 1e5,
            nlos_snr: 1e3,
            los_exponent: 2.5,
            nlos_exponent: 3.5,
            correlation_m: None,
            fading: None,
            shadowing: None,
        };
        let los = link.los_rate_bps(900.0, 40.0);
        let nlos = link.nlos_rate_bps(900.0, 40.0);
        let expected = link.expected_rate_bps(&Uplink::at(1.0, 900.0, 40.0));
        assert!(nlos < expected && expected < los);
        // D = 50 m: γ D^−2.5 = 1e5/17677.67 = 5.656854; log2(6.656854) = 2.734841
        assert!((los / 1e6 - 2.734_841).abs() < 1e-5, "{los}");
        assert_eq!(elevation_deg(0.0, 40.0), 90.0);
        // With fading: less, the mean of what is drawn, with the slopes of the means.
        let faded = LineOfSight { fading: Some(Fading::rician(3.0)), ..link };
        let at = |d2_m2: f64| Uplink::at(1.0, d2_m2, 40.0);
        let mean_bps = faded.expected_rate_bps(&at(900.0));
        assert!(mean_bps < expected && faded.mean_over_draws(&at(900.0), &|bps| bps) >= mean_bps);
        let streams = Streams::new(9);
        let draws: Vec<f64> = (0..40_000).map(|slot| faded.draw(&at(900.0), &streams, slot, 1).rate_bps).collect();
        assert!((draws.iter().sum::<f64>() / 40_000.0 / mean_bps - 1.0).abs() < 0.02);
        assert!(draws.iter().all(|&bps| bps <= faded.best_rate_bps(&at(900.0))));
        for (slot, &bps) in (0..).zip(&draws[..500]) {
            assert!(bps <= faded.best_drawn_rate_bps(&at(900.0), &streams, slot, 1));
        }
        let Slopes { by_distance2, by_elevation } = faded.slopes(&at(900.0));
        let numeric = (faded.expected_rate_bps(&at(900.1)) - faded.expected_rate_bps(&at(899.9))) / 0.2;
        let angle = (elevation_deg(900.1, 40.0) - elevation_deg(899.9, 40.0)) / 0.2;
        assert!(((by_distance2 + by_elevation * angle) / numeric - 1.0).abs() < 1e-4, "{numeric}");
    }
}
