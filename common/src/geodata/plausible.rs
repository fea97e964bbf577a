//! Whether sensor nodes, zones, buildings and the boundary of a field lie where they were probably meant to lie: the
//! doubts about coordinates that are valid, but of another unit, reference system, sign or order.

use nalgebra::Vector2;

use super::projection::{Origin, Projection};
use super::{check_geodetic, heights};
use crate::airspace::Polygon;
use crate::geometry::{Position, extent};

/// Extent [m] below which several sensor nodes are no field, whereas the degrees of a field are closer together.
const LEAST_FIELD_M: f64 = 1.0;

/// Side of an area [m] that no UAV flies over.
const VAST_M: f64 = 100e3;

/// A sensor node is an outlier if it is farther from the middle than this multiple of the distance within which three
/// quarters of the nodes lie, and farther than [`LEAST_OUTLIER_M`].
const OUTLIER_RATIO: f64 = 10.0;

/// Least distance [m] of an outlier from the middle of the sensor nodes.
const LEAST_OUTLIER_M: f64 = 1e3;

/// Most sensor nodes times corners for which is checked which nodes a boundary excludes.
const MOST_CHECKED: usize = 100_000_000;

/// Slack of a coordinate in whole hundredths [0.01].
const HUNDREDTHS_SLACK: f64 = 1e-6;

/// What a polygon in the area is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PolygonRole {
    /// A no-fly zone.
    NoFly,
    /// A building.
    Building,
    /// The boundary.
    Boundary,
}

/// A polygon in the area, by its name in messages: its key, or its file and number.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedPolygon {
    /// Its name.
    pub name: String,
    /// What it is.
    pub role: PolygonRole,
    /// Its corners [m].
    pub corners_m: Vec<[f64; 2]>,
}

/// All that lies in a field.
pub struct FieldPlaces<'a> {
    /// Extent of the area in x and y [m].
    pub sides_m: [f64; 2],
    /// Its south-west corner; `None` without geodetic coordinates.
    pub origin: Option<Origin>,
    /// The sensor nodes [m].
    pub nodes: &'a [Position],
    /// The altitude of the ground at each [m], or none.
    pub ground_m: &'a [f64],
    /// The name of a sensor node in messages: its file and line.
    pub node_name: &'a dyn Fn(usize) -> String,
    /// Zones, buildings and the boundary.
    pub polygons: &'a [NamedPolygon],
    /// `d_c` [m], within which the UAV serves sensor nodes outside of the boundary.
    pub comm_radius_m: f64,
}

/// Whether coordinates that should be metres are probably degrees: those of several nodes, all in the range of degrees
/// and closer together than nodes can stand.
#[must_use]
pub fn are_degrees(positions: &[[f64; 2]]) -> bool {
    let extent = extent(positions.iter().map(|&position| position.into()));
    positions.iter().all(is_in_degrees) && extent.is_some_and(|[low, high]| is_point(high - low))
}

/// Whether the coordinates of a single position that should be metres may be degrees: they are in the range of degrees,
/// and finer than a centimetre.
#[must_use]
pub fn may_be_degrees(position: &[f64; 2]) -> bool {
    let is_fine = |coordinate: &f64| {
        let hundredths = coordinate * 100.0;
        (hundredths - hundredths.round()).abs() > HUNDREDTHS_SLACK
    };
    is_in_degrees(position) && position.iter().all(is_fine)
}

/// Whether a position is in the range of a latitude and a longitude, in either order.
fn is_in_degrees([x, y]: &[f64; 2]) -> bool {
    x.abs().max(y.abs()) <= 180.0 && x.abs().min(y.abs()) <= 90.0
}

/// Whether an extent is too small for a field, but not that of one position.
fn is_point(extent: Vector2<f64>) -> bool {
    extent.x.max(extent.y) < LEAST_FIELD_M && extent.norm_squared() > 0.0
}

impl FieldPlaces<'_> {
    /// Probably unintended, a line each: all SNs stand within a metre, a side of the area is 100 km or longer, and
    /// more.
    pub fn doubts(&self) -> Vec<String> {
        let [width_m, height_m] = self.sides_m;
        let mut doubts = Vec::new();
        if self.origin.is_none()
            && let Some([low, high]) = extent(self.nodes.iter().copied())
            && is_point(high - low)
        {
            let count = self.nodes.len();
            let size = format!("{:.3} m × {:.3} m", high.x - low.x, high.y - low.y);
            doubts.push(format!("all {count} sensor nodes stand within {size}: are the metres of their list degrees?"));
        }
        if width_m.max(height_m) >= VAST_M {
            let size = format!("{} × {}", distance(width_m), distance(height_m));
            doubts.push(format!("the area is {size}: are all positions degrees of WGS84 (EPSG:4326), or metres?"));
        }
        doubts.extend(self.outlier());
        doubts.extend(heights::doubts(self.nodes, self.ground_m, self.node_name));
        doubts.extend(self.polygons.iter().filter_map(|polygon| self.beyond(polygon)));
        doubts.extend(self.polygons.iter().filter_map(|polygon| self.excluded(polygon)));
        doubts
    }

    /// An SN is more than 1 km from the middle of all, and 10 times as far as three quarters of them.
    fn outlier(&self) -> Option<String> {
        let [_, _, _, ..] = self.nodes else { return None };
        let median = |axis: usize| {
            let mut along: Vec<f64> = self.nodes.iter().map(|at| at[axis]).collect();
            let middle = along.len() / 2;
            *along.select_nth_unstable_by(middle, f64::total_cmp).1
        };
        let centre = Position::new(median(0), median(1));
        let distances_m: Vec<f64> = self.nodes.iter().map(|at| (at - centre).norm()).collect();
        let (node, &farthest_m) = distances_m.iter().enumerate().max_by(|(_, a), (_, b)| a.total_cmp(b))?;
        let mut sorted = distances_m.clone();
        let within_m = *sorted.select_nth_unstable_by((distances_m.len() - 1) * 3 / 4, f64::total_cmp).1;
        (farthest_m > LEAST_OUTLIER_M.max(OUTLIER_RATIO * within_m)).then(|| {
            let name = (self.node_name)(node);
            let [farthest, within] = [farthest_m, within_m].map(distance);
            format!("{name}: {farthest} from the middle of the sensor nodes, most of which lie within {within}")
        })
    }

    /// A polygon that nowhere touches the area.
    fn beyond(&self, polygon: &NamedPolygon) -> Option<String> {
        let [low, high] = extent(polygon.corners_m.iter().map(|&corner| corner.into()))?;
        let [width_m, height_m] = self.sides_m;
        let gap = |low: f64, high: f64, side_m: f64| if low > side_m { low - side_m } else { high.min(0.0) };
        let away = Vector2::new(gap(low.x, high.x, width_m), gap(low.y, high.y, height_m));
        (away.norm_squared() > 0.0).then(|| {
            let far = distance(away.norm());
            let hint =
                self.meant(&nalgebra::center(&low, &high)).map(|what| format!("; is {what}?")).unwrap_or_default();
            format!("{}: it lies {far} {} of the area{hint}", polygon.name, direction(&away))
        })
    }

    /// What is probably wrong with the coordinates of a position beyond the area: what moves it there.
    fn meant(&self, at: &Position) -> Option<&'static str> {
        let projection = Projection::at(self.origin?);
        let found = projection.unproject(at)?;
        meant([found.lat_deg, found.lon_deg], |[lat_deg, lon_deg]| {
            projection.project(lat_deg, lon_deg).is_some_and(|at| {
                [0, 1].into_iter().all(|axis| (-self.sides_m[axis]..=2.0 * self.sides_m[axis]).contains(&at[axis]))
            })
        })
    }

    /// A boundary that is farther from sensor nodes than `d_c`, or a no-fly zone that encloses most of them.
    fn excluded(&self, polygon: &NamedPolygon) -> Option<String> {
        if self.nodes.is_empty() || self.nodes.len().saturating_mul(polygon.corners_m.len()) > MOST_CHECKED {
            return None;
        }
        let is_border = polygon.role == PolygonRole::Boundary;
        let outline = Polygon::of(&polygon.corners_m, is_border).ok()?;
        let name = &polygon.name;
        match polygon.role {
            PolygonRole::Building => None,
            PolygonRole::NoFly => {
                let within = self.nodes.iter().filter(|node| outline.encloses(node)).count();
                let around = format!("a no-fly zone around {within} of {} sensor nodes", self.nodes.len());
                let hint = "is it the boundary (`kind` or `name` boundary, area.boundary_m)?";
                (2 * within > self.nodes.len()).then(|| format!("{name}: {around}: {hint}"))
            }
            PolygonRole::Boundary => {
                let away_m = |node: &Position| (outline.nearest(node) - node).norm();
                let outside = self.nodes.iter().enumerate().filter(|(_, node)| !outline.encloses(node));
                let outside = outside.map(|(node, at)| (node, away_m(at)));
                let outside: Vec<(usize, f64)> = outside.filter(|(_, away_m)| *away_m > self.comm_radius_m).collect();
                let (node, far_m) = *outside.iter().max_by(|(_, a), (_, b)| a.total_cmp(b))?;
                let of = match outside.len() {
                    1 => String::new(),
                    count => format!(", as {} other sensor nodes are", count - 1),
                };
                let node = (self.node_name)(node);
                let range = distance(self.comm_radius_m);
                Some(format!(
                    "{node}: {} outside of the boundary ({name}), beyond d_c, {range}{of}: it cannot be served",
                    distance(far_m)
                ))
            }
        }
    }
}

/// What is probably wrong with a latitude and a longitude [°]: what changes it so that it `is_near`.
pub fn meant([lat_deg, lon_deg]: [f64; 2], is_near: impl Fn([f64; 2]) -> bool) -> Option<&'static str> {
    let changed = [
        ([lat_deg, -lon_deg], "the sign of its longitude wrong"),
        ([-lat_deg, lon_deg], "the sign of its latitude wrong"),
        ([lon_deg, lat_deg], "its longitude first, where latitude is expected, or the other way round"),
    ];
    let is_meant = |position: &[f64; 2]| check_geodetic(*position).is_ok() && is_near(*position);
    changed.into_iter().find(|(position, _)| is_meant(position)).map(|(_, what)| what)
}

/// A distance in the unit that suits it.
#[must_use]
pub fn distance(metres: f64) -> String {
    match metres {
        ..1.0 => format!("{metres:.3} m"),
        ..1e3 => format!("{metres:.0} m"),
        ..100e3 => format!("{:.1} km", metres / 1e3),
        _ => format!("{:.0} km", metres / 1e3),
    }
}

/// The direction of a vector, x east and y north, of eight.
fn direction(away: &Vector2<f64>) -> String {
    let is_large = |along: f64, across: f64| along.abs() > across.abs() * std::f64::consts::FRAC_PI_8.tan();
    let word = |is_told: bool, along: f64, low: &'static str, high: &'static str| {
        is_told.then_some(if along < 0.0 { low } else { high })
    };
    let north = word(is_large(away.y, away.x), away.y, "south", "north");
    let east = word(is_large(away.x, away.y), away.x, "west", "east");
    north.into_iter().chain(east).collect::<Vec<_>>().join("-")
}

#[cfg(test)]
mod tests {
    use super::*;

    const ORIGIN: Origin = Origin { lat_deg: 47.397, lon_deg: 8.545 };

    /// The doubts about a field of 200 m × 200 m.
    fn doubts(nodes: &[[f64; 2]], polygons: &[NamedPolygon]) -> Vec<String> {
        let nodes: Vec<Position> = nodes.iter().map(|&node| node.into()).collect();
        let node_name = &|node: usize| format!("line {}", node + 2);
        let comm_radius_m = 10.0;
        let origin = Some(ORIGIN);
        let ground_m = &[];
        FieldPlaces { sides_m: [200.0; 2], origin, nodes: &nodes, ground_m, node_name, polygons, comm_radius_m }
            .doubts()
    }

    fn square(role: PolygonRole, [x, y]: [f64; 2], side: f64) -> NamedPolygon {
        let corners_m = vec![[x, y], [x + side, y], [x + side, y + side], [x, y + side]];
        NamedPolygon { name: "a".to_owned(), role, corners_m }
    }

    #[test]
    fn metres_of_a_field_are_no_degrees() {
        for (positions, expected) in [
            (&[[8.5452, 47.3972], [8.5478, 47.3988]][..], true),
            (&[[47.3972, 8.5452], [47.3988, 8.5478]], true),
            (&[[-122.41, 37.77], [-122.45, 37.8]], true),
            (&[[8.5452, 47.3972]], false),
            (&[[8.5452, 47.3972], [8.5452, 47.3972]], false),
            (&[[1.0, 2.0], [3.0, 4.0]], false),
            (&[[465_700.1, 5_249_600.1], [465_700.2, 5_249_600.2]], false),
        ] {
            assert_eq!(are_degrees(positions), expected, "{positions:?}");
        }
    }

    #[test]
    fn a_single_position_of_fine_metres_may_be_degrees() {
        for (position, expected) in [
            ([8.5452, 47.3972], true),
            ([-122.4194, 37.7749], true),
            ([8.5452, 247.3972], false),
            ([8.5, 47.25], false),
            ([8.5452, 47.0], false),
            ([91.123, 92.123], false),
        ] {
            assert_eq!(may_be_degrees(&position), expected, "{position:?}");
        }
    }

    #[test]
    fn only_a_node_far_from_close_ones_is_an_outlier() {
        let near = [[1.0, 1.0], [90.0, 9.0], [5.0, 80.0], [100.0, 100.0]];
        let with = |far: &[[f64; 2]]| doubts(&[&near[..], far].concat(), &[]);
        assert!(with(&[]).is_empty() && with(&[[900.0, 0.0]]).is_empty());
        let [said] = &with(&[[30e3, 40e3]])[..] else { panic!("one doubt") };
        assert!(said.starts_with("line 6: 49.9 km from the middle of the sensor nodes, most of which lie"), "{said}");
        let two = doubts(&[[0.0, 0.0], [9e3, 0.0]], &[]);
        assert!(two.is_empty(), "{two:?}");
    }

    #[test]
    fn polygons_that_touch_the_area_are_not_beyond_it() {
        for (corner, expected) in [
            ([50.0, 50.0], None),
            ([-100.0, 0.0], None),
            ([200.0, 200.0], None),
            ([-107.0, 0.0], Some("a: it lies 7 m west of the area")),
            ([2200.0, -2100.0], Some("a: it lies 2.8 km south-east of the area")),
            ([0.0, 200_200.0], Some("a: it lies 200 km north of the area")),
        ] {
            for role in [PolygonRole::NoFly, PolygonRole::Building, PolygonRole::Boundary] {
                let said = doubts(&[], &[square(role, corner, 100.0)]);
                assert_eq!(said.first().map(String::as_str), expected, "{corner:?}");
            }
        }
    }

    #[test]
    fn what_moves_a_polygon_into_the_area_is_named() {
        let projection = Projection::at(ORIGIN);
        for ([lat_deg, lon_deg], hint) in [
            ([47.398, -8.546], "is the sign of its longitude wrong?"),
            ([-17.0, 8.546], "area"),
            ([8.546, 47.398], "is its longitude first, where latitude is expected, or the other way round?"),
        ] {
            let at = projection.project(lat_deg, lon_deg).unwrap();
            let said = doubts(&[], &[square(PolygonRole::NoFly, at.into(), 10.0)]).concat();
            assert!(said.ends_with(hint), "{said}");
        }
    }

    #[test]
    fn nodes_out_of_range_of_a_boundary_and_zones_around_all_nodes_are_said() {
        let nodes = [[50.0, 50.0], [160.0, 50.0], [190.0, 50.0]];
        let boundary = square(PolygonRole::Boundary, [0.0, 0.0], 150.0);
        let beyond = "outside of the boundary (a), beyond d_c, 10 m";
        let expected = format!("line 4: 40 m {beyond}: it cannot be served");
        assert_eq!(doubts(&nodes, std::slice::from_ref(&boundary)), [expected]);
        let both = doubts(&[nodes[0], [161.0, 50.0], nodes[2]], &[boundary]);
        assert_eq!(both, [format!("line 4: 40 m {beyond}, as 1 other sensor nodes are: it cannot be served")]);
        let zone = |side| doubts(&nodes, &[square(PolygonRole::NoFly, [0.0, 0.0], side)]);
        assert!(zone(100.0).is_empty());
        assert!(zone(170.0)[0].starts_with("a: a no-fly zone around 2 of 3 sensor nodes: is it the boundary"));
        assert!(doubts(&nodes, &[square(PolygonRole::Building, [0.0, 0.0], 195.0)]).is_empty());
    }
}
