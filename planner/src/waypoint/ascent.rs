//! The ascent solver of the three-dimensional waypoint: projected gradient ascent of the true objective from several
//! starts.
//!
//! The problem has three variables and a convex feasible set, but the objective has a non-smooth peak above every
//! sensor node (SN). An ascent may end at the wrong peak, and gradients do not lead onto one, so every SN is among the
//! starts. Each step follows the steepest ascent, is projected exactly onto the feasible set, and is taken only if the
//! objective rises.

use std::cmp::Ordering;

use nalgebra::{Vector3, center};

use crate::geometry::disks::project;
use crate::waypoint::problem::{Problem, RatedPoint, SETTLED_M};

/// Starts that are followed to their end.
pub(crate) const FOLLOWED: usize = 6;

/// Altitudes tried at every start, the lowest and the highest among them, where the UAV can climb.
const LEVELS: u32 = 6;

/// Most steps from one start.
const MAX_STEPS: u32 = 200;

/// Fraction of the linear rise that a step must keep.
const SUFFICIENT: f64 = 1e-4;

/// What is left of a step that does not rise enough.
const SHRINK: f64 = 0.3;

/// First step [m].
const FIRST_STEP_M: f64 = 2.0;

/// Longest step [m] along the ascent, before projection.
const LONGEST_STEP_M: f64 = 200.0;

/// Relative rise of the objective below which a step counts as none.
const RISE: f64 = 1e-11;

/// Steps in a row without a rise that end an ascent.
const PATIENCE: u32 = 4;

/// Fills `starts` with the best starts of `problem`, best first and at most six; with none if no point keeps every
/// constraint.
///
/// They stand over the mean of the SNs, the UAV, each SN and half-way from the mean to it, all projected into the
/// feasible set, each at the best of a few altitudes.
pub fn fill_starts(problem: &Problem, starts: &mut Vec<RatedPoint>) {
    starts.clear();
    let mean = problem.mean();
    let levels = if problem.altitudes_m[0] < problem.altitudes_m[1] { LEVELS - 1 } else { 0 };
    let around = problem.disks[1..].iter().flat_map(|range| [range.centre, center(&range.centre, &mean)]);
    for ground in [mean, problem.disks[0].centre].into_iter().chain(around) {
        let Some(ground) = project(&ground, &problem.disks) else {
            return starts.clear();
        };
        starts.push(problem.best_level(&ground, levels));
    }
    starts.sort_unstable_by(|a, b| {
        let by_position = a.point.iter().zip(b.point.iter()).map(|(a, b)| a.total_cmp(b));
        by_position.fold(b.rate_bps.total_cmp(&a.rate_bps), Ordering::then)
    });
    starts.dedup();
    starts.truncate(FOLLOWED);
}

/// The best end of the ascents from `starts`; `None` if there are none.
#[must_use]
pub fn best_end(problem: &Problem, starts: &[RatedPoint]) -> Option<RatedPoint> {
    starts.iter().map(|start| climb(problem, *start)).reduce(RatedPoint::or_better)
}

/// Ascends from a feasible point until it settles: projected ascent with the step lengths of Barzilai and Borwein
/// (1988), each shortened until the objective rises.
#[must_use]
pub fn climb(problem: &Problem, start: RatedPoint) -> RatedPoint {
    let mut at = start;
    let mut slope = problem.ascent(&at.point);
    let mut stretch = FIRST_STEP_M / slope.norm();
    let mut idle = 0;
    for _ in 0..MAX_STEPS {
        stretch = stretch.min(LONGEST_STEP_M / slope.norm());
        let Some((next, left)) = step(problem, &at, &slope, stretch) else {
            break;
        };
        let moved = next.point - at.point;
        let next_slope = problem.ascent(&next.point);
        let bend = -moved.dot(&(next_slope - slope));
        stretch = if bend > 0.0 { moved.norm_squared() / bend } else { 10.0 * left };
        idle = if next.rate_bps - at.rate_bps <= RISE * at.rate_bps { idle + 1 } else { 0 };
        at = next;
        slope = next_slope;
        if moved.norm() < SETTLED_M || idle >= PATIENCE {
            break;
        }
    }
    at
}

/// The first point of a shrinking step that rises enough, and the stretch left of it; `None` if none does, as where
/// there is no slope, or one that is not a number.
fn step(problem: &Problem, at: &RatedPoint, slope: &Vector3<f64>, mut stretch: f64) -> Option<(RatedPoint, f64)> {
    while stretch * slope.norm() >= SETTLED_M {
        let point = problem.project(&(at.point + slope * stretch))?;
        let next = problem.rated(point);
        let rise_bps = next.rate_bps - at.rate_bps;
        if rise_bps > 0.0 && rise_bps >= SUFFICIENT * slope.dot(&(point - at.point)) {
            return Some((next, stretch));
        }
        stretch *= SHRINK;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::waypoint::problem::tests::{curves, dense_urban, fadings, posed};
    use nalgebra::Point3;
    use proptest::prelude::*;
    use skysink_common::channel::{LineOfSight, Sight};
    use skysink_common::geometry::Position;

    /// The best end from the best starts.
    fn solve(problem: &Problem) -> Option<RatedPoint> {
        let mut starts = Vec::new();
        fill_starts(problem, &mut starts);
        best_end(problem, &starts)
    }

    #[test]
    fn a_pair_is_served_from_its_midpoint() {
        // 40 m apart in dense urban surroundings at 50 m, θ = 68°: nearer to one is farther from the other.
        let problem = posed(dense_urban(), &[[-20.0, 7.0], [20.0, 7.0]], [50.0, 50.0]);
        let end = solve(&problem).unwrap();
        assert!((end.point - Point3::new(0.0, 7.0, 50.0)).norm() < 1e-3, "{end:?}");
    }

    #[test]
    fn coinciding_starts_are_ascended_once() {
        // A lone SN is its mean, and half-way from the mean to it.
        let problem = posed(dense_urban(), &[[10.0, 0.0]], [50.0, 50.0]);
        let mut starts = Vec::new();
        fill_starts(&problem, &mut starts);
        let points: Vec<Point3<f64>> = starts.iter().map(|start| start.point).collect();
        assert_eq!(points, [Point3::new(10.0, 0.0, 50.0), Point3::new(0.0, 0.0, 50.0)]);
    }

    #[test]
    fn a_step_of_insufficient_increase_is_shortened() {
        // From 20 m to one side of a pair to nearly as far on the other, where by symmetry the rate is nearly the same.
        let problem = posed(dense_urban(), &[[-20.0, 0.0], [20.0, 0.0]], [50.0, 50.0]);
        let at = problem.rated(Point3::new(0.0, 20.0, 50.0));
        let slope = problem.ascent(&at.point);
        assert!(problem.rate_bps(&Point3::new(0.0, -19.999, 50.0)) > at.rate_bps);
        let (next, _) = step(&problem, &at, &slope, -39.999 / slope.y).unwrap();
        assert!((next.point.y - (20.0 - 39.999 * SHRINK)).abs() < 1e-9, "{next:?}");
    }

    #[test]
    fn reach_limits_the_ascent() {
        let mut problem = posed(dense_urban(), &[[30.0, 40.0]], [20.0, 120.0]);
        problem.disks[0].radius_m = 10.0;
        let end = solve(&problem).unwrap();
        assert!((end.point.xy() - Position::new(6.0, 8.0)).norm() < 1e-6, "{end:?}");
        let best_m = problem.best_altitude_m(&Position::new(6.0, 8.0));
        assert!((end.point.z - best_m).abs() < 1e-2, "{end:?}, {best_m} m");
    }

    #[test]
    fn sensor_nodes_without_a_common_point_have_no_waypoint() {
        let problem = posed(dense_urban(), &[[-60.1, 0.0], [60.1, 0.0]], [20.0, 120.0]);
        assert_eq!(solve(&problem), None);
    }

    #[test]
    fn links_of_zero_rate_leave_the_ascent_at_its_start() {
        let silent = LineOfSight { los_snr: 0.0, nlos_snr: 0.0, ..dense_urban() };
        let end = solve(&posed(silent, &[[10.0, 0.0], [20.0, 0.0]], [20.0, 120.0]));
        assert_eq!(end.map(|end| end.rate_bps), Some(0.0));
    }

    proptest! {
        #[test]
        fn the_ascent_ends_at_a_local_maximum(
            curve in curves(),
            fading in fadings(),
            positions in prop::collection::vec((-40.0..40.0, -40.0..40.0), 1..7),
            range in (10.0..60.0, 0.0..100.0),
        ) {
            let positions: Vec<[f64; 2]> = positions.into_iter().map(|(x_m, y_m)| [x_m, y_m]).collect();
            let problem = posed(LineOfSight { sight: Sight::Curve(curve), fading, ..dense_urban() }, &positions, [range.0, range.0 + range.1]);
            let end = solve(&problem).expect("the origin is in all disks");
            prop_assert_eq!(problem.project(&end.point), Some(end.point));
            for axis in 0..3 {
                for step_m in [-3.0, -0.1, -1e-3, 1e-3, 0.1, 3.0] {
                    let mut step = Vector3::zeros();
                    step[axis] = step_m;
                    let near = problem.project(&(end.point + step)).expect("the end is feasible");
                    let near_bps = problem.rate_bps(&near);
                    // Where all links together carry less than a bit in a millisecond, one per second is no way up.
                    let slack_bps = if end.rate_bps < 1e3 { 1.0 } else { end.rate_bps * 1e-7 };
                    let most_bps = end.rate_bps + slack_bps;
                    prop_assert!(near_bps <= most_bps, "{near} beats {end:?} with {near_bps} bit/s");
                }
            }
        }
    }
}
