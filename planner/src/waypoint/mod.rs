//! Where to fly: sP2 as a value, and its expansion sP2*.
//!
//! sP2 maximises the sum of the scheduled rates within reach of the UAV and in range of every scheduled sensor node.
//! sP2* expands the rates to first order in `d²`, which makes it the projection of a weighted centroid onto an
//! intersection of disks. How that is computed is left to [`crate::waypoint::geometric`] and [`crate::waypoint::conic`].

pub mod ascent;
pub mod conic;
pub mod geometric;
pub mod sca;
pub mod spatial;
pub mod spatial_solver;

use std::f64::consts::LOG2_E;

use skysink_common::geometry::{Position, distance_squared};
use skysink_common::link::Link;
use skysink_common::message::SolverOutcome;
use skysink_common::scenario::WaypointSolver;

use crate::sensor_table::SensorTable;
use conic::ConicSolver;
use geometric::Disk;

/// Re-expansion ends when the waypoint moves less than this [m].
const SETTLED_M: f64 = 1e-6;

/// sP2 of one slot. Posing the next one reuses its memory.
#[derive(Debug, Clone)]
pub struct Problem {
    link: Link,
    targets: Vec<Target>,
    /// Reach first, then the range of each target.
    disks: Vec<Disk>,
}

/// A scheduled sensor node (SN), as sP2 sees it.
#[derive(Debug, Clone, Copy)]
struct Target {
    position: Position,
    gain: f64,
}

/// A point that keeps every constraint of sP2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Waypoint {
    /// Where it is.
    pub position: Position,
    /// How it was found.
    pub outcome: SolverOutcome,
}

impl Problem {
    /// An empty problem over the links of `field` that never allocates for up to its n SNs.
    #[must_use]
    pub fn new(field: &SensorTable) -> Self {
        let served = field.resource_blocks;
        Self { link: field.link, targets: Vec::with_capacity(served), disks: Vec::with_capacity(served + 1) }
    }

    /// Poses sP2 for the SNs `ids` and the UAV at `position`, `L_u(t−1)`: `‖q − L_u(t−1)‖ ≤ V τ` and `‖q − L_i‖ ≤ d_c`.
    pub fn pose(&mut self, field: &SensorTable, position: &Position, ids: &[u32]) {
        self.targets.clear();
        self.disks.clear();
        self.disks.push(Disk { centre: *position, radius_m: field.reach_m });
        for &id in ids {
            let centre = *field.position(id);
            self.targets.push(Target { position: centre, gain: field.gains[id as usize] });
            self.disks.push(Disk { centre, radius_m: field.comm_radius_m });
        }
    }

    /// Solves sP2* at the mean of the scheduled positions, then at its own result, up to `sca_iterations` times in all.
    ///
    /// The letter takes one step. Each further one starts from a feasible point, where the expansion is a lower bound
    /// that touches the true rate, so that the rate never falls. `None` if no point keeps every constraint.
    pub fn solve(&self, solver: &mut Solver, sca_iterations: u32) -> Option<Waypoint> {
        let mut waypoint = solver.nearest(&self.centroid(&self.mean()), &self.disks)?;
        for _ in 1..sca_iterations {
            let Some(next) = solver.nearest(&self.centroid(&waypoint.position), &self.disks) else {
                break;
            };
            let moved_m2 = distance_squared(&next.position, &waypoint.position);
            let outcome = if waypoint.outcome == SolverOutcome::Fallback { waypoint.outcome } else { next.outcome };
            waypoint = Waypoint { position: next.position, outcome };
            if moved_m2 < SETTLED_M * SETTLED_M {
                break;
            }
        }
        Some(waypoint)
    }

    /// The true objective of sP2 at `q`, `Σ r_i` [bit/s] (UTS eq. 4).
    #[must_use]
    pub fn rate_bps(&self, q: &Position) -> f64 {
        self.targets.iter().map(|target| self.link.rate_bps(target.gain, distance_squared(&target.position, q))).sum()
    }

    /// Mean of the scheduled positions, the letter's expansion point.
    fn mean(&self) -> Position {
        let sum = self.targets.iter().map(|target| target.position.coords).sum::<nalgebra::Vector2<f64>>();
        (sum / self.targets.len() as f64).into()
    }

    /// The point that sP2* expanded at `q0` would choose without constraints: it maximises `−Σ c_i ‖L_i − q‖²`.
    fn centroid(&self, q0: &Position) -> Position {
        let mut sum = nalgebra::Vector2::zeros();
        let mut weight = 0.0;
        for target in &self.targets {
            let c = self.slope(target, q0);
            sum += (target.position - q0) * c;
            weight += c;
        }
        // Where no link carries anything (or any carries anything, H → 0), sP2* says nothing, and q0 is as good as any.
        if weight > 0.0 && weight.is_finite() { q0 + sum / weight } else { *q0 }
    }

    /// How fast a rate falls with `d²` at `q0`, `c_i` [bit/s/m²].
    ///
    /// `c_i = W log2(e) γ_i / (x_i (x_i + γ_i))`, `γ_i = α_i p/σ²`, `x_i = H² + ‖L_i − q0‖²`.
    fn slope(&self, target: &Target, q0: &Position) -> f64 {
        let snr = self.link.reference_snr(target.gain);
        let x_m2 = self.link.altitude_m * self.link.altitude_m + distance_squared(&target.position, q0);
        self.link.bandwidth_hz * LOG2_E * snr / (x_m2 * (x_m2 + snr))
    }
}

/// What solves sP2*.
pub enum Solver {
    /// Exactly, by plane geometry.
    Geometric,
    /// As a second-order cone program.
    Conic(Box<ConicSolver>),
}

impl Solver {
    /// The scenario's choice.
    #[must_use]
    pub fn new(choice: WaypointSolver) -> Self {
        match choice {
            WaypointSolver::Geometric => Self::Geometric,
            WaypointSolver::Clarabel => Self::Conic(Box::default()),
        }
    }

    /// The point in all `disks` that is nearest to `target`; `None` if there is none.
    pub fn nearest(&mut self, target: &Position, disks: &[Disk]) -> Option<Waypoint> {
        let solved = |position| Waypoint { position, outcome: SolverOutcome::Solved };
        let fallen_back = |position| Waypoint { position, outcome: SolverOutcome::Fallback };
        match self {
            Self::Geometric => geometric::project(target, disks).map(solved),
            Self::Conic(conic) => match conic.project(target, disks) {
                Some(position) => Some(solved(position)),
                None => geometric::project(target, disks).map(fallen_back),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor_table::tests::table_of;
    use proptest::prelude::*;

    /// sP2 for all SNs of `field`, from `position`.
    fn posed(field: &SensorTable, position: [f64; 2]) -> Problem {
        let mut problem = Problem::new(field);
        problem.pose(field, &position.into(), &field.ids().collect::<Vec<_>>());
        problem
    }

    fn assert_waypoint(problem: &Problem, expected: [f64; 2]) {
        for choice in [WaypointSolver::Geometric, WaypointSolver::Clarabel] {
            let waypoint = problem.solve(&mut Solver::new(choice), 1).unwrap();
            let off_m = (waypoint.position - Position::from(expected)).norm();
            assert!(off_m < 1e-4, "{choice:?}: {}", waypoint.position);
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
    fn the_flatter_link_draws_the_waypoint_less() {
        // q0 = (50, 50) is 6 m from both: x = 400 + 36 = 436. The first link has γ = x, the second γ = 3x, so that with
        // k = W log2(e), c_1 = k x / (x · 2x) = k/(2x) and c_2 = k 3x / (x · 4x) = 3k/(4x): weights 2 and 3.
        let mut field = table_of(&[[44.0, 50.0], [56.0, 50.0]]);
        let per_gain = field.link.reference_snr(1.0);
        field.gains = vec![436.0 / per_gain, 3.0 * 436.0 / per_gain];
        assert_waypoint(&posed(&field, [50.0, 50.0]), [(2.0 * 44.0 + 3.0 * 56.0) / 5.0, 50.0]);
    }

    #[test]
    fn touching_disks_are_served_from_the_point_between_them() {
        let problem = posed(&table_of(&[[50.0, 50.0], [50.0, 50.0], [50.0, 70.0]]), [50.0, 40.0]);
        let waypoint = problem.solve(&mut Solver::Geometric, 1).unwrap();
        assert!((waypoint.position - Position::new(50.0, 60.0)).norm() < 1e-9, "{}", waypoint.position);
    }

    #[test]
    fn a_program_that_clarabel_does_not_solve_falls_back_and_says_so() {
        // The disks miss each other by 0.9e-9 of their radii, which decision D5 accepts and an interior-point method
        // does not.
        let problem = posed(&table_of(&[[50.0, 50.0], [50.0, 50.0 + 20.0 * (1.0 + 0.9e-9)]]), [50.0, 40.0]);
        let waypoint = problem.solve(&mut Solver::new(WaypointSolver::Clarabel), 1).unwrap();
        assert_eq!(Some(waypoint.position), problem.solve(&mut Solver::Geometric, 1).map(|exact| exact.position));
        assert_eq!(waypoint.outcome, SolverOutcome::Fallback);
    }

    #[test]
    fn sensor_nodes_that_no_point_can_serve_together_have_no_waypoint() {
        let problem = posed(&table_of(&[[50.0, 50.0], [50.0, 70.1]]), [50.0, 50.0]);
        for choice in [WaypointSolver::Geometric, WaypointSolver::Clarabel] {
            assert_eq!(problem.solve(&mut Solver::new(choice), 5), None, "{choice:?}");
        }
    }

    #[test]
    fn links_that_carry_nothing_are_served_from_their_mean() {
        let mut field = table_of(&[[44.0, 50.0], [56.0, 50.0], [50.0, 53.0]]);
        field.gains = vec![0.0; 3];
        assert_waypoint(&posed(&field, [50.0, 50.0]), [50.0, 51.0]);
    }

    #[test]
    fn a_reused_problem_forgets_the_last_slot() {
        let field = table_of(&[[44.0, 50.0], [56.0, 50.0], [50.0, 53.0]]);
        let mut problem = posed(&field, [50.0, 50.0]);
        problem.pose(&field, &Position::new(30.0, 50.0), &[1]);
        assert_waypoint(&problem, [56.0, 50.0]);
    }

    /// Two to six SNs within 14 m of each other with gains [dB] that differ, over a link that is the bottleneck.
    fn clusters() -> impl Strategy<Value = SensorTable> {
        let sensor = (45.0..55.0, 45.0..55.0, -90.0..-50.0);
        prop::collection::vec(sensor, 2..7).prop_map(|sensors| {
            let places: Vec<[f64; 2]> = sensors.iter().map(|&(x_m, y_m, _)| [x_m, y_m]).collect();
            let mut field = table_of(&places);
            field.gains = sensors.iter().map(|&(.., gain_db)| 10f64.powf(gain_db / 10.0)).collect();
            field.link.altitude_m = 5.0; // low, so that the rates bend within range
            field
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]

        #[test]
        fn the_slopes_are_the_derivatives_of_the_rates(field in clusters(), at in (40.0..60.0, 40.0..60.0)) {
            let (problem, q0) = (posed(&field, [50.0, 50.0]), Position::new(at.0, at.1));
            for target in &problem.targets {
                let d2_m2 = distance_squared(&target.position, &q0);
                let rate_bps = |step_m2| field.link.rate_bps(target.gain, d2_m2 + step_m2);
                let slope = (rate_bps(-1e-3) - rate_bps(1e-3)) / 2e-3;
                prop_assert!((problem.slope(target, &q0) / slope - 1.0).abs() < 1e-4, "{slope}");
            }
        }

        #[test]
        fn no_point_of_a_fine_grid_has_a_higher_expanded_rate(field in clusters(), from in (30.0..70.0, 30.0..70.0)) {
            let problem = posed(&field, [from.0, from.1]);
            let q0 = problem.mean();
            let expanded = |q: &Position| -> f64 {
                let falls = |target: &Target| problem.slope(target, &q0) * distance_squared(&target.position, q);
                -problem.targets.iter().map(falls).sum::<f64>()
            };
            let solved = problem.solve(&mut Solver::Geometric, 1);
            let limit = solved.map_or(f64::NEG_INFINITY, |waypoint| expanded(&waypoint.position));
            for column in 0..=200 {
                for row in 0..=200 {
                    let q = Position::new(30.0 + 0.2 * f64::from(column), 30.0 + 0.2 * f64::from(row));
                    let feasible = problem.disks.iter().all(|disk| (q - disk.centre).norm() <= disk.radius_m);
                    prop_assert!(!feasible || expanded(&q) <= limit + 1e-9 * limit.abs(), "{q} beats {solved:?}");
                }
            }
        }

        #[test]
        fn the_true_rate_never_falls_from_a_feasible_start(field in clusters(), from in (35.0..65.0, 35.0..65.0)) {
            let problem = posed(&field, [from.0, from.1]);
            for (choice, slack) in [(WaypointSolver::Geometric, 1e-12), (WaypointSolver::Clarabel, 1e-9)] {
                let mut last_bps = 0.0;
                // The first result is feasible; every further expansion starts from the one before.
                for iterations in 1..=20 {
                    let Some(waypoint) = problem.solve(&mut Solver::new(choice), iterations) else {
                        break;
                    };
                    let rate_bps = problem.rate_bps(&waypoint.position);
                    let kept = rate_bps >= last_bps * (1.0 - slack);
                    prop_assert!(kept, "{choice:?}, {iterations}: {rate_bps} < {last_bps}");
                    last_bps = rate_bps;
                }
            }
        }
    }

    #[test]
    fn re_expansion_ends_where_it_settles() {
        let mut field = table_of(&[[44.0, 50.0], [56.0, 50.0], [50.0, 53.0]]);
        field.gains = vec![1e-9, 1e-6, 1e-7];
        field.link.altitude_m = 5.0;
        let problem = posed(&field, [50.0, 50.0]);
        let at = |iterations| problem.solve(&mut Solver::Geometric, iterations).unwrap().position;
        assert!((at(1) - at(2)).norm() > 1e-3, "one more step still moves");
        assert_eq!(at(500), at(1000), "hundreds of steps more do not");
    }
}
