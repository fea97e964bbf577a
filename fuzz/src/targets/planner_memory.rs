//! Checkpoints of a planner.

use skysink_common::checkpoint::Checkpoint;
use skysink_common::message::FlightReport;
use skysink_common::scenario::Scenario;
use skysink_flight_sim::Flight;
use skysink_planner::Planner;
use skysink_planner::strategies::names;

use super::world::{SEEN, WORLDS, World, planned};
use crate::cursor::Cursor;

/// Slots of the life that a checkpoint is taken from.
const LIFE_SLOTS: u64 = 6;

/// A planner that is given any bytes refuses them and is as it was, or resumes from them and plans what the UAV can do.
/// An unspoilt checkpoint is never refused.
///
/// # Panics
/// If not.
pub fn planner_memory(bytes: &[u8]) {
    let mut input = Cursor::new(bytes);
    let world = &WORLDS[usize::from(input.u8()) % WORLDS.len()];
    let strategy = names()[usize::from(input.u8()) % names().len()];
    let seen = SEEN[usize::from(input.u8()) % SEEN.len()];
    let scenario = planned(&world.scenario, strategy, seen);
    let (mut planner, here) = life(world, &scenario);
    let lived = saved(&planner);
    let checkpoint = spoilt(&lived, &mut input);
    if planner.restore(&checkpoint).is_err() {
        assert_eq!(saved(&planner), lived);
        assert_ne!(checkpoint, lived, "a checkpoint of its own is refused");
    }
    let queues: Vec<u32> = world.nodes.iter().map(|_| input.u32()).collect();
    planner.observe(LIFE_SLOTS, &here, &queues);
    let plan = planner.step(LIFE_SLOTS + 1, here.position(), &queues);
    let mut flight = Flight::new(&scenario, &world.nodes);
    flight.restore(&here);
    let report = flight.step(LIFE_SLOTS + 1, Some(&plan));
    assert_eq!((report.hold, report.refused), (0, 0), "{plan:?} from {here:?}");
    let mut again = Planner::new(&scenario, &world.nodes).expect("a scenario with a change that is allowed");
    again.restore(&saved(&planner)).expect("what a planner saves is a checkpoint");
    assert_eq!(saved(&again), saved(&planner));
    for planner in [&mut planner, &mut again] {
        planner.observe(LIFE_SLOTS + 1, &report, &queues);
    }
    let [plan, same] =
        [&mut planner, &mut again].map(|planner| planner.step(LIFE_SLOTS + 2, report.position(), &queues));
    assert_eq!(format!("{plan:?}"), format!("{same:?}"));
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
fn spoilt(checkpoint: &[u8], input: &mut Cursor) -> Vec<u8> {
    let mut spoilt = checkpoint.to_vec();
    match input.u8() % 4 {
        0 => {}
        1 => spoilt.truncate(usize::from(input.u16()) % (checkpoint.len() + 1)),
        2 => {
            for _ in 0..input.u8() % 4 {
                let (place, length) = (usize::from(input.u16()), usize::from(input.u8()) % 9);
                let new = input.bytes(length);
                if let Some(old) = spoilt.get_mut(place..place + new.len()) {
                    old.copy_from_slice(new);
                }
            }
        }
        _ => {
            let length = usize::from(input.u16()) % 400;
            spoilt = input.bytes(length).to_vec();
        }
    }
    spoilt
}
