//! Ways around corners: the shortest in the graph of the corners of an airspace that see each other.
//!
//! A shortest way is taut: at each bend the zone lies within the bend. So a corner is joined only to those that it sees
//! along its zone, not across it. What is asked for is kept: the ways to a corner, and those to a point.

use std::cmp::Ordering;
use std::collections::{BinaryHeap, HashMap};
use std::sync::{Arc, OnceLock, PoisonError, RwLock};

use nalgebra::Vector2;

use super::boxes::LENGTH_SLACK;
use super::contacts::ANGLE_SLACK;
use super::ground::ClosedGround;
use super::polygon::{Bends, Polygon};
use super::ways::Ways;
use crate::geometry::{Position, distance_squared, length_m};

/// Most lengths that are kept for points [8 bytes].
const MOST_KEPT: usize = 4_000_000;

/// The shortest ways between zones.
#[derive(Debug, PartialEq)]
pub(super) struct BentWays {
    graph: CornerGraph,
    /// Where the boundaries of zones that overlap cross [m].
    crossings: Vec<Position>,
}

impl BentWays {
    /// The ways over a ground with zones, for a UAV that begins at `start` [m].
    pub fn of(ground: &ClosedGround, start: &Position) -> Self {
        let polygons: Vec<&Polygon> = ground.polygons().collect();
        let pairs = (1..polygons.len()).flat_map(|second| (0..second).map(move |first| [first, second]));
        let crossings = pairs.flat_map(|[first, second]| polygons[first].crossings(polygons[second])).collect();
        Self { graph: CornerGraph::of(ground, start), crossings }
    }

    fn is_reachable(&self, ground: &ClosedGround, point: &Position) -> bool {
        ground.contains(point) && self.graph.reaches(ground, point)
    }

    /// The point beside zones that is nearest to `point` [m], which is not reachable.
    fn find_nearest(&self, ground: &ClosedGround, point: &Position) -> Position {
        let projections = ground.polygons().flat_map(|polygon| polygon.projections(point));
        let rims = projections.chain(self.crossings.iter().copied()).map(|rim| (rim, true));
        let mut beside: Vec<(Position, bool)> = rims.chain(ground.contacts.beside().map(|rim| (rim, false))).collect();
        beside.sort_by(|a, b| distance_squared(&a.0, point).total_cmp(&distance_squared(&b.0, point)));
        let outward = |&(projected, is_rim): &(Position, bool)| {
            let away = projected - point;
            let clearance_m = if is_rim { ground.clearance_m() } else { 0.0 };
            // To either side of the edge; one of them is free.
            [1.0, -1.0].map(|side| projected + away.try_normalize(0.0).unwrap_or_default() * (side * clearance_m))
        };
        let free = beside.iter().flat_map(outward).find(|point| self.is_reachable(ground, point));
        free.unwrap_or_else(|| {
            let nodes = self.graph.reachable(ground);
            let nearest = nodes.min_by(|a, b| distance_squared(a, point).total_cmp(&distance_squared(b, point)));
            nearest.copied().unwrap_or(self.graph.start())
        })
    }
}

impl Ways for Arc<BentWays> {
    fn nearest(&self, ground: &ClosedGround, point: &Position) -> Position {
        self.graph
            .nearest(point, || if self.is_reachable(ground, point) { *point } else { self.find_nearest(ground, point) })
    }

    fn is_reachable(&self, ground: &ClosedGround, point: &Position) -> bool {
        BentWays::is_reachable(self, ground, point)
    }

    fn way(&self, ground: &ClosedGround, from: &Position, to: &Position) -> Bends {
        if ground.is_clear(from, to) {
            return Bends::from_slice(&[*to]);
        }
        let end = self.nearest(ground, to);
        let begin = if ground.contains(from) { *from } else { self.nearest(ground, from) };
        let mut way = Bends::new();
        if begin != *from {
            way.push(begin);
        }
        if ground.is_clear(&begin, &end) {
            way.push(end);
            return way;
        }
        if !self.graph.connect(ground, &begin, &end, &mut way) {
            return Bends::new();
        }
        way.push(end);
        // A bend that is already reached.
        while way.len() > 1 && (way[0] - from).norm() <= ground.clearance_m() && ground.is_clear(from, &way[1]) {
            way.remove(0);
        }
        way
    }

    fn distance_m(&self, ground: &ClosedGround, from: &Position, to: &Position) -> f64 {
        if ground.is_clear(from, to) {
            return (to - from).norm();
        }
        let way = self.way(ground, from, to);
        if way.is_empty() { f64::INFINITY } else { length_m(from, &way) }
    }

    fn between_m(&self, ground: &ClosedGround, from: &Position, to: &Position) -> f64 {
        if ground.is_clear(from, to) {
            return (to - from).norm();
        }
        self.graph.shortest(ground, from, to).map_or(f64::INFINITY, |way| way.length_m)
    }
}

/// The corners that ways bend at, and the shortest ways between them.
#[derive(Debug, Default)]
struct CornerGraph {
    nodes: Vec<Node>,
    clearance_m: f64,
    start: Position,
    /// The nodes that each sees, with the distances [m].
    neighbours: OnceLock<Vec<Vec<(usize, f64)>>>,
    /// Whether a way leads from the start to the node.
    is_reached: OnceLock<Vec<bool>>,
    /// The ways to each node.
    ways_to: Vec<OnceLock<WaysTo>>,
    /// Ways to points, by their bits.
    goals: RwLock<HashMap<[u64; 2], Arc<Goal>>>,
    /// Reachable points that are nearest to points, by their bits.
    nearest: RwLock<HashMap<[u64; 2], Position>>,
}

impl PartialEq for CornerGraph {
    /// What is found from the rest is not compared.
    fn eq(&self, other: &Self) -> bool {
        self.nodes == other.nodes && self.start == other.start
    }
}

/// A place beside a corner.
#[derive(Debug, Clone, PartialEq)]
struct Node {
    at: Position,
    /// Unit vectors from the corner along the edges of its zone.
    edges: [Vector2<f64>; 2],
}

/// The shortest ways from all nodes to one.
#[derive(Debug)]
struct WaysTo {
    /// Their lengths [m]; infinite without one.
    lengths_m: Box<[f64]>,
    /// The next node of each.
    next: Box<[u16]>,
}

/// A point that ways lead to.
#[derive(Debug)]
struct Goal {
    /// The nodes that it sees.
    seen: Vec<SeenNode>,
    /// Length of the shortest way from each node [m], up to rounding.
    to_go_m: Box<[f64]>,
}

/// A node that a point sees.
#[derive(Debug, Clone, Copy)]
struct SeenNode {
    node: usize,
    /// Distance from the point [m].
    away_m: f64,
}

/// A way over nodes.
#[derive(Debug, Clone, Copy)]
struct NodeWay {
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
    /// The graph over a ground on which the UAV begins at `start`.
    pub fn of(ground: &ClosedGround, start: &Position) -> Self {
        let clearance_m = ground.clearance_m();
        let corners = ground.polygons().flat_map(|polygon| beside_corners(polygon, clearance_m));
        let nodes: Vec<Node> = corners.filter(|node| ground.contains(&node.at)).collect();
        let ways_to = nodes.iter().map(|_| OnceLock::new()).collect();
        Self { nodes, clearance_m, start: *start, ways_to, ..Self::default() }
    }

    /// The nodes that each node sees.
    fn neighbours(&self, ground: &ClosedGround) -> &[Vec<(usize, f64)>] {
        self.neighbours.get_or_init(|| {
            let mut neighbours: Vec<Vec<(usize, f64)>> = vec![Vec::new(); self.nodes.len()];
            for (first, node) in self.nodes.iter().enumerate() {
                for (second, other) in self.nodes.iter().enumerate().skip(first + 1) {
                    let may_bend =
                        node.may_bend(&other.at, self.clearance_m) && other.may_bend(&node.at, self.clearance_m);
                    if may_bend && ground.is_clear(&node.at, &other.at) {
                        let length_m = (other.at - node.at).norm();
                        neighbours[first].push((second, length_m));
                        neighbours[second].push((first, length_m));
                    }
                }
            }
            neighbours
        })
    }

    /// The ways to the node `goal`, by Dijkstra's algorithm.
    fn ways_to(&self, ground: &ClosedGround, goal: usize) -> &WaysTo {
        self.ways_to[goal].get_or_init(|| {
            let neighbours = self.neighbours(ground);
            let count = self.nodes.len();
            let mut ways = WaysTo { lengths_m: vec![f64::INFINITY; count].into(), next: vec![0; count].into() };
            let mut pending = BinaryHeap::from([Pending { length_m: 0.0, node: goal }]);
            ways.lengths_m[goal] = 0.0;
            ways.next[goal] = goal as u16; // at most MAX_CORNERS
            while let Some(Pending { length_m, node }) = pending.pop() {
                if length_m > ways.lengths_m[node] {
                    continue;
                }
                for &(other, step_m) in &neighbours[node] {
                    if length_m + step_m < ways.lengths_m[other] {
                        ways.lengths_m[other] = length_m + step_m;
                        ways.next[other] = node as u16;
                        pending.push(Pending { length_m: length_m + step_m, node: other });
                    }
                }
            }
            ways
        })
    }

    /// Whether a way leads from the start to each node.
    fn is_reached(&self, ground: &ClosedGround) -> &[bool] {
        self.is_reached.get_or_init(|| {
            let neighbours = self.neighbours(ground);
            let mut pending: Vec<usize> = self.seen(ground, &self.start).iter().map(|seen| seen.node).collect();
            let mut is_reached = vec![false; self.nodes.len()];
            while let Some(node) = pending.pop() {
                if !std::mem::replace(&mut is_reached[node], true) {
                    pending.extend(neighbours[node].iter().map(|(other, _)| other));
                }
            }
            is_reached
        })
    }

    /// Where the UAV begins.
    pub fn start(&self) -> Position {
        self.start
    }

    /// The nodes that a way leads to from the start.
    pub fn reachable(&self, ground: &ClosedGround) -> impl Iterator<Item = &Position> {
        let nodes = self.nodes.iter().zip(self.is_reached(ground));
        nodes.filter(|(_, is_reached)| **is_reached).map(|(node, _)| &node.at)
    }

    /// Whether a way leads from the start to a free `point`.
    pub fn reaches(&self, ground: &ClosedGround, point: &Position) -> bool {
        if ground.is_clear(&self.start, point) {
            return true;
        }
        // The nearest ones are the likeliest.
        let mut nodes: Vec<&Position> = self.reachable(ground).collect();
        nodes.sort_by(|a, b| distance_squared(a, point).total_cmp(&distance_squared(b, point)));
        nodes.iter().any(|node| ground.is_clear(node, point))
    }

    /// The kept reachable point nearest to `point`, or that which `find` finds.
    pub fn nearest(&self, point: &Position, find: impl FnOnce() -> Position) -> Position {
        kept(&self.nearest, MOST_KEPT / 40, point, find)
    }

    /// The nodes that `point` sees, and a way that comes from there may bend at.
    fn seen(&self, ground: &ClosedGround, point: &Position) -> Vec<SeenNode> {
        let nodes = self.nodes.iter().enumerate();
        let seen = nodes.filter(|(_, node)| node.may_bend(point, self.clearance_m) && ground.is_clear(point, &node.at));
        seen.map(|(node, Node { at, .. })| SeenNode { node, away_m: (at - point).norm() }).collect()
    }

    /// What is known of the ways to `point`.
    fn goal(&self, ground: &ClosedGround, point: &Position) -> Arc<Goal> {
        let find = || {
            let seen = self.seen(ground, point);
            let mut to_go_m = vec![f64::INFINITY; self.nodes.len()].into_boxed_slice();
            for SeenNode { node, away_m } in &seen {
                for (least_m, length_m) in to_go_m.iter_mut().zip(&self.ways_to(ground, *node).lengths_m) {
                    *least_m = least_m.min(length_m + away_m);
                }
            }
            Arc::new(Goal { seen, to_go_m })
        };
        kept(&self.goals, MOST_KEPT / self.nodes.len().max(1), point, find)
    }

    /// The shortest way between two points that do not see each other; `None` if there is none.
    pub fn shortest(&self, ground: &ClosedGround, from: &Position, to: &Position) -> Option<NodeWay> {
        let goal = self.goal(ground, to);
        // The nodes that `from` sees, in the order of the lengths of the ways over them, as far as they may be the
        // first.
        let over = self.nodes.iter().zip(&goal.to_go_m).enumerate().filter(|(_, (_, to_go_m))| to_go_m.is_finite());
        let over = over.map(|(node, (at, to_go_m))| Pending { length_m: (at.at - from).norm() + to_go_m, node });
        let mut over = BinaryHeap::from(over.collect::<Vec<_>>());
        let mut least_m = f64::INFINITY;
        let mut firsts: Vec<usize> = Vec::new();
        while let Some(Pending { length_m, node: first }) = over.pop() {
            if length_m > least_m * (1.0 + LENGTH_SLACK) {
                break;
            }
            let node = &self.nodes[first];
            if node.may_bend(from, self.clearance_m) && ground.is_clear(from, &node.at) {
                least_m = least_m.min(length_m);
                firsts.push(first);
            }
        }
        firsts.sort_unstable(); // of equal ways the first one
        let mut best = NodeWay { length_m: f64::INFINITY, first: 0, last: 0 };
        for first in firsts {
            let away_m = (self.nodes[first].at - from).norm();
            for last in &goal.seen {
                let length_m = away_m + self.ways_to(ground, last.node).lengths_m[first] + last.away_m;
                if length_m < best.length_m {
                    best = NodeWay { length_m, first, last: last.node };
                }
            }
        }
        best.length_m.is_finite().then_some(best)
    }

    /// Appends the bends of the shortest way from `from` to `to`, neither of which sees the other; false if there is
    /// none.
    pub fn connect(&self, ground: &ClosedGround, from: &Position, to: &Position, way: &mut Bends) -> bool {
        let Some(best) = self.shortest(ground, from, to) else { return false };
        let ways = self.ways_to(ground, best.last);
        let mut node = best.first;
        way.push(self.nodes[node].at);
        while node != best.last {
            node = usize::from(ways.next[node]);
            way.push(self.nodes[node].at);
        }
        true
    }
}

/// What is kept in `all`, up to `most` points, for `point`, or else what `find` finds.
fn kept<T: Clone>(all: &RwLock<HashMap<[u64; 2], T>>, most: usize, point: &Position, find: impl FnOnce() -> T) -> T {
    let key = [point.x.to_bits(), point.y.to_bits()];
    if let Some(known) = all.read().unwrap_or_else(PoisonError::into_inner).get(&key) {
        return known.clone();
    }
    let found = find();
    let mut all = all.write().unwrap_or_else(PoisonError::into_inner);
    if all.len() >= most {
        all.clear();
    }
    all.insert(key, found.clone());
    found
}

impl Node {
    /// Whether a shortest way from or to `other` [m] may bend here: whether it passes beside the zone of this corner.
    fn may_bend(&self, other: &Position, clearance_m: f64) -> bool {
        let along = other - self.at;
        let sides_m = self.edges.map(|edge| along.perp(&edge));
        // Nodes lie beside their corners, which turns the way between near ones.
        let slack_m = 4.0 * clearance_m + 1e-9 * along.norm();
        sides_m.iter().all(|side_m| *side_m >= -slack_m) || sides_m.iter().all(|side_m| *side_m <= slack_m)
    }
}

/// Places `clearance_m` [m] beside the corners that a way around the polygon bends at.
fn beside_corners(polygon: &Polygon, clearance_m: f64) -> impl Iterator<Item = Node> {
    let corners = polygon.corners();
    let count = corners.len();
    (0..count).filter_map(move |index| {
        let at = corners[index];
        let back = (corners[(index + count - 1) % count] - at).normalize();
        let on = (corners[(index + 1) % count] - at).normalize();
        // The forbidden side is to the left.
        let turn = on.perp(&back);
        let is_flat = turn < ANGLE_SLACK && back.dot(&on) < 0.0;
        let outward = if is_flat { Vector2::new(on.y, -on.x) } else { -(back + on).normalize() };
        (turn > 0.0).then_some(Node { at: at + outward * clearance_m, edges: [back, on] })
    })
}
