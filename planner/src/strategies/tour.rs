//! `tour`: a travelling salesman tour over all sensor nodes (SNs), flown repeatedly.
//!
//! The closed tour is that of [`closed_tour`]: nearest neighbour, then 2-opt and or-opt. The UAV flies from disk to
//! disk of radius `d_c` about the SNs, instead of over the SNs.

use skysink_common::geometry::Position;
use skysink_common::stop::Stop;

use super::turns::InTurn;
use crate::geometry::disks::{Disk, nearest_in_both, slots_between};
use crate::geometry::tour::closed_tour;
use crate::mission_table::MissionTable;
use crate::strategy::Registered;

/// The strategy in the registry.
pub const STRATEGY: Registered =
    Registered::new("tour", "a travelling salesman tour over all sensor nodes, flown repeatedly", |setup| {
        Box::new(InTurn::new(setup, order(setup.table, &setup.scenario.start().xy(), setup.stop), waypoint))
    })
    .with_state();

/// A closed tour that starts at the SN nearest to `start`.
fn order(table: &MissionTable, start: &Position, stop: &Stop) -> Vec<u32> {
    let mut order = closed_tour(table.limits.area(), &table.sensors.positions, stop);
    let away_m2 = |&id: &u32| (table.sensors.position(id) - start).norm_squared();
    let first = (0..order.len()).min_by(|&a, &b| away_m2(&order[a]).total_cmp(&away_m2(&order[b])));
    order.rotate_left(first.unwrap_or(0));
    order
}

/// Where to fly from `position`: in as few slots as it takes to get in range of `current`, and to the point in range
/// that is nearest to `next`.
fn waypoint(table: &MissionTable, position: &Position, [current, next]: [&Position; 2]) -> Position {
    let range = Disk { centre: *current, radius_m: table.limits.comm_radius_m };
    let slots = slots_between(position, &range, table.limits.reach_m);
    let reach = Disk { centre: *position, radius_m: table.limits.reach_m * slots };
    let end = nearest_in_both(next, &reach, &range);
    position + (end - position) / slots
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mission_table::tests::table_of;

    /// From `position`, toward SN 0 with the last SN after it.
    fn from(position: [f64; 2], positions_m: &[[f64; 2]]) -> Position {
        let table = table_of(positions_m);
        let last = table.sensors.positions[table.sensors.positions.len() - 1];
        waypoint(&table, &position.into(), [&table.sensors.positions[0], &last])
    }

    #[test]
    fn a_tour_begins_with_the_sensor_node_nearest_to_the_start() {
        let table = table_of(&[[90.0, 90.0], [50.0, 80.0]]);
        assert_eq!(order(&table, &Position::new(50.0, 50.0), &Stop::default()), [1, 0]);
    }

    #[test]
    fn a_tour_turns_at_the_rim_toward_the_next_sensor_node() {
        let positions = [[50.0, 90.0], [90.0, 90.0]];
        // SN 0 is 40 m away, in range after 30 m; the one point there is (50, 80).
        assert!((from([50.0, 50.0], &positions) - Position::new(50.0, 80.0)).norm() < 1e-4);
        // From (50, 70) the whole disk around SN 0 is in reach; (60, 90) is nearest to SN 1.
        assert!((from([50.0, 70.0], &positions) - Position::new(60.0, 90.0)).norm() < 1e-9);
    }

    #[test]
    fn a_leg_of_two_slots_is_flown_in_equal_steps() {
        // 48 m away, 38 m to the rim, two slots; alone, its own next: (50, 98) is 24 m a slot.
        assert!((from([50.0, 50.0], &[[50.0, 98.0]]) - Position::new(50.0, 74.0)).norm() < 1e-9);
    }
}
