//! A custom strategy in the paper's field: flies to the nearest sensor node with at least 5 000 bit, and serves only
//! that one.

use skysink_common::checkpoint::Checkpoint;
use skysink_common::geometry::{above, distance_squared, within};
use skysink_common::message::SolverOutcome;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::Mission;
use skysink_planner::strategy::{Decision, Strategy, View};
use skysink_planner::waypoint::problem::Waypoint;

struct Nearest;

impl Checkpoint for Nearest {} // it has no state

impl Strategy for Nearest {
    fn plan(&mut self, view: &View<'_>) -> Option<Decision> {
        let table = view.table;
        let uav = view.ground();
        let away_m2 = |id: u32| distance_squared(table.sensors.position(id), &uav);
        let waiting = table.sensors.ids().filter(|&id| view.belief.queues_bits[id as usize] >= 5_000);
        let nearest = waiting.min_by(|&a, &b| away_m2(a).total_cmp(&away_m2(b)))?;
        let ground = table.motion.toward(&uav, table.sensors.position(nearest));
        let is_in_range = within(table.sensors.position(nearest), &ground, table.limits.comm_radius_m);
        let waypoint = Waypoint { point: above(&ground, view.position.z), outcome: SolverOutcome::Rule };
        let served = if is_in_range { vec![nearest] } else { vec![] };
        Some(Decision::serve(view, &waypoint, &served))
    }
}

/// Simulates the mission and prints its loss.
pub fn main() {
    let scenario = Scenario::letter(Overrides::default()).expect("built in");
    let list = SensorList::of(&scenario).expect("drawn");
    let mission = Mission::by(&scenario, &list, &mut |_| Ok(Box::new(Nearest)), &Stop::default());
    let mission = mission.expect("a checked scenario");
    let totals = mission.last().expect("at least one slot").header.totals;
    println!("lost {} of {} bit", totals.lost_bits, totals.sampled_bits);
    assert!(totals.is_balanced() && totals.delivered_bits > 0);
}
