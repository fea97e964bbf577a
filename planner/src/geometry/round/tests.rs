use std::time::Duration;

use proptest::prelude::*;

use super::*;

const STEPS: RoundEffort = RoundEffort::Steps(2_000);

fn positions(points_m: &[[f64; 2]]) -> Vec<Position> {
    points_m.iter().copied().map(Position::from).collect()
}

fn closed(centres: &[Position], radius_m: f64) -> Disks<'_> {
    Disks { centres, radius_m, start: None, is_closed: true }
}

/// The legs of a round.
fn legs(disks: &Disks, round: &DiskRound) -> Vec<[Position; 2]> {
    let points = &round.points;
    let count = if disks.is_closed || points.len() == 1 { points.len() } else { points.len() - 1 };
    (0..count).map(|leg| [points[leg], points[(leg + 1) % points.len()]]).collect()
}

/// What every round keeps.
fn check(disks: &Disks, round: &DiskRound) {
    let legs = legs(disks, round);
    let length_m: f64 = legs.iter().map(|[from, to]| (to - from).norm()).sum();
    assert!((length_m - round.length_m).abs() <= 1e-9 * (1.0 + length_m));
    let radius_m = disks.field().cover.radius_m;
    for centre in disks.centres {
        let touches = |[from, to]: &[Position; 2]| distance_to_leg_squared(centre, from, to) <= radius_m.powi(2);
        assert!(legs.iter().any(touches), "{centre} is not touched, radius {}, by {round:?}", disks.radius_m);
    }
    let first = usize::from(disks.start.is_some());
    assert!(disks.start.is_none_or(|start| round.points[0] == start));
    assert_eq!(round.points.len(), first + round.order.len());
    for (point, &disk) in round.points[first..].iter().zip(&round.order) {
        assert!((point - disks.centres[disk as usize]).norm() <= disks.radius_m);
    }
    let mut order = round.order.clone();
    order.sort_unstable();
    order.dedup();
    assert_eq!(order.len(), round.order.len(), "each disk has at most one point");
}

#[test]
fn a_round_far_from_the_origin_has_the_same_length() {
    let centres = |x_m: f64| positions(&[[x_m, 0.0], [x_m + 50.0, 0.0], [x_m + 50.0, 50.0], [x_m, 50.0]]);
    let length_m = |x_m: f64, radius_m: f64| closed(&centres(x_m), radius_m).round(STEPS, &Stop::default()).length_m;
    for radius_m in [10.0, 0.3, 1e-6, 0.0] {
        let near_m = length_m(0.0, radius_m);
        for far_m in [1e4, 1e6, 1e9] {
            assert!((length_m(far_m, radius_m) / near_m - 1.0).abs() < 1e-6, "{far_m} m, radius {radius_m} m");
        }
    }
}

#[test]
fn a_stopped_search_ends_at_once() {
    let stop = Stop::default();
    stop.flag().store(2, std::sync::atomic::Ordering::Relaxed);
    let centres: Vec<Position> =
        (0..3_000).map(|index| Position::new(f64::from(index), f64::from(index % 7))).collect();
    let begin = std::time::Instant::now();
    assert_eq!(closed(&centres, 0.1).round(STEPS, &stop).order.len(), 1, "it has only begun");
    assert!(begin.elapsed() < Duration::from_secs(1), "{:?}", begin.elapsed());
}

#[test]
fn four_corners_are_touched_on_their_diagonals() {
    // A convex problem with the symmetry of the square: 4 (a − √2 r).
    let centres = positions(&[[0.0, 0.0], [50.0, 0.0], [50.0, 50.0], [0.0, 50.0]]);
    let disks = closed(&centres, 10.0);
    let round = disks.round(STEPS, &Stop::default());
    check(&disks, &round);
    let expected_m = 4.0 * (50.0 - 10.0 * 2f64.sqrt());
    assert!((round.length_m / expected_m - 1.0).abs() < 1e-6, "{}", round.length_m);
}

#[test]
fn from_a_start_to_one_disk_is_straight() {
    let centres = positions(&[[40.0, 30.0]]);
    for (is_closed, expected_m) in [(true, 80.0), (false, 40.0)] {
        let disks = Disks { centres: &centres, radius_m: 10.0, start: Some(Position::origin()), is_closed };
        let round = disks.round(STEPS, &Stop::default());
        check(&disks, &round);
        assert!((round.length_m - expected_m).abs() < 1e-5);
    }
}

#[test]
fn disks_with_a_common_point_have_a_round_of_zero_length() {
    let centres = positions(&[[0.0, 0.0], [8.0, 0.0], [4.0, 7.0], [4.0, 2.0]]);
    for is_closed in [true, false] {
        let disks = Disks { centres: &centres, radius_m: 5.0, start: None, is_closed };
        let round = disks.round(STEPS, &Stop::default());
        check(&disks, &round);
        assert!(round.length_m < 1e-3, "{round:?}");
        let at_it = Disks { start: Some(Position::new(4.0, 2.5)), ..disks };
        assert_eq!(at_it.round(STEPS, &Stop::default()).length_m, 0.0);
    }
    let none = closed(&[], 5.0).round(STEPS, &Stop::default());
    assert_eq!(none, DiskRound::default());
}

#[test]
fn points_are_accepted_as_disks_of_zero_radius() {
    let centres = positions(&[[0.0, 0.0], [30.0, 40.0], [30.0, 0.0], [0.0, 40.0], [15.0, 0.0]]);
    let round = closed(&centres, 0.0).round(STEPS, &Stop::default());
    check(&closed(&centres, 0.0), &round);
    assert!((round.length_m - 140.0).abs() < 1e-9, "{round:?}");
}

/// The length of the shortest round over a few disks [m]: of all orders, each by the cone program.
fn shortest_m(disks: &Disks) -> f64 {
    let field = disks.field();
    let mut shortest_m = f64::INFINITY;
    let mut orders = vec![Vec::new()];
    let count = disks.centres.len() as u32;
    while let Some(order) = orders.pop() {
        if order.len() == disks.centres.len() {
            let points = cone::shortest(&field, &order).expect("a small program").points;
            let back = points[0] - points[points.len() - 1];
            let legs_m: f64 = points.windows(2).map(|leg| (leg[1] - leg[0]).norm()).sum();
            shortest_m = shortest_m.min(legs_m + if disks.is_closed { back.norm() } else { 0.0 });
            continue;
        }
        orders.extend((0..count).filter(|next| !order.contains(next)).map(|next| [&order[..], &[next]].concat()));
    }
    shortest_m
}

#[test]
fn the_shortest_order_is_found() {
    for seed in 0..30 {
        let mut random = Streams::new(seed).stream(Purpose::Position, 0, 0);
        let mut coordinate_m = || 100.0 * skysink_common::random::fraction(&mut random);
        let centres: Vec<Position> = (0..5).map(|_| Position::new(coordinate_m(), coordinate_m())).collect();
        let start = (seed % 3 > 0).then(|| Position::new(50.0, 50.0));
        let radius_m = [3.0, 12.0, 25.0][(seed / 3 % 3) as usize];
        let disks = Disks { centres: &centres, radius_m, start, is_closed: seed % 2 == 0 };
        let round = disks.round(STEPS, &Stop::default());
        check(&disks, &round);
        let shortest_m = shortest_m(&disks);
        assert!(round.length_m <= shortest_m * (1.0 + 1e-5) + 1e-4, "seed {seed}: {} > {shortest_m}", round.length_m);
    }
}

#[test]
fn equal_steps_give_equal_rounds_and_more_steps_no_longer_ones() {
    let mut random = Streams::new(1).stream(Purpose::Position, 0, 0);
    let mut coordinate_m = || 1_000.0 * skysink_common::random::fraction(&mut random);
    let centres: Vec<Position> = (0..100).map(|_| Position::new(coordinate_m(), coordinate_m())).collect();
    let disks = Disks { centres: &centres, radius_m: 20.0, start: Some(Position::new(500.0, 500.0)), is_closed: true };
    let [few, again, many] = [100, 100, 5_000].map(|steps| disks.round(RoundEffort::Steps(steps), &Stop::default()));
    assert_eq!(few, again);
    [&few, &many].into_iter().for_each(|round| check(&disks, round));
    assert!(many.length_m < few.length_m, "{} and {}", many.length_m, few.length_m);
    let timed = disks.round(RoundEffort::Time(Duration::from_millis(20)), &Stop::default());
    check(&disks, &timed);
    let stop = Stop::default();
    stop.flag().store(2, std::sync::atomic::Ordering::Relaxed);
    let stopped = disks.round(RoundEffort::Steps(u64::MAX), &stop);
    assert_eq!(stopped.points[0], disks.start.unwrap());
}

/// Lattice points give disks that touch, coincide, or lie on a line.
fn centres() -> impl Strategy<Value = Vec<Position>> {
    let coordinate = || prop_oneof![0.0..100.0f64, (0i32..=10).prop_map(|step| f64::from(step) * 10.0)];
    prop::collection::vec((coordinate(), coordinate()).prop_map(|(x_m, y_m)| Position::new(x_m, y_m)), 1..40)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn every_round_touches_all_disks(
        centres in centres(), radius_m in prop_oneof![Just(0.0), Just(5.0), Just(10.0), 0.1..60.0f64],
        has_start in any::<bool>(), is_closed in any::<bool>(),
    ) {
        let start = has_start.then(|| Position::new(20.0, 30.0));
        let disks = Disks { centres: &centres, radius_m, start, is_closed };
        let round = disks.round(RoundEffort::Steps(100), &Stop::default());
        check(&disks, &round);
        let better = disks.round(RoundEffort::Steps(400), &Stop::default());
        check(&disks, &better);
    }
}
