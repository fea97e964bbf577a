//! Successive convex approximation (SCA) of the three-dimensional waypoint problem: one Clarabel program per step.
//!
//! The problem is that of `docs/src/model.md`, "Probabilistic line of sight": maximise the sum of the expected rates
//! `E[r] = P_L R_L + (1 − P_L) R_N` of the scheduled sensor nodes (SNs), in reach and in range. A step linearises it at
//! an expansion point `(q̂, ẑ)`; a hat marks values there. Bounding rates from below in this way is the method of You
//! and Zhang, "Hybrid Offline-Online Design for UAV-Enabled Data Harvesting in Probabilistic LoS Channels", IEEE Trans.
//! Wireless Commun., 2020.
//!
//! **Rate.** In the variables `y = D² = d² + z²` and `x = 1/P_L = 1 + e^{−s}`, `s = b (θ − a) − ln a`, the rate of an
//! SN is replaced by its tangent, which varies by `−Φ (x − x̂) − Ψ (y − ŷ)` with `Φ = P̂_L² (R̂_L − R̂_N)` and
//! `Ψ = −∂E/∂y`. For the line-of-sight part, `P_L R_L = (W/x) log2(1 + γ y^{−α_L/2})`, the tangent is a lower bound,
//! because this function is jointly convex at every SNR for `α_L ≤ 4`. For `α_L > 4`, and for the generalised logistic
//! curve, whose probability has another form, no step is made. The non-line-of-sight part is small; its tangent is no
//! bound.
//!
//! **Angle.** `θ` is bounded from below by its tangent in `v ≤ sin θ = z/D`, `θ ≥ θ̂ + (180/π)(v − v̂)/cos θ̂`. The
//! constraint `v D ≤ z` is tightened to `½ ((v̂/D̂) D² + (D̂/v̂) v²) ≤ z`, which with `t = v̂ z/D̂` is the ball
//! `(v̂/D̂)² d² + (1 − t)² + v² ≤ 1`.
//!
//! **Program.** A quadratic objective, `n + 1` second-order cones for reach and range, and one second-order and one
//! exponential cone per SN.
//!
//! **Step length.** The bound is not exact and a solver has errors, so a step is taken only as far as the true
//! objective rises. Straight above an SN `θ` has a peak, and the bounds are tight over short steps only. Steps become
//! small there, and the projected gradient ascent ([`ascent`](super::ascent)) finishes the search.

use clarabel::solver::SupportedConeT::{ExponentialConeT, SecondOrderConeT, ZeroConeT};
use nalgebra::{Point3, Vector3};
use skysink_common::channel::{ChannelModel, LineOfSight, LosCurve, Sight, Uplink};
use skysink_common::geometry::{Position, distance_squared};

use crate::cone_program::ConeProgram;
use crate::waypoint::problem::{Problem, RatedPoint};

/// Largest exponent `α_L` for which the tangent is used as a lower bound.
const CONVEX_UP_TO: f64 = 4.0;

/// Smallest `cos θ̂` at which `θ(v)` is expanded: its slope is unbounded straight above an SN.
const LEAST_COSINE: f64 = 0.02;

/// Tolerance of Clarabel. It may be loose, because every result is checked against the true objective.
const TOLERANCE: f64 = 1e-7;

/// Most halvings of a step on which the true objective does not rise.
const HALVINGS: usize = 6;

/// Relative increase below which the iteration has converged.
const SETTLED: f64 = 1e-9;

/// Smallest altitude range [m] that is searched; in a smaller one the altitude is fixed.
const FLAT_M: f64 = 1e-6;

/// Number of variables of the point; those of the SNs follow.
const POINT: usize = 3;

/// What the convex steps contributed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Contribution {
    /// They moved the point to a higher rate.
    Moved,
    /// Clarabel solved a program, which confirmed the point.
    Confirmed,
    /// Clarabel was not used, or solved no program.
    Nothing,
}

/// Makes up to `iterations` convex steps from a feasible `start`; the true objective never falls.
///
/// Returns `start` for channels without the convex bound (a curve other than the sigmoid, or `α_L > 4`), and where
/// Clarabel solves no program.
#[must_use]
pub fn approximate(problem: &Problem, start: RatedPoint, iterations: u32) -> (RatedPoint, Contribution) {
    let mut at = start;
    let mut contribution = Contribution::Nothing;
    let Some(link @ LineOfSight { sight: Sight::Curve(LosCurve::Sigmoid { a, b }), .. }) =
        problem.channel.line_of_sight()
    else {
        return (at, contribution);
    };
    if link.los_exponent > CONVEX_UP_TO {
        return (at, contribution);
    }
    for _ in 0..iterations {
        let Some(proposal) = Program::at(problem, link, &at.point, [*a, *b]).solve() else {
            break;
        };
        let next = as_far_as_it_rises(problem, at, &proposal);
        let rises = next.rate_bps > at.rate_bps * (1.0 + SETTLED);
        at = next;
        if !rises {
            if contribution == Contribution::Nothing {
                contribution = Contribution::Confirmed;
            }
            break;
        }
        contribution = Contribution::Moved;
    }
    (at, contribution)
}

/// Backtracking line search from `at` toward `proposal`: the first point of higher true objective, or `at`.
fn as_far_as_it_rises(problem: &Problem, at: RatedPoint, proposal: &Point3<f64>) -> RatedPoint {
    let step = proposal - at.point;
    let fractions = std::iter::successors(Some(1.0), |fraction| Some(fraction / 2.0)).take(HALVINGS + 1);
    let points = fractions.filter_map(|fraction| problem.project(&(at.point + step * fraction)));
    points.map(|point| problem.rated(point)).find(|point| point.rate_bps > at.rate_bps).unwrap_or(at)
}

/// One convex program.
///
/// `u` holds the step from the expansion point in units of `unit_m`, then for every SN `v` and `w = (x − 1) e^ŝ`, which
/// is near 1.
struct Program {
    origin: Point3<f64>,
    unit_m: f64,
    cones: ConeProgram,
}

impl Program {
    /// The program of `problem` expanded at the feasible point `at`, for the curve `1/(1 + a e^{−b(θ−a)})` of `[a, b]`.
    fn at(problem: &Problem, link: &LineOfSight, at: &Point3<f64>, curve: [f64; 2]) -> Self {
        let variables = POINT + 2 * problem.gains.len();
        let unit_m = problem.disks.iter().map(|disk| disk.radius_m).fold(f64::INFINITY, f64::min);
        let mut program = Self { origin: *at, unit_m, cones: ConeProgram::new(variables) };
        program.stay_between(problem.altitudes_m);
        for disk in &problem.disks {
            let from_centre = (at.xy() - disk.centre) / disk.radius_m; // ‖(q − centre)/ρ‖ ≤ 1
            program.cones.stay_within(1.0, &from_centre, 0, unit_m / disk.radius_m);
        }
        let scale_bps = problem.rate_bps(at);
        for (index, range) in problem.disks[1..].iter().enumerate() {
            program.serve(link, &range.centre, curve, scale_bps, POINT + 2 * index);
        }
        program
    }

    /// Adds the range of altitudes, or the fixed altitude.
    fn stay_between(&mut self, [low_m, high_m]: [f64; 2]) {
        if high_m - low_m < FLAT_M {
            self.cones.cone(ZeroConeT(1));
            self.cones.row(0.0, &[(2, 1.0)]);
        } else {
            self.cones.at_least_0((high_m - self.origin.z) / self.unit_m, &[(2, 1.0)]);
            self.cones.at_least_0((self.origin.z - low_m) / self.unit_m, &[(2, -1.0)]);
        }
    }

    /// Adds one SN's terms of the objective, divided by `scale_bps`, and its two cones. `v` is the index of its
    /// variable `v`; `w` follows.
    fn serve(&mut self, link: &LineOfSight, target: &Position, [a, b]: [f64; 2], scale_bps: f64, v: usize) {
        let w = v + 1;
        let away = self.origin.xy() - target;
        let z_m = self.origin.z;
        let d2_m2 = distance_squared(&self.origin.xy(), target);
        let distance_m = (d2_m2 + z_m * z_m).sqrt();
        let sine = z_m / distance_m;

        let cosine = (d2_m2.sqrt() / distance_m).max(LEAST_COSINE);
        let expanded_sine = (1.0 - cosine * cosine).sqrt();
        let growth = b * (1.0 / cosine).to_degrees();
        let inverse_odds = a * (-b * (expanded_sine.atan2(cosine).to_degrees() - a)).exp(); // e^−ŝ

        let uplink = Uplink::at(1.0, d2_m2, z_m);
        let probability = link.los_probability(&uplink);
        let gain_bps = link.los_rate_bps(d2_m2, z_m) - link.nlos_rate_bps(d2_m2, z_m);
        self.cones.linear[w] = probability * probability * gain_bps.max(0.0) * inverse_odds / scale_bps;
        let fall = -link.slopes(&uplink).by_distance2 * self.unit_m / scale_bps;
        for (axis, offset_m) in Vector3::new(away.x, away.y, z_m).iter().enumerate() {
            self.cones.quadratic[axis] += 2.0 * fall * self.unit_m;
            self.cones.linear[axis] += 2.0 * fall * offset_m;
        }

        // (v̂/D̂)² d² + (1 − t)² + v² ≤ 1, t = v̂ z/D̂
        let tilt = sine / distance_m;
        self.cones.cone(SecondOrderConeT(5));
        self.cones.row(1.0, &[]);
        self.cones.row(tilt * away.x, &[(0, -tilt * self.unit_m)]);
        self.cones.row(tilt * away.y, &[(1, -tilt * self.unit_m)]);
        self.cones.row(1.0 - tilt * z_m, &[(2, tilt * self.unit_m)]);
        self.cones.row(0.0, &[(v, -1.0)]);

        // e^{ŝ − s} ≤ w, s − ŝ = b (180/π) (v − v̂)/cos θ̂
        self.cones.cone(ExponentialConeT());
        self.cones.row(growth * expanded_sine, &[(v, growth)]);
        self.cones.row(1.0, &[]);
        self.cones.row(0.0, &[(w, -1.0)]);
    }

    /// The solution; `None` unless Clarabel reports the status `Solved`.
    fn solve(self) -> Option<Point3<f64>> {
        let found = self.cones.solve(TOLERANCE)?;
        Some(self.origin + Vector3::new(found.x[0], found.x[1], found.x[2]) * self.unit_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::waypoint::ascent;
    use crate::waypoint::problem::tests::{dense_urban, fadings, posed};
    use proptest::prelude::*;

    /// Clusters of one to six SNs in sight of the origin, and a range of altitudes, an empty one among them.
    fn problems() -> impl Strategy<Value = Problem> {
        let positions = prop::collection::vec((-40.0..40.0, -40.0..40.0), 1..7);
        let curve = prop::sample::select(vec![(4.88, 0.43), (9.61, 0.16), (12.08, 0.11), (27.23, 0.08)]);
        let height_m = prop_oneof![3 => 5.0..100.0, 1 => Just(0.0)];
        (positions, curve, 20.0..60.0, height_m, 2.0..4.0, fadings()).prop_map(
            |(positions, (a, b), low_m, height_m, los_exponent, fading)| {
                let positions: Vec<[f64; 2]> = positions.into_iter().map(|(x_m, y_m)| [x_m, y_m]).collect();
                let link = LineOfSight {
                    sight: Sight::Curve(LosCurve::Sigmoid { a, b }),
                    los_exponent,
                    fading,
                    ..dense_urban()
                };
                posed(link, &positions, [low_m, low_m + height_m])
            },
        )
    }

    fn start_of(problem: &Problem, fraction: f64) -> RatedPoint {
        problem.rated(Point3::new(0.0, 0.0, problem.altitude_m(fraction)))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(150))]

        /// `P_L R_L` over `x = 1/P_L` and `y = D²`: `(1/x) log2(1 + γ y^−κ)`.
        #[test]
        fn up_to_an_exponent_of_4_the_tangent_is_a_lower_bound(
            kappa in 0.5f64..2.0,
            expansion in (0.0..3.0, 0.0..5.0),
            other in (0.0..3.0, 0.0..5.0),
        ) {
            let snr = 1.2e6f64;
            let rate = |y: f64| (1.0 + snr * y.powf(-kappa)).log2();
            let [(x0, y0), (x, y)] = [expansion, other].map(|(x, y): (f64, f64)| (10f64.powf(x), 10f64.powf(y)));
            let by_x = rate(y0) / (x0 * x0);
            let by_y = kappa * snr * std::f64::consts::LOG2_E / (x0 * y0 * (y0.powf(kappa) + snr));
            let tangent = rate(y0) / x0 - by_x * (x - x0) - by_y * (y - y0);
            prop_assert!(rate(y) / x >= tangent - 1e-9 * rate(y0), "{} < {tangent}", rate(y) / x);
        }

        #[test]
        fn sca_steps_do_not_lower_the_rate_or_violate_constraints(problem in problems(), fraction in 0.0..1.0) {
            let mut last = start_of(&problem, fraction);
            for _ in 0..5 {
                let (next, _) = approximate(&problem, last, 1);
                prop_assert!(next.rate_bps >= last.rate_bps, "{} < {}", next.rate_bps, last.rate_bps);
                prop_assert_eq!(next.rate_bps, problem.rate_bps(&next.point));
                prop_assert_eq!(problem.project(&next.point), Some(next.point));
                last = next;
            }
        }
    }

    #[test]
    fn many_steps_converge_to_the_end_of_the_ascent() {
        for (a, b) in [(4.88, 0.43), (9.61, 0.16), (12.08, 0.11), (27.23, 0.08)] {
            let link = LineOfSight { sight: Sight::Curve(LosCurve::Sigmoid { a, b }), ..dense_urban() };
            let problem = posed(link, &[[-30.0, 5.0], [30.0, 0.0], [5.0, 35.0], [0.0, -25.0]], [20.0, 120.0]);
            let (end, contribution) = approximate(&problem, start_of(&problem, 0.5), 60);
            assert_eq!(contribution, Contribution::Moved, "a = {a}");
            let onward = ascent::climb(&problem, end);
            assert!(onward.rate_bps <= end.rate_bps * (1.0 + 1e-5), "a = {a}: {end:?}, {onward:?}");
        }
    }

    #[test]
    fn one_step_covers_most_of_the_distance_to_the_midpoint_of_a_pair() {
        // Two SNs 60 m apart, the UAV 20 m off their middle at 60 m: by symmetry the best point is above the middle.
        let problem = posed(dense_urban(), &[[-30.0, 0.0], [30.0, 0.0]], [60.0, 60.0]);
        let start = problem.rated(Point3::new(0.0, 20.0, 60.0));
        let (end, contribution) = approximate(&problem, start, 1);
        assert_eq!((contribution, end.point.z), (Contribution::Moved, 60.0));
        assert!(end.point.y.abs() < 2.0 && end.point.x.abs() < 1e-3, "{end:?}");
    }

    #[test]
    fn channels_without_a_convex_bound_are_left_to_the_ascent() {
        let logistic = LosCurve::Logistic { b1: -0.4568, b2: 0.047, b3: -0.63, b4: 1.63 };
        for link in [
            LineOfSight { los_exponent: 4.1, ..dense_urban() },
            LineOfSight { sight: Sight::Curve(logistic), ..dense_urban() },
        ] {
            let problem = posed(link, &[[30.0, 0.0]], [20.0, 120.0]);
            let start = start_of(&problem, 0.5);
            assert_eq!(approximate(&problem, start, 5), (start, Contribution::Nothing));
        }
    }

    #[test]
    fn up_to_an_exponent_of_4_a_step_is_made() {
        let problem = posed(LineOfSight { los_exponent: 4.0, ..dense_urban() }, &[[30.0, 0.0]], [20.0, 120.0]);
        assert_ne!(approximate(&problem, start_of(&problem, 0.5), 1).1, Contribution::Nothing);
    }

    #[test]
    fn straight_above_a_lone_sensor_node_a_step_descends() {
        let problem = posed(dense_urban(), &[[0.0, 0.0]], [20.0, 120.0]);
        let (end, contribution) = approximate(&problem, start_of(&problem, 0.6), 5);
        assert_eq!(contribution, Contribution::Moved);
        assert!(end.point.z < 50.0, "{end:?}");
    }
}
