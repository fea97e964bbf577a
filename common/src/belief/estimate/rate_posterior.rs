//! What contacts reveal of a sampling rate if arrivals are at random: a Gamma distribution (decision D24).

use serde::{Deserialize, Serialize};
use statrs::function::erf::erfc;

/// A Gamma distribution of the bits per slot: `mean = shape/rate`, `variance = shape/rate²`.
///
/// With Poisson packets of `L` bits it is the posterior: a gap of `n` slots with `x` bits adds `x/L` to the shape, and
/// `n/L` to the rate. With on-off arrivals `L` is their dispersion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RatePosterior {
    shape: f64,
    /// [slots/bit]
    rate: f64,
}

/// Bits found after a gap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Gained {
    /// Exactly these [bit].
    Exactly(f64),
    /// At least these [bit]: the buffer was full.
    AtLeast(f64),
}

/// Most terms of an exact sum.
const MOST_TERMS: f64 = 1_000.0;

/// Least probability above a limit for which the sum up to it is subtracted from the whole.
const LEAST_ABOVE: f64 = 1e-6;

/// Least and greatest shape of a posterior that is stored.
const SHAPES: [f64; 2] = [1e-6, 1e18];

impl RatePosterior {
    /// The distribution before any contact: with the mean [bit per slot] and the variance of a rate that is uniform
    /// within `half_fraction` of it. `None` if that is one rate, which is known.
    pub(super) fn prior(mean_bits: f64, half_fraction: f64) -> Option<Self> {
        let shape = 3.0 / (half_fraction * half_fraction);
        (half_fraction > 0.0 && mean_bits > 0.0).then(|| Self { shape, rate: shape / mean_bits })
    }

    /// Mean [bit per slot].
    pub fn mean_bits(&self) -> f64 {
        self.shape / self.rate
    }

    /// Standard deviation [bit per slot].
    pub fn sd_bits(&self) -> f64 {
        self.shape.sqrt() / self.rate
    }

    /// Whether it is one.
    pub(super) fn is_possible(&self) -> bool {
        (SHAPES[0]..=SHAPES[1]).contains(&self.shape) && self.rate > 0.0 && self.rate.is_finite()
    }

    /// Adds a gap of `slots` slots, for arrivals with this dispersion [bit].
    ///
    /// The bits of a gap that ended with a full buffer are unknown above a limit. The posterior is then a mixture over
    /// them, of which mean and variance are kept.
    pub(super) fn add(&mut self, slots: u64, gained: Gained, dispersion_bits: f64) {
        let rate = self.rate + slots as f64 / dispersion_bits;
        match gained {
            Gained::Exactly(bits) => *self = Self { shape: self.shape + bits / dispersion_bits, rate },
            Gained::AtLeast(least_bits) => {
                let exposure = slots as f64 / (dispersion_bits * self.rate);
                let [packets, variance] = self.packets_above(exposure, (least_bits / dispersion_bits).ceil());
                let mean = (self.shape + packets) / rate;
                let spread = mean / rate + variance / (rate * rate);
                *self = Self { shape: mean * mean / spread, rate: mean / spread };
            }
        }
    }

    /// Mean and variance of the packets of a gap, of which at least `least` arrive, a whole number. Their law is
    /// negative binomial, with the mean `shape · exposure`; taken as normal for very many packets, or very few above
    /// the limit.
    fn packets_above(&self, exposure: f64, least: f64) -> [f64; 2] {
        let mean = self.shape * exposure;
        let variance = mean * (1.0 + exposure);
        let mut probability = (-self.shape * exposure.ln_1p()).exp();
        if least <= MOST_TERMS && probability > f64::MIN_POSITIVE {
            let failure = exposure / (1.0 + exposure);
            let [mut above, mut first, mut second] = [1.0, mean, variance + mean * mean];
            for packets in (0..least as u32).map(f64::from) {
                above -= probability;
                first -= packets * probability;
                second -= packets * packets * probability;
                probability *= (self.shape + packets) / (packets + 1.0) * failure;
            }
            if above > LEAST_ABOVE {
                let mean = first / above;
                return [mean, (second / above - mean * mean).max(0.0)];
            }
        }
        let deviation = variance.sqrt();
        let score = (least - 0.5 - mean) / deviation;
        let hazard = inverse_mills(score);
        [mean + deviation * hazard, (variance * (1.0 + score * hazard - hazard * hazard)).max(0.0)]
    }
}

/// `φ(z)/Q(z)`: the mean of a standard normal number above `z`.
fn inverse_mills(z: f64) -> f64 {
    if z > 20.0 {
        return z + 1.0 / z; // the next term is below 1e-3 of the last
    }
    let density = (-0.5 * z * z).exp() / (2.0 * std::f64::consts::PI).sqrt();
    density / (0.5 * erfc(z / std::f64::consts::SQRT_2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arrivals::{DrawnArrivals, Poisson};
    use crate::random::Streams;

    #[test]
    fn the_prior_has_the_variance_of_a_uniform_rate() {
        // Uniform on 50 to 150: variance 100²/12.
        let prior = RatePosterior::prior(100.0, 0.5).unwrap();
        assert!((prior.mean_bits() - 100.0).abs() < 1e-9);
        assert!((prior.sd_bits() - 100.0 / 12f64.sqrt()).abs() < 1e-9);
        assert_eq!(RatePosterior::prior(100.0, 0.0), None);
    }

    #[test]
    fn a_gap_moves_the_mean_towards_its_observed_rate() {
        // Shape 12, rate 0.12. 10 slots with 2 000 bit in packets of 50: shape 12 + 40, rate 0.12 + 0.2.
        let mut posterior = RatePosterior::prior(100.0, 0.5).unwrap();
        posterior.add(10, Gained::Exactly(2_000.0), 50.0);
        assert!((posterior.mean_bits() - 52.0 / 0.32).abs() < 1e-9);
        assert!((posterior.sd_bits() - 52f64.sqrt() / 0.32).abs() < 1e-9);
    }

    #[test]
    fn packet_tails_are_summed_or_approximated_as_normal() {
        // Shape 2, exposure 1: P(0) = 1/4, P(1) = 1/4, mean 2, variance 4. Above: (2 − 1/4)/(1/2) = 3.5;
        // (8 − 1/4)/(1/2) − 3.5² = 3.25.
        let posterior = RatePosterior { shape: 2.0, rate: 1.0 };
        let [mean, variance] = posterior.packets_above(1.0, 2.0);
        assert!((mean - 3.5).abs() < 1e-12 && (variance - 3.25).abs() < 1e-12, "{mean}, {variance}");
        // 600 packets with a deviation of sqrt(600 · 1.6) = 31: nearly normal.
        let [mean, variance] = RatePosterior { shape: 1e3, rate: 1.0 }.packets_above(0.6, 620.0);
        let hazard = inverse_mills((619.5 - 600.0) / 960f64.sqrt());
        assert!((mean - 600.0 - 960f64.sqrt() * hazard).abs() < 0.5, "{mean}");
        assert!(variance > 0.0 && variance < 960.0, "{variance}");
    }

    #[test]
    fn the_truncated_mean_follows_the_normal_distribution() {
        assert!((inverse_mills(0.0) - (2.0 / std::f64::consts::PI).sqrt()).abs() < 1e-12);
        assert!((inverse_mills(2.0) - 2.373_215_5).abs() < 1e-6);
        assert!((inverse_mills(20.0) - inverse_mills(20.000_001)).abs() < 1e-3);
    }

    /// 1 000 SNs whose rates are uniform on 50 to 150 bit per slot, learnt over 30 gaps of up to 20 slots; a gap with
    /// more than `full_bits` ends with a full buffer. Returns how many rates lie within the middle 90 % of their
    /// posterior.
    fn covered(packet_bits: f64, full_bits: u64) -> usize {
        let arrivals = Poisson::new(packet_bits, Streams::new(11));
        let is_covered = |sensor: u32| {
            let truth_bits = 50.0 + f64::from(sensor) / 10.0;
            let mut posterior = RatePosterior::prior(100.0, 0.5).unwrap();
            let mut slot = 0;
            for gap in 0..30 {
                let slots = 1 + (gap * 7 + u64::from(sensor)) % 20;
                let bits: u64 = (slot + 1..=slot + slots).map(|slot| arrivals.bits(slot, sensor, truth_bits)).sum();
                let gained = if bits < full_bits {
                    Gained::Exactly(bits as f64)
                } else {
                    Gained::AtLeast(full_bits as f64 - packet_bits / 2.0)
                };
                posterior.add(slots, gained, packet_bits);
                slot += slots;
            }
            (truth_bits - posterior.mean_bits()).abs() < 1.645 * posterior.sd_bits()
        };
        (0..1_000).filter(|&sensor| is_covered(sensor)).count()
    }

    #[test]
    fn credible_intervals_cover_the_truth_at_their_level() {
        // 900 ± 2.1 standard deviations of sqrt(1000 · 0.9 · 0.1) = 9.5
        for (packet_bits, full_bits) in [(1.0, u64::MAX), (100.0, u64::MAX), (100.0, 1_000), (300.0, 1_200)] {
            let covered = covered(packet_bits, full_bits);
            assert!((880..=920).contains(&covered), "{covered} of 1000 with packets of {packet_bits} bit");
        }
    }
}
