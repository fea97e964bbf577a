//! What the slots of a scenario demand of a vehicle (decisions D29 and D31).

use serde::Serialize;
use skysink_common::geometry::Position;
use skysink_common::scenario::Scenario;

use super::quantity::scaled;

/// Acceleration of a common copter [m/s²], for comparison.
const COPTER_MPS2: f64 = 2.5;

/// Acceleration that no copter exceeds for long [m/s²]: level flight at a tilt of 45°.
const MOST_MPS2: f64 = 9.81;

/// One-sided quantile of the normal distribution at 95 %.
const MOSTLY: f64 = 1.645;

/// What the slots demand of a vehicle, and what wind and errors do.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MotionFigures {
    /// Acceleration that flies the reach of a slot from rest to rest [m/s²], 4 V/τ, at a top speed of twice the mean
    /// speed; `None` if the scenario gives the acceleration.
    pub demanded_mps2: Option<f64>,
    /// Time in which a copter of 2.5 m/s² flies the reach from rest to rest [s]; `None` likewise.
    pub copter_s: Option<f64>,
    /// Ground speed against the wind and with it [m/s]; `None` without wind.
    pub ground_mps: Option<[f64; 2]>,
    /// Standard deviation of where a slot ends [m]: half of the visits planned at `d_c` miss the range. `None` if it
    /// ends at the waypoint.
    pub position_error_m: Option<f64>,
    /// Number of UAVs that start outside of a base and within `uav.separation_m` of another; `None` if there are none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub crowded: Option<usize>,
}

impl MotionFigures {
    /// Of a scenario.
    pub fn of(scenario: &Scenario) -> Self {
        let uav = &scenario.uav;
        let hop_m = uav.max_speed_mps * scenario.slot_s;
        let is_instant = uav.acceleration_mps2.is_none();
        let wind_mps = scenario.wind_mps().norm();
        Self {
            demanded_mps2: is_instant.then(|| 4.0 * hop_m / scenario.slot_s.powi(2)),
            copter_s: is_instant.then(|| 2.0 * (hop_m / COPTER_MPS2).sqrt()),
            ground_mps: uav.wind_mps.map(|_| [uav.max_speed_mps - wind_mps, uav.max_speed_mps + wind_mps]),
            position_error_m: uav.position_error_m,
            crowded: Some(crowded(scenario)).filter(|crowded| *crowded > 0),
        }
    }

    /// Whether `reach_m` of a slot is `V τ`.
    pub fn is_plain(&self) -> bool {
        self.demanded_mps2.is_some() && self.ground_mps.is_none()
    }

    /// Name and value of each figure.
    pub fn rows(&self) -> Vec<(&'static str, String)> {
        let mut rows = Vec::new();
        if let (Some(demanded_mps2), Some(copter_s)) = (self.demanded_mps2, self.copter_s) {
            let demanded = scaled(demanded_mps2, "m/s²");
            rows.push(("V τ from rest to rest", format!("{demanded}; a copter takes {}", scaled(copter_s, "s"))));
        }
        if let Some(ground_mps) = self.ground_mps {
            let [against, with] = ground_mps.map(|mps| scaled(mps, "m/s"));
            rows.push(("ground speed", format!("{against} upwind, {with} downwind")));
        }
        if let Some(sigma_m) = self.position_error_m.filter(|sigma_m| *sigma_m > 0.0) {
            let inside = scaled(MOSTLY * sigma_m, "m");
            rows.push(("visits missed by σ", format!("half at d_c, 5 % from {inside} inside")));
        }
        rows
    }

    /// UAVs start too near to each other, outside of a base.
    pub fn start_warning(&self) -> Option<String> {
        let crowded = self.crowded?;
        Some(format!(
            "{crowded} UAVs start within uav.separation_m of another and outside of a base: waypoints near to a UAV \
             that waits there are refused (give uav.starts_m farther apart, or a [base] around the starts)"
        ))
    }

    /// The slots take more than 9.81 m/s² (a tilt of 45°), and the scenario gives no acceleration.
    pub fn warning(&self) -> Option<String> {
        let demanded_mps2 = self.demanded_mps2.filter(|demanded_mps2| *demanded_mps2 > MOST_MPS2)?;
        let demanded = scaled(demanded_mps2, "m/s²");
        let copter = scaled(self.copter_s?, "s");
        Some(format!(
            "no copter flies V τ from rest to rest in a slot: that takes {demanded}, and with 2.5 m/s² {copter}: set \
             uav.acceleration_mps2, or use longer slots"
        ))
    }
}

/// Number of UAVs that start outside of a base and within the least distance of another one (decision D23).
fn crowded(scenario: &Scenario) -> usize {
    let separation_m = scenario.uav.separation_m.unwrap_or(0.0);
    let base = scenario.landing_base();
    let starts: Vec<Position> = scenario.starts().map(|start| start.xy()).collect();
    let outside = || starts.iter().enumerate().filter(|(_, at)| !base.as_ref().is_some_and(|base| base.contains(at)));
    let is_crowded = |(uav, at): &(usize, &Position)| {
        outside().any(|(other, near)| other != *uav && (near - *at).norm() < separation_m)
    };
    outside().filter(is_crowded).count()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use skysink_common::scenario::Overrides;

    use super::*;

    fn motion(keys: &str) -> MotionFigures {
        let text = format!("name = 'a'\n{keys}");
        MotionFigures::of(&Scenario::parse(&text, Path::new("a.toml"), Overrides::default()).unwrap())
    }

    #[test]
    fn the_papers_acceleration_is_warned_of_and_that_of_long_slots_is_not() {
        // 30 m = a/4 · 1 s²; 2.5/4 · 6.93² = 30 m.
        let letter = motion("");
        assert_eq!(letter.demanded_mps2, Some(120.0));
        assert!((letter.copter_s.unwrap() - 48f64.sqrt()).abs() < 1e-12);
        assert!(letter.warning().unwrap().contains("120 m/s², and with 2.5 m/s² 6.93 s"));
        let slow = motion("slot_s = 60.0\n[uav]\nendurance_s = 1e6\n"); // 1800 m in 60 s: 2 m/s²
        assert_eq!((slow.demanded_mps2, slow.warning()), (Some(2.0), None));
        let given = motion("[uav]\nacceleration_mps2 = 2.5\n");
        assert_eq!((given.demanded_mps2, given.warning(), given.is_plain()), (None, None, false));
        assert!(given.rows().is_empty() && letter.is_plain());
    }

    #[test]
    fn wind_and_errors_are_shown() {
        let rows = motion("[uav]\nwind_mps = [3.0, 4.0]\nposition_error_m = 3.0\n").rows();
        assert_eq!(rows[1].1, "25 m/s upwind, 35 m/s downwind");
        assert!(rows[2].1.starts_with("half at d_c, 5 % from 4.9"), "{rows:?}");
    }
}
