//! What noise, fading and a line of sight that stays do to the links.

use serde::Serialize;
use skysink_common::channel::{Channel, ChannelModel};
use skysink_common::message::SensorNode;
use skysink_common::scenario::Scenario;
use skysink_common::units::dbm_of_watts;

use super::links::LinkFigures;
use super::quantity::{percent, scaled, short};

/// Density of thermal noise at 290 K [dBm/Hz].
const THERMAL_DBM_PER_HZ: f64 = -174.0;

/// Noise of a fixed power that is farther above thermal noise than this [dB] was hardly meant for this bandwidth.
const HIGH_DB: f64 = 20.0;

/// The noise, and the models of the channel that are off by default.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RadioFigures {
    /// Noise power in the bandwidth of a link [dBm].
    pub noise_dbm: f64,
    /// The same relative to thermal noise, -174 dBm/Hz [dB].
    pub above_thermal_db: f64,
    /// Bandwidth of a link [Hz].
    pub bandwidth_hz: f64,
    /// Whether the noise power is the same for any bandwidth (`noise_dbm`).
    pub is_fixed: bool,
    /// Factor K of fading [dB]; `None` without fading, and for −∞ in JSON.
    pub k_db: Option<f64>,
    /// Mean rate of the weakest SN at the distance d_c relative to the one without fading; `None` without fading.
    pub faded: Option<f64>,
    /// Correlation distance of a line of sight that stays [m]; `None` if it is redrawn.
    pub los_correlation_m: Option<f64>,
}

impl RadioFigures {
    /// The figures of `scenario`, whose links at the distance d_c are `rim`.
    #[must_use]
    pub fn of(scenario: &Scenario, nodes: &[SensorNode], rim: &LinkFigures) -> Self {
        let link = &scenario.link;
        let channel = Channel::of(link);
        let noise_dbm = dbm_of_watts(link.noise_w());
        let mut steady = scenario.clone();
        steady.link.fading = None;
        let of_steady = |figures: LinkFigures| rim.rates_bps[0] / figures.rates_bps[0];
        Self {
            noise_dbm,
            above_thermal_db: noise_dbm - THERMAL_DBM_PER_HZ - 10.0 * link.bandwidth_hz.log10(),
            bandwidth_hz: link.bandwidth_hz,
            is_fixed: link.noise_dbm_per_hz.is_none(),
            k_db: channel.fading().and(link.k_db),
            faded: channel.fading().map(|_| of_steady(LinkFigures::at(&steady, nodes, link.comm_radius_m))),
            los_correlation_m: channel.line_of_sight().and_then(|model| model.correlation_m),
        }
    }

    /// Name and value of each figure that applies.
    #[must_use]
    pub fn rows(&self) -> Vec<(&'static str, String)> {
        let noise = format!(
            "{:.1} dBm, thermal + {:.1} dB in {}",
            self.noise_dbm,
            self.above_thermal_db,
            scaled(self.bandwidth_hz, "Hz")
        );
        let mut rows = vec![("noise", noise)];
        if self.is_fixed && self.above_thermal_db > HIGH_DB {
            rows.push(("", "fixed; noise_dbm_per_hz follows W".to_owned()));
        }
        if let (Some(k_db), Some(faded)) = (self.k_db, self.faded) {
            let law = if k_db.is_finite() { format!("K = {} dB", short(k_db)) } else { "Rayleigh".to_owned() };
            rows.push(("fading", format!("{law}: {} of the mean rate at d_c", percent(faded))));
        }
        if let Some(correlation_m) = self.los_correlation_m {
            rows.push(("line of sight", format!("stays, correlated over {}", scaled(correlation_m, "m"))));
        }
        rows
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use skysink_common::scenario::Overrides;
    use skysink_common::units::ratio_of_db;

    fn rows(link: &str) -> Vec<(&'static str, String)> {
        let text = format!("name = 'a'\n[link]\n{link}");
        let scenario = Scenario::parse(&text, Path::new("a.toml"), Overrides::default()).unwrap();
        let nodes = [SensorNode { gain: ratio_of_db(-55.0), ..SensorNode::default() }];
        RadioFigures::of(&scenario, &nodes, &LinkFigures::at(&scenario, &nodes, 10.0)).rows()
    }

    #[test]
    fn the_noise_is_compared_with_thermal_noise() {
        // −174 + 10 log10(5e3) = −137.01 dBm; −100 dBm is 37.01 dB above it.
        let fixed = rows("bandwidth_hz = 5e3\n");
        assert_eq!(fixed[0], ("noise", "-100.0 dBm, thermal + 37.0 dB in 5 kHz".to_owned()));
        assert!(fixed[1].1.contains("noise_dbm_per_hz"), "{fixed:?}");
        // −174 + 7 + 36.99 = −130.01 dBm
        let density = "-130.0 dBm, thermal + 7.0 dB in 5 kHz";
        assert_eq!(rows("bandwidth_hz = 5e3\nnoise_dbm_per_hz = -167.0\n"), [("noise", density.to_owned())]);
        assert_eq!(rows("")[0].1, "-100.0 dBm, thermal + 7.0 dB in 5 MHz");
    }

    #[test]
    fn fading_is_given_with_its_mean_rate_and_frozen_sight_with_its_distance() {
        // γ = 1.58e6/500 = 3162: log2 = 11.627; less 0.8327 bit of Rayleigh: 10.796, 92.9 %.
        let rayleigh = "Rayleigh: 92.9 % of the mean rate at d_c";
        assert_eq!(rows("fading = 'rician'\nk_db = -inf\n")[1], ("fading", rayleigh.to_owned()));
        // K = 10: E[ln g] = ln(10/11) + E1(10) = −0.0953, 0.1375 bit, 98.8 %.
        assert!(rows("fading = 'rician'\n")[1].1.starts_with("K = 10 dB: 98.8 %"));
        let frozen = rows("model = 'probabilistic-los'\nlos_correlation_m = 50.0\n");
        assert_eq!(frozen[1], ("line of sight", "stays, correlated over 50 m".to_owned()));
        assert_eq!(rows("model = 'probabilistic-los'\nlos_correlation_m = 0.0\n").len(), 1);
    }
}
