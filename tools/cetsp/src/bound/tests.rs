use proptest::prelude::*;
use skysink_common::random::{Purpose, Streams, fraction};
use skysink_common::stop::Stop;
use skysink_planner::geometry::round::{DiskRound, Disks};

use super::*;

const STEPS: RoundEffort = RoundEffort::Steps(2_000);

fn positions(points_m: &[[f64; 2]]) -> Vec<Position> {
    points_m.iter().copied().map(Position::from).collect()
}

fn round(disks: &Disks, effort: RoundEffort) -> DiskRound {
    disks.round(effort, &Stop::default())
}

/// The bound beside this round [m].
fn bound_beside_m(disks: &Disks, round: &DiskRound) -> f64 {
    bound_m(&disks.field(), round.length_m, RoundEffort::Steps(3_000))
}

#[test]
fn four_corners_are_touched_on_their_diagonals() {
    // A convex problem with the symmetry of the square: 4 (a − √2 r).
    let centres = positions(&[[0.0, 0.0], [50.0, 0.0], [50.0, 50.0], [0.0, 50.0]]);
    let disks = Disks { centres: &centres, radius_m: 10.0, start: None, is_closed: true };
    let expected_m = 4.0 * (50.0 - 10.0 * 2f64.sqrt());
    assert!((bound_beside_m(&disks, &round(&disks, STEPS)) / expected_m - 1.0).abs() < 1e-6);
}

#[test]
fn from_a_start_to_one_disk_is_straight() {
    let centres = positions(&[[40.0, 30.0]]);
    for (is_closed, expected_m) in [(true, 80.0), (false, 40.0)] {
        let disks = Disks { centres: &centres, radius_m: 10.0, start: Some(Position::origin()), is_closed };
        assert!((bound_beside_m(&disks, &round(&disks, STEPS)) - expected_m).abs() < 1e-4);
    }
}

#[test]
fn without_disks_the_bound_is_zero() {
    let disks = Disks { centres: &[], radius_m: 5.0, start: None, is_closed: true };
    assert_eq!(bound_m(&disks.field(), 0.0, STEPS), 0.0);
}

/// The length of the shortest round over a few disks [m]: of all orders, each by the cone program.
fn shortest_m(disks: &Disks) -> f64 {
    let field = disks.field();
    let mut shortest_m = f64::INFINITY;
    let mut orders = vec![Vec::new()];
    let count = disks.centres.len() as u32;
    while let Some(order) = orders.pop() {
        if order.len() == disks.centres.len() {
            let points = shortest(&field, &order).expect("a small program").points;
            shortest_m = shortest_m.min(length_m(&field, &points));
            continue;
        }
        orders.extend((0..count).filter(|next| !order.contains(next)).map(|next| [&order[..], &[next]].concat()));
    }
    shortest_m
}

#[test]
fn the_shortest_order_is_proven() {
    for seed in 0..30 {
        let mut random = Streams::new(seed).stream(Purpose::Position, 0, 0);
        let mut coordinate_m = || 100.0 * fraction(&mut random);
        let centres: Vec<Position> = (0..5).map(|_| Position::new(coordinate_m(), coordinate_m())).collect();
        let start = (seed % 3 > 0).then(|| Position::new(50.0, 50.0));
        let radius_m = [3.0, 12.0, 25.0][(seed / 3 % 3) as usize];
        let disks = Disks { centres: &centres, radius_m, start, is_closed: seed % 2 == 0 };
        let bound_m = bound_beside_m(&disks, &round(&disks, STEPS));
        let shortest_m = shortest_m(&disks);
        assert!(bound_m <= shortest_m + 1e-9, "seed {seed}: {bound_m} > {shortest_m}");
        assert!(bound_m >= shortest_m * (1.0 - 1e-4) - 1e-3, "seed {seed}: {bound_m} < {shortest_m}");
    }
}

#[test]
fn the_bound_on_a_hundred_disks_is_near_their_round() {
    let mut random = Streams::new(1).stream(Purpose::Position, 0, 0);
    let mut coordinate_m = || 1_000.0 * fraction(&mut random);
    let centres: Vec<Position> = (0..100).map(|_| Position::new(coordinate_m(), coordinate_m())).collect();
    let disks = Disks { centres: &centres, radius_m: 20.0, start: Some(Position::new(500.0, 500.0)), is_closed: true };
    let round = round(&disks, RoundEffort::Steps(5_000));
    let bound_m = bound_beside_m(&disks, &round);
    assert!((0.6..1.0).contains(&(bound_m / round.length_m)), "{bound_m}");
}

/// Lattice points give disks that touch, coincide, or lie on a line.
fn centres() -> impl Strategy<Value = Vec<Position>> {
    let coordinate = || prop_oneof![0.0..100.0f64, (0i32..=10).prop_map(|step| f64::from(step) * 10.0)];
    prop::collection::vec((coordinate(), coordinate()).prop_map(|(x_m, y_m)| Position::new(x_m, y_m)), 1..40)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn no_round_is_shorter_than_its_bound(
        centres in centres(), radius_m in prop_oneof![Just(0.0), Just(5.0), Just(10.0), 0.1..60.0f64],
        has_start in any::<bool>(), is_closed in any::<bool>(),
    ) {
        let start = has_start.then(|| Position::new(20.0, 30.0));
        let disks = Disks { centres: &centres, radius_m, start, is_closed };
        let [found, better] = [100, 400].map(|steps| round(&disks, RoundEffort::Steps(steps)));
        let bound_m = bound_m(&disks.field(), found.length_m, RoundEffort::Steps(100));
        prop_assert!(bound_m <= better.length_m * (1.0 + 1e-9) + 1e-9, "{} > {}", bound_m, better.length_m);
    }
}
