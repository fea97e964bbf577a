//! Straight flight toward a sensor node (SN), and the transit rule for slots without a decision.

use skysink_common::geometry::{Position, distance_squared};

use super::Serving;
use crate::strategy::{Decision, View};

/// The decision of a slot that the strategy leaves to transit: it serves the fullest queues around the waypoint.
pub fn transit_decision(serving: &mut Serving, view: &View) -> Decision {
    let mut values = Vec::new(); // allocated only where weights differ
    let ground = view.ground();
    let goal = transit_goal(&view.table.sensors.positions, &ground, view.values(&mut values));
    serving.serve_fullest(view, &goal.map_or(ground, |goal| view.table.motion.toward(&ground, goal)))
}

/// The goal of transit (decision D8): the SN with the largest queue; `None` in an empty field. The UAV flies there at
/// full speed, and stops on it. `positions` and `queues_bits` [bit] are by id.
///
/// Ties go to the nearest, then to the lowest index. It reads all N queues in order, and the positions of those that
/// are not below the fullest so far. At N = 10^6 that takes about a third of a millisecond, and one to two where all
/// queues are equal.
#[must_use]
pub fn transit_goal<'a>(positions: &'a [Position], position: &Position, queues_bits: &[u32]) -> Option<&'a Position> {
    let mut fullest: Option<(u32, f64, &Position)> = None;
    for (&queue_bits, goal) in queues_bits.iter().zip(positions) {
        if fullest.is_some_and(|(most_bits, ..)| queue_bits < most_bits) {
            continue;
        }
        let away_m2 = distance_squared(goal, position);
        let is_first = |(most_bits, nearest_m2, _): (u32, f64, _)| {
            queue_bits > most_bits || away_m2.total_cmp(&nearest_m2).is_lt()
        };
        if fullest.is_none_or(is_first) {
            fullest = Some((queue_bits, away_m2, goal));
        }
    }
    fullest.map(|(.., goal)| goal)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mission_table::MissionTable;
    use crate::mission_table::tests::table_of;

    fn transit(table: &MissionTable, position: &Position, queues_bits: &[u32]) -> Position {
        table.motion.toward(position, transit_goal(&table.sensors.positions, position, queues_bits).unwrap())
    }

    #[test]
    fn transit_flies_straight_at_full_speed() {
        let table = table_of(&[[65.0, 85.0], [5.0, 6.0]]);
        // From (5, 5) to (65, 85) is (60, 80), 100 m: 30 m of it are (18, 24).
        let waypoint = transit(&table, &Position::new(5.0, 5.0), &[8, 7]);
        assert!((waypoint - Position::new(23.0, 29.0)).norm() < 1e-12, "{waypoint}");
    }

    #[test]
    fn transit_stops_at_a_goal_within_reach() {
        let table = table_of(&[[50.1, 79.9]]);
        assert_eq!(transit(&table, &Position::new(50.1, 50.0), &[8]), table.sensors.positions[0]);
        assert_eq!(transit(&table, &table.sensors.positions[0], &[8]), table.sensors.positions[0]);
    }

    #[test]
    fn transit_ties_go_to_the_nearest_then_the_lowest_index() {
        let table = table_of(&[[10.0, 50.0], [50.0, 71.0], [50.0, 30.0], [70.0, 50.0]]);
        let position = Position::new(50.0, 50.0);
        assert_eq!(transit(&table, &position, &[5, 5, 5, 5]), table.sensors.positions[2]);
        assert_eq!(transit(&table, &position, &[4, 5, 4, 4]), table.sensors.positions[1]);
    }
}
