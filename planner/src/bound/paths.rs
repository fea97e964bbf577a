//! Upper bound on the number of sensors that the UAV can serve in some slots, by the lengths of paths.
//!
//! The sensors that are served within K slots lie on a path whose [`legs`] take at most K − 1 slots in all. For any
//! prices `π_i` of the sensors, the weight of a path is that of its legs less the prices of their ends, plus `2 π_i`
//! for each of its sensors, less `π_i` at its two ends. The legs of a path are a spanning tree; [`merge_tree`] bounds
//! the weight of spanning trees from below, for all sets of sensors at once. Any prices and surcharges of legs give a
//! bound; subgradient steps improve it.

pub mod legs;
pub mod merge_tree;

use crate::mission_table::MissionTable;
use legs::{Legs, PricedLeg};
use merge_tree::{BestSet, MergeTree};

/// Most rounds of subgradient ascent, for each of [`FRACTIONS`].
const ROUNDS: u32 = 400;

/// Rounds without a higher weight after which the ascent ends.
const PATIENCE: u32 = 50;

/// Fractions of the sensors for which prices are chosen; every choice bounds every number of sensors.
const FRACTIONS: [f64; 10] = [1.0, 0.97, 0.95, 0.92, 0.88, 0.84, 0.8, 0.75, 0.65, 0.5];

/// First step of prices, as a fraction of the mean leg; it falls to none.
const PRICE_STEP: f64 = 0.1;

/// The same of surcharges.
const SURCHARGE_STEP: f64 = 0.04;

/// Bisection steps for the reward per sensor for which the best set has a given size.
const HALVINGS: u32 = 14;

/// Most sensors whose paths are bounded: there are O(N²) legs.
const MOST_SENSORS: usize = 1_000;

/// Margin of the number of sensors that a set of cuts bounds, against rounding up to the next one.
const COUNT_MARGIN: f64 = 1e-6;

/// Upper bound on the sensors served in some slots.
#[derive(Debug, Clone, PartialEq)]
pub struct PathBound {
    /// Least weight of a path over m sensors [slots], by m − 1.
    weights: Vec<f64>,
    blocks: usize,
}

impl PathBound {
    /// The bound for the sensors of `table`; for more than 1 000 only by the resource blocks.
    #[must_use]
    pub fn new(table: &MissionTable) -> Self {
        let (mut bound, legs) = Self::with_legs(table);
        let Some(mut legs) = legs else { return bound };
        let count = table.sensors.positions.len();
        let longest = bound.weights[count - 1];
        if longest <= (count / bound.blocks) as f64 {
            return bound; // the bound by the resource blocks is stronger
        }
        let mean_leg = (longest / (count - 1) as f64).max(1.0);
        for fraction in FRACTIONS {
            let target = ((count as f64 * fraction) as usize).max(2);
            let mut prices = vec![0.0; count];
            let mut weight: f64 = bound.weights.iter().sum();
            let mut raised = 0;
            for round in 0..ROUNDS {
                let (slope, used) = bound.tighten(&legs, &prices, target);
                let sum: f64 = bound.weights.iter().sum();
                if sum > weight {
                    weight = sum;
                    raised = round;
                } else if round > raised + PATIENCE {
                    break;
                }
                let step = mean_leg * (1.0 - f64::from(round) / f64::from(ROUNDS));
                prices.iter_mut().zip(slope).for_each(|(price, slope)| *price += PRICE_STEP * step * slope);
                legs.adjust(&used, SURCHARGE_STEP * step);
            }
        }
        bound
    }

    /// A weaker bound that is much faster to compute: by a spanning tree of the legs, without prices and surcharges.
    #[must_use]
    pub fn by_legs(table: &MissionTable) -> Self {
        Self::with_legs(table).0
    }

    /// The bound without prices, and the legs; `None` if only the resource blocks bound.
    fn with_legs(table: &MissionTable) -> (Self, Option<Legs>) {
        let count = table.sensors.positions.len();
        let mut bound = Self { weights: vec![0.0; count], blocks: table.limits.blocks() };
        if !(2..=MOST_SENSORS).contains(&count) {
            return (bound, None);
        }
        let legs = Legs::new(table);
        bound.tighten(&legs, &vec![0.0; count], count);
        (bound, Some(legs))
    }

    /// Raises the weights to the bounds by `prices` and the surcharges of `legs`. Returns the subgradient with respect
    /// to the prices at about `target` sensors, and the legs that connect these.
    fn tighten(&mut self, legs: &Legs, prices: &[f64], target: usize) -> (Vec<f64>, Vec<PricedLeg>) {
        let count = prices.len();
        let tree = cheapest_tree(legs, prices);
        // A path has one leg, not two, at its first and last sensor.
        let ends: Vec<f64> = (0..).zip(prices).map(|(id, price)| price + legs.end_slots(id)).collect();
        let mut by_end: Vec<usize> = (0..count).collect();
        by_end.sort_unstable_by(|&a, &b| ends[b].total_cmp(&ends[a]).then(a.cmp(&b)));
        let ends_slots = ends[by_end[0]] + ends[by_end[1]];
        let highest_price = prices.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        // With this reward the best set has all sensors.
        let mut high = (tree.last() + 2.0 * highest_price).max(0.0) + 1.0;
        let mut low = 0.0;
        let best_set = |reward: f64| tree.best_set(|sensor| reward - 2.0 * prices[sensor]);
        let mut best = best_set(high);
        self.raise(high, &best, ends_slots);
        for _ in 0..HALVINGS {
            let reward = (low + high) / 2.0;
            let set = best_set(reward);
            self.raise(reward, &set, ends_slots);
            if set.size < target {
                low = reward;
            } else {
                high = reward;
                best = set;
            }
        }
        let (sensors, used) = tree.members(&best);
        let mut slope = vec![0.0; count];
        sensors.iter().for_each(|&sensor| slope[sensor as usize] += 2.0);
        used.iter().flat_map(|leg| leg.ends).for_each(|end| slope[end as usize] -= 1.0);
        by_end[..2].iter().for_each(|&end| slope[end] -= 1.0);
        (slope, used)
    }

    /// Raises the weights by the best set for a `reward` per sensor [slots]: a path over m sensors weighs at least
    /// `reward m − value − ends_slots`.
    fn raise(&mut self, reward: f64, best: &BestSet, ends_slots: f64) {
        for (index, weight) in self.weights.iter_mut().enumerate().skip(1) {
            let bound = reward * (index + 1) as f64 - best.value - ends_slots;
            *weight = weight.max((bound - COUNT_MARGIN).ceil());
        }
    }

    /// Most sensors that can be served in `slots` slots in a row.
    pub fn most(&self, slots: u64) -> usize {
        // A path over more sensors weighs no less than one over some of them.
        let in_time = self.weights.iter().take_while(|weight| **weight + 1.0 <= slots as f64);
        in_time.count().min(self.blocks.saturating_mul(usize::try_from(slots).unwrap_or(usize::MAX)))
    }
}

/// The merge tree of all legs. Of the far legs only those cheaper than the last merge of the near ones can be in it.
fn cheapest_tree(legs: &Legs, prices: &[f64]) -> MergeTree {
    let mut cheap: Vec<PricedLeg> = legs.near(prices).collect();
    let tree = merged(prices.len(), &mut cheap);
    let highest = tree.as_ref().map_or(f64::INFINITY, MergeTree::last);
    let near = cheap.len();
    cheap.extend(legs.far(prices, highest));
    match tree {
        Some(tree) if cheap.len() == near => tree,
        _ => merged(prices.len(), &mut cheap).expect("there is a leg between any two sensors"),
    }
}

fn merged(sensors: usize, legs: &mut [PricedLeg]) -> Option<MergeTree> {
    legs.sort_unstable_by(|a, b| a.priced.total_cmp(&b.priced).then(a.ends.cmp(&b.ends)));
    MergeTree::new(sensors, legs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mission_table::tests::table_of;

    #[test]
    fn path_lengths_bound_the_number_of_visits() {
        // On a line, 50 m apart: 30 m from rim to rim, one slot. From the first to the third rim are 80 m, three slots,
        // as each has to be met on the way; to the last 190 m, seven slots, of which cells of 5 m leave six.
        let paths = PathBound::new(&table_of(&[100.0, 150.0, 200.0, 310.0].map(|x_m| [x_m, 200.0])));
        assert_eq!([0, 1, 2, 3, 4, 5, 6, 7, 8].map(|slots| paths.most(slots)), [0, 1, 2, 2, 3, 3, 3, 4, 4]);
        // Side by side the blocks are the limit.
        let mut table = table_of(&[200.0, 201.0, 202.0].map(|x_m| [x_m, 200.0]));
        table.limits.resource_blocks = 2;
        let paths = PathBound::new(&table);
        assert_eq!([1, 2].map(|slots| paths.most(slots)), [2, 3]);
    }
}
