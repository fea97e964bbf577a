//! What a planner remembers.

use skysink_common::message::FlightReport;
use skysink_common::scenario::Scenario;
use skysink_flight_sim::Flight;
use skysink_planner::Planner;
use skysink_planner::settings::Strategy;

use super::world::{SEEN, WORLDS, World, planned};
use crate::cursor::Cursor;

/// Slots of the life that a memory is taken from.
const LIFE_SLOTS: u64 = 6;

/// A planner that is given any memory refuses it and is as it was, or goes on with it: then it has that memory, and plans
/// what the UAV can do. An unspoilt memory is never refused.
///
/// # Panics
/// If not.
pub fn planner_memory(bytes: &[u8]) {
    let mut input = Cursor::new(bytes);
    let world = &WORLDS[usize::from(input.u8()) % WORLDS.len()];
    let strategy = Strategy::ALL[usize::from(input.u8()) % Strategy::ALL.len()];
    let seen = SEEN[usize::from(input.u8()) % SEEN.len()];
    let scenario = planned(&world.scenario, strategy, seen);
    let (mut planner, here) = life(world, &scenario);
    let lived = planner.memory().to_vec();
    let memory = spoilt(&lived, &mut input);
    match planner.recall(LIFE_SLOTS, &memory) {
        Ok(()) => assert_eq!(planner.memory(), memory),
        Err(_) => {
            assert_eq!(planner.memory(), lived);
            assert_ne!(memory, lived, "a memory of its own is refused");
        }
    }
    let queues: Vec<u32> = world.nodes.iter().map(|_| input.u32()).collect();
    planner.observe(LIFE_SLOTS, &here, &queues);
    let plan = planner.step(LIFE_SLOTS + 1, &here.position(), here.z_m, &queues);
    let mut flight = Flight::new(&scenario, &world.nodes);
    flight.take_over(&here);
    let report = flight.step(LIFE_SLOTS + 1, Some(&plan));
    assert_eq!((report.hold, report.refused), (0, 0), "{plan:?} from {here:?}");
    let (next, there) = (planner.memory().to_vec(), report.position());
    let mut again = Planner::new(&scenario, &world.nodes).expect("its keys were checked");
    again.recall(LIFE_SLOTS + 1, &next).expect("what a planner remembers is a memory");
    for planner in [&mut planner, &mut again] {
        planner.observe(LIFE_SLOTS + 1, &report, &queues);
    }
    let [plan, same] =
        [&mut planner, &mut again].map(|planner| planner.step(LIFE_SLOTS + 2, &there, report.z_m, &queues));
    assert_eq!(format!("{plan:?}"), format!("{same:?}"));
}

/// A planner after some slots, and the flight of the last.
fn life(world: &World, scenario: &Scenario) -> (Planner, FlightReport) {
    let mut planner = Planner::new(scenario, &world.nodes).expect("its keys were checked");
    let mut flight = Flight::new(scenario, &world.nodes);
    let mut report = flight.start();
    let queues = world.list.queues_bits();
    for slot in 1..=LIFE_SLOTS {
        planner.observe(slot - 1, &report, &queues);
        let plan = planner.step(slot, &report.position(), report.z_m, &queues);
        report = flight.step(slot, Some(&plan));
    }
    (planner, report)
}

/// A memory with some of its bytes replaced, cut, or any bytes instead.
fn spoilt(memory: &[u8], input: &mut Cursor) -> Vec<u8> {
    let mut spoilt = memory.to_vec();
    match input.u8() % 4 {
        0 => {}
        1 => spoilt.truncate(usize::from(input.u16()) % (memory.len() + 1)),
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
