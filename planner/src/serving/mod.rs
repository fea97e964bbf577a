//! The waypoint of a schedule, and the schedule of a waypoint: the last step of most strategies.

pub(crate) mod nearby;
pub mod transit;

use nalgebra::Point3;
use skysink_common::geometry::{Position, above};
use skysink_common::message::SolverOutcome;
use skysink_common::nodes::Answer;
use skysink_common::told::Told;

use crate::keys::Settings;
use crate::mission_table::MissionTable;
use crate::strategy::{Decision, Setup, View};
use crate::waypoint::Solver;
use crate::waypoint::problem::Waypoint;
use nearby::fullest_first;

/// Computes waypoints and schedules, without allocations in a slot.
pub struct Serving {
    solver: Solver,
    /// Working memory for a schedule.
    ids: Vec<u32>,
    /// Whether the most data is to be delivered.
    collects: bool,
}

impl Serving {
    /// With the solver that the scenario chooses.
    #[must_use]
    pub fn new(setup: &Setup) -> Self {
        let ids = Vec::with_capacity(setup.table.sensors.count());
        let Settings { waypoint_solver, sca_iterations, objective, .. } = *setup.settings;
        let collects = objective.is_collect();
        Self { solver: Solver::new(setup.scenario, setup.table, waypoint_solver, sca_iterations), ids, collects }
    }

    /// The best waypoint for the SNs `ids`, by sP2; `None` if no point in reach is in range of all of them.
    pub fn waypoint(&mut self, view: &View, ids: &[u32]) -> Option<Waypoint> {
        self.solver.solve(view.table, &view.position, ids)
    }

    /// The point above `ground` with the best altitude for the SNs `ids`.
    pub fn above(&mut self, view: &View, ground: &Position, ids: &[u32]) -> Point3<f64> {
        self.solver.above(view.table, ground, &view.position, ids)
    }

    /// The decision to fly to `ground`, clamped to the area, and serve the n fullest queues in range, by their values;
    /// those that upload most where data is to be collected.
    pub fn serve_fullest(&mut self, view: &View, ground: &Position) -> Decision {
        if self.collects {
            return self.serve_most(view, ground);
        }
        let ground = view.end_for(ground);
        fill_fullest_in_range(view.table, &ground, view.told(view.belief.queues_bits), &mut self.ids);
        self.decision(view, &ground)
    }

    /// As [`Self::serve_fullest`], for the n SNs in range that are expected to upload most from the altitude of the
    /// UAV, by its value.
    pub fn serve_most(&mut self, view: &View, ground: &Position) -> Decision {
        let ground = view.end_for(ground);
        let uav = above(&ground, view.position.z);
        fill_most_in_range(view.table, &uav, view.told(view.belief.queues_bits), &mut self.ids);
        self.decision(view, &ground)
    }

    /// As [`Self::serve_fullest`], for the n SNs in range with the smallest `key`, which must be unique.
    pub fn serve_by<K: Ord>(&mut self, view: &View, ground: &Position, key: impl Fn(u32) -> K) -> Decision {
        let ground = view.end_for(ground);
        fill_in_range(view.table, &ground, view.belief.answers, key, &mut self.ids);
        self.decision(view, &ground)
    }

    /// As [`Self::serve_by`], for the n SNs of most value, whatever the objective, of which those that are first come
    /// before the others.
    pub fn serve_first(&mut self, view: &View, ground: &Position, is_first: impl Fn(u32) -> bool) -> Decision {
        self.serve_by(view, ground, |id| (!is_first(id), fullest_first(view.value(id), id)))
    }

    /// The decision to fly to `end`, as a fixed flight does, and serve there those of `chosen` that are in range, then
    /// the fullest in range, or those that upload most; those that upload nothing come last.
    pub fn serve_at(&mut self, view: &View, end: Point3<f64>, chosen: &[u32]) -> Decision {
        let MissionTable { sensors, .. } = view.table;
        let queues_bits = view.belief.queues_bits;
        let key = |id: u32| {
            let bits = view.table.expected_bits(&end, &[id], queues_bits) as u32; // no more than its queue
            let most = if self.collects { sensors.weights.value(id, bits) } else { view.value(id) };
            (bits == 0, !chosen.contains(&id), fullest_first(most, id))
        };
        fill_in_range(view.table, &end.xy(), view.belief.answers, key, &mut self.ids);
        let schedule = self.ids.iter().copied().collect();
        Decision { waypoint: end, schedule, outcome: SolverOutcome::Rule, winner: None }
    }

    /// The decision to serve the SNs of the working memory from above `ground`.
    fn decision(&mut self, view: &View, ground: &Position) -> Decision {
        let Self { solver, ids, .. } = self;
        let waypoint = solver.above(view.table, ground, &view.position, ids);
        Decision { waypoint, schedule: ids.iter().copied().collect(), outcome: SolverOutcome::Rule, winner: None }
    }
}

impl Decision {
    /// The decision to serve the SNs `ids`, ascending, from a solved waypoint, clamped to the area.
    ///
    /// # Panics
    /// If there are more than [`MAX_SERVED`](skysink_common::message::MAX_SERVED) ids.
    #[must_use]
    pub fn serve(view: &View, waypoint: &Waypoint, ids: &[u32]) -> Self {
        let ground = view.table.clamp_to_area(&waypoint.point.xy());
        let point = Point3::new(ground.x, ground.y, waypoint.point.z);
        Self { waypoint: point, schedule: ids.iter().copied().collect(), outcome: waypoint.outcome, winner: None }
    }
}

/// Fills `ids` with the SNs of the n fullest queues within `d_c` of `ground`, by their values, ascending by id: of
/// equals those with the lowest. SNs that do not send are left out.
pub fn fill_fullest_in_range<'t>(
    table: &MissionTable,
    ground: &Position,
    told: impl Into<Told<'t>>,
    ids: &mut Vec<u32>,
) {
    let Told { queues_bits, answers } = told.into();
    if table.sensors.weights.are_equal() {
        // Not the values: they would look at the weights for every SN.
        return fill_in_range(table, ground, answers, |id| fullest_first(queues_bits[id as usize], id), ids);
    }
    fill_in_range(table, ground, answers, |id| fullest_first(table.value(id, queues_bits[id as usize]), id), ids);
}

/// Fills `ids` with the n SNs within `d_c` of `uav` that are expected to upload most there, by its value, ascending.
/// SNs that do not send are left out.
pub fn fill_most_in_range<'t>(table: &MissionTable, uav: &Point3<f64>, told: impl Into<Told<'t>>, ids: &mut Vec<u32>) {
    let Told { queues_bits, answers } = told.into();
    let key = |id| {
        let bits = table.expected_bits(uav, &[id], queues_bits) as u32; // no more than its queue
        fullest_first(table.sensors.weights.value(id, bits), id)
    };
    fill_in_range(table, &uav.xy(), answers, key, ids);
}

/// Fills `ids` with the n SNs within `d_c` of `ground` that have the smallest `key`, ascending by id; of those that
/// send by their `answers`, by id, or of all if there are none.
fn fill_in_range<K: Ord>(
    table: &MissionTable,
    ground: &Position,
    answers: &[Answer],
    key: impl Fn(u32) -> K,
    ids: &mut Vec<u32>,
) {
    let MissionTable { sensors, limits, .. } = table;
    ids.clear();
    sensors.grid.visit_within(ground, limits.comm_radius_m, |node| {
        if answers.get(node.id as usize).is_none_or(|answer| answer.sends()) {
            ids.push(node.id);
        }
    });
    let blocks = limits.blocks();
    if ids.len() > blocks {
        ids.select_nth_unstable_by_key(blocks, |&id| key(id));
        ids.truncate(blocks);
    }
    ids.sort_unstable();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mission_table::tests::table_of;
    use crate::strategy::tests::{field, view};

    /// The n fullest queues in range.
    fn fullest(table: &MissionTable, ground: [f64; 2], queues_bits: &[u32]) -> Vec<u32> {
        let mut ids = vec![77];
        fill_fullest_in_range(table, &ground.into(), queues_bits, &mut ids);
        ids
    }

    #[test]
    fn the_fullest_queues_in_range_are_served_in_ascending_order() {
        let table = table_of(&[[50.0, 50.0], [51.0, 50.0], [60.0, 50.0], [60.1, 50.0], [52.0, 50.0], [53.0, 50.0]]);
        // SN 3 is 10.1 m away. n = 4 of the rest: 9, 8, then the two lowest indices of the three that hold 3.
        assert_eq!(fullest(&table, [50.0, 50.0], &[3, 3, 9, 99, 8, 3]), [0, 1, 2, 4]);
        assert_eq!(fullest(&table, [0.0, 0.0], &[3, 3, 9, 99, 8, 3]), [0; 0]);
    }

    #[test]
    fn a_waypoint_rounded_outside_the_area_is_moved_to_its_border() {
        let field = field([([100.0, 50.0], 100.0, 30_000)].into_iter());
        let view = view(&field.table, 1, [90.0, 50.0], &[9]);
        let decision = Serving::new(&field.setup()).serve_fullest(&view, &Position::new(100.0 + 1e-12, 50.0));
        assert_eq!((decision.waypoint, &decision.schedule[..]), (Point3::new(100.0, 50.0, 20.0), &[0][..]));
    }

    #[test]
    fn an_empty_queue_is_served_while_blocks_are_free() {
        assert_eq!(fullest(&table_of(&[[50.0, 50.0], [51.0, 50.0]]), [50.0, 50.0], &[0, 0]), [0, 1]);
    }

    #[test]
    fn a_priority_key_precedes_the_queue_in_range() {
        let table = table_of(&[[50.0, 50.0], [51.0, 50.0], [52.0, 50.0], [53.0, 50.0], [54.0, 50.0], [90.0, 90.0]]);
        let queues_bits = [1, 5, 6, 7, 8, 9];
        let key = |id: u32| (![0, 5].contains(&id), fullest_first(queues_bits[id as usize], id));
        let mut ids = Vec::new();
        fill_in_range(&table, &Position::new(50.0, 50.0), &[], key, &mut ids);
        assert_eq!(ids, [0, 2, 3, 4]);
    }
}
