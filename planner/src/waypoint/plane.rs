//! sP2* in the plane: the waypoint where the rate falls with the distance alone.
//!
//! sP2* expands the rates to first order in `d²`, which makes it the projection of a weighted centroid onto an
//! intersection of disks: exactly by plane geometry, or as a second-order cone program.

use nalgebra::Vector2;
use skysink_common::channel::ChannelModel;
use skysink_common::geometry::{Position, above, distance_squared};
use skysink_common::message::SolverOutcome;

use crate::geometry::disks::project;
use crate::waypoint::conic::ConicSolver;
use crate::waypoint::problem::{Problem, SETTLED_M, Waypoint};

/// Solves sP2* at the mean of the scheduled positions, then at its own result, up to `iterations` times in all: as a
/// cone program by `conic`, if there is one, or exactly. `None` if no point keeps every constraint.
///
/// The paper takes one step. Each further step starts from a feasible point, where the expansion is a lower bound that
/// touches the true rate, so the rate never falls.
pub fn solve(problem: &Problem, mut conic: Option<&mut ConicSolver>, iterations: u32) -> Option<Waypoint> {
    let mut waypoint = nearest(problem, conic.as_deref_mut(), &centroid(problem, &problem.mean()))?;
    for _ in 1..iterations {
        let at = waypoint.point.xy();
        let Some(next) = nearest(problem, conic.as_deref_mut(), &centroid(problem, &at)) else {
            break;
        };
        let moved_m2 = distance_squared(&next.point.xy(), &at);
        let outcome = if waypoint.outcome == SolverOutcome::Fallback { waypoint.outcome } else { next.outcome };
        waypoint = Waypoint { point: next.point, outcome };
        if moved_m2 < SETTLED_M * SETTLED_M {
            break;
        }
    }
    Some(waypoint)
}

/// The point in all disks that is nearest to `target`; `None` if there is none.
fn nearest(problem: &Problem, conic: Option<&mut ConicSolver>, target: &Position) -> Option<Waypoint> {
    let is_exact = conic.is_none();
    let by_cones = conic.and_then(|conic| conic.project(target, &problem.disks));
    let outcome = if is_exact || by_cones.is_some() { SolverOutcome::Solved } else { SolverOutcome::Fallback };
    let ground = by_cones.or_else(|| project(target, &problem.disks))?;
    Some(Waypoint { point: above(&ground, problem.altitudes_m[0]), outcome })
}

/// The point that sP2* expanded at `q0` would choose without constraints: it maximises `−Σ c_i ‖L_i − q‖²`, where
/// `c_i = −∂r_i/∂d²` [bit/s/m²] at `q0`.
fn centroid(problem: &Problem, q0: &Position) -> Position {
    let at = above(q0, problem.altitudes_m[0]);
    let mut sum = Vector2::zeros();
    let mut weight = 0.0;
    for (position, uplink) in problem.uplinks(&at) {
        let c = -problem.channel.slopes(&uplink).by_distance2;
        sum += (position - q0) * c;
        weight += c;
    }
    // If all rates are 0 (or unbounded, H → 0), sP2* has no preference, and q0 is kept.
    if weight > 0.0 && weight.is_finite() { q0 + sum / weight } else { *q0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    use crate::keys::WaypointSolver;
    use crate::mission_table::MissionTable;
    use crate::mission_table::tests::table_of;
    use proptest::prelude::*;
    use skysink_common::channel::{Channel, FreeSpace, Uplink};

    /// sP2 for all SNs of `table`, from `position` and the letter's altitude.
    fn posed(table: &MissionTable, position: [f64; 2]) -> Problem {
        posed_at(table, position, 20.0)
    }

    fn posed_at(table: &MissionTable, position: [f64; 2], altitude_m: f64) -> Problem {
        let mut problem = Problem::new(table);
        problem.pose(table, &position.into(), [altitude_m; 2], &table.sensors.ids().collect::<Vec<_>>());
        problem
    }

    fn solved(problem: &Problem, choice: WaypointSolver, iterations: u32) -> Option<Waypoint> {
        match choice {
            WaypointSolver::Geometric => solve(problem, None, iterations),
            WaypointSolver::Clarabel => solve(problem, Some(&mut ConicSolver::default()), iterations),
        }
    }

    fn free_space(table: &MissionTable) -> FreeSpace {
        let Channel::FreeSpace(model) = &table.channel else { panic!("the letter's channel is free space") };
        model.clone()
    }

    fn assert_waypoint(problem: &Problem, expected: [f64; 2]) {
        for choice in [WaypointSolver::Geometric, WaypointSolver::Clarabel] {
            let waypoint = solved(problem, choice, 1).unwrap();
            let off_m = (waypoint.point.xy() - Position::from(expected)).norm();
            assert!(off_m < 1e-4, "{choice:?}: {}", waypoint.point);
            assert_eq!(waypoint.outcome, SolverOutcome::Solved, "{choice:?}");
        }
    }

    #[test]
    fn a_lone_sensor_node_is_flown_over() {
        assert_waypoint(&posed(&table_of(&[[50.0, 60.0]]), [50.0, 50.0]), [50.0, 60.0]);
    }

    #[test]
    fn a_lone_sensor_node_beyond_reach_is_approached_as_far_as_reach_allows() {
        assert_waypoint(&posed(&table_of(&[[50.0, 85.0]]), [50.0, 50.0]), [50.0, 80.0]);
    }

    #[test]
    fn equal_links_are_served_from_the_middle() {
        assert_waypoint(&posed(&table_of(&[[44.0, 50.0], [56.0, 50.0]]), [50.0, 50.0]), [50.0, 50.0]);
    }

    #[test]
    fn a_link_of_smaller_gradient_attracts_the_waypoint_less() {
        // q0 = (50, 50) is 6 m from both: x = 400 + 36 = 436. The first link has γ = x, the second γ = 3x, so that with
        // k = W log2(e), c_1 = k x / (x · 2x) = k/(2x) and c_2 = k 3x / (x · 4x) = 3k/(4x): weights 2 and 3.
        let mut field = table_of(&[[44.0, 50.0], [56.0, 50.0]]);
        let per_gain = free_space(&field).reference_snr(1.0);
        Arc::make_mut(&mut field.sensors).gains = vec![436.0 / per_gain, 3.0 * 436.0 / per_gain];
        assert_waypoint(&posed(&field, [50.0, 50.0]), [(2.0 * 44.0 + 3.0 * 56.0) / 5.0, 50.0]);
    }

    #[test]
    fn tangent_disks_are_served_from_their_common_point() {
        let problem = posed(&table_of(&[[50.0, 50.0], [50.0, 50.0], [50.0, 70.0]]), [50.0, 40.0]);
        let waypoint = solve(&problem, None, 1).unwrap();
        assert!((waypoint.point.xy() - Position::new(50.0, 60.0)).norm() < 1e-9, "{}", waypoint.point);
    }

    #[test]
    fn a_program_that_clarabel_fails_to_solve_is_a_reported_fallback() {
        // The disks miss each other by 0.9e-9 of their radii, which decision D5 accepts and an interior-point method
        // does not.
        let problem = posed(&table_of(&[[50.0, 50.0], [50.0, 50.0 + 20.0 * (1.0 + 0.9e-9)]]), [50.0, 40.0]);
        let waypoint = solved(&problem, WaypointSolver::Clarabel, 1).unwrap();
        assert_eq!(Some(waypoint.point), solve(&problem, None, 1).map(|exact| exact.point));
        assert_eq!(waypoint.outcome, SolverOutcome::Fallback);
    }

    #[test]
    fn a_fallback_in_any_step_is_reported_for_the_waypoint() {
        // Two disks that nearly touch, a third SN beside, and links that draw the waypoint to one side: Clarabel solves
        // some of the programs.
        let mut fallen_back = 0;
        for step in 0..100 {
            let angle = f64::from(step) / 16.0;
            let apart_m = 20.0 * (1.0 - 5e-10);
            let beside = [50.0 + apart_m * angle.cos(), 50.0 + apart_m * angle.sin()];
            let mut field = table_of(&[[50.0, 50.0], beside, [50.0, 55.0]]);
            Arc::make_mut(&mut field.sensors).gains = vec![1e-9, 1e-7, 1e-8];
            let problem = posed(&field, [50.0, 50.0]);
            let [first, last] = [1, 9].map(|iterations| solved(&problem, WaypointSolver::Clarabel, iterations));
            if first.is_some_and(|first| first.outcome == SolverOutcome::Fallback) {
                fallen_back += 1;
                assert_eq!(last.map(|last| last.outcome), Some(SolverOutcome::Fallback), "step {step}");
            }
        }
        assert!(fallen_back > 10, "only {fallen_back} of 100");
    }

    #[test]
    fn sensor_nodes_without_a_common_point_have_no_waypoint() {
        let problem = posed(&table_of(&[[50.0, 50.0], [50.0, 70.1]]), [50.0, 50.0]);
        for choice in [WaypointSolver::Geometric, WaypointSolver::Clarabel] {
            assert_eq!(solved(&problem, choice, 5), None, "{choice:?}");
        }
    }

    #[test]
    fn links_of_zero_rate_are_served_from_their_mean() {
        let mut field = table_of(&[[44.0, 50.0], [56.0, 50.0], [50.0, 53.0]]);
        Arc::make_mut(&mut field.sensors).gains = vec![0.0; 3];
        assert_waypoint(&posed(&field, [50.0, 50.0]), [50.0, 51.0]);
    }

    #[test]
    fn a_reused_problem_keeps_no_state_of_the_last_slot() {
        let field = table_of(&[[44.0, 50.0], [56.0, 50.0], [50.0, 53.0]]);
        let mut problem = posed(&field, [50.0, 50.0]);
        problem.pose(&field, &Position::new(30.0, 50.0), [20.0; 2], &[1]);
        assert_waypoint(&problem, [56.0, 50.0]);
    }

    /// How fast the rate of `uplink` falls with `d²`, `c_i` [bit/s/m²].
    fn slope(problem: &Problem, uplink: &Uplink) -> f64 {
        -problem.channel.slopes(uplink).by_distance2
    }

    /// An altitude [m] so low that the rates bend within range.
    const LOW_M: f64 = 5.0;

    /// Two to six SNs within 14 m of each other with gains [dB] that differ, over a link that is the bottleneck.
    fn clusters() -> impl Strategy<Value = MissionTable> {
        let sensor = (45.0..55.0, 45.0..55.0, -90.0..-50.0);
        prop::collection::vec(sensor, 2..7).prop_map(|sensors| {
            let positions: Vec<[f64; 2]> = sensors.iter().map(|&(x_m, y_m, _)| [x_m, y_m]).collect();
            let mut field = table_of(&positions);
            Arc::make_mut(&mut field.sensors).gains =
                sensors.iter().map(|&(.., gain_db)| 10f64.powf(gain_db / 10.0)).collect();
            field
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]

        #[test]
        fn the_slopes_are_the_derivatives_of_the_rates(field in clusters(), at in (40.0..60.0, 40.0..60.0)) {
            let problem = posed_at(&field, [50.0, 50.0], LOW_M);
            let q0 = Position::new(at.0, at.1);
            for (_, uplink) in problem.uplinks(&above(&q0, LOW_M)) {
                let beside = |step_m2: f64| Uplink { d2_m2: uplink.d2_m2 + step_m2, ..uplink };
                let rate_bps = |step_m2| field.channel.expected_rate_bps(&beside(step_m2));
                let expected = (rate_bps(-1e-3) - rate_bps(1e-3)) / 2e-3;
                prop_assert!((slope(&problem, &uplink) / expected - 1.0).abs() < 1e-4, "{expected}");
            }
        }

        #[test]
        fn no_point_of_a_fine_grid_has_a_higher_expanded_rate(field in clusters(), from in (30.0..70.0, 30.0..70.0)) {
            let problem = posed_at(&field, [from.0, from.1], LOW_M);
            let q0 = problem.mean();
            let expanded = |q: &Position| -> f64 {
                let at = above(&q0, LOW_M);
                let falls = |(at, uplink): (&Position, Uplink)| slope(&problem, &uplink) * distance_squared(at, q);
                -problem.uplinks(&at).map(falls).sum::<f64>()
            };
            let solved = solve(&problem, None, 1);
            let limit = solved.map_or(f64::NEG_INFINITY, |waypoint| expanded(&waypoint.point.xy()));
            for column in 0..=200 {
                for row in 0..=200 {
                    let q = Position::new(30.0 + 0.2 * f64::from(column), 30.0 + 0.2 * f64::from(row));
                    let feasible = problem.disks.iter().all(|disk| (q - disk.centre).norm() <= disk.radius_m);
                    prop_assert!(!feasible || expanded(&q) <= limit + 1e-9 * limit.abs(), "{q} beats {solved:?}");
                }
            }
        }

        #[test]
        fn the_true_rate_does_not_decrease_from_a_feasible_start(field in clusters(), from in (35.0..65.0, 35.0..65.0)) {
            let problem = posed_at(&field, [from.0, from.1], LOW_M);
            for (choice, slack) in [(WaypointSolver::Geometric, 1e-12), (WaypointSolver::Clarabel, 1e-9)] {
                let mut last_bps = 0.0;
                // The first result is feasible; every further expansion starts from the one before.
                for iterations in 1..=20 {
                    let Some(waypoint) = solved(&problem, choice, iterations) else {
                        break;
                    };
                    let rate_bps = problem.rate_bps(&waypoint.point);
                    let kept = rate_bps >= last_bps * (1.0 - slack);
                    prop_assert!(kept, "{choice:?}, {iterations}: {rate_bps} < {last_bps}");
                    last_bps = rate_bps;
                }
            }
        }
    }

    #[test]
    fn re_expansion_ends_at_convergence() {
        let mut field = table_of(&[[44.0, 50.0], [56.0, 50.0], [50.0, 53.0]]);
        Arc::make_mut(&mut field.sensors).gains = vec![1e-9, 1e-6, 1e-7];
        let problem = posed_at(&field, [50.0, 50.0], LOW_M);
        let at = |iterations| solve(&problem, None, iterations).unwrap().point;
        assert!((at(1) - at(2)).norm() > 1e-3, "one more step still moves");
        assert_eq!(at(500), at(1000), "hundreds of steps more do not");
    }
}
