//! Lower bound on the weight of every spanning tree of every set of sensors, by the order in which legs of increasing
//! price merge the sensors into one component (Kruskal).
//!
//! The legs cheaper than a price x connect the sensors into components. A tree over a set of sensors in k of them has
//! at least k − 1 legs of price x or more. So its weight is at least the price of the cheapest leg times its number of
//! legs, plus the integral of `k(x) − 1` over x above that price. A component that exists from x1 to x2 contributes `x2
//! − x1` if the set has a sensor in it, so the best set for given rewards is found by one pass over the components.

use super::legs::PricedLeg;

/// The components in the order of their creation, beginning with the single sensors.
#[derive(Debug, Clone)]
pub struct MergeTree {
    sensors: usize,
    /// By component: the price at which it is created.
    births: Vec<f64>,
    /// By merge, in order: the two components that merge, and the leg.
    merges: Vec<([u32; 2], PricedLeg)>,
}

/// The set of sensors that maximises rewards less weight.
#[derive(Debug, Clone)]
pub struct BestSet {
    /// Rewards less a lower bound on the weight of every spanning tree of the set.
    pub value: f64,
    /// Sensors in it.
    pub size: usize,
    /// By component: its value, if the set has a sensor in it.
    values: Vec<f64>,
}

impl MergeTree {
    /// The tree over `sensors` sensors, at least 2, by `legs` sorted by price; `None` if they do not connect all.
    #[must_use]
    pub fn new(sensors: usize, legs: &[PricedLeg]) -> Option<Self> {
        let cheapest = legs.first()?.priced;
        let mut tree = Self { sensors, births: vec![cheapest; sensors], merges: Vec::with_capacity(sensors - 1) };
        let mut parents: Vec<u32> = (0..sensors as u32).collect();
        let mut components = parents.clone();
        for leg in legs {
            let [a, b] = leg.ends.map(|end| root(&mut parents, end));
            if a == b {
                continue;
            }
            tree.merges.push(([components[a as usize], components[b as usize]], *leg));
            parents[a as usize] = b;
            components[b as usize] = tree.births.len() as u32;
            tree.births.push(leg.priced);
            if tree.merges.len() == sensors - 1 {
                return Some(tree);
            }
        }
        None
    }

    /// The price of the last merge.
    pub fn last(&self) -> f64 {
        self.births[self.births.len() - 1]
    }

    /// The best set of at least one sensor, if sensor i has the reward `rewards(i)`.
    pub fn best_set(&self, rewards: impl Fn(usize) -> f64) -> BestSet {
        let cheapest = self.births[0];
        let mut values: Vec<f64> = (0..self.sensors).map(|sensor| rewards(sensor) - cheapest).collect();
        let mut sizes = vec![1; self.sensors];
        for (parts, leg) in &self.merges {
            let mut value = 0.0;
            let mut size = 0;
            for part in self.kept(parts, leg, &values) {
                value += self.worth(part, leg, &values);
                size += sizes[part as usize];
            }
            values.push(value);
            sizes.push(size);
        }
        let last = values.len() - 1;
        BestSet { value: values[last] + self.last(), size: sizes[last], values }
    }

    /// The value that a component adds to the one into which it is merged by `leg`.
    fn worth(&self, part: u32, leg: &PricedLeg, values: &[f64]) -> f64 {
        values[part as usize] - (leg.priced - self.births[part as usize])
    }

    /// Those of two merging components that are in the best set: those of positive worth, or the better one.
    fn kept(&self, parts: &[u32; 2], leg: &PricedLeg, values: &[f64]) -> impl Iterator<Item = u32> {
        let [first, second] = parts.map(|part| self.worth(part, leg, values));
        let kept = [first > 0.0 || first >= second, second > 0.0 || second > first];
        parts.iter().copied().zip(kept).filter_map(|(part, is_kept)| is_kept.then_some(part))
    }

    /// The sensors of a best set, and the legs that connect them.
    pub fn members(&self, best: &BestSet) -> (Vec<u32>, Vec<PricedLeg>) {
        let mut sensors = Vec::with_capacity(best.size);
        let mut legs = Vec::with_capacity(best.size);
        let mut open = vec![(best.values.len() - 1) as u32];
        while let Some(component) = open.pop() {
            let Some(merge) = (component as usize).checked_sub(self.sensors) else {
                sensors.push(component);
                continue;
            };
            let (parts, leg) = &self.merges[merge];
            let before = open.len();
            open.extend(self.kept(parts, leg, &best.values));
            if open.len() == before + 2 {
                legs.push(*leg);
            }
        }
        (sensors, legs)
    }
}

fn root(parents: &mut [u32], mut node: u32) -> u32 {
    while parents[node as usize] != node {
        parents[node as usize] = parents[parents[node as usize] as usize];
        node = parents[node as usize];
    }
    node
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SENSORS: usize = 6;

    fn tree_of(prices: &[f64]) -> (Vec<PricedLeg>, MergeTree) {
        let pairs = (0..SENSORS as u32).flat_map(|first| (0..first).map(move |second| [first, second]));
        let leg = |(ends, &priced): ([u32; 2], &f64)| PricedLeg { priced, ends, cells: None };
        let mut legs: Vec<PricedLeg> = pairs.zip(prices).map(leg).collect();
        legs.sort_by(|a, b| a.priced.total_cmp(&b.priced));
        let tree = MergeTree::new(SENSORS, &legs).unwrap();
        (legs, tree)
    }

    /// Weight of the cheapest tree over a set of sensors, by Kruskal's algorithm on the legs within it.
    fn cheapest(legs: &[PricedLeg], set: u32) -> f64 {
        let mut parents: Vec<u32> = (0..SENSORS as u32).collect();
        let mut weight = 0.0;
        for leg in legs.iter().filter(|leg| leg.ends.iter().all(|end| set >> end & 1 == 1)) {
            let [a, b] = leg.ends.map(|end| root(&mut parents, end));
            if a != b {
                parents[a as usize] = b;
                weight += leg.priced;
            }
        }
        weight
    }

    proptest! {
        #[test]
        fn no_set_exceeds_the_best_set(
            prices in prop::collection::vec(-2.0..5.0, SENSORS * (SENSORS - 1) / 2),
            rewards in prop::collection::vec(-3.0..4.0, SENSORS),
        ) {
            let (legs, tree) = tree_of(&prices);
            let best = tree.best_set(|sensor| rewards[sensor]);
            let worth = |set: u32| {
                let rewards: f64 = (0..SENSORS).filter(|sensor| set >> sensor & 1 == 1).map(|sensor| rewards[sensor]).sum();
                rewards - cheapest(&legs, set)
            };
            for set in 1u32..1 << SENSORS {
                prop_assert!(worth(set) <= best.value + 1e-9, "{:b}: {} above {}", set, worth(set), best.value);
            }
            let (members, used) = tree.members(&best);
            prop_assert_eq!((members.len(), used.len()), (best.size, best.size - 1));
        }

        #[test]
        fn high_rewards_make_all_sensors_the_best_set(
            prices in prop::collection::vec(-2.0..5.0, SENSORS * (SENSORS - 1) / 2),
        ) {
            let (legs, tree) = tree_of(&prices);
            let best = tree.best_set(|_| 100.0);
            prop_assert_eq!(best.size, SENSORS);
            prop_assert!((best.value - (600.0 - cheapest(&legs, (1 << SENSORS) - 1))).abs() < 1e-9);
        }
    }
}
