//! A planner's working memory is made once, before its first slot (Clarabel's own apart).

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use skysink_common::geometry::Position;
use skysink_common::scenario::{Overrides, Scenario, Strategy};
use skysink_common::sensors::SensorList;
use skysink_planner::Planner;

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

/// Flies 300 slots from the letter's field with `queues_bits` at the start and `sampled_bits` more in every slot.
fn fly(strategy: Strategy, mut queues_bits: Vec<u32>, sampled_bits: u32) {
    let scenario = Scenario::letter(Overrides { strategy: Some(strategy), ..Overrides::default() }).unwrap();
    let list = SensorList::of(&scenario).unwrap();
    let mut planner = Planner::new(&scenario, &list.nodes(scenario.sensors.capacity_bits));
    let mut position = scenario.uav.start;
    let requests_before = REQUESTS.get();
    for slot in 1..=300 {
        let plan = planner.step(slot, &position, &queues_bits);
        position = Position::new(plan.x_m, plan.y_m);
        plan.scheduled().iter().for_each(|&id| queues_bits[id as usize] = 0);
        queues_bits.iter_mut().for_each(|queue_bits| *queue_bits = (*queue_bits + sampled_bits).min(30_000));
        assert_eq!(REQUESTS.get(), requests_before, "{}, slot {slot}", strategy.name());
    }
}

#[test]
fn no_slot_asks_for_memory() {
    let letter = SensorList::of(&Scenario::letter(Overrides::default()).unwrap()).unwrap();
    for strategy in Strategy::ALL {
        fly(strategy, letter.queues_bits(), 100);
    }
}

/// Ties, which have lists of ids compared.
#[test]
fn no_slot_of_equal_queues_asks_for_memory() {
    for strategy in Strategy::ALL {
        fly(strategy, vec![0; 200], 0);
        fly(strategy, vec![30_000; 200], 30_000);
    }
}
