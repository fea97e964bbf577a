//! Fewer corners for zones of many, such as the outline of a lake: zones grow, and a boundary shrinks, a little.
//!
//! Two changes add a triangle to the closed ground: to leave out a corner that points into it, and to prolong the edges
//! before and after an edge until they meet. Always the change with the least deviation from the outlines is made next.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use rstar::primitives::{GeomWithData, Rectangle};
use rstar::{AABB, RTree};

use super::contacts::ANGLE_SLACK;
use super::polygon::{Polygon, nearest_between};
use crate::geometry::{Position, extent};

/// A corner of a ring, and the edge from it to the next one.
#[derive(Debug)]
struct Corner {
    at: Position,
    ring: usize,
    before: usize,
    after: usize,
    /// Farthest deviation of the edge from the outline [m].
    deviation_m: f64,
    is_left_out: bool,
}

/// A change of a ring: corners in a row, of which the inner ones are left out, and the corner in their place.
#[derive(Debug)]
struct Change {
    deviation_m: f64,
    corners: [usize; 4],
    /// Where the prolonged edges meet; without it the second corner is left out, and the fourth counts for nothing.
    meeting: Option<Position>,
}

impl Change {
    /// The ends of the row, and its inner corners.
    fn row(&self) -> &[usize] {
        if self.meeting.is_some() { &self.corners } else { &self.corners[..3] }
    }

    /// The triangle that it adds.
    fn triangle(&self, all: &[Corner]) -> [Position; 3] {
        let [a, b, c, _] = self.corners.map(|corner| all[corner].at);
        self.meeting.map_or([a, b, c], |meeting| [b, meeting, c])
    }
}

impl PartialEq for Change {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Change {}

impl Ord for Change {
    fn cmp(&self, other: &Self) -> Ordering {
        let by_corners = other.corners.cmp(&self.corners).then(other.meeting.is_some().cmp(&self.meeting.is_some()));
        other.deviation_m.total_cmp(&self.deviation_m).then(by_corners)
    }
}

impl PartialOrd for Change {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// What stays free where zones grow.
#[derive(Debug, Clone, Copy, Default)]
pub struct KeptGround<'a> {
    /// Positions [m].
    pub places: &'a [Position],
    /// Polygons: what is free of them.
    pub areas: &'a [Polygon],
}

impl KeptGround<'_> {
    /// Whether a triangle covers a part of it.
    fn meets(&self, triangle: &[Position; 3]) -> bool {
        self.places.iter().any(|place| holds(triangle, place)) || self.areas.iter().any(|area| do_meet(area, triangle))
    }
}

/// The rings of polygons that are simplified.
struct Outlines<'k> {
    corners: Vec<Corner>,
    /// Corners of each ring that are left.
    counts: Vec<usize>,
    /// Edges by their first and second corner; some are gone.
    edges: RTree<GeomWithData<Rectangle<[f64; 2]>, [usize; 2]>>,
    changes: BinaryHeap<Change>,
    kept: KeptGround<'k>,
}

/// Leaves out corners of `polygons` until all of them together have at most `most`, or no change deviates by at most
/// `tolerance_m` [m]; returns the farthest deviation [m]. What is forbidden only grows, but not over what is `kept`.
pub fn simplify(polygons: &mut [Polygon], most: usize, tolerance_m: f64, kept: KeptGround<'_>) -> f64 {
    let mut count: usize = polygons.iter().map(|polygon| polygon.corners().len()).sum();
    if count <= most || tolerance_m.is_nan() || tolerance_m <= 0.0 {
        return 0.0;
    }
    let mut outlines = Outlines::of(polygons, kept);
    let mut farthest_m = 0.0f64;
    while count > most {
        let Some(change) = outlines.changes.pop().filter(|change| change.deviation_m <= tolerance_m) else { break };
        if outlines.is_possible(&change) {
            outlines.make(&change);
            farthest_m = farthest_m.max(change.deviation_m);
            count -= 1;
        }
    }
    for (ring, polygon) in polygons.iter_mut().enumerate() {
        let first = outlines.corners.iter().position(|corner| corner.ring == ring && !corner.is_left_out);
        let first = first.expect("three corners are left");
        let mut corners = vec![outlines.corners[first].at];
        let mut next = outlines.corners[first].after;
        while next != first {
            corners.push(outlines.corners[next].at);
            next = outlines.corners[next].after;
        }
        if corners.len() < polygon.corners().len() {
            // As a whole, if rounding should have made edges cross.
            *polygon = polygon.with_corners(corners).unwrap_or_else(|| polygon.clone());
        }
    }
    farthest_m
}

impl<'k> Outlines<'k> {
    fn of(polygons: &[Polygon], kept: KeptGround<'k>) -> Self {
        let mut corners = Vec::new();
        for (ring, polygon) in polygons.iter().enumerate() {
            let first = corners.len();
            let count = polygon.corners().len();
            corners.extend(polygon.corners().iter().enumerate().map(|(index, at)| Corner {
                at: *at,
                ring,
                before: first + (index + count - 1) % count,
                after: first + (index + 1) % count,
                deviation_m: 0.0,
                is_left_out: false,
            }));
        }
        let edges = (0..corners.len()).map(|from| edge_box(&corners, [from, corners[from].after])).collect();
        let counts = polygons.iter().map(|polygon| polygon.corners().len()).collect();
        let all = corners.len();
        let mut outlines = Self { corners, counts, edges: RTree::bulk_load(edges), changes: BinaryHeap::new(), kept };
        for corner in 0..all {
            outlines.offer(corner);
        }
        outlines
    }

    /// Offers the changes that leave out `corner`, or the edge from it to the next one.
    fn offer(&mut self, corner: usize) {
        let before = self.corners[corner].before;
        let after = self.corners[corner].after;
        let beyond = self.corners[after].after;
        let corners = [before, corner, after, beyond];
        let [a, b, c, d] = corners.map(|corner| self.corners[corner].at);
        let [of_ab, of_bc, of_cd] = [before, corner, after].map(|corner| self.corners[corner].deviation_m);
        let turn = |a: &Position, b: &Position, c: &Position| (b - a).perp(&(c - b));
        // What is forbidden is to the left.
        if turn(&a, &b, &c) <= 0.0 {
            let deviation_m = of_ab.max(of_bc) + away_m(&b, &a, &c);
            self.changes.push(Change { deviation_m, corners, meeting: None });
        }
        let [ab, cd] = [b - a, d - c];
        let across = ab.perp(&cd);
        if turn(&a, &b, &c) > 0.0 && turn(&b, &c, &d) > 0.0 && across > ANGLE_SLACK * ab.norm() * cd.norm() {
            let meeting = b + ab * ((c - b).perp(&cd) / across);
            let deviation_m = of_ab.max(of_cd).max(of_bc + away_m(&meeting, &b, &c));
            self.changes.push(Change { deviation_m, corners, meeting: Some(meeting) });
        }
    }

    /// Whether the corners of `change` are still in a row, and its triangle is free of the ring and of what is kept.
    fn is_possible(&self, change: &Change) -> bool {
        let row = change.row();
        let is_row = row.windows(2).all(|pair| {
            !self.corners[pair[0]].is_left_out
                && !self.corners[pair[1]].is_left_out
                && self.corners[pair[0]].after == pair[1]
        });
        let ring = self.corners[row[0]].ring;
        if !is_row || self.counts[ring] <= row.len() {
            return false;
        }
        let triangle = change.triangle(&self.corners);
        if self.kept.meets(&triangle) {
            return false;
        }
        let [low, high] = extent(triangle).expect("a triangle has corners");
        let near = self.edges.locate_in_envelope_intersecting(&AABB::from_corners([low.x, low.y], [high.x, high.y]));
        near.map(|edge| edge.data).all(|[from, to]| {
            let is_gone = self.corners[from].is_left_out || self.corners[from].after != to;
            if is_gone || self.corners[from].ring != ring {
                return true;
            }
            let is_beside = row.contains(&from) || !holds(&triangle, &self.corners[from].at);
            let is_of_row = row.windows(2).any(|pair| pair == [from, to]);
            let is_clear = change.meeting.is_none_or(|meeting| {
                let edge = [from, to].map(|corner| self.corners[corner].at);
                is_of_row || [triangle[0], triangle[2]].iter().all(|end| !do_cross(&edge, &[*end, meeting]))
            });
            is_beside && is_clear
        })
    }

    fn make(&mut self, change: &Change) {
        let row = change.row();
        let [first, last] = [row[0], row[row.len() - 1]];
        for &corner in &row[1..row.len() - 1] {
            self.corners[corner].is_left_out = true;
        }
        self.corners[first].deviation_m = change.deviation_m;
        let ring = self.corners[first].ring;
        self.counts[ring] -= 1;
        let joint = change.meeting.map(|at| {
            let deviation_m = change.deviation_m;
            self.corners.push(Corner { at, ring, before: first, after: last, deviation_m, is_left_out: false });
            self.corners.len() - 1
        });
        self.corners[first].after = joint.unwrap_or(last);
        self.corners[last].before = joint.unwrap_or(first);
        for from in std::iter::once(first).chain(joint) {
            self.edges.insert(edge_box(&self.corners, [from, self.corners[from].after]));
        }
        // All rows with a new edge.
        let start = self.corners[first].before;
        let mut corner = start;
        loop {
            self.offer(corner);
            if corner == last {
                break;
            }
            corner = self.corners[corner].after;
        }
    }
}

fn edge_box(corners: &[Corner], edge: [usize; 2]) -> GeomWithData<Rectangle<[f64; 2]>, [usize; 2]> {
    let [a, b] = edge.map(|corner| corners[corner].at);
    GeomWithData::new(Rectangle::from_corners([a.x, a.y], [b.x, b.y]), edge)
}

/// Distance of `point` from the segment between `a` and `b` [m].
fn away_m(point: &Position, a: &Position, b: &Position) -> f64 {
    (nearest_between(point, a, b) - point).norm()
}

/// Whether a closed triangle holds `point`.
fn holds([a, b, c]: &[Position; 3], point: &Position) -> bool {
    let side = |from: &Position, to: &Position| (to - from).perp(&(point - from));
    let sides = [side(a, b), side(b, c), side(c, a)];
    sides.iter().all(|side| *side >= 0.0) || sides.iter().all(|side| *side <= 0.0)
}

/// Whether a polygon and a triangle have a point in common; also true of some that are in line with each other.
fn do_meet(polygon: &Polygon, triangle: &[Position; 3]) -> bool {
    let [lowest, highest] = polygon.extent();
    let is_near = extent(*triangle).is_some_and(|[low, high]| low.sup(&lowest) <= high.inf(&highest));
    if !is_near {
        return false;
    }
    let corners = polygon.corners();
    let mut edges = corners.iter().zip(corners.iter().cycle().skip(1)).map(|(from, to)| [*from, *to]);
    let [a, b, c] = *triangle;
    let sides = [[a, b], [b, c], [c, a]];
    edges.any(|edge| sides.iter().any(|side| do_cross(&edge, side)))
        || polygon.encloses(&a)
        || holds(triangle, &corners[0])
}

/// Whether two segments have a point in common.
fn do_cross([a, b]: &[Position; 2], [c, d]: &[Position; 2]) -> bool {
    let side = |p: &Position, q: &Position, r: &Position| (q - p).perp(&(r - p));
    side(a, b, c) * side(a, b, d) <= 0.0 && side(c, d, a) * side(c, d, b) <= 0.0
}
