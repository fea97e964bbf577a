//! Where zones touch each other or the edge of the area: ground of no width that is closed (decision D14).
//!
//! Each polygon forbids its interior. What several forbid together is the interior of their closed union, which has in
//! addition the edges that two of them share, and corners around which they leave no ground, or several pieces of it
//! that meet in this point only.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use nalgebra::Vector2;

use super::boxes::BoxIndex;
use super::polygon::{ClosedZone, DEPTH_SLACK, Polygon};
use crate::geometry::{Position, distance_squared};

/// Gaps between zones, and beside the edge of the area, up to this width are closed [m]: corners in files are rounded.
const WIDEST_GAP_M: f64 = 0.02;

/// The same relative to the area.
const WIDEST_GAP: f64 = 1e-4;

/// Slack of directions at a corner [rad]: edges that turn by less are one.
pub(super) const ANGLE_SLACK: f64 = 1e-9;

/// A shared edge, or a corner, at which there is closed ground on all sides.
#[derive(Debug, Clone, PartialEq)]
struct Contact {
    /// Its ends [m], equal at a corner.
    ends: [Position; 2],
    /// The altitudes at which it is closed [m], from the first to below the second.
    altitudes_m: [f64; 2],
}

/// The contacts of zones.
#[derive(Debug, Clone, Default)]
pub(super) struct ZoneContacts {
    contacts: Vec<Contact>,
    index: BoxIndex,
    /// How near to a corner it is met [m].
    rounding_m: f64,
    /// Points beside shared corners where there is free ground [m].
    beside: Vec<Position>,
}

impl PartialEq for ZoneContacts {
    fn eq(&self, other: &Self) -> bool {
        self.contacts == other.contacts && self.beside == other.beside
    }
}

/// A zone's part of the directions around one of its corners: from `begin` on [rad], over `span` [rad].
#[derive(Debug, Clone, Copy)]
struct Sector {
    begin: f64,
    span: f64,
    top_m: f64,
}

/// A point as a key; both zeros are one.
fn key(point: &Position) -> [u64; 2] {
    [point.x, point.y].map(|coordinate_m| (coordinate_m + 0.0).to_bits())
}

/// Closes gaps between zones that are too narrow to fly through, and between zones and the edge of the area `edge`: a
/// corner beside the edge of another zone becomes a corner of that, too, so that they share corners and edges.
pub(super) fn close_gaps(zones: &mut [ClosedZone], extent_m: f64) {
    let gap_m = WIDEST_GAP_M.min(WIDEST_GAP * extent_m);
    for grown in 0..zones.len() {
        for other in (0..zones.len()).filter(|&other| other != grown) {
            let [low, high] = zones[grown].polygon.extent();
            let margin = Vector2::repeat(gap_m);
            let [other_low, other_high] = zones[other].polygon.extent();
            if !(low - margin <= other_high && other_low <= high + margin) {
                continue;
            }
            let corners = zones[other].polygon.corners().iter().copied();
            let near: Vec<Position> =
                corners.filter(|corner| low - margin <= *corner && *corner <= high + margin).collect();
            if let Some(joined) = joined(&zones[grown].polygon, &near, &zones[other].polygon, gap_m, extent_m) {
                zones[grown].polygon = joined;
            }
        }
    }
}

/// `polygon` with those of `corners`, of `other`, as corners that lie at most `gap_m` beside it, or on its edges;
/// `None` if there are none, or it would cross itself.
fn joined(polygon: &Polygon, corners: &[Position], other: &Polygon, gap_m: f64, extent_m: f64) -> Option<Polygon> {
    let rounding_m = DEPTH_SLACK * extent_m;
    let own = polygon.corners();
    let is_shared = |at: &Position| other.corners().contains(at);
    // (edge, distance along it, corner)
    let mut joints: Vec<(usize, f64, Position)> = Vec::new();
    for corner in corners {
        let near = |at: &&Position| distance_squared(at, corner) <= gap_m * gap_m;
        if own.contains(corner) || own.iter().filter(near).any(is_shared) {
            continue; // joined there
        }
        let nearest = (0..own.len()).filter_map(|index| {
            let [begin, end] = [own[index], own[(index + 1) % own.len()]];
            let along = end - begin;
            let length_m = along.norm();
            let on_m = (corner - begin).dot(&along) / length_m;
            let beside_m = -along.perp(&(corner - begin)) / length_m; // on the free side, to the right
            let away_m = distance_squared(&(begin + along * (on_m / length_m).clamp(0.0, 1.0)), corner).sqrt();
            let is_near = away_m <= gap_m && beside_m >= -rounding_m;
            is_near.then_some((away_m, beside_m, index, on_m))
        });
        let nearest = nearest.min_by(|a, b| a.0.total_cmp(&b.0).then(b.1.total_cmp(&a.1)));
        joints.extend(nearest.map(|(_, _, index, on_m)| (index, on_m, *corner)));
    }
    if joints.is_empty() {
        return None;
    }
    joints.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let mut ring = Vec::with_capacity(own.len() + joints.len());
    for (index, corner) in own.iter().enumerate() {
        ring.push(*corner);
        ring.extend(joints.iter().filter(|joint| joint.0 == index).map(|joint| joint.2));
    }
    polygon.with_corners(ring)
}

impl ZoneContacts {
    /// The contacts of `zones`, whose gaps are closed, in an area of this extent, with points `clearance_m` beside them
    /// [m].
    pub fn of(zones: &[ClosedZone], extent_m: f64, clearance_m: f64) -> Self {
        let mut tops_m: BTreeMap<[[u64; 2]; 2], f64> = BTreeMap::new();
        let mut sectors: BTreeMap<[u64; 2], (Position, Vec<Sector>)> = BTreeMap::new();
        for ClosedZone { polygon, top_m } in zones {
            let corners = polygon.corners();
            for (index, at) in corners.iter().enumerate() {
                let next = corners[(index + 1) % corners.len()];
                let before = corners[(index + corners.len() - 1) % corners.len()];
                let edge_m = tops_m.entry([key(at), key(&next)]).or_insert(*top_m);
                *edge_m = edge_m.max(*top_m);
                // What is forbidden is to the left: from the next corner round to the one before.
                let angle = |to: &Position| (to.y - at.y).atan2(to.x - at.x);
                let span = (angle(&before) - angle(&next)).rem_euclid(TAU);
                let (_, around) = sectors.entry(key(at)).or_insert((*at, Vec::new()));
                around.push(Sector { begin: angle(&next), span, top_m: *top_m });
            }
        }
        let mut contacts = Vec::new();
        for (&[from, to], &top_m) in &tops_m {
            if let Some(&other_m) = tops_m.get(&[to, from]).filter(|_| from < to) {
                let ends = [from, to].map(|end| sectors[&end].0);
                contacts.push(Contact { ends, altitudes_m: [f64::NEG_INFINITY, top_m.min(other_m)] });
            }
        }
        let mut beside = Vec::new();
        for (at, around) in sectors.values().filter(|(_, around)| around.len() > 1) {
            let mut levels_m: Vec<f64> = around.iter().map(|sector| sector.top_m).collect();
            levels_m.sort_by(f64::total_cmp);
            levels_m.dedup();
            let floors_m = std::iter::once(f64::NEG_INFINITY).chain(levels_m.iter().copied());
            for (floor_m, &top_m) in floors_m.zip(&levels_m) {
                let gaps = gaps(around.iter().filter(|sector| sector.top_m >= top_m));
                if gaps.len() != 1 {
                    contacts.push(Contact { ends: [*at; 2], altitudes_m: [floor_m, top_m] });
                }
                let middles = gaps.iter().map(|[begin, end]| ((begin + end) / 2.0).sin_cos());
                beside.extend(middles.map(|(sin, cos)| at + Vector2::new(cos, sin) * clearance_m));
            }
        }
        let index = BoxIndex::new(contacts.iter().map(|Contact { ends: [a, b], .. }| [a.inf(b), a.sup(b)]));
        Self { contacts, index, rounding_m: DEPTH_SLACK * extent_m, beside }
    }

    /// Points beside shared corners; some are in zones.
    pub fn beside(&self) -> impl Iterator<Item = Position> {
        self.beside.iter().copied()
    }

    /// Whether `point` [m] lies on a contact at the altitude `z_m` [m].
    pub fn forbid(&self, point: &Position, z_m: f64) -> bool {
        let mut near = self.index.near(point, point, self.rounding_m).map(|number| &self.contacts[number]);
        near.any(|contact| contact.is_at(z_m) && contact.holds(point, self.rounding_m))
    }

    /// The fraction of the way from `from` to `to` [m] at which it comes upon a contact at the altitude `z_m` [m];
    /// `None` if it does not. A way beside an edge that zones share, by up to `slack_m` [m], is along it. A way that
    /// begins on a contact may leave it.
    pub fn entry(&self, from: &Position, to: &Position, z_m: f64, slack_m: f64) -> Option<f64> {
        if self.contacts.is_empty() || from == to {
            return None;
        }
        let slack_m = slack_m.max(self.rounding_m);
        let near = self.index.near(from, to, slack_m).map(|number| &self.contacts[number]);
        let entries = near.filter(|contact| contact.is_at(z_m)).filter_map(|contact| {
            let is_corner = contact.ends[0] == contact.ends[1];
            contact.entry(from, to, if is_corner { self.rounding_m } else { slack_m })
        });
        entries.min_by(f64::total_cmp)
    }
}

impl Contact {
    fn is_at(&self, z_m: f64) -> bool {
        self.altitudes_m[0] <= z_m && z_m < self.altitudes_m[1]
    }

    /// Whether `point` lies on it, but on a shared edge not at its ends, where there may be free ground.
    fn holds(&self, point: &Position, slack_m: f64) -> bool {
        let [begin, end] = self.ends;
        if begin == end {
            return distance_squared(point, &begin) <= slack_m * slack_m;
        }
        let along = (end - begin).normalize();
        let on_m = along.dot(&(point - begin));
        let inner_m = slack_m..=(end - begin).norm() - slack_m;
        along.perp(&(point - begin)).abs() <= slack_m && inner_m.contains(&on_m)
    }

    fn entry(&self, from: &Position, to: &Position, slack_m: f64) -> Option<f64> {
        if self.holds(from, slack_m) && !self.holds(to, slack_m) {
            return None;
        }
        let [begin, end] = self.ends;
        let along = (end - begin).try_normalize(0.0).unwrap_or_else(Vector2::x);
        let length_m = (end - begin).norm();
        // The part of the way in the box about the edge, which is `slack_m` wide to each side.
        let mut part = [0.0f64, 1.0];
        for (axis, farthest_m) in [(along, length_m), (Vector2::new(-along.y, along.x), 0.0)] {
            let at_m = axis.dot(&(from - begin));
            let way_m = axis.dot(&(to - from));
            if way_m == 0.0 {
                if !(-slack_m..=farthest_m + slack_m).contains(&at_m) {
                    return None;
                }
                continue;
            }
            let [a, b] = [-slack_m - at_m, farthest_m + slack_m - at_m].map(|off_m| off_m / way_m);
            part = [part[0].max(a.min(b)), part[1].min(a.max(b))];
        }
        // Past the end of an edge the way is in the box, too, but not along it.
        let least_m = if begin == end { 0.0 } else { 4.0 * slack_m };
        let flown_m = (part[1] - part[0]) * (to - from).norm();
        (part[0] <= part[1] && flown_m >= least_m).then_some(part[0])
    }
}

/// The gaps between sectors, from their first to their last direction [rad].
fn gaps<'s>(sectors: impl Iterator<Item = &'s Sector>) -> Vec<[f64; 2]> {
    let mut sectors: Vec<Sector> = sectors.copied().collect();
    sectors.sort_by(|a, b| a.begin.total_cmp(&b.begin));
    let first = sectors[0].begin;
    let mut covered = first;
    let mut gaps = Vec::new();
    // Twice round: the last ones may cover the first.
    let last_covered = sectors.iter().map(|sector| sector.begin + sector.span - TAU).fold(covered, f64::max);
    covered = covered.max(last_covered);
    for sector in &sectors {
        if sector.begin > covered + ANGLE_SLACK {
            gaps.push([covered, sector.begin]);
        }
        covered = covered.max(sector.begin + sector.span);
    }
    if first + TAU > covered + ANGLE_SLACK {
        gaps.push([covered, first + TAU]);
    }
    gaps
}
