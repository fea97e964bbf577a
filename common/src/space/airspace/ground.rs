//! The ground under a UAV: what no-fly zones, buildings and the edge of the area close.

use super::boxes::BoxIndex;
use super::contacts::{self, ZoneContacts};
use super::polygon::{ClosedZone, DEPTH_SLACK, Polygon};
use crate::geometry::Position;

/// How far ways keep from the corners that they bend at, relative to the area.
const CLEARANCE: f64 = 1e-8;

/// Farther than any corner lies from the origin along an axis [m].
const FARTHEST_M: f64 = 1e12;

/// The ground of an area: the interior of what all zones, and the outside of the area, cover together, is closed.
///
/// The default is open.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct ClosedGround {
    zones: Vec<ClosedZone>,
    /// The zones by the boxes around them, but for a boundary.
    index: BoxIndex,
    /// Where zones touch.
    pub contacts: ZoneContacts,
    /// The lowest altitude of the UAV [m].
    lowest_m: f64,
    /// The north-east corner of the area.
    pub corner: Position,
    /// The longer side of the area [m].
    extent_m: f64,
}

impl ClosedGround {
    /// The ground of an area of these sides [m], for a UAV that flies `lowest_m` [m] high or higher, with zones up to
    /// their tops [m].
    pub fn new(sides_m: [f64; 2], lowest_m: f64, zones: impl Iterator<Item = (Polygon, f64)>) -> Self {
        let extent_m = sides_m[0].max(sides_m[1]);
        let mut zones: Vec<ClosedZone> = zones.map(|(polygon, top_m)| ClosedZone { polygon, top_m }).collect();
        let mut contacts = ZoneContacts::default();
        if !zones.is_empty() {
            let [width_m, height_m] = sides_m;
            let edge = Polygon::of(&[[0.0, 0.0], [width_m, 0.0], [width_m, height_m], [0.0, height_m]], true);
            zones.extend(edge.map(|polygon| ClosedZone { polygon, top_m: f64::INFINITY }));
            contacts::close_gaps(&mut zones, extent_m);
            contacts = ZoneContacts::of(&zones, extent_m, CLEARANCE * extent_m);
            // Ways between two points of the area stay in it, if no gap at its edge is closed.
            let is_on_edge = |at: &Position| [0.0, width_m].contains(&at.x) || [0.0, height_m].contains(&at.y);
            if zones.last().is_some_and(|edge| edge.polygon.corners().iter().all(is_on_edge)) {
                zones.pop();
            }
        }
        let boxes = zones.iter().map(|zone| match zone.polygon.is_border() {
            true => [-FARTHEST_M, FARTHEST_M].map(|side_m| Position::new(side_m, side_m)),
            false => zone.polygon.extent(),
        });
        Self { index: BoxIndex::new(boxes), zones, contacts, lowest_m, corner: Position::from(sides_m), extent_m }
    }

    /// Whether there is no zone.
    #[inline]
    pub fn is_open(&self) -> bool {
        self.zones.is_empty()
    }

    /// Its zones that rise above the altitude `z_m` [m].
    pub fn zones_above(&self, z_m: f64) -> impl Iterator<Item = &Polygon> {
        self.zones.iter().filter(move |zone| zone.top_m > z_m).map(|zone| &zone.polygon)
    }

    /// Zones at the lowest altitude.
    pub fn polygons(&self) -> impl Iterator<Item = &Polygon> {
        self.zones_above(self.lowest_m)
    }

    /// How far a way keeps from corners [m].
    pub fn clearance_m(&self) -> f64 {
        CLEARANCE * self.extent_m
    }

    /// Zones that rise above the altitude `z_m` [m], and may be met on the straight way.
    fn zones_near(&self, from: &Position, to: &Position, z_m: f64) -> impl Iterator<Item = &ClosedZone> {
        let near = self.index.near(from, to, self.clearance_m()).map(|number| &self.zones[number]);
        near.filter(move |zone| zone.top_m > z_m)
    }

    /// How deep in a zone rounding may lead [m].
    pub fn slack_m(&self) -> f64 {
        DEPTH_SLACK * self.extent_m
    }

    /// Whether `point` [m] lies in the area, and not in closed ground.
    pub fn contains(&self, point: &Position) -> bool {
        let is_in_area = Position::origin() <= *point && *point <= self.corner;
        let slack_m = self.slack_m();
        is_in_area
            && self.zones_near(point, point, self.lowest_m).all(|zone| !zone.polygon.forbids(point, slack_m))
            && !self.contacts.forbid(point, self.lowest_m)
    }

    /// Whether the straight way enters no zone, wherever it leads.
    #[inline]
    pub fn is_clear(&self, from: &Position, to: &Position) -> bool {
        if self.zones.is_empty() {
            return true;
        }
        let slack_m = self.slack_m();
        let mut zones = self.zones_near(from, to, self.lowest_m);
        zones.all(|zone| zone.polygon.entry(from, to, slack_m, true).is_none())
            && self.contacts.entry(from, to, self.lowest_m, slack_m).is_none()
    }

    /// The fraction of the straight way from `from` to `to` [m] at which it enters closed ground, by more than
    /// `slack_m` [m], between the altitudes `z_m` [m] at its ends; `None` if it enters none.
    pub fn entry(&self, from: &Position, to: &Position, z_m: [f64; 2], slack_m: f64) -> Option<f64> {
        let [from_m, to_m] = z_m;
        let z_m = from_m.min(to_m);
        // From above a building the way leads into it, not out of it.
        let of_zone = |zone: &ClosedZone| zone.polygon.entry(from, to, slack_m, zone.top_m > from_m);
        let entries = self.zones_near(from, to, z_m).filter_map(of_zone);
        entries.chain(self.contacts.entry(from, to, z_m, slack_m)).min_by(f64::total_cmp)
    }
}
