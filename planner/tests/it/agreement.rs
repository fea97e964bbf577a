//! The two searches of sP1 against programs that are as direct as they can be, on small fields.

use std::cmp::Reverse;

use proptest::prelude::*;
use skysink_common::geometry::Position;
use skysink_common::message::{Limits, NOBODY, SensorNode};
use skysink_common::sampling::Sampling;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::weights::Weights;
use skysink_planner::mission_table::MissionTable;
use skysink_planner::strategies::algorithm_1::{Reach, Search};
use skysink_planner::strategies::exact::ExactSearch;

/// A field, the UAV over it, and the queues [bit].
#[derive(Debug, Clone)]
struct Case {
    table: MissionTable,
    position: Position,
    queues_bits: Vec<u32>,
}

impl Case {
    fn queue(&self, id: u32) -> u64 {
        u64::from(self.queues_bits[id as usize])
    }

    fn sum(&self, ids: &[u32]) -> u64 {
        ids.iter().map(|&id| self.queue(id)).sum()
    }

    /// The SNs within `d_c` of `centre` but for `except`, fullest first, at most `count`.
    fn fullest_in_range(&self, centre: &Position, except: &[u32], count: usize) -> Vec<u32> {
        let in_range = |&id: &u32| close(self.table.sensors.position(id), centre, self.table.limits.comm_radius_m);
        let mut ids: Vec<u32> = self.table.sensors.ids().filter(|id| !except.contains(id)).filter(in_range).collect();
        ids.sort_by_key(|&id| (Reverse(self.queue(id)), id));
        ids.truncate(count);
        ids
    }

    /// The exact set.
    fn exact(&self) -> Vec<u32> {
        let mut ids = Vec::new();
        let centre = ExactSearch::new(&self.table).best_set(&self.table, &self.position, &self.queues_bits, &mut ids);
        assert_eq!(centre.is_none(), ids.is_empty());
        if let Some(centre) = centre {
            assert!(close(&centre, &self.position, self.table.limits.reach_m), "{centre} is out of reach");
            let in_range = |&id: &u32| close(self.table.sensors.position(id), &centre, self.table.limits.comm_radius_m);
            assert!(ids.iter().all(in_range), "{ids:?} from {centre}");
        }
        ids
    }
}

/// Decision D5.
fn close(a: &Position, b: &Position, limit_m: f64) -> bool {
    (a - b).norm() <= limit_m * (1.0 + 1e-9)
}

/// Coordinates [m], on a lattice of 5 m (touching and coincident SNs, SNs on circles) or anywhere.
fn coordinates(low: u32, high: u32) -> impl Strategy<Value = f64> {
    prop_oneof![f64::from(low)..f64::from(high), (low / 5..=high / 5).prop_map(|step| f64::from(step) * 5.0)]
}

/// The letter's range of 10 m and up to `most` SNs between `low` and `high` [m], with queues that often tie.
fn cases(most: usize, low: u32, high: u32, reaches_m: impl Strategy<Value = f64>) -> impl Strategy<Value = Case> {
    let queues = prop_oneof![0u32..3, 0u32..12, 0u32..30_000];
    let sensors = prop::collection::vec((coordinates(low, high), coordinates(low, high), queues), 1..=most);
    let place = (coordinates(low, high), coordinates(low, high));
    let blocks = prop_oneof![1u32..6, Just(64)];
    (sensors, place, reaches_m, blocks).prop_map(|(sensors, (x_m, y_m), reach_m, resource_blocks)| {
        let node = |&(x_m, y_m, _): &(f64, f64, u32)| SensorNode { x_m, y_m, gain: 1e-5, ..SensorNode::default() };
        let nodes: Vec<SensorNode> = sensors.iter().map(node).collect();
        let mut table = MissionTable::of(&Scenario::letter(Overrides::default()).unwrap(), &nodes);
        table.limits = Limits { reach_m, resource_blocks, ..table.limits };
        Case {
            table,
            position: Position::new(x_m, y_m),
            queues_bits: sensors.into_iter().map(|(.., queue_bits)| queue_bits).collect(),
        }
    })
}

/// Algorithm 1 once more: the best of all (sum, anchor, set), over all SNs.
fn algorithm_1(case: &Case, reach: Reach) -> Option<(u32, Vec<u32>)> {
    let table = &case.table;
    let d_c = case.table.limits.comm_radius_m;
    let n = case.table.limits.blocks();
    let limit_m = match reach {
        Reach::Letter if table.limits.reach_m > d_c => table.limits.reach_m - d_c,
        Reach::Letter => table.limits.reach_m,
        Reach::Wide => table.limits.reach_m + d_c,
    };
    let mut best: Option<(u64, u32, Vec<u32>)> = None;
    for i in table.sensors.ids().filter(|&i| close(table.sensors.position(i), &case.position, limit_m)) {
        let mut set = vec![i];
        let mut partners: Vec<u32> = table
            .sensors
            .ids()
            .filter(|&j| j != i && close(table.sensors.position(j), table.sensors.position(i), 2.0 * d_c))
            .collect();
        partners.sort_by_key(|&j| (Reverse(case.queue(j)), j));
        if let Some(&k) = partners.first().filter(|_| n >= 2) {
            let [xi, yi] = table.sensors.position(i).coords.into();
            let [xk, yk] = table.sensors.position(k).coords.into();
            let d = f64::hypot(xi - xk, yi - yk);
            let (ux, uy) = if d == 0.0 { (1.0, 0.0) } else { ((xi - xk) / d, (yi - yk) / d) };
            let mx = (xi + xk) / 2.0;
            let my = (yi + yk) / 2.0;
            let v = (d_c * d_c - d * d / 4.0).abs().sqrt();
            let mut centres = vec![
                [mx - v * uy, my + v * ux],
                [mx + v * uy, my - v * ux],
                [xk + d_c * ux, yk + d_c * uy],
                [xi - d_c * ux, yi - d_c * uy],
                [mx, my],
            ];
            centres.retain(|&centre| {
                reach == Reach::Letter || close(&centre.into(), &case.position, case.table.limits.reach_m)
            });
            let others = centres.iter().map(|&centre| case.fullest_in_range(&centre.into(), &[i, k], n - 2));
            let others: Vec<Vec<u32>> = others.collect();
            let most = others.iter().map(|others| case.sum(others)).max();
            if let Some(others) = others.into_iter().find(|others| Some(case.sum(others)) == most) {
                set.push(k);
                set.extend(others);
            }
        }
        let sum = case.sum(&set);
        set.sort_unstable();
        if best.as_ref().is_none_or(|(best, ..)| sum > *best) {
            best = Some((sum, i, set));
        }
    }
    best.map(|(_, anchor, set)| (anchor, set))
}

/// Whether one point within reach has all of `ids` in range.
///
/// By Helly's theorem, disks of the plane have a point in common if every three of them have. Three of one radius have
/// one if their centres fit into a circle of that radius; two and the disk of reach, if the lens of the two is in
/// reach.
fn coverable(case: &Case, ids: &[u32]) -> bool {
    let table = &case.table;
    let place = |index: usize| table.sensors.position(ids[index]);
    let alone = |index: usize| close(place(index), &case.position, table.limits.reach_m + table.limits.comm_radius_m);
    let pair = |a: usize, b: usize| lens_in_reach(case, place(a), place(b));
    let triple = |a: usize, b: usize, c: usize| enclosing_radius_m([place(a), place(b), place(c)]) <= radius_m(case);
    (0..ids.len()).all(|a| alone(a) && (0..a).all(|b| pair(a, b)) && (0..a).all(|b| (0..b).all(|c| triple(a, b, c))))
}

/// Radius [m] of the disks whose common points are looked for: `d_c` and half the slack of decision D5, as in the
/// search where two circles touch: there that slack moves their crossing by its root.
fn radius_m(case: &Case) -> f64 {
    case.table.limits.comm_radius_m * (1.0 + 0.5e-9)
}

/// Radius [m] of the smallest circle around three points: half the longest side, or the circumradius of an acute
/// triangle.
fn enclosing_radius_m([a, b, c]: [&Position; 3]) -> f64 {
    let mut sides_m = [(a - b).norm(), (b - c).norm(), (c - a).norm()];
    sides_m.sort_by(f64::total_cmp);
    let [short, middle, long] = sides_m;
    if long * long >= short * short + middle * middle {
        return long / 2.0;
    }
    let twice_area = (b - a).perp(&(c - a)).abs();
    short * middle * long / (2.0 * twice_area)
}

/// Whether the lens of the disks about `a` and `b` comes within reach.
fn lens_in_reach(case: &Case, a: &Position, b: &Position) -> bool {
    let d_c = radius_m(case);
    let apart_m = (a - b).norm();
    let uav = &case.position;
    if !close(a, b, 2.0 * case.table.limits.comm_radius_m) {
        return false;
    }
    let pulled = |centre: &Position| {
        let from_centre = uav - centre;
        centre + from_centre * (d_c / from_centre.norm()).min(1.0)
    };
    for (own, other) in [(a, b), (b, a)] {
        if close(&pulled(own), other, d_c) {
            return close(&pulled(own), uav, case.table.limits.reach_m);
        }
    }
    let across = nalgebra::Vector2::new(a.y - b.y, b.x - a.x) / apart_m;
    let offset = across * (d_c * d_c - apart_m * apart_m / 4.0).max(0.0).sqrt();
    let middle = nalgebra::center(a, b);
    close(&(middle + offset), uav, case.table.limits.reach_m)
        || close(&(middle - offset), uav, case.table.limits.reach_m)
}

/// sP1 by looking at every set of at most n SNs: the largest sum, then the smallest ids, free blocks above all.
fn best_of_all_sets(case: &Case) -> Vec<u32> {
    let sensors = case.queues_bits.len();
    let n = case.table.limits.blocks();
    let mut best = (Reverse(0), vec![NOBODY; sensors]);
    for members in 1u32..1 << sensors {
        let mut ids: Vec<u32> = (0..sensors as u32).filter(|id| members >> id & 1 == 1).collect();
        if ids.len() <= n && coverable(case, &ids) {
            let sum = Reverse(case.sum(&ids));
            ids.resize(sensors, NOBODY);
            best = best.min((sum, ids));
        }
    }
    let (_, mut ids) = best;
    ids.retain(|&id| id != NOBODY);
    ids
}

/// The largest sum of queues [bit] of n SNs in range of a point in reach, on a grid of `step_m` through the UAV.
fn best_on_grid(case: &Case, step_m: f64) -> u64 {
    let steps = (case.table.limits.reach_m / step_m) as i32;
    let offsets = move || (-steps..=steps).map(move |step| f64::from(step) * step_m);
    let centres = offsets().flat_map(|east_m| {
        offsets().map(move |north_m| Position::new(case.position.x + east_m, case.position.y + north_m))
    });
    let in_reach = centres.filter(|centre| close(centre, &case.position, case.table.limits.reach_m));
    let sum = |centre| case.sum(&case.fullest_in_range(&centre, &[], case.table.limits.blocks()));
    in_reach.map(sum).max().unwrap_or(0)
}

/// Reaches [m] above, at and below the range of 10 m.
fn reaches() -> impl Strategy<Value = f64> {
    prop_oneof![Just(30.0), Just(20.0), Just(10.0), Just(7.5), Just(5.0), 0.5..30.0]
}

/// Three SNs whose smallest circle is wider than `d_c` by 5e-13 m: the circles of the outer two touch in a point that
/// is 3e-6 m out of range of the third.
#[test]
fn three_sensor_nodes_on_a_circle_are_served_together_despite_rounding() {
    let places_m = [[60.0, 60.0], [50.008_016_800_160_94, 50.0], [40.0, 60.0]];
    let nodes = places_m.map(|[x_m, y_m]| SensorNode { x_m, y_m, gain: 1e-5, ..SensorNode::default() });
    let table = MissionTable::of(&Scenario::letter(Overrides::default()).unwrap(), &nodes);
    let position = Position::new(43.997_282_708_186_496, 40.0);
    let case = Case { table, position, queues_bits: vec![0; 3] };
    assert_eq!(case.exact(), [0, 1, 2]);
    assert_eq!(best_of_all_sets(&case), [0, 1, 2]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200 * crate::CASES_FACTOR))]

    #[test]
    fn algorithm_1_agrees_with_enumeration(case in cases(40, 10, 90, reaches())) {
        for reach in [Reach::Letter, Reach::Wide] {
            let mut ids = Vec::new();
            let found = Search::default().best_set(reach, &case.table, &case.position, &case.queues_bits, &mut ids);
            let found = found.map(|winner| (winner.anchor, ids));
            prop_assert_eq!(found, algorithm_1(&case, reach), "{:?}", reach);
        }
    }

    #[test]
    fn the_exact_search_agrees_with_enumeration(case in cases(10, 30, 70, reaches())) {
        prop_assert_eq!(case.exact(), best_of_all_sets(&case));
    }

    #[test]
    fn the_exact_search_agrees_with_enumeration_in_a_dense_field(case in cases(10, 40, 60, reaches())) {
        prop_assert_eq!(case.exact(), best_of_all_sets(&case));
    }
}

/// The largest weighted sum of queues of a set, by looking at every set of at most n SNs.
fn best_weighted_bits(case: &Case, weights: &[f64]) -> f64 {
    let count = case.queues_bits.len();
    let sets = (1u32..1 << count).map(|members| (0..count as u32).filter(|id| members >> id & 1 == 1).collect());
    let served = sets.filter(|ids: &Vec<u32>| ids.len() <= case.table.limits.blocks() && coverable(case, ids));
    served.map(|ids| weighted_bits(case, weights, &ids)).fold(0.0, f64::max)
}

fn weighted_bits(case: &Case, weights: &[f64], ids: &[u32]) -> f64 {
    ids.iter().map(|&id| weights[id as usize] * case.queue(id) as f64).sum()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100 * crate::CASES_FACTOR))]

    #[test]
    fn weighted_searches_agree_with_enumeration(
        case in cases(9, 30, 70, reaches()),
        logs in prop::collection::vec(-2.0f64..2.0, 9),
    ) {
        let drawn: Vec<f64> = logs.iter().take(case.queues_bits.len()).map(|&log| 10f64.powf(log)).collect();
        let sampling = Sampling::new(vec![1.0; drawn.len()], vec![30_000; drawn.len()]);
        let weights = Weights::new(drawn.clone(), &sampling);
        let mut room = Vec::new();
        let values = weights.values(&case.queues_bits, &mut room).to_vec();
        let valued = Case { queues_bits: values, ..case.clone() };
        let [best, found] = [best_weighted_bits(&case, &drawn), weighted_bits(&case, &drawn, &valued.exact())];
        prop_assert!((best - found).abs() <= 1e-6 * best, "{} of {}", found, best);
        let mut ids = Vec::new();
        let winner = Search::default().best_set(Reach::Wide, &case.table, &case.position, &valued.queues_bits, &mut ids);
        prop_assert_eq!(winner.map(|winner| (winner.anchor, ids)), algorithm_1(&valued, Reach::Wide));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40 * crate::CASES_FACTOR))]

    /// The grid cannot win. Nor can it miss a set that smaller disks would still have: from any of their common points
    /// the next of the grid is at most half a diagonal away.
    #[test]
    fn no_point_of_a_fine_grid_is_better_where_the_lens_is_not_narrow(case in cases(30, 20, 80, 1.0..25.0)) {
        let step_m = case.table.limits.comm_radius_m / 50.0;
        let half_diagonal_m = step_m * std::f64::consts::FRAC_1_SQRT_2;
        let on_grid = best_on_grid(&case, step_m);
        let mut smaller = case.clone();
        smaller.table.limits.comm_radius_m -= half_diagonal_m;
        smaller.table.limits.reach_m -= half_diagonal_m;
        prop_assert!(on_grid <= case.sum(&case.exact()), "{on_grid}");
        prop_assert!(on_grid >= case.sum(&smaller.exact()), "{on_grid}");
    }
}
