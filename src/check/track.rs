//! What a fixed flight is: its length, its altitudes, and how near it comes to the boundary, zones and buildings.

use serde::Serialize;
use skysink_common::airspace::Polygon;
use skysink_common::geometry::Position;
use skysink_common::scenario::Scenario;

use super::quantity::scaled;

/// The figures of a fixed flight (`uav.track`).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FixedFlight {
    /// Length of its way over ground [m].
    pub way_m: f64,
    /// Lowest and highest altitude above the ground [m].
    pub altitudes_m: [f64; 2],
    /// Least horizontal distance of its straight ways, slot by slot, from the boundary of the area, the zones and the
    /// buildings at their altitude [m]; null if there are none.
    pub clearance_m: Option<f64>,
    /// The slot of the least distance; null likewise.
    pub nearest_slot: Option<u64>,
}

impl FixedFlight {
    /// The figures; `None` if the flight is not fixed.
    pub fn of(scenario: &Scenario) -> Option<Self> {
        let waypoints_m = scenario.uav.waypoints_m.as_ref()?;
        let start: [f64; 3] = scenario.start().into();
        let flown = waypoints_m.iter().take(scenario.slots as usize);
        let places: Vec<(Position, f64)> =
            std::iter::once(&start).chain(flown).map(|&[x_m, y_m, z_m]| (Position::new(x_m, y_m), z_m)).collect();
        let zones = scenario.simplified_zones().zones;
        let nearest = |from: &(Position, f64), to: &(Position, f64)| {
            let lowest_m = from.1.min(to.1);
            let high = zones.iter().filter(|(_, top_m)| *top_m > lowest_m);
            high.map(|(polygon, _)| distance_m(polygon, &from.0, &to.0)).reduce(f64::min)
        };
        let ways = (1..).zip(places.windows(2));
        let nearest = ways.filter_map(|(slot, pair)| Some((nearest(&pair[0], &pair[1])?, slot)));
        let nearest: Option<(f64, u64)> = nearest.reduce(|least, next| if next.0 < least.0 { next } else { least });
        let altitudes_m = places.iter().map(|place| place.1);
        Some(Self {
            way_m: places.windows(2).map(|pair| (pair[1].0 - pair[0].0).norm()).sum(),
            altitudes_m: [altitudes_m.clone().fold(f64::INFINITY, f64::min), altitudes_m.fold(0.0, f64::max)],
            clearance_m: nearest.map(|(away_m, _)| away_m),
            nearest_slot: nearest.map(|(_, slot)| slot),
        })
    }

    /// Name and value of each figure.
    pub fn rows(&self) -> Vec<(&'static str, String)> {
        let [lowest_m, highest_m] = self.altitudes_m;
        let high =
            if lowest_m < highest_m { format!("{lowest_m} to {highest_m} m up") } else { format!("{lowest_m} m up") };
        let mut rows = vec![("fixed flight", format!("{}, {high}", scaled(self.way_m, "m")))];
        if let (Some(clearance_m), Some(slot)) = (self.clearance_m, self.nearest_slot) {
            let away = scaled(clearance_m, "m");
            rows.push(("least distance of it", format!("{away} to a zone or the fence, in slot {slot}")));
        }
        rows
    }
}

/// Distance of a straight way from the outline of a polygon [m]: 0 where it crosses, otherwise that of an end of one
/// from the other.
fn distance_m(polygon: &Polygon, from: &Position, to: &Position) -> f64 {
    let corners = polygon.corners();
    let edges = corners.iter().zip(corners.iter().cycle().skip(1));
    let along = to - from;
    let is_crossed = |(a, b): (&Position, &Position)| {
        let side = |at: &Position| along.perp(&(at - from));
        let across = b - a;
        let of_edge = |at: &Position| across.perp(&(at - a));
        side(a) * side(b) < 0.0 && of_edge(from) * of_edge(to) < 0.0
    };
    if edges.clone().any(is_crossed) {
        return 0.0;
    }
    let of_ends = [from, to].map(|end| (polygon.nearest(end) - end).norm());
    let of_corners = corners.iter().map(|corner| {
        let part = if along.norm() > 0.0 { (corner - from).dot(&along) / along.norm_squared() } else { 0.0 };
        (from + along * part.clamp(0.0, 1.0) - corner).norm()
    });
    of_corners.chain(of_ends).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use skysink_common::scenario::Overrides;

    use super::*;

    /// From (10, 50) to (50, 50) and (50, 90), along a zone whose corner is 3 m east and 4 m north of the bend: the way
    /// north passes at 3 m.
    #[test]
    fn the_least_distance_is_that_of_ways_and_not_of_their_ends() {
        let text = "name = 'a'\nslots = 2\n[uav]\nmax_speed_mps = 40.0\nstart_m = [10, 50]\n\
                    waypoints_m = [[50, 50, 20], [50, 90, 20]]\n\
                    [[area.no_fly]]\npolygon_m = [[53, 54], [70, 54], [70, 60]]\n\
                    [[area.building]]\npolygon_m = [[20, 51], [30, 51], [30, 55]]\nheight_m = 15.0\n";
        let scenario = Scenario::parse(text, Path::new("a.toml"), Overrides::default()).unwrap();
        let flight = FixedFlight::of(&scenario).unwrap();
        assert_eq!((flight.way_m, flight.altitudes_m), (80.0, [20.0; 2]));
        assert_eq!((flight.clearance_m, flight.nearest_slot), (Some(3.0), Some(2)));
        assert_eq!(flight.rows()[1].1, "3 m to a zone or the fence, in slot 2");
        assert_eq!(FixedFlight::of(&Scenario::letter(Overrides::default()).unwrap()), None);
    }
}
