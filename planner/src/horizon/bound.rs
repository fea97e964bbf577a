//! Lower bounds on the predicted loss of any plan over a planning window: with real-valued queues, and random channels
//! at their expected rates. Computed in every slot.
//!
//! Bounds on the loss of any flight, in whole bits and for all draws of the channel, are left to [`crate::bound`].

use super::forecast::PlanningWindow;
use super::model::{PlanningModel, SensorModel};

/// Gaps between visits that are compared.
const GAPS: usize = 8;

/// Lower bound on the loss [bit] of every plan over `window`, the larger of [`by_visits`] and [`by_throughput`].
#[must_use]
pub fn lower_bound(model: &PlanningModel, window: &PlanningWindow) -> f64 {
    by_visits(model, window).max(by_throughput(model, window))
}

/// Lower bound on the loss [bit] by visits.
///
/// At most `n K` sensors are served in K slots. A sensor that is not served in the K slots before slot t loses in slot
/// t at least as much as if it was emptied just before them or, if these are all slots since the start, as if unserved.
/// So the loss in slot t is at least the sum of these losses without the `n K` largest, for every K.
#[must_use]
pub fn by_visits(model: &PlanningModel, window: &PlanningWindow) -> f64 {
    let most = |slots: i32| model.table.resource_blocks.saturating_mul(slots as usize);
    let mut fills: Vec<f64> = model.sensors.iter().map(|sensor| sensor.fill_slots.ceil()).collect();
    fills.sort_unstable_by(f64::total_cmp);
    fills.dedup();
    let stride = fills.len().div_ceil(GAPS).max(1);
    // Loss in a slot with at least `gap` slots before it, by gap.
    let mut later: Vec<(i32, f64)> = Vec::new();
    for gap in fills.into_iter().step_by(stride).filter(|gap| *gap < f64::from(window.slots)) {
        let lost_bits = |sensor: &SensorModel| (gap + 1.0 - sensor.fill_slots).clamp(0.0, 1.0) * sensor.mean_bits;
        let losses = model.sensors.iter().map(lost_bits).collect();
        later.push((gap as i32, without_largest(losses, most(gap as i32))));
    }
    let widest = later.last().map_or(0, |(gap, _)| *gap);
    let mut bound_bits = 0.0;
    for slot in 1..=window.slots {
        let before = later.iter().take_while(|(gap, _)| *gap < slot);
        let mut least_bits = before.map(|(_, bits)| *bits).fold(0.0, f64::max);
        let served = most(slot - 1);
        if served < model.sensors.len() {
            let lost_bits = |(sensor, empty): (&SensorModel, &f64)| {
                (f64::from(slot) - empty - sensor.fill_slots).clamp(0.0, 1.0) * sensor.mean_bits
            };
            let losses = model.sensors.iter().zip(&window.empty).map(lost_bits).collect();
            least_bits = least_bits.max(without_largest(losses, served));
        } else if slot > widest {
            // All later slots have the same bound.
            return bound_bits + least_bits * f64::from(window.slots - slot + 1);
        }
        bound_bits += least_bits;
    }
    bound_bits
}

/// Lower bound on the loss [bit] by throughput: stored and sampled bits, less the buffers, less the capacity of n of
/// the best links in every slot.
#[must_use]
pub fn by_throughput(model: &PlanningModel, window: &PlanningWindow) -> f64 {
    let slots = f64::from(window.slots);
    let mut excess_bits = 0.0;
    let mut best_bits = 0.0f64;
    for ((sensor, empty), index) in model.sensors.iter().zip(&window.empty).zip(0..) {
        let stored_slots = (-empty).min(sensor.fill_slots);
        excess_bits += (slots + stored_slots - sensor.fill_slots) * sensor.mean_bits;
        let carried = model.capacity_slots(index, 0.0).min(sensor.fill_slots);
        best_bits = best_bits.max(carried * sensor.mean_bits);
    }
    (excess_bits - best_bits * slots * model.table.resource_blocks as f64).max(0.0)
}

/// The sum of `values` without the `count` largest.
fn without_largest(mut values: Vec<f64>, count: usize) -> f64 {
    if count >= values.len() {
        return 0.0;
    }
    if count > 0 {
        values.select_nth_unstable_by(count - 1, |a, b| b.total_cmp(a));
    }
    values[count..].iter().sum()
}
