//! The working memory of strategies that remember nothing is made once, before the first slot (Clarabel's own apart).

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use skysink_common::geometry::{Position, above};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_planner::Planner;
use skysink_planner::strategies::stateless;

thread_local! {
    /// Requests for memory by this thread.
    static REQUESTS: Cell<u64> = const { Cell::new(0) };
}

/// The system's allocator, counting.
struct Counting;

// SAFETY: every call is handed to the system's allocator unchanged; counting touches no memory of theirs.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        REQUESTS.set(REQUESTS.get() + 1);
        // SAFETY: the caller's promises about `layout` are passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: `pointer` came from `alloc` above, hence from the system's allocator, with this layout.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Flies 300 slots of `scenario` with `queues_bits` at the start and `sampled_bits` more in every slot.
fn fly(scenario: &Scenario, mut queues_bits: Vec<u32>, sampled_bits: u32) {
    let list = SensorList::of(scenario).unwrap();
    let mut planner = Planner::new(scenario, &list.nodes()).unwrap();
    let mut position = scenario.start().xy();
    let mut altitude_m = scenario.uav.altitude_m;
    let requests_before = REQUESTS.get();
    for slot in 1..=300 {
        let plan = planner.step(slot, above(&position, altitude_m), &queues_bits);
        position = Position::new(plan.x_m, plan.y_m);
        altitude_m = plan.z_m;
        plan.scheduled().iter().for_each(|&id| queues_bits[id as usize] = 0);
        queues_bits.iter_mut().for_each(|queue_bits| *queue_bits = (*queue_bits + sampled_bits).min(30_000));
        assert_eq!(REQUESTS.get(), requests_before, "{}, slot {slot}", scenario.planner.strategy);
    }
}

fn letter(strategy: &'static str) -> Scenario {
    Scenario::letter(Overrides { strategy: Some(strategy), ..Overrides::default() }).unwrap()
}

/// The letter's field in dense urban surroundings, flown in three dimensions.
fn spatial(strategy: &'static str) -> Scenario {
    let text = "name = 'a'\n[uav]\naltitude = 'free'\n[link]\nmodel = 'probabilistic-los'\n\
                environment = 'dense-urban'\ncomm_radius_m = 25.0\nbandwidth_hz = 5e3\n";
    let overrides = Overrides { strategy: Some(strategy), ..Overrides::default() };
    Scenario::parse(text, std::path::Path::new("a.toml"), overrides).unwrap()
}

#[test]
fn no_slot_allocates() {
    for strategy in stateless() {
        for scenario in [letter(strategy), spatial(strategy)] {
            let queues_bits = SensorList::of(&scenario).unwrap().queues_bits();
            fly(&scenario, queues_bits, 100);
        }
    }
}

/// Ties, which have lists of ids compared.
#[test]
fn no_slot_of_equal_queues_allocates() {
    for strategy in stateless() {
        fly(&letter(strategy), vec![0; 200], 0);
        fly(&letter(strategy), vec![30_000; 200], 30_000);
    }
}

/// A hundred times the letter's field at its density.
#[test]
fn no_slot_over_a_large_field_allocates() {
    for strategy in stateless() {
        let text = "name = 'a'\n[area]\nside_m = 1e3\n[sensors]\ncount = 20000\n";
        let overrides = Overrides { strategy: Some(strategy), ..Overrides::default() };
        let scenario = Scenario::parse(text, std::path::Path::new("a.toml"), overrides).unwrap();
        let queues_bits = SensorList::of(&scenario).unwrap().queues_bits();
        fly(&scenario, queues_bits, 100);
    }
}
