//! The signal-to-noise ratios (SNRs) that a UAV hears of sensor nodes near it (decision D32).

use nalgebra::Point3;

use super::model::Uplink;
use super::{Channel, DrawnChannel};
use crate::geometry::Position;
use crate::keys::Only;

/// Keys of the models whose links have an SNR that may be heard.
pub(crate) const ONLY: Only = Only {
    key: "model",
    values: &["map", "probabilistic-los", "buildings"],
    expected: Some("it only with model = \"map\", \"probabilistic-los\" or \"buildings\""),
};

impl DrawnChannel {
    /// The SNR [dB] of the `uplink` of the sensor node `id` at the position `sensor` to the UAV at `uav`, in `slot`;
    /// with a line of sight after the gap of the modem. Minus infinity without a link, or an SNR.
    pub fn snr_db(&self, uplink: &Uplink, sensor: &Position, uav: &Point3<f64>, slot: u64, id: u32) -> f64 {
        match self.law() {
            Channel::Map(model) => model.snr_db(uplink, self.map_residual(model, sensor, uav, slot, id)),
            Channel::LineOfSight(model) => {
                let rate_bps = self.draw(uplink, sensor, uav, slot, id).rate_bps;
                10.0 * (rate_bps / model.bandwidth_hz * std::f64::consts::LN_2).exp_m1().log10()
            }
            _ => f64::NEG_INFINITY,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Streams;
    use crate::scenario::{Overrides, Scenario};
    use std::path::Path;

    #[test]
    fn an_snr_is_that_of_the_drawn_rate() {
        let sensor = Position::origin();
        let uav = Point3::new(40.0, 0.0, 30.0);
        let text = "name = 'x'\n[link]\nmodel = 'probabilistic-los'\nlos_correlation_m = 20.0\n";
        let scenario = Scenario::parse(text, Path::new("x.toml"), Overrides::default()).unwrap();
        let drawn = DrawnChannel::new(Channel::of(&scenario.link), Streams::new(4));
        let uplink = drawn.law().uplink(1.0, &sensor, &uav);
        let model = drawn.law().line_of_sight().unwrap();
        let distance2_db = 10.0 * (uplink.d2_m2 + uplink.z_m * uplink.z_m).log10();
        let states = [(model.los_snr, model.los_exponent), (model.nlos_snr, model.nlos_exponent)];
        let snrs_db = states.map(|(at_1m, exponent)| 10.0 * at_1m.log10() - 0.5 * exponent * distance2_db);
        let is_seen = drawn.draw(&uplink, &sensor, &uav, 3, 0).line_of_sight;
        let snr_db = drawn.snr_db(&uplink, &sensor, &uav, 3, 0);
        assert!((snr_db - snrs_db[usize::from(!is_seen)]).abs() < 1e-9, "{snr_db} of {snrs_db:?}");
    }
}
