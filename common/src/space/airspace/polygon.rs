//! A simple polygon that a straight way may enter or not.

use smallvec::SmallVec;

use crate::geometry::{Position, distance_squared, extent};

/// Bends of a way, and its end.
pub type Bends = SmallVec<[Position; 4]>;

/// Least area of a polygon, relative to the square of the diagonal of its extent.
const LEAST_AREA: f64 = 1e-12;

/// Slack of crossings, as a fraction of a segment or an edge.
const CROSSING_SLACK: f64 = 1e-12;

/// A simple polygon. What is forbidden is its interior, or, for a border, all outside of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Polygon {
    /// Its corners [m], with the forbidden side to the left of each edge.
    corners: Vec<Position>,
    lowest: Position,
    highest: Position,
    is_border: bool,
}

/// Depth in a zone that rounding may lead to, relative to the area.
pub(super) const DEPTH_SLACK: f64 = 1e-12;

/// A zone up to an altitude.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ClosedZone {
    /// Its outline.
    pub polygon: Polygon,
    /// Its top [m]; infinite for a no-fly zone.
    pub top_m: f64,
}

impl Polygon {
    /// The polygon with these corners, in either direction.
    ///
    /// # Errors
    /// What is expected of the corners, if they are not those of a simple polygon.
    pub fn of(corners: &[[f64; 2]], is_border: bool) -> Result<Self, &'static str> {
        const EXPECTED: &str = "the corners of a polygon, [[x, y], [x, y], [x, y], ...] in metres, without crossings";
        let mut corners: Vec<Position> = corners.iter().map(|&corner| Position::from(corner)).collect();
        corners.dedup();
        while corners.len() > 1 && corners.first() == corners.last() {
            corners.pop();
        }
        let is_measurable = |corner: &Position| corner.iter().all(|coordinate_m| coordinate_m.abs() <= 1e9);
        if corners.len() < 3 || !corners.iter().all(is_measurable) {
            return Err(EXPECTED);
        }
        let mut ring = Self::ring(corners, is_border);
        let twice_m2 = ring.twice_m2();
        if twice_m2.abs() <= LEAST_AREA * (ring.highest - ring.lowest).norm_squared() || ring.crosses_itself() {
            return Err(EXPECTED);
        }
        if (twice_m2 > 0.0) == is_border {
            ring.corners.reverse();
        }
        Ok(ring)
    }

    /// The ring of these corners as they are, of which there are some.
    fn ring(corners: Vec<Position>, is_border: bool) -> Self {
        let [lowest, highest] = extent(corners.iter().copied()).expect("a polygon has corners");
        Self { corners, lowest, highest, is_border }
    }

    /// Twice its area [m²], below 0 if its corners go clockwise.
    fn twice_m2(&self) -> f64 {
        let origin = self.corners[0];
        edges(&self.corners).map(|[a, b]| (a - origin).perp(&(b - origin))).sum()
    }

    /// Its corners [m], with the forbidden side to the left.
    pub fn corners(&self) -> &[Position] {
        &self.corners
    }

    /// The corners of its bounding box, south-west and north-east [m].
    pub fn extent(&self) -> [Position; 2] {
        [self.lowest, self.highest]
    }

    /// The part of its bounding box that it fills.
    pub fn filled(&self) -> f64 {
        let sides = self.highest - self.lowest;
        self.twice_m2().abs() / 2.0 / (sides.x * sides.y)
    }

    /// Whether what is forbidden is the outside.
    pub fn is_border(&self) -> bool {
        self.is_border
    }

    /// The polygon with other corners [m], in the same direction; `None` if it would cross itself.
    pub(super) fn with_corners(&self, corners: Vec<Position>) -> Option<Self> {
        let ring = Self::ring(corners, self.is_border);
        (!ring.crosses_itself()).then_some(ring)
    }

    /// Whether two edges have more in common than the corner between neighbours.
    fn crosses_itself(&self) -> bool {
        let count = self.corners.len();
        let edge = |index: usize| [self.corners[index], self.corners[(index + 1) % count]];
        // Those apart in x are not compared: after each edge only those that begin before it ends.
        let mut order: Vec<usize> = (0..count).collect();
        let west_m = |index: &usize| edge(*index).map(|end| end.x).into_iter().fold(f64::INFINITY, f64::min);
        order.sort_by(|a, b| west_m(a).total_cmp(&west_m(b)));
        (0..count).any(|at| {
            let first = order[at];
            let east_m = edge(first).map(|end| end.x).into_iter().fold(f64::NEG_INFINITY, f64::max);
            let others = order[at + 1..].iter().take_while(|other| west_m(other) <= east_m);
            others.into_iter().any(|&other| self.do_edges_meet(first.min(other), first.max(other)))
        })
    }

    /// Whether two edges, `first` before `second`, have more in common than the corner between neighbours.
    fn do_edges_meet(&self, first: usize, second: usize) -> bool {
        let count = self.corners.len();
        let edge = |index: usize| [self.corners[index], self.corners[(index + 1) % count]];
        let [a, b] = edge(first);
        let [c, d] = edge(second);
        let are_apart = a.y.max(b.y) < c.y.min(d.y) || c.y.max(d.y) < a.y.min(b.y);
        let are_neighbours = second == first + 1 || (first == 0 && second == count - 1);
        if are_neighbours {
            // Back along the same line.
            let [before, at, after] = if second == first + 1 { [a, b, d] } else { [c, d, b] };
            let [back, on] = [before - at, after - at];
            return back.perp(&on) == 0.0 && back.dot(&on) > 0.0;
        }
        if are_apart {
            return false;
        }
        let side = |p: &Position, q: &Position, r: &Position| (q - p).perp(&(r - p));
        let of_c = side(&a, &b, &c);
        let of_d = side(&a, &b, &d);
        let of_a = side(&c, &d, &a);
        let of_b = side(&c, &d, &b);
        if [of_a, of_b, of_c, of_d] == [0.0; 4] {
            return a.inf(&b).sup(&c.inf(&d)) <= a.sup(&b).inf(&c.sup(&d));
        }
        of_c * of_d <= 0.0 && of_a * of_b <= 0.0
    }

    /// Whether `point` [m] lies within the polygon, by the crossings of a ray; on an edge it is either.
    pub fn encloses(&self, point: &Position) -> bool {
        let crossings = edges(&self.corners).filter(|[a, b]| {
            (a.y > point.y) != (b.y > point.y) && point.x < a.x + (point.y - a.y) / (b.y - a.y) * (b.x - a.x)
        });
        crossings.count() % 2 == 1
    }

    /// Whether `point` [m] is forbidden, and deeper than `slack_m` [m].
    pub fn forbids(&self, point: &Position, slack_m: f64) -> bool {
        let is_near = || {
            let margin = nalgebra::Vector2::repeat(slack_m);
            self.lowest - margin <= *point && *point <= self.highest + margin
        };
        if !self.is_border && !is_near() {
            return false;
        }
        let is_apart = |edge: [Position; 2]| {
            let [a, b] = edge;
            let is_beside = |axis: usize| {
                a[axis].min(b[axis]) - point[axis] > 2.0 * slack_m || point[axis] - a[axis].max(b[axis]) > 2.0 * slack_m
            };
            is_beside(0) || is_beside(1) || distance_squared(&projection(point, edge), point) > slack_m * slack_m
        };
        self.encloses(point) != self.is_border && edges(&self.corners).all(is_apart)
    }

    /// The point of the boundary that is nearest to `point` [m].
    pub fn nearest(&self, point: &Position) -> Position {
        let nearest = self.projections(point).min_by(|a, b| {
            let away_m2 = |projected: &Position| distance_squared(projected, point);
            away_m2(a).total_cmp(&away_m2(b))
        });
        nearest.expect("a polygon has edges")
    }

    /// The nearest point of each edge to `point` [m].
    pub fn projections(&self, point: &Position) -> impl Iterator<Item = Position> {
        let point = *point;
        edges(&self.corners).map(move |edge| projection(&point, edge))
    }

    /// The points at which its boundary crosses that of `other` [m].
    pub fn crossings(&self, other: &Self) -> Vec<Position> {
        let is_near = self.lowest.sup(&other.lowest) <= self.highest.inf(&other.highest);
        let pairs = edges(&self.corners).filter(|_| is_near);
        let pairs = pairs.flat_map(|edge| edges(&other.corners).map(move |of_other| (edge, of_other)));
        let crossing = |([a, b], [c, d]): ([Position; 2], [Position; 2])| {
            let along = b - a;
            let across = d - c;
            let turn = along.perp(&across); // 0 in parallel, which makes fractions infinite or NaN
            let [of_along, of_across] = [(c - a).perp(&across) / turn, (c - a).perp(&along) / turn];
            let is_on = |fraction: &f64| (0.0..=1.0).contains(fraction);
            (is_on(&of_along) && is_on(&of_across)).then(|| a + along * of_along)
        };
        pairs.filter_map(crossing).collect()
    }

    /// The fraction of the straight way from `from` to `to` [m] at which it becomes forbidden, by more than `slack_m`
    /// [m]; `None` if it does not. With `may_leave`, a way that begins at a forbidden point may leave it.
    pub fn entry(&self, from: &Position, to: &Position, slack_m: f64, mut may_leave: bool) -> Option<f64> {
        if !self.is_border {
            let is_apart = |axis: usize| {
                from[axis].max(to[axis]) <= self.lowest[axis] || from[axis].min(to[axis]) >= self.highest[axis]
            };
            if is_apart(0) || is_apart(1) {
                return None;
            }
        }
        let along = to - from;
        if !self.is_border && from != to {
            // All of it lies to one side of the line: at most its boundary is touched.
            let sides = || self.corners.iter().map(|corner| along.perp(&(corner - from)));
            if sides().all(|side| side >= 0.0) || sides().all(|side| side <= 0.0) {
                return None;
            }
        }
        let mut turns: SmallVec<[f64; 8]> = SmallVec::new();
        turns.extend([0.0, 1.0]);
        let length_m = along.norm();
        for [a, b] in edges(&self.corners) {
            let edge = b - a;
            let across = along.perp(&edge);
            let off = a - from;
            if across.abs() <= CROSSING_SLACK * length_m * edge.norm() {
                // In parallel: where it begins or ends beside the edge.
                for end in [off, b - from] {
                    let fraction = end.dot(&along) / (length_m * length_m);
                    turns.extend((0.0..=1.0).contains(&fraction).then_some(fraction));
                }
                continue;
            }
            let fraction = off.perp(&edge) / across;
            let of_edge = off.perp(&along) / across;
            let crossed = -CROSSING_SLACK..=1.0 + CROSSING_SLACK;
            if crossed.contains(&fraction) && crossed.contains(&of_edge) {
                turns.push(fraction.clamp(0.0, 1.0));
            }
        }
        turns.sort_unstable_by(f64::total_cmp);
        for pair in turns.windows(2) {
            let middle = from + along * ((pair[0] + pair[1]) / 2.0);
            let is_forbidden = self.forbids(&middle, slack_m);
            if is_forbidden && !(may_leave && self.forbids(from, slack_m)) {
                return Some(pair[0]);
            }
            may_leave &= is_forbidden;
        }
        None
    }
}

/// The edges of a closed polygon.
fn edges(corners: &[Position]) -> impl Iterator<Item = [Position; 2]> {
    let next = corners.iter().cycle().skip(1);
    corners.iter().zip(next).map(|(a, b)| [*a, *b])
}

/// The point of an edge that is nearest to `point`.
fn projection(point: &Position, [a, b]: [Position; 2]) -> Position {
    let along = b - a;
    a + along * ((point - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0)
}

/// The point between `from` and `to` that is nearest to `point`.
pub(super) fn nearest_between(point: &Position, from: &Position, to: &Position) -> Position {
    let along = to - from;
    if along == nalgebra::Vector2::zeros() {
        return *from;
    }
    let fraction = (point - from).dot(&along) / along.norm_squared();
    if fraction < 1.0 { from + along * fraction.max(0.0) } else { *to }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square() -> Polygon {
        Polygon::of(&[[10.0, 10.0], [30.0, 10.0], [30.0, 30.0], [10.0, 30.0]], false).unwrap()
    }

    fn entry(ring: &Polygon, from: [f64; 2], to: [f64; 2]) -> Option<f64> {
        ring.entry(&from.into(), &to.into(), 1e-9, true)
    }

    #[test]
    fn a_polygon_fills_a_part_of_its_bounding_box() {
        let triangle = Polygon::of(&[[10.0, 10.0], [30.0, 10.0], [30.0, 20.0]], false).unwrap();
        assert_eq!([square(), triangle].map(|polygon| polygon.filled()), [1.0, 0.5]);
    }

    #[test]
    fn a_segment_enters_the_interior_where_it_crosses_an_edge() {
        assert_eq!(entry(&square(), [0.0, 20.0], [40.0, 20.0]), Some(0.25));
        assert_eq!(entry(&square(), [0.0, 20.0], [20.0, 20.0]), Some(0.5), "it ends inside");
        assert_eq!(entry(&square(), [0.0, 0.0], [40.0, 40.0]), Some(0.25), "through two corners");
        assert_eq!(entry(&square(), [0.0, 5.0], [40.0, 5.0]), None);
    }

    #[test]
    fn a_segment_along_an_edge_or_past_a_corner_does_not_enter() {
        assert_eq!(entry(&square(), [0.0, 10.0], [40.0, 10.0]), None);
        assert_eq!(entry(&square(), [10.0, 10.0], [30.0, 10.0]), None);
        assert_eq!(entry(&square(), [0.0, 20.0], [20.0, 0.0]), None, "it touches (10, 10)");
        assert_eq!(entry(&square(), [0.0, 20.0 + 1e-10], [20.0, 1e-10]), None, "within the slack");
        assert!(entry(&square(), [0.0, 20.0 + 1e-6], [20.0, 1e-6]).is_some());
    }

    #[test]
    fn a_segment_may_leave_the_interior_but_not_reenter() {
        assert_eq!(entry(&square(), [20.0, 20.0], [40.0, 20.0]), None);
        let bay = [
            [0.0, 0.0],
            [30.0, 0.0],
            [30.0, 30.0],
            [20.0, 30.0],
            [20.0, 10.0],
            [10.0, 10.0],
            [10.0, 30.0],
            [0.0, 30.0],
        ];
        let bay = Polygon::of(&bay, false).unwrap();
        assert_eq!(entry(&bay, [5.0, 20.0], [15.0, 20.0]), None, "into the bay");
        assert!(entry(&bay, [5.0, 20.0], [25.0, 20.0]).is_some(), "through the bay");
    }

    #[test]
    fn points_outside_the_boundary_are_forbidden() {
        let border = Polygon::of(&[[10.0, 10.0], [30.0, 10.0], [30.0, 30.0], [10.0, 30.0]], true).unwrap();
        assert_eq!(entry(&border, [12.0, 20.0], [28.0, 20.0]), None);
        assert_eq!(entry(&border, [20.0, 20.0], [40.0, 20.0]), Some(0.5));
        assert!(border.forbids(&Position::new(99.0, 99.0), 0.0) && !border.forbids(&Position::new(20.0, 20.0), 0.0));
    }

    #[test]
    fn an_invalid_polygon_is_refused() {
        for corners in [
            &[[0.0, 0.0], [1.0, 0.0]][..],
            &[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]],
            &[[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]],
            &[[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [1.0, 0.0]],
            &[[0.0, 0.0], [1.0, 0.0], [f64::NAN, 1.0]],
            &[[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [2.0, 0.0], [0.0, 4.0]],
        ] {
            assert!(Polygon::of(corners, false).is_err(), "{corners:?}");
        }
        let closed = [[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.0, 0.0]];
        assert_eq!(Polygon::of(&closed, false).unwrap().corners().len(), 3, "a repeated corner counts once");
    }
}
