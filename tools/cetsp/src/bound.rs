//! Lower bounds on the length of every round.
//!
//! - *Branch and bound*: the shortest path that touches some disks in a given order is a convex problem, and no longer
//!   than with a further disk in between. From few disks on, the disk whose insertion costs most at its cheapest place
//!   is inserted at each. The least length of the orders that are left bounds all rounds.
//! - *1-trees*: legs between disks are at least their centres' distance less two radii. The ascent of Held and Karp
//!   bounds the rounds over a spread subset of the disks, and so those over all.

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::time::Instant;

use nalgebra::Vector2;
use skysink_common::geometry::Position;
use skysink_planner::geometry::round::{DiskField, RoundEffort, SETTLED, distance_to_leg_squared, shortest};

/// Margin of a length against rounding, relative to it.
const LENGTH_MARGIN: f64 = 1e-9;

/// A gap between the length of an order and its bound above this fraction is closed by the cone program.
const GAP: f64 = 1e-6;

/// Least length of a leg that has a direction, as a fraction of the radius.
const LEAST_LEG: f64 = 1e-7;

/// Most sweeps over the points of an order.
const SWEEPS: usize = 40;

/// Steps of the ascent, and of those without a better bound after which its steps are halved.
const ASCENT: usize = 200;
const PATIENCE: usize = 8;

/// Most disks of a subset.
const MOST_SPREAD: usize = 400;

/// An order of disks, with the points that make it short.
struct Order {
    disks: Vec<u32>,
    points: Vec<Position>,
    bound_m: f64,
}

impl PartialEq for Order {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Order {}

impl PartialOrd for Order {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Order {
    /// The least bound is the greatest, and first in the heap; of equals the one with most disks.
    fn cmp(&self, other: &Self) -> Ordering {
        other.bound_m.total_cmp(&self.bound_m).then(self.disks.len().cmp(&other.disks.len()))
    }
}

/// A lower bound on the length of every round [m], of which one is `known_m` long; at most that. A step evaluates an
/// order of some of the disks.
pub fn bound_m(field: &DiskField, known_m: f64, effort: RoundEffort) -> f64 {
    let by_trees_m = if field.is_closed { by_trees_m(field, known_m) } else { 0.0 };
    let by_orders_m = if by_trees_m < known_m { by_orders_m(field, known_m, effort) } else { 0.0 };
    by_trees_m.max(by_orders_m).min(known_m)
}

/// The bound of branch and bound; a step evaluates an order.
fn by_orders_m(field: &DiskField, known_m: f64, effort: RoundEffort) -> f64 {
    let begin = Instant::now();
    let mut evaluated = 0u64;
    let mut heap = BinaryHeap::new();
    heap.extend(first_order(field).map(|disks| evaluate(field, disks, None)));
    while let Some(order) = heap.peek() {
        let is_over = match effort {
            RoundEffort::Steps(steps) => evaluated >= steps,
            RoundEffort::Time(time) => begin.elapsed() >= time,
        };
        if is_over || order.bound_m >= known_m {
            return order.bound_m.min(known_m);
        }
        let order = heap.pop().expect("it was seen");
        let Some(disk) = next_disk(field, &order) else {
            // It touches all disks, and none is shorter.
            return order.bound_m.min(known_m);
        };
        let stops = order.points.len();
        // Of the two directions of a closed round one is enough.
        let legs = if field.is_closed && stops <= 2 { 1 } else { stops };
        let behind = (0..legs).map(|leg| {
            let to = order.points.get(leg + 1).or(field.is_closed.then(|| &order.points[0]));
            (leg + 1, field.touch(disk, &order.points[leg], to).1)
        });
        let may_begin = !field.is_closed && field.start.is_none();
        let first = may_begin.then(|| (0, field.touch(disk, &order.points[0], None).1));
        for (place, point) in behind.chain(first) {
            let mut disks = order.disks.clone();
            let mut points = order.points.clone();
            disks.insert(place - field.fixed(), disk);
            points.insert(place, point);
            let mut further = evaluate(field, disks, Some(points));
            further.bound_m = further.bound_m.max(order.bound_m);
            evaluated += 1;
            if further.bound_m < known_m * (1.0 - LENGTH_MARGIN) {
                heap.push(further);
            }
        }
    }
    known_m
}

/// The disks of the first order: the one farthest from the start, or the one farthest from the middle.
fn first_order(field: &DiskField) -> Option<Vec<u32>> {
    let centres = &field.cover.centres;
    let middle = centres.iter().fold(Vector2::zeros(), |sum, centre| sum + centre.coords) / centres.len().max(1) as f64;
    let from = field.start.unwrap_or(middle.into());
    let away_m2 = |&disk: &u32| (centres[disk as usize] - from).norm_squared();
    let farthest = (0..centres.len() as u32).max_by(|a, b| away_m2(a).total_cmp(&away_m2(b)))?;
    Some(vec![farthest])
}

/// The disk that the path does not touch, and whose cheapest insertion costs most.
fn next_disk(field: &DiskField, order: &Order) -> Option<u32> {
    let stops = order.points.len();
    let leg = |leg: usize| {
        let to = order.points.get(leg + 1).or(field.is_closed.then(|| &order.points[0]));
        (&order.points[leg], to)
    };
    let mut best: Option<(f64, u32)> = None;
    for (disk, centre) in (0u32..).zip(&field.cover.centres) {
        let mut cheapest_m = f64::INFINITY;
        for (from, to) in (0..stops).map(leg) {
            let away_m2 = match to {
                Some(to) => distance_to_leg_squared(centre, from, to),
                None => (centre - from).norm_squared(),
            };
            if away_m2 <= field.cover.radius_m * field.cover.radius_m {
                cheapest_m = 0.0;
                break;
            }
            // Not exact: the choice needs no certainty.
            cheapest_m = cheapest_m.min(field.touch(disk, from, to).0);
            if best.is_some_and(|(most_m, _)| cheapest_m <= most_m) {
                break;
            }
        }
        if cheapest_m > 0.0 && best.is_none_or(|(most_m, _)| cheapest_m > most_m) {
            best = Some((cheapest_m, disk));
        }
    }
    best.map(|(_, disk)| disk)
}

/// An order with its points, from these on, and its bound.
fn evaluate(field: &DiskField, disks: Vec<u32>, points: Option<Vec<Position>>) -> Order {
    let at_centres = || field.start.into_iter().chain(disks.iter().map(|&disk| field.cover.centres[disk as usize]));
    let mut points = points.unwrap_or_else(|| at_centres().collect());
    descend(field, &disks, &mut points);
    let mut bound_m = dual_m(field, &disks, &points[0], &directions(field, &points));
    if bound_m < length_m(field, &points) * (1.0 - GAP)
        && let Some(shortest) = shortest(field, &disks)
    {
        bound_m = bound_m.max(dual_m(field, &disks, &shortest.points[0], &shortest.directions));
        points = shortest.points;
    }
    Order { disks, points, bound_m: bound_m * (1.0 - LENGTH_MARGIN) }
}

fn length_m(field: &DiskField, points: &[Position]) -> f64 {
    let legs: f64 = points.windows(2).map(|leg| (leg[1] - leg[0]).norm()).sum();
    let back = if field.is_closed { (points[0] - points[points.len() - 1]).norm() } else { 0.0 };
    legs + back
}

/// Moves each point to where the path between its neighbours is shortest.
fn descend(field: &DiskField, disks: &[u32], points: &mut [Position]) {
    let stops = points.len();
    let fixed = field.fixed();
    for _ in 0..SWEEPS {
        let mut moved_m = 0.0f64;
        for index in fixed..stops {
            let before = if index > 0 { Some(index - 1) } else { field.is_closed.then(|| stops - 1) };
            let after = if index + 1 < stops { Some(index + 1) } else { field.is_closed.then_some(0) };
            let [before, after] =
                [before, after].map(|other| other.filter(|&other| other != index).map(|other| points[other]));
            let disk = disks[index - fixed];
            let point = match (before, after) {
                (Some(before), Some(after)) => field.turning_point(disk, &before, &after),
                (Some(other), None) | (None, Some(other)) => field.touch(disk, &other, None).1,
                (None, None) => points[index],
            };
            moved_m = moved_m.max((point - points[index]).norm());
            points[index] = point;
        }
        if moved_m <= SETTLED * field.inner_m {
            return;
        }
    }
}

/// The directions of the legs; where points lie together, that between the legs before and after.
fn directions(field: &DiskField, points: &[Position]) -> Vec<Vector2<f64>> {
    let stops = points.len();
    let legs = if field.is_closed { stops } else { stops - 1 };
    let direction = |leg: usize| {
        let vector = points[(leg + 1) % stops] - points[leg];
        if vector.norm() > LEAST_LEG * field.inner_m { vector.normalize() } else { Vector2::zeros() }
    };
    let found: Vec<Vector2<f64>> = (0..legs).map(direction).collect();
    let between = |leg: usize| match found[leg] {
        none if none == Vector2::zeros() => (found[(leg + legs - 1) % legs] + found[(leg + 1) % legs]) / 2.0,
        direction => direction,
    };
    (0..legs).map(between).collect()
}

/// A lower bound on the length of every path that touches `disks` in this order [m], from `first` if it has a start.
///
/// For any vectors `u_k` no longer than 1, one for each leg, the length is at least `Σ u_k · (p_{k+1} − p_k)`, whose
/// least value over the points is `Σ c_k · g_k − r ‖g_k‖` with `g_k = u_{k−1} − u_k`. The directions of the shortest
/// path make them equal.
fn dual_m(field: &DiskField, disks: &[u32], first: &Position, directions: &[Vector2<f64>]) -> f64 {
    let fixed = field.fixed();
    let turn = |stop: usize| {
        let before = stop.checked_sub(1).or_else(|| field.is_closed.then(|| directions.len() - 1));
        let [into, out] = [before, Some(stop)].map(|leg| leg.and_then(|leg| directions.get(leg)).copied());
        into.unwrap_or_default() - out.unwrap_or_default()
    };
    let least_m = |(index, &disk): (usize, &u32)| {
        let turn = turn(index + fixed);
        field.cover.centres[disk as usize].coords.dot(&turn) - field.cover.radius_m * turn.norm()
    };
    let from_start_m = if fixed > 0 { first.coords.dot(&turn(0)) } else { 0.0 };
    from_start_m + disks.iter().enumerate().map(least_m).sum::<f64>()
}

/// The best bound of 1-trees over spread subsets.
fn by_trees_m(field: &DiskField, known_m: f64) -> f64 {
    let spread = spread(field);
    let mut best_m = 0.0f64;
    let mut count = 3.0;
    while count as usize <= spread.len() {
        let bound_m = ascent_m(field, &spread[..count as usize], known_m);
        best_m = best_m.max(bound_m);
        if bound_m < 0.7 * best_m {
            break;
        }
        count = (count * 1.25f64).max(count + 1.0);
    }
    best_m * (1.0 - LENGTH_MARGIN)
}

/// Nodes of the 1-trees, the start or a disk first, then each farthest from those before: centre and radius.
fn spread(field: &DiskField) -> Vec<(Position, f64)> {
    let radius_m = field.cover.radius_m;
    let mut left: Vec<(f64, Position)> = field.cover.centres.iter().map(|centre| (f64::INFINITY, *centre)).collect();
    let mut nodes = Vec::new();
    let mut last = match field.start {
        Some(start) => {
            nodes.push((start, 0.0));
            start
        }
        None if left.is_empty() => return nodes,
        None => {
            let first = left.swap_remove(0).1;
            nodes.push((first, radius_m));
            first
        }
    };
    while nodes.len() < MOST_SPREAD && !left.is_empty() {
        left.iter_mut().for_each(|(away_m2, centre)| *away_m2 = away_m2.min((*centre - last).norm_squared()));
        let farthest = (0..left.len()).max_by(|&a, &b| left[a].0.total_cmp(&left[b].0)).expect("one is left");
        last = left.swap_remove(farthest).1;
        nodes.push((last, radius_m));
    }
    nodes
}

/// The ascent over these nodes [m].
fn ascent_m(field: &DiskField, nodes: &[(Position, f64)], known_m: f64) -> f64 {
    debug_assert!(field.is_closed && nodes.len() >= 3);
    let count = nodes.len();
    let leg_m = |a: usize, b: usize| ((nodes[a].0 - nodes[b].0).norm() - nodes[a].1 - nodes[b].1).max(0.0);
    let legs_m: Vec<f64> = (0..count).flat_map(|a| (0..count).map(move |b| leg_m(a, b))).collect();
    let mut prices = vec![0.0; count];
    let mut best_m = 0.0f64;
    let mut pace = 1.0;
    let mut waited = 0;
    let mut degrees = vec![0i32; count];
    let mut nearest = vec![(f64::INFINITY, 0); count];
    for _ in 0..ASCENT {
        let priced = |a: usize, b: usize| legs_m[a * count + b] + prices[a] + prices[b];
        degrees.fill(0);
        nearest.fill((f64::INFINITY, usize::MAX));
        // A tree over all nodes but the first (Prim), and the two cheapest legs of the first.
        let mut tree_m = 0.0;
        let mut at = 1;
        let mut left: Vec<usize> = (2..count).collect();
        while !left.is_empty() {
            let mut cheapest = (f64::INFINITY, 0);
            for (index, &node) in left.iter().enumerate() {
                let priced_m = priced(at, node);
                if priced_m < nearest[node].0 {
                    nearest[node] = (priced_m, at);
                }
                if nearest[node].0 < cheapest.0 {
                    cheapest = (nearest[node].0, index);
                }
            }
            at = left.swap_remove(cheapest.1);
            tree_m += cheapest.0;
            degrees[at] += 1;
            degrees[nearest[at].1] += 1;
        }
        let mut two = [(f64::INFINITY, 0); 2];
        for node in 1..count {
            let priced_m = priced(0, node);
            if priced_m < two[0].0 {
                two = [(priced_m, node), two[0]];
            } else if priced_m < two[1].0 {
                two[1] = (priced_m, node);
            }
        }
        two.iter().for_each(|(_, node)| degrees[*node] += 1);
        let bound_m = tree_m + two[0].0 + two[1].0 - 2.0 * prices.iter().sum::<f64>();
        waited += 1;
        if bound_m > best_m {
            (best_m, waited) = (bound_m, 0);
        }
        if waited > PATIENCE {
            (pace, waited) = (pace / 2.0, 0);
        }
        let squares: i32 = degrees[1..].iter().map(|degree| (degree - 2).pow(2)).sum();
        if squares == 0 || pace < 1e-4 || best_m >= known_m {
            break;
        }
        let step_m = pace * (known_m - bound_m) / f64::from(squares);
        for (price, degree) in prices.iter_mut().zip(&degrees).skip(1) {
            *price += step_m * f64::from(degree - 2);
        }
    }
    best_m
}

#[cfg(test)]
mod tests;
