//! The motion of the vehicle: a trapezoidal speed profile toward a target, with lag and gusts.

use nalgebra::{Vector2, Vector3};
use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Fastest climb and descent [m/s], and their acceleration [m/s²].
const CLIMB_MPS: f64 = 2.5;
const DESCENT_MPS: f64 = 1.5;
const CLIMB_MPS2: f64 = 2.5;

/// Part of the acceleration that braking uses where the velocity lags, so that the vehicle does not overshoot.
const BRAKING: f64 = 0.6;

/// Standard deviation of gusts, as a fraction of the wind, and their correlation time [s].
const GUSTS: f64 = 0.3;
const GUST_S: f64 = 3.0;

/// The limits of a vehicle, and the wind.
#[derive(Debug, Clone, Copy)]
pub struct MotionLimits {
    /// Greatest horizontal acceleration [m/s²].
    pub acceleration_mps2: f64,
    /// Greatest speed over ground [m/s].
    pub speed_mps: f64,
    /// Time constant of the velocity [s].
    pub lag_s: f64,
    /// Wind toward the east [m/s].
    pub wind_mps: f64,
}

/// A moving vehicle, relative to its home: east, north, up.
#[derive(Debug, Clone)]
pub struct Body {
    /// Position [m].
    pub position_m: Vector3<f64>,
    /// Velocity [m/s], without gusts.
    pub velocity_mps: Vector3<f64>,
    gust_mps: Vector2<f64>,
}

impl Default for Body {
    fn default() -> Self {
        Self { position_m: Vector3::zeros(), velocity_mps: Vector3::zeros(), gust_mps: Vector2::zeros() }
    }
}

impl Body {
    /// Moves for `dt_s` [s] toward `target_m` [m].
    pub fn fly(&mut self, target_m: &Vector3<f64>, limits: &MotionLimits, dt_s: f64, random: &mut ChaCha8Rng) {
        let away_m = target_m - self.position_m;
        let wanted_mps = approach(away_m.xy(), limits, dt_s);
        let lag_s = limits.lag_s.max(dt_s);
        let change_mps = (wanted_mps - self.velocity_mps.xy()) * (dt_s / lag_s);
        let change_mps = change_mps.cap_magnitude(limits.acceleration_mps2 * dt_s);
        let speed_mps = if away_m.z < 0.0 { DESCENT_MPS } else { CLIMB_MPS };
        let braking_mps = (2.0 * CLIMB_MPS2 * away_m.z.abs()).sqrt();
        let wanted_up_mps = speed_mps.min(braking_mps).min(away_m.z.abs() / dt_s).copysign(away_m.z);
        let most_mps = CLIMB_MPS2 * dt_s;
        let change_up_mps = (wanted_up_mps - self.velocity_mps.z).clamp(-most_mps, most_mps);
        self.velocity_mps += Vector3::new(change_mps.x, change_mps.y, change_up_mps);
        self.gust(limits.wind_mps * GUSTS, dt_s, random);
        self.position_m += (self.velocity_mps + self.gust_mps.push(0.0)) * dt_s;
    }

    /// Stands on the ground.
    pub fn stand(&mut self) {
        self.velocity_mps = Vector3::zeros();
        self.gust_mps = Vector2::zeros();
        self.position_m.z = 0.0;
    }

    /// The velocity that it measures [m/s].
    pub fn measured_mps(&self) -> Vector3<f64> {
        self.velocity_mps + self.gust_mps.push(0.0)
    }

    /// Advances the gusts of the standard deviation `sigma_mps` [m/s].
    fn gust(&mut self, sigma_mps: f64, dt_s: f64, random: &mut ChaCha8Rng) {
        if sigma_mps > 0.0 {
            let kept = (-dt_s / GUST_S).exp();
            let fresh = Vector2::from([0; 2].map(|_| random.sample::<f64, _>(StandardNormal)))
                * sigma_mps
                * (1.0 - kept * kept).sqrt();
            self.gust_mps = self.gust_mps * kept + fresh;
        }
    }
}

/// The velocity [m/s] with which a vehicle approaches a point that is `away_m` [m] away.
fn approach(away_m: Vector2<f64>, limits: &MotionLimits, dt_s: f64) -> Vector2<f64> {
    let Some((direction, distance_m)) = nalgebra::Unit::try_new_and_get(away_m, 1e-9) else { return Vector2::zeros() };
    let lags = limits.lag_s > 0.0;
    let braking_mps2 = limits.acceleration_mps2 * if lags { BRAKING } else { 1.0 };
    let last_s = if lags { 2.5 * limits.lag_s } else { dt_s };
    // The limit holds in the air: against the wind, the vehicle is slower over ground.
    let wind_mps = Vector2::new(limits.wind_mps, 0.0);
    let across_mps = direction.perp(&wind_mps);
    let through_mps = (limits.speed_mps.powi(2) - across_mps.powi(2)).max(0.0).sqrt();
    let fastest_mps = (through_mps + direction.dot(&wind_mps)).clamp(0.0, limits.speed_mps);
    let speed_mps = fastest_mps.min((2.0 * braking_mps2 * distance_m).sqrt()).min(distance_m / last_s);
    direction.into_inner() * speed_mps
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::SeedableRng as _;

    const LIMITS: MotionLimits = MotionLimits { acceleration_mps2: 2.5, speed_mps: 10.0, lag_s: 0.0, wind_mps: 0.0 };

    /// The time [s] until a vehicle that rests has come within 5 cm of a point `away_m` to the east, and rests there.
    fn time_s(away_m: f64, limits: &MotionLimits) -> f64 {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut body = Body::default();
        let target_m = Vector3::new(away_m, 0.0, 0.0);
        let mut steps = 0;
        while (body.position_m - target_m).norm() > 0.05 || body.velocity_mps.norm() > 0.2 {
            body.fly(&target_m, limits, 0.01, &mut random);
            steps += 1;
            assert!(steps < 10_000, "{body:?}");
        }
        f64::from(steps) * 0.01
    }

    #[test]
    fn a_leg_from_rest_to_rest_takes_the_time_of_a_trapezoid() {
        // 2 √(d / a) up to v² / a = 40 m, then d / v + v / a.
        for (away_m, expected_s) in [(10.0, 4.0), (40.0, 8.0), (100.0, 14.0)] {
            let taken_s = time_s(away_m, &LIMITS);
            assert!((taken_s - expected_s).abs() < 0.15, "{away_m} m: {taken_s} s");
        }
    }

    #[test]
    fn a_climb_accelerates_brakes_and_is_faster_than_a_descent() {
        for (from_m, to_m, expected_s) in [(0.0, 20.0, 9.0), (20.0, 0.0, 14.0)] {
            let mut random = ChaCha8Rng::seed_from_u64(1);
            let mut body = Body { position_m: Vector3::new(0.0, 0.0, from_m), ..Body::default() };
            let mut steps = 0;
            while (body.position_m.z - to_m).abs() > 0.05 {
                body.fly(&Vector3::new(0.0, 0.0, to_m), &LIMITS, 0.01, &mut random);
                steps += 1;
                assert!(steps < 3_000, "{body:?}");
            }
            let taken_s = f64::from(steps) * 0.01; // d / v + v / a, less what braking saves at the end
            assert!((taken_s - expected_s).abs() < 0.5, "{from_m} m to {to_m} m: {taken_s} s");
        }
    }

    #[test]
    fn gusts_have_their_standard_deviation_and_correlation_time() {
        let limits = MotionLimits { wind_mps: 10.0, ..LIMITS };
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut body = Body::default();
        let gusts: Vec<f64> = (0..200_000)
            .map(|_| {
                body.fly(&Vector3::zeros(), &limits, 0.1, &mut random);
                body.gust_mps.x
            })
            .collect();
        let mean = |terms: &mut dyn Iterator<Item = f64>| terms.sum::<f64>() / gusts.len() as f64;
        let variance = mean(&mut gusts.iter().map(|gust| gust * gust));
        let after_3_s = mean(&mut gusts.iter().zip(&gusts[30..]).map(|(gust, later)| gust * later)) / variance;
        assert!((variance.sqrt() - 3.0).abs() < 0.15, "{}", variance.sqrt());
        assert!((after_3_s - (-1.0f64).exp()).abs() < 0.05, "{after_3_s}");
        body.stand();
        assert!(body.measured_mps() == Vector3::zeros() && body.position_m.z == 0.0);
    }

    proptest! {
        #[test]
        fn a_vehicle_with_lag_arrives_and_does_not_overshoot(away_m in 1.0..80.0, lag_s in 0.05..0.5) {
            let limits = MotionLimits { lag_s, ..LIMITS };
            let mut random = ChaCha8Rng::seed_from_u64(1);
            let mut body = Body::default();
            let target_m = Vector3::new(away_m, 0.0, 0.0);
            for _ in 0..3_000 {
                body.fly(&target_m, &limits, 0.01, &mut random);
                prop_assert!(body.position_m.x < away_m + 0.5, "{body:?}");
            }
            prop_assert!((body.position_m - target_m).norm() < 0.1);
        }
    }
}
