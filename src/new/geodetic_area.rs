//! The area around positions in degrees: a plane in which all of them have positive coordinates.

use std::path::Path;

use skysink_common::error::InputError;
use skysink_common::geodata::plausible::{distance, meant};
use skysink_common::geodata::projection::Projection;
use skysink_common::geometry::Position;
use skysink_common::scenario::Origin;
use skysink_lab::import::plan::PLAN;
use skysink_lab::import::south_west;

use super::area::{MARGIN_M, beyond, sides};
use super::plan::HOME;

/// Approximate length of a degree of latitude [m].
const DEGREE_M: f64 = 111_000.0;

/// Side of an area that contains all positions for which the tangent plane is accurate [m].
const VAST_M: f64 = 1e6;

/// Distances of the corner of the area from the sensor nodes, tried in this order [m]. A small one can fail: on the
/// southern hemisphere, a point far to the east of the corner, on the same parallel, has y < 0 in the tangent plane.
const CORNERS_M: [f64; 4] = [MARGIN_M, 100.0, 1e3, 1e4];

/// Largest angle [°] by which the corner lies west of a position near a pole.
const MOST_WEST_DEG: f64 = 45.0;

/// A position with its origin.
pub struct SourcePosition<'a> {
    pub what: &'static str,
    pub path: &'a Path,
    pub place: &'a str,
    /// Latitude and longitude [°].
    pub position: [f64; 2],
}

impl SourcePosition<'_> {
    /// Its name in messages.
    pub fn name(&self) -> String {
        self.refusal("").to_string().trim_end_matches(": ").to_owned()
    }

    /// Whether the UAV starts there.
    pub fn is_start(&self) -> bool {
        self.what == "option" || (self.what == PLAN && self.place == HOME)
    }

    pub fn refusal(&self, message: &str) -> InputError {
        InputError::new(self.what, self.path, format_args!("{}: {message}", self.place))
    }
}

/// An area in degrees.
pub struct GeodeticArea {
    /// Its south-west corner.
    pub origin: Origin,
    /// Its sides [m].
    pub sides_m: [f64; 2],
    /// The positions in it [m].
    pub positions: Vec<Position>,
}

impl GeodeticArea {
    /// The area north and east of a corner, in whose tangent plane all positions have positive coordinates. The first
    /// `nodes` of them are those of sensor nodes, which say where the field is if one lies elsewhere.
    pub fn around(places: &[SourcePosition<'_>], nodes: usize) -> Result<Self, InputError> {
        let positions: Vec<[f64; 2]> = places.iter().map(|place| place.position).collect();
        let by_corner = CORNERS_M.iter().map(|&corner_m| corner(&positions, corner_m));
        let by_circle = CORNERS_M.iter().map(|&corner_m| corner_near_pole(&positions, corner_m));
        for [lat_deg, lon_deg] in by_corner.chain(by_circle) {
            let lon_deg = if lon_deg < -180.0 { lon_deg + 360.0 } else { lon_deg }; // west of the 180th meridian
            let [lat_deg, lon_deg] = [lat_deg, lon_deg].map(|deg| (deg * 1e7).round() / 1e7);
            let origin = Origin { lat_deg, lon_deg };
            let projection = Projection::at(origin);
            let is_within = |at: &Position| at.iter().all(|along_m| (0.0..=VAST_M).contains(along_m));
            let project = |[lat_deg, lon_deg]: &[f64; 2]| projection.project(*lat_deg, *lon_deg).filter(is_within);
            if let Some(positions) = positions.iter().map(project).collect::<Option<Vec<Position>>>() {
                let last_m = positions.iter().fold(Position::origin(), |last, at| last.sup(at));
                return Ok(Self { origin, sides_m: [last_m.x, last_m.y].map(beyond), positions });
            }
        }
        Err(refusal(places, if nodes > 0 { &positions[..nodes] } else { &positions }))
    }

    pub fn projection(&self) -> Projection {
        Projection::at(self.origin)
    }

    /// Its keys.
    pub fn keys(&self) -> String {
        let Origin { lat_deg, lon_deg } = self.origin;
        let origin =
            format!("origin_lat_deg = {lat_deg:.7} # of its south-west corner, WGS84\norigin_lon_deg = {lon_deg:.7}");
        format!("{}\n{origin}", sides(self.sides_m))
    }
}

/// The corner [°] at a distance [m] south of the southernmost position, and west of the westernmost one on the parallel
/// of the corner.
fn corner(positions: &[[f64; 2]], corner_m: f64) -> [f64; 2] {
    let [low_lat_deg, low_lon_deg] = south_west(positions);
    let lat_deg = (low_lat_deg - corner_m / DEGREE_M).max(-90.0);
    [lat_deg, low_lon_deg - corner_m / DEGREE_M / low_lat_deg.to_radians().cos().max(0.01)]
}

/// The same near a pole, where parallels are circles of very different size: west of each position on its own parallel.
fn corner_near_pole(positions: &[[f64; 2]], corner_m: f64) -> [f64; 2] {
    let west_of = |[lat_deg, lon_deg]: &[f64; 2]| {
        let west_deg = corner_m / DEGREE_M / lat_deg.to_radians().cos();
        [*lat_deg, lon_deg - west_deg.min(MOST_WEST_DEG)]
    };
    let [lat_deg, lon_deg] = south_west(&positions.iter().map(west_of).collect::<Vec<_>>());
    [(lat_deg - corner_m / DEGREE_M).max(-90.0), lon_deg]
}

/// The refusal of positions without an area, by the one that is farthest from the middle of the `field` [°].
fn refusal(places: &[SourcePosition<'_>], field: &[[f64; 2]]) -> InputError {
    let median = [0, 1].map(|axis| {
        let mut along: Vec<f64> = field.iter().map(|position| position[axis]).collect();
        along.sort_by(f64::total_cmp);
        along[along.len() / 2]
    });
    let projection = Projection::at(Origin { lat_deg: median[0], lon_deg: median[1] });
    let away_m = |[lat_deg, lon_deg]: [f64; 2]| {
        projection.project(lat_deg, lon_deg).map_or(f64::INFINITY, |at| at.coords.norm())
    };
    let distances = places.iter().map(|place| (place, away_m(place.position)));
    // The first of those that are equally far.
    let farthest = distances.reduce(|farthest, next| if next.1 > farthest.1 { next } else { farthest });
    let (farthest, farthest_m) = farthest.expect("there are several");
    let [lat_deg, lon_deg] = farthest.position;
    if farthest_m <= VAST_M {
        let expected = "the positions lie around a pole, where no plane has north at its top: expected them within 90° \
                        of longitude, or metres of a plane without latitude and longitude";
        return farthest.refusal(&format!("{lat_deg},{lon_deg}: {expected}"));
    }
    let away = if farthest_m.is_finite() { distance(farthest_m) } else { "half the Earth".to_owned() };
    let hint = meant(farthest.position, |position| away_m(position) <= VAST_M);
    let hint = hint.map(|what| format!("; is {what}?")).unwrap_or_default();
    let expected = format!("expected a field of at most {}{hint}", distance(VAST_M));
    farthest.refusal(&format!("{lat_deg},{lon_deg}: {away} from the middle of the positions: {expected}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The area around positions [°], or the refusal.
    fn around(positions: &[[f64; 2]], nodes: usize) -> Result<GeodeticArea, String> {
        let place = |&position: &[f64; 2]| SourcePosition { what: "a", path: Path::new("b"), place: "c", position };
        let places: Vec<SourcePosition> = positions.iter().map(place).collect();
        GeodeticArea::around(&places, nodes).map_err(|refusal| refusal.message)
    }

    #[test]
    fn a_field_near_a_pole_has_an_area_with_all_positions_at_their_distances() {
        for positions in [
            &[[89.999, 10.0], [89.99, 100.0], [89.995, 20.0]][..],
            &[[89.9, 170.0], [89.95, -100.0]],
            &[[-89.999, 10.0], [-89.99, 80.0]],
            &[[-89.9, 170.0], [-89.95, -170.0]],
            &[[90.0, 0.0], [89.999, 20.0]],
        ] {
            let area = around(positions, positions.len()).unwrap_or_else(|message| panic!("{positions:?}: {message}"));
            for (at, other) in area.positions.iter().zip(area.positions.iter().skip(1)) {
                assert!(at.iter().chain(other.iter()).all(|along_m| *along_m >= 0.0));
            }
            // Near a pole the parallels are circles about it: the law of cosines, with 111.69 km per degree.
            let [[first_lat, first_lon], [second_lat, second_lon]] = [positions[0], positions[1]];
            let [r, s] = [first_lat, second_lat].map(|lat_deg| (90.0 - lat_deg.abs()) * 111_694.0);
            let between_m = (r * r + s * s - 2.0 * r * s * (second_lon - first_lon).to_radians().cos()).sqrt();
            let found_m = (area.positions[0] - area.positions[1]).norm();
            assert!((found_m / between_m - 1.0).abs() < 1e-3, "{positions:?}: {found_m} m, not {between_m} m");
        }
    }

    #[test]
    fn a_field_around_a_pole_is_refused_as_such() {
        for lat_deg in [89.99, -89.99] {
            let positions = [[lat_deg, 0.0], [lat_deg, 120.0], [lat_deg, -120.0]];
            let message = around(&positions, 3).err().unwrap();
            assert!(message.contains("the positions lie around a pole"), "{message}");
        }
    }

    #[test]
    fn the_sensor_nodes_say_where_the_field_is() {
        let nodes = [[50.1, 7.2], [50.102, 7.202]];
        let swapped = [[7.199, 50.099], [7.199, 50.103], [7.203, 50.103], [7.203, 50.099]];
        let message = around(&[&nodes[..], &swapped].concat(), 2).err().unwrap();
        assert!(message.starts_with("c: 7.199,50.1"), "{message}");
        assert!(message.ends_with("; is its longitude first, where latitude is expected, or the other way round?"));
        let message = around(&[nodes[0], nodes[1], [50.1, -7.2], [-60.0, 100.0]], 2).err().unwrap();
        assert!(message.starts_with("c: -60,100: half the Earth from the middle"), "{message}");
    }
}
