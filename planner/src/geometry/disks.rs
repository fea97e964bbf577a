//! The projection of a point onto an intersection of disks, exactly.
//!
//! The nearest point is the target itself, or the target's projection on one disk, or a crossing of two circles.

use skysink_common::geometry::{Position, distance_squared, within};

/// A closed disk.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Disk {
    /// Its centre.
    pub centre: Position,
    /// Its radius [m], not negative.
    pub radius_m: f64,
}

impl Disk {
    /// Whether the disk contains `point`, with the slack of decision D5.
    pub fn contains(&self, point: &Position) -> bool {
        within(point, &self.centre, self.radius_m)
    }

    /// The point of the rim in the direction of `target`.
    fn rim_toward(&self, target: &Position) -> Position {
        let from_centre = target - self.centre;
        self.centre + from_centre * (self.radius_m / from_centre.norm())
    }

    /// Whether the disk contains `point`, without slack.
    fn contains_strictly(&self, point: &Position) -> bool {
        distance_squared(point, &self.centre) <= self.radius_m * self.radius_m
    }
}

/// Slack of the number of slots to a disk, relative to the reach of one slot; far below that of decision D5.
const SLOT_SLACK: f64 = 1e-11;

/// Slots to fly from `from` into `disk` at `reach_m` [m] per slot, at least 1.
#[inline]
#[must_use]
pub fn slots_between(from: &Position, disk: &Disk, reach_m: f64) -> f64 {
    let away_m = distance_squared(from, &disk.centre).sqrt() - disk.radius_m;
    (away_m / reach_m - SLOT_SLACK).ceil().max(1.0)
}

/// Straight, at full speed, from `position` toward `goal`, as far as one slot reaches, `reach_m` [m], stopping on it if
/// it is nearer.
#[must_use]
pub fn toward(reach_m: f64, position: &Position, goal: &Position) -> Position {
    if within(goal, position, reach_m) {
        return *goal;
    }
    position + (goal - position).normalize() * reach_m
}

/// The point of all `disks` that is nearest to `target`; `None` if they have no point in common (decision D5).
#[must_use]
pub fn project(target: &Position, disks: &[Disk]) -> Option<Position> {
    let outside = || disks.iter().filter(|disk| !disk.contains(target));
    let pairs = || disks.iter().enumerate().flat_map(|(index, a)| disks[..index].iter().map(move |b| (a, b)));
    nearest_in_all(target, disks, [*target])
        .or_else(|| nearest_in_all(target, disks, outside().map(|disk| disk.rim_toward(target))))
        .or_else(|| nearest_in_all(target, disks, pairs().flat_map(|(a, b)| crossings(a, b))))
}

/// The candidate in all `disks` that is nearest to `target`; the first of equals.
#[inline]
fn nearest_in_all(
    target: &Position,
    disks: &[Disk],
    candidates: impl IntoIterator<Item = Position>,
) -> Option<Position> {
    let mut best: Option<(f64, Position)> = None;
    for candidate in candidates {
        let away_m2 = distance_squared(&candidate, target);
        let is_nearer = best.is_none_or(|(best_m2, _)| away_m2 < best_m2);
        if is_nearer && disks.iter().all(|disk| disk.contains(&candidate)) {
            best = Some((away_m2, candidate));
        }
    }
    best.map(|(_, point)| point)
}

/// The point of both disks that is nearest to `target`, without the slack of decision D5; a point between them if they
/// miss each other by rounding.
///
/// The look-ahead flies through this point. [`project`], which accepts points within the slack, would change some
/// flights.
#[must_use]
pub fn nearest_in_both(target: &Position, reach: &Disk, range: &Disk) -> Position {
    if range.contains_strictly(target) && reach.contains_strictly(target) {
        return *target;
    }
    for (disk, other) in [(range, reach), (reach, range)] {
        if !disk.contains_strictly(target) {
            let point = disk.rim_toward(target);
            if other.contains_strictly(&point) {
                return point;
            }
        }
    }
    if reach.centre == range.centre {
        return range.rim_toward(target); // two equal disks, and rounding has put the rim point outside
    }
    let [a, b] = crossings(reach, range);
    if distance_squared(&a, target) <= distance_squared(&b, target) { a } else { b }
}

/// The intersections of the circles of `a` and `b`; twice the same point if they touch.
///
/// For circles that miss each other it returns the point between them that divides the gap by their radii, which is in
/// both within the slack of decision D5. If one circle lies inside the other, or they are concentric, the result is in
/// general on neither circle (or NaN), and callers must test it against the disks.
pub(crate) fn crossings(a: &Disk, b: &Disk) -> [Position; 2] {
    let between = b.centre - a.centre;
    let apart_m = between.norm();
    let along = between / apart_m;
    if apart_m > a.radius_m + b.radius_m {
        let touching = a.centre + between * (a.radius_m / (a.radius_m + b.radius_m));
        return [touching; 2];
    }
    let foot_m = (apart_m + (a.radius_m - b.radius_m) * ((a.radius_m + b.radius_m) / apart_m)) / 2.0;
    let half_chord_m = ((a.radius_m - foot_m) * (a.radius_m + foot_m)).max(0.0).sqrt();
    let foot = a.centre + along * foot_m;
    let across = nalgebra::Vector2::new(-along.y, along.x) * half_chord_m;
    [foot + across, foot - across]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn disk(x_m: f64, y_m: f64, radius_m: f64) -> Disk {
        Disk { centre: Position::new(x_m, y_m), radius_m }
    }

    fn assert_nearest(target: [f64; 2], disks: &[Disk], expected: [f64; 2]) {
        let nearest = project(&target.into(), disks).expect("the disks have a point in common");
        assert!((nearest - Position::from(expected)).norm() < 1e-12, "{nearest}");
    }

    #[test]
    fn a_target_inside_all_disks_is_returned() {
        assert_nearest([1.0, 2.0], &[disk(0.0, 0.0, 10.0), disk(5.0, 0.0, 10.0)], [1.0, 2.0]);
    }

    #[test]
    fn one_disk_is_reached_along_the_line_to_its_centre() {
        assert_nearest([34.0, 43.0], &[disk(4.0, 3.0, 10.0)], [10.0, 11.0]); // (30, 40) has norm 50: (4, 3) + (6, 8)
    }

    #[test]
    fn a_lens_is_reached_at_its_corner() {
        let disks = [disk(-6.0, 0.0, 10.0), disk(6.0, 0.0, 10.0)]; // 6² + 8² = 10²
        assert_nearest([0.0, 30.0], &disks, [0.0, 8.0]);
        assert_nearest([1.0, -30.0], &disks, [0.0, -8.0]);
    }

    #[test]
    fn ties_of_distance_go_to_the_first_candidate() {
        let target = Position::origin();
        let candidates = [[6.0, 8.0], [3.0, 4.0], [-3.0, 4.0], [5.0, 0.0]].map(Position::from);
        assert_eq!(nearest_in_all(&target, &[disk(0.0, 0.0, 20.0)], candidates), Some(candidates[1]));
    }

    #[test]
    fn internally_tangent_circles_cross_at_the_tangent_point() {
        for step in 1..2_000 {
            let radius_m = f64::from(step) * 0.01;
            let inner_m = radius_m / 3.0;
            let apart_m = radius_m - inner_m;
            let outer = disk(0.1, 0.2, radius_m);
            let inner = disk(0.1 + apart_m * 0.6, 0.2 + apart_m * 0.8, inner_m);
            for crossing in crossings(&outer, &inner).into_iter().chain(crossings(&inner, &outer)) {
                let touching = Position::new(0.1 + radius_m * 0.6, 0.2 + radius_m * 0.8);
                assert!((crossing - touching).norm() < 1e-5, "{radius_m}: {crossing}");
            }
        }
    }

    #[test]
    fn a_target_within_the_slack_of_a_disk_but_outside_is_pulled_into_it() {
        let range = disk(0.0, 0.0, 10.0);
        let nearest = nearest_in_both(&Position::new(10.0 + 5e-9, 0.0), &disk(9.0, 0.0, 5.0), &range);
        assert_eq!(nearest, Position::new(10.0, 0.0));
    }

    #[test]
    fn crossings_of_unequal_circles_match_the_closed_form() {
        // Radii 15 and 13 about (0, 0) and (14, 0): (9, ±12), for 9² + 12² = 15² and 5² + 12² = 13².
        assert_nearest([9.0, 40.0], &[disk(0.0, 0.0, 15.0), disk(14.0, 0.0, 13.0)], [9.0, 12.0]);
    }

    #[test]
    fn tangent_disks_intersect_in_one_point() {
        let far_apart_m = 20.0 * (1.0 + 0.9e-9); // within the slack of decision D5
        for apart_m in [20.0, 20.0 - 1e-14, far_apart_m] {
            let disks = [disk(0.0, 0.0, 10.0), disk(0.0, apart_m, 10.0), disk(0.0, 0.0, 10.0)];
            let nearest = project(&Position::new(3.0, 14.0), &disks).expect("the middle is in range of all");
            assert!((nearest - Position::new(0.0, 10.0)).norm() < 1e-6, "{nearest}");
        }
    }

    #[test]
    fn the_gap_between_disks_of_unequal_radii_is_divided_by_radius() {
        // Apart by 0.9e-9 of both radii: each is missed by 0.9e-9 of its own.
        let disks = [disk(0.0, 0.0, 10.0), disk(1_010.0 * (1.0 + 0.9e-9), 0.0, 1_000.0)];
        let nearest = project(&Position::new(10.0, 50.0), &disks).expect("decision D5 accepts a point between them");
        assert!((nearest - Position::new(10.0, 0.0)).norm() < 1e-6, "{nearest}");
    }

    #[test]
    fn four_circles_through_one_point_intersect_there() {
        let disks = [disk(0.1, 0.3, 10.0), disk(20.1, 0.3, 10.0), disk(10.1, 10.3, 10.0), disk(10.1, -9.7, 10.0)];
        let nearest = project(&Position::new(17.0, 5.0), &disks).expect("(10.1, 0.3) is in range of all");
        assert!((nearest - Position::new(10.1, 0.3)).norm() < 1e-6, "{nearest}");
    }

    #[test]
    fn disjoint_disks_have_no_nearest_point() {
        assert_eq!(project(&Position::origin(), &[disk(0.0, 0.0, 10.0), disk(20.001, 0.0, 10.0)]), None);
        let nested_but_one = [disk(0.0, 0.0, 30.0), disk(1.0, 0.0, 2.0), disk(-4.0, 0.0, 2.0)];
        assert_eq!(project(&Position::new(9.0, 9.0), &nested_but_one), None);
    }

    #[test]
    fn a_disk_inside_another_is_the_intersection() {
        let disks = [disk(0.0, 0.0, 30.0), disk(20.0, 0.0, 10.0), disk(20.0, 0.0, 10.0)]; // touching inside, twice
        assert_nearest([50.0, 0.0], &disks, [30.0, 0.0]);
        assert_nearest([20.0, 25.0], &disks, [20.0, 10.0]);
    }

    #[test]
    fn nan_has_no_nearest_point() {
        assert_eq!(project(&Position::new(f64::NAN, 0.0), &[disk(0.0, 0.0, 10.0)]), None);
    }

    /// Lattice points give touching, coincident and tangent circles, random ones the rest.
    fn positions() -> impl Strategy<Value = Position> {
        let coordinate = || prop_oneof![-15.0..15.0, (-3i32..=3).prop_map(|step| f64::from(step) * 5.0)];
        (coordinate(), coordinate()).prop_map(|(x_m, y_m)| Position::new(x_m, y_m))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(1_000))]

        #[test]
        fn no_point_of_a_fine_grid_is_nearer(
            target in positions(),
            disks in prop::collection::vec((positions(), 5.0f64..20.0), 1..6),
        ) {
            let disks: Vec<Disk> = disks.iter().map(|&(centre, radius_m)| Disk { centre, radius_m }).collect();
            let nearest = project(&target, &disks);
            let nearest_m2 = nearest.map_or(f64::INFINITY, |nearest| distance_squared(&nearest, &target));
            prop_assert!(nearest.is_none_or(|nearest| disks.iter().all(|disk| disk.contains(&nearest))));
            for column in -100..=100 {
                for row in -100..=100 {
                    let step = nalgebra::Vector2::new(f64::from(column), f64::from(row)) / 100.0;
                    let point = disks[0].centre + step * disks[0].radius_m;
                    let in_all = disks.iter().all(|disk| (point - disk.centre).norm() <= disk.radius_m);
                    prop_assert!(
                        !in_all || nearest.is_some() && distance_squared(&point, &target) >= nearest_m2 - 1e-9,
                        "{} is nearer than {:?}", point, nearest
                    );
                }
            }
        }
    }
    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]

        #[test]
        fn the_point_in_reach_and_range_is_the_nearest_to_the_target(
            centre in [0.0..100.0, 0.0..100.0], radius_m in 0.5..30.0, target in [0.0..100.0, 0.0..100.0], reach_m in 5.0..40.0,
        ) {
            let from = Position::new(50.0, 50.0);
            let centre = Position::from(centre);
            let target = Position::from(target);
            let range = Disk { centre, radius_m };
            let reach_m = reach_m * slots_between(&from, &range, reach_m);
            let waypoint = nearest_in_both(&target, &Disk { centre: from, radius_m: reach_m }, &range);
            let inside = |point: &Position, slack: f64| {
                distance_squared(point, &centre) <= (radius_m * slack).powi(2)
                    && distance_squared(point, &from) <= (reach_m * slack).powi(2)
            };
            prop_assert!(inside(&waypoint, 1.0 + 1e-10), "{}", waypoint);
            for column in 0..=100 {
                for row in 0..=100 {
                    let point = Position::new(f64::from(column), f64::from(row));
                    let nearer = (point - target).norm() < (waypoint - target).norm() - 1e-9;
                    prop_assert!(!nearer || !inside(&point, 1.0), "{} beats {}", point, waypoint);
                }
            }
        }
    }

    #[test]
    fn the_nearest_point_in_one_disk_twice_is_on_its_rim() {
        let both = disk(30.0, 40.0, 10.0);
        for degrees in 0..360 {
            let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
            let target = Position::new(30.0 + 57.0 * cos, 40.0 + 57.0 * sin);
            let rim = Position::new(30.0 + 10.0 * cos, 40.0 + 10.0 * sin);
            assert!((nearest_in_both(&target, &both, &both) - rim).norm() < 1e-12, "{degrees} degrees");
        }
    }

    #[test]
    fn the_slots_to_a_disk_are_rounded_up() {
        assert_eq!(slots_between(&Position::origin(), &disk(70.0, 0.0, 10.0), 30.0), 2.0); // 60 m
        assert_eq!(slots_between(&Position::origin(), &disk(5.0, 0.0, 10.0), 30.0), 1.0);
    }
}
