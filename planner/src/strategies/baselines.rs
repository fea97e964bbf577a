//! The rules that need no search: the baselines' waypoints, transit, and serving the fullest queues in range.
//!
//! The letter's own strategy is in [`crate::strategies::algorithm_1`] and [`crate::waypoint`].

use rand::RngExt;
use skysink_common::geometry::{Position, distance_squared, within};
use skysink_common::random::{Purpose, Streams};
use skysink_common::wide::{BLOCK, wide};

use crate::sensor_table::SensorTable;
use crate::strategies::nearby::fullest_first;

/// Draws of a random waypoint before the UAV stays where it is.
///
/// Of the points drawn, at least a share of π/4 is in reach, unless the position is outside the area or not a number;
/// flight-sim reports no such position, but a planner that never answers would be worse than one that stays.
const MAX_DRAWS: u32 = 1_000;

/// Random flight: uniform on the disk of radius `V τ` about the UAV, intersected with the closed area, by rejection.
#[must_use]
pub fn random_waypoint(table: &SensorTable, streams: &Streams, slot: u64, position: &Position) -> Position {
    let mut stream = streams.stream(Purpose::RandomFlight, slot, 0);
    let bounds_m = |at_m: f64, extent_m: f64| ((at_m - table.reach_m).max(0.0), (at_m + table.reach_m).min(extent_m));
    let (west_m, east_m) = bounds_m(position.x, table.area.width_m);
    let (south_m, north_m) = bounds_m(position.y, table.area.height_m);
    for _ in 0..MAX_DRAWS {
        let [share_x, share_y] = stream.random::<[f64; 2]>();
        let drawn = Position::new(west_m + (east_m - west_m) * share_x, south_m + (north_m - south_m) * share_y);
        if within(&drawn, position, table.reach_m) {
            return drawn;
        }
    }
    *position
}

/// Greedy flight: the SN with the largest queue within `V τ`, ties to the lowest index (decision D7); `None` if there
/// is none.
#[must_use]
pub fn greedy_waypoint(table: &SensorTable, position: &Position, queues_bits: &[u32]) -> Option<Position> {
    let mut fullest: Option<(u64, Position)> = None;
    table.grid.visit_within(position, table.reach_m, |node| {
        let key = fullest_first(queues_bits[node.id as usize], node.id);
        if fullest.is_none_or(|(least, _)| key < least) {
            fullest = Some((key, node.position));
        }
    });
    fullest.map(|(_, position)| position)
}

/// Transit (decision D8): straight, at full speed, toward the SN with the largest queue, stopping on it if it is
/// nearer.
///
/// Ties go to the nearest, then to the lowest index. This is the one rule that looks at the whole field, in slots of
/// transit only: it reads all N queues in order, and the positions of the fullest. At N = 10^6 that is about a tenth of a
/// millisecond, and one to two where all queues are equal.
#[must_use]
pub fn transit_waypoint(table: &SensorTable, position: &Position, queues_bits: &[u32]) -> Position {
    let most_bits = wide(|| most(queues_bits));
    let mut nearest: Option<(f64, &Position)> = None;
    for (queues_bits, positions) in queues_bits.chunks(BLOCK).zip(table.positions.chunks(BLOCK)) {
        if wide(|| holds(queues_bits, most_bits)) {
            for (_, goal) in queues_bits.iter().zip(positions).filter(|&(&queue_bits, _)| queue_bits == most_bits) {
                let away_m2 = distance_squared(goal, position);
                if nearest.is_none_or(|(nearest_m2, _)| away_m2.total_cmp(&nearest_m2).is_lt()) {
                    nearest = Some((away_m2, goal));
                }
            }
        }
    }
    let Some((_, goal)) = nearest else {
        return *position;
    };
    toward(table, position, goal)
}

/// Straight, at full speed, from `position` toward `goal`, stopping on it if it is nearer.
#[must_use]
pub fn toward(table: &SensorTable, position: &Position, goal: &Position) -> Position {
    if within(goal, position, table.reach_m) {
        return *goal;
    }
    position + (goal - position).normalize() * table.reach_m
}

/// The largest queue [bit].
#[inline(always)]
fn most(queues_bits: &[u32]) -> u32 {
    queues_bits.iter().fold(0, |most, &queue_bits| most.max(queue_bits))
}

/// Whether one of the queues holds exactly `bits`.
#[inline(always)]
fn holds(queues_bits: &[u32], bits: u32) -> bool {
    queues_bits.iter().fold(false, |found, &queue_bits| found | (queue_bits == bits))
}

/// Fills `ids` with the n largest queues within `d_c` of `waypoint`, ascending by id; ties to the lowest index.
pub fn serve_fullest(table: &SensorTable, waypoint: &Position, queues_bits: &[u32], ids: &mut Vec<u32>) {
    ids.clear();
    table.grid.visit_within(waypoint, table.comm_radius_m, |node| ids.push(node.id));
    if ids.len() > table.resource_blocks {
        ids.select_nth_unstable_by_key(table.resource_blocks, |&id| fullest_first(queues_bits[id as usize], id));
        ids.truncate(table.resource_blocks);
    }
    ids.sort_unstable();
}

/// Fills `ids` with those of `first` that are within `d_c` of `waypoint`, then with the largest queues there, n in all,
/// ascending by id.
pub fn serve_first(table: &SensorTable, waypoint: &Position, first: &[u32], queues_bits: &[u32], ids: &mut Vec<u32>) {
    ids.clear();
    table.grid.visit_within(waypoint, table.comm_radius_m, |node| ids.push(node.id));
    ids.sort_unstable_by_key(|id| (!first.contains(id), fullest_first(queues_bits[*id as usize], *id)));
    ids.truncate(table.resource_blocks);
    ids.sort_unstable();
}

/// How far from `from` toward `to`, as a share of the way, one stays within `radius_m` [m] of `centre`; 0 if `from` is
/// not.
#[must_use]
pub fn share_within(from: &Position, to: &Position, centre: &Position, radius_m: f64) -> f64 {
    let (way, away) = (to - from, from - centre);
    let (a, b, c) = (way.norm_squared(), way.dot(&away), away.norm_squared() - radius_m * radius_m);
    if c > 0.0 {
        return 0.0;
    }
    // The larger root of a t² + 2 b t + c = 0, c ≤ 0.
    let root = (b * b - a * c).max(0.0).sqrt();
    let share = if b > 0.0 { -c / (b + root) } else { (root - b) / a };
    if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor_table::tests::table_of;

    #[test]
    fn random_waypoints_stay_in_reach_and_in_the_area() {
        let table = table_of(&[[50.0, 50.0]]);
        for (seed, corner) in (0..).zip([[0.0, 0.0], [100.0, 0.0], [97.0, 88.0], [50.0, 50.0]]) {
            let position = Position::from(corner);
            for slot in 1..=500 {
                let waypoint = random_waypoint(&table, &Streams::new(seed), slot, &position);
                assert!(within(&waypoint, &position, table.reach_m), "seed {seed}, slot {slot}: {waypoint}");
                assert!(table.area.contains(&waypoint, 0.0), "seed {seed}, slot {slot}: {waypoint}");
            }
        }
    }

    #[test]
    fn random_waypoints_spread_evenly_over_the_disk() {
        let table = table_of(&[[50.0, 50.0]]);
        let position = Position::new(50.0, 50.0);
        let (mut sum, mut sum_m2) = (nalgebra::Vector2::zeros(), 0.0);
        for slot in 1..=20_000 {
            let offset_m = random_waypoint(&table, &Streams::new(1), slot, &position) - position;
            sum += offset_m;
            sum_m2 += offset_m.norm_squared();
        }
        // Uniform on a disk of radius R: mean 0 with deviation R/2 per axis, mean squared radius R²/2 = 450 with
        // deviation R²/√12 = 260. Five standard errors of 20 000 draws: 5 · 15/141 = 0.53 m and 5 · 260/141 = 9.2 m².
        assert!((sum / 20_000.0).amax() < 0.53, "{sum}");
        assert!((sum_m2 / 20_000.0 - 450.0).abs() < 9.2, "{sum_m2}");
    }

    #[test]
    fn a_random_waypoint_from_nowhere_is_nowhere_instead_of_never() {
        let table = table_of(&[[50.0, 50.0]]);
        let waypoint = |x_m| random_waypoint(&table, &Streams::new(1), 1, &Position::new(x_m, 50.0));
        assert!(waypoint(f64::NAN).x.is_nan());
        assert_eq!(waypoint(500.0), Position::new(500.0, 50.0));
    }

    #[test]
    fn greedy_flight_takes_the_fullest_queue_in_reach_and_the_lowest_index_of_equals() {
        let table = table_of(&[[50.0, 81.0], [50.0, 80.0], [20.0, 50.0], [60.0, 50.0]]);
        let position = Position::new(50.0, 50.0);
        // SN 0 is 31 m away, out of reach; SNs 1 and 2 exactly 30 m.
        assert_eq!(greedy_waypoint(&table, &position, &[9, 7, 7, 6]), Some(table.positions[1]));
        assert_eq!(greedy_waypoint(&table, &position, &[9, 7, 8, 6]), Some(table.positions[2]));
        assert_eq!(greedy_waypoint(&table, &Position::new(50.0, 0.0), &[9, 7, 7, 6]), None);
    }

    #[test]
    fn transit_flies_straight_at_full_speed() {
        let table = table_of(&[[65.0, 85.0], [5.0, 6.0]]);
        // From (5, 5) to (65, 85) is (60, 80), 100 m: 30 m of it are (18, 24).
        let waypoint = transit_waypoint(&table, &Position::new(5.0, 5.0), &[8, 7]);
        assert!((waypoint - Position::new(23.0, 29.0)).norm() < 1e-12, "{waypoint}");
    }

    #[test]
    fn transit_stops_on_a_nearer_goal() {
        let table = table_of(&[[50.1, 79.9]]);
        assert_eq!(transit_waypoint(&table, &Position::new(50.1, 50.0), &[8]), table.positions[0]);
        assert_eq!(transit_waypoint(&table, &table.positions[0], &[8]), table.positions[0]);
    }

    #[test]
    fn transit_prefers_the_nearest_of_equals_and_then_the_lowest_index() {
        let table = table_of(&[[10.0, 50.0], [50.0, 71.0], [50.0, 30.0], [70.0, 50.0]]);
        let position = Position::new(50.0, 50.0);
        assert_eq!(transit_waypoint(&table, &position, &[5, 5, 5, 5]), table.positions[2]);
        assert_eq!(transit_waypoint(&table, &position, &[4, 5, 4, 4]), table.positions[1]);
    }

    #[test]
    fn the_fullest_queues_in_range_are_served_in_ascending_order() {
        let table = table_of(&[[50.0, 50.0], [51.0, 50.0], [60.0, 50.0], [60.1, 50.0], [52.0, 50.0], [53.0, 50.0]]);
        let mut ids = vec![77];
        // SN 3 is 10.1 m away. n = 4 of the rest: 9, 8, then the two lowest indices of the three that hold 3.
        serve_fullest(&table, &Position::new(50.0, 50.0), &[3, 3, 9, 99, 8, 3], &mut ids);
        assert_eq!(ids, [0, 1, 2, 4]);
        serve_fullest(&table, &Position::new(0.0, 0.0), &[3, 3, 9, 99, 8, 3], &mut ids);
        assert_eq!(ids, [0; 0]);
    }

    #[test]
    fn whom_a_plan_names_is_served_before_fuller_queues_if_in_range() {
        let table = table_of(&[[50.0, 50.0], [51.0, 50.0], [52.0, 50.0], [53.0, 50.0], [54.0, 50.0], [90.0, 90.0]]);
        let mut ids = Vec::new();
        serve_first(&table, &Position::new(50.0, 50.0), &[0, 5], &[1, 5, 6, 7, 8, 9], &mut ids);
        assert_eq!(ids, [0, 2, 3, 4]);
    }

    #[test]
    fn the_way_within_a_circle_ends_on_it() {
        let at = Position::new;
        // From 4 m west of the centre of a circle of 10 m eastward: 14 m of 28 m.
        let share = share_within(&at(46.0, 50.0), &at(74.0, 50.0), &at(50.0, 50.0), 10.0);
        assert!((share - 0.5).abs() < 1e-12, "{share}");
        let share = share_within(&at(54.0, 50.0), &at(26.0, 50.0), &at(50.0, 50.0), 10.0);
        assert!((share - 0.5).abs() < 1e-12, "{share}");
        assert_eq!(share_within(&at(46.0, 50.0), &at(48.0, 50.0), &at(50.0, 50.0), 10.0), 1.0, "never leaves it");
        assert_eq!(share_within(&at(30.0, 50.0), &at(50.0, 50.0), &at(50.0, 50.0), 10.0), 0.0, "starts outside");
        assert_eq!(share_within(&at(46.0, 50.0), &at(46.0, 50.0), &at(50.0, 50.0), 10.0), 0.0, "nowhere to go");
    }

    #[test]
    fn an_empty_queue_is_served_while_blocks_are_free() {
        let table = table_of(&[[50.0, 50.0], [51.0, 50.0]]);
        let mut ids = Vec::new();
        serve_fullest(&table, &Position::new(50.0, 50.0), &[0, 0], &mut ids);
        assert_eq!(ids, [0, 1]);
    }

    /// A golden draw: missions flown with `rfs` depend on it.
    #[test]
    fn random_flight_stays_what_it_is() {
        let table = table_of(&[[50.0, 50.0]]);
        let waypoints = [1, 2].map(|slot| random_waypoint(&table, &Streams::new(1), slot, &Position::new(50.0, 50.0)));
        assert_eq!(
            waypoints,
            [[62.22547328363256, 46.235563928894265], [66.48446199110184, 34.41681694902436]].map(Position::from)
        );
    }
}
