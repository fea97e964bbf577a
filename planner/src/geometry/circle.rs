//! The smallest enclosing circle of points.

use skysink_common::geometry::{Position, distance_squared};

/// Relative slack of "inside": a circle passes exactly through the points that define it.
const SLACK: f64 = 1.0 + 1e-12;

/// A circle by its centre and squared radius [m²].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circle {
    /// Its centre.
    pub centre: Position,
    /// Its squared radius [m²].
    pub radius_m2: f64,
}

impl Circle {
    fn contains(&self, point: &Position) -> bool {
        distance_squared(&self.centre, point) <= self.radius_m2 * SLACK
    }

    fn through_two(a: &Position, b: &Position) -> Self {
        let centre = nalgebra::center(a, b);
        Self { centre, radius_m2: distance_squared(&centre, a).max(distance_squared(&centre, b)) }
    }

    /// The circle through three points; if they are on a line, the one over the outer two.
    fn through_three(a: &Position, b: &Position, c: &Position) -> Self {
        let u = b - a;
        let v = c - a;
        let twice_area_m2 = 2.0 * (u.x * v.y - u.y * v.x);
        let u2 = u.norm_squared();
        let v2 = v.norm_squared();
        let offset = nalgebra::Vector2::new(v.y * u2 - u.y * v2, u.x * v2 - v.x * u2) / twice_area_m2;
        let centre = a + offset;
        let radius_m2 = [a, b, c].map(|point| distance_squared(&centre, point)).into_iter().fold(0.0, f64::max);
        if radius_m2.is_finite() {
            return Self { centre, radius_m2 };
        }
        let pairs = [Self::through_two(a, b), Self::through_two(a, c), Self::through_two(b, c)];
        pairs.into_iter().max_by(|a, b| a.radius_m2.total_cmp(&b.radius_m2)).expect("three pairs")
    }

    /// The smallest enclosing circle of `points` by Welzl's incremental algorithm; a circle of radius 0 at the origin
    /// if there are no points.
    #[must_use]
    pub fn around(points: &[Position]) -> Self {
        let Some(first) = points.first() else {
            return Self { centre: Position::origin(), radius_m2: 0.0 };
        };
        let mut circle = Self { centre: *first, radius_m2: 0.0 };
        for (i, a) in points.iter().enumerate() {
            if circle.contains(a) {
                continue;
            }
            circle = Self { centre: *a, radius_m2: 0.0 };
            for (j, b) in points[..i].iter().enumerate() {
                if circle.contains(b) {
                    continue;
                }
                circle = Self::through_two(a, b);
                for c in &points[..j] {
                    if !circle.contains(c) {
                        circle = Self::through_three(a, b, c);
                    }
                }
            }
        }
        circle
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_circle_of_a_right_triangle_spans_its_hypotenuse() {
        let points = [[0.0, 0.0], [6.0, 0.0], [0.0, 8.0], [3.0, 4.0]].map(Position::from);
        let circle = Circle::around(&points);
        assert_eq!((circle.centre, circle.radius_m2), (Position::new(3.0, 4.0), 25.0));
    }

    #[test]
    fn collinear_and_coincident_points_have_a_circle() {
        let circle = Circle::around(&[[0.0, 0.0], [4.0, 0.0], [10.0, 0.0], [10.0, 0.0]].map(Position::from));
        assert_eq!((circle.centre, circle.radius_m2), (Position::new(5.0, 0.0), 25.0));
        assert_eq!(Circle::around(&[Position::new(1.0, 2.0); 3]).radius_m2, 0.0);
    }

    #[test]
    fn the_circle_of_collinear_points_spans_the_outer_two() {
        let points = [[0.0, 0.0], [4.0, 4.0], [1.0, 1.0]].map(Position::from);
        for [a, b, c] in [[0, 1, 2], [1, 2, 0], [2, 0, 1]] {
            let circle = Circle::through_three(&points[a], &points[b], &points[c]);
            assert_eq!((circle.centre, circle.radius_m2), (Position::new(2.0, 2.0), 8.0));
        }
    }

    proptest! {
        /// The smallest circle is one through two or three of the points.
        #[test]
        fn the_circle_is_the_smallest_of_all_through_two_or_three(
            coordinates in prop::collection::vec((0.0..20.0, 0.0..20.0), 2..9),
        ) {
            let points: Vec<Position> = coordinates.into_iter().map(|(x_m, y_m)| Position::new(x_m, y_m)).collect();
            let circle = Circle::around(&points);
            let contains_all = |circle: &Circle| {
                points.iter().all(|point| distance_squared(point, &circle.centre) <= circle.radius_m2 * (1.0 + 1e-9))
            };
            prop_assert!(contains_all(&circle));
            for (i, a) in points.iter().enumerate() {
                for (j, b) in points[..i].iter().enumerate() {
                    let mut others = vec![Circle::through_two(a, b)];
                    others.extend(points[..j].iter().map(|c| Circle::through_three(a, b, c)));
                    for other in others.iter().filter(|other| contains_all(other)) {
                        prop_assert!(circle.radius_m2 <= other.radius_m2 * (1.0 + 1e-9));
                    }
                }
            }
        }
    }
}
