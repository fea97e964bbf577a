//! Propulsion power of a rotary-wing UAV in level flight.
//!
//! Model and default values: Y. Zeng, J. Xu, R. Zhang, "Energy Minimization for Wireless Communication With Rotary-Wing
//! UAV", IEEE Transactions on Wireless Communications 18(4), 2019, with the values of its table I.

use crate::scenario::Propulsion;

/// Propulsion power [W] at the speed `V` [m/s]; at 0 it is the power of hovering.
///
/// `P = P_0 (1 + 3 V²/U_tip²) + P_i (sqrt(1 + V⁴/(4 v_0⁴)) − V²/(2 v_0²))^½ + ½ d_0 ρ s A V³`.
#[must_use]
pub fn power_w(aircraft: &Propulsion, speed_mps: f64) -> f64 {
    let v2 = speed_mps * speed_mps;
    let blade_w = aircraft.blade_profile_w * (1.0 + 3.0 * v2 / aircraft.tip_speed_mps.powi(2));
    // sqrt(1 + x²) − x cancels at high speed; its reciprocal form does not.
    let x = v2 / (2.0 * aircraft.hover_induced_mps.powi(2));
    let induced_w = aircraft.induced_w / (x + (1.0 + x * x).sqrt()).sqrt();
    let drag = aircraft.drag_ratio * aircraft.air_density_kgpm3 * aircraft.rotor_solidity * aircraft.rotor_disc_m2;
    blade_w + induced_w + 0.5 * drag * v2 * speed_mps
}

/// The speed of least propulsion power [m/s], from 0 to `max_speed_mps`.
///
/// The power is convex in `V²`: the profile power is linear in it, and the drag `∝ (V²)^(3/2)` and the induced power
/// `P_i exp(−½ asinh(V²/(2 v_0²)))` are convex. So it falls up to one speed and rises beyond it.
#[must_use]
pub fn least_power_mps(aircraft: &Propulsion, max_speed_mps: f64) -> f64 {
    let is_lower = |slow_mps: f64, fast_mps: f64| power_w(aircraft, slow_mps) <= power_w(aircraft, fast_mps);
    narrowed(max_speed_mps, is_lower)[0]
}

/// The speed of least energy per metre [m/s], above 0 and up to `max_speed_mps`.
///
/// With `u = V²`, `P/√u` falls where `2 u P' < P`. Where `2 u P' ≥ P`, `P' > 0` and, since P is convex in u, `2 u P' −
/// P` rises. So the energy per metre falls up to one speed and rises beyond it.
#[must_use]
pub fn farthest_mps(aircraft: &Propulsion, max_speed_mps: f64) -> f64 {
    let per_metre = |speed_mps: f64| power_w(aircraft, speed_mps) / speed_mps;
    narrowed(max_speed_mps, |slow_mps, fast_mps| per_metre(slow_mps) < per_metre(fast_mps))[1]
}

/// The speeds from 0 to `max_speed_mps` [m/s], narrowed down by ternary search: `is_lower` says of a slower and a
/// faster one whether the search goes on below the faster. Where `is_lower` is true of equals, the slow end is that of
/// a least value at 0, and otherwise the fast end is above 0.
fn narrowed(max_speed_mps: f64, is_lower: impl Fn(f64, f64) -> bool) -> [f64; 2] {
    let mut low_mps = 0.0;
    let mut high_mps = max_speed_mps;
    for _ in 0..100 {
        let third_mps = (high_mps - low_mps) / 3.0;
        if is_lower(low_mps + third_mps, high_mps - third_mps) {
            high_mps -= third_mps;
        } else {
            low_mps += third_mps;
        }
    }
    [low_mps, high_mps]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::{Overrides, Scenario};

    fn aircraft() -> Propulsion {
        Scenario::letter(Overrides::default()).unwrap().uav.propulsion
    }

    #[test]
    fn hover_power_is_profile_plus_induced_power() {
        assert!((power_w(&aircraft(), 0.0) - (79.86 + 88.63)).abs() < 1e-12);
    }

    #[test]
    fn the_power_follows_the_closed_form() {
        // V = 10: 79.86 (1 + 300/14400) = 81.52375; x = 100/(2 · 16.2409) = 3.078647,
        // sqrt(1 + x²) − x = 3.236982 − 3.078647 = 0.158335, its root 0.397914, times 88.63 = 35.26710;
        // ½ · 0.6 · 1.225 · 0.05 · 0.503 · 1000 = 9.242625
        assert!((power_w(&aircraft(), 10.0) - (81.52375 + 35.2671 + 9.242625)).abs() < 1e-3);
    }

    #[test]
    fn slow_flight_takes_less_power_than_hovering_and_fast_flight_more() {
        let power = |speed_mps| power_w(&aircraft(), speed_mps);
        assert!(power(10.0) < power(0.0) && power(30.0) > power(0.0));
        assert!(power(1e4).is_finite());
    }

    #[test]
    fn the_speed_of_least_power_minimises_power() {
        let slow_rotor = Propulsion { induced_w: 1.0, tip_speed_mps: 2.0, ..aircraft() };
        for (aircraft, max_speed_mps, expected_mps) in
            [(aircraft(), 30.0, 10.2), (aircraft(), 5.0, 5.0), (slow_rotor, 30.0, 0.0)]
        {
            let least_mps = least_power_mps(&aircraft, max_speed_mps);
            assert!((least_mps - expected_mps).abs() < 0.05, "{least_mps}");
            for step in 0..=3_000 {
                let speed_mps = max_speed_mps * f64::from(step) / 3e3;
                assert!(power_w(&aircraft, speed_mps) >= power_w(&aircraft, least_mps) - 1e-9, "{speed_mps}");
            }
        }
    }
}
