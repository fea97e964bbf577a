//! How many sources the UAV can serve in some slots at most, by the way between them.
//!
//! Two sources `d` apart are served at least `w = ceil((d − 2 d_c)/(V τ))` slots apart, 0 if `d ≤ 2 d_c`: each is within
//! `d_c` of the UAV then. So m sources that are all served within K slots lie on a path of m − 1 edges whose weights w
//! sum up to at most K − 1. Every such path weighs at least, for any numbers `π_i`: the m − 1 edges of least
//! `w − π_i − π_j` that close no circle (a path closes none), plus twice the m least `π_i` (an inner node has two edges),
//! less the two largest (its ends have one).

use nalgebra::Point2;

use super::world::World;

/// Rounds of subgradient ascent over `π`, for each of [`SHARES`].
const ROUNDS: u32 = 40;

/// Shares of the sources for which `π` is chosen; every choice bounds every number of sources.
const SHARES: [f64; 5] = [1.0, 0.9, 0.8, 0.65, 0.5];

/// First step of the ascent [slots]; it falls to none.
const STEP: f64 = 0.5;

/// Most sources for which the way is counted: edges grow with their square.
const MOST_SOURCES: usize = 600;

/// Keeps rounding from raising a weight or a bound to the next slot.
const ROUNDING: f64 = 1e-6;

/// Most sources served in some slots.
#[derive(Debug, Clone, PartialEq)]
pub struct Reachable {
    /// Least weight of a path over m sources [slots], by m − 1.
    weights: Vec<f64>,
    blocks: usize,
}

struct Edge {
    weight: f64,
    priced: f64,
    ends: [u32; 2],
}

impl Reachable {
    /// Counts the way between the sources of `world`; above 600 of them only the resource blocks.
    #[must_use]
    pub fn new(world: &World) -> Self {
        let count = world.positions.len();
        let mut reachable = Self { weights: vec![0.0; count], blocks: world.blocks() };
        if (2..=MOST_SOURCES).contains(&count) {
            let mut edges = edges(&world.positions, world.radius_m(), world.reach_m());
            let mut prices = vec![0.0; count];
            reachable.tighten(&mut edges, &prices, count);
            if reachable.weights[count - 1] <= (count / reachable.blocks) as f64 {
                return reachable; // so near to each other that the resource blocks tell more
            }
            for share in SHARES {
                let target = ((count as f64 * share) as usize).max(2);
                for round in 0..ROUNDS {
                    let slope = reachable.tighten(&mut edges, &prices, target);
                    let step = STEP * (1.0 - f64::from(round) / f64::from(ROUNDS));
                    prices.iter_mut().zip(slope).for_each(|(price, slope)| *price += step * slope);
                }
            }
        }
        reachable
    }

    /// The bound by one set of prices `π`, for every m; returns its slope over `π` at `target` sources.
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
        let (mut joined, mut weight) = (1, 0.0);
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

    /// Most sources that can be served in `slots` slots in a row.
    #[must_use]
    pub fn most(&self, slots: i32) -> usize {
        let most = self.blocks.saturating_mul(slots.max(0) as usize);
        // A path over more sources weighs no less than one over some of them.
        let too_far = |weight: &f64| *weight > f64::from(slots - 1);
        let first = self.weights.iter().position(too_far).unwrap_or(self.weights.len());
        most.min(first)
    }
}

fn edges(positions: &[Point2<f64>], radius_m: f64, reach_m: f64) -> Vec<Edge> {
    let mut edges = Vec::with_capacity(positions.len() * positions.len() / 2);
    for (i, a) in positions.iter().enumerate() {
        for (j, b) in positions[..i].iter().enumerate() {
            let between_m = (a - b).norm() - 2.0 * radius_m;
            let weight = (between_m / reach_m - ROUNDING).ceil().max(0.0);
            edges.push(Edge { weight, priced: weight, ends: [i as u32, j as u32] });
        }
    }
    edges
}

fn root(parents: &mut [u32], mut node: u32) -> u32 {
    while parents[node as usize] != node {
        parents[node as usize] = parents[parents[node as usize] as usize];
        node = parents[node as usize];
    }
    node
}
