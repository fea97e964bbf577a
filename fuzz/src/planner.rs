//! A planner that is told anything, or given any checkpoint.

use arbitrary::{Result, Unstructured};
use skysink_common::checkpoint::Checkpoint;
use skysink_common::geometry::{Position, above};
use skysink_common::message::{FlightReport, HoldReason, PathPoint, SensorNode, is_possible_path};
use skysink_common::scenario::Scenario;
use skysink_flight_sim::Flight;
use skysink_planner::Planner;
use skysink_planner::settings::Knowledge;
use skysink_planner::strategies::names;

use crate::messages::report;
use crate::scratch::bytes;
use crate::world::{SEEN, WORLDS, World, planned};

/// Slots of the life that a checkpoint is taken from.
const LIFE_SLOTS: u64 = 6;

/// Whatever it is told, the planner answers with at most n known sensor nodes; and if the UAV is where it can be, over
/// the scenario's own sensor nodes, the UAV can do all that the plan says, and the path is one.
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
            let mut flight = Flight::new(&scenario, &nodes);
            let here = FlightReport { x_m, y_m, z_m: altitude_m, ..flight.start() };
            flight.restore(&here);
            let report = flight.step(slot, Some(&plan));
            assert_eq!((report.hold, report.refused), (HoldReason::None as u32, 0), "{plan:?} from {here:?}");
            let path: Vec<_> = planner.path().iter().copied().map(PathPoint::from).collect();
            assert!(is_possible_path(&path, &scenario.area), "{path:?} from {here:?}");
        }
    }
    Ok(())
}

/// A planner that is given any bytes refuses them and is as it was, or resumes from them and plans what the UAV can do.
/// An unspoilt checkpoint is never refused.
pub fn checkpoint(u: &mut Unstructured) -> Result<()> {
    let world = &WORLDS[usize::from(u.arbitrary::<u8>()?) % WORLDS.len()];
    let strategy = strategy(u)?;
    let scenario = planned(&world.scenario, strategy, SEEN[usize::from(u.arbitrary::<u8>()?) % SEEN.len()]);
    let (mut planner, here) = life(world, &scenario);
    let lived = saved(&planner);
    let checkpoint = spoilt(&lived, u)?;
    if planner.restore(&checkpoint).is_err() {
        assert_eq!(saved(&planner), lived);
        assert_ne!(checkpoint, lived, "a checkpoint of its own is refused");
    }
    let queues = queues(u, world)?;
    planner.observe(LIFE_SLOTS, &here, &queues);
    let plan = planner.step(LIFE_SLOTS + 1, here.position(), &queues);
    let mut flight = Flight::new(&scenario, &world.nodes);
    flight.restore(&here);
    let report = flight.step(LIFE_SLOTS + 1, Some(&plan));
    assert_eq!((report.hold, report.refused), (0, 0), "{plan:?} from {here:?}");
    let mut again = Planner::new(&scenario, &world.nodes).expect("a scenario with a change that is allowed");
    again.restore(&saved(&planner)).expect("what a planner saves is a checkpoint");
    assert_eq!(saved(&again), saved(&planner));
    let [plan, same] = [&mut planner, &mut again].map(|planner| {
        planner.observe(LIFE_SLOTS + 1, &report, &queues);
        planner.step(LIFE_SLOTS + 2, report.position(), &queues)
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

/// A planner after some slots, and the flight of the last.
fn life(world: &World, scenario: &Scenario) -> (Planner, FlightReport) {
    let mut planner = Planner::new(scenario, &world.nodes).expect("its keys were checked");
    let mut flight = Flight::new(scenario, &world.nodes);
    let mut report = flight.start();
    let queues = world.list.queues_bits();
    for slot in 1..=LIFE_SLOTS {
        planner.observe(slot - 1, &report, &queues);
        let plan = planner.step(slot, report.position(), &queues);
        report = flight.step(slot, Some(&plan));
    }
    (planner, report)
}

/// A checkpoint with some of its bytes replaced, cut, or any bytes instead.
fn spoilt(checkpoint: &[u8], u: &mut Unstructured) -> Result<Vec<u8>> {
    let mut spoilt = checkpoint.to_vec();
    match u.arbitrary::<u8>()? % 4 {
        0 => {}
        1 => spoilt.truncate(usize::from(u.arbitrary::<u16>()?) % (checkpoint.len() + 1)),
        2 => {
            for _ in 0..u.arbitrary::<u8>()? % 4 {
                let at = usize::from(u.arbitrary::<u16>()?);
                let length = usize::from(u.arbitrary::<u8>()?) % 9;
                let new = bytes(u, length)?;
                if let Some(old) = spoilt.get_mut(at..at + new.len()) {
                    old.copy_from_slice(new);
                }
            }
        }
        _ => {
            let length = usize::from(u.arbitrary::<u16>()?) % 400;
            spoilt = bytes(u, length)?.to_vec();
        }
    }
    Ok(spoilt)
}
