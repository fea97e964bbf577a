//! The corners of an airspace that see each other, and the shortest ways between them.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use nalgebra::Vector2;

use super::{Airspace, Bends, Polygon};
use crate::geometry::Position;

/// The corners that ways bend at, and the shortest ways between them.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct CornerGraph {
    nodes: Vec<Position>,
    /// Length of the shortest way from node `row` to node `column` [m], by rows; infinite without one.
    lengths_m: Vec<f64>,
    /// The node after `row` on that way.
    next: Vec<u16>,
    /// Whether a way leads from the start to the node.
    is_reached: Vec<bool>,
    start: Position,
}

/// A node that a point sees.
#[derive(Debug, Clone, Copy)]
pub(super) struct SeenNode {
    node: usize,
    /// Distance from the point [m].
    away_m: f64,
}

/// A way over nodes.
#[derive(Debug, Clone, Copy)]
pub(super) struct NodeWay {
    /// Its length, with the ways to its first and from its last node [m].
    pub length_m: f64,
    first: usize,
    last: usize,
}

/// A node that is to be visited, the nearest first.
#[derive(PartialEq)]
struct Pending {
    length_m: f64,
    node: usize,
}

impl Eq for Pending {}

impl Ord for Pending {
    fn cmp(&self, other: &Self) -> Ordering {
        other.length_m.total_cmp(&self.length_m).then(other.node.cmp(&self.node))
    }
}

impl PartialOrd for Pending {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl CornerGraph {
    /// The graph of an airspace in which the UAV begins at `start`.
    pub fn of(airspace: &Airspace, start: &Position) -> Self {
        let corners = airspace.polygons().flat_map(|polygon| beside_corners(polygon, airspace.clearance_m()));
        let nodes: Vec<Position> = corners.filter(|node| airspace.contains(node)).collect();
        let count = nodes.len();
        let mut neighbours: Vec<Vec<(usize, f64)>> = vec![Vec::new(); count];
        for first in 0..count {
            for second in first + 1..count {
                if airspace.is_free(&nodes[first], &nodes[second]) {
                    let length_m = (nodes[second] - nodes[first]).norm();
                    neighbours[first].push((second, length_m));
                    neighbours[second].push((first, length_m));
                }
            }
        }
        let mut graph = Self {
            lengths_m: vec![f64::INFINITY; count * count],
            next: vec![0; count * count],
            is_reached: vec![false; count],
            start: *start,
            nodes,
        };
        for goal in 0..count {
            graph.find_ways_to(goal, &neighbours);
        }
        let seen: Vec<usize> = (0..count).filter(|&node| airspace.is_free(start, &graph.nodes[node])).collect();
        for node in 0..count {
            graph.is_reached[node] = seen.iter().any(|&from| graph.length_m(from, node).is_finite());
        }
        graph
    }

    /// Dijkstra's algorithm, backward from `goal`.
    fn find_ways_to(&mut self, goal: usize, neighbours: &[Vec<(usize, f64)>]) {
        let count = self.nodes.len();
        let mut pending = BinaryHeap::from([Pending { length_m: 0.0, node: goal }]);
        self.lengths_m[goal * count + goal] = 0.0;
        self.next[goal * count + goal] = goal as u16; // at most MAX_CORNERS
        while let Some(Pending { length_m, node }) = pending.pop() {
            if length_m > self.lengths_m[node * count + goal] {
                continue;
            }
            for &(other, step_m) in &neighbours[node] {
                let at = other * count + goal;
                if length_m + step_m < self.lengths_m[at] {
                    self.lengths_m[at] = length_m + step_m;
                    self.next[at] = node as u16;
                    pending.push(Pending { length_m: length_m + step_m, node: other });
                }
            }
        }
    }

    fn length_m(&self, from: usize, to: usize) -> f64 {
        self.lengths_m[from * self.nodes.len() + to]
    }

    /// Where the UAV begins.
    pub fn start(&self) -> Position {
        self.start
    }

    /// The nodes that a way leads to from the start.
    pub fn reachable(&self) -> impl Iterator<Item = &Position> {
        self.nodes.iter().zip(&self.is_reached).filter(|(_, is_reached)| **is_reached).map(|(node, _)| node)
    }

    /// Whether a way leads from the start to a free `point`.
    pub fn reaches(&self, airspace: &Airspace, point: &Position) -> bool {
        airspace.is_free(&self.start, point) || self.reachable().any(|node| airspace.is_free(node, point))
    }

    /// The nodes that `point` sees.
    pub fn seen(&self, airspace: &Airspace, point: &Position) -> Vec<SeenNode> {
        let nodes = self.nodes.iter().enumerate().filter(|(_, node)| airspace.is_free(point, node));
        nodes.map(|(node, at)| SeenNode { node, away_m: (at - point).norm() }).collect()
    }

    /// The shortest way between two points that see these nodes, but not each other; `None` if there is none.
    pub fn shortest(&self, seen: &[SeenNode], ends: &[SeenNode]) -> Option<NodeWay> {
        let mut best = NodeWay { length_m: f64::INFINITY, first: 0, last: 0 };
        for first in seen {
            for last in ends {
                let length_m = first.away_m + self.length_m(first.node, last.node) + last.away_m;
                if length_m < best.length_m {
                    best = NodeWay { length_m, first: first.node, last: last.node };
                }
            }
        }
        best.length_m.is_finite().then_some(best)
    }

    /// Appends the bends of the shortest way from `from` to `to`, neither of which sees the other; false if there is
    /// none.
    pub fn connect(&self, airspace: &Airspace, from: &Position, to: &Position, way: &mut Bends) -> bool {
        let Some(best) = self.shortest(&self.seen(airspace, from), &self.seen(airspace, to)) else { return false };
        let mut node = best.first;
        way.push(self.nodes[node]);
        while node != best.last {
            node = usize::from(self.next[node * self.nodes.len() + best.last]);
            way.push(self.nodes[node]);
        }
        true
    }
}

/// Points `clearance_m` [m] beside the corners that a way around the polygon bends at.
fn beside_corners(polygon: &Polygon, clearance_m: f64) -> impl Iterator<Item = Position> {
    let corners = polygon.corners();
    let count = corners.len();
    (0..count).filter_map(move |index| {
        let at = corners[index];
        let back = (corners[(index + count - 1) % count] - at).normalize();
        let on = (corners[(index + 1) % count] - at).normalize();
        // The forbidden side is to the left.
        let turn = on.perp(&back);
        let is_flat = turn < 1e-9 && back.dot(&on) < 0.0;
        let outward = if is_flat { Vector2::new(on.y, -on.x) } else { -(back + on).normalize() };
        (turn > 0.0).then_some(at + outward * clearance_m)
    })
}
