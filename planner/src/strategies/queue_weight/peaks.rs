//! The waypoints at which queue-weighted service less a price for energy may be largest.
//!
//! *Where links empty the queues* of a set of sensor nodes (SNs), its service is the same at all points in range of the
//! set, and the objective depends on the distance flown alone. The propulsion power falls up to the distance of least
//! power and rises beyond it ([`least_power_mps`]). The points in reach, in the area and in range of the set are
//! convex. If they meet the circle of least power about the UAV, the best of them is on it, and [`visit`] has one: an
//! arc of them ends where the circle crosses a circle of range or a border of the area, and otherwise holds the whole
//! circle. If they are all beyond it, the nearest of them to the UAV is best, which one SN or two determine. If they
//! are all within it, the farthest is best: the far end of a range, or a corner between two ranges and borders.
//!
//! *Where a link does not empty a queue*, the service also grows toward the SN, and these points are where [`climb`]
//! starts, with the points in range of one SN that are nearest to another. There may be a better peak, by less than 0.1
//! % in the tests.
//!
//! [`least_power_mps`]: skysink_common::propulsion::least_power_mps

use arrayvec::ArrayVec;
use nalgebra::{Point3, Vector2, Vector3};
use skysink_common::geometry::{Position, above, within};

use crate::geometry::disks::{Disk, crossings, project, toward};
use crate::mission_table::MissionTable;
use crate::strategy::View;

/// Starts that are followed.
const FOLLOWED: usize = 6;

/// Starts nearer to each other than this [m] count as one.
const APART_M: f64 = 1.0;

/// Relative rise that counts as none: the objective at two points of equal value differs by rounding.
const VALUE_SLACK: f64 = 1e-12;

/// First and last step [m] of a search.
const STEPS_M: [f64; 2] = [4.0, 1e-3];

/// Most steps of a search, more than any over a reach of some hundred metres takes. Over a far longer one, the
/// objective may rise all the way.
const MAX_STEPS: u32 = 500;

/// Horizontal directions of a step.
const DIRECTIONS: u32 = 8;

/// Turn of the directions from step to step [rad], the golden angle: along the edge of a range only few directions
/// rise.
const TURN: f64 = 2.399_963_229_728_653;

/// Directions without an SN to fly toward or past.
const COMPASS: [[f64; 2]; 4] = [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]];

/// A point with its objective [bit²].
pub(super) type Valued = (f64, Point3<f64>);

/// The best few points, best first; of equals the first offered.
#[derive(Debug, Default)]
pub(super) struct Best(ArrayVec<Valued, FOLLOWED>);

impl Best {
    pub(super) fn offer(&mut self, (value, point): Valued) {
        if let Some(near) = self.0.iter().position(|(_, other)| (point - other).norm() < APART_M) {
            if !is_above(value, self.0[near].0) {
                return;
            }
            self.0.remove(near);
        }
        let rank = self.0.iter().position(|(other, _)| is_above(value, *other)).unwrap_or(self.0.len());
        if rank < FOLLOWED {
            self.0.truncate(FOLLOWED - 1);
            self.0.insert(rank, (value, point));
        }
    }

    /// The first; `None` if nothing was offered.
    pub(super) fn first(&self) -> Option<Valued> {
        self.0.first().copied()
    }

    /// The best end of the searches from all of them.
    pub(super) fn climbed(&self, view: &View, mut value_at: impl FnMut(&Point3<f64>) -> f64) -> Option<Valued> {
        let ends = self.0.iter().map(|start| climb(view, *start, &mut value_at));
        ends.reduce(|best, end| if is_above(end.0, best.0) { end } else { best })
    }
}

/// Whether `value` is above `other` by more than rounding.
fn is_above(value: f64, other: f64) -> bool {
    value > other + VALUE_SLACK * other.abs()
}

/// Visits the points of the module's first list for the SNs `ids` and the distance of least power `slow_m` [m], those
/// on the way to an SN first; also points out of reach.
pub(super) fn visit(view: &View, slow_m: f64, ids: &[u32], mut visit: impl FnMut(Position)) {
    let MissionTable { sensors, limits, .. } = view.table;
    let ground = view.ground();
    let slow = Disk { centre: ground, radius_m: slow_m };
    let reach = Disk { centre: ground, radius_m: limits.reach_m };
    for &id in ids {
        visit(toward(slow_m, &ground, sensors.position(id)));
    }
    visit(ground);
    for [x, y] in COMPASS {
        visit(Position::new(ground.x + slow_m * x, ground.y + slow_m * y));
        visit(Position::new((1.0 + x + y) / 2.0 * limits.width_m, (1.0 + x - y) / 2.0 * limits.height_m)); // corners
    }
    visit_borders(view.table, &slow, &mut visit);
    for (index, &id) in ids.iter().enumerate() {
        let range = Disk { centre: *sensors.position(id), radius_m: limits.comm_radius_m };
        visit(view.table.motion.toward(&ground, &range.centre));
        project(&ground, &[reach, range]).into_iter().for_each(&mut visit);
        match (range.centre - ground).try_normalize(0.0) {
            Some(direction) => visit(range.centre + direction * range.radius_m),
            None => COMPASS.iter().for_each(|direction| visit(ground + Vector2::from(*direction) * range.radius_m)),
        }
        crossings(&slow, &range).into_iter().for_each(&mut visit);
        visit_borders(view.table, &range, &mut visit);
        for other in ids[..index].iter().map(|&other| sensors.position(other)) {
            if within(other, &range.centre, 2.0 * range.radius_m) {
                let beside = Disk { centre: *other, ..range };
                crossings(&range, &beside).into_iter().for_each(&mut visit);
                for (sensor, other) in [(range.centre, beside), (*other, range)] {
                    project(&sensor, &[reach, other]).into_iter().for_each(&mut visit);
                }
            }
        }
    }
}

/// Visits the points where the circle about `disk` crosses the borders of the area; NaN where it does not.
fn visit_borders(table: &MissionTable, disk: &Disk, visit: &mut impl FnMut(Position)) {
    let Disk { centre, radius_m } = *disk;
    let half_chord_m = |away_m: f64| ((radius_m - away_m) * (radius_m + away_m)).sqrt();
    for sign in [-1.0, 1.0] {
        for x_m in [0.0, table.limits.width_m] {
            visit(Position::new(x_m, centre.y + sign * half_chord_m(x_m - centre.x)));
        }
        for y_m in [0.0, table.limits.height_m] {
            visit(Position::new(centre.x + sign * half_chord_m(y_m - centre.y), y_m));
        }
    }
}

/// Pattern search (R. Hooke, T. A. Jeeves, "Direct Search Solution of Numerical and Statistical Problems", Journal of
/// the ACM 8(2), 1961) with turning directions: the objective has edges where SNs come into range.
fn climb(view: &View, start: Valued, value_at: &mut impl FnMut(&Point3<f64>) -> f64) -> Valued {
    let mut best = start;
    let [mut step_m, settled_m] = STEPS_M;
    let mut turn: f64 = 0.0;
    for _ in 0..MAX_STEPS {
        if step_m <= settled_m {
            break;
        }
        let around = (0..DIRECTIONS).map(|direction| {
            let (sin, cos) = (turn + std::f64::consts::TAU * f64::from(direction) / f64::from(DIRECTIONS)).sin_cos();
            Vector3::new(cos, sin, 0.0)
        });
        let is_climbing = view.table.limits.climb_m > 0.0;
        let vertical = [Vector3::z(), -Vector3::z()].into_iter().filter(|_| is_climbing);
        let from = best;
        for direction in around.chain(vertical) {
            let point = feasible(view, &(from.1 + direction * step_m));
            let value = value_at(&point);
            if is_above(value, best.0) {
                best = (value, point);
            }
        }
        turn += TURN;
        if best.0 == from.0 {
            step_m /= 2.0;
        }
    }
    best
}

/// A point in reach, in the area and between the altitudes of one slot: `target`, moved as far as needed.
fn feasible(view: &View, target: &Point3<f64>) -> Point3<f64> {
    let limits = &view.table.limits;
    let from = view.ground();
    let ground = toward(limits.reach_m, &from, &view.table.clamp_to_area(&target.xy()));
    let ground = view.table.airspace.last_free(&from, &ground, [limits.min_altitude_m; 2]);
    let low_m = limits.min_altitude_m.max(view.position.z - limits.climb_m);
    let high_m = limits.max_altitude_m.min(view.position.z + limits.climb_m);
    above(&ground, if limits.climb_m > 0.0 { target.z.max(low_m).min(high_m) } else { view.position.z })
}

#[cfg(test)]
mod tests {
    use super::super::{QueueWeight, QueueWeightObjective, Service};
    use super::*;
    use crate::strategy::tests::{field, view};
    use crate::strategy::{OwnedSetup, Strategy};
    use proptest::prelude::{Strategy as Generator, *};
    use skysink_common::channel::Channel;

    /// Spacing of the grid [m].
    const GRID_M: f64 = 0.5;

    /// The largest objective at the points of a grid over what is in reach, and the scale of its terms [bit²].
    fn best_on_the_grid(objective: &mut QueueWeightObjective, view: &View) -> (f64, f64) {
        let limits = view.table.limits;
        let steps = |length_m: f64| 0..=(length_m / GRID_M) as u32;
        let points = steps(limits.width_m).flat_map(|i| steps(limits.height_m).map(move |j| [i, j].map(f64::from)));
        let points = points.map(|[i, j]| Position::new(i * GRID_M, j * GRID_M));
        let mut best = (f64::NEG_INFINITY, 1.0);
        for ground in points.filter(|ground| (ground - view.ground()).norm() <= limits.reach_m) {
            let point = above(&ground, view.position.z);
            let value = objective.best_value(view, &point);
            if value > best.0 {
                best = (value, value.abs() + 2.0 * objective.price_bits2_per_j * objective.energy_j(view, &point));
            }
        }
        best
    }

    fn fields() -> impl Generator<Value = (OwnedSetup, Vec<u32>, [f64; 2], f64)> {
        let sensors = prop::collection::vec(([10.0..90.0, 10.0..90.0], 0u32..9_000), 1..10);
        let uav = prop_oneof![Just(None), [0.0..100.0, 0.0..100.0].prop_map(Some), Just(Some([0.0, 100.0]))];
        (sensors, 1usize..5, 1.0..9.0, uav, prop_oneof![Just(5e6), Just(4e3)]).prop_map(
            |(sensors, blocks, price_log, uav, bandwidth_hz)| {
                let (positions, queues_bits): (Vec<[f64; 2]>, Vec<u32>) = sensors.into_iter().unzip();
                let mut field = field(positions.into_iter().map(|position_m| (position_m, 100.0, 30_000)));
                let Channel::FreeSpace(model) = &mut field.table.channel else { panic!("free space") };
                model.bandwidth_hz = bandwidth_hz;
                field.table.limits.resource_blocks = blocks as u32;
                field.scenario.link.resource_blocks = blocks;
                let above_the_first: [f64; 2] = field.table.sensors.positions[0].into();
                (field, queues_bits, uav.unwrap_or(above_the_first), 10f64.powf(price_log))
            },
        )
    }

    proptest! {
        #[test]
        fn no_point_of_a_fine_grid_is_better((field, queues_bits, uav, price) in fields()) {
            let view = view(&field.table, 1, uav, &queues_bits);
            for (price, service) in [(price, Service::Upload), (0.0, Service::Capacity)] {
                let mut strategy = QueueWeight::new(&field.setup(), price, service);
                let Some(decision) = strategy.plan(&view) else { return Ok(()) };
                prop_assert!((decision.waypoint.xy() - view.ground()).norm() <= 30.0 * (1.0 + 1e-9));
                let own = strategy.objective.value_of(&view, &decision.waypoint, &decision.schedule);
                let ids: Vec<u32> = view.table.sensors.ids().collect();
                let tolerance = if strategy.objective.is_level(&view, &ids) { 1e-9 } else { 1e-3 };
                let (best, scale) = best_on_the_grid(&mut strategy.objective, &view);
                prop_assert!(own >= best - tolerance * scale, "{own} at {decision:?}, but {best} on the grid");
            }
        }
    }
}
