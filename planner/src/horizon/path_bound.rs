//! A lower bound on the slots in which some sensors are served, by the paths between them; so at most how many the UAV
//! can serve in some slots.
//!
//! Two sensors `d` apart are served at least `w = ceil((d − 2 d_c)/(V τ))` slots apart, 0 if `d ≤ 2 d_c`: each is
//! within `d_c` of the UAV then. So m sensors that are all served within K slots lie on a path of m − 1 edges whose
//! weights w sum up to at most K − 1. Every such path weighs at least, for any numbers `π_i`: the m − 1 edges of least
//! `w − π_i − π_j` that close no circle (a path closes none), plus twice the m least `π_i` (an inner node has two
//! edges), less the two largest (its ends have one).

use crate::sensor_table::SensorTable;

/// Rounds of subgradient ascent over `π`, for each of [`FRACTIONS`].
const ROUNDS: u32 = 40;

/// Fractions of the sensors for which `π` is chosen; every choice bounds every number of sensors.
const FRACTIONS: [f64; 5] = [1.0, 0.9, 0.8, 0.65, 0.5];

/// First step of the ascent [slots]; it falls to none.
const STEP: f64 = 0.5;

/// Most sensors whose paths are bounded: edges grow with their square.
const MOST_SENSORS: usize = 600;

/// Keeps rounding from raising a weight or a bound to the next slot.
const ROUNDING: f64 = 1e-6;

/// Most sensors served in some slots.
#[derive(Debug, Clone, PartialEq)]
pub struct PathBound {
    /// Least weight of a path over m sensors [slots], by m − 1.
    weights: Vec<f64>,
    blocks: usize,
}

struct Edge {
    weight: f64,
    priced: f64,
    ends: [u32; 2],
}

impl PathBound {
    /// The bound over the sensors of `table`; above 600 of them by the resource blocks alone.
    #[must_use]
    pub fn new(table: &SensorTable) -> Self {
        let count = table.positions.len();
        let mut bound = Self { weights: vec![0.0; count], blocks: table.resource_blocks };
        if (2..=MOST_SENSORS).contains(&count) {
            let mut edges = edges(table);
            let mut prices = vec![0.0; count];
            bound.tighten(&mut edges, &prices, count);
            if bound.weights[count - 1] <= (count / bound.blocks) as f64 {
                return bound; // so near to each other that the resource blocks tell more
            }
            for fraction in FRACTIONS {
                let target = ((count as f64 * fraction) as usize).max(2);
                for round in 0..ROUNDS {
                    let slope = bound.tighten(&mut edges, &prices, target);
                    let step = STEP * (1.0 - f64::from(round) / f64::from(ROUNDS));
                    prices.iter_mut().zip(slope).for_each(|(price, slope)| *price += step * slope);
                }
            }
        }
        bound
    }

    /// The bound by one set of prices `π`, for every m; returns its slope over `π` at `target` sensors.
    fn tighten(&mut self, edges: &mut [Edge], prices: &[f64], target: usize) -> Vec<f64> {
        for edge in edges.iter_mut() {
            edge.priced = edge.weight - prices[edge.ends[0] as usize] - prices[edge.ends[1] as usize];
        }
        edges.sort_unstable_by(|a, b| a.priced.total_cmp(&b.priced).then(a.ends.cmp(&b.ends)));
        let count = prices.len();
        let mut sorted: Vec<u32> = (0..count as u32).collect();
        sorted.sort_unstable_by(|&a, &b| prices[a as usize].total_cmp(&prices[b as usize]).then(a.cmp(&b)));
        let price = |rank: usize| prices[sorted[rank] as usize];
        let largest = price(count - 1) + price(count - 2);
        let mut slope = vec![0.0; count];
        sorted[..target].iter().for_each(|&node| slope[node as usize] += 2.0);
        sorted[count - 2..].iter().for_each(|&node| slope[node as usize] -= 1.0);
        let mut parents: Vec<u32> = (0..count as u32).collect();
        let mut joined = 1;
        let mut weight = 0.0;
        let mut twice_least = 2.0 * price(0);
        for edge in edges.iter() {
            let [a, b] = edge.ends.map(|end| root(&mut parents, end));
            if a == b {
                continue;
            }
            parents[a as usize] = b;
            if joined < target {
                edge.ends.iter().for_each(|&end| slope[end as usize] -= 1.0);
            }
            weight += edge.priced;
            twice_least += 2.0 * price(joined);
            let bound = (weight + twice_least - largest - ROUNDING).ceil();
            self.weights[joined] = self.weights[joined].max(bound);
            joined += 1;
        }
        slope
    }

    /// Most sensors that can be served in `slots` slots in a row.
    #[must_use]
    pub fn most(&self, slots: i32) -> usize {
        // A path over more sensors weighs no less than one over some of them.
        let in_time = self.weights.iter().take_while(|weight| **weight <= f64::from(slots - 1));
        in_time.count().min(self.blocks.saturating_mul(slots.max(0) as usize))
    }
}

fn edges(table: &SensorTable) -> Vec<Edge> {
    let weight = |a: u32, b: u32| {
        let between_m = (table.position(a) - table.position(b)).norm() - 2.0 * table.comm_radius_m;
        (between_m / table.reach_m - ROUNDING).ceil().max(0.0)
    };
    let edge = |a: u32, b: u32| Edge { weight: weight(a, b), priced: 0.0, ends: [a, b] };
    table.ids().flat_map(|a| (0..a).map(move |b| edge(a, b))).collect()
}

fn root(parents: &mut [u32], mut node: u32) -> u32 {
    while parents[node as usize] != node {
        parents[node as usize] = parents[parents[node as usize] as usize];
        node = parents[node as usize];
    }
    node
}
