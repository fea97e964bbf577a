//! Lower bounds on the predicted loss of any plan over a planning window: with real-valued queues, and random channels
//! at their expected rates. Computed in every slot.

use super::visits::without_largest;

/// Gaps between visits that are compared.
const GAPS: usize = 8;

/// The sensors that can lose data in a planning window, as predicted.
#[derive(Debug, Clone, PartialEq)]
pub struct WindowField {
    /// The sensors.
    pub sensors: Vec<WindowSensor>,
    /// Slots of the window.
    pub slots: i32,
    /// Resource blocks, `n`.
    pub blocks: usize,
}

/// A sensor in a planning window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindowSensor {
    /// Slots in which its empty buffer fills.
    pub fill_slots: f64,
    /// Bits sampled per slot, above 0; weighted where weights differ, and so are then the bounds (decision D25): a link
    /// carries at most the largest weighted upload.
    pub mean_bits: f64,
    /// The slot, at most 0, in which it was or would have been empty.
    pub empty: f64,
    /// Capacity of its best link [slots of sampling].
    pub capacity_slots: f64,
}

impl WindowSensor {
    /// The slot in which it is full if unserved.
    fn full(&self) -> f64 {
        self.empty + self.fill_slots
    }
}

impl WindowField {
    /// Lower bound on the loss [bit] of every plan, by visits and by throughput.
    pub fn least_loss_bits(&self) -> f64 {
        self.least_loss_by_visits().max(self.least_loss_by_throughput())
    }

    /// Lower bound on the loss [bit] by visits.
    ///
    /// At most `n K` sensors are served in K slots. A sensor that is not served in the K slots before slot t loses in
    /// slot t at least as much as if it was emptied just before them or, if these are all slots since the start, as if
    /// unserved. So the loss in slot t is at least the sum of these losses without the `n K` largest, for every K.
    fn least_loss_by_visits(&self) -> f64 {
        let most = |slots: i32| self.blocks.saturating_mul(slots as usize);
        let mut fills: Vec<f64> = self.sensors.iter().map(|sensor| sensor.fill_slots.ceil()).collect();
        fills.sort_unstable_by(f64::total_cmp);
        fills.dedup();
        let stride = fills.len().div_ceil(GAPS).max(1);
        // Loss in a slot with at least `gap` slots before it, by gap.
        let mut later: Vec<(i32, f64)> = Vec::new();
        for gap in fills.into_iter().step_by(stride).filter(|gap| *gap < f64::from(self.slots)) {
            let lost_bits = |sensor: &WindowSensor| (gap + 1.0 - sensor.fill_slots).clamp(0.0, 1.0) * sensor.mean_bits;
            let mut losses: Vec<f64> = self.sensors.iter().map(lost_bits).collect();
            later.push((gap as i32, without_largest(&mut losses, most(gap as i32), f64::total_cmp)));
        }
        let widest = later.last().map_or(0, |(gap, _)| *gap);
        let mut by_full = self.sensors.clone();
        by_full.sort_unstable_by(|one, other| one.full().total_cmp(&other.full()));
        let mean_bits = by_full.first().map(|first| first.mean_bits);
        let mean_bits = mean_bits.filter(|mean_bits| by_full.iter().all(|sensor| sensor.mean_bits == *mean_bits));
        let mut bound_bits = 0.0;
        for slot in 1..=self.slots {
            let before = later.iter().take_while(|(gap, _)| *gap < slot);
            let mut least_bits = before.map(|(_, bits)| *bits).fold(0.0, f64::max);
            let served = most(slot - 1);
            if served < self.sensors.len() {
                least_bits = least_bits.max(lost_unserved_bits(&by_full, mean_bits, slot, served));
            } else if slot > widest {
                // All later slots have the same bound.
                return bound_bits + least_bits * f64::from(self.slots - slot + 1);
            }
            bound_bits += least_bits;
        }
        bound_bits
    }

    /// Lower bound on the loss [bit] by throughput: stored and sampled bits, less the buffers, less the capacity of n
    /// of the best links in every slot.
    fn least_loss_by_throughput(&self) -> f64 {
        let slots = f64::from(self.slots);
        let mut excess_bits = 0.0;
        let mut best_bits = 0.0f64;
        for sensor in &self.sensors {
            let stored_slots = (-sensor.empty).min(sensor.fill_slots);
            excess_bits += (slots + stored_slots - sensor.fill_slots) * sensor.mean_bits;
            best_bits = best_bits.max(sensor.capacity_slots.min(sensor.fill_slots) * sensor.mean_bits);
        }
        (excess_bits - best_bits * slots * self.blocks as f64).max(0.0)
    }
}

/// Loss in `slot` of unserved `sensors`, in the order in which they are full, without the `served` largest [bit]; each
/// samples `mean_bits` [bit], if all do.
fn lost_unserved_bits(sensors: &[WindowSensor], mean_bits: Option<f64>, slot: i32, served: usize) -> f64 {
    let slot = f64::from(slot);
    let late = &sensors[..sensors.partition_point(|sensor| sensor.full() < slot)];
    let lost_bits = |sensor: &WindowSensor| (slot - sensor.full()).min(1.0) * sensor.mean_bits;
    let Some(mean_bits) = mean_bits else {
        return without_largest(&mut late.iter().map(lost_bits).collect::<Vec<f64>>(), served, f64::total_cmp);
    };
    // The first to be full lose most, and those that are so for a slot as much as each other.
    let long = late.partition_point(|sensor| sensor.full() <= slot - 1.0);
    let others_bits: f64 = late[long.max(served).min(late.len())..].iter().map(lost_bits).sum();
    long.saturating_sub(served) as f64 * mean_bits + others_bits
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three sensors that fill in `fill_slots` slots, with a visit a slot, over `slots` slots. A visit carries a full
    /// buffer of 30 kbit.
    fn three(fill_slots: f64, empty: f64, slots: i32) -> WindowField {
        let mean_bits = 30_000.0 / fill_slots;
        let sensor = WindowSensor { fill_slots, mean_bits, empty, capacity_slots: f64::INFINITY };
        WindowField { sensors: vec![sensor; 3], slots, blocks: 1 }
    }

    #[test]
    fn the_bounds_count_visits_and_bits() {
        // One visit a slot, three sensors that fill in 10 slots from empty, full at slot 0: unserved ones lose
        // everything. Slot 1 costs 3, slot 2 two, slot 3 one, all of 3000 bit; then each can be served in time.
        assert_eq!(three(10.0, -10.0, 8).least_loss_by_visits(), 18_000.0);
        // Full in 2 slots: of three with one visit a slot, one is late in every slot from the third on, and at first
        // all.
        let empty = three(2.0, 0.0, 10);
        assert_eq!(empty.least_loss_by_visits(), 8.0 * 15_000.0);
        // 45 kbit a slot come in and 30 kbit go out, 450 − 90 − 300 = 60 kbit in ten slots.
        assert_eq!(empty.least_loss_by_throughput(), 60_000.0);
        assert_eq!(empty.least_loss_bits(), 120_000.0);
    }
}
