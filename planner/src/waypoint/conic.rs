//! The conic waypoint solver: the projection onto an intersection of disks as a second-order cone program, by Clarabel.
//!
//! It solves the same problem as [`crate::geometry::disks`], as an independent check. Only this file, `cone_program`
//! and what is written with it depend on Clarabel.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus, SupportedConeT};
use skysink_common::geometry::{Position, distance_squared};

use crate::cone_program;
use crate::geometry::disks::{self, Disk};

/// Rows of a cone: `(r, q − centre)`.
const ROWS: usize = 3;

/// Constraint violation allowed to the solver, in radii.
const FEASIBILITY: f64 = 1e-9;

/// Gap allowed between its objective and the optimum, in squares of the smallest radius.
///
/// The objective is flat at its optimum, `½‖v‖²`, so that a gap ε can hide a distance `sqrt(2 ε)`: 4e-5 m at 10 m.
const GAP: f64 = 1e-11;

/// Farthest that a solution may lie from the disks, in units of the smallest radius, to count as one.
const FARTHEST_PULL: f64 = 1e-4;

/// Clarabel, with one solver per number of disks.
///
/// A solver is created once per shape; then only its data are replaced. Settings that carry state from one problem to
/// the next, such as equilibration, are disabled, so that a result does not depend on earlier problems.
#[derive(Default)]
pub struct ConicSolver {
    /// By number of disks.
    kept: Vec<Option<DefaultSolver<f64>>>,
    /// Non-zeros of the constraint matrix and right-hand side, handed to the solver.
    matrix: Vec<f64>,
    offsets: Vec<f64>,
}

impl ConicSolver {
    /// The point of all `disks` that is nearest to `target`.
    ///
    /// `None` if Clarabel does not report `Solved`, or its solution is too far outside the disks: the caller has to
    /// fall back. There is at least one disk.
    pub fn project(&mut self, target: &Position, disks: &[Disk]) -> Option<Position> {
        let unit_m = disks.iter().map(|disk| disk.radius_m).fold(f64::INFINITY, f64::min);
        let solution = target + self.solve(target, disks, unit_m)? * unit_m;
        // An interior-point solution may lie a little outside, where decision D5 would refuse a sensor node.
        let pulled = disks::project(&solution, disks)?;
        let farthest_m = FARTHEST_PULL * unit_m;
        (distance_squared(&pulled, &solution) <= farthest_m * farthest_m).then_some(pulled)
    }

    /// Minimises `½‖v‖²` subject to `‖v − v_j‖ ≤ ρ_j` for every disk, all lengths from `target` and in units of
    /// `unit_m`, as `b − A v ∈ K`, per disk with the rows `(1, (v − v_j)/ρ_j)`.
    ///
    /// Each cone is divided by its own `ρ_j`, so that reach and range weigh the same whatever their radii.
    fn solve(&mut self, target: &Position, disks: &[Disk], unit_m: f64) -> Option<nalgebra::Vector2<f64>> {
        let Self { kept, matrix, offsets } = self;
        matrix.clear();
        offsets.clear();
        for _column in 0..2 {
            matrix.extend(disks.iter().map(|disk| -unit_m / disk.radius_m));
        }
        for disk in disks {
            let from_target = (disk.centre - target) / disk.radius_m;
            offsets.extend([1.0, -from_target.x, -from_target.y]);
        }
        if kept.len() <= disks.len() {
            kept.resize_with(disks.len() + 1, || None);
        }
        let solver = kept[disks.len()].get_or_insert_with(|| template(disks.len()));
        solver.update_A(matrix).expect("presolve is off and the shape is the kept one's");
        solver.update_b(offsets).expect("presolve is off and the shape is the kept one's");
        solver.solve();
        (solver.solution.status == SolverStatus::Solved)
            .then(|| nalgebra::Vector2::new(solver.solution.x[0], solver.solution.x[1]))
    }
}

/// A solver with the right shape and placeholder data: `P = I`, `q = 0`, one non-zero per disk in each column of `A`.
fn template(disks: usize) -> DefaultSolver<f64> {
    let rows = (0..disks).map(|disk| disk * ROWS + 1).chain((0..disks).map(|disk| disk * ROWS + 2)).collect();
    let columns = vec![0, disks, 2 * disks];
    let constraints = CscMatrix::new(disks * ROWS, 2, columns, rows, vec![-1.0; 2 * disks]);
    let offsets: Vec<f64> = (0..disks).flat_map(|_| [1.0, 0.0, 0.0]).collect();
    let cones = vec![SupportedConeT::SecondOrderConeT(ROWS); disks];
    let settings = DefaultSettings {
        equilibrate_enable: false, // nothing is fitted to the first problem's data
        tol_feas: FEASIBILITY,
        tol_gap_abs: GAP,
        tol_gap_rel: GAP,
        ..cone_program::settings()
    };
    DefaultSolver::new(&CscMatrix::identity(2), &[0.0; 2], &constraints, &offsets, &cones, settings)
        .expect("the shapes agree by construction")
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn disk(x_m: f64, y_m: f64, radius_m: f64) -> Disk {
        Disk { centre: Position::new(x_m, y_m), radius_m }
    }

    #[test]
    fn the_nearest_point_of_a_lens_is_its_corner() {
        // Circles of radius 10 about (±6, 0) cross at (0, ±8): 6² + 8² = 10².
        let disks = [disk(-6.0, 0.0, 10.0), disk(6.0, 0.0, 10.0)];
        let nearest = ConicSolver::default().project(&Position::new(0.0, 30.0), &disks).unwrap();
        assert!((nearest - Position::new(0.0, 8.0)).norm() < 1e-6, "{nearest}");
    }

    #[test]
    fn disjoint_disks_are_refused() {
        let disks = [disk(-10.1, 0.0, 10.0), disk(10.1, 0.0, 10.0)];
        assert_eq!(ConicSolver::default().project(&Position::origin(), &disks), None);
    }

    #[test]
    fn a_solution_outside_the_disks_is_rejected() {
        // A reach of 1 m at the rim of a range of 5 km, to whose distance Clarabel's tolerance is relative.
        let mut refused = 0;
        for step in 0..100 {
            let away = |angle: f64, away_m: f64| [away_m * angle.cos(), away_m * angle.sin()];
            let [x_m, y_m] = away(0.7 * f64::from(step), 5_001.0 - 1e-5);
            let disks = [disk(x_m, y_m, 1.0), disk(0.0, 0.0, 5_000.0)];
            let target = Position::from(away(1.1 * f64::from(step), 25.0 * f64::from(step % 20)));
            let solution = ConicSolver::default().solve(&target, &disks, 1.0).map(|solution| target + solution);
            let pulled = ConicSolver::default().project(&target, &disks);
            let off_m = solution.zip(pulled).map(|(solution, pulled)| (solution - pulled).norm());
            assert!(off_m.is_none_or(|off_m| off_m <= FARTHEST_PULL), "step {step}: {off_m:?}");
            refused += u32::from(solution.is_some() && pulled.is_none());
        }
        assert!(refused > 0);
    }

    #[test]
    fn a_result_does_not_depend_on_earlier_problems() {
        let mut used = ConicSolver::default();
        for step in 0..60 {
            let shift_m = f64::from(step);
            let mut disks =
                vec![disk(0.0, 0.0, 30.0), disk(shift_m / 3.0, 4.0, 10.0), disk(1e-3 * shift_m, -5.0, 10.0)];
            disks.truncate(1 + step as usize % 3);
            let target = Position::new(40.0 - shift_m, shift_m * shift_m / 50.0);
            let fresh = ConicSolver::default().project(&target, &disks);
            assert_eq!(used.project(&target, &disks), fresh, "step {step}");
        }
    }

    /// Offsets [m] and radii that make random, tangent, nested and coincident disks, all within sight of the origin.
    fn problems() -> impl Strategy<Value = (Position, Vec<Disk>)> {
        let coordinate = || prop_oneof![-12.0..12.0, (-2i32..=2).prop_map(|step| f64::from(step) * 5.0)];
        let position = move || (coordinate(), coordinate()).prop_map(|(x_m, y_m)| Position::new(x_m, y_m));
        let reach = (position(), prop_oneof![Just(30.0), Just(3_000.0), 5.0..40.0]);
        (position(), reach, prop::collection::vec(position(), 1..6)).prop_map(|(target, (from, radius_m), centres)| {
            let mut disks = vec![Disk { centre: from, radius_m }];
            disks.extend(centres.into_iter().map(|centre| Disk { centre, radius_m: 10.0 }));
            (Position::from(target.coords * 2.0), disks)
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4_000))]

        #[test]
        fn both_solvers_agree_to_a_millimetre((target, disks) in problems()) {
            let exact = disks::project(&target, &disks);
            if let Some(conic) = ConicSolver::default().project(&target, &disks) {
                let off_m = (conic - exact.expect("the conic answer lies in all disks")).norm();
                prop_assert!(off_m <= 1e-3, "{off_m} m apart: {conic}");
                prop_assert!(disks.iter().all(|disk| disk.contains(&conic)));
            }
        }

        #[test]
        fn a_target_among_the_centres_is_solved_without_a_fallback(
            target in (-4.0..4.0, -4.0..4.0),
            centres in prop::collection::vec((-4.0..4.0, -4.0..4.0), 1..8),
        ) {
            // All centres are within 4·√2 = 5.7 m of the origin, so that a disk of 4.3 m about it is in all of them.
            let disks: Vec<Disk> = centres.iter().map(|&(x_m, y_m)| disk(x_m, y_m, 10.0)).collect();
            let target = Position::new(target.0, target.1);
            let exact = disks::project(&target, &disks).expect("the origin is in all disks");
            let conic = ConicSolver::default().project(&target, &disks);
            prop_assert!(conic.is_some_and(|conic| (conic - exact).norm() <= 1e-4), "{conic:?}, {exact}");
        }

        #[test]
        fn a_nearly_empty_lens_gives_the_same_point_or_none(
            angle in 0.0..std::f64::consts::TAU,
            overlap_m in prop_oneof![Just(0.0), 0.0..1e-7, 0.0..1e-3],
            target in (-20.0..20.0, -20.0..20.0),
        ) {
            let to_centre = nalgebra::Vector2::new(angle.cos(), angle.sin()) * (10.0 - overlap_m);
            let disks = [to_centre, -to_centre].map(|centre| Disk { centre: centre.into(), radius_m: 10.0 });
            let target = Position::new(target.0, target.1);
            let exact = disks::project(&target, &disks).expect("the origin is in both disks");
            if let Some(conic) = ConicSolver::default().project(&target, &disks) {
                prop_assert!((conic - exact).norm() <= 1e-3, "{conic}, {exact}");
            }
        }
    }
}
