//! A plan to start from where blocks are scarce: every slot serves the best set of that slot, as `exact` does.
//!
//! Its stops are sets that no partition of the field has: who shares a slot differs from visit to visit.

use skysink_common::geometry::distance_squared;

use super::flight::{Visit, serve};
use super::forecast::Outlook;
use super::world::{Place, World};
use crate::strategies::exact::ExactSearch;

/// The stops of the slots of `outlook` if every slot takes the fullest set in reach; `None` where a slot has nobody in
/// reach: there it would be lost.
#[must_use]
pub fn roll_out(world: &World, outlook: &Outlook) -> Option<Vec<Place>> {
    let mut search = ExactSearch::new(&world.field);
    let mut queues_bits = vec![0; world.field.positions.len()];
    let (mut empty, mut at) = (outlook.empty.clone(), outlook.start);
    let mut ids = Vec::new();
    let mut stops = Vec::new();
    for slot in 1..=outlook.slots {
        for ((source, id), empty) in world.sources.iter().zip(&world.ids).zip(&empty) {
            let stored_slots = (f64::from(slot - 1) - empty).min(source.fill_slots);
            queues_bits[*id as usize] = (stored_slots * source.mean_bits) as u32;
        }
        at = search.best_set(&world.field, &at, &queues_bits, &mut ids)?;
        let sources = ids.iter().filter_map(|id| world.ids.binary_search(id).ok());
        let members: Vec<u32> = sources.map(|source| source as u32).collect();
        for &source in &members {
            let away_m2 = distance_squared(&world.positions[source as usize], &at);
            let capacity_slots = world.capacity_slots(source, away_m2);
            serve(world, &mut empty, &Visit { source, slot, capacity_slots });
        }
        stops.extend(world.place_at(at, members));
    }
    Some(stops)
}
