//! How near the legs of a mission come to the geofence, the zones, the buildings and the ground.
//!
//! Legs are straight lines between waypoints, from home at the altitude of the take-off. Distances to the geofence and
//! to zones are horizontal, those to buildings are to the nearest point of their walls and roofs.

use geo::{BoundingRect, Contains, Distance, Euclidean, Line, Point, Polygon, Rect};
use nalgebra::Point3;
use skysink_common::geometry::Position;
use skysink_common::interpolation::interpolate;

use super::fence;
use super::track::{GeodeticTrack, GeodeticZone};
use super::vehicle::{Leg, VehicleMission};

/// A leg that is nearer than a margin by no more than this [m], the rounding of a run, keeps the margin.
const ROUNDING_M: f64 = 0.01;

/// Steps of the search for the least distance on a leg that climbs: each shortens the interval by 0.618.
const SEARCH_STEPS: usize = 80;

/// How near legs come to one kind of obstacle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LegClearance {
    /// The least distance [m]; below 0 where a leg ends outside of the geofence.
    pub least_m: f64,
    /// How many legs come nearer than the margin.
    pub near: usize,
}

/// How near the legs of a mission come to what they must not touch; `None` for what there is not.
#[derive(Debug, Clone, PartialEq)]
pub struct MissionClearance {
    /// Number of legs.
    pub legs: usize,
    /// Nearer than this is near [m].
    pub margin_m: f64,
    pub ground: LegClearance,
    pub zones: Option<LegClearance>,
    pub buildings: Option<LegClearance>,
    pub fence: Option<LegClearance>,
    /// Distance from home to the geofence [m], below 0 outside of it.
    pub home_m: Option<f64>,
}

impl MissionClearance {
    /// The clearance of a mission from the corners of its `fence`, if it has one, the zones and the ground.
    pub fn of(track: &GeodeticTrack<'_>, mission: &VehicleMission, fence: Option<&[Position]>, margin_m: f64) -> Self {
        let legs: Vec<Leg> = mission.parts.iter().flat_map(|part| part.legs()).collect();
        let obstacles = |is_building: bool| -> Vec<Obstacle> {
            track.zones.iter().filter(|zone| zone.height_m.is_some() == is_building).map(Obstacle::of).collect()
        };
        let [zones, buildings] = [false, true].map(obstacles);
        let fence = fence.map(fence::polygon);
        let clearance = |distance_m: &dyn Fn(&Leg) -> f64| {
            let distances_m: Vec<f64> = legs.iter().map(distance_m).collect();
            let least_m = distances_m.iter().copied().fold(f64::INFINITY, f64::min);
            LegClearance { least_m, near: distances_m.iter().filter(|away_m| is_near(**away_m, margin_m)).count() }
        };
        let of_all = |obstacles: &[Obstacle]| {
            (!obstacles.is_empty()).then(|| clearance(&|leg| least_distance_m(obstacles, leg)))
        };
        let home = track.points[0].position.xy();
        Self {
            legs: legs.len(),
            margin_m,
            ground: clearance(&|[from, to]| from.z.min(to.z)),
            zones: of_all(&zones),
            buildings: of_all(&buildings),
            home_m: fence.as_ref().map(|fence| inside_m(fence, &home)),
            fence: fence.map(|fence| clearance(&|leg| within_m(&fence, leg))),
        }
    }

    /// Whether a distance [m] is less than the margin.
    pub fn is_near(&self, away_m: f64) -> bool {
        is_near(away_m, self.margin_m)
    }
}

/// Whether a distance [m] is less than a margin [m], or below 0.
fn is_near(away_m: f64, margin_m: f64) -> bool {
    away_m < (margin_m - ROUNDING_M).max(-ROUNDING_M)
}

/// Distance [m] of a leg to a fence from inside; below 0 if an end of it lies outside.
fn within_m(fence: &Polygon, leg: &Leg) -> f64 {
    let ends_m = leg.map(|end| inside_m(fence, &end.xy()));
    let least_m = ends_m[0].min(ends_m[1]);
    if least_m < 0.0 { least_m } else { Euclidean.distance(&line(leg), fence.exterior()) }
}

/// Distance [m] of a place to a fence, below 0 outside of it.
fn inside_m(fence: &Polygon, at: &Position) -> f64 {
    let at = Point::new(at.x, at.y);
    let away_m = Euclidean.distance(&at, fence.exterior());
    if fence.contains(&at) { away_m } else { -away_m }
}

fn line([from, to]: &Leg) -> Line {
    Line::new((from.x, from.y), (to.x, to.y))
}

/// A zone, or a building.
struct Obstacle {
    outline: Polygon,
    extent: Rect,
    /// Its top [m]; infinite for a zone.
    top_m: f64,
}

impl Obstacle {
    fn of(zone: &GeodeticZone) -> Self {
        let outline = fence::polygon(zone.outline.corners());
        let extent = outline.bounding_rect().expect("a zone has corners");
        Self { outline, extent, top_m: zone.height_m.unwrap_or(f64::INFINITY) }
    }

    /// The least that the horizontal distance of a leg can be [m], by the boxes around both.
    fn bound_m(&self, leg: &Leg) -> f64 {
        let of_leg = line(leg).bounding_rect();
        let gap_m = |low: [f64; 2], high: [f64; 2]| (low[0] - high[1]).max(low[1] - high[0]).max(0.0);
        let east_m = gap_m([self.extent.min().x, of_leg.min().x], [self.extent.max().x, of_leg.max().x]);
        let north_m = gap_m([self.extent.min().y, of_leg.min().y], [self.extent.max().y, of_leg.max().y]);
        east_m.hypot(north_m)
    }

    /// Distance of a leg [m].
    fn distance_m(&self, leg: &Leg) -> f64 {
        let above_m = leg.map(|end| (end.z - self.top_m).max(0.0));
        if above_m[0] == above_m[1] {
            return Euclidean.distance(&line(leg), &self.outline).hypot(above_m[0]);
        }
        // A leg that climbs over the building. Over each edge the distance is convex along the leg; over the roof it is
        // least where the leg crosses an edge, or ends.
        let [from, to] = leg;
        let away_m = |edge: &Line, fraction: f64| {
            let at = interpolate(*from, *to, fraction);
            Euclidean.distance(&Point::new(at.x, at.y), edge).hypot((at.z - self.top_m).max(0.0))
        };
        let edges = self.outline.exterior().lines();
        let beside_m = edges.map(|edge| least(|fraction| away_m(&edge, fraction)));
        let is_over = |end: &Point3<f64>| self.outline.contains(&Point::new(end.x, end.y));
        let ends_m = leg.iter().zip(above_m).filter(|(end, _)| is_over(end)).map(|(_, above_m)| above_m);
        beside_m.chain(ends_m).fold(f64::INFINITY, f64::min)
    }
}

/// Distance of a leg to the nearest of the obstacles [m].
fn least_distance_m(obstacles: &[Obstacle], leg: &Leg) -> f64 {
    let mut bounded: Vec<(f64, &Obstacle)> =
        obstacles.iter().map(|obstacle| (obstacle.bound_m(leg), obstacle)).collect();
    bounded.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut least_m = f64::INFINITY;
    for (bound_m, obstacle) in bounded {
        if bound_m >= least_m {
            break;
        }
        least_m = least_m.min(obstacle.distance_m(leg));
    }
    least_m
}

/// The least value of a convex function between 0 and 1, by golden sections.
fn least(value: impl Fn(f64) -> f64) -> f64 {
    let golden = (5.0_f64.sqrt() - 1.0) / 2.0;
    let [mut low, mut high] = [0.0, 1.0];
    for _ in 0..SEARCH_STEPS {
        let [left, right] = [high - golden * (high - low), low + golden * (high - low)];
        if value(left) <= value(right) {
            high = right;
        } else {
            low = left;
        }
    }
    [0.0, 1.0, f64::midpoint(low, high)].map(value).into_iter().fold(f64::INFINITY, f64::min)
}
