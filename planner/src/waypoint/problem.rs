//! sP2 as a value: from which waypoint the scheduled sensor nodes are expected to send most.
//!
//! It maximises the sum of the expected rates, `Σ E[r_i]`, within reach of the UAV, in range of every scheduled sensor
//! node (SN) on the ground, and between the altitudes that one slot allows. How it is solved is left to
//! [`crate::waypoint::plane`], [`crate::waypoint::ascent`] and [`crate::waypoint::sca`].

use nalgebra::{Point3, Vector2, Vector3};
use skysink_common::channel::{Channel, Uplink};
use skysink_common::geometry::Position;
use skysink_common::message::SolverOutcome;

use crate::geometry::disks::{Disk, project};
use crate::sensor_table::SensorTable;

/// Nearer than this [m] on the ground, the UAV is straight above an SN.
const ABOVE_M: f64 = 1e-9;

/// Altitudes that [`Problem::best_altitude_m`] compares before it narrows the best one down.
const LEVELS: u32 = 16;

/// Golden-section steps from there: each leaves 0.618 of the bracket, together less than 1e-7 of it.
const NARROWINGS: u32 = 34;

/// sP2 of one slot. Posing the next one reuses its memory.
#[derive(Debug, Clone)]
pub struct Problem {
    /// The channel of all uplinks.
    pub channel: Channel,
    /// The scheduled SNs.
    pub targets: Vec<Target>,
    /// Reach first, then the range of each target.
    pub disks: Vec<Disk>,
    /// The lowest and the highest altitude [m]; the same where the UAV cannot climb.
    pub altitudes_m: [f64; 2],
}

/// A scheduled SN.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// Where it stands, `L_i`.
    pub position: Position,
    /// Its reference channel gain at 1 m, `α_i`, as a linear ratio.
    pub gain: f64,
}

/// A point that keeps every constraint of sP2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Waypoint {
    /// Where it is.
    pub point: Point3<f64>,
    /// How it was found.
    pub outcome: SolverOutcome,
}

impl Target {
    /// Its uplink with the UAV at `uav`.
    #[must_use]
    pub fn uplink(&self, uav: &Point3<f64>) -> Uplink {
        Uplink::new(self.gain, &self.position, uav)
    }
}

impl Problem {
    /// An empty problem over the SNs of `table` that never allocates for up to n of them.
    #[must_use]
    pub fn new(table: &SensorTable) -> Self {
        let served = table.resource_blocks;
        Self {
            channel: table.channel,
            targets: Vec::with_capacity(served),
            disks: Vec::with_capacity(served + 1),
            altitudes_m: [0.0; 2],
        }
    }

    /// Poses sP2 for the SNs `ids` and the UAV above `ground`, `L_u(t−1)`: `‖q − L_u(t−1)‖ ≤ V τ` and `‖q − L_i‖ ≤ d_c`
    /// on the ground, at one of `altitudes_m` [m], the lowest and the highest.
    pub fn pose(&mut self, table: &SensorTable, ground: &Position, altitudes_m: [f64; 2], ids: &[u32]) {
        self.targets.clear();
        self.disks.clear();
        self.disks.push(Disk { centre: *ground, radius_m: table.reach_m });
        for &id in ids {
            let position = *table.position(id);
            self.targets.push(Target { position, gain: table.gains[id as usize] });
            self.disks.push(Disk { centre: position, radius_m: table.comm_radius_m });
        }
        self.altitudes_m = altitudes_m;
    }

    /// Mean of the scheduled positions, the letter's expansion point.
    #[must_use]
    pub fn mean(&self) -> Position {
        let sum = self.targets.iter().map(|target| target.position.coords).sum::<Vector2<f64>>();
        (sum / self.targets.len() as f64).into()
    }

    /// The objective, `Σ E[r_i]` [bit/s].
    #[must_use]
    pub fn rate_bps(&self, at: &Point3<f64>) -> f64 {
        self.targets.iter().map(|target| self.channel.expected_rate_bps(&target.uplink(at))).sum()
    }

    /// Direction and slope [bit/s/m] of the steepest ascent of the objective.
    ///
    /// Straight above an SN the elevation angle has a tip, `θ ≈ 90° − (180/π) d/z`, so that leaving it in any direction
    /// costs the same slope: what the other SNs pull is reduced by that, at most to rest.
    #[must_use]
    pub fn ascent(&self, at: &Point3<f64>) -> Vector3<f64> {
        let mut pull = Vector2::zeros();
        let mut hold = 0.0;
        let mut climb = 0.0;
        for target in &self.targets {
            let away = at.xy() - target.position;
            let d_m = away.norm();
            let slopes = self.channel.slopes(&Uplink { gain: target.gain, d2_m2: d_m * d_m, z_m: at.z });
            let by_angle = slopes.by_elevation.to_degrees() / (d_m * d_m + at.z * at.z);
            climb += 2.0 * at.z * slopes.by_distance2 + d_m * by_angle;
            if d_m > ABOVE_M {
                pull += away * (2.0 * slopes.by_distance2 - at.z * by_angle / d_m);
            } else {
                hold += at.z * by_angle;
            }
        }
        let pulled = pull.norm();
        let left = if pulled > hold { 1.0 - hold / pulled } else { 0.0 };
        Vector3::new(pull.x * left, pull.y * left, climb)
    }

    /// The feasible point nearest to `target`; `None` if no point keeps every constraint.
    #[must_use]
    pub fn project(&self, target: &Point3<f64>) -> Option<Point3<f64>> {
        let ground = project(&target.xy(), &self.disks)?;
        let [low_m, high_m] = self.altitudes_m;
        Some(Point3::new(ground.x, ground.y, target.z.max(low_m).min(high_m)))
    }

    /// The altitude [m] that maximises the objective above `ground`, by search along the vertical; the lowest of equals.
    #[must_use]
    pub fn best_altitude_m(&self, ground: &Position) -> f64 {
        let rate_bps = |z_m: f64| self.rate_bps(&Point3::new(ground.x, ground.y, z_m));
        let level_m = |level: u32| self.altitude_m(f64::from(level.min(LEVELS)) / f64::from(LEVELS));
        let mut best_m = level_m(0);
        let mut best_bps = rate_bps(best_m);
        let mut best_level = 0;
        for level in 1..=LEVELS {
            let z_m = level_m(level);
            let level_bps = rate_bps(z_m);
            if level_bps > best_bps {
                (best_m, best_bps, best_level) = (z_m, level_bps, level);
            }
        }
        let mut low_m = level_m(best_level.saturating_sub(1));
        let mut high_m = level_m(best_level + 1);
        let golden = (5f64.sqrt() - 1.0) / 2.0;
        for _ in 0..NARROWINGS {
            let width_m = (high_m - low_m) * golden;
            let lower_m = high_m - width_m;
            let upper_m = low_m + width_m;
            let lower_bps = rate_bps(lower_m);
            let upper_bps = rate_bps(upper_m);
            let is_below = lower_bps >= upper_bps;
            let (z_m, z_bps) = if is_below { (lower_m, lower_bps) } else { (upper_m, upper_bps) };
            (low_m, high_m) = if is_below { (low_m, upper_m) } else { (lower_m, high_m) };
            if z_bps > best_bps {
                (best_m, best_bps) = (z_m, z_bps);
            }
        }
        best_m
    }

    /// The altitude [m] at `fraction` of the range, 0 for the lowest; at 0 and 1 its ends, to the bit.
    pub(crate) fn altitude_m(&self, fraction: f64) -> f64 {
        let [low_m, high_m] = self.altitudes_m;
        (low_m * (1.0 - fraction) + high_m * fraction).max(low_m).min(high_m)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;
    use skysink_common::channel::LineOfSight;
    use skysink_common::scenario::LosCurve;

    /// Dense urban surroundings, bandwidth 1 Hz, 0.1 W over −109 dBm: `γ = 0.1 · 1e−6/(1.259e−14 · 6.607) = 1.202e6`.
    pub(crate) fn dense_urban() -> LineOfSight {
        LineOfSight {
            bandwidth_hz: 1.0,
            comm_s: 0.1,
            curve: LosCurve::Sigmoid { a: 12.08, b: 0.11 },
            los_snr: 1.202e6,
            nlos_snr: 1.202e4,
            los_exponent: 2.5,
            nlos_exponent: 3.5,
        }
    }

    /// The problem of the SNs at `places_m` [m] for a UAV 80 m around the origin, `d_c` = 60 m.
    pub(crate) fn posed(model: LineOfSight, places_m: &[[f64; 2]], altitudes_m: [f64; 2]) -> Problem {
        let target = |&place: &[f64; 2]| Target { position: place.into(), gain: 1.0 };
        let targets: Vec<Target> = places_m.iter().map(target).collect();
        let mut disks = vec![Disk { centre: Position::origin(), radius_m: 80.0 }];
        disks.extend(targets.iter().map(|target| Disk { centre: target.position, radius_m: 60.0 }));
        Problem { channel: Channel::LineOfSight(model), targets, disks, altitudes_m }
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
        // From where it is hardly ever in line of sight to where it is far away: no end of the range is best.
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
            let link = LineOfSight { curve, los_exponent: exponents.0, nlos_exponent: exponents.1, ..dense_urban() };
            let problem = posed(link, &[[50.0, 3.0], [-45.0, 10.0], [0.0, 60.0]], [10.0, 150.0]);
            let at = Point3::new(at.0, at.1, at.2);
            let slope = problem.ascent(&at);
            // A logistic curve has a corner where it reaches 0, which no difference may straddle.
            let flat = |target: &Target| link.los_probability(target.uplink(&at).d2_m2, at.z) > 1e-3;
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
            let link = LineOfSight { curve, ..dense_urban() };
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
