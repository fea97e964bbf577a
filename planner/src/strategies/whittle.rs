//! `whittle`: a Whittle index policy for the age of the data, divided by the slots of flight.
//!
//! In every slot the UAV flies straight toward the sensor node (SN) of largest `W_i(h_i + d_i)/d_i`, where `d_i` is the
//! least number of slots until SN i can be served, `h_i` its age, and `W_i` its Whittle index. In range the n SNs of
//! largest index are served. Where every index is 0, no SN overflows before the UAV could be there, and the earliest
//! deadline decides.
//!
//! Source: V. Tripathi, E. Modiano, "A Whittle Index Approach to Minimizing Functions of Age of Information", Allerton
//! 2019, arXiv 1908.10438, after P. Whittle, "Restless Bandits: Activity Allocation in a Changing World", Journal of
//! Applied Probability 25A, 1988. One server serves one source per slot. A source of age h costs f(h) in a slot, with f
//! non-decreasing; its next age is 1 if it is served and h + 1 if not. (The abstract of the first paper was read, not
//! the full text. The index is derived here for this setting, and the tests check it against the definition.
//! Whether the paper counts ages in the same way was not checked.)
//!
//! The index `W(h)` is the price of a service at which serving at age h and waiting one more slot cost the same. A
//! source that is served at every age H costs the price and `f(1) + ... + f(H)` in H slots. Equal averages for H = h
//! and H = h + 1 give `W(h) = h f(h + 1) − (f(1) + ... + f(h))`.
//!
//! Adapted to a mobile server and buffers that overflow:
//! - *Age* is the time since the SN was, or would have been, empty [slots]: `h_i = B_i(t−1)/(s_i τ)` while there is
//!   room in the buffer. While it is full, the slots since it was first seen full are added. This age is also right
//!   after partial uploads and for initial queues.
//! - *Cost* is what the SN has lost at that age: `f(h) = s_i τ max(0, h − C_i)` [bit], where `C_i = B/(s_i τ)` is the
//!   number of slots to fill the buffer. It is charged in every slot, so that the index of a full SN keeps growing.
//!   With the loss of one slot as the cost, the index would stay constant.
//! - *Flight*: SN i can be served at the end of the `d_i`-th slot at the earliest, at age `h_i + d_i`. This takes `d_i`
//!   slots of the server, hence the index per slot of flight. The paper's optimality for two sources does not carry
//!   over.

use std::cmp::Reverse;

use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode, encode};
use skysink_common::geometry::distance_squared;

use crate::geometry::disks::Disk;
use crate::serving::Serving;
use crate::serving::nearby::fullest_first;
use crate::strategy::{Decision, Registered, Setup, Strategy, View};

/// The strategy in the registry.
pub const STRATEGY: Registered =
    Registered::new("whittle", "Whittle index of age: fly to the largest index per slot of flight", |setup| {
        Box::new(Whittle::new(setup))
    })
    .with_state();

/// Tolerance [slots] when an age is rounded down: rounding errors must not lose a slot.
const WHOLE: f64 = 1e-9;

struct Whittle {
    ages: Ages,
    serving: Serving,
}

impl Whittle {
    fn new(setup: &Setup) -> Self {
        let ages = Ages { full_since: vec![0; setup.table.sensors.count()] };
        Self { ages, serving: Serving::new(setup) }
    }
}

struct Ages {
    /// Slot in which each SN was first seen full, 0 if it is not full, by id.
    full_since: Vec<u32>,
}

impl Ages {
    /// Updates `full_since` at the beginning of the slot of `view`.
    fn update(&mut self, view: &View) {
        let slot = u32::try_from(view.slot).unwrap_or(u32::MAX);
        for (id, since) in view.table.sensors.ids().zip(&mut self.full_since) {
            let sampler = view.table.sensors.sampler(id);
            // Of bits that expire a full queue holds now one bit more, now one less, unless it samples whole bits a
            // slot.
            let stored_bits = sampler.stored_bits();
            let missing_bits = u32::from(sampler.lasting_slots < sampler.fill_slots() && stored_bits > 1);
            let is_full = view.belief.queues_bits[id as usize] >= stored_bits - missing_bits;
            *since = match *since {
                _ if !is_full => 0,
                0 => slot,
                since => since,
            };
        }
    }

    /// Age [slots] of SN `id` at the beginning of the slot of `view`, if it samples `mean_bits` per slot.
    fn age_slots(&self, view: &View, id: u32, mean_bits: f64) -> f64 {
        let since = self.full_since[id as usize];
        let full_slots = if since == 0 { 0 } else { view.slot.saturating_sub(since.into()) };
        f64::from(view.belief.queues_bits[id as usize]) / mean_bits + full_slots as f64
    }

    /// The index [bit] of serving SN `id` at the end of the `flight`-th slot from now, times its weight (decision D25);
    /// 0 if it never samples.
    fn index(&self, view: &View, id: u32, flight: f64) -> f64 {
        let mean_bits = view.belief.mean_bits(id);
        if mean_bits == 0.0 {
            return 0.0;
        }
        let age = (self.age_slots(view, id, mean_bits) + flight + WHOLE).floor();
        let factor = view.table.sensors.weights.factor(id as usize);
        factor * overflow_index(mean_bits, view.table.sensors.sampler(id).stored_bits().into(), age)
    }

    /// The SN to fly to; `None` if no SN samples.
    fn goal(&self, view: &View) -> Option<u32> {
        let ground = view.ground();
        let rated = |id: u32| {
            let deadline_slots = view.belief.deadline_slots(id)?;
            let range = Disk { centre: *view.table.sensors.position(id), radius_m: view.table.limits.comm_radius_m };
            let flight = view.table.motion.slots_into(&ground, &range);
            let rating =
                [-self.index(view, id, flight) / flight, deadline_slots, distance_squared(&range.centre, &ground)];
            Some((rating, id))
        };
        let before =
            |a: &[f64; 3], b: &[f64; 3]| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])).then(a[2].total_cmp(&b[2]));
        view.servable().filter_map(rated).min_by(|a, b| before(&a.0, &b.0)).map(|(_, id)| id)
    }
}

/// The Whittle index [bit] at the whole age `age` [slots] of an SN that samples `mean_bits` per slot, above 0, into a
/// buffer of `capacity_bits`: `W(h) = h f(h + 1) − (f(1) + ... + f(h))`, `f(h) = max(0, s τ h − B)`.
///
/// `f` is 0 up to `m = floor(B/(s τ))`, so that the sum is that of an arithmetic series from m + 1 to h.
fn overflow_index(mean_bits: f64, capacity_bits: f64, age: f64) -> f64 {
    let next_bits = (mean_bits * (age + 1.0) - capacity_bits).max(0.0);
    let none_slots = (capacity_bits / mean_bits + WHOLE).floor();
    let some_slots = (age - none_slots).max(0.0);
    let sum_bits = some_slots * (mean_bits * (none_slots + age + 1.0) / 2.0 - capacity_bits);
    (age * next_bits - sum_bits).max(0.0)
}

impl Strategy for Whittle {
    /// Straight toward the SN with the largest index per slot of flight, until above it (ties: the earliest deadline,
    /// the nearest, the lowest id). Serves the n in range with the largest indices at the end of the slot (ties: the
    /// fullest). `None` if no SN samples.
    fn plan(&mut self, view: &View<'_>) -> Option<Decision> {
        self.ages.update(view);
        let goal = self.ages.goal(view)?;
        let waypoint = view.table.motion.toward(&view.ground(), view.table.sensors.position(goal));
        // For non-negative floats the order of the bit patterns is the order of the numbers.
        let index = |id: u32| self.ages.index(view, id, 1.0).to_bits();
        let key = |id: u32| (Reverse(index(id)), fullest_first(view.value(id), id));
        Some(self.serving.serve_by(view, &waypoint, key))
    }
}

impl Checkpoint for Whittle {
    fn save(&self, bytes: &mut Vec<u8>) {
        encode(&self.ages.full_since, bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        let full_since: Vec<u32> = decode(bytes)?;
        CheckpointError::ensure(full_since.len() == self.ages.full_since.len(), "a slot for each sensor node")?;
        self.ages.full_since = full_since;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::strategy::tests::{field, view};
    use crate::strategy::{OwnedSetup, Strategy};
    use proptest::prelude::*;

    /// What an SN has lost at this age [bit].
    fn cost_bits(mean_bits: f64, capacity_bits: f64, age: u32) -> f64 {
        (mean_bits * f64::from(age) - capacity_bits).max(0.0)
    }

    /// Cost per slot [bit] of a service at every age `age` that has the price `price_bits`.
    fn average_bits(mean_bits: f64, capacity_bits: f64, age: u32, price_bits: f64) -> f64 {
        let costs = (1..=age).map(|age| cost_bits(mean_bits, capacity_bits, age)).sum::<f64>();
        (costs + price_bits) / f64::from(age)
    }

    #[test]
    fn the_whittle_index_matches_the_sum() {
        // 10 bit a slot into 30 bit: f = 0, 0, 0, 10, 20, 30. W(2) = 2 · 0 = 0, W(3) = 3 · 10 = 30, W(4) = 4 · 20 − 10
        // = 70, W(5) = 5 · 30 − 30 = 120.
        assert_eq!(
            [0.0, 1.0, 2.0, 3.0, 4.0, 5.0].map(|age| overflow_index(10.0, 30.0, age)),
            [0.0, 0.0, 0.0, 30.0, 70.0, 120.0]
        );
        // Into 35 bit: f = 0, 0, 0, 5, 15, 25. W(3) = 15, W(4) = 60 − 5 = 55, W(5) = 125 − 20 = 105.
        assert_eq!([2.0, 3.0, 4.0, 5.0].map(|age| overflow_index(10.0, 35.0, age)), [0.0, 15.0, 55.0, 105.0]);
    }

    proptest! {
        /// The definition: at the price W(h) services at age h and at h + 1 cost the same, and no other age less.
        #[test]
        fn serving_and_waiting_are_equal_at_the_price_of_the_index(
            mean_bits in 1.0..50.0, capacity_bits in 1u32..400, age in 1u32..60,
        ) {
            let capacity_bits = f64::from(capacity_bits);
            let price_bits = overflow_index(mean_bits, capacity_bits, age.into());
            let average = |age| average_bits(mean_bits, capacity_bits, age, price_bits);
            let tolerance = 1e-9 * (1.0 + average(age));
            prop_assume!(price_bits > 0.0); // without a price every age without a loss costs nothing
            prop_assert!((average(age) - average(age + 1)).abs() < tolerance, "{} {}", average(age), average(age + 1));
            for other in 1..120 {
                prop_assert!(average(other) > average(age) - tolerance, "served at {other}");
            }
        }

        #[test]
        fn the_index_does_not_decrease_with_age(mean_bits in 0.1..50.0, capacity_bits in 1u32..400, age in 0u32..500) {
            let index = |age: u32| overflow_index(mean_bits, capacity_bits.into(), age.into());
            prop_assert!(index(age) >= 0.0 && index(age + 1) >= index(age) * (1.0 - 1e-12));
        }
    }

    /// The field of these SNs, x, y [m] and rate [bit/s], with buffers of 1 000 bit.
    fn field_of(sensors: &[[f64; 3]]) -> OwnedSetup {
        field(sensors.iter().map(|&[x_m, y_m, sampling_bps]| ([x_m, y_m], sampling_bps, 1_000)))
    }

    /// Where it flies from (50, 50) in slot 1.
    fn waypoint(sensors: &[[f64; 3]], queues_bits: &[u32]) -> Option<[f64; 2]> {
        let field = field_of(sensors);
        let mut whittle = Whittle::new(&field.setup());
        whittle.plan(&view(&field.table, 1, [50.0, 50.0], queues_bits)).map(|decision| decision.waypoint.xy().into())
    }

    #[test]
    fn whittle_flies_to_the_largest_index_per_slot_of_flight() {
        // 100 bit a slot, C = 10; both full, age 10. SN 0 is 30 m away, in range after 1 slot: h = 11, f(11) = 100, W =
        // 11 · 200 − 100 = 2100. SN 1 is 48 m away, in range after 2: h = 12, W = 12 · 300 − 300 = 3300, 1650 a slot.
        let sensors = [[50.0, 80.0, 100.0], [98.0, 50.0, 100.0]];
        assert_eq!(waypoint(&sensors, &[1_000, 1_000]), Some([50.0, 80.0]));
        // SN 0 with room for 1 slot, age 9: h = 10, W = 10 · 100 = 1000, less than 1650.
        assert_eq!(waypoint(&sensors, &[900, 1_000]), Some([80.0, 50.0]));
    }

    #[test]
    fn ties_of_index_go_to_the_earliest_deadline_then_the_nearest_then_the_lowest_id() {
        let sensors = [[50.0, 80.0, 10.0], [60.0, 50.0, 10.0], [50.0, 40.0, 10.0], [50.0, 51.0, 0.0]];
        assert_eq!(waypoint(&sensors, &[20, 10, 10, 1_000]), Some([50.0, 80.0]));
        assert_eq!(waypoint(&sensors, &[10, 10, 10, 1_000]), Some([60.0, 50.0]));
        assert_eq!(waypoint(&sensors[3..], &[1_000]), None, "nobody samples");
        assert_eq!(waypoint(&[], &[]), None);
    }

    #[test]
    fn the_longest_full_buffer_comes_first() {
        let field = field_of(&[[50.0, 20.0, 100.0], [50.0, 80.0, 100.0]]);
        let mut whittle = Whittle::new(&field.setup());
        let mut goal = |slot, queues_bits: &[u32]| {
            whittle.plan(&view(&field.table, slot, [50.0, 50.0], queues_bits)).unwrap().waypoint.y
        };
        assert_eq!(goal(1, &[900, 1_000]), 80.0);
        assert_eq!(goal(2, &[1_000, 1_000]), 80.0, "full since slot 1, not 2");
        assert_eq!(goal(3, &[1_000, 900]), 20.0, "SN 1 was served");
        assert_eq!(goal(4, &[1_000, 1_000]), 20.0, "SN 1 is full since slot 4 only");
    }

    #[test]
    fn the_largest_indices_in_range_are_served() {
        // All above 50 m; SN 5 samples slowly and is full: C = 1000, W = 1001 · 2 − 1 = 2001. The others sample 100:
        // with 1000, 950, 900 and 800 bit W(11) = 2100, W(10) = 1000, W(10) = 1000, W(9) = 0.
        let sensors = [0.0, 1.0, 2.0, 3.0, 4.0].map(|step| [50.0 + step, 50.0, 100.0]);
        let field = field_of(&[&sensors[..], &[[50.0, 51.0, 1.0]]].concat());
        let mut whittle = Whittle::new(&field.setup());
        let decision = whittle.plan(&view(&field.table, 1, [50.0, 50.0], &[800, 900, 1_000, 950, 700, 1_000])).unwrap();
        assert_eq!(decision.schedule[..], [1, 2, 3, 5]);
    }

    #[test]
    fn a_restored_checkpoint_continues_and_one_of_another_field_is_refused() {
        let field = field_of(&[[50.0, 20.0, 100.0], [50.0, 80.0, 100.0]]);
        let mut whittle = Whittle::new(&field.setup());
        whittle.plan(&view(&field.table, 1, [50.0, 50.0], &[900, 1_000]));
        let mut bytes = Vec::new();
        whittle.save(&mut bytes);
        let later = view(&field.table, 2, [50.0, 50.0], &[1_000, 1_000]);
        let mut fresh = Whittle::new(&field.setup());
        assert_eq!(fresh.plan(&later).unwrap().waypoint.y, 20.0, "it has not seen slot 1");
        fresh.restore(&bytes).unwrap();
        assert_eq!(fresh.plan(&later).unwrap().waypoint.y, 80.0);
        let other = field_of(&[[50.0, 20.0, 100.0]; 3]);
        assert_eq!(
            Whittle::new(&other.setup()).restore(&bytes).unwrap_err().to_string(),
            "checkpoint: expected a slot for each sensor node"
        );
    }
}
