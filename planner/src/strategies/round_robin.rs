//! `round-robin`: cyclic service in the order of ids.
//!
//! The UAV flies over one sensor node (SN) after the other. An SN is served as soon as it is in range, with the n − 1
//! fullest of the others.

use super::turns::InTurn;
use crate::geometry::turns::Turns;
use crate::mission_table::MissionTable;
use crate::strategy::Registered;

/// The strategy in the registry.
pub const STRATEGY: Registered =
    Registered::new("round-robin", "round robin: over one sensor node after the other, by id", |setup| {
        // Straight toward the SN whose turn it is, until above it.
        let waypoint = |table: &MissionTable, position: &_, _: [&_; 2], above: &_| table.motion.toward(position, above);
        let sensors = &setup.table.sensors;
        let turns = Turns { order: sensors.ids().collect(), points: sensors.positions.clone() };
        Box::new(InTurn::new(setup, turns, false, |_, _| 0, waypoint))
    })
    .with_state()
    .without_weights();

#[cfg(test)]
mod tests {
    use crate::strategies::tests::made;
    use crate::strategy::tests::view;

    #[test]
    fn round_robin_flies_straight_over_each_sensor_node_in_order() {
        let (table, mut round_robin) = made("round-robin", &[[80.0, 90.0], [50.0, 60.0]]);
        let mut waypoint = |slot, ground| {
            let decision = round_robin.plan(&view(&table, slot, ground, &[9, 9])).unwrap();
            (decision.waypoint.xy().into(), decision.schedule.to_vec())
        };
        // (30, 40) is 50 m away: 30 m of it are (18, 24); then 20 m are left.
        assert_eq!(waypoint(1, [50.0, 50.0]), ([68.0, 74.0], vec![]));
        assert_eq!(waypoint(2, [68.0, 74.0]), ([80.0, 90.0], vec![0]), "served, which ends its turn");
        assert_eq!(waypoint(3, [80.0, 90.0]).1, [0; 0], "on the way");
        assert_eq!(waypoint(4, [50.0, 59.0]), ([50.0, 60.0], vec![1]));
        assert_eq!(waypoint(5, [50.0, 60.0]).1, [0; 0]);
        assert_eq!(waypoint(6, [80.0, 89.0]), ([80.0, 90.0], vec![0]), "and again from the first");
    }

    #[test]
    fn the_current_turn_is_served_before_fuller_queues() {
        let positions = [[50.0, 50.0], [51.0, 50.0], [52.0, 50.0], [53.0, 50.0], [54.0, 50.0]];
        let (table, mut round_robin) = made("round-robin", &positions);
        let mut served = |slot| round_robin.plan(&view(&table, slot, [50.0, 50.0], &[1, 9, 8, 7, 6])).unwrap().schedule;
        assert_eq!(served(1)[..], [0, 1, 2, 3], "SN 0 instead of SN 4");
        assert_eq!(served(2)[..], [1, 2, 3, 4], "SN 0 had its turn");
        assert_eq!(served(3)[..], [0, 1, 2, 3]);
    }
}
