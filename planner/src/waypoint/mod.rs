//! The waypoint of a schedule: sP2, solved in each slot by the scenario's solver.
//!
//! If the rate depends on the distance alone, [`plane`] solves sP2* at the UAV's altitude; otherwise [`ascent`] and
//! [`sca`] search in three dimensions. Solver outcomes are determined in this file.

pub mod ascent;
pub mod conic;
pub mod plane;
pub mod problem;
pub mod sca;

use nalgebra::Point3;
use skysink_common::channel::ChannelModel;
use skysink_common::geometry::{Position, above};
use skysink_common::message::SolverOutcome;
use skysink_common::scenario::Scenario;

use crate::keys::WaypointSolver;
use crate::mission_table::MissionTable;
use conic::ConicSolver;
use problem::{Problem, RatedPoint, Waypoint};
use sca::Contribution;

/// Relative difference in rate below which two ends are equally good.
const CONFIRMED: f64 = 1e-6;

/// The solver of a mission, with its working memory.
pub struct Solver {
    scenario: Scenario,
    problem: Problem,
    starts: Vec<RatedPoint>,
    /// Most expansions, 1 to 1000.
    iterations: u32,
    /// None where the solver is geometric.
    conic: Option<ConicSolver>,
}

impl Solver {
    /// The solver `choice` of a scenario over the SNs of `table`, with at most `iterations` expansions, 1 to 1000.
    #[must_use]
    pub fn new(scenario: &Scenario, table: &MissionTable, choice: WaypointSolver, iterations: u32) -> Self {
        let is_conic = choice == WaypointSolver::Clarabel;
        Self {
            scenario: scenario.clone(),
            problem: Problem::new(table),
            starts: Vec::with_capacity(2 * table.limits.blocks() + 2),
            iterations,
            conic: is_conic.then(ConicSolver::default),
        }
    }

    /// The waypoint from which the SNs `ids` are expected to send most, for the UAV at `uav`, `L_u(t−1)`; `None` if no
    /// point keeps every constraint.
    pub fn solve(&mut self, table: &MissionTable, uav: &Point3<f64>, ids: &[u32]) -> Option<Waypoint> {
        self.problem.pose(table, &uav.xy(), self.scenario.altitudes_m(uav.z), ids);
        if !table.channel.depends_on_elevation() {
            return plane::solve(&self.problem, self.conic.as_mut(), self.iterations);
        }
        ascent::fill_starts(&self.problem, &mut self.starts);
        let alone = ascent::best_end(&self.problem, &self.starts)?;
        if self.conic.is_none() || table.has_levels() {
            return Some(Waypoint { point: alone.point, outcome: SolverOutcome::Solved });
        }
        self.approximate(alone)
    }

    /// Convex steps from the best starts, each followed by ascent; or `alone`, the end of the ascent without them, if
    /// it is clearly better, such as when a step has left the peak above an SN.
    fn approximate(&self, alone: RatedPoint) -> Option<Waypoint> {
        let ends = self.starts.iter().map(|start| {
            let (stepped, contribution) = sca::approximate(&self.problem, *start, self.iterations);
            let end = ascent::climb(&self.problem, stepped);
            (end, outcome(contribution, stepped, end))
        });
        let (end, outcome) = ends.reduce(|best, end| if end.0.rate_bps > best.0.rate_bps { end } else { best })?;
        if alone.rate_bps > end.rate_bps * (1.0 + CONFIRMED) {
            return Some(Waypoint { point: alone.point, outcome: SolverOutcome::Fallback });
        }
        Some(Waypoint { point: end.point, outcome })
    }

    /// The point above `ground` with the highest expected rate of the SNs `ids`, at an altitude that the UAV at `uav`
    /// reaches in one slot; at the UAV's altitude if `ids` is empty.
    pub fn above(&mut self, table: &MissionTable, ground: &Position, uav: &Point3<f64>, ids: &[u32]) -> Point3<f64> {
        let altitudes_m = self.scenario.altitudes_m(uav.z);
        let altitude_m = if ids.is_empty() || !table.channel.depends_on_elevation() {
            uav.z.max(altitudes_m[0]).min(altitudes_m[1])
        } else {
            self.problem.pose(table, ground, altitudes_m, ids);
            self.problem.best_altitude_m(ground)
        };
        above(ground, altitude_m)
    }
}

/// The outcome of an ascent from `stepped` to `end`: solved if Clarabel moved the start uphill, or confirmed a start
/// from which the ascent leads no higher.
fn outcome(contribution: Contribution, stepped: RatedPoint, end: RatedPoint) -> SolverOutcome {
    let is_end = end.rate_bps <= stepped.rate_bps * (1.0 + CONFIRMED);
    match contribution {
        Contribution::Moved => SolverOutcome::Solved,
        Contribution::Confirmed if is_end => SolverOutcome::Solved,
        Contribution::Confirmed | Contribution::Nothing => SolverOutcome::Fallback,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::disks::Disk;
    use crate::waypoint::problem::tests::{dense_urban, posed};
    use skysink_common::channel::{LineOfSight, LosCurve, Sight};
    use skysink_common::scenario::Overrides;

    #[test]
    fn the_ascent_is_used_where_convex_steps_end_lower() {
        // A link that is better out of line of sight, where the SN is served best from beside it. A convex step leads
        // right above it instead, where the tip holds the ascent.
        let curve = LosCurve::Sigmoid { a: 9.66, b: 0.067 };
        let link =
            LineOfSight { sight: Sight::Curve(curve), los_snr: 2e4, nlos_snr: 2e4, los_exponent: 4.0, ..dense_urban() };
        let mut problem = posed(link, &[[18.0, 7.0]], [12.0, 60.0]);
        problem.disks[0] = Disk { centre: Position::new(-290.0, 235.0), radius_m: 500.0 };
        problem.disks[1].radius_m = 30.0;
        let scenario = Scenario::letter(Overrides::default()).unwrap();
        let mut solver = Solver { scenario, problem, starts: Vec::new(), iterations: 2, conic: None };
        ascent::fill_starts(&solver.problem, &mut solver.starts);
        let alone = ascent::best_end(&solver.problem, &solver.starts).unwrap();
        let beside_m = (alone.point.xy() - Position::new(18.0, 7.0)).norm();
        assert!(beside_m > 0.1, "{alone:?}");
        let waypoint = solver.approximate(alone).unwrap();
        assert_eq!(waypoint, Waypoint { point: alone.point, outcome: SolverOutcome::Fallback });
    }
}
