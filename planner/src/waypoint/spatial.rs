//! Where to fly in three dimensions: the waypoint of a probabilistic line-of-sight link as a value.
//!
//! It maximises the expected rate of the scheduled set, `Σ E[r_i]` (UTS section IV), over the ground position `(x, y)`
//! and the altitude `z`: within reach of the UAV, in range of every scheduled sensor node (SN) on the ground, and between
//! the altitudes that one slot allows. How it is solved is left to [`crate::waypoint::ascent`] and [`crate::waypoint::sca`].

use std::f64::consts::LOG2_E;

use nalgebra::{Point3, Vector2, Vector3};
use skysink_common::geometry::{Position, distance_squared, elevation_deg};
use skysink_common::los::LosLink;
use skysink_common::scenario::LosCurve;

use crate::sensor_table::SensorTable;
use crate::waypoint::geometric::{self, Disk};

/// Nearer than this [m] on the ground, the UAV is straight above an SN.
const ABOVE_M: f64 = 1e-9;

/// Altitudes that [`SpatialProblem::best_altitude_m`] compares before it narrows the best one down.
const LEVELS: u32 = 16;

/// Golden-section steps from there: each leaves 0.618 of the bracket, together less than 1e-7 of it.
const NARROWINGS: u32 = 34;

/// The problem of one slot. Posing the next one reuses its memory.
#[derive(Debug, Clone)]
pub struct SpatialProblem {
    /// The channel, the same for every SN.
    pub link: LosLink,
    /// Where the scheduled SNs stand.
    pub targets: Vec<Position>,
    /// Reach first, then the range of each target.
    pub disks: Vec<Disk>,
    /// The lowest and the highest altitude [m].
    pub altitudes_m: [f64; 2],
}

/// The two parts of an expected rate's slope at one SN.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Slopes {
    /// With the squared distance `D² = d² + z²`, at a constant elevation angle [bit/s/m²].
    pub by_distance2: f64,
    /// With the elevation angle, at a constant distance [bit/s/°].
    pub by_elevation: f64,
}

impl SpatialProblem {
    /// An empty problem over `link` that never allocates for up to `served` SNs.
    #[must_use]
    pub fn new(link: LosLink, served: usize) -> Self {
        let (targets, disks) = (Vec::with_capacity(served), Vec::with_capacity(served + 1));
        Self { link, targets, disks, altitudes_m: [0.0; 2] }
    }

    /// Poses the problem for the SNs `ids` and the UAV at `position`, `L_u(t−1)`.
    pub fn pose(&mut self, field: &SensorTable, position: &Position, altitudes_m: [f64; 2], ids: &[u32]) {
        self.targets.clear();
        self.targets.extend(ids.iter().map(|&id| *field.position(id)));
        self.disks.clear();
        self.disks.push(Disk { centre: *position, radius_m: field.reach_m });
        self.disks.extend(self.targets.iter().map(|&centre| Disk { centre, radius_m: field.comm_radius_m }));
        self.altitudes_m = altitudes_m;
    }

    /// The objective, `Σ E[r_i]` [bit/s].
    #[must_use]
    pub fn rate_bps(&self, at: &Point3<f64>) -> f64 {
        let d2_m2 = |target| distance_squared(target, &at.xy());
        self.targets.iter().map(|target| self.link.expected_rate_bps(d2_m2(target), at.z)).sum()
    }

    /// Direction and slope [bit/s/m] of the steepest ascent of the objective.
    ///
    /// Straight above an SN the elevation angle has a tip, `θ ≈ 90° − (180/π) d/z`, so that leaving it in any direction
    /// costs the same slope: what the other SNs pull is reduced by that, at most to rest.
    #[must_use]
    pub fn ascent(&self, at: &Point3<f64>) -> Vector3<f64> {
        let (mut pull, mut hold, mut climb) = (Vector2::zeros(), 0.0, 0.0);
        for target in &self.targets {
            let away = at.xy() - target;
            let d_m = away.norm();
            let slopes = slopes(&self.link, d_m * d_m, at.z);
            let by_angle = slopes.by_elevation.to_degrees() / (d_m * d_m + at.z * at.z);
            climb += 2.0 * at.z * slopes.by_distance2 + d_m * by_angle;
            if d_m > ABOVE_M {
                pull += away * (2.0 * slopes.by_distance2 - at.z * by_angle / d_m);
            } else {
                hold += at.z * by_angle;
            }
        }
        let pulled = pull.norm();
        let share = if pulled > hold { 1.0 - hold / pulled } else { 0.0 };
        Vector3::new(pull.x * share, pull.y * share, climb)
    }

    /// The feasible point nearest to `target`; `None` if no point keeps every constraint.
    #[must_use]
    pub fn project(&self, target: &Point3<f64>) -> Option<Point3<f64>> {
        let ground = geometric::project(&target.xy(), &self.disks)?;
        let [low_m, high_m] = self.altitudes_m;
        Some(Point3::new(ground.x, ground.y, target.z.max(low_m).min(high_m)))
    }

    /// The altitude [m] that maximises the objective above `ground`, by search along the vertical; the lowest of equals.
    #[must_use]
    pub fn best_altitude_m(&self, ground: &Position) -> f64 {
        let rate_bps = |z_m: f64| self.rate_bps(&Point3::new(ground.x, ground.y, z_m));
        let (mut best_m, mut best_bps, mut best_level) = (self.altitude_m(0.0), rate_bps(self.altitude_m(0.0)), 0);
        for level in 1..=LEVELS {
            let z_m = self.altitude_m(f64::from(level) / f64::from(LEVELS));
            let level_bps = rate_bps(z_m);
            if level_bps > best_bps {
                (best_m, best_bps, best_level) = (z_m, level_bps, level);
            }
        }
        let share = |level: u32| f64::from(level.min(LEVELS)) / f64::from(LEVELS);
        let (mut low_m, mut high_m) =
            (self.altitude_m(share(best_level.saturating_sub(1))), self.altitude_m(share(best_level + 1)));
        let golden = (5f64.sqrt() - 1.0) / 2.0;
        for _ in 0..NARROWINGS {
            let width_m = (high_m - low_m) * golden;
            let (lower_m, upper_m) = (high_m - width_m, low_m + width_m);
            let (lower_bps, upper_bps) = (rate_bps(lower_m), rate_bps(upper_m));
            let (z_m, z_bps) = if lower_bps >= upper_bps { (lower_m, lower_bps) } else { (upper_m, upper_bps) };
            (low_m, high_m) = if lower_bps >= upper_bps { (low_m, upper_m) } else { (lower_m, high_m) };
            if z_bps > best_bps {
                (best_m, best_bps) = (z_m, z_bps);
            }
        }
        best_m
    }

    /// The altitude [m] at `share` of the range, 0 for the lowest; at 0 and 1 its ends, to the bit.
    pub(crate) fn altitude_m(&self, share: f64) -> f64 {
        let [low_m, high_m] = self.altitudes_m;
        (low_m * (1.0 - share) + high_m * share).max(low_m).min(high_m)
    }
}

/// The slopes of [`LosLink::expected_rate_bps`].
///
/// `∂E/∂D² = P_L R_L' + (1 − P_L) R_N'` with `R' = −W log2(e) (α/2) γ / (D² (D^α + γ))`, and
/// `∂E/∂θ = P_L' (R_L − R_N)`.
pub(crate) fn slopes(link: &LosLink, d2_m2: f64, z_m: f64) -> Slopes {
    let probability = link.los_probability(d2_m2, z_m);
    let distance2_m2 = d2_m2 + z_m * z_m;
    let fall = |snr: f64, exponent: f64| {
        let kappa = exponent / 2.0;
        link.bandwidth_hz * LOG2_E * kappa * snr / (distance2_m2 * (distance2_m2.powf(kappa) + snr))
    };
    let (los_fall, nlos_fall) = (fall(link.los_snr, link.los_exponent), fall(link.nlos_snr, link.nlos_exponent));
    let steepness = steepness(&link.curve, elevation_deg(d2_m2, z_m));
    Slopes {
        by_distance2: -(probability * los_fall + (1.0 - probability) * nlos_fall),
        by_elevation: steepness * (link.los_rate_bps(d2_m2, z_m) - link.nlos_rate_bps(d2_m2, z_m)),
    }
}

/// How fast the chance of line of sight rises with the elevation angle `theta_deg` [deg], `P_L'` [1/°].
fn steepness(curve: &LosCurve, theta_deg: f64) -> f64 {
    let probability = curve.probability(theta_deg);
    match *curve {
        LosCurve::Sigmoid { b, .. } => b * probability * (1.0 - probability),
        // Where the curve is held at 0 it is flat; P_L = b3 + b4 σ and b3 + b4 = 1, so that 1 − P_L = b4 (1 − σ).
        LosCurve::Logistic { b2, b3, b4, .. } if probability > 0.0 => {
            b2 * (probability - b3) / b4 * (1.0 - probability)
        }
        LosCurve::Logistic { .. } => 0.0,
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Dense urban surroundings, bandwidth 1 Hz, 0.1 W over −109 dBm: `γ = 0.1 · 1e−6/(1.259e−14 · 6.607) = 1.202e6`.
    pub(crate) fn dense_urban() -> LosLink {
        LosLink {
            bandwidth_hz: 1.0,
            curve: LosCurve::Sigmoid { a: 12.08, b: 0.11 },
            los_snr: 1.202e6,
            nlos_snr: 1.202e4,
            los_exponent: 2.5,
            nlos_exponent: 3.5,
        }
    }

    /// The problem of the SNs at `places_m` [m] for a UAV 80 m around the origin, `d_c` = 60 m.
    pub(crate) fn posed(link: LosLink, places_m: &[[f64; 2]], altitudes_m: [f64; 2]) -> SpatialProblem {
        let targets: Vec<Position> = places_m.iter().map(|&place| place.into()).collect();
        let mut disks = vec![Disk { centre: Position::origin(), radius_m: 80.0 }];
        disks.extend(targets.iter().map(|&centre| Disk { centre, radius_m: 60.0 }));
        SpatialProblem { link, targets, disks, altitudes_m }
    }

    pub(crate) fn curves() -> impl Strategy<Value = LosCurve> {
        prop_oneof![
            (4.0..30.0, 0.05..0.5).prop_map(|(a, b)| LosCurve::Sigmoid { a, b }),
            (-1.0..0.0, 0.02..0.1, 0.8..2.0).prop_map(|(b1, b2, b4)| LosCurve::Logistic { b1, b2, b3: 1.0 - b4, b4 }),
        ]
    }

    #[test]
    fn a_lone_sensor_node_is_served_best_from_straight_above_and_the_tip_holds() {
        let problem = posed(dense_urban(), &[[3.0, 4.0]], [20.0, 120.0]);
        let slope = problem.ascent(&Point3::new(3.0, 4.0, 50.0));
        assert_eq!((slope.x, slope.y), (0.0, 0.0));
        assert!(slope.z < 0.0, "at 90° only the distance is left: {slope}");
        assert_eq!(problem.best_altitude_m(&Position::new(3.0, 4.0)), 20.0);
    }

    #[test]
    fn a_tip_gives_way_to_a_stronger_pull() {
        // P_L hardly depends on the angle at 90° in dense urban surroundings: 1 − P_L = 12.08 e^{−0.11 · 77.92} = 0.0023.
        let problem = posed(dense_urban(), &[[0.0, 0.0], [50.0, 0.0], [50.0, 1.0], [50.0, -1.0]], [20.0, 120.0]);
        let at = Point3::new(0.0, 0.0, 40.0);
        let slope = problem.ascent(&at);
        assert!(slope.x > 0.0 && slope.y.abs() < 1e-12, "{slope}");
        let ahead = Point3::new(1e-4, 0.0, 40.0);
        let rise = (problem.rate_bps(&ahead) - problem.rate_bps(&at)) / 1e-4;
        assert!((slope.x / rise - 1.0).abs() < 1e-3, "{slope}, {rise}");
    }

    #[test]
    fn the_best_altitude_of_a_far_sensor_node_lies_between() {
        // From far below the horizon's chance to far above its reach: no end of the range is best.
        let problem = posed(dense_urban(), &[[50.0, 0.0]], [1.0, 5_000.0]);
        let best_m = problem.best_altitude_m(&Position::origin());
        let slope = problem.ascent(&Point3::new(0.0, 0.0, best_m));
        assert!((10.0..500.0).contains(&best_m) && slope.z.abs() < 1e-6, "{best_m} m, {slope}");
    }

    #[test]
    fn the_ends_of_the_range_are_met_to_the_bit() {
        let problem = posed(dense_urban(), &[[0.0, 0.0]], [20.1, 119.7]);
        assert_eq!([problem.altitude_m(0.0), problem.altitude_m(1.0)], [20.1, 119.7]);
        let projected = problem.project(&Point3::new(0.0, 0.0, 500.0)).unwrap();
        assert_eq!(projected.z, 119.7);
        assert_eq!(problem.project(&Point3::new(f64::NAN, 0.0, 50.0)), None);
    }

    proptest! {
        #[test]
        fn the_ascent_is_the_gradient_of_the_rate(
            curve in curves(),
            exponents in (1.5..6.0, 2.0..6.0),
            at in (-40.0..40.0, -40.0..40.0, 10.0..150.0),
        ) {
            let link = LosLink { curve, los_exponent: exponents.0, nlos_exponent: exponents.1, ..dense_urban() };
            let problem = posed(link, &[[50.0, 3.0], [-45.0, 10.0], [0.0, 60.0]], [10.0, 150.0]);
            let at = Point3::new(at.0, at.1, at.2);
            let slope = problem.ascent(&at);
            // A logistic curve has a corner where it reaches 0, which no difference may straddle.
            let flat = |target: &Position| {
                link.los_probability(distance_squared(target, &at.xy()), at.z) > 1e-3
            };
            prop_assume!(problem.targets.iter().all(flat));
            for axis in 0..3 {
                let mut step = Vector3::zeros();
                step[axis] = 1e-4;
                let difference = (problem.rate_bps(&(at + step)) - problem.rate_bps(&(at - step))) / 2e-4;
                prop_assert!((slope[axis] - difference).abs() < 1e-6 * (1e-2 + difference.abs()), "{slope}, {difference}");
            }
        }

        #[test]
        fn no_altitude_of_a_fine_grid_is_better(
            curve in curves(),
            places in prop::collection::vec((-50.0..50.0, -50.0..50.0), 1..5),
            range in (10.0..60.0, 0.0..100.0),
        ) {
            let places: Vec<[f64; 2]> = places.into_iter().map(|(x_m, y_m)| [x_m, y_m]).collect();
            let link = LosLink { curve, ..dense_urban() };
            let problem = posed(link, &places, [range.0, range.0 + range.1]);
            let rate_bps = |z_m: f64| problem.rate_bps(&Point3::new(0.0, 0.0, z_m));
            let best_m = problem.best_altitude_m(&Position::origin());
            prop_assert!((range.0..=range.0 + range.1).contains(&best_m));
            for step in 0..=1_000 {
                let z_m = problem.altitude_m(f64::from(step) / 1e3);
                prop_assert!(rate_bps(z_m) <= rate_bps(best_m) * (1.0 + 1e-9), "{z_m} m beats {best_m} m");
            }
        }
    }
}
