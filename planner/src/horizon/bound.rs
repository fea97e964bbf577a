//! Loss that no plan can avoid, by counting visits alone: n in a slot, wherever the UAV is.

use skysink_common::message::SensorNode;
use skysink_common::scenario::Scenario;

use super::Horizon;
use super::forecast::Outlook;
use super::reach::Reachable;
use super::world::World;

/// Windows that are compared.
const WINDOWS: usize = 8;

/// A lower bound on the loss [bit] of a whole mission from the queues `queues_bits` [bit] before slot 1, by id, however it
/// is flown: [`lower_bound_with_way`].
#[must_use]
pub fn mission_bound(scenario: &Scenario, sensors: &[SensorNode], queues_bits: &[u32]) -> f64 {
    let horizon = Horizon::new(scenario, sensors);
    let world = &horizon.world;
    lower_bound_with_way(world, &horizon.outlook(1, &scenario.start().xy(), queues_bits), &Reachable::new(world))
}

/// A lower bound on the loss [bit] of every plan over `outlook`, the larger of [`by_visits`] and [`by_throughput`].
#[must_use]
pub fn lower_bound(world: &World, outlook: &Outlook) -> f64 {
    by_visits(world, outlook).max(by_throughput(world, outlook))
}

/// A tighter bound, which takes longer: of [`by_visits`] with as many sources as the way between them allows, and
/// [`by_throughput`].
#[must_use]
pub fn lower_bound_with_way(world: &World, outlook: &Outlook, reachable: &Reachable) -> f64 {
    by_counts(world, outlook, |slots| reachable.most(slots)).max(by_throughput(world, outlook))
}

/// At most `n K` sources are served in K slots, and who was not served in the K slots before slot t loses in slot t at
/// least what it loses if it was emptied just before them, or, if these are all slots since the start, what it loses
/// unserved. So the loss in slot t is at least the sum of these losses without the `n K` largest, for every K.
#[must_use]
pub fn by_visits(world: &World, outlook: &Outlook) -> f64 {
    by_counts(world, outlook, |slots| world.blocks().saturating_mul(slots as usize))
}

/// The bound of [`by_visits`] if at most `most(K)` sources are served in K slots.
fn by_counts(world: &World, outlook: &Outlook, most: impl Fn(i32) -> usize) -> f64 {
    let mut fills: Vec<f64> = world.sources.iter().map(|source| source.fill_slots.ceil()).collect();
    fills.sort_unstable_by(f64::total_cmp);
    fills.dedup();
    let mut losses = Vec::with_capacity(world.sources.len());
    let stride = fills.len().div_ceil(WINDOWS).max(1);
    // Loss in a slot with at least `window` slots before it, by window.
    let mut later: Vec<(i32, f64)> = Vec::new();
    for window in fills.iter().step_by(stride).filter(|window| **window < f64::from(outlook.slots)) {
        losses.clear();
        losses.extend(
            world.sources.iter().map(|source| (window + 1.0 - source.fill_slots).clamp(0.0, 1.0) * source.mean_bits),
        );
        later.push((*window as i32, without_largest(&mut losses, most(*window as i32))));
    }
    let widest = later.iter().map(|(window, _)| *window).max().unwrap_or(0);
    let mut bound_bits = 0.0;
    for slot in 1..=outlook.slots {
        let mut least_bits =
            later.iter().filter(|(window, _)| *window < slot).map(|(_, bits)| *bits).fold(0.0, f64::max);
        let served = most(slot - 1);
        if served < world.sources.len() {
            losses.clear();
            losses.extend(world.sources.iter().zip(&outlook.empty).map(|(source, empty)| {
                (f64::from(slot) - empty - source.fill_slots).clamp(0.0, 1.0) * source.mean_bits
            }));
            least_bits = least_bits.max(without_largest(&mut losses, served));
        } else if slot > widest {
            // From here on every slot is like this one.
            return bound_bits + least_bits * f64::from(outlook.slots - slot + 1);
        }
        bound_bits += least_bits;
    }
    bound_bits
}

/// What is there and comes in, less what fits into the storages, less what n of the best links carry in every slot.
#[must_use]
pub fn by_throughput(world: &World, outlook: &Outlook) -> f64 {
    let slots = f64::from(outlook.slots);
    let (mut excess_bits, mut best_bits) = (0.0, 0.0f64);
    for ((source, empty), id) in world.sources.iter().zip(&outlook.empty).zip(0..) {
        let stored_slots = (-empty).min(source.fill_slots);
        excess_bits += (slots + stored_slots - source.fill_slots) * source.mean_bits;
        let carried = world.capacity_slots(id, 0.0).min(source.fill_slots);
        best_bits = best_bits.max(carried * source.mean_bits);
    }
    (excess_bits - best_bits * slots * world.blocks() as f64).max(0.0)
}

/// The sum of `values`, which change their order, without the `count` largest.
fn without_largest(values: &mut [f64], count: usize) -> f64 {
    if count >= values.len() {
        return 0.0;
    }
    if count > 0 {
        values.select_nth_unstable_by(count - 1, |a, b| b.total_cmp(a));
    }
    values[count..].iter().sum()
}
