//! Flights, queues and sensor nodes as the planner gets them.

use skysink_common::geometry::{Position, above};
use skysink_common::message::{HoldReason, PathPoint, SensorNode, is_possible_path};
use skysink_common::scenario::Scenario;
use skysink_flight_sim::Flight;
use skysink_planner::Planner;
use skysink_planner::settings::Knowledge;
use skysink_planner::strategies::names;

use super::flight_message::report;
use super::world::{SEEN, WORLDS, planned};
use crate::cursor::Cursor;

/// Whatever it is told, the planner answers with at most n known sensor nodes; and if the UAV is where it can be, over
/// the scenario's own sensor nodes, the UAV can do all that the plan says, and the path is one.
///
/// # Panics
/// If not.
pub fn planner_message(bytes: &[u8]) {
    let mut input = Cursor::new(bytes);
    let choice = usize::from(input.u8());
    let world = &WORLDS[choice % WORLDS.len()];
    let (knowledge, rates) = SEEN[choice / WORLDS.len() % SEEN.len()];
    let strategy = names()[usize::from(input.u8()) % names().len()];
    let scenario = planned(&world.scenario, strategy, (knowledge, rates));
    let foreign = input.u8() % 4;
    let mut nodes = world.nodes.clone();
    for node in nodes.iter_mut().take(foreign.into()) {
        let (x_m, y_m, gain) = (input.f64(), input.f64(), input.f64());
        *node = SensorNode { x_m, y_m, gain, ..*node };
    }
    let mut planner = Planner::new(&scenario, &nodes).expect("its keys were checked");
    for _ in 0..2 {
        let (slot, position, altitude_m) = (input.u64(), Position::new(input.f64(), input.f64()), input.f64());
        let queues: Vec<u32> = nodes.iter().map(|_| input.u32()).collect();
        if knowledge != Knowledge::Oracle {
            planner.observe(input.u64(), &report(&mut input, 2), &queues);
        }
        let plan = planner.step(slot, above(&position, altitude_m), &queues);
        let ids = plan.scheduled();
        assert!(plan.served as usize == ids.len() && ids.len() <= scenario.link.resource_blocks, "{plan:?}");
        assert!(ids.iter().all(|&id| (id as usize) < nodes.len()) && ids.is_sorted_by(|a, b| a < b), "{plan:?}");
        if foreign == 0 && possible(&scenario, &position, altitude_m) {
            let mut flight = Flight::new(&scenario, &nodes);
            let mut here = flight.start();
            (here.x_m, here.y_m, here.z_m) = (position.x, position.y, altitude_m);
            flight.restore(&here);
            let report = flight.step(slot, Some(&plan));
            assert_eq!((report.hold, report.refused), (HoldReason::None as u32, 0), "{plan:?} from {here:?}");
            let path: Vec<_> = planner.path().iter().copied().map(PathPoint::from).collect();
            assert!(is_possible_path(&path, &scenario.area), "{path:?} from {here:?}");
        }
    }
}

/// Whether the UAV can be there.
fn possible(scenario: &Scenario, position: &Position, altitude_m: f64) -> bool {
    let uav = scenario.uav;
    let high = uav.climb().map_or(altitude_m == uav.altitude_m, |climb| {
        (climb.min_altitude_m..=climb.max_altitude_m).contains(&altitude_m)
    });
    scenario.area.contains(position, 0.0) && high
}
