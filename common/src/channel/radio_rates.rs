//! From the row of a radio to the table of its rates over distance and altitude (decision D38).

use std::f64::consts::SQRT_2;

use statrs::function::erf::erfc_inv;

use super::table::RateTable;
use crate::presets::radios::{Radio, RateStep};

/// Distance of the two points of the table about a step of the rate [m]. Between points a table is linear.
const STEP_M: f64 = 1e-3;

/// Probabilities in a table with shadowing: 0.005, 0.015 ... 0.995.
const PROBABILITIES: u32 = 100;

/// Distances in a table with shadowing, besides those of the steps.
const DISTANCES: u32 = 100;

/// The log-distance law of the received level, and its spread.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathLoss {
    /// Path loss exponent, `n`.
    pub exponent: f64,
    /// Margin for fading and for the attitude of antennas [dB].
    pub margin_db: f64,
    /// Standard deviation of log-normal shadowing, redrawn in every slot [dB].
    pub sigma_db: f64,
}

impl Radio {
    /// The mean received level [dBm] at the distance `length_m` [m]: `P_tx − L1 − margin − 10 n lg D`.
    fn level_dbm(&self, loss: &PathLoss, length_m: f64) -> f64 {
        self.tx_dbm - self.first_metre_db - loss.margin_db - 10.0 * loss.exponent * length_m.log10()
    }

    /// The distance [m] at which the mean level is the sensitivity of `step`.
    pub fn range_m(&self, loss: &PathLoss, step: &RateStep) -> f64 {
        let spare_db = self.level_dbm(loss, 1.0) - step.sensitivity_dbm;
        10f64.powf(spare_db / (10.0 * loss.exponent))
    }

    /// The horizontal distance [m], in whole millimetres, at which `step` ends for a UAV at the altitude `altitude_m`
    /// [m]; `None` if it does not reach the ground.
    fn step_m(&self, loss: &PathLoss, step: &RateStep, altitude_m: f64) -> Option<f64> {
        let square_m2 = self.range_m(loss, step).powi(2) - altitude_m * altitude_m;
        (square_m2 >= 0.0).then(|| (square_m2.sqrt() / STEP_M).floor() * STEP_M)
    }

    /// The largest horizontal distance [m] with a rate for a UAV at the altitude `altitude_m` [m]; `None` without one.
    pub fn comm_radius_m(&self, loss: &PathLoss, altitude_m: f64) -> Option<f64> {
        self.step_m(loss, &self.steps[0], altitude_m).filter(|&radius_m| radius_m > 0.0)
    }

    /// The highest rate [bit/s] whose sensitivity `level_dbm` reaches; 0 below all.
    fn rate_bps(&self, level_dbm: f64) -> f64 {
        let reached = self.steps.iter().rev().find(|step| level_dbm >= step.sensitivity_dbm);
        reached.map_or(0.0, |step| step.rate_bps)
    }

    /// The table of its rates, for a UAV at these altitudes [m], ascending: two distances about each step, and with
    /// shadowing further ones to where one draw in 200 has a rate.
    ///
    /// # Panics
    /// If altitudes are not ascending, or the exponent is not above 0.
    pub fn table(&self, loss: &PathLoss, altitudes_m: &[f64]) -> RateTable {
        let has_shadowing = loss.sigma_db > 0.0;
        let steps = altitudes_m
            .iter()
            .flat_map(|&altitude_m| self.steps.iter().filter_map(move |step| self.step_m(loss, step, altitude_m)));
        let mut distances_m: Vec<f64> = steps.flat_map(|step_m| [step_m, step_m + STEP_M]).chain([0.0]).collect();
        let mut probabilities = vec![0.5];
        if has_shadowing {
            probabilities = (0..PROBABILITIES).map(|draw| (f64::from(draw) + 0.5) / f64::from(PROBABILITIES)).collect();
            let best_db = shadowing_db(loss.sigma_db, 1.0 - 0.5 / f64::from(PROBABILITIES));
            let strongest = PathLoss { margin_db: loss.margin_db - best_db, ..*loss };
            let farthest_m = self.range_m(&strongest, &self.steps[0]);
            distances_m.extend((1..=DISTANCES).map(|point| farthest_m * f64::from(point) / f64::from(DISTANCES)));
        }
        distances_m.sort_unstable_by(f64::total_cmp);
        distances_m.dedup();
        let mut rates_bps = Vec::with_capacity(distances_m.len() * altitudes_m.len() * probabilities.len());
        for &distance_m in &distances_m {
            for &altitude_m in altitudes_m {
                let mean_dbm = self.level_dbm(loss, distance_m.hypot(altitude_m));
                let drawn_dbm = |&probability: &f64| match has_shadowing {
                    true => mean_dbm + shadowing_db(loss.sigma_db, probability),
                    false => mean_dbm,
                };
                rates_bps.extend(probabilities.iter().map(drawn_dbm).map(|level_dbm| self.rate_bps(level_dbm)));
            }
        }
        RateTable::new(distances_m, altitudes_m.to_vec(), probabilities, rates_bps)
            .expect("ascending axes, and rates that rise with the level")
    }
}

/// The shadowing [dB] that is not exceeded with `probability`.
fn shadowing_db(sigma_db: f64, probability: f64) -> f64 {
    -sigma_db * SQRT_2 * erfc_inv(2.0 * probability)
}
