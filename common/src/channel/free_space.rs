//! Free space: the rate depends on the distance alone, and each sensor node has its own gain.

use std::f64::consts::LOG2_E;

use rand::RngExt;
use serde::{Deserialize, Serialize};
use strum::VariantNames;

use super::fading::Fading;
use super::model::{ChannelModel, Draw, Slopes, Uplink};
use crate::interpolation::interpolate;
use crate::keys::Only;
use crate::random::{Purpose, Streams};
use crate::units::ratio_of_db;

/// Keys of the model `free-space`.
pub(crate) const ONLY: Only = Only {
    key: "model",
    values: &["free-space"],
    expected: Some("it only with model = \"free-space\"; with \"probabilistic-los\" it is reference_gain_db for all"),
};

/// Whether the reference gain changes during the mission.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum GainMode {
    /// One gain per sensor node and mission.
    Static,
    /// Redrawn from `gain_db` in every slot; the planner knows only that of the sensor list.
    PerSlot,
}

/// Steps of the range of gains [dB] in a mean over draws, without and with fading.
const GAIN_STEPS: [u32; 2] = [1 << 14, 1 << 7];

/// Steps of fading that are one where gains are redrawn, too.
const COARSE: usize = 8;

/// The parameters of a free-space uplink.
#[derive(Debug, Clone, PartialEq)]
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
    /// Fading of the power.
    pub fading: Option<Fading>,
}

impl FreeSpace {
    /// Signal-to-noise ratio at 1 m, `γ = α p / σ²`, of a reference gain `α` (linear).
    pub fn reference_snr(&self, gain: f64) -> f64 {
        gain * self.tx_power_w / self.noise_w
    }

    /// Shannon rate [bit/s] of one uplink (UTS eq. 4).
    ///
    /// `r = W log2(1 + α p / (σ² (H² + d²)))`. Finite at distance 0 because `H > 0`.
    pub fn rate_bps(&self, uplink: &Uplink) -> f64 {
        let snr = self.reference_snr(uplink.gain) / (uplink.z_m * uplink.z_m + uplink.d2_m2);
        self.bandwidth_hz * (1.0 + snr).log2()
    }

    /// The rate with a gain of `gain_db` [dB] instead, times `power_gain`.
    fn rate_at_gain_bps(&self, uplink: &Uplink, gain_db: f64, power_gain: f64) -> f64 {
        self.rate_bps(&Uplink { gain: ratio_of_db(gain_db) * power_gain, ..*uplink })
    }

    /// The uplink with another power.
    fn faded(uplink: &Uplink, power_gain: f64) -> Uplink {
        Uplink { gain: uplink.gain * power_gain, ..*uplink }
    }
}

impl ChannelModel for FreeSpace {
    /// The rate, or its mean over the fading.
    #[inline]
    fn expected_rate_bps(&self, uplink: &Uplink) -> f64 {
        let Some(fading) = &self.fading else { return self.rate_bps(uplink) };
        let snr = self.reference_snr(uplink.gain) / (uplink.z_m * uplink.z_m + uplink.d2_m2);
        self.bandwidth_hz * fading.mean(snr)
    }

    /// `−W log2(e) γ / (x (x + γ))` with `x = H² + d²`, and 0 for the elevation; with fading `−W/x` times the slope of
    /// the mean by `ln(γ/x)`.
    #[inline]
    fn slopes(&self, uplink: &Uplink) -> Slopes {
        let snr = self.reference_snr(uplink.gain);
        let x_m2 = uplink.z_m * uplink.z_m + uplink.d2_m2;
        if let Some(fading) = &self.fading {
            let by_distance2 = -(self.bandwidth_hz * fading.slope(snr / x_m2) / x_m2);
            return Slopes { by_distance2, by_elevation: 0.0 };
        }
        Slopes { by_distance2: -(self.bandwidth_hz * LOG2_E * snr / (x_m2 * (x_m2 + snr))), by_elevation: 0.0 }
    }

    fn is_random(&self) -> bool {
        self.redrawn_db.is_some() || self.fading.is_some()
    }

    /// The rate with the gain of the sensor node or the one drawn for the slot, times the fading drawn for the slot.
    fn draw(&self, uplink: &Uplink, streams: &Streams, slot: u64, sensor: u32) -> Draw {
        let drawn_gain = |range_db| ratio_of_db(draw_gain_db(range_db, streams, slot, sensor));
        let mut gain = self.redrawn_db.map_or(uplink.gain, drawn_gain);
        if let Some(fading) = &self.fading {
            gain *= fading.draw(streams, slot, sensor);
        }
        Draw { line_of_sight: true, rate_bps: self.rate_bps(&Uplink { gain, ..*uplink }) }
    }

    fn best_rate_bps(&self, uplink: &Uplink) -> f64 {
        let power_gain = self.fading.as_ref().map_or(1.0, Fading::highest);
        let redrawn_bps = self.redrawn_db.map(|[_, highest_db]| self.rate_at_gain_bps(uplink, highest_db, power_gain));
        redrawn_bps.unwrap_or_else(|| self.rate_bps(&Self::faded(uplink, power_gain)))
    }

    fn best_drawn_rate_bps(&self, uplink: &Uplink, streams: &Streams, slot: u64, sensor: u32) -> f64 {
        self.draw(uplink, streams, slot, sensor).rate_bps
    }

    /// The mean over gains that are uniform in dB, and over fading: the value at the upper end of each of many steps.
    fn mean_over_draws(&self, uplink: &Uplink, value: &dyn Fn(f64) -> f64) -> f64 {
        let Some([lowest_db, highest_db]) = self.redrawn_db else {
            let Some(fading) = &self.fading else { return value(self.rate_bps(uplink)) };
            return fading.mean_of(1, |power_gain| value(self.rate_bps(&Self::faded(uplink, power_gain))));
        };
        let steps = GAIN_STEPS[usize::from(self.fading.is_some())];
        let step_db = (highest_db - lowest_db) / f64::from(steps);
        let at = |step: u32| {
            let gain_db = lowest_db + step_db * f64::from(step);
            let faded = |power_gain: f64| value(self.rate_at_gain_bps(uplink, gain_db, power_gain));
            self.fading.as_ref().map_or_else(|| faded(1.0), |fading| fading.mean_of(COARSE, faded))
        };
        (1..=steps).map(at).sum::<f64>() / f64::from(steps)
    }

    fn fading(&self) -> Option<&Fading> {
        self.fading.as_ref()
    }

    fn drawn_gains(&self) -> Option<[f64; 2]> {
        self.redrawn_db.map(|range_db| range_db.map(ratio_of_db))
    }
}

/// Reference gain [dB] of `sensor`, uniform between two levels [dB]; `slot` is 0 for a gain of the whole mission.
#[must_use]
pub fn draw_gain_db([lowest_db, highest_db]: [f64; 2], streams: &Streams, slot: u64, sensor: u32) -> f64 {
    let fraction: f64 = streams.stream(Purpose::Gain, slot, sensor).random();
    interpolate(lowest_db, highest_db, fraction)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::channel::Channel;

    /// The channel of the paper.
    fn paper_channel() -> FreeSpace {
        FreeSpace { bandwidth_hz: 5e6, tx_power_w: 0.05, noise_w: 1e-13, comm_s: 0.1, redrawn_db: None, fading: None }
    }

    /// α = 10^−5.2, H = 20 m.
    fn uplink(d2_m2: f64) -> Uplink {
        Uplink::at(10f64.powf(-5.2), d2_m2, 20.0)
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
    fn only_a_gain_that_is_redrawn_makes_the_channel_random() {
        let is_random = |redrawn_db| FreeSpace { redrawn_db, ..paper_channel() }.is_random();
        assert_eq!([None, Some([-55.0, -50.0])].map(is_random), [false, true]);
    }

    #[test]
    fn the_mean_over_redrawn_gains_lies_between_those_of_the_ends() {
        // With a gain that is uniform in dB, 10 log10(α) is uniform: its mean is the middle, up to half a step.
        let channel = FreeSpace { redrawn_db: Some([-60.0, -50.0]), ..paper_channel() };
        let gain_db = |rate_bps: f64| {
            let snr = (rate_bps / 5e6).exp2() - 1.0;
            10.0 * (snr * 500.0 * 1e-13 / 0.05).log10()
        };
        let mean_db = channel.mean_over_draws(&uplink(100.0), &gain_db);
        assert!((mean_db + 55.0).abs() < 1e-3 && mean_db > -55.0, "{mean_db}");
        assert_eq!(
            paper_channel().mean_over_draws(&uplink(100.0), &|bps| bps),
            paper_channel().rate_bps(&uplink(100.0))
        );
        assert_eq!(channel.best_rate_bps(&uplink(100.0)), channel.rate_at_gain_bps(&uplink(100.0), -50.0, 1.0));
    }

    #[test]
    fn fading_keeps_its_mean_its_slope_and_its_best_draw() {
        let fading = Some(Fading::rician(f64::NEG_INFINITY));
        let channel = FreeSpace { fading, ..paper_channel() };
        let expected_bps = channel.expected_rate_bps(&uplink(100.0));
        // γ = 6309.6 is high: 0.8327 bit/s/Hz less than without, and a little more.
        let lost = (channel.rate_bps(&uplink(100.0)) - expected_bps) / 5e6;
        assert!((lost - 0.8327).abs() < 3e-3, "{lost}");
        let step = |d2_m2: f64| channel.expected_rate_bps(&uplink(d2_m2));
        let slope = (step(100.01) - step(99.99)) / 0.02;
        assert!((channel.slopes(&uplink(100.0)).by_distance2 / slope - 1.0).abs() < 1e-5, "{slope}");
        let streams = Streams::new(5);
        let rates_bps: Vec<f64> =
            (0..40_000).map(|slot| channel.draw(&uplink(100.0), &streams, slot, 2).rate_bps).collect();
        let mean_bps = rates_bps.iter().sum::<f64>() / 40_000.0;
        assert!((mean_bps / expected_bps - 1.0).abs() < 4e-3, "{mean_bps}, not {expected_bps}"); // 5 standard errors
        let best_bps = channel.best_rate_bps(&uplink(100.0));
        assert!(rates_bps.iter().all(|&rate_bps| rate_bps <= best_bps));
        let over_bps = channel.mean_over_draws(&uplink(100.0), &|bps| bps);
        assert!(over_bps >= expected_bps && over_bps < expected_bps * 1.01, "{over_bps}");
        // Both the gain and its fading are redrawn.
        let both = FreeSpace { redrawn_db: Some([-55.0, -50.0]), ..channel };
        let mean_of = |value: &dyn Fn(&FreeSpace, u64) -> f64| (0..40_000).map(|slot| value(&both, slot)).sum::<f64>();
        let mean_bps = mean_of(&|both, slot| both.draw(&uplink(100.0), &streams, slot, 2).rate_bps) / 40_000.0;
        let over_bps = both.mean_over_draws(&uplink(100.0), &|bps| bps);
        assert!(over_bps > mean_bps * 0.996 && over_bps < mean_bps * 1.02, "{over_bps} and {mean_bps}");
    }

    #[test]
    fn a_link_carries_whole_bits_rounded_down() {
        assert_eq!(Channel::from(paper_channel()).capacity_bits(99.99), 9);
        assert_eq!(Channel::from(paper_channel()).capacity_bits(0.0), 0);
    }
}
