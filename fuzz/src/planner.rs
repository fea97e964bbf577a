//! A planner that is told anything, or given any checkpoint.

use arbitrary::{Result, Unstructured};
use skysink_common::checkpoint::Checkpoint;
use skysink_common::geometry::{Position, above};
use skysink_common::message::{FlightReport, Mode, PathPoint, Plan, SensorNode, is_possible_path};
use skysink_common::scenario::Scenario;
use skysink_flight_sim::Flight;
use skysink_mission::mission::Mission;
use skysink_planner::Planner;
use skysink_planner::settings::Knowledge;
use skysink_planner::strategies::names;

use crate::messages::report;
use crate::scratch::{file, spoil};
use crate::world::{SEEN, WORLDS, World, planned};

/// Slots that are flown before a checkpoint is saved.
const FLOWN_SLOTS: u64 = 6;

/// Whatever it is told, the planner schedules known sensor nodes; the UAV can fly the plan from wherever it can be.
pub fn message(u: &mut Unstructured) -> Result<()> {
    let choice = usize::from(u.arbitrary::<u8>()?);
    let world = &WORLDS[choice % WORLDS.len()];
    let (knowledge, rates) = SEEN[choice / WORLDS.len() % SEEN.len()];
    let scenario = planned(&world.scenario, strategy(u)?, (knowledge, rates));
    let foreign = u.arbitrary::<u8>()? % 4;
    let mut nodes = world.nodes.clone();
    for node in nodes.iter_mut().take(foreign.into()) {
        let [x_m, y_m, gain] = u.arbitrary()?;
        *node = SensorNode { x_m, y_m, gain, ..*node };
    }
    let mut planner = Planner::new(&scenario, &nodes).expect("its keys were checked");
    for _ in 0..2 {
        let slot = u.arbitrary()?;
        let [x_m, y_m, altitude_m] = u.arbitrary()?;
        let position = Position::new(x_m, y_m);
        let queues = queues(u, world)?;
        if knowledge != Knowledge::Oracle {
            planner.observe(u.arbitrary()?, &report(u, 2)?, &queues);
        }
        let plan = planner.step(slot, above(&position, altitude_m), &queues);
        let ids = plan.scheduled();
        assert!(plan.served as usize == ids.len() && ids.len() <= scenario.link.resource_blocks, "{plan:?}");
        assert!(ids.iter().all(|&id| (id as usize) < nodes.len()) && ids.is_sorted_by(|a, b| a < b), "{plan:?}");
        if foreign == 0 && possible(&scenario, &position, altitude_m) {
            let here = FlightReport::at(above(&position, altitude_m), Mode::Hold);
            fly(&scenario, world, &here, slot, &plan);
            let path: Vec<_> = planner.path().iter().copied().map(PathPoint::from).collect();
            assert!(is_possible_path(&path, &scenario.area), "{path:?} from {here:?}");
        }
    }
    Ok(())
}

/// A planner refuses a spoilt checkpoint and is as it was, or resumes from it and plans what the UAV can do.
pub fn checkpoint(u: &mut Unstructured) -> Result<()> {
    let world = &WORLDS[usize::from(u.arbitrary::<u8>()?) % WORLDS.len()];
    let strategy = strategy(u)?;
    let scenario = planned(&world.scenario, strategy, SEEN[usize::from(u.arbitrary::<u8>()?) % SEEN.len()]);
    let queues = queues(u, world)?;
    let mut mission = Mission::new(&scenario, &world.list).expect("its keys were checked");
    mission.by_ref().take(FLOWN_SLOTS as usize).for_each(drop);
    let here = *mission.last_flight();
    let planner = mission.planner_mut();
    let lived = saved(planner);
    let path = file("checkpoint", &lived);
    spoil(&path, u)?;
    let checkpoint = std::fs::read(path).expect("the checkpoint is there");
    if planner.restore(&checkpoint).is_err() {
        assert_eq!(saved(planner), lived);
        assert_ne!(checkpoint, lived, "a checkpoint of its own is refused");
    }
    planner.observe(FLOWN_SLOTS, &here, &queues);
    let plan = planner.step(FLOWN_SLOTS + 1, here.position(), &queues);
    let report = fly(&scenario, world, &here, FLOWN_SLOTS + 1, &plan);
    let mut again = Planner::new(&scenario, &world.nodes).expect("its keys were checked");
    again.restore(&saved(planner)).expect("what a planner saves is a checkpoint");
    assert_eq!(saved(&again), saved(planner));
    let [plan, same] = [planner, &mut again].map(|planner| {
        planner.observe(FLOWN_SLOTS + 1, &report, &queues);
        planner.step(FLOWN_SLOTS + 2, report.position(), &queues)
    });
    assert_eq!(format!("{plan:?}"), format!("{same:?}"));
    Ok(())
}

fn strategy(u: &mut Unstructured) -> Result<&'static str> {
    Ok(names()[usize::from(u.arbitrary::<u8>()?) % names().len()])
}

/// The queue [bit] of each sensor node.
fn queues(u: &mut Unstructured, world: &World) -> Result<Vec<u32>> {
    world.nodes.iter().map(|_| u.arbitrary()).collect()
}

/// Whether the UAV can be there.
fn possible(scenario: &Scenario, position: &Position, altitude_m: f64) -> bool {
    let uav = scenario.uav;
    let high = uav.climb().map_or(altitude_m == uav.altitude_m, |climb| {
        (climb.min_altitude_m..=climb.max_altitude_m).contains(&altitude_m)
    });
    scenario.area.contains(position, 0.0) && high
}

fn saved(planner: &Planner) -> Vec<u8> {
    let mut bytes = Vec::new();
    planner.save(&mut bytes);
    bytes
}

/// Flies the plan of a slot, all of which must be possible from `here`.
fn fly(scenario: &Scenario, world: &World, here: &FlightReport, slot: u64, plan: &Plan) -> FlightReport {
    let mut flight = Flight::new(scenario, &world.nodes);
    flight.restore(here);
    let report = flight.step(slot, Some(plan));
    assert_eq!((report.hold, report.refused), (0, 0), "{plan:?} from {here:?}");
    report
}
