//! `rfs`: the random flight strategy, a baseline of the UTS letter (arXiv 2103.00753).
//!
//! The waypoint is uniform on the points in reach within the area; the n fullest queues in range of it are served.

use rand::RngExt;
use skysink_common::geometry::{Position, within};
use skysink_common::interpolation::interpolate;
use skysink_common::random::{Purpose, Streams};

use crate::mission_table::MissionTable;
use crate::serving::Serving;
use crate::strategy::{Registered, rule};

/// The strategy in the registry.
pub const STRATEGY: Registered = Registered::new("rfs", "random flight; serves the fullest queues in range", |setup| {
    let streams = Streams::new(setup.scenario.seed);
    let mut serving = Serving::new(setup);
    rule(move |view| {
        let waypoint = random_waypoint(view.table, &streams, view.slot, &view.ground());
        Some(serving.serve_fullest(view, &waypoint))
    })
});

/// Most draws of a random waypoint, after which the UAV holds its position.
///
/// At least a fraction of π/4 of the drawn points is in reach, unless the position is outside the area or NaN.
/// flight-sim reports no such position; the limit only guarantees termination.
const MAX_DRAWS: u32 = 1_000;

/// Random flight: uniform on the disk of radius `V τ` about the UAV, intersected with the closed area, by rejection.
fn random_waypoint(table: &MissionTable, streams: &Streams, slot: u64, position: &Position) -> Position {
    let mut stream = streams.stream(Purpose::RandomFlight, slot, 0);
    let bounds_m = |at_m: f64, extent_m: f64| {
        ((at_m - table.limits.reach_m).max(0.0), (at_m + table.limits.reach_m).min(extent_m))
    };
    let (west_m, east_m) = bounds_m(position.x, table.limits.area().width_m());
    let (south_m, north_m) = bounds_m(position.y, table.limits.area().height_m());
    for _ in 0..MAX_DRAWS {
        let [fraction_x, fraction_y] = stream.random::<[f64; 2]>();
        let drawn = Position::new(interpolate(west_m, east_m, fraction_x), interpolate(south_m, north_m, fraction_y));
        if within(&drawn, position, table.limits.reach_m) {
            return drawn;
        }
    }
    *position
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mission_table::tests::table_of;

    #[test]
    fn random_waypoints_stay_in_reach_and_in_the_area() {
        let table = table_of(&[[50.0, 50.0]]);
        for (seed, corner) in (0..).zip([[0.0, 0.0], [100.0, 0.0], [97.0, 88.0], [50.0, 50.0]]) {
            let position = Position::from(corner);
            for slot in 1..=500 {
                let waypoint = random_waypoint(&table, &Streams::new(seed), slot, &position);
                assert!(within(&waypoint, &position, table.limits.reach_m), "seed {seed}, slot {slot}: {waypoint}");
                assert!(table.limits.area().contains(&waypoint, 0.0), "seed {seed}, slot {slot}: {waypoint}");
            }
        }
    }

    #[test]
    fn random_waypoints_are_uniform_over_the_disk() {
        let table = table_of(&[[50.0, 50.0]]);
        let position = Position::new(50.0, 50.0);
        let mut sum = nalgebra::Vector2::zeros();
        let mut sum_m2 = 0.0;
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
    fn a_random_waypoint_from_nan_terminates() {
        let table = table_of(&[[50.0, 50.0]]);
        let waypoint = |x_m| random_waypoint(&table, &Streams::new(1), 1, &Position::new(x_m, 50.0));
        assert!(waypoint(f64::NAN).x.is_nan());
        assert_eq!(waypoint(500.0), Position::new(500.0, 50.0));
    }

    /// A golden draw: missions flown with `rfs` depend on it.
    #[test]
    fn random_flight_is_stable() {
        let table = table_of(&[[50.0, 50.0]]);
        let waypoints = [1, 2].map(|slot| random_waypoint(&table, &Streams::new(1), slot, &Position::new(50.0, 50.0)));
        assert_eq!(
            waypoints,
            [[62.22547328363256, 46.235563928894265], [66.48446199110184, 34.41681694902436]].map(Position::from)
        );
    }
}
