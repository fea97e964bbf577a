//! What is heard of links (decision D32): the signal-to-noise ratios (SNRs) of sensor nodes near a UAV, and what a
//! planner learns from them that knows only a law of the links.
//!
//! A law misses each SNR by a residual, which the links of nearby places share: it is interpolated by simple kriging
//! made cheap.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, PoisonError, RwLock};

use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use super::map::key;
use super::model::Uplink;
use super::{Channel, DrawnChannel, LinkBudget};
use crate::checkpoint::CheckpointError;
use crate::geometry::Position;
use crate::keys::Only;

/// Keys of the models whose links have an SNR that may be heard.
pub(crate) const ONLY: Only = Only {
    key: "model",
    values: &["map", "probabilistic-los", "buildings"],
    expected: Some("it only with model = \"map\", \"probabilistic-los\" or \"buildings\""),
};

/// SNRs that are kept of each sensor node.
pub const HEARD_SNRS: usize = 64;

/// Most bytes of a sensor node in a checkpoint: its position, and four numbers of 4 bytes for each SNR.
pub const BYTES_PER_HEARD: usize = HEARD_SNRS * 16 + 32;

/// Correlation distance of what a law misses, where no residual stays [m].
const CORRELATION_M: f64 = 30.0;

/// What a law has missed of an SNR that was heard.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct HeardResidual {
    /// Where the UAV was [m].
    at_m: [f32; 3],
    /// In dB; of a line of sight in probability.
    residual: f32,
}

/// The last residuals by the bits of the positions of their sensor nodes.
type ResidualsByPlace = BTreeMap<[u64; 2], VecDeque<HeardResidual>>;

/// What a planner has heard of the links of a mission. Clones share it.
#[derive(Debug, Clone)]
pub struct HeardLinks {
    correlation_m: f64,
    residuals: Arc<RwLock<ResidualsByPlace>>,
}

/// The checkpoint of [`HeardLinks`].
#[derive(Debug, Serialize, Deserialize)]
pub struct SavedHeard(ResidualsByPlace);

impl HeardLinks {
    /// Before anything is heard over these links.
    #[must_use]
    pub fn of(link: &LinkBudget) -> Self {
        let lengths_m = [link.los_correlation_m, link.residual_m];
        let stays_m = lengths_m.into_iter().flatten().find(|length_m| *length_m > 0.0);
        Self { correlation_m: stays_m.unwrap_or(CORRELATION_M), residuals: Arc::default() }
    }

    /// Takes in that the UAV at `uav` has heard the SNR `snr_db` [dB] of the sensor node at `sensor`, over `uplink`, where
    /// `law` is the channel that the planner reckons with.
    pub fn hear(&self, law: &Channel, uplink: &Uplink, sensor: &Position, uav: &Point3<f64>, snr_db: f64) {
        let residual = law.residual(uplink, snr_db) as f32;
        let mut residuals = self.residuals.write().unwrap_or_else(PoisonError::into_inner);
        let last = residuals.entry(key(sensor)).or_default();
        if last.len() == HEARD_SNRS {
            last.pop_front();
        }
        last.push_back(HeardResidual { at_m: [uav.x as f32, uav.y as f32, uav.z as f32], residual });
    }

    /// What the law is expected to miss for the sensor node at `sensor` and the UAV at `uav` [m]:
    /// `Σ w_k e_k/(1 + Σ w_k)` with `w_k = e^{−d_k/l}` of the residuals `e_k` heard at the distances `d_k`; 0 where nothing
    /// was.
    pub fn residual(&self, sensor: &Position, uav: &Point3<f64>) -> f64 {
        let residuals = self.residuals.read().unwrap_or_else(PoisonError::into_inner);
        let (mut weights, mut weighted) = (0.0, 0.0);
        for heard in residuals.get(&key(sensor)).into_iter().flatten() {
            let distance_m = (uav - Point3::from(heard.at_m.map(f64::from))).norm();
            let weight = (-distance_m / self.correlation_m).exp();
            weights += weight;
            weighted += weight * f64::from(heard.residual);
        }
        weighted / (1.0 + weights)
    }

    /// The state of a checkpoint.
    pub fn saved(&self) -> SavedHeard {
        SavedHeard(self.residuals.read().unwrap_or_else(PoisonError::into_inner).clone())
    }

    /// Checks a state of a mission with these sensor nodes.
    ///
    /// # Errors
    /// If it is impossible.
    pub fn check(SavedHeard(residuals): &SavedHeard, sensors: &[Position]) -> Result<(), CheckpointError> {
        let is_heard = |heard: &HeardResidual| heard.residual.is_finite() && heard.at_m.iter().all(|m| m.is_finite());
        let is_possible = residuals.len() <= sensors.len()
            && residuals.values().all(|last| last.len() <= HEARD_SNRS && last.iter().all(is_heard));
        CheckpointError::ensure(is_possible, "SNRs of these sensor nodes")
    }

    /// Restores a checked state.
    pub fn restore(&self, SavedHeard(residuals): SavedHeard) {
        *self.residuals.write().unwrap_or_else(PoisonError::into_inner) = residuals;
    }
}

impl Channel {
    /// What this law of links has missed of the SNR `snr_db` [dB] that was heard over `uplink`: decibels by a law of the
    /// distance. Of a random line of sight the difference of its probability from where the SNR lies between those out of
    /// sight, 0, and in sight, 1. Nothing of other channels.
    fn residual(&self, uplink: &Uplink, snr_db: f64) -> f64 {
        match self {
            Self::Map(model) => model.law.map_or(0.0, |law| snr_db - law.snr_db(uplink)),
            Self::LineOfSight(model) if model.curve().is_some() => {
                let [seen_db, hidden_db] = model.snrs_db(uplink);
                let part = (snr_db - hidden_db) / (seen_db - hidden_db);
                if part.is_finite() { part.clamp(0.0, 1.0) - model.los_probability(uplink) } else { 0.0 }
            }
            _ => 0.0,
        }
    }
}

impl DrawnChannel {
    /// The SNR [dB] of the `uplink` of the sensor node `id` at the position `sensor` to the UAV at `uav`, in `slot`; with a
    /// line of sight after the gap of the modem. Minus infinity without a link, or an SNR.
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
    use crate::channel::ChannelModel;
    use crate::random::Streams;
    use crate::scenario::{Overrides, Scenario};
    use std::path::Path;

    /// A line of sight that stays over 20 m.
    fn link() -> LinkBudget {
        let text = "name = 'x'\n[link]\nmodel = 'probabilistic-los'\nlos_correlation_m = 20.0\n";
        Scenario::parse(text, Path::new("x.toml"), Overrides::default()).unwrap().link
    }

    fn at(x_m: f64) -> Point3<f64> {
        Point3::new(x_m, 0.0, 30.0)
    }

    /// Residuals at these places, for the sensor node at the origin.
    fn heard(residuals: &[(f64, f32)]) -> HeardLinks {
        let heard = HeardLinks::of(&link());
        let last = residuals.iter().map(|&(x_m, residual)| HeardResidual { at_m: [x_m as f32, 0.0, 30.0], residual });
        heard.restore(SavedHeard([(key(&Position::origin()), last.collect())].into()));
        heard
    }

    #[test]
    fn a_residual_is_the_weighted_mean_of_those_heard_and_of_nothing() {
        // e^0 = 1 of 3 dB, e^{−ln 2} = 1/2 of −1 dB and the law's own 1: (3 − 1/2)/(1 + 1 + 1/2) = 1 dB.
        let half_m = (20.0 * std::f64::consts::LN_2) as f32;
        let both = heard(&[(0.0, 3.0), (half_m.into(), -1.0)]);
        assert!((both.residual(&Position::origin(), &at(0.0)) - 1.0).abs() < 1e-7);
        assert!(both.residual(&Position::origin(), &at(2000.0)).abs() < 1e-9, "far away the law");
        assert_eq!(both.residual(&Position::new(1.0, 0.0), &at(0.0)), 0.0, "of another sensor node nothing was heard");
    }

    #[test]
    fn the_last_64_snrs_count_and_survive_a_restart() {
        let (law, sensor) = (Channel::of(&link()), Position::origin());
        let heard = heard(&[]);
        for step in 0..70 {
            let uav = at(f64::from(step));
            heard.hear(&law, &law.uplink(1.0, &sensor, &uav), &sensor, &uav, f64::from(step) - 40.0);
        }
        let SavedHeard(saved) = heard.saved();
        let last = &saved[&key(&sensor)];
        assert_eq!((last.len(), last[0].at_m[0], last[63].at_m[0]), (HEARD_SNRS, 6.0, 69.0));
        let again = HeardLinks::of(&link());
        let mut bytes = Vec::new();
        crate::checkpoint::encode(&heard.saved(), &mut bytes);
        assert!(bytes.len() <= BYTES_PER_HEARD, "{}", bytes.len());
        again.restore(crate::checkpoint::decode(&bytes).unwrap());
        assert_eq!(again.residual(&sensor, &at(33.0)), heard.residual(&sensor, &at(33.0)));
        assert!(HeardLinks::check(&heard.saved(), &[]).is_err(), "more than the sensor nodes of the mission");
        let spoilt = SavedHeard([([0; 2], [HeardResidual { at_m: [0.0; 3], residual: f32::NAN }].into())].into());
        assert!(HeardLinks::check(&spoilt, &[sensor]).is_err());
    }

    /// Where a link was found in sight it is expected in sight, and elsewhere as the law says.
    #[test]
    fn a_heard_line_of_sight_moves_its_probability() {
        let (law, sensor, uav) = (Channel::of(&link()), Position::origin(), at(40.0));
        let uplink = law.uplink(1.0, &sensor, &uav);
        let model = law.line_of_sight().unwrap();
        let probability = model.los_probability(&uplink);
        for (snr_db, is_seen) in model.snrs_db(&uplink).into_iter().zip([1.0, 0.0]) {
            let heard = heard(&[]);
            (0..9).for_each(|_| heard.hear(&law, &uplink, &sensor, &uav, snr_db));
            let corrected = Uplink { level: heard.residual(&sensor, &uav), ..uplink };
            // Nine of ten parts are what was heard.
            let expected = 0.9 * is_seen + 0.1 * probability;
            assert!((model.los_probability(&corrected) - expected).abs() < 1e-6);
            assert_eq!(law.expected_rate_bps(&corrected) > law.expected_rate_bps(&uplink), is_seen == 1.0);
            let elsewhere = Uplink { level: heard.residual(&sensor, &at(4000.0)), ..uplink };
            assert!((model.los_probability(&elsewhere) - probability).abs() < 1e-9);
        }
    }

    #[test]
    fn an_snr_is_that_of_the_drawn_rate() {
        let (sensor, uav) = (Position::origin(), at(40.0));
        let drawn = DrawnChannel::new(Channel::of(&link()), Streams::new(4));
        let uplink = drawn.law().uplink(1.0, &sensor, &uav);
        let snrs_db = drawn.law().line_of_sight().unwrap().snrs_db(&uplink);
        let is_seen = drawn.draw(&uplink, &sensor, &uav, 3, 0).line_of_sight;
        let snr_db = drawn.snr_db(&uplink, &sensor, &uav, 3, 0);
        assert!((snr_db - snrs_db[usize::from(!is_seen)]).abs() < 1e-9, "{snr_db} of {snrs_db:?}");
    }
}
