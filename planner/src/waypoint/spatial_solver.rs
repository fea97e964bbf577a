//! Poses and solves the three-dimensional waypoint of a slot with the scenario's choice of solver.
//!
//! Which solver contributed what is decided here, in one place; how each works is left to [`crate::waypoint::ascent`] and
//! [`crate::waypoint::sca`].

use nalgebra::Point3;
use skysink_common::geometry::Position;
use skysink_common::los::LosLink;
use skysink_common::message::SolverOutcome;
use skysink_common::scenario::{PlannerChoice, WaypointSolver};

use crate::sensor_table::SensorTable;
use crate::waypoint::ascent::{self, Rated, Starts};
use crate::waypoint::sca::{self, Contribution};
use crate::waypoint::spatial::SpatialProblem;

/// Relative difference in rate below which two ends are equally good.
const CONFIRMED: f64 = 1e-6;

/// A point that keeps every constraint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpatialWaypoint {
    /// Where it is.
    pub point: Point3<f64>,
    /// How it was found.
    pub outcome: SolverOutcome,
}

/// The solver of a mission, with its working memory.
#[derive(Debug, Clone)]
pub struct SpatialSolver {
    problem: SpatialProblem,
    starts: Starts,
    choice: PlannerChoice,
}

impl SpatialSolver {
    /// The scenario's solver over `link` for up to `served` SNs.
    #[must_use]
    pub fn new(link: LosLink, choice: PlannerChoice, served: usize) -> Self {
        Self { problem: SpatialProblem::new(link, served), starts: Starts::with_room_for(served), choice }
    }

    /// The waypoint from which the SNs `ids` are expected to send most, for the UAV at `position`; `None` if no point
    /// keeps every constraint.
    pub fn solve(
        &mut self,
        field: &SensorTable,
        position: &Position,
        altitudes_m: [f64; 2],
        ids: &[u32],
    ) -> Option<SpatialWaypoint> {
        self.problem.pose(field, position, altitudes_m, ids);
        match self.choice.waypoint_solver {
            WaypointSolver::Geometric => {
                let end = ascent::solve(&self.problem, &mut self.starts)?;
                Some(SpatialWaypoint { point: end.point, outcome: SolverOutcome::Solved })
            }
            WaypointSolver::Clarabel => self.approximate(),
        }
    }

    /// Convex steps from the best starts, each finished by ascent; the ascent alone where that leads visibly higher, as it
    /// may where a step leaves the tip above an SN.
    fn approximate(&mut self) -> Option<SpatialWaypoint> {
        let problem = &self.problem;
        let ends = self.starts.of(problem).iter().map(|start| {
            let (stepped, contribution) = sca::approximate(problem, *start, self.choice.sca_iterations);
            let end = ascent::climb(problem, stepped);
            (end, outcome(contribution, stepped, end))
        });
        let (end, outcome) = ends.reduce(|best, end| if end.0.rate_bps > best.0.rate_bps { end } else { best })?;
        let alone = ascent::solve(problem, &mut self.starts)?;
        if alone.rate_bps > end.rate_bps * (1.0 + CONFIRMED) {
            return Some(SpatialWaypoint { point: alone.point, outcome: SolverOutcome::Fallback });
        }
        Some(SpatialWaypoint { point: end.point, outcome })
    }

    /// The altitude [m] in `altitudes_m` from which the SNs `ids` are expected to send most to the UAV above `ground`;
    /// with nobody to serve, the one nearest to `altitude_m`.
    pub fn altitude_above(
        &mut self,
        field: &SensorTable,
        ground: &Position,
        altitudes_m: [f64; 2],
        altitude_m: f64,
        ids: &[u32],
    ) -> f64 {
        if ids.is_empty() {
            return altitude_m.max(altitudes_m[0]).min(altitudes_m[1]);
        }
        self.problem.pose(field, ground, altitudes_m, ids);
        self.problem.best_altitude_m(ground)
    }
}

/// Whose the `end` of an ascent is: Clarabel's if it moved the start uphill, or called its own result, `stepped`, the end
/// and was right.
fn outcome(contribution: Contribution, stepped: Rated, end: Rated) -> SolverOutcome {
    let right = end.rate_bps <= stepped.rate_bps * (1.0 + CONFIRMED);
    match contribution {
        Contribution::Moved => SolverOutcome::Solved,
        Contribution::Confirmed if right => SolverOutcome::Solved,
        Contribution::Confirmed | Contribution::Nothing => SolverOutcome::Fallback,
    }
}
