//! An external planner: flies to the fullest queue in reach and serves the n fullest in range, as `gfs` does.
//! Start it with `skysink run SCENARIO --planner target/debug/examples/ring_planner`, or by hand.

use std::cmp::Reverse;
use std::process::ExitCode;

use skysink::worker;
use skysink_common::checkpoint::Checkpoint;
use skysink_common::geometry::{Position, above, within};
use skysink_common::message::SolverOutcome;
use skysink_planner::strategy::{Decision, Strategy, View};
use skysink_planner::waypoint::problem::Waypoint;

struct Greedy;

impl Checkpoint for Greedy {} // it has no state

impl Strategy for Greedy {
    fn plan(&mut self, view: &View<'_>) -> Option<Decision> {
        let table = view.table;
        let fullest_first = |&id: &u32| (Reverse(view.belief.queues_bits[id as usize]), id);
        let around = |place: Position, radius_m| {
            table.sensors.ids().filter(move |&id| within(table.sensors.position(id), &place, radius_m))
        };
        let goal = around(view.ground(), table.limits.reach_m).min_by_key(fullest_first)?; // without one, in transit
        let ground = *table.sensors.position(goal);
        let mut served: Vec<u32> = around(ground, table.limits.comm_radius_m).collect();
        served.sort_unstable_by_key(fullest_first);
        served.truncate(table.limits.blocks());
        served.sort_unstable();
        let waypoint = Waypoint { point: above(&ground, view.position.z), outcome: SolverOutcome::Rule };
        Some(Decision::serve(view, &waypoint, &served))
    }
}

/// Plans until the mission ends.
pub fn main() -> ExitCode {
    worker::plan_by(|_| Box::new(Greedy))
}
