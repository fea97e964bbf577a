//! The problem sP2: the waypoint with the highest expected rate of the scheduled sensor nodes (SNs).
//!
//! It maximises the sum of the expected rates, `Σ E[r_i]`, within reach of the UAV, in range of every scheduled SN, and
//! between the altitudes that one slot allows. Solvers are in [`crate::waypoint::plane`], [`crate::waypoint::ascent`]
//! and [`crate::waypoint::sca`].

use nalgebra::{Point3, Vector2, Vector3};
use skysink_common::channel::{Channel, ChannelModel, Uplink};
use skysink_common::geometry::{Position, above};
use skysink_common::message::SolverOutcome;

use crate::geometry::disks::{Disk, project};
use crate::mission_table::MissionTable;

/// A waypoint that moves less than this [m] in a step has settled.
pub(super) const SETTLED_M: f64 = 1e-6;

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
    /// Reach first, then the range of each scheduled SN, about its position `L_i`.
    pub disks: Vec<Disk>,
    /// Reference channel gain at 1 m of each scheduled SN, `α_i`, as a linear ratio.
    pub gains: Vec<f64>,
    /// The lowest and the highest altitude [m]; the same where the UAV cannot climb.
    pub altitudes_m: [f64; 2],
}

/// A point that keeps every constraint of sP2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Waypoint {
    /// Where it is.
    pub point: Point3<f64>,
    /// How it was found.
    pub outcome: SolverOutcome,
}

/// A point and its objective.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RatedPoint {
    /// Where it is.
    pub point: Point3<f64>,
    /// `Σ E[r_i]` there [bit/s].
    pub rate_bps: f64,
}

impl RatedPoint {
    /// The one of higher rate; of equals this one.
    #[must_use]
    pub fn or_better(self, other: Self) -> Self {
        if other.rate_bps > self.rate_bps { other } else { self }
    }
}

impl Problem {
    /// An empty problem over the SNs of `table` that never allocates for up to n of them.
    #[must_use]
    pub fn new(table: &MissionTable) -> Self {
        let served = table.limits.blocks();
        Self {
            channel: table.channel.clone(),
            disks: Vec::with_capacity(served + 1),
            gains: Vec::with_capacity(served),
            altitudes_m: [0.0; 2],
        }
    }

    /// Poses sP2 for the SNs `ids` and the UAV above `ground`, `L_u(t−1)`: `‖q − L_u(t−1)‖ ≤ V τ` and `‖q − L_i‖ ≤ d_c`
    /// on the ground, at one of `altitudes_m` [m], the lowest and the highest.
    pub fn pose(&mut self, table: &MissionTable, ground: &Position, altitudes_m: [f64; 2], ids: &[u32]) {
        self.disks.clear();
        self.disks.push(Disk { centre: *ground, radius_m: table.limits.reach_m });
        self.disks.extend(
            ids.iter().map(|&id| Disk { centre: *table.sensors.position(id), radius_m: table.limits.comm_radius_m }),
        );
        self.gains.clear();
        self.gains.extend(ids.iter().map(|&id| table.sensors.gains[id as usize]));
        self.altitudes_m = altitudes_m;
    }

    /// Where each scheduled SN stands and its uplink, with the UAV at `uav`.
    pub fn uplinks(&self, uav: &Point3<f64>) -> impl Iterator<Item = (&Position, Uplink)> {
        let sensors = self.disks[1..].iter().zip(&self.gains);
        sensors.map(|(range, &gain)| (&range.centre, self.channel.uplink(gain, &range.centre, uav)))
    }

    /// Mean of the scheduled positions, the expansion point of the paper.
    pub fn mean(&self) -> Position {
        let sum = self.disks[1..].iter().map(|range| range.centre.coords).sum::<Vector2<f64>>();
        (sum / self.gains.len() as f64).into()
    }

    /// The objective, `Σ E[r_i]` [bit/s].
    pub fn rate_bps(&self, at: &Point3<f64>) -> f64 {
        self.uplinks(at).map(|(_, uplink)| self.channel.expected_rate_bps(&uplink)).sum()
    }

    /// A point with its objective.
    pub fn rated(&self, point: Point3<f64>) -> RatedPoint {
        RatedPoint { point, rate_bps: self.rate_bps(&point) }
    }

    /// Direction and slope [bit/s/m] of the steepest ascent of the objective.
    ///
    /// Straight above an SN the elevation angle has a non-smooth peak, `θ ≈ 90° − (180/π) d/z`: leaving it in any
    /// direction costs the same slope, which is subtracted from the gradient of the other SNs, down to 0.
    pub fn ascent(&self, at: &Point3<f64>) -> Vector3<f64> {
        let mut pull = Vector2::zeros();
        let mut hold = 0.0;
        let mut climb = 0.0;
        for (range, &gain) in self.disks[1..].iter().zip(&self.gains) {
            let away = at.xy() - range.centre;
            let d_m = away.norm();
            let uplink = self.channel.uplink_at(gain, d_m * d_m, at.z);
            let slopes = self.channel.slopes(&uplink);
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
    pub fn project(&self, target: &Point3<f64>) -> Option<Point3<f64>> {
        let ground = project(&target.xy(), &self.disks)?;
        let [low_m, high_m] = self.altitudes_m;
        Some(above(&ground, target.z.max(low_m).min(high_m)))
    }

    /// The altitude [m] that maximises the objective above `ground`, by search along the vertical; the lowest of
    /// equals.
    pub fn best_altitude_m(&self, ground: &Position) -> f64 {
        const LAST: usize = LEVELS as usize;
        let altitude_m = |level: usize| self.altitude_m(level as f64 / LAST as f64);
        let levels: [RatedPoint; LAST + 1] = std::array::from_fn(|level| self.rated(above(ground, altitude_m(level))));
        let rises_to = |level: usize| level == 0 || levels[level].rate_bps > levels[level - 1].rate_bps;
        // There may be several local maxima, and the best level need not be next to the highest.
        let peaks = (0..=LAST).filter(|&level| rises_to(level) && (level == LAST || !rises_to(level + 1)));
        let narrowed = peaks.map(|peak| {
            let ends_m = [peak.saturating_sub(1), (peak + 1).min(LAST)].map(altitude_m);
            self.narrowed(ground, levels[peak], ends_m)
        });
        narrowed.reduce(RatedPoint::or_better).map_or(self.altitudes_m[0], |best| best.point.z)
    }

    /// The best altitude above `ground` by golden section between `low_m` and `high_m` [m], or `best`.
    fn narrowed(&self, ground: &Position, mut best: RatedPoint, [mut low_m, mut high_m]: [f64; 2]) -> RatedPoint {
        let golden = (5f64.sqrt() - 1.0) / 2.0;
        for _ in 0..NARROWINGS {
            let width_m = (high_m - low_m) * golden;
            let lower = self.rated(above(ground, high_m - width_m));
            let upper = self.rated(above(ground, low_m + width_m));
            if lower.rate_bps >= upper.rate_bps {
                high_m = upper.point.z;
                best = best.or_better(lower);
            } else {
                low_m = lower.point.z;
                best = best.or_better(upper);
            }
        }
        best
    }

    /// The best of the altitudes above `ground` that divide the range into `levels` parts, the lowest of equals.
    pub(crate) fn best_level(&self, ground: &Position, levels: u32) -> RatedPoint {
        let altitude_m = |level: u32| self.altitude_m(f64::from(level) / f64::from(levels.max(1)));
        let rated = (0..=levels).map(|level| self.rated(above(ground, altitude_m(level))));
        rated.reduce(RatedPoint::or_better).expect("at least one level")
    }

    /// The altitude [m] at `fraction` of the range, 0 for the lowest; at 0 and 1 its ends, to the bit.
    pub(crate) fn altitude_m(&self, fraction: f64) -> f64 {
        let [low_m, high_m] = self.altitudes_m;
        // In another form than `interpolate`, which differs in the last bit: flights are recorded that have this one.
        (low_m * (1.0 - fraction) + high_m * fraction).max(low_m).min(high_m)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;
    use skysink_common::channel::{Fading, LineOfSight, LosCurve, Sight};

    /// Dense urban surroundings, bandwidth 1 Hz, 0.1 W over −109 dBm: `γ = 0.1 · 1e−6/(1.259e−14 · 6.607) = 1.202e6`.
    pub(crate) fn dense_urban() -> LineOfSight {
        LineOfSight {
            bandwidth_hz: 1.0,
            comm_s: 0.1,
            sight: Sight::Curve(LosCurve::Sigmoid { a: 12.08, b: 0.11 }),
            los_snr: 1.202e6,
            nlos_snr: 1.202e4,
            los_exponent: 2.5,
            nlos_exponent: 3.5,
            correlation_m: None,
            fading: None,
            shadowing: None,
        }
    }

    /// The problem of the SNs at `positions_m` [m] for a UAV 80 m around the origin, `d_c` = 60 m.
    pub(crate) fn posed(model: LineOfSight, positions_m: &[[f64; 2]], altitudes_m: [f64; 2]) -> Problem {
        let mut disks = vec![Disk { centre: Position::origin(), radius_m: 80.0 }];
        disks.extend(positions_m.iter().map(|&position| Disk { centre: position.into(), radius_m: 60.0 }));
        let gains = vec![1.0; positions_m.len()];
        Problem { channel: Channel::LineOfSight(model), disks, gains, altitudes_m }
    }

    /// No, Rayleigh and Rician fading.
    pub(crate) fn fadings() -> impl Strategy<Value = Option<Fading>> {
        prop::sample::select(vec![None, Some(f64::NEG_INFINITY), Some(10.0)]).prop_map(|k_db| k_db.map(Fading::rician))
    }

    pub(crate) fn curves() -> impl Strategy<Value = LosCurve> {
        prop_oneof![
            (4.0..30.0, 0.05..0.5).prop_map(|(a, b)| LosCurve::Sigmoid { a, b }),
            (-1.0..0.0, 0.02..0.1, 0.8..2.0).prop_map(|(b1, b2, b4)| LosCurve::Logistic { b1, b2, b3: 1.0 - b4, b4 }),
        ]
    }

    #[test]
    fn a_lone_sensor_node_is_served_best_from_straight_above() {
        let problem = posed(dense_urban(), &[[3.0, 4.0]], [20.0, 120.0]);
        let slope = problem.ascent(&Point3::new(3.0, 4.0, 50.0));
        assert_eq!((slope.x, slope.y), (0.0, 0.0));
        assert!(slope.z < 0.0, "at 90° only the distance is left: {slope}");
        assert_eq!(problem.best_altitude_m(&Position::new(3.0, 4.0)), 20.0);
    }

    #[test]
    fn a_stronger_gradient_overcomes_the_nonsmooth_point_above_a_sensor_node() {
        // P_L hardly depends on the angle at 90° in dense urban surroundings: 1 − P_L = 12.08 e^{−0.11 · 77.92} =
        // 0.0023.
        let problem = posed(dense_urban(), &[[0.0, 0.0], [50.0, 0.0], [50.0, 1.0], [50.0, -1.0]], [20.0, 120.0]);
        let at = Point3::new(0.0, 0.0, 40.0);
        let slope = problem.ascent(&at);
        assert!(slope.x > 0.0 && slope.y.abs() < 1e-12, "{slope}");
        let ahead = Point3::new(1e-4, 0.0, 40.0);
        let rise = (problem.rate_bps(&ahead) - problem.rate_bps(&at)) / 1e-4;
        assert!((slope.x / rise - 1.0).abs() < 1e-3, "{slope}, {rise}");
    }

    #[test]
    fn the_best_altitude_for_a_far_sensor_node_is_inside_the_range() {
        // From where it is hardly ever in line of sight to where it is far away: no end of the range is best.
        let problem = posed(dense_urban(), &[[50.0, 0.0]], [1.0, 5_000.0]);
        let best_m = problem.best_altitude_m(&Position::origin());
        let slope = problem.ascent(&Point3::new(0.0, 0.0, best_m));
        assert!((10.0..500.0).contains(&best_m) && slope.z.abs() < 1e-6, "{best_m} m, {slope}");
    }

    #[test]
    fn ties_of_rate_go_to_the_lowest_altitude() {
        let silent = LineOfSight { los_snr: 0.0, nlos_snr: 0.0, ..dense_urban() };
        let problem = posed(silent, &[[50.0, 0.0]], [20.1, 119.7]);
        assert_eq!(problem.best_altitude_m(&Position::origin()), 20.1);
    }

    #[test]
    fn the_ends_of_the_altitude_range_are_exact() {
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
            fading in fadings(),
            exponents in (1.5..6.0, 2.0..6.0),
            at in (-40.0..40.0, -40.0..40.0, 10.0..150.0),
        ) {
            let (los_exponent, nlos_exponent) = exponents;
            let link = LineOfSight { sight: Sight::Curve(curve), fading, los_exponent, nlos_exponent, ..dense_urban() };
            let problem = posed(link.clone(), &[[50.0, 3.0], [-45.0, 10.0], [0.0, 60.0]], [10.0, 150.0]);
            let at = Point3::new(at.0, at.1, at.2);
            let slope = problem.ascent(&at);
            // A logistic curve has a corner where it reaches 0, which no difference may straddle.
            let is_smooth = |uplink: Uplink| link.los_probability(&uplink) > 1e-3;
            prop_assume!(problem.uplinks(&at).all(|(_, uplink)| is_smooth(uplink)));
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
            positions in prop::collection::vec((-50.0..50.0, -50.0..50.0), 1..5),
            range in (10.0..60.0, 0.0..100.0),
        ) {
            let positions: Vec<[f64; 2]> = positions.into_iter().map(|(x_m, y_m)| [x_m, y_m]).collect();
            let link = LineOfSight { sight: Sight::Curve(curve), ..dense_urban() };
            let problem = posed(link, &positions, [range.0, range.0 + range.1]);
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
